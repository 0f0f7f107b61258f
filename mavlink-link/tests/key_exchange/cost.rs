//! What an exchange costs: bytes and messages on the wire, and time, over a network with 20 ms each way that loses some;
//! and the work of either end. Figures with
//! `cargo test -p mavlink-link --test exchange cost -- --nocapture --test-threads 1`.

#![expect(clippy::print_stdout, reason = "the figures are what it is for")]

use core::time::Duration;

use crate::world::{Weather, World, ms};

struct Cost {
    times: Vec<Duration>,
    messages: usize,
    bytes: usize,
    /// Work on the ground and in the air.
    worked: [Duration; 2],
}

/// Until both ends hold the key, over so many exchanges.
fn cost(begin: fn(u64) -> World, loss: u64, runs: u64) -> Cost {
    let mut cost = Cost {
        times: Vec::new(),
        messages: 0,
        bytes: 0,
        worked: [Duration::ZERO; 2],
    };
    for seed in 0..runs {
        let mut world = begin(5_000 + seed);
        // The vehicle stays armed: the key rollover follows, which has its own timing.
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
        cost.bytes += world.bytes;
        for (sum, worked) in cost.worked.iter_mut().zip(world.worked) {
            *sum += worked;
        }
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
fn an_exchange_takes_two_round_trips_outlives_a_third_of_loss_and_is_milliseconds_of_work() {
    const RUNS: u64 = 200;
    for (name, begin) in [
        ("exchange", World::paired as fn(u64) -> World),
        ("pairing", World::pairing),
    ] {
        for (loss, median, worst) in [(0, 85, 85), (10, 600, 15_000), (30, 4_000, 150_000)] {
            let cost = cost(begin, loss, RUNS);
            let at = |percent: usize| cost.times[(cost.times.len() - 1) * percent / 100];
            let work = cost.worked.map(|sum| sum.as_secs_f64() * 1e3 / RUNS as f64);
            println!(
                "{name}, {loss} % lost: {:.2} s median, {:.2} s at 95 %, {:.2} s worst; {:.1} messages, {:.0} bytes; \
                 work {:.1} ms on the ground, {:.1} ms in the air",
                at(50).as_secs_f64(),
                at(95).as_secs_f64(),
                at(100).as_secs_f64(),
                cost.messages as f64 / RUNS as f64,
                cost.bytes as f64 / RUNS as f64,
                work[0],
                work[1],
            );
            // A debug build on a busy computer has its time too.
            assert!(work.iter().all(|ms| *ms < 200.0), "{work:?} ms");
            assert!(at(50) <= ms(median), "{name}, {loss} %: {:?}", at(50));
            assert!(at(100) <= ms(worst), "{name}, {loss} %: {:?}", at(100));
        }
    }
}
