//! No nonce twice under one key, over restarts, power cuts at any write, stores that were put back and random sources that
//! repeat themselves.
//!
//! How it is seen: each packet holds the same plaintext. Under one key and nonce its ciphertext would be the same, so that
//! any two equal packets on the tape were sealed alike.

use core::time::Duration;
use std::collections::BTreeMap;

use mavlink_link::encrypted::{Carrier, EncryptedRecord, MAX_WIRE};
use mavlink_link::store::{Record as _, Store as _};
use proptest::prelude::*;

use super::{AIR, GROUND, World, numbered};
use crate::world::{HONEST, ms};

/// Sends frame 0 from both ends, each in a packet of its own, for a while.
fn run(world: &mut World, span: Duration, packets: &mut BTreeMap<Vec<u8>, usize>) {
    let end = world.now + span;
    while world.now < end {
        world.run(ms(20), Duration::from_secs(3_600));
        let now = world.now;
        for at in [GROUND, AIR] {
            let one = &mut world.ends[at];
            let Some(link) = &mut one.link else { continue };
            link.send(now, HONEST, &numbered(0));
            let mut out = [0; MAX_WIRE];
            let mut sent = Vec::new();
            while let Some((_, len)) = link.poll_transmit(now + ms(5), &mut one.disk, &mut out) {
                let bytes = out[..len].to_vec();
                if bytes[1] == 0 {
                    // From the id on: the same station, the same counter, the same ciphertext.
                    *packets.entry(bytes.clone()).or_default() += 1;
                }
                sent.push(bytes);
            }
            for bytes in sent {
                world.post(ms(20), 1 - at, bytes);
            }
        }
        // Their numbers are all 0, which is no sign of anything here.
        world.ends.iter_mut().for_each(|end| end.got.clear());
    }
}

#[derive(Debug, Clone)]
enum Fault {
    /// The process ends after this many 20 ms, and what is not durable is lost.
    Restart(usize),
    /// The same, and this end's disk is what it was at the start of the test, its random numbers too.
    PutBack(usize),
    /// The store is full for a while.
    Full(usize),
    Wait,
}

fn faults() -> impl Strategy<Value = Vec<(Fault, u64)>> {
    let fault = prop_oneof![
        (0..2_usize).prop_map(Fault::Restart),
        (0..2_usize).prop_map(Fault::PutBack),
        (0..2_usize).prop_map(Fault::Full),
        Just(Fault::Wait),
    ];
    proptest::collection::vec((fault, 1..30_u64), 1..8)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_two_packets_are_sealed_alike(seed: u64, faults in faults()) {
        let mut world = World::new(seed, Carrier::Datagrams);
        world.ends.iter_mut().for_each(|end| end.disk.queues = true);
        let mut packets = BTreeMap::new();
        let begun = world.ends.each_ref().map(|end| (end.disk.clone(), end.dice.clone()));
        let mut copies = begun.clone();
        run(&mut world, ms(300), &mut packets);
        let mut epochs = [0, 0];
        for (fault, steps) in faults {
            match fault {
                Fault::Restart(at) => world.start(at),
                Fault::PutBack(at) => {
                    // Never both: what it would take to have a nonce again.
                    let other = 1 - at;
                    let (disk, dice) = core::mem::replace(&mut copies[at], begun[at].clone());
                    (world.ends[at].disk, world.ends[at].dice) = (disk, dice);
                    epochs[at] = 0;
                    copies[other] = (world.ends[other].disk.clone(), world.ends[other].dice.clone());
                    world.start(at);
                }
                Fault::Full(at) => world.ends[at].disk.full = Some(""),
                Fault::Wait => {}
            }
            run(&mut world, ms(steps * 20), &mut packets);
            for (at, end) in world.ends.iter_mut().enumerate() {
                end.disk.full = None;
                // On the disk before it is used.
                let epoch = end.link.as_ref().and_then(|link| link.epoch()).unwrap_or(0);
                let stored = end.disk.records.get(&EncryptedRecord::name(&0x1b00_0101));
                let stored = stored.map_or(0, |bytes| EncryptedRecord::decode(bytes).unwrap().epoch);
                prop_assert!(epoch <= stored, "{epoch} in use, {stored} stored");
                prop_assert!(stored >= epochs[at], "an epoch falls only where a disk is put back");
                epochs[at] = stored;
            }
        }
        prop_assert!(packets.values().all(|&times| times == 1), "a nonce twice");
    }
}

#[test]
fn a_power_cut_at_any_write_of_either_end_costs_no_epoch_twice() {
    for at in [GROUND, AIR] {
        for writes in 0..6 {
            let mut world = World::new(writes, Carrier::Stream);
            let mut packets = BTreeMap::new();
            world.ends[at].disk.queues = true;
            run(&mut world, ms(200), &mut packets);
            for _ in 0..3 {
                // Killed once so many writes are durable since its start.
                world.start(at);
                let from = world.ends[at].disk.durable;
                for _ in 0..200 {
                    run(&mut world, ms(20), &mut packets);
                    if world.ends[at].disk.durable >= from + writes {
                        break;
                    }
                }
            }
            run(&mut world, Duration::from_secs(4), &mut packets);
            assert!(packets.values().all(|&times| times == 1));
            let epochs = world
                .ends
                .each_ref()
                .map(|end| end.link.as_ref().unwrap().epoch());
            assert!(epochs[0].is_some() && epochs[0] == epochs[1], "{epochs:?}");
        }
    }
}

#[test]
fn a_record_that_cannot_be_read_is_no_missing_one() {
    let mut world = World::new(1, Carrier::Stream);
    let end = &mut world.ends[GROUND];
    let name = EncryptedRecord::name(&0x1b00_0101);
    end.disk.records.insert(name, b"1 x\n".to_vec());
    let fault = end.disk.load::<EncryptedRecord>(&0x1b00_0101).unwrap_err();
    assert!(
        fault
            .to_string()
            .contains("expected a counter and an epoch"),
        "{fault}"
    );
}
