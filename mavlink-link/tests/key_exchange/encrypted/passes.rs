//! What passes: over a good radio all of it, over a bad one what the radio lets through, and after a restart of either end
//! again within a second.

use core::time::Duration;

use mavlink_link::encrypted::{Carrier, EncryptedState};
use mavlink_link::frame::KEY_EXCHANGE_ID;

use super::{AIR, GOOD, GROUND, Radio, World};
use crate::world::ms;

const BOTH: [Carrier; 2] = [Carrier::Stream, Carrier::Datagrams];

#[test]
fn both_agree_and_every_frame_arrives_in_order_and_nothing_is_seen() {
    for carrier in BOTH {
        let mut world = World::new(1, carrier);
        assert_eq!(world.state(GROUND), EncryptedState::Agreeing);
        let took = world.recovery(Duration::from_secs(1));
        assert!(took < ms(200), "{took:?}");
        world.run(Duration::from_secs(10), ms(10));
        for end in &world.ends {
            assert!(end.got.len() > 950, "{}", end.got.len());
            assert!(end.got.is_sorted());
        }
        world.check_once();
        for at in [GROUND, AIR] {
            assert_eq!(world.state(at), EncryptedState::Encrypted);
            assert_eq!(world.count(at, "lost"), 0);
            assert_eq!(world.count(at, "forged"), 0);
        }
        let overheard = world.overheard();
        // Steps 1 to 4, and requests of the air that came before.
        assert!((4..=6).contains(&overheard.len()), "{overheard:?}");
        assert!(overheard.iter().all(|&id| id == KEY_EXCHANGE_ID));
        let epochs = world
            .ends
            .each_ref()
            .map(|end| end.link.as_ref().unwrap().epoch());
        assert_eq!(epochs, [Some(1), Some(1)]);
    }
}

#[test]
fn a_bad_radio_costs_what_it_loses_and_repeats_nothing() {
    for carrier in BOTH {
        for loss in [0, 10, 20, 40] {
            for (seed, flipped) in [(2, 0), (3, 20), (4, 50)] {
                let mut world = World::new(seed, carrier);
                world.radio = Radio {
                    loss,
                    flipped,
                    double: 10,
                    latency: ms(30),
                    jitter: match carrier {
                        Carrier::Stream => Duration::ZERO,
                        Carrier::Datagrams => ms(40),
                    },
                };
                world.recovery(Duration::from_secs(60));
                world.ends.iter_mut().for_each(|end| end.got.clear());
                world.run(Duration::from_secs(20), ms(20));
                world.check_once();
                // A packet has some 800 bits: of 0.02 % damaged 15 % are, of 0.05 % a third.
                let whole = (1.0 - loss as f64 / 100.0) * (1.0 - flipped as f64 / 1e5).powi(800);
                for end in &world.ends {
                    let least = (900.0 * whole * 0.7) as usize;
                    let got = end.got.len();
                    assert!(
                        got >= least,
                        "{carrier:?} {loss} {flipped}: {got} of {least}"
                    );
                }
                world.radio = GOOD;
                world.recovery(Duration::from_secs(1));
            }
        }
    }
}

#[test]
fn a_restart_of_either_end_or_both_is_over_within_a_second() {
    for carrier in BOTH {
        for seed in 0..10 {
            let mut world = World::new(seed, carrier);
            world.radio.latency = ms(50);
            world.run(Duration::from_secs(3), ms(20));
            for ends in [&[GROUND][..], &[AIR], &[GROUND, AIR]] {
                for pause in [ms(0), ms(100), ms(1_500)] {
                    for &at in ends {
                        world.ends[at].link = None;
                    }
                    world.run(pause, ms(20));
                    ends.iter().for_each(|&at| world.start(at));
                    let took = world.recovery(Duration::from_secs(3));
                    assert!(
                        took <= Duration::from_secs(1),
                        "{ends:?} {pause:?}: {took:?}"
                    );
                    // The requests of the air are limited to one attempt in ten seconds.
                    world.run(Duration::from_secs(11), ms(100));
                }
            }
            world.check_once();
        }
    }
}

#[test]
fn a_radio_that_was_out_of_reach_for_minutes_needs_no_new_keys() {
    let mut world = World::new(7, Carrier::Datagrams);
    world.run(Duration::from_secs(2), ms(20));
    world.radio.loss = 100;
    world.run(Duration::from_secs(120), ms(500));
    assert_eq!(world.state(GROUND), EncryptedState::Silent);
    world.radio = GOOD;
    let took = world.recovery(Duration::from_secs(1));
    assert!(took <= ms(100), "{took:?}");
}

#[test]
fn an_agent_that_was_replaced_while_out_of_reach_is_found_again() {
    for seed in 0..5 {
        let mut world = World::new(seed, Carrier::Datagrams);
        world.run(Duration::from_secs(2), ms(20));
        world.radio.loss = 100;
        world.start(AIR);
        world.run(Duration::from_secs(47 + seed), ms(500));
        world.radio = GOOD;
        // Its next request: at most 10 s apart; the ground's next attempt or retry is hastened by it.
        let took = world.recovery(Duration::from_secs(12));
        assert!(took <= Duration::from_secs(11), "{took:?}");
    }
}
