//! Every history of one fault, and of two, ends by itself with one key at both ends.

use mavlink_link::provisioning::{Outcome, State};
use mavlink_link::signing::SigningKey;

use super::world::World;
use crate::support::{key, other_key};

/// One thing that goes wrong.
#[derive(Debug, Clone, Copy)]
enum Fault {
    Lost(usize),
    /// The vehicle restarts at this tick, with the file that it has.
    VehicleRestarts(u64),
    /// Its power is cut at this tick: the file is empty.
    VehicleEmptied(u64),
    /// Its power is cut at this tick, and the old file is back.
    VehicleForgets(u64),
    /// We are killed at this tick.
    Killed(u64),
    /// Nothing passes either way for ten seconds from this tick.
    Cut(u64),
    /// Our disk is full for five seconds from this tick.
    Full(u64),
}

/// Runs one rollover with these faults, then a clean line, and requires that both ends agree by themselves.
fn must_come_back(current: Option<&SigningKey>, faults: &[Fault]) {
    let mut world = World::new(current.map(SigningKey::duplicate));
    world.lost = faults
        .iter()
        .filter_map(|fault| match fault {
            Fault::Lost(n) => Some(*n),
            _ => None,
        })
        .collect();
    let old_file = world
        .px4
        .file
        .as_ref()
        .map(|(key, stamp)| (key.duplicate(), *stamp));
    let mut cut_until = 0;
    let mut full_until = 0;
    for tick in 1..=2_000 {
        for fault in faults {
            match *fault {
                Fault::VehicleRestarts(when) if when == tick => world.px4.reboot(),
                Fault::VehicleEmptied(when) if when == tick => {
                    // Only a file that is being written can be lost.
                    if world.secrets > 0 && world.px4.has(&other_key()) {
                        world.px4.file = None;
                    }
                    world.px4.reboot();
                }
                Fault::VehicleForgets(when) if when == tick => {
                    world.px4.file = old_file.as_ref().map(|(key, s)| (key.duplicate(), *s));
                    world.px4.reboot();
                }
                Fault::Killed(when) if when == tick => world.kill(),
                Fault::Cut(when) if when == tick => cut_until = tick + 100,
                Fault::Full(when) if when == tick => full_until = tick + 50,
                _ => {}
            }
        }
        world.disk.full = (tick < full_until).then_some("");
        if tick < cut_until {
            world.lost.extend(world.datagrams + 1..world.datagrams + 20);
        }
        world.step();
        if tick > 400 && world.ours.outcome().is_some() && tick % 100 == 0 {
            break;
        }
    }
    let both = match world.ours.outcome() {
        Some(Outcome::Committed) => world.px4.has(&other_key()),
        Some(Outcome::RolledBack) => world.px4.has(&key()),
        _ => false,
    };
    assert!(
        both,
        "{faults:?}: {:?} {:?}",
        world.ours.outcome(),
        world.history
    );
    let current = world.keys.current.as_ref().expect("a key in force");
    assert!(world.px4.has(current), "{faults:?}");
}

/// The datagrams and ticks at which anything can matter, from the end of the watch on.
fn window(current: Option<&SigningKey>) -> (std::ops::Range<usize>, std::ops::Range<u64>) {
    let mut world = World::new(current.map(SigningKey::duplicate));
    while world.ours.state() == State::Staged && world.secrets == 0 {
        world.step();
    }
    let (datagrams, tick) = (world.datagrams, world.tick);
    world.settle(30);
    (
        datagrams.saturating_sub(4)..world.datagrams + 12,
        tick.saturating_sub(2)..world.tick + 40,
    )
}

fn single_faults(current: Option<&SigningKey>) -> Vec<Fault> {
    let (datagrams, ticks) = window(current);
    let mut faults: Vec<_> = datagrams.map(Fault::Lost).collect();
    for tick in ticks {
        faults.extend([
            Fault::VehicleRestarts(tick),
            Fault::VehicleEmptied(tick),
            Fault::VehicleForgets(tick),
            Fault::Killed(tick),
            Fault::Cut(tick),
            Fault::Full(tick),
        ]);
    }
    faults
}

#[test]
fn no_single_fault_leaves_a_link_that_needs_a_person() {
    for current in [None, Some(key())] {
        for fault in single_faults(current.as_ref()) {
            must_come_back(current.as_ref(), &[fault]);
        }
    }
}

/// Pairs of faults, from no key or from another one: each with `VSM_ALL_CASES`, else every seventh.
fn no_pair_of_faults(current: Option<&SigningKey>) {
    let faults = single_faults(current);
    let mut pairs = 0;
    for (n, first) in faults.iter().enumerate() {
        for second in &faults[n + 1..] {
            if pairs % kit::every(7) == 0 {
                must_come_back(current, &[*first, *second]);
            }
            pairs += 1;
        }
    }
    assert!(pairs > 30_000, "only {pairs} pairs");
}

#[test]
fn no_pair_of_faults_with_a_first_key_leaves_a_link_that_needs_a_person() {
    no_pair_of_faults(None);
}

#[test]
fn no_pair_of_faults_with_another_key_leaves_a_link_that_needs_a_person() {
    no_pair_of_faults(Some(&key()));
}
