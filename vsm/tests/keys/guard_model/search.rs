//! The model: a guard, a VSM with one access list, and an attacker who owns the network, searched through every reachable state.
//!
//! A stamp is a small number, and a seal is perfect: a datagram is what its sender has put together, and only who has its key can.

use std::collections::{BTreeSet, HashMap, VecDeque};

use super::{Flaw, Scope};

/// A key: the numbers of guard keys, in the order in which they were made, or of the group's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Key {
    Guard(u8),
    Group(u8),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) enum Way {
    ToVsm,
    FromVsm,
    ToGroup,
}

/// A datagram on the network.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub(super) struct Datagram {
    /// None: without a trailer.
    pub(super) key: Option<Key>,
    pub(super) way: Way,
    pub(super) stamp: u8,
    /// Its sender is who it says.
    pub(super) honest: bool,
}

/// What an end remembers of the stamps of one key: on its disk, and since its start.
#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
struct Stamps {
    /// On the disk: above everything that was sent or taken.
    ceiling: u8,
    /// At the start: at and below it nothing is taken.
    floor: u8,
    seen: BTreeSet<u8>,
    /// The last that was sent.
    clock: u8,
}

impl Stamps {
    /// What a start finds.
    fn started(&self, flaw: Option<Flaw>) -> Stamps {
        let floor = match flaw {
            Some(Flaw::ForgetsAtRestart) => 0,
            _ => self.ceiling,
        };
        Stamps {
            ceiling: self.ceiling,
            floor,
            seen: BTreeSet::new(),
            clock: floor,
        }
    }

    fn takes(&self, stamp: u8, flaw: Option<Flaw>) -> bool {
        stamp > self.floor && (flaw == Some(Flaw::NoWindow) || !self.seen.contains(&stamp))
    }

    fn take(&mut self, stamp: u8, flaw: Option<Flaw>) {
        self.seen.insert(stamp);
        self.clock = self.clock.max(stamp);
        if flaw != Some(Flaw::CeilingLate) {
            self.ceiling = self.ceiling.max(stamp);
        }
    }

    fn send(&mut self) -> u8 {
        self.clock = self.clock.max(self.floor) + 1;
        self.ceiling = self.ceiling.max(self.clock);
        self.clock
    }
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(super) struct State {
    /// The keys that the VSM takes, the one in force first.
    vsm_keys: Vec<u8>,
    cucs_key: u8,
    made: u8,
    revoked: BTreeSet<u8>,
    vsm: Vec<Stamps>,
    cucs: Vec<Stamps>,
    group: u8,
    /// The group key that the guard was given, up to which stamp it takes nothing, and what it has taken.
    given: Option<(u8, u8)>,
    group_clock: u8,
    group_seen: BTreeSet<u8>,
    /// Group keys that who was locked out has; the guard has been given another since.
    lost_groups: BTreeSet<u8>,
    offered_since: bool,
    /// The list in force, the one on the disk, the newest that ever was in force, and the newest that was signed.
    list: u8,
    stored: u8,
    highest: u8,
    signed: u8,
    network: BTreeSet<Datagram>,
    leaked: BTreeSet<Key>,
    /// Everything that the VSM has taken in the CUCS's name, and the guard in the VSM's.
    taken: BTreeSet<Datagram>,
    /// The first promise that does not hold.
    broken: Option<&'static str>,
    steps: u8,
}

/// What may happen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    CucsSends,
    VsmSends,
    VsmSendsToGroup,
    Offers,
    ToVsm(Datagram),
    ToCucs(Datagram),
    VsmRestarts,
    CucsRestarts,
    Rotates,
    CucsHasNewKey,
    DayIsOver,
    Revokes,
    Leaks(Key),
    /// The attacker puts one together.
    Forges(Datagram),
    Signs,
    /// The VSM is given the list of this version again.
    Reads(u8),
}

impl State {
    fn first() -> State {
        State {
            vsm_keys: vec![0],
            cucs_key: 0,
            made: 1,
            revoked: BTreeSet::new(),
            vsm: vec![Stamps::default(); 4],
            cucs: vec![Stamps::default(); 4],
            group: 0,
            given: None,
            group_clock: 0,
            group_seen: BTreeSet::new(),
            lost_groups: BTreeSet::new(),
            offered_since: false,
            list: 1,
            stored: 1,
            highest: 1,
            signed: 1,
            network: BTreeSet::new(),
            leaked: BTreeSet::new(),
            taken: BTreeSet::new(),
            broken: None,
            steps: 0,
        }
    }

    fn steps(&self, scope: &Scope) -> Vec<Step> {
        let sent = |way: Way| {
            self.network
                .iter()
                .filter(|one| one.honest && one.way == way)
                .count()
        };
        let mut all = Vec::new();
        if sent(Way::ToVsm) < scope.sends {
            all.push(Step::CucsSends);
        }
        if sent(Way::FromVsm) < scope.sends {
            all.push(Step::VsmSends);
        }
        if scope.group && sent(Way::ToGroup) < scope.sends {
            all.push(Step::VsmSendsToGroup);
        }
        if scope.group && self.given != Some((self.group, self.group_clock)) {
            all.push(Step::Offers);
        }
        // Each of them, to either end: the attacker repeats, reorders and reflects as he likes.
        for one in &self.network {
            all.push(Step::ToVsm(*one));
            all.push(Step::ToCucs(*one));
        }
        all.push(Step::CucsRestarts);
        // Each of these makes another group key.
        if self.group < MAX_GROUP {
            all.push(Step::VsmRestarts);
        }
        if self.made < scope.keys {
            all.push(Step::Rotates);
            if self.group < MAX_GROUP {
                all.push(Step::Revokes);
            }
        }
        if self.cucs_key != self.vsm_keys[0] {
            all.push(Step::CucsHasNewKey);
        }
        if self.vsm_keys.len() > 1 {
            all.push(Step::DayIsOver);
        }
        if self.leaked.len() < scope.leaks {
            let groups = (0..=self.group).filter(|_| scope.group).map(Key::Group);
            all.extend(
                (0..self.made)
                    .map(Key::Guard)
                    .chain(groups)
                    .map(Step::Leaks),
            );
        }
        let keys = self.leaked.iter().map(|key| Some(*key)).chain([None]);
        for key in keys {
            for way in [Way::ToVsm, Way::FromVsm, Way::ToGroup] {
                let stamp = 6;
                all.push(Step::Forges(Datagram {
                    key,
                    way,
                    stamp,
                    honest: false,
                }));
            }
        }
        if scope.lists {
            if self.signed < 3 {
                all.push(Step::Signs);
            }
            all.extend((1..=self.signed).map(Step::Reads));
        }
        all
    }

    fn after(&self, step: Step, flaw: Option<Flaw>) -> State {
        let mut next = self.clone();
        next.steps += 1;
        match step {
            Step::CucsSends => {
                let key = next.cucs_key;
                let stamp = next.cucs[usize::from(key)].send();
                next.put(Key::Guard(key), Way::ToVsm, stamp);
            }
            Step::VsmSends => {
                // Under the key that its CUCS uses.
                let used = next.vsm_keys.iter().find(|key| **key == next.cucs_key);
                let key = used.copied().unwrap_or(next.vsm_keys[0]);
                let stamp = next.vsm[usize::from(key)].send();
                next.put(Key::Guard(key), Way::FromVsm, stamp);
            }
            Step::VsmSendsToGroup => {
                next.group_clock += 1;
                next.put(Key::Group(next.group), Way::ToGroup, next.group_clock);
            }
            // Sealed for this guard alone, and new: the trailer of it is as of any other datagram.
            Step::Offers => {
                let floor = match flaw {
                    Some(Flaw::OfferWithoutFloor) => 0,
                    _ => next.group_clock,
                };
                if next.given.is_none_or(|(known, _)| known != next.group) {
                    next.group_seen.clear();
                    next.given = Some((next.group, floor));
                }
                next.offered_since = true;
            }
            Step::ToVsm(one) => next.vsm_takes(one, flaw),
            Step::ToCucs(one) => next.cucs_takes(one, flaw),
            Step::VsmRestarts => {
                next.vsm = next.vsm.iter().map(|one| one.started(flaw)).collect();
                // Its group has another key with each start.
                next.group += 1;
                next.list = next.stored;
            }
            Step::CucsRestarts => {
                next.cucs = next.cucs.iter().map(|one| one.started(flaw)).collect();
                next.given = None;
                next.group_seen.clear();
            }
            Step::Rotates => {
                next.vsm_keys = vec![next.made, next.vsm_keys[0]];
                next.made += 1;
            }
            Step::Revokes => {
                next.revoked.extend(next.vsm_keys.iter());
                if flaw == Some(Flaw::RevokedIsPrevious) {
                    next.vsm_keys = vec![next.made, next.vsm_keys[0]];
                } else {
                    next.vsm_keys = vec![next.made];
                }
                next.made += 1;
                if next.leaked.contains(&Key::Group(next.group)) {
                    next.lost_groups.insert(next.group);
                }
                next.offered_since = false;
                if flaw != Some(Flaw::GroupKeyStays) {
                    next.group += 1;
                }
            }
            Step::CucsHasNewKey => next.cucs_key = next.vsm_keys[0],
            Step::DayIsOver => next.vsm_keys.truncate(1),
            Step::Leaks(key) => {
                next.leaked.insert(key);
            }
            Step::Forges(one) => {
                next.network.insert(one);
            }
            Step::Signs => next.signed += 1,
            Step::Reads(version) => {
                if version >= next.list || flaw == Some(Flaw::OlderList) {
                    next.list = version;
                    if flaw != Some(Flaw::ListNotStored) {
                        next.stored = next.stored.max(version);
                    }
                    next.highest = next.highest.max(version);
                }
            }
        }
        if next.list < next.highest {
            next.broken = Some(super::LIST);
        }
        next
    }

    fn put(&mut self, key: Key, way: Way, stamp: u8) {
        let key = Some(key);
        self.network.insert(Datagram {
            key,
            way,
            stamp,
            honest: true,
        });
    }

    fn vsm_takes(&mut self, one: Datagram, flaw: Option<Flaw>) {
        let way = one.way == Way::ToVsm || flaw == Some(Flaw::NoDirection);
        let key = match one.key {
            None if flaw == Some(Flaw::TakesUnguarded) => self.vsm_keys[0],
            Some(Key::Guard(key)) if way && self.vsm_keys.contains(&key) => key,
            // The same bytes of trailer, and the key that a member of the group has.
            Some(Key::Group(group))
                if flaw == Some(Flaw::CommandsByGroup) && group == self.group =>
            {
                self.vsm_keys[0]
            }
            _ => return,
        };
        let stamps = &mut self.vsm[usize::from(key)];
        if one.key.is_some() && !stamps.takes(one.stamp, flaw) {
            return;
        }
        stamps.take(one.stamp, flaw);
        if one.key.is_none() {
            return self.broken = Some(super::GUARDED);
        }
        if matches!(one.key, Some(Key::Group(_))) {
            return self.broken = Some(super::GROUP);
        }
        if self.revoked.contains(&key) {
            return self.broken = Some(super::REVOKED);
        }
        let known = self.leaked.contains(&Key::Guard(key));
        if !one.honest && !known || one.way != Way::ToVsm {
            return self.broken = Some(super::GENUINE);
        }
        if !self.taken.insert(one) {
            self.broken = Some(super::ONCE);
        }
    }

    fn cucs_takes(&mut self, one: Datagram, flaw: Option<Flaw>) {
        match one.key {
            Some(Key::Guard(key)) if key == self.cucs_key => {
                if one.way != Way::FromVsm && flaw != Some(Flaw::NoDirection) {
                    return;
                }
                let stamps = &mut self.cucs[usize::from(key)];
                if !stamps.takes(one.stamp, flaw) {
                    return;
                }
                stamps.take(one.stamp, flaw);
                let known = self.leaked.contains(&Key::Guard(key));
                if one.way != Way::FromVsm || !one.honest && !known {
                    return self.broken = Some(super::GENUINE);
                }
            }
            Some(Key::Group(key)) if one.way == Way::ToGroup => {
                let Some((given, floor)) = self.given else {
                    return;
                };
                if key != given || one.stamp <= floor || !self.group_seen.insert(one.stamp) {
                    return;
                }
                if self.lost_groups.contains(&key) && self.offered_since && !one.honest {
                    return self.broken = Some(super::REVOKED);
                }
                if !one.honest && !self.leaked.contains(&Key::Group(key)) {
                    return self.broken = Some(super::GENUINE);
                }
            }
            _ => return,
        }
        if !self.taken.insert(one) {
            self.broken = Some(super::ONCE);
        }
    }
}

/// What a search has found.
pub(super) struct Explored {
    pub(super) states: usize,
    pub(super) taken: usize,
    /// The promise that does not hold, and how that comes about.
    pub(super) broken: Option<(&'static str, Vec<Step>)>,
}

/// Every state within the bounds of a scope.
pub(super) fn explore(scope: &Scope) -> Explored {
    let first = State::first();
    let mut known: HashMap<State, u32> = HashMap::new();
    // Of each state: the one before, and the step that led to it.
    let mut ways: Vec<(u32, Option<Step>)> = vec![(0, None)];
    let mut due = VecDeque::from([(first.clone(), 0_u32)]);
    known.insert(unstepped(&first), 0);
    let mut taken = 0;
    while let Some((state, number)) = due.pop_front() {
        taken = taken.max(state.taken.len());
        if let Some(promise) = state.broken {
            return Explored {
                states: known.len(),
                taken,
                broken: Some((promise, trace(&ways, number))),
            };
        }
        if state.steps == scope.depth {
            continue;
        }
        for step in state.steps(scope) {
            let next = state.after(step, scope.flaw);
            let name = unstepped(&next);
            if known.contains_key(&name) {
                continue;
            }
            let place = u32::try_from(ways.len()).expect("fewer states");
            known.insert(name, place);
            ways.push((number, Some(step)));
            due.push_back((next, place));
        }
    }
    Explored {
        states: known.len(),
        taken,
        broken: None,
    }
}

/// Reached earlier it may go further: the first time counts, and the search goes by breadth.
fn unstepped(state: &State) -> State {
    State {
        steps: 0,
        ..state.clone()
    }
}

fn trace(ways: &[(u32, Option<Step>)], mut number: u32) -> Vec<Step> {
    let mut steps = Vec::new();
    while let (before, Some(step)) = ways[number as usize] {
        steps.push(step);
        number = before;
    }
    steps.reverse();
    steps
}

const MAX_GROUP: u8 = 2;
