//! The order to zeroize (steps 6 and 7) as a model of its own beside that of the keys: both rest on the two static keys alone, and
//! neither reads what the other has stored. The same attacker, terms and comparison with the code.
//!
//! One ground orders two vehicles, whose agents have the same static key, as a memory card that was copied has: of these the agent of
//! the first is modelled. **What must hold** is in the constants below. A challenge is the agent's HMAC of the order's number, under a
//! secret of its process that is replaced after 10 s and holds for as long again; [`Action::Period`] is these 10 s.

use core::time::Duration;
use std::collections::{BTreeMap, BTreeSet, HashSet, VecDeque};
use std::hash::{BuildHasher as _, BuildHasherDefault, DefaultHasher};

use mavlink_link::Now;
use mavlink_link::exchange::{
    AutopilotKey, Inbound, Initiator, InitiatorConfig, InitiatorEvent, Message, NoRandom, Parties,
    Responder, ResponderEvent, Step, Trust, ZeroizeReport,
};

use super::code::{identity, public};
use super::messages::gate;
use super::terms::{Knowledge, Name, Term, bytes, hmac, join, len, secret, secret_bytes, value};
use crate::disks::{AirDisk, GroundDisk};
use crate::world::{AIR, GROUND, HONEST, WANTED, parties, wire};

const GENUINE: &str = "an agent is ordered by its pinned ground, and for its own vehicle, alone";
const FRESH: &str = "an order counts with a challenge that this process has given for it lately";
const ONCE: &str = "an order counts once for each challenge";
const OWN_REPORT: &str = "a report that the ground takes is the agent's of that order";

/// A mistake that somebody could make: the search must find each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Flaw {
    /// An order counts without a challenge.
    NoChallenge,
    /// What has counted is forgotten.
    CountsTwice,
    /// An order to another vehicle counts.
    OtherVehicle,
    /// The ground takes a report of another order for its own.
    AnyReport,
    /// The signing key makes the authenticator.
    SigningKey,
    /// The secret of challenges is never replaced.
    NoPeriod,
}

/// What an order or its answer contains, all of it public.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
enum Content {
    /// Step 6: number, vehicle, challenge.
    Order(u8, u8, Option<Term>),
    /// Step 7: the number and its challenge.
    Challenge(u8, Term),
    /// Step 7: the number, stored and done.
    Report(u8),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
struct Sent {
    wire: Term,
    content: Content,
    tag: Term,
}

#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
struct State {
    /// What the ground orders of each vehicle now: number, challenge.
    orders: BTreeMap<u8, (u8, Option<Term>)>,
    /// The agent's secrets and their age in periods, the one in use first.
    secrets: [Option<(u8, u8)>; 2],
    /// The orders that this process has taken, the last one last, and whether it has reported.
    taken: Vec<(u8, bool)>,
    tape: BTreeSet<Sent>,
    leaked: BTreeSet<Name>,
    made: u8,
    drawn: u8,
    restarts: u8,
    periods: u8,
    forgets: u8,
    /// The agent's process, and by which of them, in which period, each challenge was given.
    process: u8,
    given: BTreeMap<Term, (u8, u8)>,
    /// The challenges that have been good for something, how often the agent was ordered, and what it has reported.
    used: BTreeSet<Term>,
    ordered: u8,
    reported: BTreeSet<u8>,
    /// Reports that the ground has taken.
    heard: u8,
    posed: bool,
    broken: Option<&'static str>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Action {
    /// The ground orders a vehicle; what it ordered of it before is given up.
    Order(u8),
    Deliver(Content),
    /// The agent reports what has become of the last order that it has taken.
    Report,
    /// The ground asks for another challenge.
    Forget,
    Period,
    RestartAir,
    RestartGround,
    Leak(Name),
}

#[derive(Debug, Clone, Copy)]
struct Scope {
    orders: u8,
    periods: u8,
    restarts: u8,
    forgets: u8,
    leaks: &'static [Name],
    flaw: Option<Flaw>,
}

const SCOPE: Scope = Scope {
    orders: 2,
    periods: 2,
    restarts: 1,
    forgets: 1,
    leaks: &[],
    flaw: None,
};

fn number_bytes(number: u8) -> [u8; 16] {
    let mut bytes = [0; 16];
    bytes[0] = number;
    bytes
}

impl Scope {
    fn key(&self) -> Term {
        match self.flaw {
            Some(Flaw::SigningKey) => secret(Name::FirstKey),
            _ => gate(Some([Name::Ground, Name::Air])),
        }
    }

    /// As it goes out, under the authenticator of both static keys.
    fn sent(&self, content: Content) -> Sent {
        let zeros = bytes(&[0; 16]);
        let (step, [system, component], number, data) = match content {
            Content::Order(number, vehicle, challenge) => {
                let rest = bytes(&[0x1b, 0, 0, 1, 0x1b, 0, 1, vehicle, 1]);
                let own = bytes(&number_bytes(number));
                (6, [1, 191], number, [own, challenge.unwrap_or(zeros), rest])
            }
            Content::Challenge(number, challenge) => {
                let own = bytes(&[&[1, 0], number_bytes(number).as_slice()].concat());
                (7, [245, 190], number, [own, challenge, bytes(&[])])
            }
            Content::Report(number) => {
                let own = bytes(&[&[3, 1], number_bytes(number).as_slice()].concat());
                (7, [245, 190], number, [own, zeros, bytes(&[])])
            }
        };
        let used: usize = data.iter().map(|part| len(*part)).sum();
        let header = |len: usize| {
            let rest = [number, 0, 0, 0, 2, step, 1, 0, system, component, len as u8];
            [bytes(&[0; 32]), bytes(&rest)]
        };
        let text = [&[bytes(b"first")], header(used).as_slice(), &data].concat();
        let tag = hmac(self.key(), join(&text), 16);
        let wire = join(&[header(used + 16).as_slice(), &data, &[tag]].concat());
        Sent { wire, content, tag }
    }

    fn knowledge(&self, state: &State) -> Knowledge {
        let mut received = BTreeSet::new();
        for sent in &state.tape {
            received.insert(sent.tag);
            if let Content::Challenge(_, challenge) = sent.content {
                received.insert(challenge);
            }
        }
        Knowledge {
            received,
            names: state.leaked.clone(),
        }
    }

    fn actions(&self, state: &State, knowledge: &Knowledge) -> Vec<Action> {
        let mut actions = vec![Action::Report];
        if state.drawn < self.orders {
            actions.extend([Action::Order(1), Action::Order(2)]);
        }
        let mut words: BTreeSet<Content> = state.tape.iter().map(|sent| sent.content).collect();
        if knowledge.makes(self.key()) {
            // Whatever he likes: with each challenge that was ever given, and none.
            let given = state.tape.iter().filter_map(|sent| match sent.content {
                Content::Challenge(_, challenge) => Some(challenge),
                _ => None,
            });
            let given: Vec<_> = given.map(Some).chain([None]).collect();
            for number in 1..=self.orders {
                words.extend(given.iter().map(|one| Content::Order(number, 1, *one)));
                words.insert(Content::Report(number));
            }
        }
        actions.extend(words.into_iter().map(Action::Deliver));
        if state.forgets < self.forgets {
            actions.push(Action::Forget);
        }
        if state.periods < self.periods {
            actions.push(Action::Period);
        }
        if state.restarts < self.restarts {
            actions.extend([Action::RestartAir, Action::RestartGround]);
        }
        actions.extend(self.leaks.iter().map(|name| Action::Leak(*name)));
        actions
    }

    fn next(&self, last: &State, action: Action) -> Option<State> {
        let mut state = last.clone();
        match action {
            Action::Order(vehicle) => {
                state.drawn += 1;
                state.orders.insert(vehicle, (state.drawn, None));
                let order = Content::Order(state.drawn, vehicle, None);
                state.tape.insert(self.sent(order));
            }
            Action::Deliver(content @ Content::Order(..)) => self.ordered(&mut state, content),
            Action::Deliver(content) => self.answered(&mut state, content),
            Action::Report => {
                let (number, reported) = state.taken.last_mut()?;
                if std::mem::replace(reported, true) {
                    return None;
                }
                let number = *number;
                state.reported.insert(number);
                state.tape.insert(self.sent(Content::Report(number)));
            }
            Action::Forget => {
                let waits = state.orders.values_mut().find(|(_, of)| of.is_some())?;
                waits.1 = None;
                state.forgets += 1;
            }
            Action::Period => {
                for secret in &mut state.secrets {
                    if let Some((_, age)) = secret {
                        *age += u8::from(self.flaw != Some(Flaw::NoPeriod));
                    }
                    *secret = secret.filter(|(_, age)| *age < 2);
                }
                state.periods += 1;
            }
            Action::RestartAir => {
                (state.secrets, state.taken) = ([None; 2], Vec::new());
                state.process += 1;
                state.restarts += 1;
            }
            Action::RestartGround => {
                state.orders.clear();
                state.restarts += 1;
            }
            Action::Leak(name) => drop(state.leaked.insert(name)),
        }
        (state != *last).then_some(state)
    }

    /// Whether a message that was never sent was to be expected, since a static key was stolen.
    fn judge(&self, state: &mut State, content: Content) {
        let genuine = state.tape.contains(&self.sent(content));
        let stolen = [Name::Ground, Name::Air]
            .iter()
            .any(|name| state.leaked.contains(name));
        if !genuine && !stolen {
            state.broken = Some(GENUINE);
        }
        state.posed |= !genuine;
    }

    /// A challenge for a number, by the secret in use.
    fn challenge(secret_of: u8, number: u8) -> Term {
        // What is hashed begins with its length.
        let text = [16_u64.to_le_bytes().as_slice(), &number_bytes(number)].concat();
        hmac(secret(Name::Challenges(secret_of)), bytes(&text), 16)
    }

    fn ordered(&self, state: &mut State, content: Content) {
        let Content::Order(number, vehicle, challenge) = content else {
            return;
        };
        if vehicle != 1 && self.flaw != Some(Flaw::OtherVehicle) {
            return;
        }
        if challenge.is_none() && self.flaw != Some(Flaw::NoChallenge) {
            let [now, before] = &mut state.secrets;
            if now.is_none_or(|(_, age)| age > 0) {
                state.made += 1;
                *before = now.replace((state.made, 0));
            }
            let (secret_of, _) = now.unwrap_or_default();
            let challenge = Self::challenge(secret_of, number);
            let by = (state.process, state.periods);
            state.given.entry(challenge).or_insert(by);
            let given = Content::Challenge(number, challenge);
            state.tape.insert(self.sent(given));
            return;
        }
        let known = state.taken.iter().find(|(taken, _)| *taken == number);
        if let Some((_, reported)) = known
            && self.flaw != Some(Flaw::CountsTwice)
        {
            if *reported {
                state.tape.insert(self.sent(Content::Report(number)));
            }
            return;
        }
        let held = state.secrets.iter().flatten();
        let mut held = held.map(|(secret_of, _)| Self::challenge(*secret_of, number));
        let is_held = challenge.is_some_and(|challenge| held.any(|one| one == challenge));
        if !is_held && self.flaw != Some(Flaw::NoChallenge) {
            return;
        }
        self.judge(state, content);
        if vehicle != 1 {
            state.broken = Some(GENUINE);
        }
        // By what has happened, not by what the agent keeps.
        let given = challenge.and_then(|challenge| state.given.get(&challenge));
        let lately =
            |(process, period): &(u8, u8)| *process == state.process && state.periods - period < 2;
        if !given.is_some_and(lately) {
            state.broken = Some(FRESH);
        }
        if challenge.is_some_and(|challenge| !state.used.insert(challenge)) {
            state.broken = Some(ONCE);
        }
        state.ordered += 1;
        state.taken.push((number, false));
    }

    fn answered(&self, state: &mut State, content: Content) {
        let (number, challenge) = match content {
            Content::Challenge(number, challenge) => (number, Some(challenge)),
            Content::Report(number) => (number, None),
            Content::Order(..) => return,
        };
        let any = self.flaw == Some(Flaw::AnyReport) && challenge.is_none();
        let mut orders = state.orders.clone().into_iter();
        let Some((vehicle, (own, has))) = orders.find(|(_, (own, _))| *own == number || any) else {
            return;
        };
        let Some(challenge) = challenge else {
            if !state.reported.contains(&own)
                && !state.leaked.contains(&Name::Ground)
                && !state.leaked.contains(&Name::Air)
            {
                state.broken = Some(OWN_REPORT);
            }
            state.orders.remove(&vehicle);
            state.heard += 1;
            return;
        };
        if has.is_none() {
            state.orders.insert(vehicle, (own, Some(challenge)));
            let order = Content::Order(own, vehicle, Some(challenge));
            state.tape.insert(self.sent(order));
        }
    }

    fn explore(&self) -> Explored {
        let mut explored = Explored {
            parents: vec![None],
            ..Explored::default()
        };
        let hasher = BuildHasherDefault::<DefaultHasher>::default();
        let mut seen = HashSet::from([hasher.hash_one(State::default())]);
        let mut queue = VecDeque::from([(0, State::default())]);
        while let Some((number, state)) = queue.pop_front() {
            if let Some(promise) = state.broken {
                explored.broken = Some((promise, explored.trace(number)));
                return explored;
            }
            explored.ordered = explored.ordered.max(state.ordered);
            explored.heard |= state.heard > 0;
            explored.posed |= state.posed;
            let knowledge = self.knowledge(&state);
            for action in self.actions(&state, &knowledge) {
                if let Some(next) = self.next(&state, action)
                    && seen.insert(hasher.hash_one(&next))
                {
                    queue.push_back((explored.parents.len(), next));
                    explored.parents.push(Some((number, action)));
                }
            }
        }
        explored
    }
}

#[derive(Default)]
struct Explored {
    broken: Option<(&'static str, Vec<Action>)>,
    ordered: u8,
    heard: bool,
    posed: bool,
    parents: Vec<Option<(usize, Action)>>,
}

impl Explored {
    fn trace(&self, mut number: usize) -> Vec<Action> {
        let mut trace = Vec::new();
        while let Some((parent, action)) = self.parents[number] {
            trace.push(action);
            number = parent;
        }
        trace.reverse();
        trace
    }
}

/// The real machines.
struct Code {
    grounds: [Initiator; 2],
    air: Responder<u8>,
    air_disk: AirDisk,
    clocks: [Duration; 2],
    sent: Vec<Vec<u8>>,
    ordered: u8,
    heard: u8,
}

fn ground(vehicle: u8, now: Duration) -> Initiator {
    let parties = Parties::new(GROUND, AIR, 0x1b00_0001, 0x1b00_0100 + u32::from(vehicle));
    let config = InitiatorConfig {
        parties,
        identity: identity(Name::Ground),
        trust: Trust::Pinned(public(Name::Air)),
        wanted: WANTED,
    };
    Initiator::new(config, GroundDisk::default().memory(), now)
}

impl Code {
    fn new() -> Code {
        let now = Duration::from_secs(1);
        let peer = mavlink_link::exchange::PinnedPeer {
            key: public(Name::Ground),
            counter: 0,
        };
        let air_disk = AirDisk {
            peer: Some(peer),
            ..AirDisk::default()
        };
        assert_eq!(parties(), ground(1, now).config().parties);
        Code {
            grounds: [1, 2].map(|vehicle| ground(vehicle, now)),
            air: super::code::responder(&air_disk, now),
            air_disk,
            clocks: [now; 2],
            sent: vec![],
            ordered: 0,
            heard: 0,
        }
    }

    fn random(bytes: Vec<u8>) -> impl FnMut(&mut [u8]) -> Result<(), NoRandom> {
        move |out: &mut [u8]| {
            out.copy_from_slice(&bytes[..out.len()]);
            Ok(())
        }
    }

    fn act(&mut self, scope: &Scope, action: Action, before: &State, after: &State) {
        let mono = self.clocks[0];
        match action {
            Action::Order(vehicle) => {
                let mut random = Self::random(number_bytes(after.drawn).to_vec());
                let ground = &mut self.grounds[usize::from(vehicle) - 1];
                let ordered = ground.order_zeroize(mono, false, &mut random);
                assert_eq!(ordered, Ok(true));
            }
            Action::Deliver(content) => {
                self.deliver(&wire(&value(scope.sent(content).wire)), after.made);
            }
            Action::Report => self
                .air
                .report_zeroize(ZeroizeReport::Stored(AutopilotKey::Replaced)),
            Action::Forget => {
                // Long enough for the one that waits, and for no other.
                let of = before.orders.iter().find(|(_, (_, of))| of.is_some());
                let (vehicle, _) = of.expect("one that waits");
                self.clocks[0] += Duration::from_secs(2);
                let now = self.now();
                let ground = &mut self.grounds[usize::from(*vehicle) - 1];
                let mut disk = GroundDisk::default();
                ground.handle_timeout(now, &mut Self::random(vec![0; 32]), &mut disk);
            }
            Action::Period => self.clocks[1] += Duration::from_secs(10),
            Action::RestartAir => {
                self.air = super::code::responder(&self.air_disk, self.clocks[1]);
            }
            Action::RestartGround => {
                self.grounds = [1, 2].map(|vehicle| ground(vehicle, mono));
            }
            Action::Leak(_) => {}
        }
        self.collect();
    }

    fn now(&self) -> Now {
        Now {
            mono: self.clocks[0],
            wall: Duration::ZERO,
        }
    }

    fn deliver(&mut self, payload: &[u8], made: u8) {
        let up = Self::step(payload) == Step::Order;
        if up {
            let inbound = Inbound {
                from: HONEST,
                source: GROUND,
                verified: false,
                payload,
            };
            let mut random = Self::random(secret_bytes(Name::Challenges(made)));
            let (now, disk) = (self.clocks[1], &mut self.air_disk);
            let _ = self.air.handle(now, inbound, &mut random, disk);
        } else {
            let now = self.now();
            for ground in &mut self.grounds {
                let inbound = Inbound {
                    from: (),
                    source: AIR,
                    verified: false,
                    payload,
                };
                let _ = ground.handle(now, inbound, &mut GroundDisk::default());
            }
        }
        self.collect();
    }

    fn step(payload: &[u8]) -> Step {
        match Message::parse(payload) {
            Ok(mavlink_link::exchange::Received::Exchange(message)) => message.step,
            other => panic!("the model has made what cannot be read: {other:?}"),
        }
    }

    fn collect(&mut self) {
        let answers = std::iter::from_fn(|| self.air.poll_transmit()).map(|out| out.message);
        let answers: Vec<_> = answers.collect();
        let orders = self.grounds.iter_mut().filter_map(Initiator::poll_transmit);
        for message in answers.into_iter().chain(orders) {
            if message.step != Step::Reject {
                self.sent.push(wire(&message.to_payload()));
            }
        }
        while let Some(event) = self.air.poll_event() {
            self.ordered += u8::from(matches!(event, ResponderEvent::Zeroize { .. }));
        }
        for ground in &mut self.grounds {
            while let Some(event) = ground.poll_event() {
                self.heard +=
                    u8::from(matches!(event, InitiatorEvent::Zeroize { report: Some(_) }));
            }
        }
    }
}

/// Leads the machines along a history, and plays to them everything that was ever sent.
fn follow(scope: &Scope, trace: &[Action]) {
    let mut states = vec![State::default()];
    for action in trace {
        states.extend(scope.next(&states[states.len() - 1], *action));
    }
    let mut code = Code::new();
    for (at, action) in trace.iter().enumerate() {
        let [before, after] = [&states[at], &states[at + 1]];
        code.act(scope, *action, before, after);
        let here = || format!("{:#?}", &trace[..=at]);
        let counts = (code.ordered, code.heard);
        assert_eq!(counts, (after.ordered, after.heard), "{}", here());
        let tape: BTreeSet<_> = after
            .tape
            .iter()
            .map(|sent| wire(&value(sent.wire)))
            .collect();
        let sent: BTreeSet<_> = code.sent.iter().cloned().collect();
        assert_eq!(sent, tape, "{}", here());
    }
    let last = &states[trace.len()];
    for sent in &last.tape {
        let next = scope.next(last, Action::Deliver(sent.content));
        if next.is_none() {
            let before = (code.ordered, code.heard);
            code.deliver(&wire(&value(sent.wire)), u8::MAX);
            assert_eq!(
                (code.ordered, code.heard),
                before,
                "{:?} after {trace:#?}",
                sent.content
            );
        }
    }
}

#[test]
fn an_agent_is_ordered_by_its_ground_alone_once_a_challenge_and_for_its_vehicle() {
    let found = SCOPE.explore();
    assert!(found.broken.is_none(), "{:#?}", found.broken);
    assert!(!found.posed && found.heard);
    assert!(found.ordered >= 2, "{}", found.ordered);
    assert!(
        found.parents.len() > 5_000,
        "{} states",
        found.parents.len()
    );
}

#[test]
fn who_has_a_static_key_can_order_and_nothing_else_breaks() {
    for (leaks, poses) in [
        ([Name::Ground].as_slice(), true),
        (&[Name::Air], true),
        (&[Name::FirstKey], false),
    ] {
        let scope = Scope {
            leaks,
            orders: 1,
            ..SCOPE
        };
        let found = scope.explore();
        assert!(found.broken.is_none(), "{:#?}", found.broken);
        assert_eq!(found.posed, poses, "{leaks:?}");
    }
}

#[test]
fn every_mistake_with_orders_is_found() {
    let mut silent = Vec::new();
    for (flaw, promise) in [
        (Flaw::NoChallenge, FRESH),
        (Flaw::CountsTwice, ONCE),
        (Flaw::OtherVehicle, GENUINE),
        (Flaw::AnyReport, OWN_REPORT),
        // A report is forged before an order is.
        (Flaw::SigningKey, OWN_REPORT),
        (Flaw::NoPeriod, FRESH),
    ] {
        let scope = Scope {
            flaw: Some(flaw),
            leaks: &[Name::FirstKey],
            ..SCOPE
        };
        let found = scope.explore().broken.map(|(promise, _)| promise);
        if found != Some(promise) {
            silent.push((flaw, found));
        }
    }
    assert!(silent.is_empty(), "{silent:?}");
}

#[test]
fn the_code_orders_and_reports_what_the_model_does() {
    let small = Scope { orders: 1, ..SCOPE };
    for (scope, every) in [(small, 7), (SCOPE, 397)] {
        let found = scope.explore();
        assert!(found.broken.is_none());
        for number in (0..found.parents.len()).step_by(every) {
            follow(&scope, &found.trace(number));
        }
    }
}
