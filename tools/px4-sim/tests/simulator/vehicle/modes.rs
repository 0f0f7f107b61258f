//! On the ground every mode is acknowledged; in the air only one that can be flown.

use crate::vehicle::support::*;
use mavlink::dialects::development as mav;
use mavlink::dialects::development::{MavMessage, MavState};
use px4_sim::Mode;

fn airborne() -> Flight {
    let mut flight = Flight::ready();
    assert_eq!(
        flight.command(22, &[0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 508.0]),
        Some(0)
    );
    assert_eq!(flight.arm(), Some(0));
    assert!(flight.until(60.0, |t| t.mode == Mode::Loiter && !t.landed));
    flight.run(3.0);
    flight
}

#[test]
fn on_the_ground_an_acknowledgement_proves_nothing() {
    let mut flight = Flight::ready();
    for mode in [
        Mode::Mission,
        Mode::Rtl,
        Mode::Land,
        Mode::PosCtl,
        Mode::AltCtl,
        Mode::Offboard,
    ] {
        assert_eq!(flight.set_mode(mode), Some(0), "{mode:?}");
        flight.run(1.1);
        let beat = flight.heartbeat();
        assert_eq!(beat.custom_mode, mode.custom_mode());
        assert_eq!(beat.system_status, MavState::MAV_STATE_UNINIT, "{mode:?}");
        assert_eq!(flight.arm(), Some(1), "{mode:?}");
    }
    assert_eq!(flight.set_mode(Mode::Loiter), Some(0));
    flight.run(1.1);
    assert_eq!(
        flight.heartbeat().system_status,
        MavState::MAV_STATE_STANDBY
    );
}

#[test]
fn unknown_modes_are_rejected_with_a_text() {
    let mut flight = Flight::ready();
    assert_eq!(flight.command(176, &[1.0, 99.0]), Some(1));
    assert_eq!(flight.command(176, &[1.0, 4.0, 99.0]), Some(1));
    assert_eq!(
        flight.command(176, &[0.0, 4.0, 4.0]),
        Some(1),
        "bit 0 of param1 is needed"
    );
    assert_eq!(
        flight.command(176, &[1.0, 67_371_008.0]),
        Some(1),
        "packed custom mode"
    );
    flight.run(0.5);
    assert!(flight.has_text("Unsupported main mode"));
    assert!(flight.has_text("Unsupported auto mode"));
}

#[test]
fn set_mode_is_answered_for_do_set_mode() {
    let mut flight = Flight::ready();
    #[allow(deprecated, reason = "PX4 takes what MAVLink has replaced")]
    flight.send(&MavMessage::SET_MODE(mav::SET_MODE_DATA {
        custom_mode: Mode::Rtl.custom_mode(),
        target_system: 1,
        base_mode: mav::MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
    }));
    flight.run(0.1);
    let ack = flight.last(|m| match m {
        MavMessage::COMMAND_ACK(a) => Some((a.command as u32, a.result as u32)),
        _ => None,
    });
    assert_eq!(ack, Some((176, 0)));
    assert_eq!(flight.vehicle.truth().mode, Mode::Rtl);
}

#[test]
fn in_the_air_a_mode_without_its_source_is_rejected() {
    let mut flight = airborne();
    assert_eq!(flight.set_mode(Mode::PosCtl), Some(1));
    assert_eq!(flight.set_mode(Mode::Offboard), Some(1));
    assert_eq!(flight.set_mode(Mode::Mission), Some(1));
    flight.run(0.5);
    assert!(flight.has_text("Switching to Position is currently not available"));
    assert!(flight.has_text("Switching to Offboard is currently not available"));
    assert_eq!(flight.vehicle.truth().mode, Mode::Loiter);
    assert_eq!(flight.command(400, &[0.0]), Some(1));
    flight.run(0.5);
    assert!(flight.has_text("Disarming denied: not landed"));
}

#[test]
fn a_take_off_without_altitude_stops_at_two_and_a_half_metres() {
    let mut flight = Flight::ready();
    assert_eq!(
        flight.command(22, &[0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, f32::NAN]),
        Some(0)
    );
    assert_eq!(flight.arm(), Some(0));
    assert!(flight.until(30.0, |t| t.mode == Mode::Loiter && !t.landed));
    flight.run(5.0);
    let height = -flight.vehicle.truth().position.d;
    assert!((1.5..3.2).contains(&height), "{height}");
    assert!(flight.has_text("Using default takeoff altitude: 2.5 m"));
}

#[test]
fn a_commanded_take_off_reaches_its_altitude_and_holds() {
    let flight = airborne();
    let truth = flight.vehicle.truth();
    assert!((truth.place.altitude_m - 508.0).abs() < 1.0, "{truth:?}");
    assert!(truth.position.horizontal() < 1.0);
}

#[test]
fn land_comes_down_here_and_return_goes_home() {
    let mut flight = airborne();
    let away = flight.vehicle.truth();
    assert_eq!(
        flight.command(192, &[-1.0, 1.0, 0.0, f32::NAN, 47.398_5, 8.545_594, 510.0]),
        Some(0)
    );
    flight.run(40.0);
    let there = flight.vehicle.truth();
    assert!(
        (there.place.latitude_deg - 47.398_5).abs() < 2e-5,
        "{there:?}"
    );
    assert!((there.place.altitude_m - 510.0).abs() < 1.0);
    assert!((there.position - away.position).horizontal() > 80.0);
    assert_eq!(flight.command(20, &[]), Some(0));
    flight.run(1.0);
    assert!(
        flight.has_text("RTL: start return at 518 m (30 m above destination)"),
        "{:?}",
        flight.texts()
    );
    assert!(
        flight.until(200.0, |t| !t.armed),
        "{:?}",
        flight.vehicle.truth()
    );
    let end = flight.vehicle.truth();
    assert!(end.position.horizontal() < 1.5, "{:?}", end.position);
    assert_eq!(end.mode, Mode::Loiter, "hold after a return");
    assert!(flight.has_text("Disarmed by landing"));
}

#[test]
fn a_return_chooses_between_home_and_rally_points_as_rtl_type_says() {
    let rally = |north, up| item(5100, [0.0; 4], north, 0.0, up);
    for (rtl_type, from, lands) in [
        (0, 100.0, 120.0),
        (0, 40.0, 60.0),
        (0, 20.0, 0.0),
        (1, 20.0, 60.0),
        (2, 100.0, 0.0),
        (5, 5.0, 60.0),
    ] {
        let mut flight = airborne();
        let points = [rally(120.0, 0.0), rally(60.0, 0.0), rally(3.0, 0.0)];
        let points = &points[..if rtl_type == 5 { 2 } else { 3 }];
        let kind = mav::MavMissionType::MAV_MISSION_TYPE_RALLY;
        assert_eq!(flight.upload_kind(points, kind), Some(0));
        flight.send(&MavMessage::PARAM_SET(mav::PARAM_SET_DATA {
            param_value: f32::from_bits(rtl_type),
            target_system: 1,
            target_component: 1,
            param_id: "RTL_TYPE".into(),
            param_type: mav::MavParamType::MAV_PARAM_TYPE_INT32,
        }));
        let place = waypoint(from, 0.0, 20.0);
        let (lat, lon) = (place.x as f32 / 1e7, place.y as f32 / 1e7);
        let go = [-1.0, 1.0, 0.0, f32::NAN, lat, lon, 508.0];
        assert_eq!(flight.command(192, &go), Some(0));
        flight.run(40.0);
        assert_eq!(flight.command(20, &[]), Some(0));
        assert!(flight.until(200.0, |t| !t.armed), "RTL_TYPE {rtl_type}");
        let end = flight.vehicle.truth().position;
        assert!((end.n - lands).abs() < 2.0, "RTL_TYPE {rtl_type}: {end:?}");
    }
}

#[test]
fn an_orbit_keeps_its_radius_and_direction() {
    let mut flight = airborne();
    let home = flight.vehicle.truth().place;
    let (lat, lon) = (home.latitude_deg as f32, home.longitude_deg as f32);
    assert_eq!(
        flight.command(34, &[20.0, 4.0, 0.0, f32::NAN, lat, lon, 508.0]),
        Some(0)
    );
    flight.run(20.0);
    assert_eq!(flight.vehicle.truth().mode, Mode::Orbit);
    let mut turned = 0.0;
    let mut last = flight.vehicle.truth().position.bearing();
    for _ in 0..100 {
        flight.run(0.1);
        let at = flight.vehicle.truth().position;
        assert!((15.0..25.0).contains(&at.horizontal()), "{at:?}");
        let step = (at.bearing() - last + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU)
            - std::f64::consts::PI;
        turned += step;
        last = at.bearing();
    }
    assert!(turned > 1.0, "clockwise: {turned}");
}

#[test]
fn the_frame_of_a_reposition_is_not_looked_at() {
    let mut flight = airborne();
    let command = |frame| {
        MavMessage::COMMAND_INT(mav::COMMAND_INT_DATA {
            command: mav::MavCmd::MAV_CMD_DO_REPOSITION,
            target_system: 1,
            target_component: 1,
            param1: -1.0,
            param2: 1.0,
            param4: f32::NAN,
            x: 473_977_434,
            y: 85_455_939,
            z: 520.0,
            frame,
            ..Default::default()
        })
    };
    flight.send(&command(mav::MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT));
    flight.run(20.0);
    let altitude = flight.vehicle.truth().place.altitude_m;
    assert!(
        (altitude - 520.0).abs() < 1.0,
        "AMSL although called relative: {altitude}"
    );
}

/// As of navigator_main.cpp and loiter.cpp of PX4.
#[test]
fn the_mode_once_more_and_an_altitude_alone_keep_the_place_that_is_flown_to() {
    let mut flight = airborne();
    let here = flight.vehicle.truth().place;
    let lat = (here.latitude_deg + 0.002) as f32;
    let lon = here.longitude_deg as f32;
    let go = |flight: &mut Flight, [lat, lon, amsl]: [f32; 3]| {
        flight.command(192, &[-1.0, 1.0, 0.0, f32::NAN, lat, lon, amsl])
    };
    assert_eq!(go(&mut flight, [lat, lon, 508.0]), Some(0));
    flight.run(5.0);
    assert_eq!(flight.set_mode(Mode::Loiter), Some(0));
    assert_eq!(go(&mut flight, [f32::NAN, f32::NAN, 515.0]), Some(0));
    flight.run(10.0);
    let truth = flight.vehicle.truth();
    assert!(truth.velocity.n > 3.0, "{truth:?}");
    // Without either it stops.
    assert_eq!(go(&mut flight, [f32::NAN; 3]), Some(0));
    flight.run(10.0);
    let truth = flight.vehicle.truth();
    assert!(truth.velocity.horizontal() < 0.5, "{truth:?}");
    assert!(truth.position.n < 150.0, "{truth:?}");
}
