//! EVENT of the vehicle as 16000: by the vehicle's own metadata and without it, once where a text says the same, also where
//! the link loses events; reports on arming checks; and storms.

use kit::bridge::{Faults, Rig, Setup, vehicle_id};
use mavlink_link::service::ftp::{FilePath, Operation};
use px4_sim::HealthFaults;
use stanag_msgs::Message;
use stanag_msgs::enums::AlertPriority;
use vsm::session::{FileEvent, FileRefusal};

fn setup(mav: Faults) -> Setup {
    let vehicle = px4_sim::Config {
        events: true,
        ..px4_sim::Config::default()
    };
    Setup {
        vehicles: vec![vehicle],
        mav,
        ..Setup::default()
    }
}

/// The texts of 16000 since `mark`, whole, with priorities.
fn alerts(rig: &Rig, mark: usize) -> Vec<(AlertPriority, String)> {
    let mut all: Vec<(AlertPriority, String)> = Vec::new();
    for (_, _, message) in &rig.station().received[mark..] {
        let Message::SubsystemStatusAlert(alert) = message else {
            continue;
        };
        let text = alert.text.map_or_else(String::new, |text| text.to_string());
        match all.last_mut() {
            Some((_, whole)) if alert.append_order.is_some_and(|order| order > 1) => {
                whole.push_str(&text);
            }
            _ => all.push((alert.priority.expect("a priority"), text)),
        }
    }
    all
}

fn count(alerts: &[(AlertPriority, String)], text: &str) -> usize {
    alerts
        .iter()
        .filter(|(_, known)| known.contains(text))
        .count()
}

const CHECKS_BEGIN: &str = "commander_arming_check_summary";
const CHECKS_END: &str = "commander_health_summary";

fn logged(rig: &Rig, text: &str) -> bool {
    rig.log.iter().any(|entry| entry.text.contains(text))
}

fn report(rig: &mut Rig, name: &str, level: u8, arguments: &[u8]) {
    let vehicle = rig.vehicles[0].vehicle_mut();
    vehicle.report_event(name, level, arguments);
}

#[test]
fn with_the_vehicles_metadata_each_event_is_one_alert_with_its_text_and_level() {
    let mut rig = Rig::ready_with(setup(Faults::NONE));
    rig.run(5.0);
    assert!(logged(
        &rig,
        "events of the vehicle are defined by its metadata"
    ));
    let mark = rig.station().received.len();
    // Sent as an event alone: no text of it exists.
    report(&mut rig, "commander_gcs_lost", 4, &[]);
    report(
        &mut rig,
        "navigator_mis_geofence_violation",
        3,
        &7_i32.to_le_bytes(),
    );
    rig.run(1.0);
    let expected = [
        (
            AlertPriority::Caution,
            "Connection to ground control station lost".to_owned(),
        ),
        (
            AlertPriority::Warning,
            "Geofence violation for waypoint 7".to_owned(),
        ),
    ];
    assert_eq!(alerts(&rig, mark), expected);
    let mark = rig.station().received.len();
    rig.take_off(15.0);
    rig.run(5.0);
    let seen = alerts(&rig, mark);
    for text in ["Armed by external command", "Takeoff detected"] {
        assert_eq!(count(&seen, text), 1, "{seen:#?}");
    }
    assert_eq!(count(&seen, "vehicle event"), 0, "{seen:#?}");
}

#[test]
fn without_metadata_the_text_stands_for_its_event_and_others_are_alerted_by_number() {
    let mut setup = setup(Faults::NONE);
    setup.vehicles[0]
        .files
        .insert("/etc/extras/all_events.json.xz", *b"{]");
    let mut rig = Rig::ready_with(setup);
    rig.run(5.0);
    assert!(logged(
        &rig,
        "the vehicle's events are alerted by their numbers: not the JSON"
    ));
    // Several checks are a count: nobody can do anything with their numbers.
    let mark = rig.station().received.len();
    report(&mut rig, CHECKS_BEGIN, 8, &[]);
    for name in ["check_a", "check_b", "check_b"] {
        report(&mut rig, name, 3, &[0xff; 5]);
    }
    report(&mut rig, CHECKS_END, 8, &[]);
    rig.run(1.0);
    let text = "checks of the vehicle before arming fail: 2 (their texts have not been read)";
    let seen = alerts(&rig, mark);
    assert_eq!(count(&seen, text), 1, "{seen:#?}");
    assert_eq!(count(&seen, "vehicle event"), 0, "{seen:#?}");
    let mark = rig.station().received.len();
    rig.take_off(15.0);
    rig.run(5.0);
    let seen = alerts(&rig, mark);
    for text in ["Armed by external command", "Takeoff detected"] {
        assert_eq!(count(&seen, text), 1, "{seen:#?}");
    }
    assert_eq!(count(&seen, "vehicle event"), 0, "{seen:#?}");
    // PX4's own text of this one names a pilot, whoever it was.
    let mark = rig.station().received.len();
    report(&mut rig, "failsafe_rc_override", 6, &[]);
    rig.run(5.0);
    let seen = alerts(&rig, mark);
    let text = "ended its failsafe for a mode that was commanded, or for a pilot's sticks";
    assert_eq!(count(&seen, text), 1, "{seen:#?}");
    let mark = rig.station().received.len();
    report(&mut rig, "x", 2, &[1, 2]);
    rig.run(5.0);
    let text = "of component 1, critical: arguments 0102";
    let seen = alerts(&rig, mark);
    assert_eq!(count(&seen, text), 1, "{seen:#?}");
    assert_eq!(seen[0].0, AlertPriority::Warning);
}

#[test]
fn events_that_the_link_loses_are_requested_again_and_those_that_are_gone_are_counted() {
    let mut rig = Rig::ready_with(setup(Faults::NONE));
    rig.run(5.0);
    let mark = rig.station().received.len();
    let vehicle = rig.vehicles[0].vehicle_mut();
    vehicle.report_event("commander_gcs_lost", 4, &[]);
    vehicle.lose_events(1);
    rig.run(5.0);
    let seen = alerts(&rig, mark);
    assert_eq!(
        count(&seen, "Connection to ground control station lost"),
        1,
        "{seen:#?}"
    );
    assert!(rig.arrived.get(&412).is_some_and(|requests| *requests >= 1));
    // More at once than the vehicle keeps.
    let mark = rig.station().received.len();
    let vehicle = rig.vehicles[0].vehicle_mut();
    for _ in 0..25 {
        vehicle.report_event("commander_gcs_lost", 6, &[]);
    }
    vehicle.report_event("mission_execute", 6, &[]);
    vehicle.lose_events(19);
    rig.run(6.0);
    let seen = alerts(&rig, mark);
    assert_eq!(
        count(&seen, "6 events of the vehicle were lost"),
        1,
        "{seen:#?}"
    );
    assert_eq!(count(&seen, "Executing Mission"), 1, "{seen:#?}");
}

#[test]
fn checks_that_keep_it_from_arming_are_one_alert_that_stands_until_they_pass() {
    let mut rig = Rig::ready_with(setup(Faults::NONE));
    rig.run(5.0);
    let mark = rig.station().received.len();
    let fault = HealthFaults {
        estimator: 0x10,
        ..HealthFaults::default()
    };
    rig.vehicles[0].vehicle_mut().set_health_faults(fault);
    rig.run(1.0);
    let text = "checks of the vehicle before arming fail: No valid global position estimate";
    let raised = alerts(&rig, mark);
    assert_eq!(count(&raised, text), 1, "{raised:#?}");
    let mark = rig.station().received.len();
    rig.vehicles[0]
        .vehicle_mut()
        .set_health_faults(HealthFaults::default());
    rig.run(1.0);
    let cleared = (
        AlertPriority::Cleared,
        "the vehicle's checks before arming no longer fail".to_owned(),
    );
    assert!(
        alerts(&rig, mark).contains(&cleared),
        "{:#?}",
        alerts(&rig, mark)
    );
}

#[test]
fn nothing_urgent_is_taken_for_the_twin_of_another() {
    let mut setup = setup(Faults::NONE);
    setup.vehicles[0]
        .files
        .insert("/etc/extras/all_events.json.xz", *b"{]");
    let mut rig = Rig::ready_with(setup);
    rig.run(5.0);
    let mark = rig.station().received.len();
    // The texts of arming and of the take-off follow an emergency, an error and a warning that have none.
    report(&mut rig, "x", 0, &[1]);
    report(&mut rig, "y", 3, &[2]);
    report(&mut rig, "z", 4, &[3]);
    rig.take_off(15.0);
    rig.run(8.0);
    let seen = alerts(&rig, mark);
    for text in [
        "emergency: arguments 01",
        "error: arguments 02",
        "warning: arguments 03",
    ] {
        assert_eq!(count(&seen, text), 1, "{text}: {seen:#?}");
    }
}

#[test]
fn a_report_of_checks_without_its_end_is_over_after_three_seconds() {
    let mut rig = Rig::ready_with(setup(Faults::NONE));
    rig.run(5.0);
    let mark = rig.station().received.len();
    report(&mut rig, CHECKS_BEGIN, 8, &[]);
    rig.run(4.0);
    report(&mut rig, "x", 4, &[1]);
    rig.run(4.0);
    let seen = alerts(&rig, mark);
    assert_eq!(count(&seen, "warning: arguments 01"), 1, "{seen:#?}");
}

#[test]
fn arming_ends_the_alert_of_checks_and_does_not_say_that_they_pass() {
    let mut rig = Rig::ready_with(setup(Faults::NONE));
    rig.run(5.0);
    report(&mut rig, CHECKS_BEGIN, 8, &[]);
    report(&mut rig, "check_a", 3, &[0xff; 5]);
    report(&mut rig, CHECKS_END, 8, &[]);
    rig.run(1.0);
    let mark = rig.station().received.len();
    rig.take_off(15.0);
    let seen = alerts(&rig, mark);
    assert_eq!(
        count(&seen, "the vehicle is armed: its earlier arming checks"),
        1,
        "{seen:#?}"
    );
    assert_eq!(count(&seen, "no longer fail"), 0, "{seen:#?}");
}

/// What stops an operator's file in flight is no reason to stop the vehicle's own, which is read after it.
#[test]
fn after_a_log_that_is_too_large_in_flight_the_metadata_is_read_there() {
    let mut rig = Rig::ready_with(setup(Faults::NONE));
    let log = "/fs/microsd/log/a.ulg";
    let vehicle = rig.vehicles[0].vehicle_mut();
    vehicle.files_mut().insert(log, vec![7; 300_000]);
    rig.take_off(15.0);
    let mark = rig.log.len();
    rig.restart_bridge();
    let mut begun = false;
    let mut ended = None;
    for _ in 0..500 {
        rig.run(0.02);
        let (now, bridge) = (rig.now(), rig.bridge.as_mut().expect("a bridge"));
        if !begun {
            let path = FilePath::new(log).expect("a path");
            let read = Operation::Read { path, resume: None };
            let begin = bridge.start_file(now, vehicle_id(0), read, &mut rig.store);
            begun = begin.is_ok();
        }
        while let Some(event) = bridge.poll_file(vehicle_id(0)) {
            if let FileEvent::Ended(end) = event {
                ended = Some(end);
            }
        }
        if ended.is_some() {
            break;
        }
    }
    assert!(
        matches!(ended, Some(Err(FileRefusal::TooLargeInFlight(..)))),
        "{ended:?}"
    );
    let defined = |rig: &Rig| {
        let mut since = rig.log[mark..].iter();
        since.any(|entry| entry.text.contains("are defined by its metadata"))
    };
    assert!(!defined(&rig));
    rig.run(30.0);
    assert!(defined(&rig));
}

#[test]
fn a_storm_of_emergencies_is_bounded_too() {
    let mut rig = Rig::ready_with(setup(Faults::NONE));
    rig.run(5.0);
    let mark = rig.station().received.len();
    for round in 0..100_u32 {
        for at in 0..10 {
            report(&mut rig, "x", 0, &(round * 10 + at).to_le_bytes());
        }
        rig.run(0.05);
    }
    rig.run(5.0);
    let seen = alerts(&rig, mark);
    let passed = count(&seen, "vehicle event");
    assert!((200..330).contains(&passed), "{passed}");
    assert!(count(&seen, "texts and events before it are not reported") > 0);
}

#[test]
fn a_storm_of_events_leaves_room_for_an_emergency_and_for_orders() {
    let mut rig = Rig::ready_with(setup(Faults::NONE));
    rig.run(5.0);
    let mark = rig.station().received.len();
    for round in 0..200_u32 {
        let vehicle = rig.vehicles[0].vehicle_mut();
        for at in 0..10 {
            vehicle.report_event("x", 4, &(round * 10 + at).to_le_bytes());
        }
        rig.run(0.02);
    }
    report(&mut rig, "commander_gcs_lost", 0, &[]);
    rig.run(8.0);
    let seen = alerts(&rig, mark);
    assert_eq!(count(&seen, "Connection to ground control station lost"), 1);
    assert!(count(&seen, "vehicle event") < 330, "{}", seen.len());
    assert!(count(&seen, "texts and events before it are not reported") > 0);
    rig.take_off(15.0);
}

/// A link that loses a tenth of everything, both ways.
#[test]
fn on_a_bad_link_nothing_is_alerted_twice_and_no_event_is_missing() {
    let mav = Faults {
        loss: 0.1,
        ..Faults::NONE
    };
    let mut rig = Rig::ready_with(setup(mav));
    rig.run(20.0);
    assert!(logged(&rig, "are defined by its metadata"));
    let mark = rig.station().received.len();
    for at in 0..30_i32 {
        report(
            &mut rig,
            "navigator_mis_geofence_violation",
            3,
            &at.to_le_bytes(),
        );
        rig.run(1.0);
    }
    rig.run(5.0);
    let seen = alerts(&rig, mark);
    for at in 0..30 {
        let text = format!("Geofence violation for waypoint {at}");
        let same = seen.iter().filter(|(_, known)| *known == text).count();
        assert_eq!(same, 1, "{text}: {seen:#?}");
    }
}
