//! A multicopter has no test of having passed a waypoint: a small acceptance radius can be missed,
//! and then the leg's line is followed for good, or the vehicle is stuck beside it.
//!
//! The course is that of flights of a real PX4: two cubic legs of about 150 m in short chords.

use crate::vehicle::support::*;
use px4_sim::{Config, Mode, Truth};

const LEGS: [[(f64, f64); 4]; 2] = [
    [(30.0, 0.0), (90.0, 0.0), (120.0, 40.0), (120.0, 100.0)],
    [(120.0, 100.0), (120.0, 160.0), (60.0, 150.0), (60.0, 210.0)],
];

/// Flies the course with this acceptance radius; returns the largest deviation, or where the vehicle was last.
fn fly(radius: f32, speed: f32, seed: u64) -> Result<f64, Truth> {
    let mut flight = Flight::boot(Config {
        seed,
        ..Config::default()
    });
    flight.run(8.0);
    let mut line = vec![(0.0, 0.0), (30.0, 0.0)];
    for leg in LEGS {
        line.extend((1..=12).map(|i| cubic(leg, f64::from(i) / 12.0)));
    }
    let mut plan = vec![takeoff(20.0), action(178, [1.0, speed, -1.0, 0.0])];
    plan.extend(
        line[1..]
            .iter()
            .map(|&(n, e)| item(16, [0.0, radius, 0.0, f32::NAN], n, e, 20.0)),
    );
    plan.push(land(60.0, 210.0));
    assert_eq!(flight.upload(&plan), Some(0));
    assert_eq!(flight.command(300, &[0.0]), Some(0));
    if !flight.until(240.0, |t| !t.armed) {
        return Err(flight.vehicle.truth());
    }
    let under_way = 3..plan.len() as u16 - 1;
    let course: Vec<Truth> = flight
        .track
        .iter()
        .filter(|t| under_way.contains(&t.mission_seq))
        .copied()
        .collect();
    Ok(deviation(&course, &line))
}

fn cubic(p: [(f64, f64); 4], t: f64) -> (f64, f64) {
    let u = 1.0 - t;
    let weights = [u * u * u, 3.0 * u * u * t, 3.0 * u * t * t, t * t * t];
    let sum = |pick: fn(&(f64, f64)) -> f64| weights.iter().zip(&p).map(|(w, p)| w * pick(p)).sum();
    (sum(|p| p.0), sum(|p| p.1))
}

#[test]
fn two_metres_and_more_are_always_reached_and_flown_as_closely_as_a_real_one() {
    for seed in 1..=6 {
        for (radius, speed) in [(2.0, 5.0), (2.0, 10.0), (3.0, 5.0), (0.0, 5.0), (0.0, 10.0)] {
            let off = fly(radius, speed, seed)
                .unwrap_or_else(|at| panic!("{radius} m, seed {seed}: {at:?}"));
            assert!(
                (0.4..3.0).contains(&off),
                "{radius} m at {speed} m/s, seed {seed}: {off}"
            );
        }
    }
}

#[test]
fn one_metre_is_missed_now_and_then_for_good() {
    let lost: Vec<Truth> = (1..=12)
        .filter_map(|seed| fly(1.0, 5.0, seed).err())
        .collect();
    assert!(
        !lost.is_empty(),
        "a vehicle that never misses hides the danger"
    );
    assert!(lost.len() < 12);
    // Flown away along the line, or stuck beside it; in mission mode, with nothing reported.
    for truth in lost {
        assert!(
            truth.armed && truth.mode == Mode::Mission && truth.mission_seq < 26,
            "{truth:?}"
        );
    }
}
