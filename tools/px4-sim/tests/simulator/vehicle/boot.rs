//! What happens between switching on and the first possible take-off.

use crate::vehicle::support::*;
use mavlink::dialects::development::{MavMessage, MavState};
use px4_sim::{Config, Mode};

#[test]
fn the_first_heartbeat_is_hold_disarmed_and_not_ready() {
    let mut flight = Flight::boot(Config::default());
    flight.run(1.9);
    assert!(flight.received.is_empty(), "{:?}", flight.received);
    flight.run(0.2);
    let beat = flight.heartbeat();
    assert_eq!(beat.custom_mode, 0x0304_0000);
    assert_eq!(beat.base_mode.bits(), 0x1d);
    assert_eq!(beat.system_status, MavState::MAV_STATE_UNINIT);
    assert_eq!(beat.mavtype as u32, 2);
    assert_eq!(beat.autopilot as u32, 12);
}

#[test]
fn arming_is_refused_for_about_three_seconds_after_it() {
    let mut flight = Flight::boot(Config::default());
    flight.run(2.0);
    assert_eq!(flight.arm(), Some(1));
    flight.run(2.0);
    assert!(
        flight.has_text("Arming denied: Resolve system health failures first"),
        "{:?}",
        flight.texts()
    );
    assert!(flight.has_text("Preflight Fail: no heading reference"));
    assert_eq!(flight.arm(), Some(1));
    flight.run(1.0);
    assert_eq!(flight.arm(), Some(0));
    flight.run(1.0);
    assert_eq!(flight.heartbeat().system_status, MavState::MAV_STATE_ACTIVE);
    assert!(flight.has_text("Armed by external command"));
}

#[test]
fn home_is_known_after_four_seconds_and_a_plan_can_be_uploaded_before() {
    let mut flight = Flight::boot(Config::default());
    flight.run(2.0);
    assert_eq!(
        flight.upload(&[takeoff(10.0), waypoint(50.0, 0.0, 10.0)]),
        Some(0)
    );
    flight.run(1.5);
    let home = |m: &MavMessage| match m {
        MavMessage::HOME_POSITION(h) => Some(h.clone()),
        _ => None,
    };
    assert!(flight.last(home).is_none());
    flight.run(3.0);
    let home = flight.last(home).unwrap();
    let config = Config::default();
    assert!((f64::from(home.latitude) * 1e-7 - config.home.latitude_deg).abs() < 1e-5);
    assert!((f64::from(home.altitude) * 1e-3 - config.home.altitude_m).abs() < 1.0);
}

#[test]
fn a_vehicle_that_is_armed_and_does_nothing_disarms_itself() {
    let mut flight = Flight::ready();
    assert_eq!(flight.arm(), Some(0));
    assert_eq!(flight.arm(), Some(0), "a repeat is no error");
    flight.run(9.0);
    assert!(flight.vehicle.truth().armed);
    flight.run(1.5);
    assert!(!flight.vehicle.truth().armed);
    assert!(flight.has_text("Disarmed by auto preflight disarming"));
}

#[test]
fn forcing_does_not_arm_without_a_mission_in_mission_mode() {
    let mut flight = Flight::ready();
    assert_eq!(flight.set_mode(Mode::Mission), Some(0));
    assert_eq!(flight.command(400, &[1.0, 21196.0]), Some(1));
    assert_eq!(flight.command(300, &[0.0]), Some(2));
    flight.run(0.5);
    assert!(flight.has_text("Mission start denied! No valid mission"));
}
