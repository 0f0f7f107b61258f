//! Deaths of nodes and the writes of a VSM, simulated: the same seed gives the same figures.

use std::collections::BTreeSet;

use super::costs::{CEILING_S, NODES_OF_VSM, SHORTEST_S, TAKE_OVERS, TRIALS};
use super::fleet::Fleet;
use crate::faults::Dice;

/// What one event has led to: for each VSM that it took a node from, until its last vehicle had a frame of the next one.
#[derive(Debug, Default)]
pub(super) struct Deaths {
    pub(super) taken_over: Vec<f64>,
    /// The slowest VSM of each trial.
    pub(super) last: Vec<f64>,
    /// How many VSMs the fullest node serves afterwards.
    pub(super) fullest: Vec<f64>,
    pub(super) without: u32,
}

/// Lets so many nodes die at once, in many trials. Where all die, all start again.
pub(super) fn deaths(fleet: &Fleet, dead: u32, dice: &mut Dice) -> Deaths {
    let mut all = Deaths::default();
    for _ in 0..TRIALS {
        let mut down = BTreeSet::new();
        while dead < fleet.nodes && down.len() < dead as usize {
            down.insert(below(dice, fleet.nodes));
        }
        let mut serves = vec![0_u32; fleet.nodes as usize];
        let mut orphans = Vec::new();
        for vsm in 0..fleet.vsms() {
            let owner = vsm % fleet.nodes;
            let mut nodes = vec![owner];
            while nodes.len() < NODES_OF_VSM as usize {
                let other = below(dice, fleet.nodes);
                if !nodes.contains(&other) {
                    nodes.push(other);
                }
            }
            if dead < fleet.nodes && !down.contains(&owner) {
                serves[owner as usize] += 1;
                continue;
            }
            nodes.retain(|node| !down.contains(node));
            orphans.push(nodes);
        }
        let lanes = u32::try_from(orphans.len()).unwrap_or(u32::MAX);
        let mut last = 0.0_f64;
        for nodes in orphans {
            if nodes.is_empty() {
                all.without += 1;
                continue;
            }
            // Whoever looks first after the lease has ended takes it.
            let next = nodes[dice.below(nodes.len())];
            serves[next as usize] += 1;
            let took = take_over_s(dice) + fleet.restore_s(lanes);
            last = last.max(took);
            all.taken_over.push(took);
        }
        all.last.push(last);
        all.fullest
            .push(serves.into_iter().max().unwrap_or(0).into());
    }
    all
}

/// A take-over of a VSM of few vehicles: its kind by how often each was measured, and its time on the lines from the shortest to the
/// median of that kind and on to the longest.
fn take_over_s(dice: &mut Dice) -> f64 {
    let mut drawn = dice.below(TAKE_OVERS.iter().map(|(times, ..)| times).sum());
    for (times, median, longest) in TAKE_OVERS {
        if drawn < times {
            let known = [(0.0, SHORTEST_S), (0.5, median), (1.0, longest)];
            return quantile_of(&known, unit(dice));
        }
        drawn -= times;
    }
    f64::INFINITY
}

/// A minute of one VSM's ceilings behind a take-over, when all are due at once: writes a second, and the longest wait, s.
/// One thread stores them one after the other (`clock-writer`), in the order in which they became due.
pub(super) fn ceilings(vehicles: u32, write_s: f64) -> (f64, f64) {
    let micros = |seconds: f64| (seconds * 1e6).round() as u64;
    let (write, again, minute) = (micros(write_s), micros(CEILING_S), micros(60.0));
    let mut due: BTreeSet<(u64, u32)> = (0..vehicles).map(|vehicle| (0, vehicle)).collect();
    let (mut now, mut writes, mut longest) = (0, 0_u32, 0);
    while let Some((at, vehicle)) = due.pop_first() {
        now = at.max(now) + write;
        if now > minute {
            break;
        }
        writes += 1;
        longest = longest.max(now - at);
        due.insert((now.max(at + again), vehicle));
    }
    (f64::from(writes) / 60.0, longest as f64 / 1e6)
}

/// A value of a distribution that is known at some parts of one.
fn quantile_of(known: &[(f64, f64)], part: f64) -> f64 {
    let mut pairs = known.iter().zip(&known[1..]);
    let pair = pairs.find(|(_, (end, _))| part <= *end);
    pair.map_or(f64::INFINITY, |((a, low), (b, high))| {
        low + (high - low) * (part - a) / (b - a)
    })
}

/// As `cargo xtask faults` has it: rounded up, the 99th of a few is the longest.
pub(super) fn at(values: &[f64], part: f64) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().saturating_sub(1) as f64;
    sorted
        .get((last * part).ceil() as usize)
        .copied()
        .unwrap_or(0.0)
}

fn below(dice: &mut Dice, end: u32) -> u32 {
    u32::try_from(dice.below(end as usize)).unwrap_or(0)
}

fn unit(dice: &mut Dice) -> f64 {
    dice.below(1 << 30) as f64 / f64::from(1 << 30)
}

#[cfg(test)]
mod tests {
    use super::super::costs::LONGEST_S;
    use super::super::fleet::FLEET;
    use super::*;

    #[test]
    fn a_seed_gives_the_same_take_overs_with_the_measured_quantiles() {
        let drawn = |seed| deaths(&FLEET, 1, &mut Dice::new(seed));
        let (once, again) = (drawn(7), drawn(7));
        assert_eq!(once.taken_over, again.taken_over);
        assert_ne!(once.taken_over, drawn(8).taken_over);
        // One of twenty nodes owns five of the hundred VSMs.
        assert_eq!(once.taken_over.len(), 5 * TRIALS as usize);
        let restored = FLEET.restore_s(5);
        let [median, longest] = [0.5, 1.0].map(|part| at(&once.taken_over, part) - restored);
        // Between the medians of the kinds, and close to the longest of all.
        assert!((2.74..3.03).contains(&median), "{median} s");
        assert!((5.6..=LONGEST_S + 1e-9).contains(&longest), "{longest} s");
    }

    #[test]
    fn a_vsm_has_no_node_left_only_where_all_of_its_nodes_are_dead() {
        let dice = &mut Dice::new(1);
        assert_eq!(deaths(&FLEET, 2, dice).without, 0);
        assert!(deaths(&FLEET, 18, dice).without > 0);
        let restart = deaths(&FLEET, FLEET.nodes, dice);
        assert_eq!(restart.without, 0);
        assert_eq!(restart.taken_over.len(), 100 * TRIALS as usize);
    }

    #[test]
    fn a_dead_node_serves_nothing_and_the_others_serve_all() {
        let dice = &mut Dice::new(1);
        let fullest = deaths(&FLEET, 1, dice).fullest;
        assert!(fullest.iter().all(|vsms| (6.0..=10.0).contains(vsms)));
        let three = Fleet { nodes: 3, ..FLEET };
        let fullest = deaths(&three, 2, dice).fullest;
        assert!(fullest.iter().all(|vsms| *vsms == 100.0));
    }

    #[test]
    fn ceilings_are_stored_every_six_seconds_until_the_thread_is_busy() {
        // The writes at 0, 6, ... 54 s, and none of the one at 60 s.
        assert_eq!(ceilings(100, 0.002), (100.0 * 10.0 / 60.0, 0.2));
        let (writes_s, longest_s) = ceilings(10_000, 0.002);
        assert!((writes_s - 500.0).abs() < 1.0, "{writes_s}");
        assert!(longest_s > 13.0, "{longest_s}");
    }

    #[test]
    fn a_distribution_is_read_between_what_is_known_of_it() {
        let known = [(0.0, 2.0), (0.5, 3.0), (1.0, 7.0)];
        let read = [0.0, 0.25, 0.5, 0.75, 1.0].map(|part| quantile_of(&known, part));
        assert_eq!(read, [2.0, 2.5, 3.0, 5.0, 7.0]);
        assert_eq!(at(&[3.0, 1.0, 2.0], 0.5), 2.0);
        assert_eq!(at(&[], 0.5), 0.0);
    }
}
