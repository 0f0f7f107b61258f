//! The machine: the state of a rollover, and what it concludes from frames and time.

use core::time::Duration;
use std::collections::VecDeque;

use thiserror::Error;

use crate::Now;
use crate::address::ProvenAddress;
use crate::frame::{Parser, Signature, Stamp};
use crate::link::challenge::{Ping, Turns};
use crate::link::receiver::KeyState;
use crate::link::{Endpoint, Lifts, LinkConfig, Rising};
use crate::signing::clock::{Ceiling, Origin};
use crate::signing::{KeyId, SigningKey};
use crate::store::{Disk, Store as _, StoreError};

/// The settings of a rollover.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KeyRolloverConfig<A> {
    /// The link: the same ids and link id as in flight, since the vehicle keeps every stream until it restarts.
    pub link: LinkConfig<A>,
    /// A date that cannot be in the future, such as that of the build.
    pub not_before: Stamp,
    /// Whether the link may carry the key in the clear: if not, the rollover only finds out which key the vehicle has.
    pub may_send_key: bool,
    /// Whether unsigned frames of a vehicle that should sign are believed, from any address: a person, or the agent
    /// beside it, has confirmed that it lost its key. Otherwise only the address counts that has proved to be the vehicle.
    pub believe_unsigned: bool,
}

/// The state of a rollover.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum State {
    /// The new key is on disk; for 10 s only the one vehicle may be on the link.
    Staged,
    /// Waiting until the vehicle reports that it is disarmed.
    WaitDisarm,
    /// SETUP_SIGNING has been sent; heartbeats under both keys ask which one is in use.
    Sent,
    /// The vehicle signs with the new key.
    Committed,
    /// The vehicle still uses the old key; passed through on the way to another try.
    NotTaken,
    /// Three tries were not taken; the new key is given up after half a minute of the old one.
    RolledBack,
    /// The vehicle is silent: it may have either key, so both are kept and tried.
    Unknown,
}

/// Something for the caller to do or to report.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// The new state.
    State(State),
    /// Another autopilot is on the link, or the same one from two addresses; nothing is sent while there are two.
    SeveralAutopilots {
        /// Its system id.
        system: u8,
    },
    /// The vehicle refuses while it is armed.
    RefusedWhileArmed,
    /// Make the new key the current one on disk, and the current one the previous.
    Commit,
    /// The vehicle had the new key and has lost it: its power was cut while it wrote its key file (pitfall 23).
    FellBack,
    /// The rollover has ended.
    Ended(Outcome),
}

/// How a rollover ended. Silence does not end it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The vehicle has the new key.
    Committed,
    /// The vehicle keeps the old key: the new one may be deleted.
    RolledBack,
    /// The vehicle stays unsigned (PX4 1.17 and older cannot sign). The new key stays on disk.
    NeverSigns,
    /// More than one autopilot was on the link: nothing was sent.
    SeveralAutopilots,
}

/// Why a rollover cannot begin.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum StartError {
    /// The clock of the new key cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// No frame could prove which of the two it was signed with.
    #[error("the new key equals the current key, expected a different one")]
    SameKey,
}

/// The rollover of one vehicle from one key to another. `A` is an address.
#[derive(Debug)]
pub struct KeyRollover<A> {
    pub(super) config: KeyRolloverConfig<A>,
    /// The key in force so far; `None` where the vehicle does not sign yet.
    pub(super) old: Option<KeyState>,
    pub(super) new: NewKey,
    pub(super) state: State,
    pub(super) entered: Duration,
    /// SETUP_SIGNING sent since the last fresh start.
    pub(super) tries: u8,
    /// Joins frames that the peer, or a line, has split.
    pub(super) parser: Parser,
    /// For the datagrams of all other senders, each on its own: half a frame of theirs must not swallow the peer's next.
    pub(super) strange: Parser,
    pub(super) peer: ProvenAddress<A, Signature>,
    pub(super) seq: u8,
    pub(super) seen: Seen,
    pub(super) heartbeat_at: Duration,
    /// The next alternating heartbeat goes under the new key.
    pub(super) new_next: bool,
    pub(super) setup_due: bool,
    /// The new key is not durable yet.
    pub(super) held: bool,
    /// Where verified frames with stale timestamps came from.
    pub(super) lifts: Lifts<A, KeySlot>,
    /// Senders of verified frames that are stamped too far ahead, and of challenges of the same kind.
    pub(super) challenge: Turns<A, KeySlot>,
    pub(super) answer: Turns<A, (KeySlot, Ping)>,
    pub(super) rising: Rising<A>,
    pub(super) events: VecDeque<Event>,
    pub(super) outcome: Option<Outcome>,
}

/// The key to be installed.
#[derive(Debug)]
pub(super) enum NewKey {
    /// Never sent: nothing can have been signed with it.
    Staged(SigningKey),
    /// Sent at least once; frames may verify under it.
    Offered(Box<KeyState>),
}

/// Which key a frame is signed with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeySlot {
    /// The key in force so far.
    Old,
    /// The key to be installed.
    New,
}

/// What has been received from the vehicle.
#[derive(Debug, Default)]
pub(super) struct Seen {
    /// The first believed frame.
    pub(super) first: Option<Duration>,
    /// The last frame that verified, under either key.
    pub(super) verified: Option<Duration>,
    /// The last of them that was accepted, too.
    pub(super) accepted: Option<Duration>,
    /// The last frame under the old key, or unsigned where there is no old key.
    pub(super) old: Option<Duration>,
    /// Frames under the old key, made after the last SETUP_SIGNING was a replay.
    pub(super) old_newer: u32,
    /// Unsigned frames of the autopilot other than heartbeats, since the last SETUP_SIGNING.
    pub(super) unsigned: u32,
    /// Frames under the old key with stamps beyond what is followed: its clock was dragged ahead, or they are replays
    /// from when it was. They show that the key was perhaps not taken, never that it was refused.
    pub(super) future: u32,
    /// Frames under the vehicle's system id, signed with neither key.
    pub(super) foreign: u64,
    /// Frames under the vehicle's system id without a signature, from an address where nothing has verified.
    pub(super) disbelieved: u64,
    /// When it last reported disarmed; `None` once it reports armed.
    pub(super) disarmed: Option<Duration>,
    /// It reported that it refuses while armed.
    pub(super) refused_armed: bool,
    /// Stamp of our first heartbeat under the old key after the last SETUP_SIGNING.
    pub(super) mark: Option<Stamp>,
}

impl<A: Copy + Eq> KeyRollover<A> {
    /// Begins, or continues where an earlier process ended: a key of which the store has a clock may have
    /// been sent before, so the state is [`State::Unknown`]. It is also `Unknown` where the key may not be sent from
    /// here.
    ///
    /// `new` must be on disk already.
    ///
    /// # Errors
    /// The store cannot be read, or both keys are the same.
    pub fn start(
        config: KeyRolloverConfig<A>,
        old: Option<KeyState>,
        new: SigningKey,
        now: Now,
        store: &mut dyn Disk,
    ) -> Result<Self, StartError> {
        if old.as_ref().is_some_and(|old| old.key().same_as(&new)) {
            return Err(StartError::SameKey);
        }
        // A rollover that may not send the key only asks which one is in use, and cannot distinguish a key that was
        // never sent from one whose clock was lost.
        let known = !config.may_send_key || store.load::<Ceiling>(&new.id())?.is_some();
        let (new, state) = if known {
            let key = KeyState::start(new, Origin::KeyFile, config.not_before, now, store)?;
            (NewKey::Offered(Box::new(key)), State::Unknown)
        } else {
            (NewKey::Staged(new), State::Staged)
        };
        let peer = match config.link.endpoint {
            Endpoint::Listen => None,
            Endpoint::Fixed(peer) => Some(peer),
        };
        Ok(Self {
            config,
            old,
            new,
            state,
            entered: now.mono,
            tries: 0,
            parser: Parser::new(),
            strange: Parser::new(),
            peer: ProvenAddress::new(peer),
            seq: 0,
            seen: Seen::default(),
            heartbeat_at: now.mono,
            new_next: false,
            setup_due: false,
            held: false,
            lifts: Lifts::new(),
            challenge: Turns::new(),
            answer: Turns::new(),
            rising: Rising::new(),
            events: VecDeque::from([Event::State(state)]),
            outcome: None,
        })
    }

    /// The state.
    #[must_use]
    pub fn state(&self) -> State {
        self.state
    }

    /// When it entered its state, in the caller's monotonic time.
    #[must_use]
    pub fn entered_at(&self) -> Duration {
        self.entered
    }

    /// How it ended, once it has. Heartbeats continue; a vehicle that loses the key again reopens the rollover.
    #[must_use]
    pub fn outcome(&self) -> Option<Outcome> {
        self.outcome
    }

    /// The name of the new key.
    #[must_use]
    pub fn new_id(&self) -> KeyId {
        match &self.new {
            NewKey::Staged(key) => key.id(),
            NewKey::Offered(key) => key.id(),
        }
    }

    /// The vehicle's address, once it is known.
    #[must_use]
    pub fn peer(&self) -> Option<A> {
        self.peer.get()
    }

    /// The vehicle's address, as long as frames that cannot be recordings verify from it.
    #[must_use]
    pub fn proven_peer(&self, mono: Duration) -> Option<A> {
        let accepted = self.seen.accepted;
        self.peer()
            .filter(|_| accepted.is_some_and(|at| mono.saturating_sub(at) < RECENTLY))
    }

    /// Frames under the vehicle's system id that neither key has signed: it may have a third one.
    #[must_use]
    pub fn foreign_frames(&self) -> u64 {
        self.seen.foreign
    }

    /// Unsigned frames under the vehicle's system id that were not believed: it may have lost its key.
    #[must_use]
    pub fn disbelieved_frames(&self) -> u64 {
        self.seen.disbelieved
    }

    /// Whether the vehicle has not taken the key and signs with timestamps further ahead than is followed, or recordings
    /// from when it did are replayed. If its clock was dragged ahead on our own stream, it accepts nothing of ours before
    /// it has restarted.
    #[must_use]
    pub fn is_dragged(&self) -> bool {
        // Frames under the old key are stamped further ahead than can be followed, so none proves to be newer than a timestamp
        // of ours. The key is sent again: it comes with a new initial timestamp, which repairs that.
        self.config.may_send_key && self.seen.future >= 2
    }

    /// Holds the new key back, or no longer: while it is not durable it is not sent. All else continues.
    pub fn hold_key(&mut self, hold: bool) {
        self.held = hold;
    }

    /// Whether the new key is due to be sent, or is held back.
    #[must_use]
    pub fn key_is_due(&self) -> bool {
        self.setup_due && self.peer().is_some()
    }

    /// Whether any frame of the vehicle has been believed.
    #[must_use]
    pub fn has_received(&self) -> bool {
        self.seen.first.is_some()
    }

    /// One of the two keys with its clock, for a caller that verifies other frames with it meanwhile. There is none
    /// for a vehicle that did not sign, and no new one before it has been sent.
    pub fn key_mut(&mut self, under: KeySlot) -> Option<&mut KeyState> {
        match (under, &mut self.new) {
            (KeySlot::Old, _) => self.old.as_mut(),
            (KeySlot::New, NewKey::Offered(new)) => Some(new),
            (KeySlot::New, NewKey::Staged(_)) => None,
        }
    }

    /// A copy of the new key.
    #[must_use]
    pub fn new_key(&self) -> SigningKey {
        match &self.new {
            NewKey::Staged(key) => key.duplicate(),
            NewKey::Offered(key) => key.key().duplicate(),
        }
    }

    /// A copy of the key in force so far, to be kept as the one before.
    #[must_use]
    pub fn old_key(&self) -> Option<SigningKey> {
        self.old.as_ref().map(|old| old.key().duplicate())
    }

    /// Whether there is a key in force so far.
    #[must_use]
    pub fn has_old_key(&self) -> bool {
        self.old.is_some()
    }

    /// The key in force so far, taken back from a rollover whose new key has not been sent.
    #[must_use]
    pub fn into_old(self) -> Option<KeyState> {
        self.old
    }

    /// The key that the vehicle has proved to use, with its clock; both are gone from here then.
    #[must_use]
    pub fn into_key_in_force(self) -> Option<KeyState> {
        match (self.outcome, self.new) {
            (Some(Outcome::Committed), NewKey::Offered(new)) => Some(*new),
            (Some(Outcome::RolledBack), _) => self.old,
            _ => None,
        }
    }

    /// The next event, in order.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// When [`handle_timeout`](Self::handle_timeout) is next needed, in monotonic time.
    #[must_use]
    pub fn poll_timeout(&self) -> Duration {
        let decision = match self.state {
            State::Sent => self.entered.saturating_add(SETTLE),
            State::Staged => self
                .seen
                .first
                .map_or(Duration::MAX, |at| at.saturating_add(ALONE)),
            State::RolledBack => self.entered.saturating_add(GIVE_UP),
            _ => Duration::MAX,
        };
        let heartbeat = match self.peer() {
            Some(_) => self.heartbeat_at,
            None => Duration::MAX,
        };
        match self.outcome {
            Some(_) => heartbeat,
            None => decision.min(heartbeat),
        }
    }

    /// Does what is due by now. Calling it early or late does no harm.
    pub fn handle_timeout(&mut self, now: Now) {
        self.decide(now.mono);
    }

    /// Enters the next state where the evidence or the time requires it.
    pub(super) fn decide(&mut self, mono: Duration) {
        if self.outcome == Some(Outcome::Committed) && self.not_taken(mono) {
            // It had the key and lost it: PX4 lost power before its key file was written.
            (self.outcome, self.tries) = (None, 0);
            self.events.push_back(Event::FellBack);
            self.again(mono);
        }
        if self.outcome.is_some() {
            return;
        }
        let in_state = mono.saturating_sub(self.entered);
        match self.state {
            State::Staged => {
                let alone = self
                    .seen
                    .first
                    .is_some_and(|first| mono.saturating_sub(first) >= ALONE);
                if alone {
                    self.enter(State::WaitDisarm, mono);
                    self.decide(mono);
                }
            }
            // PX4 rejects SETUP_SIGNING while armed, with a STATUSTEXT of severity critical each time.
            State::WaitDisarm if self.config.may_send_key => {
                let disarmed = self
                    .seen
                    .disarmed
                    .is_some_and(|at| mono.saturating_sub(at) < DISARMED_LIFE);
                if disarmed {
                    self.setup_due = true;
                    self.enter(State::Sent, mono);
                }
            }
            State::Sent if in_state >= SETTLE && !self.setup_due => {
                if self.not_taken(mono) || self.is_dragged() {
                    self.again(mono);
                } else {
                    self.enter(State::Unknown, mono);
                }
            }
            State::Unknown if self.not_taken(mono) => self.again(mono),
            State::Unknown if self.is_dragged() => {
                if in_state >= ASK_FAST_FOR {
                    self.tries = 0;
                }
                if self.tries < TRIES {
                    self.again(mono);
                }
            }
            State::RolledBack if in_state >= GIVE_UP => {
                let still_old = self
                    .seen
                    .old
                    .is_some_and(|at| mono.saturating_sub(at) < RECENTLY);
                if still_old {
                    self.end(Outcome::RolledBack);
                } else {
                    // Silence is not a refusal, here either.
                    self.enter(State::Unknown, mono);
                }
            }
            State::WaitDisarm
            | State::Sent
            | State::Unknown
            | State::RolledBack
            | State::NotTaken => {}
            State::Committed => {}
        }
    }

    /// Whether frames prove that the vehicle has not taken the key: two under the old key that are newer
    /// than what could still have been in flight, or two unsigned where nothing verifies. A rollover that may not send
    /// the key concludes nothing from unsigned frames: it could not give the key to a vehicle that has none.
    fn not_taken(&self, mono: Duration) -> bool {
        self.seen.old_newer >= 2 || (self.config.may_send_key && self.vehicle_is_open(mono))
    }

    /// The vehicle sends unsigned frames other than heartbeats: it has no key, or has lost it.
    #[must_use]
    pub fn vehicle_is_open(&self, mono: Duration) -> bool {
        let verified_lately = self
            .seen
            .verified
            .is_some_and(|at| mono.saturating_sub(at) < RECENTLY);
        self.seen.unsigned >= 2 && !verified_lately
    }

    /// NOT_TAKEN: wait for disarmed where that was the reason, else send again, three times in all.
    pub(super) fn again(&mut self, mono: Duration) {
        self.enter(State::NotTaken, mono);
        if core::mem::take(&mut self.seen.refused_armed) {
            // A refusal while armed says nothing about the key, so it costs no try.
            self.tries = self.tries.saturating_sub(1);
        }
        if self.tries < TRIES && self.config.may_send_key {
            // A report from before the last try may be out of date.
            self.seen.disarmed = None;
            self.enter(State::WaitDisarm, mono);
        } else if self.seen.old_newer >= 2 {
            self.enter(State::RolledBack, mono);
        } else if self.is_dragged() {
            // Frames that far ahead can be replays, so nothing is given up; retried later.
            self.enter(State::Unknown, mono);
        } else {
            self.end(Outcome::NeverSigns);
        }
    }

    /// A frame of the vehicle has verified under the new key.
    pub(super) fn commit(&mut self, now: Now) {
        let mono = now.mono;
        if self.state != State::Committed {
            self.enter(State::Committed, mono);
            // Only frames received from now on can prove that the key was lost again.
            (self.seen.old_newer, self.seen.unsigned) = (0, 0);
            self.seen.mark = match &self.new {
                NewKey::Offered(new) => Some(new.clock().reading(now)),
                NewKey::Staged(_) => None,
            };
            self.events.push_back(Event::Commit);
            self.end(Outcome::Committed);
        }
    }

    pub(super) fn end(&mut self, outcome: Outcome) {
        self.outcome = Some(outcome);
        self.setup_due = false;
        self.events.push_back(Event::Ended(outcome));
    }

    pub(super) fn enter(&mut self, state: State, mono: Duration) {
        self.state = state;
        self.entered = mono;
        self.events.push_back(Event::State(state));
    }
}

/// How long only one autopilot must have been on the link: PX4 does not check whom a key is for.
const ALONE: Duration = Duration::from_secs(10);
/// How long a report of the vehicle that it is disarmed is valid.
const DISARMED_LIFE: Duration = Duration::from_millis(1_500);
/// How long after SETUP_SIGNING its effect is judged.
const SETTLE: Duration = Duration::from_secs(2);
const TRIES: u8 = 3;
/// How long UNKNOWN asks at 5 Hz before it asks slowly.
pub(super) const ASK_FAST_FOR: Duration = Duration::from_secs(60);
/// How long frames must come under the old key alone before the new one is given up.
const GIVE_UP: Duration = Duration::from_secs(30);
const RECENTLY: Duration = Duration::from_secs(2);
