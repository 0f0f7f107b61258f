//! Discovery to release, and the fields of #41, #43 and #48 by what they do.

use kit::bridge::{VSM, vehicle_id};
use px4_sim::Mode as Px4;
use serde_json::json;
use stanag_msgs::Id;

use super::*;

#[test]
fn a_broadcast_shows_what_can_be_had_and_grants_nothing() {
    let (mut rig, mut station) = rig();
    let fields = json!({ "VSM ID": -1, "Data Link ID": Id::NULL.0 as i32 });
    station.send(&mut rig, Id::BROADCAST, 1, &fields);
    rig.run(0.5);
    let [offer] = &station.take(&rig, 21)[..] else {
        panic!("one #21")
    };
    assert_eq!(offer["Vehicle ID"], vehicle_id(0).0);
    assert_eq!(offer["CUCS ID"], CUCS.0);
    assert_eq!(offer["VSM ID"], VSM.0);
    assert_eq!(
        (&offer["LOI Authorized"], &offer["LOI Granted"]),
        (&json!(0x0f), &json!(0))
    );
    assert_eq!(offer["Controlled Station Mode"], 0);
    assert!(
        station.take(&rig, 101).is_empty(),
        "no status before a grant"
    );
}

#[test]
fn a_flight_from_control_to_release() {
    let (mut rig, mut station) = ready();
    let identity = station.take(&rig, 20);
    assert_eq!(identity[0]["Vehicle ID Update"], vehicle_id(0).0);
    take_off(&mut rig, &mut station, 20.0);
    rig.run(2.0);
    let states = station.take(&rig, 101);
    let last = states.last().expect("#101 is pushed");
    let (latitude, _) = orders::place(0.0, 0.0);
    assert!((last["Latitude"].as_f64().unwrap() - latitude.to_radians()).abs() < 1e-6);
    assert!(last["W_Speed"].as_f64().unwrap().abs() < 1.0);
    assert!(
        last["Time Stamp"].as_f64().unwrap() > 1.7e9,
        "seconds since 1970"
    );
    // Mode 12 here, then over there with #48 manual.
    mode(&mut rig, &mut station, 12);
    assert!(rig.until(10.0, |rig| rig.truth().mode == Px4::Loiter));
    rig.run(1.0);
    assert_eq!(
        station.take(&rig, 106).last().unwrap()["Select Flight Path Control Mode"],
        12
    );
    mode(&mut rig, &mut station, 19);
    assert!(rig.until(60.0, |rig| rig.truth().landed));
    rig.run(3.0);
    let released = request(&mut rig, &mut station, 0, 0);
    assert_eq!(released[0]["LOI Granted"], 0);
    station.receive(&rig);
    station.received.clear();
    rig.run(2.0);
    assert!(
        station.take(&rig, 101).is_empty(),
        "status ends with the release"
    );
}

#[test]
fn a_demand_moves_the_vehicle_only_where_it_rules() {
    let (mut rig, mut station) = ready();
    take_off(&mut rig, &mut station, 20.0);
    mode(&mut rig, &mut station, 12);
    rig.run(5.0);
    let height = |rig: &Rig| -rig.truth().position.d;
    let (latitude, longitude) = orders::place(60.0, 0.0);
    let there = json!({
        "Altitude Command Type": 1, "Commanded Altitude": 40.0, "Altitude Type": 2,
        "Commanded Waypoint Number": 65535,
        "Loiter Position Latitude": latitude.to_radians(),
        "Loiter Position Longitude": longitude.to_radians(),
    });
    // Configuration rules in mode 12: neither altitude nor place of #43 is flown to, and the station is informed.
    steer(&mut rig, &mut station, &there);
    rig.run(8.0);
    assert!((height(&rig) - 20.0).abs() < 1.5, "{}", height(&rig));
    assert!(rig.truth().position.n.abs() < 2.0);
    let alerts = station.alerts(&rig);
    assert!(
        alerts.iter().any(|text| text.contains("Loiter Position")),
        "{alerts:?}"
    );
    // Manual by #48, reported by #109.
    station.send(
        &mut rig,
        vehicle_id(0),
        48,
        &json!({ "Altitude Mode": 2, "Speed Mode": 2, "Course/Heading Mode": 2 }),
    );
    rig.run(0.5);
    assert_eq!(
        station.take(&rig, 109).last().unwrap()["Altitude Mode State"],
        2
    );
    steer(&mut rig, &mut station, &there);
    assert!(rig.until(40.0, |rig| height(rig) > 38.0
        && rig.truth().position.n > 50.0));
}

#[test]
fn the_loiter_altitude_rules_in_mode_12_and_a_demand_in_mode_15() {
    let (mut rig, mut station) = ready();
    take_off(&mut rig, &mut station, 20.0);
    let height = |rig: &Rig| -rig.truth().position.d;
    station.send(
        &mut rig,
        vehicle_id(0),
        41,
        &json!({ "Loiter Type": 4, "Loiter Altitude": 30.0, "Altitude Type": 2 }),
    );
    rig.run(0.5);
    mode(&mut rig, &mut station, 12);
    assert!(
        rig.until(40.0, |rig| (height(rig) - 30.0).abs() < 1.0),
        "{:?}",
        station.alerts(&rig)
    );
    // 15: #43 overrides, at once.
    mode(&mut rig, &mut station, 15);
    rig.run(0.2);
    steer(
        &mut rig,
        &mut station,
        &json!({ "Altitude Command Type": 1, "Commanded Altitude": 45.0, "Altitude Type": 2 }),
    );
    assert!(
        rig.until(60.0, |rig| height(rig) > 43.5),
        "{:?}",
        station.alerts(&rig)
    );
    rig.run(2.0);
    assert_eq!(
        station.take(&rig, 106).last().unwrap()["Select Flight Path Control Mode"],
        15
    );
}

#[test]
fn commands_are_acknowledged_by_instance_once_1401_asks_for_it() {
    let (mut rig, mut station) = ready();
    let loiter = json!({ "Loiter Type": 1, "Loiter Radius": 30.0, "Loiter Direction": 1 });
    station.send(&mut rig, vehicle_id(0), 41, &loiter);
    rig.run(0.5);
    assert!(station.take(&rig, 1400).is_empty());
    station.send(
        &mut rig,
        vehicle_id(0),
        1401,
        &json!({ "Message Type": 41 }),
    );
    rig.run(0.2);
    let instance = station.send(&mut rig, vehicle_id(0), 41, &loiter);
    rig.run(0.5);
    let [answer] = &station.take(&rig, 1400)[..] else {
        panic!("one #1400")
    };
    assert_eq!(answer["Original Message Instance ID"], instance);
    assert_eq!(answer["Original Message Type"], 41);
    // A release ends it.
    request(&mut rig, &mut station, 0, 0);
    request(&mut rig, &mut station, 0x0f, 1);
    station.send(&mut rig, vehicle_id(0), 41, &loiter);
    rig.run(0.5);
    assert!(station.take(&rig, 1400).is_empty());
}

#[test]
fn reports_come_as_they_are_requested_and_scheduled() {
    let (mut rig, mut station) = ready();
    station.send(
        &mut rig,
        vehicle_id(0),
        1403,
        &json!({ "Message Type": 100 }),
    );
    rig.run(0.5);
    assert_eq!(station.take(&rig, 100).len(), 1);
    station.send(
        &mut rig,
        vehicle_id(0),
        1402,
        &json!({ "Requested Message Type": 102, "Frequency": 2.0 }),
    );
    rig.run(3.2);
    let count = station.take(&rig, 102).len();
    assert!((5..=8).contains(&count), "{count}");
    station.send(
        &mut rig,
        vehicle_id(0),
        1403,
        &json!({ "Message Type": 503 }),
    );
    rig.run(0.5);
    let alerts = station.alerts(&rig);
    assert!(
        alerts.iter().any(|text| text.contains("refused")),
        "{alerts:?}"
    );
}

#[test]
fn the_configuration_phase_speaks_in_messages_and_fields_of_the_edition() {
    let (mut rig, mut station) = rig();
    // LOI 4, of whatever message.
    station.send(
        &mut rig,
        vehicle_id(0),
        1200,
        &json!({ "VSM ID": -1, "Request Type": 3 }),
    );
    rig.run(4.0);
    let real = station.take(&rig, 1301);
    let altitude = real
        .iter()
        .find(|one| one["Requested Message"] == 43 && one["Requested Field"] == 5);
    let altitude = altitude.expect("the limits of #43.05");
    let high = altitude["Max Value"].as_f64().unwrap();
    assert!(
        (100.0..100_000.0).contains(&high),
        "metres, not steps: {high}"
    );
    let modes = station.take(&rig, 1303);
    assert!(modes.iter().all(|one| one["VSM ID"] == VSM.0), "{modes:?}");
    let refused = |message: u16, field: u8| {
        modes
            .iter()
            .any(|one| one["Reported Message"] == message && one["Reported Field"] == field)
    };
    assert!(refused(47, 0), "#47 is not supported");
    assert!(!refused(48, 0));
    // Mode 2 is flown by sticks, which this edition does not have.
    let offered = |mode: u8| {
        let of_mode = |one: &&Value| {
            one["Reported Message"] == 42
                && one["Reported Field"] == 4
                && one["Reported Enumerated Index"] == mode
        };
        let latest = modes.iter().rfind(of_mode);
        latest.expect("a mode that is listed")["Enumerated Index Enable"] == 0
    };
    assert!(!offered(2));
    assert!(offered(21));
    assert_eq!(station.take(&rig, 1203).len(), 1);
}

/// Each mode after its values, under #48 manual, by which the mode before it has used some of them.
#[test]
fn a_launch_a_steering_and_a_loiter_have_the_demand_before_them_under_manual_preference() {
    let (mut rig, mut station) = ready();
    let manual = json!({ "Altitude Mode": 2, "Speed Mode": 2, "Course/Heading Mode": 2 });
    station.send(&mut rig, vehicle_id(0), 48, &manual);
    rig.run(0.5);
    take_off(&mut rig, &mut station, 20.0);
    assert!(rig.until(20.0, |rig| rig.truth().mode == Px4::Loiter));
    let alerts = station.alerts(&rig).join("|");
    assert!(!alerts.contains("refused"), "{alerts}");
    rig.run(2.0);
    let east = json!({
        "Heading Command Type": 2, "Commanded Course": 1.57, "Commanded Speed": 4.0, "Speed Type": 2,
    });
    steer(&mut rig, &mut station, &east);
    mode(&mut rig, &mut station, 15);
    let flown = rig.until(20.0, |rig| rig.truth().position.e > 20.0);
    assert!(flown, "{:?} {:?}", rig.truth(), station.alerts(&rig));
    let (latitude, longitude) = orders::place(60.0, 20.0);
    let there = json!({
        "Altitude Command Type": 1, "Commanded Altitude": 30.0, "Altitude Type": 2,
        "Loiter Position Latitude": latitude.to_radians(),
        "Loiter Position Longitude": longitude.to_radians(),
    });
    steer(&mut rig, &mut station, &there);
    mode(&mut rig, &mut station, 12);
    let reached = rig.until(60.0, |rig| {
        let at = rig.truth().position;
        (at.n - 60.0).abs() < 3.0 && (-at.d - 30.0).abs() < 1.5
    });
    assert!(reached, "{:?} {:?}", rig.truth(), station.alerts(&rig));
}

/// What a station keeps sending whether or not a mode uses it.
fn stands_by() -> Value {
    json!({
        "Altitude Command Type": 1, "Commanded Altitude": 20.0, "Altitude Type": 2,
        "Heading Command Type": 1, "Commanded Heading": 1.0,
    })
}

#[test]
fn a_landing_and_a_wave_off_are_flown_whatever_demand_stands_by() {
    let (mut rig, mut station) = ready();
    take_off(&mut rig, &mut station, 30.0);
    for next in [12, 19, 20] {
        steer(&mut rig, &mut station, &stands_by());
        rig.run(0.5);
        mode(&mut rig, &mut station, next);
        rig.run(4.0);
    }
    let alerts = station.alerts(&rig).join("|");
    assert!(!alerts.contains("refused"), "{alerts}");
    // Back up to where the landing began.
    let up = rig.until(30.0, |rig| -rig.truth().position.d > 29.0);
    assert!(up, "{:?} {alerts}", rig.truth());
    steer(&mut rig, &mut station, &stands_by());
    mode(&mut rig, &mut station, 19);
    assert!(rig.until(60.0, |rig| rig.truth().landed));
}

#[test]
fn a_mode_that_arrives_after_a_younger_demand_is_taken() {
    let (mut rig, mut station) = ready();
    take_off(&mut rig, &mut station, 20.0);
    mode(&mut rig, &mut station, 15);
    assert!(rig.until(10.0, |rig| rig.truth().mode == Px4::Offboard));
    for younger in [stands_by(), json!({})] {
        let hold = station.datagram(
            &rig,
            vehicle_id(0),
            42,
            &json!({ "Select Flight Path Control Mode": 12 }),
        );
        rig.run(0.1);
        steer(&mut rig, &mut station, &younger);
        station.send(&mut rig, vehicle_id(0), 48, &json!({}));
        rig.run(0.2);
        rig.deliver_from(station.address, &hold);
        let held = rig.until(5.0, |rig| rig.truth().mode == Px4::Loiter);
        assert!(held, "{:?}", station.alerts(&rig));
        rig.run(2.0);
        mode(&mut rig, &mut station, 15);
        let steers = rig.until(10.0, |rig| rig.truth().mode == Px4::Offboard);
        assert!(steers, "{:?}", station.alerts(&rig));
    }
    // Of two modes, of two demands and of two preferences the younger counts.
    let old = [
        (42, json!({ "Select Flight Path Control Mode": 12 })),
        (
            43,
            json!({ "Altitude Command Type": 1, "Commanded Altitude": 90.0, "Altitude Type": 2 }),
        ),
        (
            48,
            json!({ "Altitude Mode": 2, "Speed Mode": 2, "Course/Heading Mode": 2 }),
        ),
    ];
    let old = old.map(|(number, fields)| station.datagram(&rig, vehicle_id(0), number, &fields));
    rig.run(0.1);
    station.send(&mut rig, vehicle_id(0), 48, &json!({ "Altitude Mode": 1 }));
    mode(&mut rig, &mut station, 15);
    steer(&mut rig, &mut station, &stands_by());
    rig.run(0.5);
    station.take(&rig, 109);
    for bytes in old {
        rig.deliver_from(station.address, &bytes);
    }
    rig.run(1.0);
    assert_eq!(rig.truth().mode, Px4::Offboard);
    assert!(station.take(&rig, 109).is_empty());
    // Each is named. What was taken superseded nothing.
    let alerts = station.alerts(&rig);
    let with = |part: &str| alerts.iter().filter(|text| text.contains(part)).count();
    assert_eq!(
        (with("overtaken"), with("superseded")),
        (3, 0),
        "{alerts:?}"
    );
    rig.run(5.0);
    assert!(
        -rig.truth().position.d < 30.0,
        "not to 90 m: {:?}",
        rig.truth()
    );
}

/// A mode and its values are two messages: the second supersedes nothing, and both are answered by what the vehicle shows.
#[test]
fn a_demand_right_after_its_mode_is_one_command_with_it() {
    let (mut rig, mut station) = ready();
    take_off(&mut rig, &mut station, 20.0);
    for message in [42, 43] {
        let fields = json!({ "Message Type": message });
        station.send(&mut rig, vehicle_id(0), 1401, &fields);
    }
    let both = json!({ "Altitude Mode": 2, "Speed Mode": 2, "Course/Heading Mode": 2 });
    station.send(&mut rig, vehicle_id(0), 48, &both);
    rig.run(0.5);
    let (latitude, longitude) = orders::place(60.0, 0.0);
    let there = json!({
        "Altitude Command Type": 1, "Commanded Altitude": 35.0, "Altitude Type": 2,
        "Loiter Position Latitude": latitude.to_radians(),
        "Loiter Position Longitude": longitude.to_radians(),
    });
    let turned = json!({
        "Altitude Command Type": 1, "Commanded Altitude": 45.0, "Altitude Type": 2,
        "Heading Command Type": 1, "Commanded Heading": 1.0,
    });
    for (wanted, shown, values) in [(12, Px4::Loiter, there), (15, Px4::Offboard, turned)] {
        station.take(&rig, 1400);
        mode(&mut rig, &mut station, wanted);
        // Repeated, as stations do.
        for _ in 0..3 {
            steer(&mut rig, &mut station, &values);
            rig.run(0.05);
        }
        let height = values["Commanded Altitude"].as_f64().unwrap();
        let flown = rig.until(60.0, |rig| {
            rig.truth().mode == shown && (-rig.truth().position.d - height).abs() < 1.5
        });
        assert!(flown, "{:?} {:?}", rig.truth(), station.alerts(&rig));
        rig.run(2.0);
        let alerts = station.alerts(&rig).join("|");
        assert!(!alerts.contains("superseded"), "{alerts}");
        let answers = station.take(&rig, 1400);
        let of = |number: u16| {
            let is = |one: &&Value| one["Original Message Type"] == number;
            answers.iter().filter(is).count()
        };
        assert!(of(42) >= 1 && of(43) >= 3, "{answers:?}");
    }
}

/// The other way round: what the demand has begun in the mode before is flown in the new one.
#[test]
fn a_demand_right_before_its_mode_is_one_command_with_it() {
    let (mut rig, mut station) = ready();
    take_off(&mut rig, &mut station, 20.0);
    for message in [42, 43] {
        let fields = json!({ "Message Type": message });
        station.send(&mut rig, vehicle_id(0), 1401, &fields);
    }
    let both = json!({ "Altitude Mode": 2, "Speed Mode": 2, "Course/Heading Mode": 2 });
    station.send(&mut rig, vehicle_id(0), 48, &both);
    rig.run(2.0);
    mode(&mut rig, &mut station, 12);
    assert!(rig.until(10.0, |rig| rig.truth().mode == Px4::Loiter));
    rig.run(6.0);
    for (wanted, shown, height_m) in [(12, Px4::Loiter, 35.0), (15, Px4::Offboard, 45.0)] {
        station.take(&rig, 1400);
        let higher = json!({
            "Altitude Command Type": 1, "Commanded Altitude": height_m, "Altitude Type": 2,
        });
        steer(&mut rig, &mut station, &higher);
        rig.run(0.3);
        mode(&mut rig, &mut station, wanted);
        let flown = rig.until(60.0, |rig| {
            rig.truth().mode == shown && (-rig.truth().position.d - height_m).abs() < 1.5
        });
        assert!(flown, "{:?} {:?}", rig.truth(), station.alerts(&rig));
        rig.run(2.0);
        let alerts = station.alerts(&rig).join("|");
        assert!(!alerts.contains("superseded"), "{alerts}");
        let answers = station.take(&rig, 1400);
        for number in [42, 43] {
            let answered = answers
                .iter()
                .any(|one| one["Original Message Type"] == number);
            assert!(answered, "{number}: {answers:?}");
        }
    }
}

#[test]
fn flight_termination_takes_46_to_arm_and_46_to_execute_and_108_reports_it() {
    let mut rig = Rig::new(Setup {
        tables: TABLES,
        vehicle_keys: "termination = { action = \"terminate\" }",
        ..Setup::default()
    });
    rig.run(9.0);
    let mut station = StationEd25::new(CUCS, ([127, 0, 0, 2], 41_000).into());
    request(&mut rig, &mut station, 0x0f, 1);
    rig.run(1.0);
    take_off(&mut rig, &mut station, 20.0);
    let order = |rig: &mut Rig, station: &mut StationEd25, state: u8| {
        let fields = json!({ "Commanded Flight Termination State": state });
        station.send(rig, vehicle_id(0), 46, &fields);
        rig.run(1.0);
        let reports = station.take(rig, 108);
        reports
            .last()
            .map(|one| one["Reported Flight Termination State"].clone())
    };
    // Its clock is measured by what it sends anyway.
    for _ in 0..5 {
        let fields = json!({ "Message Type": 108 });
        station.send(&mut rig, vehicle_id(0), 1403, &fields);
        rig.run(1.0);
    }
    station.take(&rig, 108);
    assert_eq!(order(&mut rig, &mut station, 2), None, "it is not armed");
    assert_eq!(rig.truth().mode, Px4::Loiter);
    assert_eq!(order(&mut rig, &mut station, 1), Some(json!(1)));
    assert_eq!(order(&mut rig, &mut station, 0), Some(json!(0)));
    assert_eq!(order(&mut rig, &mut station, 1), Some(json!(1)));
    assert_eq!(order(&mut rig, &mut station, 2), Some(json!(2)));
    assert_eq!(rig.truth().mode, Px4::Termination);
    let alerts = station.alerts(&rig).join("|");
    assert!(alerts.contains("FLIGHT TERMINATION EXECUTED"), "{alerts}");
}
