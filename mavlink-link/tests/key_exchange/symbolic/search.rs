//! Everything that can happen, in every order: the network belongs to the attacker, processes die, people act.

use std::collections::{BTreeSet, HashSet, VecDeque};
use std::hash::{BuildHasher as _, BuildHasherDefault, DefaultHasher};

use super::ends::{ACTIVE, Phase, ROLLED_BACK, SENT, State, Window};
use super::messages::{Content, Facts, Handshake, Suite, gate};
use super::terms::{Knowledge, Name, secret};
use super::{Flaw, IN_FORCE, SECRET};

/// What is searched: where it begins, and how often each thing happens at most.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Scope {
    /// Whether the ends begin paired with each other, unpaired, or the agent with a ground computer that was stolen.
    pub(crate) peer: Option<Name>,
    pub(crate) sessions: u8,
    pub(crate) answers: u8,
    pub(crate) restarts: u8,
    pub(crate) windows: u8,
    /// The autopilot falls back to the key before.
    pub(crate) falls: u8,
    /// What may be stolen, at any moment, and how many of these.
    pub(crate) leaks: &'static [Name],
    pub(crate) most_leaks: usize,
    /// The attacker has the gate's key between pinned ends.
    pub(crate) open_gate: bool,
    pub(crate) flaw: Option<Flaw>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Action {
    Begin,
    Deliver(Content),
    /// The agent sends the staged key to the autopilot, which takes it, or does not; the agent and the ground see it.
    Install,
    Take,
    SeenInAir,
    RolledBack,
    SeenOnGround,
    FallBack,
    InstallAgain,
    RestartGround,
    RestartAir,
    /// A person opens the pairing window.
    OpenWindow,
    Leak(Name),
}

impl Scope {
    pub(crate) fn start(&self) -> State {
        let mut state = State::default();
        let first = (self.peer.is_some()).then(|| secret(Name::FirstKey));
        (state.ground.current, state.air.current, state.autopilot) = (first, first, first);
        state.air.peer = self.peer.map(|peer| (peer, 0));
        state.ground.peer = self
            .peer
            .filter(|peer| *peer == Name::Ground)
            .map(|_| Name::Air);
        if self.peer == Some(Name::Stolen) {
            state.leaked.insert(Name::Stolen);
            state.leaked_keys.extend(first);
        }
        state
    }

    fn knowledge(&self, state: &State) -> Knowledge {
        let mut received: BTreeSet<_> = state.leaked_keys.clone();
        received.extend(
            state
                .tape
                .iter()
                .flat_map(|message| message.parts.iter().copied()),
        );
        if self.open_gate {
            received.insert(gate(Some([Name::Ground, Name::Air])));
        }
        if self.flaw == Some(Flaw::NoGate) || self.flaw == Some(Flaw::NoCode) {
            received.insert(gate(None));
        }
        Knowledge {
            received,
            names: state.leaked.clone(),
        }
    }

    fn actions(&self, state: &State, knowledge: &Knowledge) -> Vec<Action> {
        let mut actions = Vec::new();
        if state.sessions < self.sessions {
            actions.push(Action::Begin);
        }
        let mut words: BTreeSet<Content> =
            state.tape.iter().map(|message| message.content).collect();
        words.extend(self.words_of_eve(state, knowledge));
        words.retain(|content| state.expects(content));
        if state.answers >= self.answers {
            words.retain(|content| content.step != 1);
        }
        actions.extend(words.into_iter().map(Action::Deliver));
        actions.extend([
            Action::Install,
            Action::Take,
            Action::SeenInAir,
            Action::RolledBack,
        ]);
        actions.extend([Action::SeenOnGround, Action::FallBack, Action::InstallAgain]);
        if state.restarts < self.restarts {
            actions.extend([Action::RestartGround, Action::RestartAir]);
        }
        if state.windows < self.windows {
            actions.push(Action::OpenWindow);
        }
        let stolen = self
            .leaks
            .iter()
            .filter(|name| state.leaked.contains(name))
            .count();
        if stolen < self.most_leaks {
            actions.extend(self.leaks.iter().map(|name| Action::Leak(*name)));
        }
        actions
    }

    /// What the attacker could send of his own to an end that would read it, where he passes its gate.
    fn words_of_eve(&self, state: &State, knowledge: &Knowledge) -> Vec<Content> {
        let (ground, air) = (&state.ground, &state.air);
        let passes = |suite: Suite, peer: Option<Name>, own| {
            let pinned = peer
                .filter(|_| suite == Suite::Pinned)
                .map(|peer| [own, peer]);
            knowledge.makes(gate(pinned))
        };
        let of = |open: &Handshake| passes(open.suite, open.theirs[0], open.own[0]);
        let mut words = Vec::new();
        let mut add = |step, session, ephemerals: &[Name], identities: &[Name], outcomes: &[_]| {
            let counter = if step == 2 { 0 } else { EVES_COUNTER };
            let facts = Facts {
                counter,
                epoch: 0,
                current: None,
            };
            for &ephemeral in ephemerals {
                for &identity in identities {
                    words.extend(outcomes.iter().map(|&outcome| Content {
                        step,
                        session,
                        ephemeral,
                        identity,
                        facts,
                        outcome,
                    }));
                }
            }
        };
        let none = [[0, 0]];
        match &ground.phase {
            Phase::Asking(asking) if of(asking) => {
                let reflected = [Name::EveOnce, asking.own[1]];
                add(
                    2,
                    asking.session,
                    &reflected,
                    &[Name::Eve, Name::Air, Name::Ground],
                    &none,
                );
            }
            Phase::Confirming(open, _) if of(open) => {
                let ephemeral = open.theirs[1].unwrap_or(Name::EveOnce);
                add(
                    4,
                    open.session,
                    &[ephemeral],
                    &[Name::Eve],
                    &[[0, 9], [ROLLED_BACK, 9]],
                );
            }
            _ => {}
        }
        let suite = if air.window.is_some() {
            Suite::Pairing
        } else {
            Suite::Pinned
        };
        if passes(suite, air.peer.map(|(peer, _)| peer), Name::Air) {
            for session in [EVES_SESSION, 1] {
                add(1, session, &[Name::EveOnce], &[Name::Eve], &none);
            }
        }
        let half_open = air.half_open.iter().map(|(open, _)| open);
        for open in half_open.chain(air.window.iter().flat_map(|window| &window.open)) {
            if of(open) {
                let ephemeral = open.theirs[1].unwrap_or(Name::EveOnce);
                add(
                    3,
                    open.session,
                    &[ephemeral],
                    &[Name::Eve, Name::Ground],
                    &none,
                );
            }
        }
        words
    }

    /// What an action leads to; `None` where it is not possible, or nobody can make the message.
    fn next(&self, last: &State, knowledge: &Knowledge, action: Action) -> Option<State> {
        let mut state = last.clone();
        let (ground, air) = (&mut state.ground, &mut state.air);
        match action {
            Action::Begin => state.begin(self.flaw),
            Action::Deliver(content) => {
                let message = state.deliver(content, self.flaw)?;
                let makes = last.was_sent(&message)
                    || message.parts.iter().all(|part| knowledge.makes(*part));
                makes.then_some(())?;
            }
            Action::Install => {
                let (key, _) = air.next.filter(|(_, sent)| !sent)?;
                air.next = Some((key, true));
                air.report(SENT);
            }
            Action::Take => {
                let (key, _) = air.next.filter(|(_, sent)| *sent)?;
                state.autopilot = Some(key);
            }
            Action::SeenInAir => {
                let (key, _) = air.next.filter(|(key, _)| state.autopilot == Some(*key))?;
                (air.previous, air.current, air.next) = (air.current, Some(key), None);
                air.report(ACTIVE);
            }
            Action::RolledBack => {
                air.next
                    .filter(|(key, sent)| *sent && state.autopilot != Some(*key))?;
                air.next = None;
                air.report(ROLLED_BACK);
            }
            Action::SeenOnGround => {
                let key = ground.next.filter(|key| state.autopilot == Some(*key))?;
                ground.seen(key);
            }
            Action::FallBack => {
                (state.falls < self.falls && state.autopilot == air.current).then_some(())?;
                state.autopilot = Some(air.previous?);
                state.falls += 1;
            }
            Action::InstallAgain => {
                (state.autopilot == air.previous).then_some(())?;
                state.autopilot = Some(air.current?);
            }
            Action::RestartGround => {
                ground.phase = Phase::Idle;
                state.restarts += 1;
            }
            Action::RestartAir => {
                (air.half_open, air.window, air.done) = (None, None, None);
                air.highest = air.peer.map_or(0, |(_, counter)| counter);
                state.restarts += 1;
            }
            Action::OpenWindow => {
                air.next.is_none_or(|(_, sent)| !sent).then_some(())?;
                (air.next, air.half_open, air.done) = (None, None, None);
                air.window = Some(Window::default());
                state.windows += 1;
            }
            Action::Leak(Name::FirstKey) => {
                state.leaked_keys.extend(state.autopilot);
                state.leaked.insert(Name::FirstKey);
                state.secrets.retain(|key| Some(*key) != state.autopilot);
            }
            Action::Leak(name) => drop(state.leaked.insert(name)),
        }
        (state != *last).then_some(state)
    }

    /// The promise that the state breaks.
    fn broken(&self, state: &State, knowledge: &Knowledge) -> Option<&'static str> {
        let (ground, air) = (&state.ground, &state.air);
        let kept = ground
            .previous
            .filter(|_| self.flaw != Some(Flaw::DropsPrevious));
        let on_ground = [ground.current, ground.next, kept];
        let in_air = [air.current, air.next.map(|(key, _)| key), air.previous];
        let autopilot = state.autopilot.is_none()
            || on_ground.contains(&state.autopilot) && in_air.contains(&state.autopilot);
        let staged = air
            .next
            .is_none_or(|(key, _)| on_ground[..2].contains(&Some(key)));
        if state.broken.is_some() {
            state.broken
        } else if state.secrets.iter().any(|key| knowledge.makes(*key)) {
            Some(SECRET)
        } else {
            (!state.posed && (!autopilot || !staged)).then_some(IN_FORCE)
        }
    }

    /// Visits every state, breadth first; ends at the first broken promise.
    pub(crate) fn explore(&self) -> Explored {
        let hasher = BuildHasherDefault::<DefaultHasher>::default();
        let start = self.start();
        let mut seen = HashSet::from([hasher.hash_one(&start)]);
        let mut explored = Explored {
            parents: vec![None],
            ..Explored::default()
        };
        let mut queue = VecDeque::from([(0, start)]);
        while let Some((number, state)) = queue.pop_front() {
            let knowledge = self.knowledge(&state);
            if let Some(promise) = self.broken(&state, &knowledge) {
                explored.broken = Some((promise, explored.trace(number)));
                return explored;
            }
            explored.most_keys = explored.most_keys.max(state.air_staged.len());
            explored.posed |= state.posed;
            explored.in_force |= !state.posed
                && state.ground.current == state.autopilot
                && state
                    .autopilot
                    .is_some_and(|key| state.secrets.contains(&key));
            for action in self.actions(&state, &knowledge) {
                if let Some(next) = self.next(&state, &knowledge, action)
                    && seen.insert(hasher.hash_one(&next))
                {
                    queue.push_back((explored.parents.len(), next));
                    explored.parents.push(Some((number, action)));
                }
            }
        }
        explored
    }

    /// The states along a trace, the first included.
    pub(crate) fn states(&self, trace: &[Action]) -> Vec<State> {
        let mut states = vec![self.start()];
        for action in trace {
            let last = &states[states.len() - 1];
            states.extend(self.next(last, &self.knowledge(last), *action));
        }
        states
    }
}

/// What a search has found.
#[derive(Debug, Default)]
pub(crate) struct Explored {
    pub(crate) broken: Option<(&'static str, Vec<Action>)>,
    /// The most keys that the agent staged, whether somebody posed as an end, whether an agreed key came into force.
    pub(crate) most_keys: usize,
    pub(crate) posed: bool,
    pub(crate) in_force: bool,
    parents: Vec<Option<(usize, Action)>>,
}

impl Explored {
    pub(crate) fn states(&self) -> usize {
        self.parents.len()
    }

    /// What has led to a state.
    pub(crate) fn trace(&self, mut number: usize) -> Vec<Action> {
        let mut trace = Vec::new();
        while let Some((parent, action)) = self.parents[number] {
            trace.push(action);
            number = parent;
        }
        trace.reverse();
        trace
    }
}

const EVES_SESSION: u8 = 99;
const EVES_COUNTER: u8 = 99;
