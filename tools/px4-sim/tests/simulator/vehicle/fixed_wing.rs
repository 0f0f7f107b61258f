//! The fixed wing: no hover, a loiter is an orbit, a corner is a turn.

use crate::vehicle::support::*;
use px4_sim::{Airframe, Config, Mode, Param};

fn plane(wind_ne_ms: [f64; 2]) -> Flight {
    let mut flight = Flight::boot(Config {
        airframe: Airframe::Plane,
        params: vec![(Param::MIS_TKO_LAND_REQ, 0.0)],
        wind_ne_ms,
        ..Config::default()
    });
    flight.run(8.0);
    flight
}

#[test]
fn it_reports_a_fixed_wing_and_accepts_a_pitch_for_take_off() {
    let mut flight = plane([0.0; 2]);
    assert_eq!(flight.heartbeat().mavtype as u32, 1);
    let pitch = [15.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 538.0];
    assert_eq!(flight.command(22, &pitch), Some(0));
}

#[test]
fn it_flies_a_route_and_orbits_at_its_end() {
    for wind in [[0.0, 0.0], [0.0, 6.0]] {
        let mut flight = plane(wind);
        let plan = [
            item(22, [0.0, 0.0, 0.0, f32::NAN], 300.0, 0.0, 50.0),
            waypoint(700.0, 0.0, 60.0),
            waypoint(700.0, 500.0, 60.0),
            item(17, [0.0, 0.0, 60.0, f32::NAN], 200.0, 500.0, 60.0),
        ];
        assert_eq!(flight.upload(&plan), Some(0));
        assert_eq!(flight.command(300, &[0.0]), Some(0));
        assert!(
            flight.until(240.0, |t| t.mission_seq == 3),
            "{:?}",
            flight.vehicle.truth()
        );
        flight.run(60.0);
        let leg: Vec<_> = flight
            .track
            .iter()
            .filter(|t| t.mission_seq == 2)
            .copied()
            .collect();
        let off = deviation(&leg[leg.len() / 2..], &[(700.0, 0.0), (700.0, 500.0)]);
        assert!(off < 8.0, "settles on its line in wind {wind:?}: {off}");
        let mark = flight.track.len();
        flight.run(40.0);
        for truth in &flight.track[mark..] {
            let r = (truth.position.n - 200.0).hypot(truth.position.e - 500.0);
            assert!(
                (50.0..75.0).contains(&r),
                "orbit of 60 m in wind {wind:?}: {r}"
            );
            assert!(truth.velocity.horizontal() > 5.0, "never stops");
            assert!((-truth.position.d - 60.0).abs() < 5.0);
            assert!(truth.attitude[0].abs() < 1.0);
        }
    }
}

#[test]
fn hold_is_an_orbit_and_landing_ends_on_the_ground() {
    let mut flight = plane([0.0; 2]);
    assert_eq!(
        flight.command(22, &[0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 538.0]),
        Some(0)
    );
    assert_eq!(flight.arm(), Some(0));
    assert!(
        flight.until(120.0, |t| t.mode == Mode::Loiter && !t.landed),
        "{:?}",
        flight.vehicle.truth()
    );
    flight.run(60.0);
    let truth = flight.vehicle.truth();
    assert!(truth.velocity.horizontal() > 8.0);
    assert!((truth.place.altitude_m - 538.0).abs() < 6.0, "{truth:?}");
    assert_eq!(flight.command(21, &[]), Some(0));
    assert!(
        flight.until(240.0, |t| !t.armed),
        "{:?}",
        flight.vehicle.truth()
    );
    assert!(flight.vehicle.truth().landed);
}
