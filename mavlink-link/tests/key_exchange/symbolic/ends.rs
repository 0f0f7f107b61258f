//! Ground, agent and autopilot: what each keeps on disk and in memory, and what a message does to it.

use std::collections::BTreeSet;
use std::rc::Rc;

use super::messages::{Content, Facts, Handshake, Message, Suite, gate};
use super::terms::{Name, Term};
use super::{AGREED, Flaw, GENUINE, ONCE, STAGED};

#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub(crate) struct Ground {
    // On disk.
    /// Pinned; without it the ground pairs.
    pub(crate) peer: Option<Name>,
    pub(crate) counter: u8,
    pub(crate) epoch: u8,
    pub(crate) current: Option<Term>,
    pub(crate) next: Option<Term>,
    pub(crate) previous: Option<Term>,
    /// Of a pairing whose key is `next`: not proven yet.
    pub(crate) pending: Option<Name>,
    // In memory.
    pub(crate) phase: Phase,
}

#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub(crate) enum Phase {
    #[default]
    Idle,
    Asking(Handshake),
    /// Step 3 is out; with the number of the last step 4.
    Confirming(Handshake, Option<u8>),
}

#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub(crate) struct Air {
    // On disk.
    pub(crate) peer: Option<(Name, u8)>,
    pub(crate) epoch: u8,
    pub(crate) current: Option<Term>,
    /// And whether the autopilot may have been sent it.
    pub(crate) next: Option<(Term, bool)>,
    pub(crate) previous: Option<Term>,
    // In memory.
    pub(crate) highest: u8,
    pub(crate) half_open: Option<(Handshake, Facts)>,
    pub(crate) window: Option<Window>,
    pub(crate) done: Option<Done>,
}

#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub(crate) struct Window {
    pub(crate) open: Vec<Handshake>,
    pub(crate) seen: Vec<u8>,
}

#[derive(Debug, Clone, PartialEq, Eq, Hash)]
pub(crate) struct Done {
    handshake: Handshake,
    confirm: Term,
    outcome: [u8; 2],
}

#[derive(Debug, Clone, Default, PartialEq, Eq, Hash)]
pub(crate) struct State {
    pub(crate) ground: Ground,
    pub(crate) air: Air,
    pub(crate) autopilot: Option<Term>,
    /// Everything that the two ends ever sent.
    pub(crate) tape: BTreeSet<Rc<Message>>,
    pub(crate) leaked: BTreeSet<Name>,
    pub(crate) leaked_keys: BTreeSet<Term>,
    pub(crate) sessions: u8,
    pub(crate) answers: u8,
    pub(crate) restarts: u8,
    pub(crate) windows: u8,
    pub(crate) falls: u8,
    /// Every key that an end ever stored; those that nobody else may ever know.
    pub(crate) ground_stored: BTreeSet<Term>,
    pub(crate) air_staged: BTreeSet<Term>,
    pub(crate) secrets: BTreeSet<Term>,
    /// Somebody with a stolen secret has posed as an end.
    pub(crate) posed: bool,
    /// The promise that the last step broke.
    pub(crate) broken: Option<&'static str>,
}

fn content(step: u8, of: &Handshake, ephemeral: Name, facts: Facts) -> Content {
    Content {
        step,
        session: of.session,
        ephemeral,
        identity: of.own[0],
        facts,
        outcome: [0; 2],
    }
}

const NO_FACTS: Facts = Facts {
    counter: 0,
    epoch: 0,
    current: None,
};

impl State {
    fn send(&mut self, of: &Handshake, content: Content, data: &[Term]) {
        let gate = self.gate_of(of.suite, of);
        self.tape
            .insert(Rc::new(Message::new(of.suite, content, data, gate)));
    }

    fn gate_of(&self, suite: Suite, of: &Handshake) -> Term {
        gate(
            of.theirs[0]
                .filter(|_| suite == Suite::Pinned)
                .map(|peer| [of.own[0], peer]),
        )
    }

    pub(crate) fn was_sent(&self, message: &Message) -> bool {
        self.tape.iter().any(|sent| sent.wire == message.wire)
    }

    /// Whether a message that its sender never sent was to be expected, since this was stolen; notes it.
    fn judge(&mut self, message: &Message, stolen: &[Name]) -> bool {
        let genuine = self.was_sent(message);
        let known = |name: &Name| *name == Name::Eve || self.leaked.contains(name);
        if !genuine && !stolen.iter().any(known) {
            self.broken = Some(GENUINE);
        }
        genuine
    }

    /// The ground begins; an attempt that is open is given up.
    pub(crate) fn begin(&mut self, flaw: Option<Flaw>) {
        let ground = &mut self.ground;
        let suite = if ground.peer.is_some() {
            Suite::Pinned
        } else {
            Suite::Pairing
        };
        if ground.waits() && flaw != Some(Flaw::DoesNotWait) {
            self.air.half_open = None;
            self.air
                .window
                .iter_mut()
                .for_each(|window| window.open.clear());
        }
        self.sessions += 1;
        ground.counter += 1;
        let own = [Name::Ground, Name::GroundOnce(self.sessions)];
        let mut handshake = Handshake::new(suite, self.sessions, true, own, ground.peer);
        let facts = if suite == Suite::Pinned {
            ground.facts()
        } else {
            NO_FACTS
        };
        let content = content(1, &handshake, own[1], facts);
        let data = handshake.step(true, &content, flaw);
        self.send(&handshake, content, &data);
        self.ground.phase = Phase::Asking(handshake);
    }

    /// Whether an end may read a message of this session now: what is certainly ignored need not be made.
    pub(crate) fn expects(&self, content: &Content) -> bool {
        let air = &self.air;
        match (content.step, &self.ground.phase) {
            (1, _) => air.peer.is_some() || air.window.is_some(),
            (2, Phase::Asking(open)) | (4, Phase::Confirming(open, _)) => {
                open.session == content.session
            }
            (3, _) => {
                let half_open = air.half_open.iter().map(|(open, _)| open);
                let slots = air.window.iter().flat_map(|window| &window.open);
                let done = air.done.iter().map(|done| &done.handshake);
                let mut known = half_open.chain(slots).chain(done);
                known.any(|open| open.session == content.session)
            }
            _ => false,
        }
    }

    /// Takes a message as it must be to be accepted: `None` where none with these words is.
    pub(crate) fn deliver(&mut self, content: Content, flaw: Option<Flaw>) -> Option<Message> {
        match content.step {
            1 => self.offered(content, flaw),
            2 => self.answered(content, flaw),
            3 => self.confirmed(content, flaw),
            _ => self.outcome(content, flaw),
        }
    }

    fn answered(&mut self, content: Content, flaw: Option<Flaw>) -> Option<Message> {
        let Phase::Asking(mut handshake) = self.ground.phase.clone() else {
            return None;
        };
        if content.session != handshake.session {
            return None;
        }
        let gate = self.gate_of(handshake.suite, &handshake);
        let data = handshake.step(false, &content, flaw);
        let message = Message::new(handshake.suite, content, &data, gate);
        let open = flaw == Some(Flaw::NoGate);
        let genuine = open || self.judge(&message, &[self.ground.stealable()]);
        self.posed |= !genuine;
        let mut confirm = self::content(3, &handshake, handshake.own[1], NO_FACTS);
        let data = match handshake.suite {
            Suite::Pinned => vec![handshake.confirmation()],
            Suite::Pairing => {
                confirm.facts = self.ground.facts();
                handshake.step(true, &confirm, flaw)
            }
        };
        let key = handshake.signing_key();
        let ground = &mut self.ground;
        // The agent has our waiting key in force: it must not be overwritten by the new one.
        let in_force = ground
            .next
            .filter(|next| content.facts.current == Some(*next));
        if let Some(key) = in_force.filter(|_| flaw != Some(Flaw::DoesNotPromote)) {
            ground.promote(key);
        }
        ground.epoch = ground.epoch.max(content.facts.epoch) + 1;
        if flaw == Some(Flaw::DeletesEarly) {
            ground.current = None;
        }
        let peer = handshake.theirs[0];
        ground.pending = peer.filter(|_| ground.peer != peer);
        ground.phase = Phase::Confirming(handshake.clone(), None);
        if flaw != Some(Flaw::GroundStoresLate) {
            ground.next = Some(key);
            self.ground_stored.insert(key);
        }
        if genuine {
            self.secrets.insert(key);
        }
        self.tape
            .insert(Rc::new(Message::new(handshake.suite, confirm, &data, gate)));
        Some(message)
    }

    fn outcome(&mut self, content: Content, flaw: Option<Flaw>) -> Option<Message> {
        let Phase::Confirming(handshake, number) = self.ground.phase.clone() else {
            return None;
        };
        if content.session != handshake.session
            || handshake.theirs[1] != Some(content.ephemeral)
            || number.is_some_and(|number| content.outcome[1] <= number)
        {
            return None;
        }
        let gate = self.gate_of(handshake.suite, &handshake);
        let mut data = handshake.outcome(content.outcome);
        if flaw == Some(Flaw::BelievesOutcome) {
            data.truncate(1);
        }
        let message = Message::new(handshake.suite, content, &data, gate);
        self.judge(
            &message,
            if self.posed {
                &[Name::Air, Name::Code, Name::Stolen]
            } else {
                &[]
            },
        );
        let key = handshake.signing_key();
        let ground = &mut self.ground;
        if content.outcome[0] == ROLLED_BACK {
            (ground.next, ground.phase) = (None, Phase::Idle);
            return Some(message);
        }
        if flaw == Some(Flaw::GroundStoresLate) {
            ground.next = Some(key);
        }
        if number.is_none() {
            ground.pin(handshake.theirs[0]);
            if !self.air_staged.contains(&key) && !self.posed {
                self.broken = Some(AGREED);
            }
        }
        let ground = &mut self.ground;
        ground.phase = Phase::Confirming(handshake, Some(content.outcome[1]));
        if ground.current.is_none() {
            // There is no other.
            (ground.current, ground.phase) = (ground.next.take(), Phase::Idle);
        }
        Some(message)
    }

    fn offered(&mut self, content: Content, flaw: Option<Flaw>) -> Option<Message> {
        let air = &self.air;
        let suite = if air.window.is_some() {
            Suite::Pairing
        } else {
            Suite::Pinned
        };
        let known = air
            .half_open
            .as_ref()
            .is_some_and(|(open, _)| open.session == content.session);
        let over = air
            .window
            .iter()
            .any(|window| window.seen.contains(&content.session));
        let sent = air.next.is_some_and(|(_, sent)| sent) && flaw != Some(Flaw::ReplacesSent);
        if known || over || sent {
            return None;
        }
        let peer = match suite {
            Suite::Pinned => Some(air.peer?.0),
            Suite::Pairing => None,
        };
        self.answers += 1;
        // Suite 1: who has the agent's own key can make a step 1 too, and no more; suite 2: anybody who passes the gate.
        let own = [Name::Air, Name::AirOnce(self.answers)];
        let mut handshake = Handshake::new(suite, content.session, false, own, peer);
        let gate = self.gate_of(suite, &handshake);
        let data = handshake.step(false, &content, flaw);
        let message = Message::new(suite, content, &data, gate);
        if suite == Suite::Pinned && flaw != Some(Flaw::NoCounter) {
            (content.facts.counter > air.highest).then_some(())?;
        }
        let facts = Facts {
            counter: 0,
            epoch: self.air.epoch,
            current: self.air.current,
        };
        let answer = self::content(2, &handshake, own[1], facts);
        let data = handshake.step(true, &answer, flaw);
        if suite == Suite::Pinned {
            let old = self
                .air
                .peer
                .is_some_and(|(_, done)| content.facts.counter <= done);
            if old {
                self.broken = Some(ONCE);
            }
            if flaw != Some(Flaw::KeepsNext) {
                self.air.next = None;
            }
            (self.air.done, self.air.highest) = (None, content.facts.counter);
            self.air.half_open = Some((handshake.clone(), content.facts));
        } else if let Some(window) = &mut self.air.window {
            window.seen.push(content.session);
            window.open.push(handshake.clone());
        }
        self.tape
            .insert(Rc::new(Message::new(suite, answer, &data, gate)));
        if flaw == Some(Flaw::StagesUnconfirmed) && suite == Suite::Pinned {
            self.stage(&handshake, content.facts, &message, true);
        }
        Some(message)
    }

    fn confirmed(&mut self, content: Content, flaw: Option<Flaw>) -> Option<Message> {
        if let Some(done) = &self.air.done {
            let again = |m: &&Rc<Message>| m.wire == done.confirm && m.content == content;
            if done.handshake.session == content.session {
                let again = self.tape.iter().find(again)?.as_ref().clone();
                let done = done.clone();
                self.answer_done(&done);
                return Some(again);
            }
        }
        let fits = |open: &&Handshake| {
            open.session == content.session && open.theirs[1] == Some(content.ephemeral)
        };
        let pinned = self.air.half_open.clone().filter(|(open, _)| fits(&open));
        let (handshake, data, facts) = if let Some((open, facts)) = pinned {
            let data = vec![open.confirmation()];
            (open, data, facts)
        } else {
            let mut open = self.air.window.as_ref()?.open.iter().find(fits)?.clone();
            let data = open.step(false, &content, flaw);
            (open, data, content.facts)
        };
        let gate = self.gate_of(handshake.suite, &handshake);
        let message = Message::new(handshake.suite, content, &data, gate);
        let peer = handshake.theirs[0]?;
        let needed = if handshake.suite == Suite::Pinned {
            peer
        } else {
            Name::Code
        };
        let genuine = self.judge(&message, &[needed]);
        self.stage(&handshake, facts, &message, genuine);
        Some(message)
    }

    /// The key is on the agent's disk, and may be installed in the autopilot.
    fn stage(&mut self, handshake: &Handshake, facts: Facts, confirm: &Message, genuine: bool) {
        let key = handshake.signing_key();
        if genuine && !self.ground_stored.contains(&key) {
            self.broken = Some(STAGED);
        }
        self.posed |= !genuine;
        let air = &mut self.air;
        air.peer = handshake.theirs[0].map(|peer| (peer, facts.counter));
        air.epoch = air.epoch.max(facts.epoch) + 1;
        (air.next, air.highest) = (Some((key, false)), facts.counter);
        (air.half_open, air.window) = (None, None);
        let confirm = confirm.wire;
        let done = Done {
            handshake: handshake.clone(),
            confirm,
            outcome: [0; 2],
        };
        if !self.air_staged.insert(key) {
            self.broken = Some(ONCE);
        }
        if genuine {
            self.secrets.insert(key);
        }
        self.answer_done(&done);
        self.air.done = Some(done);
    }

    fn answer_done(&mut self, done: &Done) {
        let mut content = content(4, &done.handshake, done.handshake.own[1], NO_FACTS);
        content.outcome = done.outcome;
        self.send(
            &done.handshake,
            content,
            &done.handshake.outcome(done.outcome),
        );
    }
}

impl Ground {
    fn facts(&self) -> Facts {
        Facts {
            counter: self.counter,
            epoch: self.epoch,
            current: self.current,
        }
    }

    pub(crate) fn promote(&mut self, key: Term) {
        (self.previous, self.current, self.next) = (self.current, Some(key), None);
    }

    /// In a pairing, whether nothing of an earlier session may be open at the agent when the next one begins.
    pub(crate) fn waits(&self) -> bool {
        let left = matches!(self.phase, Phase::Idle) && self.next.is_some();
        self.peer.is_none() && (left || matches!(self.phase, Phase::Confirming(..)))
    }

    /// What must be stolen before somebody can pose as the agent.
    fn stealable(&self) -> Name {
        self.peer.unwrap_or(Name::Code)
    }

    pub(crate) fn pin(&mut self, peer: Option<Name>) {
        if self.peer.is_none() {
            (self.peer, self.pending) = (peer, None);
        }
    }

    /// The autopilot signs with `next`.
    pub(crate) fn seen(&mut self, key: Term) {
        self.promote(key);
        if let Phase::Confirming(handshake, _) = &self.phase {
            let peer = handshake.theirs[0];
            self.pin(peer);
            self.phase = Phase::Idle;
        }
        if let Some(peer) = self.pending.take() {
            (self.peer, self.phase) = (Some(peer), Phase::Idle);
        }
    }
}

impl Air {
    pub(crate) fn report(&mut self, status: u8) {
        if let Some(Done { outcome, .. }) = &mut self.done
            && outcome[0] != status
        {
            *outcome = [status, outcome[1] + 1];
        }
    }
}

pub(crate) const SENT: u8 = 3;
pub(crate) const ACTIVE: u8 = 4;
pub(crate) const ROLLED_BACK: u8 = 5;
