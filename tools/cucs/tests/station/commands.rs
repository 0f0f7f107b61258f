//! A station on a real socket: each operation ends carried out, refused with the reasons, or with an error that names
//! what was expected.

use std::net::SocketAddr;
use std::time::Duration;

use crate::support::*;
use cucs::{Delivery, Event, Outcome, Route, Station, StationError, Waypoint};
use stanag_msgs::enums::{AltitudeType, FlightPathControlMode as Mode, LoiBitmap, RequestedAccess};
use stanag_msgs::messages::VehicleOperatingModeReport;
use stanag_msgs::{Message, TimeStamp};
use tokio::net::UdpSocket;

fn anywhere() -> SocketAddr {
    "127.0.0.1:0".parse().unwrap()
}

/// A station, and the socket of its VSM.
async fn pair() -> (Station, UdpSocket) {
    let socket = UdpSocket::bind(anywhere()).await.unwrap();
    let mut station = Station::bind(CUCS, anywhere(), socket.local_addr().unwrap())
        .await
        .unwrap();
    station.timeouts.answer = Duration::from_millis(1_500);
    station.timeouts.transfer = Duration::from_secs(4);
    station.timeouts.command = Duration::from_secs(4);
    (station, socket)
}

async fn serve(vsm: &mut FakeVsm, socket: &UdpSocket) {
    let mut buffer = [0; 2_048];
    loop {
        let (bytes, from) = socket.recv_from(&mut buffer).await.unwrap();
        for answer in vsm.handle(&buffer[..bytes]) {
            socket.send_to(&answer, from).await.unwrap();
        }
    }
}

/// Runs the operation while the VSM serves.
macro_rules! beside {
    ($vsm:expr, $socket:expr, $operation:expr) => {
        tokio::select! {
            outcome = $operation => outcome,
            () = serve(&mut $vsm, &$socket) => unreachable!(),
        }
    };
}

fn route(count: u16) -> Route {
    let point = |number| Waypoint {
        number,
        latitude_deg: 47.4,
        longitude_deg: 8.5,
        altitude_m: 30.0,
        altitude_type: Some(AltitudeType::Agl),
        next: if number == count { 0 } else { number + 1 },
        ..Waypoint::default()
    };
    Route {
        id: Some("r".into()),
        mission_id: Some("m".into()),
        waypoints: (1..=count).map(point).collect(),
        ..Route::default()
    }
}

#[tokio::test]
async fn an_operation_is_carried_out_from_discovery_to_release() {
    let (mut station, socket) = pair().await;
    let mut vsm = FakeVsm::new();
    let found = beside!(vsm, socket, station.discover()).unwrap();
    assert_eq!(found.len(), 1);
    assert_eq!(
        (found[0].vehicle, found[0].vsm, found[0].vehicle_type),
        (VEHICLE, Some(VSM), 2)
    );
    assert_eq!(
        (found[0].authorised.raw(), found[0].granted.raw()),
        (0x0d, 0)
    );

    let levels = LoiBitmap::LOI4 | LoiBitmap::LOI5;
    let granted = beside!(
        vsm,
        socket,
        station.request(VEHICLE, levels, RequestedAccess::Request)
    );
    assert_eq!(granted.unwrap(), levels);
    let sent = route(120);
    let outcome = beside!(vsm, socket, station.send_route(VEHICLE, &sent)).unwrap();
    assert_eq!(outcome, Outcome::CarriedOut);
    assert_eq!(vsm.waypoints.len(), 120);
    let outcome = beside!(
        vsm,
        socket,
        station.launch(VEHICLE, 30.0, AltitudeType::Agl)
    )
    .unwrap();
    assert!(outcome.is_carried_out());
    let Some(Message::VehicleOperatingModeCommand(launch)) = vsm.carried_out.last() else {
        panic!("no launch");
    };
    assert_eq!(launch.select_flight_path_control_mode, Some(Mode::Launch));
    assert_eq!(launch.commanded_altitude.unwrap().si(), 30.0);
    assert_eq!(launch.altitude_type, Some(AltitudeType::Agl));
    beside!(vsm, socket, station.fly_route(VEHICLE, Some(3), Some(7.5))).unwrap();
    let Some(Message::VehicleOperatingModeCommand(fly)) = vsm.carried_out.last() else {
        panic!("no flight");
    };
    assert_eq!(
        (
            fly.commanded_waypoint_number,
            fly.commanded_speed.unwrap().si()
        ),
        (Some(3), 7.5)
    );
    beside!(vsm, socket, station.land(VEHICLE)).unwrap();
    beside!(vsm, socket, station.release(VEHICLE)).unwrap();
    assert_eq!(vsm.granted, LoiBitmap::NONE);
    assert_eq!(station.vehicle(VEHICLE).unwrap().granted(), LoiBitmap::NONE);
    assert_eq!(station.session().traffic().retransmitted, 0);
}

#[tokio::test]
async fn a_download_fetches_again_what_did_not_come() {
    let (mut station, socket) = pair().await;
    let mut vsm = FakeVsm::new();
    let sent = route(20);
    beside!(vsm, socket, station.send_route(VEHICLE, &sent)).unwrap();
    vsm.forgets = vec![2, 11, 12, 13, 19, 20];
    let download = beside!(vsm, socket, station.download(VEHICLE)).unwrap();
    assert!(download.missing().is_empty());
    let [back] = &Route::from_download(&download).unwrap()[..] else {
        panic!("one route")
    };
    assert_eq!(back.messages(VEHICLE, CUCS).unwrap().len(), 21);
    let numbers = |route: &Route| {
        route
            .waypoints
            .iter()
            .map(|point| point.number)
            .collect::<Vec<_>>()
    };
    assert_eq!(numbers(back), numbers(&sent));
}

#[tokio::test]
async fn a_download_whose_end_is_lost_is_completed() {
    let (mut station, socket) = pair().await;
    let mut vsm = FakeVsm::new();
    beside!(vsm, socket, station.discover()).unwrap();
    let sent = route(60);
    beside!(vsm, socket, station.send_route(VEHICLE, &sent)).unwrap();
    vsm.forgets = (40..=60).collect();
    vsm.loses_the_end = true;
    let download = beside!(vsm, socket, station.download(VEHICLE)).unwrap();
    assert_eq!(download.waypoints().count(), 60);
    assert!(download.missing().is_empty());
}

#[tokio::test]
async fn a_refusal_names_the_waypoint_and_the_reason() {
    let (mut station, socket) = pair().await;
    let mut vsm = FakeVsm::new();
    let why = "waypoint 2: 6123 m above home, expected -500 to 5000 m above home";
    vsm.refuse_load = Some((2, why.to_owned()));
    let sent = route(3);
    let outcome = beside!(vsm, socket, station.send_route(VEHICLE, &sent)).unwrap();
    let refused = outcome.accepted().unwrap_err();
    assert_eq!(refused.waypoint, Some(2));
    assert_eq!(refused.reasons, [format!("13000 refused: {why}")]);
    assert!(
        refused
            .to_string()
            .contains("for waypoint 2: waypoint 2: 6123 m above home"),
        "{refused}"
    );

    vsm.refuse_mode = Some("no route has been loaded".to_owned());
    let outcome = beside!(vsm, socket, station.fly_route(VEHICLE, None, None)).unwrap();
    let refused = outcome.accepted().unwrap_err();
    assert_eq!(refused.reasons, ["2016 refused: no route has been loaded"]);
}

#[tokio::test]
async fn rights_that_a_release_leaves_are_an_error() {
    let (mut station, socket) = pair().await;
    let mut vsm = FakeVsm::new();
    let levels = LoiBitmap::LOI2;
    beside!(
        vsm,
        socket,
        station.request(VEHICLE, levels, RequestedAccess::Request)
    )
    .unwrap();
    vsm.keeps_rights = true;
    let error = beside!(vsm, socket, station.release(VEHICLE)).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("release requested, LOI 2 (monitor) still held"),
        "{text}"
    );
    vsm.keeps_rights = false;
    beside!(vsm, socket, station.release(VEHICLE)).unwrap();
}

/// What the wait of the test below was for.
static WAITS: std::sync::Mutex<Vec<String>> = std::sync::Mutex::new(Vec::new());

/// A VSM whose disk is busy, or that waits for the load of another CUCS, receives a request and decides it later.
#[tokio::test]
async fn a_request_that_was_received_is_waited_for_and_not_made_again() {
    let (mut station, socket) = pair().await;
    station.on_wait = Some(|what, _| WAITS.lock().unwrap().push(what.to_owned()));
    let mut vsm = FakeVsm::new();
    // Longer than an answer may take.
    vsm.decides_after = 3;
    let granted = beside!(
        vsm,
        socket,
        station.request(VEHICLE, LoiBitmap::LOI4, RequestedAccess::Request)
    );
    assert_eq!(granted.unwrap(), LoiBitmap::LOI4);
    let requests = vsm.carried_out.len();
    assert_eq!(requests, 1, "{:?}", vsm.carried_out);
    let waits = WAITS.lock().unwrap().join("; ");
    assert!(waits.contains("on the received message 1"), "{waits}");

    vsm.decides_after = 3;
    beside!(vsm, socket, station.release(VEHICLE)).unwrap();
    assert_eq!(vsm.carried_out.len(), 2);

    vsm.decides_after = u32::MAX;
    station.timeouts.command = Duration::from_secs(2);
    let error = beside!(
        vsm,
        socket,
        station.request(VEHICLE, LoiBitmap::LOI4, RequestedAccess::Request)
    );
    let error = error.unwrap_err().to_string();
    assert!(
        error.contains("no decision (17000 type 2, carried out, or 3, refused)")
            && error.contains("within 2 s"),
        "{error}"
    );
}

#[tokio::test]
async fn rights_that_are_not_granted_are_an_error() {
    let (mut station, socket) = pair().await;
    let mut vsm = FakeVsm::new();
    vsm.authorised = LoiBitmap::LOI2;
    let levels = LoiBitmap::LOI2 | LoiBitmap::LOI5;
    let error = beside!(
        vsm,
        socket,
        station.request(VEHICLE, levels, RequestedAccess::Request)
    )
    .unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("LOI 2, 5 (monitor, launch) requested, 2 (monitor) granted; this CUCS may hold 2 (monitor)"),
        "{text}"
    );
    vsm.authorised = LoiBitmap::from_raw(0x0f);
    beside!(
        vsm,
        socket,
        station.request(VEHICLE, levels, RequestedAccess::Request)
    )
    .unwrap();
}

#[tokio::test]
async fn a_vsm_that_is_not_there_is_reported_as_such() {
    let free = UdpSocket::bind(anywhere())
        .await
        .unwrap()
        .local_addr()
        .unwrap();
    let mut station = Station::bind(CUCS, anywhere(), free).await.unwrap();
    station.timeouts.answer = Duration::from_millis(700);
    let error = station.discover().await.unwrap_err();
    assert!(
        matches!(
            error,
            StationError::NoVsm {
                unreachable: true,
                ..
            }
        ),
        "{error}"
    );
    let text = error.to_string();
    assert!(
        text.contains(&free.to_string()) && text.contains("0.7 s"),
        "{text}"
    );
    let error = station.land(VEHICLE).await.unwrap_err();
    assert!(matches!(error, StationError::NoVsm { .. }), "{error}");
}

#[tokio::test]
async fn a_timeout_names_what_was_expected_and_what_was_received() {
    let (mut station, socket) = pair().await;
    let mut vsm = FakeVsm::new();
    beside!(vsm, socket, station.discover()).unwrap();
    // Answers requests, but acknowledges nothing.
    vsm.mute = true;
    let began = std::time::Instant::now();
    let error = beside!(vsm, socket, station.land(VEHICLE))
        .unwrap_err()
        .to_string();
    let took_s = began.elapsed().as_secs_f64();
    assert!(error.contains("acknowledgement (17000) of 2016"), "{error}");
    // It ends after its last try, before the command's time is up.
    let named_s = error
        .split_once(" within ")
        .and_then(|(_, rest)| rest.split_once(" s; "));
    let named_s: f64 = named_s.expect("a time").0.parse().expect("seconds");
    assert!(
        (took_s - named_s).abs() < 0.3 && took_s < station.timeouts.command.as_secs_f64(),
        "{took_s}: {error}"
    );
    assert!(
        error.contains("last report: 1b:00:01:01 LOI none"),
        "{error}"
    );
    let within = Duration::from_millis(100);
    let waiting = station.wait_until("mode 11", within, |session| {
        session
            .vehicle(VEHICLE)
            .is_some_and(|state| state.mode() == Some(Mode::Waypoint))
    });
    let error = beside!(vsm, socket, waiting).unwrap_err().to_string();
    assert!(
        error.starts_with("no mode 11 within 0.1 s; last reports: "),
        "{error}"
    );
    // #2 alone answers a request too.
    let granted = beside!(
        vsm,
        socket,
        station.request(VEHICLE, LoiBitmap::LOI4, RequestedAccess::Request)
    );
    assert_eq!(granted.unwrap(), LoiBitmap::LOI4);
}

#[tokio::test]
async fn events_and_conditions_follow_what_comes_in() {
    let (mut station, socket) = pair().await;
    let mut vsm = FakeVsm::new();
    let mode = VehicleOperatingModeReport {
        time_stamp: Some(TimeStamp(5)),
        select_flight_path_control_mode: Some(Mode::Waypoint),
    };
    let to = station.local_addr().unwrap();
    socket.send_to(&vsm.status(mode.into()), to).await.unwrap();
    for part in vsm.alert("no data from the vehicle: state unknown") {
        socket.send_to(&part, to).await.unwrap();
    }
    let within = Duration::from_secs(2);
    let reached = |session: &cucs::Session| {
        session
            .vehicle(VEHICLE)
            .is_some_and(|state| state.mode() == Some(Mode::Waypoint))
    };
    station
        .wait_until("mode 11", within, reached)
        .await
        .unwrap();
    let mut alerts = Vec::new();
    while alerts.is_empty() {
        if let Event::Alert { alert, .. } = station.next_event(within).await.unwrap() {
            alerts.push(alert.text);
        }
    }
    assert_eq!(alerts, ["no data from the vehicle: state unknown"]);
}

#[tokio::test]
async fn a_vsm_that_starts_late_is_found() {
    let address = UdpSocket::bind(anywhere())
        .await
        .unwrap()
        .local_addr()
        .unwrap();
    let mut station = Station::bind(CUCS, anywhere(), address).await.unwrap();
    let late = async {
        tokio::time::sleep(Duration::from_millis(800)).await;
        let socket = UdpSocket::bind(address).await.unwrap();
        serve(&mut FakeVsm::new(), &socket).await;
    };
    let found = tokio::select! {
        found = station.discover() => found.unwrap(),
        () = late => unreachable!(),
    };
    assert_eq!(found.len(), 1);
}

#[tokio::test]
async fn any_message_can_be_sent_and_its_end_awaited() {
    let (mut station, socket) = pair().await;
    let mut vsm = FakeVsm::new();
    let message = stanag_msgs::messages::LoiterConfiguration::default();
    let within = Duration::from_secs(2);
    let delivery = beside!(vsm, socket, station.send(VEHICLE, message, within)).unwrap();
    assert_eq!(delivery, Delivery::CarriedOut);
}
