//! 16000 for what the vehicle reports as wrong: raised once, by subsystem and priority, updated when it gets worse, cleared
//! when it is over, and never a storm; 15000 and 15001 ask for the same.

use kit::bridge::{Rig, Setup};
use px4_sim::HealthFaults;
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, AlertPriority, AlertType, SubsystemBitmap, SubsystemId};
use stanag_msgs::messages::{
    SubsystemStatusAlert, SubsystemStatusDetailRequest, SubsystemStatusReport,
    SubsystemStatusRequest,
};

fn alerts(rig: &Rig, mark: usize) -> Vec<SubsystemStatusAlert> {
    let received = rig.station().received[mark..].iter();
    received
        .filter_map(|(_, _, message)| match message {
            Message::SubsystemStatusAlert(alert) => Some(alert.clone()),
            _ => None,
        })
        .collect()
}

fn reports(rig: &Rig, mark: usize) -> Vec<SubsystemStatusReport> {
    let received = rig.station().received[mark..].iter();
    received
        .filter_map(|(_, _, message)| match message {
            Message::SubsystemStatusReport(report) => Some(report.clone()),
            _ => None,
        })
        .collect()
}

fn ail(rig: &mut Rig, health_faults: HealthFaults) {
    rig.vehicles[0]
        .vehicle_mut()
        .set_health_faults(health_faults);
}

/// A fault makes one alert of this subsystem and priority, and its end clears that alert.
fn comes_and_goes(
    health_faults: HealthFaults,
    subsystem: SubsystemId,
    priority: AlertPriority,
    text: &str,
) {
    let mut rig = Rig::ready();
    // Estimator flags come only where somebody asks for the status.
    rig.done(SubsystemStatusRequest::default());
    rig.run(3.0);
    let mark = rig.station().received.len();
    ail(&mut rig, health_faults);
    rig.run(8.0);
    let raised = alerts(&rig, mark);
    let [alert] = &raised[..] else {
        panic!("{raised:#?}")
    };
    assert_eq!(alert.priority, Some(priority), "{text}");
    assert_eq!(alert.subsystem_id, Some(subsystem), "{text}");
    assert_eq!(alert.alert_type, Some(AlertType::NotClearable));
    assert!(
        alert
            .text
            .is_some_and(|reported| reported.as_str().contains(text)),
        "{alert:?}"
    );
    let id = alert.alert_warning_id.expect("an id");
    assert!(id < 0, "the first instance is negative");
    let mark = rig.station().received.len();
    ail(&mut rig, HealthFaults::default());
    rig.run(8.0);
    let cleared = alerts(&rig, mark);
    let [alert] = &cleared[..] else {
        panic!("{cleared:#?}")
    };
    assert_eq!(alert.priority, Some(AlertPriority::Cleared));
    assert_eq!(alert.alert_type, Some(AlertType::Clear));
    assert_eq!(alert.alert_warning_id, Some(-id));
}

/// What the vehicle reports as a text is an event: nothing of it stands, and nothing is there to be cleared.
#[test]
fn a_text_of_the_vehicle_is_an_event_and_is_never_cleared() {
    let mut rig = Rig::ready();
    let mark = rig.station().received.len();
    rig.take_off(15.0);
    rig.run(60.0);
    let received = alerts(&rig, mark);
    let of_the_vehicle = |alert: &&SubsystemStatusAlert| {
        alert.subsystem_id == Some(SubsystemId::from_raw(AUTOPILOT))
    };
    let texts: Vec<_> = received.iter().filter(of_the_vehicle).collect();
    let has_text = |text: &str| {
        let mut reported = texts.iter().filter_map(|alert| alert.text);
        reported.any(|reported| reported.as_str().contains(text))
    };
    assert!(has_text("Takeoff detected"), "{texts:#?}");
    for text in &texts {
        let id = text.alert_warning_id.expect("an id");
        assert!(id < 0, "its first and only instance: {text:?}");
        assert_eq!(text.alert_type, Some(AlertType::Clearable), "{text:?}");
        let later = received
            .iter()
            .filter(|alert| alert.alert_warning_id == Some(-id));
        assert_eq!(later.count(), 0, "{text:?}");
    }
}

/// Subsystem ID of the autopilot's own words.
const AUTOPILOT: u8 = 20;

fn unhealthy(bits: u32) -> HealthFaults {
    HealthFaults {
        unhealthy: bits,
        ..HealthFaults::default()
    }
}

#[test]
fn a_failing_compass_is_a_warning_of_navigation() {
    let health_faults = unhealthy(0x4);
    comes_and_goes(
        health_faults,
        SubsystemId::Navigation,
        AlertPriority::Warning,
        "compass",
    );
}

#[test]
fn a_failing_gps_is_a_warning_of_navigation() {
    let health_faults = unhealthy(0x20);
    comes_and_goes(
        health_faults,
        SubsystemId::Navigation,
        AlertPriority::Warning,
        "GPS",
    );
}

#[test]
fn failing_motors_are_a_failure_of_the_engine() {
    let health_faults = unhealthy(0x8000);
    comes_and_goes(
        health_faults,
        SubsystemId::Engine,
        AlertPriority::Failed,
        "land immediately",
    );
}

#[test]
fn a_lost_position_is_a_warning_of_navigation() {
    let health_faults = HealthFaults {
        estimator: 0x10,
        ..HealthFaults::default()
    };
    comes_and_goes(
        health_faults,
        SubsystemId::Navigation,
        AlertPriority::Warning,
        "position",
    );
}

#[test]
fn a_low_battery_is_a_caution_of_energy() {
    let health_faults = HealthFaults {
        battery: Some(14),
        ..HealthFaults::default()
    };
    comes_and_goes(
        health_faults,
        SubsystemId::PropulsionEnergy,
        AlertPriority::Caution,
        "BAT_LOW_THR",
    );
}

#[test]
fn a_battery_that_drains_is_reported_once_a_level_under_one_id() {
    let mut rig = Rig::ready();
    let mark = rig.station().received.len();
    for percent in (1..=20).rev() {
        ail(
            &mut rig,
            HealthFaults {
                battery: Some(percent),
                ..HealthFaults::default()
            },
        );
        rig.run(2.5);
    }
    let reported = alerts(&rig, mark);
    let levels: Vec<_> = reported.iter().filter_map(|alert| alert.priority).collect();
    assert_eq!(
        levels,
        [
            AlertPriority::Caution,
            AlertPriority::Warning,
            AlertPriority::Emergency
        ]
    );
    let ids: Vec<i32> = reported
        .iter()
        .filter_map(|alert| alert.alert_warning_id)
        .collect();
    assert_eq!(ids, [ids[0], -ids[0], -ids[0]]);
}

#[test]
fn a_cause_that_comes_and_goes_is_no_storm() {
    let mut rig = Rig::ready();
    let mark = rig.station().received.len();
    for round in 0..60 {
        ail(
            &mut rig,
            unhealthy(if round % 2 == 0 { 0x4 | 0x8 | 0x20 } else { 0 }),
        );
        rig.run(1.0);
    }
    // Three causes: each raised at most once, none cleared while it still comes back.
    let reported = alerts(&rig, mark);
    assert!(reported.len() <= 3, "{}", reported.len());
}

#[test]
fn one_that_stands_is_reported_to_a_station_that_comes_later() {
    let mut rig = Rig::new(Setup::default());
    ail(&mut rig, unhealthy(0x8));
    rig.run(9.0);
    rig.done(kit::bridge::orders::request_control());
    rig.run(1.0);
    assert!(rig.station().has_alert("barometer failure"));
}

#[test]
fn a_silent_vehicle_is_neither_well_nor_worse() {
    let mut rig = Rig::ready();
    ail(&mut rig, unhealthy(0x4));
    rig.run(5.0);
    rig.mav.faults.loss = 1.0;
    rig.run(5.0);
    ail(&mut rig, HealthFaults::default());
    let mark = rig.station().received.len();
    rig.run(20.0);
    assert!(
        alerts(&rig, mark)
            .iter()
            .all(|alert| alert.subsystem_id != Some(SubsystemId::Navigation))
    );
    rig.mav.faults.loss = 0.0;
    rig.run(10.0);
    assert!(rig.station().has_alert("compass recovered"));
}

#[test]
fn subsystems_are_reported_on_15000_and_their_alerts_on_15001() {
    let mut rig = Rig::ready();
    let ask = |bits: u32| SubsystemStatusRequest {
        subsystem_id: Some(SubsystemBitmap::from_raw(bits)),
        ..SubsystemStatusRequest::default()
    };
    let detail = |reference| SubsystemStatusDetailRequest {
        subsystem_state_report_reference: Some(reference),
        ..SubsystemStatusDetailRequest::default()
    };
    let mark = rig.station().received.len();
    rig.done(ask(0));
    assert_eq!(reports(&rig, mark).len(), 4);
    ail(&mut rig, unhealthy(0x4));
    rig.run(5.0);
    let mark = rig.station().received.len();
    rig.done(ask(0x20));
    let reported = reports(&rig, mark);
    let [navigation] = &reported[..] else {
        panic!("{reported:#?}")
    };
    assert_eq!(navigation.subsystem_id, Some(SubsystemId::Navigation));
    assert_eq!(navigation.subsystem_state, Some(AlertPriority::Warning));
    let reference = navigation
        .subsystem_state_report_reference
        .expect("a reference");
    assert!(reference > 0);
    let mark = rig.station().received.len();
    rig.done(detail(reference));
    let reported = reports(&rig, mark);
    let text = reported[0].report_text_reference.expect("a text");
    assert!(text.as_str().contains("compass"), "{text:?}");
    assert_eq!(rig.carry_out(detail(77)), Some(AckType::Refused));
    assert_eq!(
        rig.carry_out(ask(0x40)),
        Some(AckType::Refused),
        "it has no payload"
    );
    let mut rig = Rig::ready_with(Setup {
        dli_keys: "provisional = \"off\"",
        ..Setup::default()
    });
    assert_eq!(rig.carry_out(ask(0)), Some(AckType::Refused));
}
