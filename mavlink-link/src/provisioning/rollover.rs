//! The machine: where a rollover stands, and what it concludes from frames and time.

use core::time::Duration;
use std::collections::VecDeque;

use thiserror::Error;

use crate::Now;
use crate::frame::{Parser, Stamp};
use crate::link::receiver::KeyState;
use crate::link::{Endpoint, LinkConfig};
use crate::signing::clock::{Ceiling, Origin};
use crate::signing::{KeyId, SigningKey};
use crate::store::{Disk, Store as _, StoreError};

/// The settings of a handover.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KeyRolloverConfig<A> {
    /// The link: the same ids and link id as in flight, for the vehicle keeps every stream it hears.
    pub link: LinkConfig<A>,
    /// A date that cannot be in the future, such as that of the build.
    pub not_before: Stamp,
    /// Whether the link may show the key: if not, it is only found out which key the vehicle has.
    pub may_send_key: bool,
    /// Whether a vehicle that should sign is believed without a signature, from whatever address: a person, or the agent
    /// beside it, says that it has lost its key. Otherwise only the address counts that has proved to be the vehicle.
    pub believe_unsigned: bool,
}

/// Where a handover stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum State {
    /// The new key is on disk; for 10 s nobody but the one vehicle may be heard.
    Staged,
    /// Waits for the vehicle's word that it is disarmed.
    WaitDisarm,
    /// SETUP_SIGNING is out, and heartbeats under both keys.
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

/// Something to do or to tell.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Event {
    /// It has moved to this state.
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
    /// The vehicle had the new key and has it no more: its power was cut while it wrote its key file.
    FellBack,
    /// It is over.
    Ended(Outcome),
}

/// How a handover ended. Silence is no end.
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

/// Why a handover cannot begin.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum StartError {
    /// The clock of the new key cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// No frame could tell which of the two it was signed with.
    #[error("the new key is the current one, expected another")]
    SameKey,
}

/// One handover of one key to one vehicle. `A` is an address.
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
    pub(super) parser: Parser,
    pub(super) peer: Option<A>,
    pub(super) seq: u8,
    pub(super) seen: Seen,
    pub(super) heartbeat_at: Duration,
    /// The next alternating heartbeat goes under the new key.
    pub(super) new_next: bool,
    pub(super) setup_due: bool,
    /// Where a frame came from that verified and was behind.
    pub(super) lift: Option<(KeySlot, A)>,
    pub(super) lifted_at: Option<Duration>,
    pub(super) events: VecDeque<Event>,
    pub(super) outcome: Option<Outcome>,
}

/// The key to be handed over.
#[derive(Debug)]
pub(super) enum NewKey {
    /// Never sent: nothing can have been signed with it.
    Staged(SigningKey),
    /// Sent at least once; frames may verify under it.
    Offered(Box<KeyState>),
}

/// Which key a frame goes or came under.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeySlot {
    /// The key in force so far.
    Old,
    /// The key that is handed over.
    New,
}

/// What has been heard of the vehicle.
#[derive(Debug, Default)]
pub(super) struct Seen {
    /// The first believed frame.
    pub(super) first: Option<Duration>,
    /// The last frame that verified, under either key.
    pub(super) verified: Option<Duration>,
    /// The last frame under the old key, or unsigned where there is no old key.
    pub(super) old: Option<Duration>,
    /// Frames under the old key, made after the last SETUP_SIGNING was a replay.
    pub(super) old_newer: u32,
    /// Unsigned frames of the autopilot other than heartbeats, since the last SETUP_SIGNING.
    pub(super) unsigned: u32,
    /// Frames under the old key with stamps beyond what is followed: its clock was dragged ahead, or they are replays
    /// from when it was. They show that the key was perhaps not taken, never that it was refused.
    pub(super) future: u32,
    /// Frames in the vehicle's name under neither key.
    pub(super) foreign: u64,
    /// Frames in the vehicle's name, without a signature, from where nothing has verified.
    pub(super) disbelieved: u64,
    /// When it last said that it is disarmed; `None` once it says armed.
    pub(super) disarmed: Option<Duration>,
    /// It said that it refuses while armed.
    pub(super) refused_armed: bool,
    /// Stamp of our first heartbeat under the old key after the last SETUP_SIGNING.
    pub(super) mark: Option<Stamp>,
}

impl<A: Copy + Eq> KeyRollover<A> {
    /// Begins, or goes on where an earlier process was ended: a key that the store has a clock of has
    /// been sent before, so nothing is known of it, and the state is [`State::Unknown`]. So it is where
    /// the key may not be sent from here.
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
        // Who may not send the key only asks, and cannot tell a key that was never sent from one whose clock was lost.
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
            peer,
            seq: 0,
            seen: Seen::default(),
            heartbeat_at: now.mono,
            new_next: false,
            setup_due: false,
            lift: None,
            lifted_at: None,
            events: VecDeque::from([Event::State(state)]),
            outcome: None,
        })
    }

    /// Where it stands.
    #[must_use]
    pub fn state(&self) -> State {
        self.state
    }

    /// When it came to its state, in the caller's monotonic time.
    #[must_use]
    pub fn entered_at(&self) -> Duration {
        self.entered
    }

    /// How it ended, once it has. Heartbeats go on; a vehicle that loses the key again takes the end back.
    #[must_use]
    pub fn outcome(&self) -> Option<Outcome> {
        self.outcome
    }

    /// Names the key that is handed over.
    #[must_use]
    pub fn new_id(&self) -> KeyId {
        match &self.new {
            NewKey::Staged(key) => key.id(),
            NewKey::Offered(key) => key.id(),
        }
    }

    /// Whom it talks to, once that is known.
    #[must_use]
    pub fn peer(&self) -> Option<A> {
        self.peer
    }

    /// Frames in the vehicle's name that neither key has signed: it may have a third one.
    #[must_use]
    pub fn foreign_frames(&self) -> u64 {
        self.seen.foreign
    }

    /// Frames in the vehicle's name without a signature that were not believed: it may have lost its key.
    #[must_use]
    pub fn disbelieved_frames(&self) -> u64 {
        self.seen.disbelieved
    }

    /// Whether the vehicle has not taken the key and signs with stamps far ahead of what is followed, or what speaks in its
    /// name are recordings from when it did. Whoever dragged its clock may have done it on our own stream: then it takes
    /// nothing of ours before it has restarted.
    #[must_use]
    pub fn is_dragged(&self) -> bool {
        self.clock_is_dragged()
    }

    /// Whether anything of the vehicle has been believed.
    #[must_use]
    pub fn has_heard(&self) -> bool {
        self.seen.first.is_some()
    }

    /// One of the two keys with its clock, lent to whoever verifies others by it meanwhile. There is none
    /// for a vehicle that did not sign, and no new one before it has been sent.
    pub fn key_mut(&mut self, under: KeySlot) -> Option<&mut KeyState> {
        match (under, &mut self.new) {
            (KeySlot::Old, _) => self.old.as_mut(),
            (KeySlot::New, NewKey::Offered(new)) => Some(new),
            (KeySlot::New, NewKey::Staged(_)) => None,
        }
    }

    /// Whether nothing has been sent of the new key, by this process or one before it: it may be exchanged for
    /// another.
    #[must_use]
    pub fn is_unsent(&self) -> bool {
        matches!(self.new, NewKey::Staged(_))
    }

    /// A copy of the key that is handed over.
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

    /// The key in force so far, taken back from a handover whose key has not been sent.
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

    /// The next thing to tell or to do, in order.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// When [`handle_timeout`](Self::handle_timeout) wants to be called, in monotonic time.
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
        let heartbeat = match self.peer {
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

    /// Moves on where what has been seen, or the time, says so.
    pub(super) fn decide(&mut self, mono: Duration) {
        if self.outcome == Some(Outcome::Committed) && self.not_taken(mono) {
            // It had the key and lost it: its power was cut before its file was on its disk.
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
                if self.not_taken(mono) || self.clock_is_dragged() {
                    self.again(mono);
                } else {
                    self.enter(State::Unknown, mono);
                }
            }
            State::Unknown if self.not_taken(mono) => self.again(mono),
            State::Unknown if self.clock_is_dragged() => {
                if in_state >= ASK_FAST_FOR {
                    self.tries = 0;
                }
                if self.tries < TRIES {
                    self.again(mono);
                }
            }
            State::RolledBack if in_state >= GIVE_UP => {
                let heard = self
                    .seen
                    .old
                    .is_some_and(|at| mono.saturating_sub(at) < HEARD_LATELY);
                if heard {
                    self.end(Outcome::RolledBack);
                } else {
                    // Silence is no refusal, here either.
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

    /// Whether frames show that the vehicle has not taken the key: two under the old key that are newer
    /// than what could still have been on its way, or two unsigned where nothing verifies. Whoever may only
    /// ask decides nothing by what is unsigned: the key could not be given to a vehicle that has none.
    pub(super) fn not_taken(&self, mono: Duration) -> bool {
        self.seen.old_newer >= 2 || (self.config.may_send_key && self.vehicle_is_open(mono))
    }

    /// Frames under the old key are beyond what can be followed, so none can be newer than a stamp of ours: the key is
    /// sent again, since it mends that.
    pub(super) fn clock_is_dragged(&self) -> bool {
        self.config.may_send_key && self.seen.future >= 2
    }

    /// The vehicle sends unsigned, more than heartbeats: it has no key, or has lost it.
    #[must_use]
    pub fn vehicle_is_open(&self, mono: Duration) -> bool {
        let verified_lately = self
            .seen
            .verified
            .is_some_and(|at| mono.saturating_sub(at) < HEARD_LATELY);
        self.seen.unsigned >= 2 && !verified_lately
    }

    /// NOT_TAKEN: wait for disarmed where that was the reason, else send again, three times in all.
    pub(super) fn again(&mut self, mono: Duration) {
        self.enter(State::NotTaken, mono);
        if core::mem::take(&mut self.seen.refused_armed) {
            self.tries = self.tries.saturating_sub(1);
        }
        if self.tries < TRIES && self.config.may_send_key {
            // A word from before the last try says nothing of now.
            self.seen.disarmed = None;
            self.enter(State::WaitDisarm, mono);
        } else if self.seen.old_newer >= 2 {
            self.enter(State::RolledBack, mono);
        } else if self.clock_is_dragged() {
            // Frames that far ahead can be replays, so nothing is given up; it is tried again later.
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
            // Only what is said from now on can show that the key was lost again.
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
/// How long the vehicle's word that it is disarmed holds.
const DISARMED_LIFE: Duration = Duration::from_millis(1_500);
/// How long after SETUP_SIGNING the frames are judged.
const SETTLE: Duration = Duration::from_secs(2);
const TRIES: u8 = 3;
/// How long UNKNOWN asks at 5 Hz before it asks slowly.
pub(super) const ASK_FAST_FOR: Duration = Duration::from_secs(60);
/// How long frames under the old key alone must go on before the new one is given up.
const GIVE_UP: Duration = Duration::from_secs(30);
const HEARD_LATELY: Duration = Duration::from_secs(2);
