//! Two vehicles and four ground stations at once: each receives what it may receive, and commands what it holds.

use kit::bridge::{Rig, Setup, orders, vehicle_id};
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, LoiBitmap, RequestedAccess};
use stanag_msgs::messages::CucsAuthorisationRequest;

/// Who holds what: station 0 vehicle 0, station 1 vehicle 1, station 2 listens to both, station 3 to vehicle 1.
fn rig(one_link: bool) -> Rig {
    let mut rig = Rig::new(Setup {
        vehicles: vec![px4_sim::Config::default(); 2],
        stations: 4,
        one_link,
        ..Setup::default()
    });
    rig.run(9.0);
    let listen = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::LOI2),
        ..orders::request_control()
    };
    for (station, vehicle, request) in [
        (0, 0, orders::request_control()),
        (1, 1, orders::request_control()),
        (2, 0, listen.clone()),
        (2, 1, listen.clone()),
        (3, 1, listen),
    ] {
        let ticket = rig.send_as(station, vehicle, request);
        assert_eq!(rig.end_as(station, ticket), Some(AckType::CarriedOut));
    }
    rig
}

#[test]
fn each_command_reaches_its_vehicle_and_each_report_its_stations() {
    fly_both(rig(false));
}

#[test]
fn so_it_does_where_the_vehicles_share_a_link() {
    fly_both(rig(true));
}

fn fly_both(mut rig: Rig) {
    let tickets: Vec<_> = [(0, 0, 15.0), (1, 1, 30.0)]
        .into_iter()
        .map(|(station, vehicle, height)| {
            (
                station,
                rig.send_as(station, vehicle, orders::launch(height)),
            )
        })
        .collect();
    for (station, ticket) in tickets {
        assert_eq!(rig.end_as(station, ticket), Some(AckType::CarriedOut));
    }
    let height = |rig: &Rig, vehicle: usize| -rig.vehicles[vehicle].vehicle().truth().position.d;
    assert!(rig.until(60.0, |rig| {
        (height(rig, 0) - 15.0).abs() < 1.0 && (height(rig, 1) - 30.0).abs() < 1.0
    }));

    // Who holds the other vehicle, or only listens, commands nothing, and its answer goes to it alone.
    for (station, vehicle) in [(0, 1), (1, 0), (2, 0), (2, 1), (3, 1), (3, 0)] {
        let before = rig.vehicles[vehicle].vehicle().counters().commands_accepted;
        let ticket = rig.send_as(station, vehicle, orders::mode(Mode::AutolandEngage));
        assert_eq!(rig.end_as(station, ticket), Some(AckType::Refused));
        rig.run(2.0);
        let after = rig.vehicles[vehicle].vehicle().counters().commands_accepted;
        assert_eq!(after, before, "station {station}, vehicle {vehicle}");
    }

    for (index, station) in rig.stations.iter().enumerate() {
        assert_eq!(station.misaddressed, 0, "station {index}");
        let heights: Vec<_> = (0..2)
            .map(|vehicle| {
                station.last(vehicle_id(vehicle), 4000, |message| match message {
                    Message::InertialStates(states) => states.altitude.map(|a| a.si()),
                    _ => None,
                })
            })
            .collect();
        let expected = [[true, false], [false, true], [true, true], [false, true]][index];
        assert_eq!([heights[0].is_some(), heights[1].is_some()], expected);
        if let [Some(low), Some(high)] = heights[..] {
            // Two homes in one place: what is reported apart is flown apart.
            assert!((high - low - 15.0).abs() < 2.0, "{low} and {high}");
        }
    }
}

#[test]
fn control_of_one_vehicle_changes_hands_and_the_other_sees_nothing_of_it() {
    let mut rig = rig(false);
    let release = CucsAuthorisationRequest {
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..orders::request_control()
    };
    let ticket = rig.send_as(0, 0, release);
    assert_eq!(rig.end_as(0, ticket), Some(AckType::CarriedOut));
    let marks: Vec<_> = rig.stations.iter().map(|s| s.received.len()).collect();
    let ticket = rig.send_as(2, 0, orders::request_control());
    assert_eq!(rig.end_as(2, ticket), Some(AckType::CarriedOut));
    let ticket = rig.send_as(2, 0, orders::launch(12.0));
    assert_eq!(rig.end_as(2, ticket), Some(AckType::CarriedOut));
    assert!(rig.vehicles[1].vehicle().truth().landed);
    for (station, mark) in [(0, marks[0]), (1, marks[1]), (3, marks[3])] {
        let misdirected = rig.stations[station].received[mark..]
            .iter()
            .filter(|(_, source, _)| *source == vehicle_id(0))
            .count();
        assert_eq!(
            misdirected, 0,
            "station {station} receives messages of vehicle 0"
        );
    }
}
