//! The state of the air side, and what time and messages do to it.

use core::hash::Hash;
use core::time::Duration;
use std::collections::VecDeque;

use zeroize::Zeroizing;

use super::cookies::Cookies;
use super::limits::{Claim, Limits};
use super::sessions::{Arrival, Done, HalfOpen, PairingSlots};
use super::taken::Orders;
use crate::exchange::gate::Gate;
use crate::exchange::identity::{Identity, PublicKey, Random};
use crate::exchange::message::{Data, Inbound, Message, Received, Status, Step, Suite, VERSION};
use crate::exchange::pairing::PairingCode;
use crate::exchange::stats::{ExchangeStats, Ignored};
use crate::exchange::store::{ResponderMemory, ResponderStore, StoreError};
use crate::exchange::terms::{Parties, VehicleState, Wanted};
use crate::signing::KeyId;

/// The settings of a responder.
#[derive(Debug)]
pub struct ResponderConfig {
    /// Both ends' ids.
    pub parties: Parties,
    /// This end's static key.
    pub identity: Identity,
    /// What the keys are for.
    pub wanted: Wanted,
}

/// A message to send.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outbound<A> {
    /// The address.
    pub to: A,
    /// The message; signed where there is a key.
    pub message: Message,
}

/// Something for the agent or for a person.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum ResponderEvent {
    /// A key is staged on disk: install it in the autopilot.
    Staged {
        /// Its name.
        key: KeyId,
        /// The epoch of its exchange.
        epoch: u32,
    },
    /// The staged key is withdrawn; it must not be sent.
    Withdrawn,
    /// A pairing has succeeded, and its window is closed.
    Paired {
        /// The ground side's static key.
        peer: PublicKey,
    },
    /// The pairing window has closed without a pairing.
    WindowClosed,
    /// An attempt in the window used a wrong code; at most once in 10 s, since anyone can cause it.
    WrongCode,
    /// Somebody in the ground's name speaks another version of the exchange; at most once a minute.
    OtherVersion {
        /// The version.
        version: u8,
        /// The frame was verified under the key in force: it is the ground.
        verified: bool,
    },
    /// The disk failed; nothing was answered.
    NotStored(StoreError),
    /// The pinned ground orders this end to zeroize; answer with [`Responder::report_zeroize`].
    Zeroize {
        /// Valid also while the autopilot is not known to be disarmed.
        in_flight: bool,
    },
}

/// Why a pairing window cannot be opened.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum WindowError {
    /// A key is being installed in the autopilot; wait for the outcome.
    #[error("a key is being installed in the autopilot; wait for the outcome")]
    Busy,
    /// The staged key could not be withdrawn.
    #[error("the staged key cannot be withdrawn: {0}")]
    Store(#[from] StoreError),
}

/// The air side of the exchange. `A` is an address on the radio's side.
#[derive(Debug)]
pub struct Responder<A> {
    pub(super) config: ResponderConfig,
    pub(super) memory: ResponderMemory,
    /// The highest counter in a first message of the pinned peer.
    pub(super) highest: u64,
    pub(super) vehicle: VehicleState,
    pub(super) half_open: Option<HalfOpen<A>>,
    pub(super) pairing: Option<Window<A>>,
    pub(super) done: Option<Done<A>>,
    /// The gate of the pinned peer.
    pub(super) gate: Option<Gate>,
    pub(super) cookies: Cookies,
    pub(super) challenges: Cookies,
    pub(super) orders: Orders<A>,
    pub(super) limits: Limits<A>,
    version_noted_at: Option<Duration>,
    pub(super) pleased_at: Option<Duration>,
    pub(super) out: VecDeque<Outbound<A>>,
    pub(super) events: VecDeque<ResponderEvent>,
    pub(super) stats: ExchangeStats,
}

/// An open pairing window.
pub(super) struct Window<A> {
    pub(super) psk: Zeroizing<[u8; 32]>,
    pub(super) gate: Gate,
    wrong_code_at: Option<Duration>,
    pub(super) until: Duration,
    pub(super) slots: PairingSlots<A>,
}

impl<A> core::fmt::Debug for Window<A> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Window")
            .field("until", &self.until)
            .finish_non_exhaustive()
    }
}

impl<A: Copy + Eq + Hash> Responder<A> {
    /// A responder that starts with what an earlier process has stored.
    #[must_use]
    pub fn new(config: ResponderConfig, memory: ResponderMemory, now: Duration) -> Self {
        let peer = memory.peer.as_ref();
        Self {
            gate: peer.and_then(|peer| Gate::of_peers(&config.identity, &peer.key)),
            cookies: Cookies::of_addresses(),
            challenges: Cookies::of_orders(),
            orders: Orders::new(),
            version_noted_at: None,
            config,
            highest: memory.peer.map_or(0, |peer| peer.counter),
            memory,
            vehicle: VehicleState::default(),
            half_open: None,
            pairing: None,
            done: None,
            limits: Limits::new(now),
            pleased_at: None,
            out: VecDeque::new(),
            events: VecDeque::new(),
            stats: ExchangeStats::default(),
        }
    }

    /// What it knows of peer and keys.
    #[must_use]
    pub fn memory(&self) -> &ResponderMemory {
        &self.memory
    }

    /// Counts of what was received and ignored.
    #[must_use]
    pub fn stats(&self) -> &ExchangeStats {
        &self.stats
    }

    /// Sets the state of the vehicle, which is sent in step 2.
    pub fn set_vehicle(&mut self, vehicle: VehicleState) {
        self.vehicle = vehicle;
    }

    /// Opens the window for one pairing with this code, for 10 minutes; closes another open window. Only a person at this
    /// computer may cause it. A staged key that was not sent is withdrawn, and suite 1 waits meanwhile.
    ///
    /// # Errors
    /// A key is being installed in the autopilot, or the disk failed; no window is open then.
    pub fn open_window(
        &mut self,
        now: Duration,
        code: &PairingCode,
        store: &mut dyn ResponderStore,
    ) -> Result<(), WindowError> {
        self.pairing = None;
        // PX4 may already have the staged key, and a pairing would replace it.
        if self.memory.next.is_some_and(|next| next.sent) {
            return Err(WindowError::Busy);
        }
        self.withdraw(store)?;
        // A session of the old peer could otherwise complete inside the window.
        self.half_open = None;
        self.pairing = Some(Window {
            psk: code.psk(),
            gate: Gate::of_code(code),
            wrong_code_at: None,
            until: now.saturating_add(WINDOW),
            slots: PairingSlots::default(),
        });
        Ok(())
    }

    /// Closes the window.
    pub fn close_window(&mut self) {
        self.pairing = None;
    }

    /// How long the window is still open.
    #[must_use]
    pub fn window(&self, now: Duration) -> Option<Duration> {
        let until = self.pairing.as_ref()?.until;
        until.checked_sub(now).filter(|left| !left.is_zero())
    }

    /// The staged key is about to be sent to the autopilot: from now on it is not replaced. Call it before
    /// SETUP_SIGNING leaves.
    pub fn key_sent(&mut self) {
        if let Some(next) = &mut self.memory.next {
            next.sent = true;
        }
        self.report(Status::Sent, 0);
    }

    /// The autopilot signs with the staged key, which the caller has made the current one.
    pub fn key_active(&mut self) {
        if let Some(next) = self.memory.next.take() {
            self.memory.current = Some(next.id);
        }
        self.report(Status::Active, 0);
    }

    /// The autopilot has not taken the key, and the caller has dropped it.
    pub fn key_dropped(&mut self) {
        self.memory.next = None;
        self.report(Status::RolledBack, 0);
    }

    /// Sets another state of the staged key: waiting for disarm, the autopilot silent, unable to sign. The next answer to
    /// step 3 carries it; a responder never sends it on its own.
    pub fn report(&mut self, status: Status, reason: u8) {
        if status == Status::CannotSign
            && let Some(next) = &mut self.memory.next
        {
            // An autopilot that cannot sign has not taken the key.
            next.sent = false;
        }
        if let Some(done) = &mut self.done {
            done.report(status, reason);
        }
    }

    /// A hint that requests an exchange, at most one in 10 s, for the address where the ground was last received.
    pub fn please(&mut self, now: Duration) -> Option<Message> {
        let lately = self
            .pleased_at
            .is_some_and(|at| now.saturating_sub(at) < PLEASE_EVERY);
        let possible = self.memory.peer.is_some() || self.window(now).is_some();
        if lately || !possible {
            return None;
        }
        let sealed = self.hint()?;
        self.pleased_at = Some(now);
        Some(sealed)
    }

    /// Step 0, for a caller that limits how often it is sent.
    pub(crate) fn hint(&self) -> Option<Message> {
        let (suite, gate) = match &self.pairing {
            Some(window) => (Suite::Pairing, &window.gate),
            None => (Suite::Pinned, self.gate.as_ref()?),
        };
        let hint = self.message(suite.to_wire(), 0, Step::Please, Status::Ok);
        gate.seal(&hint, None)
    }

    /// Takes a KEY_EXCHANGE payload from the radio.
    ///
    /// # Errors
    /// Why it was ignored; counted. Some of these are answered by step 15.
    pub fn handle(
        &mut self,
        now: Duration,
        inbound: Inbound<'_, A>,
        random: &mut dyn Random,
        store: &mut dyn ResponderStore,
    ) -> Result<(), Ignored> {
        // Expired sessions are dropped first: otherwise the result would depend on when the caller's timer fires.
        self.handle_timeout(now);
        let result = self.judge(now, inbound, random, store);
        self.stats.count(result);
        result
    }

    fn judge(
        &mut self,
        now: Duration,
        inbound: Inbound<'_, A>,
        random: &mut dyn Random,
        store: &mut dyn ResponderStore,
    ) -> Result<(), Ignored> {
        let parties = &self.config.parties;
        if inbound.source != parties.initiator {
            return Err(Ignored::Source);
        }
        let message = match Message::parse(inbound.payload).map_err(Ignored::Message)? {
            Received::Exchange(message) => message,
            Received::Legacy(_) => return Err(Ignored::Legacy),
        };
        if message.target != parties.responder {
            return Err(Ignored::Target);
        }
        match message.step {
            Step::Offer | Step::Confirm | Step::Order => {}
            // Step 15 is not authenticated, so it is counted and changes nothing.
            Step::Reject => return Err(Ignored::Repeated),
            Step::Please | Step::Answer | Step::Outcome | Step::Cookie | Step::Report => {
                return Err(Ignored::Reflected);
            }
            Step::Unknown(_) => return Err(Ignored::Step),
        }
        let result = self.enter(now, &inbound, &message, random, store);
        self.answer_refusal(now, &inbound, &message, result);
        result
    }

    /// From the gate on. A message without an authenticator of the code or of the pinned keys costs one hash, and ends
    /// here.
    fn enter(
        &mut self,
        now: Duration,
        inbound: &Inbound<'_, A>,
        message: &Message,
        random: &mut dyn Random,
        store: &mut dyn ResponderStore,
    ) -> Result<(), Ignored> {
        if message.version != VERSION {
            self.note_version(now, message.version, inbound.verified);
            return Err(Ignored::Version);
        }
        let suite = Suite::from_wire(message.suite).ok_or(Ignored::Suite)?;
        // A repeated step 3 belongs to a finished session, whose gate may be gone: after a pairing the window is closed.
        let done = self.done.as_ref().filter(|done| {
            message.step == Step::Confirm && done.confirm.session == message.session
        });
        let gate = match (done, suite) {
            (Some(done), _) => &done.gate,
            (None, Suite::Pinned) => self.gate.as_ref().ok_or(Ignored::Suite)?,
            (None, Suite::Pairing) => match &self.pairing {
                Some(window) => &window.gate,
                None if message.step == Step::Confirm => return Err(Ignored::Session),
                None => return Err(Ignored::Window),
            },
        }
        .clone();
        let Some(opened) = gate.open(message) else {
            // Only step 1 shows a wrong code: a session exists only for a step 1 with the right one.
            if (suite, message.step) == (Suite::Pairing, Step::Offer) {
                self.note_wrong_code(now);
            }
            return Err(Ignored::Forged);
        };
        let claim = if inbound.verified {
            Claim::Verified
        } else if self.cookies.prove(&gate, &opened, &inbound.from, now) {
            Claim::Proven
        } else {
            Claim::Nothing
        };
        let arrival = Arrival {
            from: inbound.from,
            claim,
            gate,
        };
        let result = match message.step {
            Step::Offer => self.offered(now, &arrival, suite, &opened.message, random, store),
            Step::Order => self.ordered(now, &arrival, suite, &opened.message, random),
            _ => self.confirmed(now, &arrival, &opened.message, store),
        };
        // Orders are excluded: they are limited in number, not in rate.
        if (result, claim) == (Err(Ignored::Limited), Claim::Nothing) && message.step != Step::Order
        {
            self.ask_for_address(now, &arrival, message, random);
        }
        result
    }

    /// Step 5. It is shorter than the message it answers, so it amplifies nothing.
    fn ask_for_address(
        &mut self,
        now: Duration,
        arrival: &Arrival<A>,
        message: &Message,
        random: &mut dyn Random,
    ) {
        if let Some(cookie) = self.cookies.make(&arrival.from, now, random) {
            let step = self.message(message.suite, message.session, Step::Cookie, Status::Ok);
            let step = Message {
                public_key: message.public_key,
                data: Data::new(&cookie).unwrap_or(Data::EMPTY),
                ..step
            };
            self.send(arrival, &step);
        }
    }

    fn note_wrong_code(&mut self, now: Duration) {
        let Some(window) = &mut self.pairing else {
            return;
        };
        let lately = |at: Duration| now.saturating_sub(at) < WRONG_CODE_EVERY;
        if !window.wrong_code_at.is_some_and(lately) {
            window.wrong_code_at = Some(now);
            self.note(ResponderEvent::WrongCode);
        }
    }

    fn note_version(&mut self, now: Duration, version: u8, verified: bool) {
        let lately = |at: Duration| now.saturating_sub(at) < VERSION_EVERY;
        if !self.version_noted_at.is_some_and(lately) {
            self.version_noted_at = Some(now);
            self.note(ResponderEvent::OtherVersion { version, verified });
        }
    }

    /// Step 15, where it helps an honest peer. An attacker learns nothing new from it.
    fn answer_refusal(
        &mut self,
        now: Duration,
        inbound: &Inbound<'_, A>,
        message: &Message,
        result: Result<(), Ignored>,
    ) {
        let status = match result {
            Err(Ignored::Busy) => Status::Busy,
            Err(Ignored::Session) => Status::UnknownSession,
            Err(Ignored::Version) => Status::OtherVersion,
            Err(Ignored::Suite | Ignored::Window | Ignored::OldCounter) => Status::Refused,
            _ => return,
        };
        let claim = if inbound.verified {
            Claim::Verified
        } else {
            Claim::Nothing
        };
        // An old counter is found after the rate limit has been paid; the other refusals are limited here.
        let paid = matches!(result, Err(Ignored::OldCounter));
        if paid || self.limits.refuse(inbound.from, claim, now) {
            let refusal = Message {
                // An older peer reads its own version only.
                version: message.version,
                ..self.message(message.suite, message.session, Step::Reject, status)
            };
            self.queue(inbound.from, refusal);
        }
    }

    /// Drops what has expired. Calling it early or late is harmless.
    pub fn handle_timeout(&mut self, now: Duration) {
        self.forget_orders(now);
        self.half_open.take_if(|open| open.is_over(now));
        if let Some(window) = &mut self.pairing {
            window.slots.expire(now);
            if now >= window.until {
                self.pairing = None;
                self.note(ResponderEvent::WindowClosed);
            }
        }
    }

    /// When [`handle_timeout`](Self::handle_timeout) is next needed, in monotonic time.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Duration> {
        let half_open = self.half_open.as_ref().map(HalfOpen::until);
        let window = self.pairing.as_ref().map(|window| window.until);
        half_open.into_iter().chain(window).min()
    }

    /// The next message to send, if any.
    pub fn poll_transmit(&mut self) -> Option<Outbound<A>> {
        self.out.pop_front()
    }

    /// What has happened since the last call.
    pub fn poll_event(&mut self) -> Option<ResponderEvent> {
        self.events.pop_front()
    }

    pub(super) fn withdraw(&mut self, store: &mut dyn ResponderStore) -> Result<(), StoreError> {
        if self.memory.next.is_some() {
            store.withdraw_next()?;
            self.memory.next = None;
            self.note(ResponderEvent::Withdrawn);
        }
        self.done = None;
        Ok(())
    }

    pub(super) fn message(&self, suite: u8, session: u32, step: Step, status: Status) -> Message {
        Message {
            public_key: [0; 32],
            session,
            version: VERSION,
            step,
            suite,
            status,
            target: self.config.parties.initiator,
            data: Data::EMPTY,
        }
    }

    /// Sends a message of an exchange, with its authenticator.
    pub(super) fn send(&mut self, arrival: &Arrival<A>, message: &Message) {
        if let Some(sealed) = arrival.gate.seal(message, None) {
            self.queue(arrival.from, sealed);
        }
    }

    pub(super) fn queue(&mut self, to: A, message: Message) {
        // A full queue drops the answer: the initiator repeats its step.
        if self.out.len() < MAX_WAITING {
            self.out.push_back(Outbound { to, message });
        }
    }

    pub(super) fn note(&mut self, event: ResponderEvent) {
        self.events.push_back(event);
        while self.events.len() > MAX_WAITING {
            self.events.pop_front();
        }
    }
}

/// How long a pairing window is open.
const WINDOW: Duration = Duration::from_secs(600);
const WRONG_CODE_EVERY: Duration = Duration::from_secs(10);
const VERSION_EVERY: Duration = Duration::from_secs(60);
const PLEASE_EVERY: Duration = Duration::from_secs(10);
const MAX_WAITING: usize = 16;
