//! Somebody on the radio who records, plays again, splices, cuts, changes and invents.

use core::time::Duration;

use mavlink_link::encrypted::{Carrier, EncryptedEvent, EncryptedState};
use mavlink_link::exchange::{Identity, VERSION};
use mavlink_link::frame::{Header, KEY_EXCHANGE_ID, MAX_FRAME, encode_raw};

use super::{AIR, GROUND, World, numbered};
use crate::world::{HONEST, ms, parties};

const BOTH: [Carrier; 2] = [Carrier::Stream, Carrier::Datagrams];

fn flown(seed: u64, carrier: Carrier) -> World {
    let mut world = World::new(seed, carrier);
    world.run(Duration::from_secs(2), ms(20));
    world
}

/// Packets on the tape that this end has sent.
fn packets(world: &World, from: usize) -> Vec<Vec<u8>> {
    let sent = world.tape.iter().filter(|(by, _)| *by == from);
    sent.map(|(_, bytes)| bytes.clone())
        .filter(|bytes| bytes[1] == 0)
        .collect()
}

fn all(world: &World) -> Vec<Vec<u8>> {
    world.tape.iter().map(|(_, bytes)| bytes.clone()).collect()
}

#[test]
fn nothing_is_accepted_again_in_this_run_or_after_restarts_of_either_end_or_both() {
    for carrier in BOTH {
        for restarted in [&[][..], &[GROUND], &[AIR], &[GROUND, AIR]] {
            let mut world = flown(1, carrier);
            let tape = all(&world);
            for &at in restarted {
                world.start(at);
            }
            world.run(Duration::from_secs(2), ms(20));
            for at in [GROUND, AIR] {
                for bytes in &tape {
                    assert!(world.arrive(at, bytes).is_empty());
                }
            }
            world.check_once();
            world.recovery(Duration::from_secs(1));
        }
    }
}

#[test]
fn a_replay_at_the_moment_of_a_restart_is_not_accepted_either() {
    for at in [GROUND, AIR] {
        let mut world = flown(2, Carrier::Datagrams);
        let tape = all(&world);
        world.start(at);
        for bytes in &tape {
            assert!(world.arrive(at, bytes).is_empty());
        }
        assert!(world.count(at, "no_key") > 0);
        // What was played to it does not keep it from agreeing.
        world.recovery(Duration::from_secs(3));
        world.check_once();
    }
}

#[test]
fn packets_of_two_sessions_or_of_two_vehicles_cannot_be_spliced() {
    for carrier in BOTH {
        let (mut world, other) = (flown(3, carrier), flown(4, carrier));
        let old = packets(&world, AIR);
        world.start(AIR);
        world.run(Duration::from_secs(2), ms(20));
        let new = packets(&world, AIR).pop().unwrap();
        let foreign = packets(&other, AIR);
        for donor in old.iter().chain(&foreign) {
            // The counter of the new, the rest of the old; and halves of each.
            for cut in [9, 10, 50, 90] {
                let (Some(head), Some(tail)) = (new.get(..cut), donor.get(cut..)) else {
                    continue;
                };
                assert!(world.arrive(GROUND, &[head, tail].concat()).is_empty());
            }
        }
        world.check_once();
        world.recovery(Duration::from_secs(1));
    }
}

#[test]
fn a_packet_that_is_cut_or_changed_brings_nothing_and_costs_nothing() {
    for carrier in BOTH {
        let mut world = flown(5, carrier);
        world.radio.loss = 100;
        world.send(AIR);
        world.run(ms(20), Duration::from_secs(60));
        let packet = packets(&world, AIR).pop().unwrap();
        for cut in 1..packet.len() - 1 {
            assert!(world.arrive(GROUND, &packet[..cut]).is_empty());
            // On a stream the rest of it is what the next flag ends.
            assert!(world.arrive(GROUND, &[0x7e]).is_empty());
        }
        for at in 1..packet.len() - 1 {
            let mut bent = packet.clone();
            bent[at] ^= 1 << (at % 8);
            assert!(world.arrive(GROUND, &bent).is_empty());
            assert!(world.arrive(GROUND, &[0x7e]).is_empty());
        }
        assert!(
            !world.arrive(GROUND, &packet).is_empty(),
            "the whole one is good still"
        );
        assert!(world.arrive(GROUND, &packet).is_empty());
    }
}

#[test]
fn what_an_end_has_sent_does_not_come_back_to_it() {
    for carrier in BOTH {
        let mut world = flown(6, carrier);
        for at in [GROUND, AIR] {
            for bytes in packets(&world, at) {
                assert!(world.arrive(at, &bytes).is_empty());
            }
            assert!(world.count(at, "station") > 0);
        }
    }
}

#[test]
fn plaintext_is_never_taken_and_never_sent() {
    for carrier in BOTH {
        let mut world = World::new(7, carrier);
        world.radio.loss = 100;
        // Before there are keys: a frame is dropped, and leaves in no form.
        for at in [GROUND, AIR] {
            world.send(at);
            assert_eq!(world.count(at, "unsent_no_key"), 1);
            // In the clear, bare or framed as each of the kinds.
            let plain = numbered(77);
            assert!(world.arrive(at, &plain).is_empty());
            for kind in 0..=3 {
                let framed = [&[0x7e, kind][..], &plain, &[0x7e]].concat();
                assert!(world.arrive(at, &framed).is_empty());
            }
            assert!(
                world
                    .arrive(at, &[&[0x7e], &plain[..], &[0x7e]].concat())
                    .is_empty()
            );
            assert!(world.count(at, "plaintext") > 0);
            assert!(world.count(at, "not_exchange") > 0);
        }
        assert!(world.overheard().iter().all(|&id| id == KEY_EXCHANGE_ID));
        world.radio.loss = 0;
        world.recovery(Duration::from_secs(12));
        for at in [GROUND, AIR] {
            assert!(world.arrive(at, &numbered(78)).is_empty());
        }
    }
}

fn exchange(suite: u8, version: u8) -> Vec<u8> {
    let header = Header {
        system_id: 1,
        component_id: 191,
        message_id: KEY_EXCHANGE_ID,
        ..Header::default()
    };
    let mut payload = [1; 60];
    (payload[36], payload[38], payload[42]) = (version, suite, 17);
    let mut out = [0; MAX_FRAME];
    let len = encode_raw(header, &payload, &mut out).unwrap();
    out[..len].to_vec()
}

#[test]
fn of_exchanges_only_a_pairing_passes_inside_and_only_it_leaves_in_the_clear() {
    let mut world = flown(8, Carrier::Datagrams);
    let cases = [(0, false), (1, false), (2, true), (3, false)]
        .map(|(suite, passes)| (suite, VERSION, passes));
    // Of version 0 it is the legacy exchange, whatever its suite.
    for (suite, version, passes) in cases.into_iter().chain([(2, 0, false), (2, 1, false)]) {
        let frame = exchange(suite, version);
        let framed = [&[0x7e, 2][..], &frame, &[0x7e]].concat();
        let inside = world.arrive(GROUND, &framed);
        assert_eq!(inside == frame, passes, "suite {suite}");
        assert_eq!(inside.is_empty(), !passes);
        // The agreement on a signing key, which is suite 1 too, is encrypted as all else.
        let before = world.overheard().len();
        let now = world.now;
        world.ends[AIR]
            .link
            .as_mut()
            .unwrap()
            .send(now, HONEST, &frame);
        world.run(ms(20), Duration::from_secs(60));
        assert_eq!(world.overheard().len() - before, usize::from(passes));
    }
}

#[test]
fn recorded_requests_and_offers_cost_no_keys_that_work() {
    let mut world = World::new(9, Carrier::Datagrams);
    world.run(Duration::from_secs(2), ms(20));
    world.start(AIR);
    world.run(Duration::from_secs(12), ms(20));
    let clear: Vec<_> = all(&world)
        .into_iter()
        .filter(|bytes| bytes[1] == 2)
        .collect();
    let epoch = world.ends[GROUND].link.as_ref().unwrap().epoch();
    for _ in 0..20 {
        for at in [GROUND, AIR] {
            for bytes in &clear {
                world.arrive(at, bytes);
            }
        }
        world.run(Duration::from_secs(1), ms(20));
    }
    assert_eq!(world.ends[GROUND].link.as_ref().unwrap().epoch(), epoch);
    let lost = world.count(AIR, "lost") + world.count(GROUND, "lost");
    assert_eq!(lost, 0);
    assert_eq!(world.state(AIR), EncryptedState::Encrypted);
}

/// A packet of the other end under a counter that is ahead and needs no escape.
fn forgery(world: &World, at: usize) -> Vec<u8> {
    let mut forged = packets(world, 1 - at).pop().unwrap();
    forged[7] = 0x20;
    forged
}

#[test]
fn a_flood_of_forgeries_at_either_end_is_an_alarm_once_and_costs_no_keys() {
    for at in [GROUND, AIR] {
        let mut world = flown(10, Carrier::Datagrams);
        let epoch = world.ends[GROUND].link.as_ref().unwrap().epoch();
        let forged = forgery(&world, at);
        for _ in 0..70_000 {
            world.arrive(at, &forged);
        }
        let events: Vec<_> =
            core::iter::from_fn(|| world.ends[at].link.as_mut().unwrap().poll_event()).collect();
        let alarms = events
            .iter()
            .filter(|event| **event == EncryptedEvent::UnderAttack);
        assert_eq!(alarms.count(), 1);
        assert_eq!(world.count(at, "forged"), 70_000);
        world.recovery(ms(100));
        assert_eq!(world.ends[GROUND].link.as_ref().unwrap().epoch(), epoch);
    }
}

#[test]
fn an_end_that_has_retired_its_key_gets_another_while_the_other_end_is_received_without_a_pause() {
    for carrier in BOTH {
        for at in [AIR, GROUND] {
            let mut world = flown(12, carrier);
            for end in [at, 1 - at] {
                let epoch = world.ends[at].link.as_ref().unwrap().epoch();
                let link = world.ends[end].link.as_mut().unwrap();
                link.count_forgeries(u32::MAX);
                world.recovery(Duration::from_secs(3));
                for end in &world.ends {
                    assert!(end.link.as_ref().unwrap().epoch() > epoch);
                }
            }
            world.check_once();
        }
    }
}

#[test]
fn nothing_of_a_key_is_shown() {
    let world = flown(11, Carrier::Stream);
    for end in &world.ends {
        let shown = format!("{:?}", end.link);
        assert!(shown.contains("PacketKey"), "{shown}");
        // The one field of it that is not a number of the protocol is left out.
        assert!(
            !shown.contains("cipher") && !shown.contains("ghash"),
            "{shown}"
        );
    }
}

/// A packet under a key that nobody has.
fn garbage() -> Vec<u8> {
    [&[0x7e, 0][..], &[0x20; 96], &[0x7e]].concat()
}

#[test]
fn who_pretends_to_have_no_key_does_not_keep_a_slow_link_from_agreeing() {
    let mut world = World::new(13, Carrier::Datagrams);
    // An answer takes longer than after what an attempt counts as forgotten.
    world.radio.latency = ms(1_100);
    for n in 0..40 {
        let at = world.now + ms(500) * n;
        world.under_way.insert((at, u64::MAX), (GROUND, garbage()));
    }
    // Nothing is sent that would prove the keys before their exchange has ended.
    world.run(Duration::from_secs(20), Duration::from_secs(60));
    assert!(world.count(GROUND, "no_key") > 0);
    assert!(world.ends[GROUND].link.as_ref().unwrap().epoch().is_some());
}

#[test]
fn a_pairing_forgets_the_counter_of_the_peer_before_on_disk_too() {
    let mut world = flown(14, Carrier::Datagrams);
    let name = format!("encrypted-{:08x}", parties().vehicle_id);
    let record = |world: &World| world.ends[AIR].disk.records[&name].clone();
    assert!(!record(&world).starts_with(b"0 "));
    let (now, end) = (world.now, &mut world.ends[AIR]);
    let other = Identity::new([9; 32]).public();
    let link = end.link.as_mut().unwrap();
    link.set_peer(other, now, &mut end.disk);
    let text = String::from_utf8(record(&world)).unwrap();
    // The epoch stays: no nonce is used twice.
    let words: Vec<&str> = text.split_whitespace().collect();
    assert!(
        words.len() == 2 && words[0] == "0" && words[1] != "0",
        "{text}"
    );
}

/// An address of somebody else.
const ELSEWHERE: u8 = HONEST + 1;

/// Two ends of which one learns where the other is, after some seconds.
fn found(listening: usize) -> World {
    let mut world = World::new(77, Carrier::Datagrams);
    world.listening = Some(listening);
    world.start(listening);
    world.run(ms(8_000), ms(50));
    for end in &world.ends {
        assert_eq!(end.sender, Some(HONEST));
    }
    world
}

/// How long this end needs for its keys while forty addresses send it ten packets a millisecond.
fn agreed_beside(flood: &[Vec<u8>], world: &mut World, at: usize) -> Duration {
    let begin = world.now;
    while world.ends[at].link.as_ref().unwrap().epoch().is_none() {
        assert!(world.now - begin < Duration::from_secs(20), "no keys");
        for n in 0..50 {
            let from = ELSEWHERE + (n % 40) as u8;
            world.arrive_from(from, at, &flood[n % flood.len()]);
        }
        world.run(ms(5), ms(20));
    }
    world.now - begin
}

#[test]
fn junk_keeps_no_listening_end_from_agreeing_after_a_restart() {
    for listening in [GROUND, AIR] {
        let mut world = found(listening);
        world.start(listening);
        let took = agreed_beside(&[garbage()], &mut world, listening);
        assert!(took <= Duration::from_secs(1), "{listening}: {took:?}");
        world.recovery(Duration::from_secs(1));
        world.check_once();
    }
}

#[test]
fn neither_junk_nor_recorded_requests_keep_a_ground_that_knows_no_address_from_agreeing() {
    let mut world = found(GROUND);
    world.start(AIR);
    world.run(Duration::from_secs(5), ms(50));
    let recorded = world.tape.iter().filter(|(by, _)| *by == AIR);
    let mut flood: Vec<_> = recorded
        .map(|(_, bytes)| bytes.clone())
        .filter(|bytes| bytes[1] == 2)
        .collect();
    assert!(flood.len() >= 3, "requests and answers");
    flood.push(garbage());
    world.ends[GROUND].found = None;
    world.start(GROUND);
    world.start(AIR);
    let took = agreed_beside(&flood, &mut world, GROUND);
    assert!(took <= Duration::from_secs(1), "{took:?}");
    world.recovery(Duration::from_secs(1));
    world.check_once();
}

#[test]
fn who_only_had_his_address_forged_is_sent_less_than_three_times_as_much() {
    for listening in [GROUND, AIR] {
        let mut world = found(listening);
        let recorded = world.tape.iter().filter(|(by, _)| *by != listening);
        let mut forged: Vec<_> = recorded
            .map(|(_, bytes)| bytes.clone())
            .filter(|bytes| bytes[1] == 2)
            .collect();
        forged.push(garbage());
        // It knows of nobody, and the other end is gone.
        world.ends[1 - listening].link = None;
        world.ends[listening].found = None;
        world.start(listening);
        world.tape.clear();
        for (bytes, to) in forged.iter().zip(ELSEWHERE..) {
            world.arrive_from(to, listening, bytes);
        }
        world.run(Duration::from_secs(60), Duration::from_secs(1));
        let count = |all: &[Vec<u8>]| all.iter().map(Vec::len).sum::<usize>();
        let (sent, received) = (count(&all(&world)), count(&forged));
        assert!(
            sent > 0 && sent <= 3 * received,
            "{listening}: {sent} bytes for {received}"
        );
    }
}

#[test]
fn recorded_exchanges_from_elsewhere_do_not_move_an_end_that_works() {
    for listening in [GROUND, AIR] {
        let mut world = found(listening);
        let exchanges: Vec<_> = (world.tape.iter())
            .filter(|(_, bytes)| bytes[1] == 2)
            .cloned()
            .collect();
        assert!(exchanges.len() >= 3, "{}", exchanges.len());
        for round in 0..40 {
            for (from, bytes) in &exchanges {
                for _ in 0..100 {
                    world.arrive_from(ELSEWHERE, 1 - from, bytes);
                }
            }
            world.run(ms(100), ms(50));
            for end in &world.ends {
                assert_eq!(end.sender, Some(HONEST), "round {round}");
            }
        }
        world.recovery(ms(200));
    }
}

#[test]
fn a_copy_that_is_always_first_moves_no_end_and_is_reported() {
    let mut world = found(GROUND);
    world.copier = Some(ELSEWHERE);
    world.run(ms(20_000), ms(50));
    for at in [GROUND, AIR] {
        assert_eq!(world.ends[at].sender, Some(HONEST));
        let copied = world.count(at, "copied");
        assert!(copied >= 100, "{copied} at {at}");
        let link = world.ends[at].link.as_mut().unwrap();
        let events: Vec<_> = core::iter::from_fn(|| link.poll_event()).collect();
        assert!(events.contains(&EncryptedEvent::Copied), "{events:?}");
    }
}

#[test]
fn an_end_that_has_moved_is_followed_and_so_is_one_that_has_started_again_elsewhere() {
    for listening in [GROUND, AIR] {
        let mut world = found(listening);
        world.from[1 - listening] = ELSEWHERE;
        world.run(ms(3_500), ms(50));
        assert_eq!(world.ends[listening].sender, Some(ELSEWHERE));
        world.from[1 - listening] = HONEST;
        world.start(1 - listening);
        world.run(ms(15_000), ms(50));
        for end in &world.ends {
            assert_eq!(end.sender, Some(HONEST));
        }
    }
}

#[test]
fn a_link_whose_end_moves_beside_a_copier_carries_what_is_sent() {
    for listening in [GROUND, AIR] {
        let mut world = found(listening);
        world.copier = Some(ELSEWHERE);
        world.from[1 - listening] = ELSEWHERE + 1;
        world.run(ms(1_000), ms(50));
        let before = world.ends.each_ref().map(|end| end.got.len());
        world.run(ms(20_000), ms(50));
        for (end, before) in world.ends.iter().zip(before) {
            let got = end.got.len() - before;
            assert!(got >= 380, "{got} of 400");
        }
        world.check_once();
    }
}
