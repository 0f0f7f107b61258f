//! What PX4 v1.18 does on wings besides flying: required landings and their checks, the course mode, the figure
//! eight, go-around, and a VTOL's transitions and quad-chute.

use crate::vehicle::support::*;
use mavlink::dialects::development::{MavMessage, MissionState};
use mavlink_link::service::mission::Item;
use px4_sim::{Airframe, Config, HealthFaults, Mode, Ned, Param};

fn winged(airframe: Airframe) -> Flight {
    let mut flight = Flight::boot(Config {
        airframe,
        ..Config::default()
    });
    flight.run(8.0);
    flight
}

fn without_place(command: u16, params: [f32; 4]) -> Item {
    Item {
        frame: 2,
        command,
        autocontinue: true,
        params,
        ..Item::default()
    }
}

fn flyable(flight: &mut Flight) -> bool {
    flight.run(1.5);
    let current = flight.received.iter().rev().find_map(|(_, m)| match m {
        MavMessage::MISSION_CURRENT(m) => Some(m.mission_state),
        _ => None,
    });
    current.is_some_and(|state| state != MissionState::MISSION_STATE_NO_MISSION)
}

fn takes_off(flight: &mut Flight) {
    let up = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 548.0];
    assert_eq!(flight.command(22, &up), Some(0));
    assert_eq!(flight.arm(), Some(0));
    let up = flight.until(120.0, |t| t.mode == Mode::Loiter && !t.landed);
    assert!(up, "{:?}", flight.vehicle.truth());
}

#[test]
fn a_mission_of_wings_is_flown_only_with_a_landing_that_passes() {
    let nan = f32::NAN;
    let land = item(21, [0.0, 0.0, 0.0, nan], 0.0, 0.0, 0.0);
    let route = [waypoint(300.0, 0.0, 60.0), waypoint(600.0, 0.0, 60.0)];
    let start = without_place(189, [0.0; 4]);
    let orbit = |away, up| item(31, [1.0, 80.0, 0.0, 1.0], away, 0.0, up);
    for (landing, text) in [
        (vec![], "Landing waypoint/pattern required."),
        (vec![start], "invalid land start."),
        (
            vec![start, waypoint(-300.0, 0.0, 60.0), land],
            "the landing glide slope is steeper",
        ),
        (
            vec![start, orbit(-60.0, 5.0), land],
            "the landing point must be outside the orbit radius.",
        ),
        (
            vec![start, waypoint(-300.0, 0.0, 0.0), land],
            "must be above the landing point",
        ),
        (
            vec![item(85, [0.0, 0.0, 0.0, nan], 0.0, 0.0, 0.0)],
            "vehicle is not a VTOL",
        ),
    ] {
        let mut flight = winged(Airframe::Plane);
        let plan: Vec<Item> = route.iter().copied().chain(landing).collect();
        // It is acknowledged, although it cannot be flown.
        assert_eq!(flight.upload(&plan), Some(0));
        assert!(!flyable(&mut flight), "{text}");
        assert!(flight.has_text(text), "{text}");
    }
    let mut flight = winged(Airframe::Plane);
    let plan = [route[0], route[1], start, orbit(-700.0, 50.0), land];
    assert_eq!(flight.upload(&plan), Some(0));
    assert!(flyable(&mut flight));
}

#[test]
fn it_lands_by_its_pattern_and_goes_around_once() {
    let mut flight = winged(Airframe::Plane);
    takes_off(&mut flight);
    let plan = [
        waypoint(300.0, 0.0, 60.0),
        without_place(189, [0.0; 4]),
        item(31, [1.0, 80.0, 0.0, 1.0], 80.0, -700.0, 50.0),
        item(21, [0.0, 0.0, 0.0, f32::NAN], 0.0, 0.0, 0.0),
    ];
    assert_eq!(flight.upload(&plan), Some(0));
    assert_eq!(flight.set_mode(Mode::Mission), Some(0));
    let glides = flight.until(300.0, |t| t.mission_seq == 3 && -t.position.d < 25.0);
    assert!(glides, "{:?}", flight.vehicle.truth());
    assert_eq!(flight.command(191, &[]), Some(0));
    flight.run(20.0);
    let truth = flight.vehicle.truth();
    assert_eq!(truth.mode, Mode::Loiter);
    assert!(-truth.position.d > 27.0, "{truth:?}");
    assert_eq!(flight.command(300, &[1.0]), Some(0));
    let down = flight.until(400.0, |t| !t.armed);
    let truth = flight.vehicle.truth();
    assert!(down, "{truth:?}");
    let off = truth.position.n.hypot(truth.position.e);
    assert!(off < 150.0, "{truth:?}");
}

#[test]
fn the_course_mode_keeps_course_altitude_and_speed() {
    let mut flight = winged(Airframe::Plane);
    takes_off(&mut flight);
    // Denied before the mode is entered.
    assert_eq!(flight.command(43_002, &[0.0, 90.0]), Some(2));
    assert_eq!(flight.set_mode(Mode::Course), Some(0));
    assert_eq!(flight.command(43_002, &[1.0, 90.0]), Some(2), "a heading");
    assert_eq!(flight.command(43_002, &[0.0, 90.0]), Some(0));
    assert_eq!(flight.command(186, &[568.0]), Some(0));
    assert_eq!(flight.command(178, &[0.0, 18.0, -1.0]), Some(0));
    flight.run(40.0);
    let truth = flight.vehicle.truth();
    assert_eq!(truth.mode, Mode::Course);
    let course = truth.velocity.bearing().to_degrees();
    assert!((course - 90.0).abs() < 3.0, "{course}");
    assert!((truth.place.altitude_m - 568.0).abs() < 4.0, "{truth:?}");
    assert!(
        (truth.velocity.horizontal() - 18.0).abs() < 1.0,
        "{truth:?}"
    );
}

#[test]
fn a_figure_eight_turns_both_ways() {
    let mut flight = winged(Airframe::Plane);
    takes_off(&mut flight);
    let here = [150.0, 60.0, 0.0, 0.0, f32::NAN, f32::NAN, 548.0];
    assert_eq!(flight.command(35, &here), Some(0));
    flight.run(30.0);
    let mark = flight.track.len();
    flight.run(90.0);
    let turns_both_ways = |flight: &Flight, mark: usize| {
        let banks = || flight.track[mark..].iter().map(|t| t.attitude[0]);
        banks().any(|bank| bank > 0.2) && banks().any(|bank| bank < -0.2)
    };
    assert!(turns_both_ways(&flight, mark));
    // An altitude alone keeps it by DO_REPOSITION, but not by DO_CHANGE_ALTITUDE.
    for (command, params, keeps) in [
        (
            192,
            [-1.0, 1.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 558.0],
            true,
        ),
        (186, [568.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], false),
    ] {
        assert_eq!(flight.command(command, &params), Some(0));
        flight.run(40.0);
        let mark = flight.track.len();
        flight.run(90.0);
        assert_eq!(turns_both_ways(&flight, mark), keeps, "{command}");
    }
    let mut quad = Flight::ready();
    assert_eq!(quad.command(35, &here), Some(3));
}

fn vtol_state(flight: &Flight) -> u32 {
    let states = flight.received.iter().rev().find_map(|(_, m)| match m {
        MavMessage::EXTENDED_SYS_STATE(m) => Some(m.vtol_state as u32),
        _ => None,
    });
    states.expect("it was reported")
}

fn vtol_in_the_air() -> Flight {
    let mut flight = winged(Airframe::Vtol);
    assert_eq!(flight.heartbeat().mavtype as u32, 22);
    assert_eq!(vtol_state(&flight), 3);
    let at = place(300.0, 0.0);
    let up = [0.0, 0.0, 0.0, f32::NAN, at.0, at.1, 518.0];
    assert_eq!(flight.command(84, &up), Some(0));
    assert_eq!(flight.arm(), Some(0));
    assert!(flight.until(120.0, |t| t.mode == Mode::Loiter && !t.landed));
    flight
}

/// Latitude and longitude in degrees of a place north and east of home.
fn place(north: f64, east: f64) -> (f32, f32) {
    let at = px4_sim::LocalFrame::new(Config::default().home).to_global(Ned::new(north, east, 0.0));
    (at.latitude_deg as f32, at.longitude_deg as f32)
}

#[test]
fn a_vtol_takes_off_transitions_and_lands_vertically() {
    let mut flight = vtol_in_the_air();
    flight.run(1.5);
    assert_eq!(vtol_state(&flight), 4);
    assert!((-flight.vehicle.truth().position.d - 80.0).abs() < 12.0);
    let plan = [
        without_place(3000, [4.0, 0.0, 0.0, 0.0]),
        waypoint(300.0, 300.0, 60.0),
        without_place(189, [0.0; 4]),
        waypoint(0.0, 300.0, 50.0),
        item(85, [0.0, 0.0, 0.0, f32::NAN], 0.0, 0.0, 0.0),
    ];
    assert_eq!(flight.upload(&plan), Some(0));
    assert_eq!(flight.set_mode(Mode::Mission), Some(0));
    let down = flight.until(400.0, |t| !t.armed);
    let truth = flight.vehicle.truth();
    assert!(down, "{truth:?}");
    assert_eq!(vtol_state(&flight), 3);
    assert!(truth.position.n.hypot(truth.position.e) < 6.0, "{truth:?}");
}

#[test]
fn a_quad_chute_drops_it_to_a_hover_without_a_transition_and_returns() {
    let mut flight = vtol_in_the_air();
    flight.run(1.5);
    flight.vehicle.set_health_faults(HealthFaults {
        quad_chute: true,
        ..HealthFaults::default()
    });
    let mark = flight.received.len();
    flight.run(3.0);
    let states: Vec<u32> = flight.received[mark..]
        .iter()
        .filter_map(|(_, m)| match m {
            MavMessage::EXTENDED_SYS_STATE(m) => Some(m.vtol_state as u32),
            _ => None,
        })
        .collect();
    assert!(
        !states.contains(&2) && states.last() == Some(&3),
        "{states:?}"
    );
    assert_eq!(flight.vehicle.truth().mode, Mode::Rtl);
    assert_eq!(flight.vehicle.params().get(Param::COM_QC_ACT), 0.0);
}
