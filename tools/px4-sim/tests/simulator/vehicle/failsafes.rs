//! What the vehicle does when its steering input stops.

use crate::vehicle::support::*;
use mavlink::dialects::development as mav;
use mavlink::dialects::development::{MavMessage, MavState};
use px4_sim::{Config, Mode, Param};

fn airborne() -> Flight {
    airborne_with(&[])
}

fn airborne_with(params: &[(Param, f64)]) -> Flight {
    let mut flight = Flight::boot(Config {
        params: params.to_vec(),
        ..Config::default()
    });
    flight.run(8.0);
    assert_eq!(
        flight.command(22, &[0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 508.0]),
        Some(0)
    );
    assert_eq!(flight.arm(), Some(0));
    assert!(flight.until(60.0, |t| t.mode == Mode::Loiter && !t.landed));
    flight.run(2.0);
    flight
}

fn sticks(x: i16) -> MavMessage {
    MavMessage::MANUAL_CONTROL(mav::MANUAL_CONTROL_DATA {
        x,
        z: 500,
        target: 1,
        ..Default::default()
    })
}

fn setpoint(north: f32) -> MavMessage {
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(mav::SET_POSITION_TARGET_LOCAL_NED_DATA {
        x: north,
        y: 0.0,
        z: -20.0,
        type_mask: mav::PositionTargetTypemask::from_bits_retain(0xdf8),
        target_system: 1,
        target_component: 1,
        coordinate_frame: mav::MavFrame::MAV_FRAME_LOCAL_NED,
        ..Default::default()
    })
}

/// Sends a message at 20 Hz for some seconds.
fn stream(flight: &mut Flight, seconds: f64, message: &MavMessage) {
    for _ in 0..(seconds * 20.0) as u32 {
        flight.send(message);
        flight.run(0.05);
    }
}

#[test]
fn sticks_fly_and_their_loss_is_hold_then_return() {
    let mut flight = airborne();
    stream(&mut flight, 1.0, &sticks(0));
    assert_eq!(flight.set_mode(Mode::PosCtl), Some(0));
    stream(&mut flight, 6.0, &sticks(1000));
    let out = flight.vehicle.truth();
    assert_eq!(out.mode, Mode::PosCtl);
    assert!(
        out.velocity.n > 7.0 && out.velocity.e.abs() < 1.0,
        "{:?}",
        out.velocity
    );
    flight.run(0.4);
    assert_eq!(flight.vehicle.truth().mode, Mode::PosCtl);
    flight.run(1.4);
    assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
    assert!(flight.has_text("Failsafe activated: entering Hold for 5 seconds"));
    assert_eq!(
        flight.heartbeat().system_status,
        MavState::MAV_STATE_CRITICAL
    );
    let intended = flight.last(|m| match m {
        MavMessage::CURRENT_MODE(c) => Some((c.custom_mode, c.intended_custom_mode)),
        _ => None,
    });
    flight.run(2.0);
    let now = flight.last(|m| match m {
        MavMessage::CURRENT_MODE(c) => Some((c.custom_mode, c.intended_custom_mode)),
        _ => None,
    });
    assert_eq!(now, Some((0x0304_0000, 0x0003_0000)), "was {intended:?}");
    flight.run(3.0);
    assert_eq!(flight.vehicle.truth().mode, Mode::Rtl);
}

/// Flown by sticks for a second, and then the mode is commanded while they still come.
fn by_hand_and_then(flight: &mut Flight, mode: Mode) {
    stream(flight, 1.0, &sticks(0));
    assert_eq!(flight.set_mode(Mode::PosCtl), Some(0));
    stream(flight, 1.0, &sticks(0));
    assert_eq!(flight.set_mode(mode), Some(0));
    stream(flight, 0.2, &sticks(0));
    assert_eq!(flight.vehicle.truth().mode, mode);
}

#[test]
fn sticks_that_end_in_another_mode_are_a_loss_that_only_a_later_mode_takes_over() {
    let mut flight = airborne();
    by_hand_and_then(&mut flight, Mode::Loiter);
    flight.run(7.0);
    assert_eq!(flight.vehicle.truth().mode, Mode::Rtl);

    let mut flight = airborne();
    by_hand_and_then(&mut flight, Mode::Loiter);
    flight.run(1.0);
    assert_eq!(flight.set_mode(Mode::Loiter), Some(0));
    flight.run(10.0);
    assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
    // It is taken over for the whole flight, until sticks come again.
    assert_eq!(flight.set_mode(Mode::Land), Some(0));
    flight.run(1.0);
    assert_eq!(flight.set_mode(Mode::Loiter), Some(0));
    flight.run(10.0);
    assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);

    // COM_RCL_EXCEPT: automatic modes.
    let mut flight = airborne_with(&[(Param::COM_RCL_EXCEPT, 2.0)]);
    by_hand_and_then(&mut flight, Mode::Loiter);
    flight.run(10.0);
    assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
}

#[test]
fn a_return_outlasts_the_loss_of_sticks_and_the_next_mode_does_not() {
    let mut flight = airborne();
    by_hand_and_then(&mut flight, Mode::Rtl);
    flight.run(7.0);
    assert_eq!(flight.vehicle.truth().mode, Mode::Rtl);
    assert_eq!(flight.heartbeat().system_status, MavState::MAV_STATE_ACTIVE);
    // The time to hold has run out meanwhile.
    assert_eq!(flight.set_mode(Mode::Loiter), Some(0));
    flight.run(1.2);
    assert_eq!(flight.vehicle.truth().mode, Mode::Rtl);
    assert_eq!(
        flight.heartbeat().system_status,
        MavState::MAV_STATE_CRITICAL
    );
    assert_eq!(flight.set_mode(Mode::Loiter), Some(0));
    flight.run(10.0);
    assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
}

#[test]
fn lost_sticks_are_acted_on_as_it_is_set() {
    for (action, mode, status) in [
        (1.0, Mode::Loiter, MavState::MAV_STATE_CRITICAL),
        (
            5.0,
            Mode::Termination,
            MavState::MAV_STATE_FLIGHT_TERMINATION,
        ),
        (7.0, Mode::Loiter, MavState::MAV_STATE_ACTIVE),
    ] {
        let mut flight = airborne_with(&[(Param::NAV_RCL_ACT, action)]);
        stream(&mut flight, 1.0, &sticks(0));
        assert_eq!(flight.set_mode(Mode::PosCtl), Some(0));
        stream(&mut flight, 1.0, &sticks(0));
        // None of these holds first.
        flight.run(1.8);
        assert_eq!(flight.vehicle.truth().mode, mode, "{action}");
        assert_eq!(flight.heartbeat().system_status, status, "{action}");
    }
}

#[test]
fn sticks_that_are_moved_take_the_vehicle_and_sticks_that_are_held_do_not() {
    let mut flight = airborne();
    stream(&mut flight, 1.0, &sticks(600));
    assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
    // Slower than MAN_OVERRIDE_SPD, a range a second.
    for x in (0..12).map(|step| 600 - 40 * step) {
        stream(&mut flight, 0.05, &sticks(x));
    }
    assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
    for x in (0..8).map(|step| 120 + 100 * step) {
        stream(&mut flight, 0.05, &sticks(x));
    }
    assert_eq!(flight.vehicle.truth().mode, Mode::PosCtl);
    flight.run(0.2);
    assert!(flight.has_text("Pilot took over using sticks"));

    let mut flight = airborne_with(&[(Param::MAN_OVERRIDE_SPD, -1.0)]);
    for x in (0..8).map(|step| 120 + 100 * step) {
        stream(&mut flight, 0.05, &sticks(x));
    }
    assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
}

/// PX4 judges the last movement again until it misses the sticks, and counts the samples that went one way.
#[test]
fn sticks_that_end_as_they_move_take_the_next_mode_unless_they_have_stepped_back() {
    for (back, mode) in [(false, Mode::PosCtl), (true, Mode::Loiter)] {
        let mut flight = airborne();
        stream(&mut flight, 1.0, &sticks(1000));
        assert_eq!(flight.set_mode(Mode::PosCtl), Some(0));
        stream(&mut flight, 1.0, &sticks(1000));
        for x in (0..5).map(|step| 800 - 200 * step) {
            flight.send(&sticks(x));
            flight.run(0.02);
        }
        assert_eq!(flight.set_mode(Mode::Loiter), Some(0));
        if back {
            flight.send(&sticks(1));
        }
        flight.run(0.3);
        assert_eq!(flight.vehicle.truth().mode, mode);
    }
}

/// GF_ACTION 2 holds, as long as the sticks come.
#[test]
fn a_fence_that_is_flown_through_by_hand_holds_and_sticks_that_end_there_are_lost() {
    for they_continue in [true, false] {
        let mut flight = airborne_with(&[(Param::GF_MAX_HOR_DIST, 30.0)]);
        stream(&mut flight, 1.0, &sticks(0));
        assert_eq!(flight.set_mode(Mode::PosCtl), Some(0));
        stream(&mut flight, 10.0, &sticks(1000));
        assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
        assert_eq!(
            flight.heartbeat().system_status,
            MavState::MAV_STATE_CRITICAL
        );
        let run = |flight: &mut Flight, seconds| {
            if they_continue {
                stream(flight, seconds, &sticks(1000));
            } else {
                flight.run(seconds);
            }
        };
        run(&mut flight, 8.0);
        let mode = if they_continue {
            Mode::Loiter
        } else {
            Mode::Rtl
        };
        assert_eq!(flight.vehicle.truth().mode, mode);
        // A mode that is commanded is flown outside too.
        assert_eq!(flight.set_mode(Mode::Loiter), Some(0));
        run(&mut flight, 1.3);
        assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
        assert_eq!(flight.heartbeat().system_status, MavState::MAV_STATE_ACTIVE);
    }
}

#[test]
fn the_left_stick_in_a_lower_corner_arms_and_disarms() {
    let corner = |r| {
        MavMessage::MANUAL_CONTROL(mav::MANUAL_CONTROL_DATA {
            z: 0,
            r,
            target: 1,
            ..Default::default()
        })
    };
    let mut flight = Flight::ready();
    stream(&mut flight, 0.5, &corner(1000));
    assert_eq!(flight.set_mode(Mode::PosCtl), Some(0));
    // Not quite in it.
    stream(&mut flight, 2.0, &corner(890));
    assert!(!flight.vehicle.truth().armed);
    // More than 0.9 in single precision.
    stream(&mut flight, 1.3, &corner(900));
    assert!(flight.vehicle.truth().armed);
    stream(&mut flight, 1.3, &corner(-900));
    assert!(!flight.vehicle.truth().armed);
    flight.run(0.5);
    assert!(flight.has_text("Armed by stick gesture"));
}

#[test]
fn a_new_mode_of_the_pilot_ends_the_failsafe() {
    let mut flight = airborne();
    stream(&mut flight, 1.0, &sticks(0));
    assert_eq!(flight.set_mode(Mode::PosCtl), Some(0));
    stream(&mut flight, 1.0, &sticks(0));
    flight.run(2.0);
    assert_eq!(flight.set_mode(Mode::Loiter), Some(0));
    flight.run(10.0);
    assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
    assert_eq!(flight.heartbeat().system_status, MavState::MAV_STATE_ACTIVE);
}

#[test]
fn setpoints_fly_and_their_loss_is_a_return_at_once() {
    let mut flight = airborne();
    stream(&mut flight, 1.0, &setpoint(30.0));
    assert_eq!(flight.set_mode(Mode::Offboard), Some(0));
    stream(&mut flight, 20.0, &setpoint(30.0));
    let there = flight.vehicle.truth();
    assert_eq!(there.mode, Mode::Offboard);
    assert!(
        (there.position.n - 30.0).abs() < 1.0,
        "{:?}",
        there.position
    );
    flight.run(0.8);
    assert_eq!(flight.vehicle.truth().mode, Mode::Offboard);
    flight.run(0.6);
    assert_eq!(flight.vehicle.truth().mode, Mode::Rtl);
    assert!(flight.has_text("Failsafe activated"));
}

#[test]
fn a_lost_ground_station_is_a_return_only_where_it_is_set() {
    let mut flight = airborne();
    flight.heartbeats = false;
    flight.run(30.0);
    assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
    assert_eq!(flight.heartbeat().system_status, MavState::MAV_STATE_ACTIVE);

    let mut flight = airborne();
    flight.send(&MavMessage::PARAM_SET(mav::PARAM_SET_DATA {
        param_value: f32::from_bits(2),
        target_system: 1,
        target_component: 1,
        param_id: "NAV_DLL_ACT".into(),
        param_type: mav::MavParamType::MAV_PARAM_TYPE_INT32,
    }));
    assert_eq!(flight.vehicle.params().int(Param::NAV_DLL_ACT), 2);
    flight.heartbeats = false;
    flight.run(12.2);
    assert_eq!(
        flight.heartbeat().system_status,
        MavState::MAV_STATE_CRITICAL
    );
    assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
    flight.run(5.0);
    assert_eq!(flight.vehicle.truth().mode, Mode::Rtl);
    // The input returns, and nothing resumes by itself.
    flight.heartbeats = true;
    flight.run(3.0);
    assert!(flight.has_text("GCS connection regained"));
    assert_eq!(flight.vehicle.truth().mode, Mode::Rtl);
    assert_eq!(flight.set_mode(Mode::Loiter), Some(0));
    flight.run(1.2);
    assert_eq!(flight.heartbeat().system_status, MavState::MAV_STATE_ACTIVE);
}

#[test]
fn motors_stopped_by_force_in_the_air_bring_it_down() {
    let mut flight = airborne();
    assert_eq!(flight.command(400, &[0.0, 21196.0]), Some(0));
    assert!(!flight.vehicle.truth().armed);
    assert!(
        flight.until(5.0, |t| t.landed),
        "{:?}",
        flight.vehicle.truth()
    );
}

#[test]
fn a_flight_termination_is_final_and_its_repetition_is_rejected() {
    const TERMINATE: u16 = 185;
    let mut flight = Flight::ready();
    let [on, off] = [[1.0], [0.0]];
    assert_eq!(flight.command(TERMINATE, &on), Some(2), "denied: disarmed");
    let mut flight = airborne();
    assert_eq!(
        flight.command(TERMINATE, &off),
        Some(2),
        "denied: there is no way back"
    );
    assert_eq!(flight.command(TERMINATE, &on), Some(0));
    assert_eq!(
        flight.command(TERMINATE, &on),
        Some(1),
        "what it is in already"
    );
    flight.run(1.2);
    let beat = flight.heartbeat();
    assert_eq!(beat.system_status, MavState::MAV_STATE_FLIGHT_TERMINATION);
    assert_eq!(beat.custom_mode, Mode::Termination.custom_mode());
    // No mode and no failsafe ends it, not even on the ground and disarmed.
    assert_eq!(flight.set_mode(Mode::Loiter), Some(1));
    assert_eq!(flight.set_mode(Mode::Land), Some(1));
    flight.heartbeats = false;
    flight.run(60.0);
    let truth = flight.vehicle.truth();
    assert!(truth.landed && !truth.armed && truth.mode == Mode::Termination);
    assert_eq!(
        flight.heartbeat().system_status,
        MavState::MAV_STATE_FLIGHT_TERMINATION
    );
    assert_ne!(flight.command(400, &[1.0]), Some(0), "nothing arms it");
}
