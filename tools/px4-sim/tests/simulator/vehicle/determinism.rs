//! The same settings and the same calls give the same flight; another seed another one.

use crate::vehicle::support::*;
use px4_sim::{Config, Truth};

fn flight(seed: u64) -> (Vec<Truth>, usize) {
    let mut flight = Flight::boot(Config {
        seed,
        ..Config::default()
    });
    flight.run(8.0);
    assert_eq!(
        flight.upload(&[takeoff(10.0), waypoint(40.0, 20.0, 12.0), land(0.0, 0.0)]),
        Some(0)
    );
    assert_eq!(flight.command(300, &[0.0]), Some(0));
    flight.run(60.0);
    (flight.track, flight.received.len())
}

#[test]
fn a_seed_is_a_flight() {
    let (first, second, other) = (flight(1), flight(1), flight(2));
    assert_eq!(first, second);
    assert_ne!(first.0, other.0);
}

#[test]
fn the_size_of_a_step_changes_nothing() {
    use std::time::Duration;
    let run = |step: Duration| {
        let mut vehicle = px4_sim::Vehicle::new(Config::default());
        let mut sent = Vec::new();
        for _ in 0..10_000 / step.as_millis() {
            vehicle.step(step);
            while let Some(out) = vehicle.poll_transmit() {
                sent.push(out);
            }
        }
        (vehicle.truth(), format!("{sent:?}"))
    };
    assert_eq!(
        run(Duration::from_millis(1)),
        run(Duration::from_millis(50))
    );
}
