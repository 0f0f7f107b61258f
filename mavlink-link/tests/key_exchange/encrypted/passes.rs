//! What passes: over a good radio all of it, over a bad one what the radio lets through, and after a restart of either end
//! again within a second. The tables of docs/guide/encryption.md: `cargo nextest run -p mavlink-link --test key_exchange
//! encrypted::passes --no-capture`.
#![allow(clippy::print_stderr, reason = "figures for the guide")]

use core::time::Duration;

use mavlink_link::encrypted::{Carrier, EncryptedState, MAX_WIRE};
use mavlink_link::frame::KEY_EXCHANGE_ID;

use super::{AIR, GOOD, GROUND, Radio, World};
use crate::world::{HONEST, ms};

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

/// A radio that loses so many percent, and damages so many of each hundred thousand bits.
fn bad(carrier: Carrier, loss: u64, flipped: u64) -> Radio {
    Radio {
        loss,
        flipped,
        double: 10,
        latency: ms(30),
        jitter: match carrier {
            Carrier::Stream => Duration::ZERO,
            Carrier::Datagrams => ms(40),
        },
    }
}

/// Of what the radio loses and damages: how much of what is sent can arrive. A packet has some 800 bits.
fn whole(loss: u64, flipped: u64) -> f64 {
    (1.0 - loss as f64 / 100.0) * (1.0 - flipped as f64 / 1e5).powi(800)
}

const LOSSES: [u64; 4] = [0, 10, 20, 40];
const FLIPS: [u64; 3] = [0, 20, 50];

#[test]
fn a_bad_radio_costs_what_it_loses_and_repeats_nothing() {
    eprintln!(
        "| lost | bits damaged | keys agreed on after | frames that arrive | the radio lets through |"
    );
    for (loss, flipped) in LOSSES
        .iter()
        .flat_map(|loss| FLIPS.map(|flip| (*loss, flip)))
    {
        let (mut agreed, mut arrived) = (Duration::ZERO, 1.0_f64);
        for carrier in BOTH {
            let mut world = World::new(2 + flipped, carrier);
            world.radio = bad(carrier, loss, flipped);
            agreed = agreed.max(world.recovery(Duration::from_secs(60)));
            world.ends.iter_mut().for_each(|end| end.got.clear());
            world.run(Duration::from_secs(20), ms(20));
            world.check_once();
            for end in &world.ends {
                let got = end.got.len() as f64 / 1_000.0;
                let least = 0.9 * whole(loss, flipped) * 0.7;
                assert!(got >= least, "{carrier:?} {loss} {flipped}: {got}, {least}");
                arrived = arrived.min(got);
            }
            world.radio = GOOD;
            world.recovery(Duration::from_secs(1));
        }
        eprintln!(
            "| {loss} % | {:.2} % | {:.2} s | {:.0} % | {:.0} % |",
            flipped as f64 / 1e3,
            agreed.as_secs_f64(),
            arrived * 100.0,
            whole(loss, flipped) * 100.0
        );
    }
}

/// Restarts of either end and of both, after each of some pauses: how long until both receive again.
fn restarts(world: &mut World, within: Duration) -> Vec<Duration> {
    let mut took = Vec::new();
    for ends in [&[GROUND][..], &[AIR], &[GROUND, AIR]] {
        for pause in [ms(0), ms(100), ms(1_500)] {
            for &at in ends {
                world.ends[at].link = None;
            }
            world.run(pause, ms(20));
            ends.iter().for_each(|&at| world.start(at));
            took.push(world.recovery(within));
            // The requests of the air are limited to one attempt in ten seconds.
            world.run(Duration::from_secs(11), ms(100));
        }
    }
    world.check_once();
    took
}

#[test]
fn a_restart_of_either_end_or_both_is_over_within_a_second() {
    let mut all = Vec::new();
    for carrier in BOTH {
        for seed in 0..10 {
            let mut world = World::new(seed, carrier);
            world.radio.latency = ms(50);
            world.run(Duration::from_secs(3), ms(20));
            all.append(&mut restarts(&mut world, Duration::from_secs(3)));
        }
    }
    show("0 %", &mut all);
    assert_eq!(all.len(), 180);
    let worst = all.last().expect("some");
    assert!(*worst <= Duration::from_secs(1), "{worst:?}");
}

#[test]
fn a_restart_over_a_bad_radio_takes_as_long_as_its_losses_make_the_exchange_repeat() {
    // Four messages have to arrive, each sent again after 0.4 s at most.
    for (loss, most) in [(10, 2.0), (20, 4.0), (40, 15.0)] {
        let mut all = Vec::new();
        for (carrier, seed) in BOTH
            .into_iter()
            .flat_map(|one| [(one, 0), (one, 1), (one, 2)])
        {
            let mut world = World::new(seed, carrier);
            world.radio = bad(carrier, loss, 5);
            world.recovery(Duration::from_secs(60));
            all.append(&mut restarts(&mut world, Duration::from_secs(60)));
        }
        show(&format!("{loss} %"), &mut all);
        let (middle, worst) = (all[all.len() / 2], all[all.len() - 1]);
        assert!(worst.as_secs_f64() <= most, "{loss}: {worst:?}");
        assert!(middle.as_secs_f64() <= 2.0, "{loss}: {middle:?}");
    }
}

/// A line of the guide.
fn show(loss: &str, all: &mut [Duration]) {
    all.sort();
    let of = |part: usize| all[(all.len() - 1) * part / 100].as_secs_f64();
    eprintln!(
        "| {} restarts, {loss} lost | median {:.2} s | four of five within {:.2} s | longest {:.2} s |",
        all.len(),
        of(50),
        of(80),
        of(100)
    );
}

#[test]
fn what_is_for_the_radio_passes_in_the_clear_to_it_alone_and_is_no_mavlink() {
    for carrier in BOTH {
        let mut world = World::new(9, carrier);
        world.run(Duration::from_secs(2), ms(20));
        let (now, at) = (world.now, AIR);
        let end = &mut world.ends[at];
        let link = end.link.as_mut().unwrap();
        // With bytes that have to be escaped, and a frame of MAVLink, which it is not taken for.
        let asked = [b"ATI7~}".to_vec(), super::numbered(0x7e7d)].concat();
        link.send_radio(HONEST, &asked);
        let mut out = [0; MAX_WIRE];
        let (_, length) = link.poll_transmit(now, &mut end.disk, &mut out).unwrap();
        let wire = &out[..length];
        assert_eq!(wire[..6], *b"\x7e\x01ATI7");
        assert_eq!(wire[6..10], [0x7d, 0x5e, 0x7d, 0x5d]);
        assert_eq!(wire.iter().filter(|&&byte| byte == 0x7e).count(), 2);
        // A radio that answers, or anybody else: it is handed to who speaks to the radio, and proves nothing.
        let (before, good) = (world.count(GROUND, "radio"), world.count(GROUND, "opened"));
        for _ in 0..20 {
            assert!(world.arrive(GROUND, wire).is_empty());
        }
        assert_eq!(world.count(GROUND, "radio"), before + 20);
        assert_eq!(world.count(GROUND, "opened"), good);
        let link = world.ends[GROUND].link.as_mut().unwrap();
        assert_eq!(link.poll_radio(), Some(asked));
        let kept = core::iter::from_fn(|| link.poll_radio()).count();
        assert_eq!(
            kept, 7,
            "the others are dropped: nobody makes the memory grow"
        );
        world.recovery(Duration::from_secs(1));
    }
}

fn epochs(world: &World) -> [Option<u32>; 2] {
    let epoch = |end: &super::End| end.link.as_ref().unwrap().epoch();
    world.ends.each_ref().map(epoch)
}

#[test]
fn a_link_on_which_nothing_is_sent_agrees_once_and_counts_as_encrypted() {
    for carrier in BOTH {
        let mut world = World::new(21, carrier);
        // The one frame of either end comes before there are keys, and is dropped.
        world.run(Duration::from_secs(300), Duration::from_secs(3_600));
        assert_eq!(epochs(&world), [Some(1), Some(1)], "{carrier:?}");
        for at in [GROUND, AIR] {
            assert_eq!(world.state(at), EncryptedState::Encrypted);
            assert!(world.ends[at].got.is_empty());
        }
        let sent = world.tape.len();
        assert!((600..=700).contains(&sent), "{sent} packets in 300 s");
        world.recovery(ms(200));
        assert_eq!(epochs(&world), [Some(1), Some(1)], "{carrier:?}");
    }
}

#[test]
fn an_end_of_which_no_packet_arrives_is_asked_for_other_keys_less_and_less_often() {
    let mut world = World::new(22, Carrier::Datagrams);
    let end = world.now + Duration::from_secs(100);
    while world.now < end {
        world.run(ms(10), Duration::from_secs(3_600));
        // As of an end that has keys and sends nothing under them: its exchange alone arrives.
        (world.under_way).retain(|_, (to, bytes)| *to != GROUND || bytes[1] != 0);
    }
    assert_eq!(world.state(GROUND), EncryptedState::Silent);
    // At the start, after 2 s, and 10, 20 and 40 s later.
    assert_eq!(epochs(&world), [Some(5), Some(5)]);
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
