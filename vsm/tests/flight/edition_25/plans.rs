//! Missions: #800 to #806 there and back, contingency waypoints, and what one route cannot be.

use std::collections::BTreeMap;

use kit::bridge::vehicle_id;
use px4_sim::Mode as Px4;
use serde_json::{Value, json};
use stanag_msgs::enums::MissionPlanMode;

use super::*;

fn with(mut waypoint: Value, field: &str, value: u16) -> Value {
    waypoint[field] = json!(value);
    waypoint
}

fn send_square(rig: &mut Rig, station: &mut StationEd25) {
    let sent = [
        (801, route(101, "R1", 2)),
        (802, waypoint(101, 102, 40.0, 0.0)),
        (802, waypoint(102, 103, 40.0, 40.0)),
        (
            803,
            json!({ "Waypoint Number": 102, "Waypoint Loiter Time": 4, "Waypoint Loiter Type": 4 }),
        ),
        (802, waypoint(103, 0, 0.0, 40.0)),
    ];
    for (number, fields) in sent {
        station.send(rig, vehicle_id(0), number, &fields);
    }
    rig.run(0.5);
}

#[test]
fn a_route_is_uploaded_flown_and_downloaded_as_it_was_sent() {
    let (mut rig, mut station) = ready();
    send_square(&mut rig, &mut station);
    assert_eq!(
        transfer(&mut rig, &mut station, 2),
        Some(1),
        "{:?}",
        station.alerts(&rig)
    );
    take_off(&mut rig, &mut station, 20.0);
    mode(&mut rig, &mut station, 11);
    assert!(rig.until(20.0, |rig| rig.truth().mode == Px4::Mission));
    assert!(rig.until(120.0, |rig| rig.truth().position.e > 38.0
        && rig.truth().position.n < 5.0));
    let flown: Vec<_> = station
        .take(&rig, 110)
        .iter()
        .filter_map(|one| one["To Waypoint Number"].as_u64())
        .collect();
    for number in [101, 102, 103] {
        assert!(flown.contains(&number), "{number} in {flown:?}");
    }
    // Whatever is downloaded is what was sent, field by field.
    assert_eq!(transfer(&mut rig, &mut station, 3), Some(1));
    let routes = station.take(&rig, 801);
    assert_eq!(
        (&routes[0]["Route ID"], &routes[0]["Route Type"]),
        (&json!("R1"), &json!(2))
    );
    let waypoints = station.take(&rig, 802);
    assert_eq!(waypoints.len(), 3);
    let expected = waypoint(102, 103, 40.0, 40.0);
    let second = waypoints
        .iter()
        .find(|one| one["Waypoint Number"] == 102)
        .unwrap();
    for field in [
        "Waypoint to Latitude or Relative Y",
        "Waypoint to Longitude or Relative X",
    ] {
        let (sent, back) = (
            expected[field].as_f64().unwrap(),
            second[field].as_f64().unwrap(),
        );
        assert!((sent - back).abs() < 3e-9, "{field}");
    }
    assert_eq!(second["Next Waypoint"], 103);
    assert_eq!(second["Waypoint to Altitude"], json!(20.0));
    let loiters = station.take(&rig, 803);
    assert_eq!(loiters[0]["Waypoint Loiter Time"], 4);
}

#[test]
fn contingency_waypoints_are_routes_and_differing_ones_are_refused() {
    let (mut rig, mut station) = ready();
    let plan = |a: u16| {
        vec![
            (801, route(1, "R1", 2)),
            (
                802,
                with(waypoint(1, 2, 40.0, 0.0), "Contingency Waypoint A", 20),
            ),
            (
                802,
                with(waypoint(2, 0, 80.0, 0.0), "Contingency Waypoint A", a),
            ),
            (802, waypoint(20, 0, -40.0, 0.0)),
            (802, waypoint(30, 0, 0.0, -40.0)),
        ]
    };
    for (number, fields) in plan(30) {
        station.send(&mut rig, vehicle_id(0), number, &fields);
    }
    rig.run(0.5);
    let alerts = station.alerts(&rig).concat();
    assert!(
        alerts.contains(
            "#802 (AV Position Waypoint) of 1b:00:00:b0 refused: Contingency Waypoint A 30"
        ),
        "{alerts}"
    );
    // Carrying on from one waypoint, and elsewhere from the other.
    for (number, fields) in plan(0) {
        station.send(&mut rig, vehicle_id(0), number, &fields);
    }
    rig.run(0.5);
    assert_eq!(transfer(&mut rig, &mut station, 2), Some(2));
    let alerts = station.alerts(&rig).concat();
    assert!(
        alerts.contains("#800 (Mission Upload Command) refused: route R1: Contingency Waypoint A"),
        "{alerts}"
    );
    for (number, fields) in plan(20) {
        station.send(&mut rig, vehicle_id(0), number, &fields);
    }
    rig.run(0.5);
    assert_eq!(
        transfer(&mut rig, &mut station, 2),
        Some(1),
        "{:?}",
        station.alerts(&rig)
    );
    assert_eq!(transfer(&mut rig, &mut station, 3), Some(1));
    let contingency = station.take(&rig, 801);
    let contingency = contingency.iter().find(|one| one["Route Type"] == 3);
    assert_eq!(
        contingency.expect("a contingency route A")["Initial Waypoint Number"],
        20
    );
    let waypoints = station.take(&rig, 802);
    let of = |number: u16| {
        let one = waypoints
            .iter()
            .find(|one| one["Waypoint Number"] == number);
        one.unwrap_or_else(|| panic!("{number} of {waypoints:?}"))["Contingency Waypoint A"].clone()
    };
    assert_eq!((of(1), of(2), of(20)), (json!(20), json!(20), json!(0)));
}

#[test]
fn a_loiter_time_of_zero_is_no_loiter() {
    let (mut rig, mut station) = ready();
    for (number, fields) in [
        (801, route(1, "R1", 2)),
        (802, waypoint(1, 2, 40.0, 0.0)),
        (
            803,
            json!({ "Waypoint Number": 1, "Waypoint Loiter Type": 4 }),
        ),
        (802, waypoint(2, 0, 60.0, 0.0)),
    ] {
        station.send(&mut rig, vehicle_id(0), number, &fields);
    }
    rig.run(0.5);
    assert_eq!(
        transfer(&mut rig, &mut station, 2),
        Some(1),
        "{:?}",
        station.alerts(&rig)
    );
    take_off(&mut rig, &mut station, 20.0);
    mode(&mut rig, &mut station, 11);
    // It is kept as it was sent, and flown through: absent in Edition 4 it would have no end.
    transfer(&mut rig, &mut station, MissionPlanMode::Download.raw());
    assert_eq!(station.take(&rig, 803)[0]["Waypoint Loiter Time"], 0);
    let flown = rig.until(60.0, |rig| rig.truth().position.n > 54.0);
    assert!(flown, "{:?} {:?}", rig.truth(), station.alerts(&rig));
}

#[test]
fn a_plan_of_edition_4_reaches_a_station_of_edition_25() {
    let (mut rig, mut station) = rig();
    assert!(rig.carry_out(orders::request_control()).is_some());
    rig.send_plan(orders::square());
    assert!(rig.carry_out(orders::load()).is_some());
    assert!(rig.carry_out(orders::request_control()).is_some());
    // Control passes by a release.
    let release = stanag_msgs::messages::CucsAuthorisationRequest {
        requested_handover_access: Some(stanag_msgs::enums::RequestedAccess::Relinquish),
        ..Default::default()
    };
    assert!(rig.carry_out(release).is_some());
    let granted = request(&mut rig, &mut station, LOI_4_AND_5, 1);
    assert_ne!(granted[0]["LOI Granted"], 0);
    assert_eq!(
        transfer(&mut rig, &mut station, MissionPlanMode::Download.raw()),
        Some(1)
    );
    let mut numbers: Vec<_> = station
        .take(&rig, 802)
        .iter()
        .filter_map(|one| one["Waypoint Number"].as_u64())
        .collect();
    numbers.sort_unstable();
    assert_eq!(numbers, [101, 102, 103, 104]);
}

/// Waypoint 1, which goes on to `next` and names 20 for contingency A where it names one; 20, and a route to them.
fn mission(a: u16, next: u16) -> [(u16, Value); 3] {
    [
        (801, route(1, "R1", 2)),
        (
            802,
            with(waypoint(1, next, 40.0, 0.0), "Contingency Waypoint A", a),
        ),
        (802, waypoint(20, 0, -40.0, 0.0)),
    ]
}

fn send_all(rig: &mut Rig, station: &mut StationEd25, messages: &[(u16, Value)]) {
    for (number, fields) in messages {
        station.send(rig, vehicle_id(0), *number, fields);
    }
    rig.run(0.5);
}

/// The routes and waypoints of a download.
fn downloaded(rig: &mut Rig, station: &mut StationEd25) -> (Vec<u64>, Vec<u64>) {
    station.receive(rig);
    station.received.clear();
    assert_eq!(
        transfer(rig, station, 3),
        Some(1),
        "{:?}",
        station.alerts(rig)
    );
    let mut numbers = |of: u16, field: &str| {
        let all = station.take(rig, of);
        let mut all: Vec<_> = all.iter().filter_map(|one| one[field].as_u64()).collect();
        all.sort_unstable();
        all
    };
    (numbers(801, "Route Type"), numbers(802, "Waypoint Number"))
}

#[test]
fn a_mission_that_names_no_contingency_keeps_none_of_an_earlier_one() {
    let (mut rig, mut station) = ready();
    send_all(&mut rig, &mut station, &mission(20, 0));
    assert_eq!(transfer(&mut rig, &mut station, 2), Some(1));
    assert_eq!(downloaded(&mut rig, &mut station).0, [2, 3]);
    // Named again, in any order, and by a change of a single waypoint, it stays.
    let [flight, first, other] = mission(20, 0);
    send_all(&mut rig, &mut station, &[first.clone(), other, flight]);
    assert_eq!(transfer(&mut rig, &mut station, 2), Some(1));
    send_all(&mut rig, &mut station, &[first]);
    assert_eq!(transfer(&mut rig, &mut station, 2), Some(1));
    assert_eq!(downloaded(&mut rig, &mut station).0, [2, 3]);
    // The same number, now on the way of the flight.
    send_all(&mut rig, &mut station, &mission(0, 20));
    let loaded = transfer(&mut rig, &mut station, 2);
    assert_eq!(loaded, Some(1), "{:?}", station.alerts(&rig));
    assert_eq!(downloaded(&mut rig, &mut station).0, [2]);
}

/// The #801 last, so that it does not begin the upload.
#[test]
fn a_refused_upload_is_dropped_and_its_correction_is_loaded_in_any_order() {
    let (mut rig, mut station) = ready();
    let upload = |second: u16| {
        let [flight, first, other] = mission(20, 2);
        let next = with(waypoint(2, 0, 80.0, 0.0), "Contingency Waypoint A", second);
        [first, (802, next), other, flight]
    };
    for _ in 0..2 {
        send_all(&mut rig, &mut station, &upload(0));
        assert_eq!(transfer(&mut rig, &mut station, 2), Some(2));
        send_all(&mut rig, &mut station, &upload(20));
        let loaded = transfer(&mut rig, &mut station, 2);
        assert_eq!(loaded, Some(1), "{:?}", station.alerts(&rig));
    }
    // As it was sent, and none where the contingency route leads.
    station.receive(&rig);
    station.received.clear();
    assert_eq!(transfer(&mut rig, &mut station, 3), Some(1));
    let mut named: Vec<_> = station
        .take(&rig, 802)
        .iter()
        .map(|one| {
            (
                one["Waypoint Number"].as_u64(),
                one["Contingency Waypoint A"].as_u64(),
            )
        })
        .collect();
    named.sort_unstable();
    let expected = [(1, 20), (2, 20), (20, 0)];
    assert_eq!(named, expected.map(|(of, to)| (Some(of), Some(to))));
}

#[test]
fn an_upload_survives_a_repeated_route_and_a_restart() {
    let (mut rig, mut station) = ready();
    let [flight, first, other] = mission(20, 2);
    let flight = station.datagram(&rig, vehicle_id(0), flight.0, &flight.1);
    rig.deliver_from(station.address, &flight);
    send_all(&mut rig, &mut station, std::slice::from_ref(&first));
    rig.deliver_from(station.address, &flight);
    let second = with(waypoint(2, 3, 80.0, 0.0), "Contingency Waypoint A", 20);
    send_all(&mut rig, &mut station, &[(802, second)]);
    rig.restart_bridge();
    rig.run(12.0);
    rig.deliver_from(station.address, &flight);
    let third = with(waypoint(3, 0, 90.0, 0.0), "Contingency Waypoint A", 20);
    send_all(&mut rig, &mut station, &[(802, third), other]);
    // Which contingencies the first two name was written.
    let loaded = transfer(&mut rig, &mut station, 2);
    assert_eq!(loaded, Some(1), "{:?}", station.alerts(&rig));
    let expected = (vec![2, 3], vec![1, 2, 3, 20]);
    assert_eq!(downloaded(&mut rig, &mut station), expected);
    // Also of a mission that was loaded: one waypoint that leads elsewhere than the others is refused as before a restart.
    rig.restart_bridge();
    rig.run(12.0);
    send_all(&mut rig, &mut station, &[(802, waypoint(2, 3, 80.0, 0.0))]);
    assert_eq!(transfer(&mut rig, &mut station, 2), Some(2));
    let alerts = station.alerts(&rig).concat();
    let named = "Contingency Waypoint A of waypoint 1 is";
    assert!(alerts.contains(named), "{alerts}");
}

#[test]
fn an_upload_whose_contingencies_are_lost_with_the_disk_is_refused_until_they_are_sent_again() {
    refused_until_sent_again(|records| {
        records.retain(|name, _| !name.starts_with("contingencies-"));
    });
}

/// Of a file that something else has written to nothing counts in part.
#[test]
fn contingencies_in_a_file_of_any_length_are_refused_until_they_are_sent_again() {
    refused_until_sent_again(|records| {
        let mut logs = records.iter_mut();
        let (_, log) = logs
            .find(|(name, _)| name.starts_with("contingencies-"))
            .expect("it was written");
        log.resize((16 << 20) + 1, b'\n');
    });
}

fn refused_until_sent_again(lose: impl FnOnce(&mut BTreeMap<String, Vec<u8>>)) {
    let (mut rig, mut station) = ready();
    let [flight, first, other] = mission(20, 2);
    let flight = station.datagram(&rig, vehicle_id(0), flight.0, &flight.1);
    rig.deliver_from(station.address, &flight);
    send_all(&mut rig, &mut station, std::slice::from_ref(&first));
    let second = with(waypoint(2, 3, 80.0, 0.0), "Contingency Waypoint A", 20);
    send_all(&mut rig, &mut station, &[(802, second)]);
    lose(&mut rig.store.records);
    rig.restart_bridge();
    rig.run(12.0);
    rig.deliver_from(station.address, &flight);
    let third = with(waypoint(3, 0, 90.0, 0.0), "Contingency Waypoint A", 20);
    send_all(&mut rig, &mut station, &[(802, third), other]);
    assert_eq!(transfer(&mut rig, &mut station, 2), Some(2));
    let alerts = station.alerts(&rig).concat();
    assert!(
        alerts.contains("the contingency waypoint of waypoint 1"),
        "{alerts}"
    );
    let second = with(waypoint(2, 3, 80.0, 0.0), "Contingency Waypoint A", 20);
    send_all(&mut rig, &mut station, &[first, (802, second)]);
    let loaded = transfer(&mut rig, &mut station, 2);
    assert_eq!(loaded, Some(1), "{:?}", station.alerts(&rig));
    let expected = (vec![2, 3], vec![1, 2, 3, 20]);
    assert_eq!(downloaded(&mut rig, &mut station), expected);
}

#[test]
fn a_loiter_that_is_taken_back_after_a_restart_is_gone() {
    let (mut rig, mut station) = ready();
    let loiter = |time: u16| {
        let fields = json!({
            "Waypoint Number": 1, "Waypoint Loiter Time": time, "Waypoint Loiter Type": 4,
        });
        (803, fields)
    };
    let [flight, first, other] = mission(0, 20);
    let whole = [flight, first, other];
    send_all(&mut rig, &mut station, &whole);
    send_all(&mut rig, &mut station, &[loiter(4)]);
    assert_eq!(transfer(&mut rig, &mut station, 2), Some(1));
    rig.restart_bridge();
    rig.run(12.0);
    send_all(&mut rig, &mut station, &[loiter(0)]);
    let loaded = transfer(&mut rig, &mut station, 2);
    assert_eq!(loaded, Some(1), "{:?}", station.alerts(&rig));
    downloaded(&mut rig, &mut station);
    let loiters = station.take(&rig, 803);
    assert_eq!(loiters[0]["Waypoint Loiter Time"], 0, "{loiters:?}");
}
