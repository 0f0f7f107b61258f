//! What an exchange costs: octets and messages on the wire, and time, over a network with 20 ms each way that loses some;
//! and the work of either end. Figures with
//! `cargo test --release -p mavlink-link --test exchange cost -- --nocapture --test-threads 1`.

#![expect(clippy::print_stdout, reason = "the figures are what it is for")]

use core::time::Duration;
use std::time::Instant;

use crate::world::{Parcel, Weather, World, ms};

struct Cost {
    times: Vec<Duration>,
    messages: usize,
    octets: usize,
}

/// Until both ends hold the key, over so many exchanges.
fn cost(begin: fn(u64) -> World, loss: u64, runs: u64) -> Cost {
    let mut cost = Cost {
        times: Vec::new(),
        messages: 0,
        octets: 0,
    };
    for seed in 0..runs {
        let mut world = begin(5_000 + seed);
        // The vehicle stays armed: what follows is the handover, which has its own pace.
        world.armed = true;
        world.weather = Weather {
            loss,
            ..Weather::default()
        };
        let begun = world.now;
        while !agreed(&world) {
            let next = world.now + ms(5);
            world.run_until(next);
            assert!(world.now < Duration::from_secs(300), "{loss} %: never");
        }
        cost.times.push(world.now - begun);
        cost.messages += world.sent;
        cost.octets += world.octets;
    }
    cost.times.sort();
    cost
}

fn agreed(world: &World) -> bool {
    use mavlink_link::exchange::InitiatorEvent as E;
    world
        .events
        .iter()
        .any(|event| matches!(event, E::Agreed { .. }))
}

#[test]
fn an_exchange_takes_two_round_trips_and_outlives_a_third_of_loss() {
    const RUNS: u64 = 200;
    for (name, begin) in [
        ("exchange", World::paired as fn(u64) -> World),
        ("pairing", World::pairing),
    ] {
        for (loss, median, worst) in [(0, 85, 85), (10, 600, 15_000), (30, 4_000, 150_000)] {
            let cost = cost(begin, loss, RUNS);
            let at = |percent: usize| cost.times[(cost.times.len() - 1) * percent / 100];
            println!(
                "{name}, {loss} % lost: {:.2} s median, {:.2} s at 95 %, {:.2} s worst; {:.1} messages, {:.0} octets",
                at(50).as_secs_f64(),
                at(95).as_secs_f64(),
                at(100).as_secs_f64(),
                cost.messages as f64 / RUNS as f64,
                cost.octets as f64 / RUNS as f64,
            );
            assert!(at(50) <= ms(median), "{name}, {loss} %: {:?}", at(50));
            assert!(at(100) <= ms(worst), "{name}, {loss} %: {:?}", at(100));
        }
    }
}

#[test]
fn the_work_of_either_end_is_milliseconds() {
    const RUNS: u64 = 50;
    for (name, begin) in [
        ("exchange", World::paired as fn(u64) -> World),
        ("pairing", World::pairing),
    ] {
        let (mut ground, mut air) = (Duration::ZERO, Duration::ZERO);
        for seed in 0..RUNS {
            let mut world = begin(6_000 + seed);
            world.held = Some(Default::default());
            let begun = Instant::now();
            while world.held.as_ref().is_some_and(|held| held.is_empty()) {
                let next = world.now + ms(5);
                world.run_until(next);
            }
            ground += begun.elapsed();
            while let Some(parcel) = world.held.as_mut().and_then(|held| held.pop_front()) {
                let begun = Instant::now();
                world.deliver(&parcel);
                match parcel {
                    Parcel::Up(_) => air += begun.elapsed(),
                    _ => ground += begun.elapsed(),
                }
            }
            assert!(agreed(&world));
        }
        let each = |total: Duration| total.as_secs_f64() * 1e6 / RUNS as f64;
        println!(
            "{name}: {:.0} us of work on the ground, {:.0} us in the air",
            each(ground),
            each(air)
        );
        // A debug build on a busy computer has its time too.
        assert!(each(ground) < 200_000.0 && each(air) < 200_000.0);
    }
}
