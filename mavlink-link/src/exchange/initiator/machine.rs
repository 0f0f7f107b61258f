//! The state of the ground side, and what time and messages do to it.

use core::time::Duration;
use std::collections::VecDeque;

use super::attempt::{Asking, Attempt, Confirming, Pauses, Promise};
use super::ordering::Ordering;
use crate::Now;
use crate::exchange::gate::{Cookie, Gate};
use crate::exchange::identity::{Identity, PublicKey, Random};
use crate::exchange::message::{Inbound, Message, Received, Status, Step, Suite, VERSION};
use crate::exchange::order::ZeroizeReport;
use crate::exchange::pairing::PairingCode;
use crate::exchange::stats::{ExchangeStats, Ignored};
use crate::exchange::store::{InitiatorMemory, InitiatorStore, StoreError};
use crate::exchange::terms::{Parties, Wanted};
use crate::signing::KeyId;

/// How the initiator and its peer know each other.
#[derive(Debug)]
pub enum Trust {
    /// Suite 1: the peer's static key, pinned by an earlier pairing.
    Pinned(PublicKey),
    /// Suite 2: both ends have been given the same code.
    Pairing(PairingCode),
}

impl Trust {
    pub(super) fn suite(&self) -> Suite {
        match self {
            Self::Pinned(_) => Suite::Pinned,
            Self::Pairing(_) => Suite::Pairing,
        }
    }
}

/// The state of the key that the vehicle signs with. It decides the effect of a request of the peer (step 0).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum KeyInForce {
    /// None, or one that was never seen in use: any request starts an exchange.
    None,
    /// A recently agreed key: no request starts another exchange.
    Young,
    /// A key that may be replaced: only a request that is verified under it starts an exchange.
    Settled,
}

/// The settings of an initiator.
#[derive(Debug)]
pub struct InitiatorConfig {
    /// Both ends' ids.
    pub parties: Parties,
    /// This end's static key.
    pub identity: Identity,
    /// How the peer is known.
    pub trust: Trust,
    /// What the keys are for.
    pub wanted: Wanted,
}

/// Something for a person or for the bridge.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum InitiatorEvent {
    /// An attempt has begun: step 1 may be sent.
    Begun {
        /// Its session.
        session: u32,
    },
    /// `next` is on disk, and the vehicle may sign with it from now on.
    NextStored {
        /// Its name.
        key: KeyId,
    },
    /// The peer holds the same key.
    Agreed {
        /// The key's name.
        key: KeyId,
        /// The peer's static key, proven now.
        peer: PublicKey,
        /// The epoch of the exchange.
        epoch: u32,
    },
    /// The state of the key as the peer reports it, authenticated by the keys of the exchange.
    Status {
        /// What.
        status: Status,
        /// The cause in more detail; 0 where there is none.
        reason: u8,
    },
    /// The peer does not have the key, and it is dropped here too.
    Dropped {
        /// Its status.
        status: Status,
    },
    /// The responder already used `next`: it is the current key now.
    Promoted,
    /// No answer within 10 s; the exchange starts again after a pause.
    GaveUp {
        /// The step that was not answered.
        unanswered: Step,
    },
    /// A refusal in the peer's name. Unauthenticated: reported, and nothing else.
    Rejected {
        /// The status given.
        status: Status,
    },
    /// The disk failed; the attempt has ended.
    NotStored(StoreError),
    /// No random bytes; the attempt has ended.
    NoRandom,
    /// What the peer has done about an order to zeroize; `None` if it did not answer. Occurs twice if it has more to
    /// report.
    Zeroize {
        /// Proven to be of this order.
        report: Option<ZeroizeReport>,
    },
}

impl Promise {
    pub(super) fn event(self) -> InitiatorEvent {
        let Self { key, peer, epoch } = self;
        InitiatorEvent::Agreed { key, peer, epoch }
    }
}

/// The ground side of the exchange with one peer.
#[derive(Debug)]
pub struct Initiator {
    pub(super) config: InitiatorConfig,
    pub(super) memory: InitiatorMemory,
    pub(super) wanted: bool,
    pub(super) phase: Phase,
    pub(super) not_before: Duration,
    pub(super) pauses: Pauses,
    pub(super) hinted_at: Option<Duration>,
    /// The attempt was started by a request that anyone can have sent.
    pub(super) hinted_by_anyone: bool,
    pub(super) in_force: KeyInForce,
    /// The gate of the peer, or of the pairing code.
    pub(super) gate: Option<Gate>,
    /// The cookie with which this attempt proves its address, and how many it has received.
    cookie: Option<Cookie>,
    cookies: u32,
    /// An order to zeroize.
    pub(super) ordering: Option<Ordering>,
    pub(super) due: bool,
    pub(super) events: VecDeque<InitiatorEvent>,
    pub(super) stats: ExchangeStats,
}

#[derive(Debug)]
pub(super) enum Phase {
    Idle,
    Asking(Box<Asking>, Attempt),
    /// Step 3 has been sent and not answered.
    Confirming(Box<Confirming>, Attempt),
    /// Step 4 has been received. Step 3 is sent again from time to time, to learn the state of the key.
    Following(Box<Confirming>, Follow),
}

/// When step 3 is sent next, and when step 4 was received last.
#[derive(Debug, Clone, Copy)]
pub(super) struct Follow {
    pub(super) ask_at: Duration,
    pub(super) answered: Duration,
}

impl Initiator {
    /// An initiator that is idle until [`want`](Self::want) is called.
    #[must_use]
    pub fn new(config: InitiatorConfig, memory: InitiatorMemory, now: Duration) -> Self {
        // An earlier process may have left a session of a pairing half-open at the peer; see `NO_MORE_HALF_OPEN`.
        let pairing = matches!(config.trust, Trust::Pairing(_));
        let not_before = if pairing && memory.next.is_some() {
            now.saturating_add(NO_MORE_HALF_OPEN)
        } else {
            now
        };
        Self {
            memory,
            wanted: false,
            phase: Phase::Idle,
            not_before,
            pauses: Pauses::default(),
            hinted_at: None,
            hinted_by_anyone: false,
            gate: gate(&config),
            cookie: None,
            cookies: 0,
            ordering: None,
            in_force: if pairing || memory.current.is_none() {
                KeyInForce::None
            } else {
                KeyInForce::Settled
            },
            config,
            due: false,
            events: VecDeque::new(),
            stats: ExchangeStats::default(),
        }
    }

    /// Requests an exchange; attempts follow until one succeeds. Does nothing while one is in progress.
    pub fn want(&mut self) {
        self.wanted |= !matches!(self.phase, Phase::Following(..));
        self.hinted_by_anyone = false;
    }

    /// Sets the state of the key that the vehicle signs with. An attempt that was started by an unproven request ends with
    /// the first proof that a key is in use.
    pub fn set_key_in_force(&mut self, key: KeyInForce) {
        self.in_force = key;
        let unproven = matches!(self.phase, Phase::Idle | Phase::Asking(..));
        if key != KeyInForce::None && self.hinted_by_anyone && unproven {
            self.rest();
        }
    }

    /// Whether an exchange is requested or in progress.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        self.wanted || !matches!(self.phase, Phase::Idle)
    }

    /// What it knows of the stored keys.
    #[must_use]
    pub fn memory(&self) -> &InitiatorMemory {
        &self.memory
    }

    /// The settings.
    #[must_use]
    pub fn config(&self) -> &InitiatorConfig {
        &self.config
    }

    /// Counts of what was received and ignored.
    #[must_use]
    pub fn stats(&self) -> &ExchangeStats {
        &self.stats
    }

    /// A frame of the vehicle has verified under `next`, and the caller has made it the current key. That proves the peer
    /// as well as step 4 does.
    ///
    /// # Errors
    /// The peer of a pairing could not be pinned; call it again.
    pub fn key_in_use(&mut self, store: &mut dyn InitiatorStore) -> Result<(), StoreError> {
        // Step 4 was lost, or is still on its way: the frame takes its place.
        if let Phase::Confirming(confirming, _) = &self.phase {
            let agreed = confirming.agreed;
            self.pin(&agreed.peer, store)?;
            self.events.push_back(agreed.event());
        }
        if let Some(next) = self.memory.next.take() {
            self.memory.current = Some(next);
        }
        if matches!(self.phase, Phase::Confirming(..) | Phase::Following(..)) {
            self.rest();
        }
        Ok(())
    }

    /// Takes a KEY_EXCHANGE payload that came from the vehicle's link.
    ///
    /// # Errors
    /// Why it was ignored; counted, and nothing has changed.
    pub fn handle(
        &mut self,
        now: Now,
        inbound: Inbound<'_, ()>,
        store: &mut dyn InitiatorStore,
    ) -> Result<(), Ignored> {
        let result = self.judge(now, inbound, store);
        self.stats.count(result);
        result
    }

    fn judge(
        &mut self,
        now: Now,
        inbound: Inbound<'_, ()>,
        store: &mut dyn InitiatorStore,
    ) -> Result<(), Ignored> {
        let parties = &self.config.parties;
        if inbound.source != parties.responder {
            // The source of a frame is no proof, but a cheap first test: a forged one ends at the gate.
            return Err(Ignored::Source);
        }
        let message = match Message::parse(inbound.payload).map_err(Ignored::Message)? {
            Received::Exchange(message) => message,
            Received::Legacy(_) => return Err(Ignored::Legacy),
        };
        if message.target != parties.initiator {
            return Err(Ignored::Target);
        }
        if message.version != VERSION {
            if message.step == Step::Reject {
                let status = Status::OtherVersion;
                self.events.push_back(InitiatorEvent::Rejected { status });
                self.keep_few_events();
            }
            return Err(Ignored::Version);
        }
        match message.step {
            Step::Please => {
                // Without an authenticator a hint may come from anyone, and does not even show where the peer is.
                let gate = self.gate.as_ref().ok_or(Ignored::Forged)?;
                gate.open(&message).ok_or(Ignored::Forged)?;
                self.hinted(now.mono, inbound.verified)
            }
            // Step 15 is not authenticated: it is reported, and the attempt continues.
            Step::Reject => {
                let status = message.status;
                self.events.push_back(InitiatorEvent::Rejected { status });
                self.keep_few_events();
                Err(Ignored::Repeated)
            }
            Step::Answer | Step::Outcome | Step::Cookie => {
                let message = self.admit(&message)?;
                match message.step {
                    Step::Answer => self.answered(now, &message, store),
                    Step::Cookie => self.take_cookie(&message),
                    _ => self.outcome(now, &message, store),
                }
            }
            Step::Report => self.reported(now.mono, &message),
            // Our own messages, reflected.
            Step::Offer | Step::Confirm | Step::Order => Err(Ignored::Reflected),
            Step::Unknown(_) => Err(Ignored::Step),
        }
    }

    /// A message of the open session, without its authenticator. A message that lacks it has cost one hash.
    fn admit(&self, message: &Message) -> Result<Message, Ignored> {
        let (gate, own) = match &self.phase {
            Phase::Idle => return Err(Ignored::Session),
            Phase::Asking(asking, _) => (&asking.gate, &asking.message),
            Phase::Confirming(confirming, _) | Phase::Following(confirming, _) => {
                (&confirming.gate, &confirming.message)
            }
        };
        if (message.session, message.suite) != (own.session, own.suite) {
            return Err(Ignored::Session);
        }
        let opened = gate.open(message).ok_or(Ignored::Forged)?;
        Ok(opened.message)
    }

    /// Step 5: the responder is under load, and answers only initiators that prove their address.
    fn take_cookie(&mut self, message: &Message) -> Result<(), Ignored> {
        let own = match &self.phase {
            Phase::Asking(asking, _) => &asking.message,
            Phase::Confirming(confirming, _) => &confirming.message,
            Phase::Idle | Phase::Following(..) => return Err(Ignored::Session),
        };
        let cookie: Cookie = (message.data.as_slice().try_into()).map_err(|_| Ignored::Forged)?;
        // A cookie echoes the ephemeral key of our message, so a cookie for another session has no effect.
        if message.public_key != own.public_key || self.cookie == Some(cookie) {
            return Err(Ignored::Repeated);
        }
        // A cookie given to another address is a recording. It makes us send a few messages at most.
        if self.cookies >= MAX_COOKIES {
            return Err(Ignored::Limited);
        }
        self.cookies += 1;
        self.cookie = Some(cookie);
        self.due = true;
        Ok(())
    }

    pub(super) fn forget_cookie(&mut self) {
        (self.cookie, self.cookies) = (None, 0);
    }

    /// Step 0. Anyone can send it, once a second and for days. Where a key is in use it counts only inside a frame that is
    /// verified under that key, and it never replaces a young key.
    fn hinted(&mut self, now: Duration, verified: bool) -> Result<(), Ignored> {
        match self.in_force {
            // There is no key under which a request could be verified.
            KeyInForce::None => {}
            KeyInForce::Settled if verified => {}
            KeyInForce::Settled | KeyInForce::Young => return Err(Ignored::Hint),
        }
        let lately = self
            .hinted_at
            .is_some_and(|at| now.saturating_sub(at) < HINT_EVERY);
        // Any number of hints starts at most one attempt in `HINT_EVERY`.
        if lately || self.is_busy() {
            return Err(Ignored::Limited);
        }
        self.hinted_at = Some(now);
        self.hinted_by_anyone = !verified;
        self.wanted = true;
        Ok(())
    }

    /// Does what is due by now. Calling it early or late is harmless.
    pub fn handle_timeout(
        &mut self,
        now: Now,
        random: &mut dyn Random,
        store: &mut dyn InitiatorStore,
    ) {
        self.time_order(now.mono);
        match &mut self.phase {
            Phase::Idle if self.wanted && now.mono >= self.not_before => {
                self.begin(now, random, store);
            }
            Phase::Idle => {}
            Phase::Asking(_, attempt) if attempt.is_over(now.mono) => {
                self.give_up(now.mono, Step::Offer, random);
            }
            Phase::Confirming(_, attempt) if attempt.is_over(now.mono) => {
                self.give_up(now.mono, Step::Confirm, random);
            }
            Phase::Asking(_, attempt) | Phase::Confirming(_, attempt) => {
                self.due |= attempt.take_due(now.mono);
            }
            Phase::Following(_, follow) => {
                let silent = now.mono.saturating_sub(follow.answered) >= FOLLOW_SILENCE;
                if silent {
                    // The peer may have lost the session, or the key: another exchange finds out.
                    self.fail(now.mono, Duration::ZERO);
                } else if now.mono >= follow.ask_at {
                    follow.ask_at = now.mono.saturating_add(FOLLOW_EVERY);
                    self.due = true;
                }
            }
        }
    }

    /// The peer seems to be reachable and to have no key: sends now what would be sent later. Where the peer requested an
    /// exchange itself (`asked`), an attempt that it may have forgotten starts again. For a caller that limits how often it
    /// does so.
    pub(crate) fn hasten(&mut self, now: Duration, asked: bool) {
        match &self.phase {
            Phase::Idle => self.not_before = self.not_before.min(now),
            Phase::Confirming(confirming, _)
                if asked && now.saturating_sub(confirming.since) >= FORGOTTEN =>
            {
                self.fail(now, Duration::ZERO);
            }
            _ => self.repeat(),
        }
    }

    /// Repeats an unanswered step earlier than an attempt does by itself. For a caller whose link has one purpose, and a
    /// short way.
    pub(crate) fn repeat(&mut self) {
        self.due |= matches!(self.phase, Phase::Asking(..) | Phase::Confirming(..));
    }

    /// The message to send to the peer now, if any; signed where there is a key.
    pub fn poll_transmit(&mut self) -> Option<Message> {
        if let Some(order) = self.poll_order() {
            return Some(order);
        }
        core::mem::take(&mut self.due)
            .then(|| self.step_in_progress())
            .flatten()
    }

    /// The message in progress, which [`poll_transmit`](Self::poll_transmit) repeats, for an address at which the peer may
    /// be too ([`Callers`](crate::exchange::Callers)).
    #[must_use]
    pub fn message_in_progress(&self) -> Option<Message> {
        self.order().or_else(|| self.step_in_progress())
    }

    /// Whether the peer has answered step 1 of what is in progress. It is where that came from: a request, which may be a
    /// recording, says less.
    #[must_use]
    pub fn is_answered(&self) -> bool {
        matches!(self.phase, Phase::Confirming(..) | Phase::Following(..))
    }

    fn step_in_progress(&self) -> Option<Message> {
        let cookie = self.cookie.as_ref();
        match &self.phase {
            Phase::Idle => None,
            Phase::Asking(asking, _) => asking.gate.seal(&asking.message, cookie),
            Phase::Confirming(confirming, _) | Phase::Following(confirming, _) => {
                confirming.gate.seal(&confirming.message, cookie)
            }
        }
    }

    /// What has happened since the last call.
    pub fn poll_event(&mut self) -> Option<InitiatorEvent> {
        self.events.pop_front()
    }

    /// When [`handle_timeout`](Self::handle_timeout) is next needed, in monotonic time.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Duration> {
        let exchange = match &self.phase {
            Phase::Idle => self.wanted.then_some(self.not_before),
            Phase::Asking(_, attempt) | Phase::Confirming(_, attempt) => {
                Some(attempt.poll_timeout())
            }
            Phase::Following(_, follow) => Some(
                follow
                    .ask_at
                    .min(follow.answered.saturating_add(FOLLOW_SILENCE)),
            ),
        };
        exchange.into_iter().chain(self.order_timeout()).min()
    }

    /// The peer is proven: after a pairing, only suite 1 with this key.
    pub(super) fn pin(
        &mut self,
        peer: &PublicKey,
        store: &mut dyn InitiatorStore,
    ) -> Result<(), StoreError> {
        if matches!(self.config.trust, Trust::Pairing(_)) {
            store.pin(peer)?;
            self.config.trust = Trust::Pinned(*peer);
            self.gate = gate(&self.config);
        }
        Ok(())
    }

    fn give_up(&mut self, now: Duration, unanswered: Step, random: &mut dyn Random) {
        let pause = self.pauses.next(random);
        self.fail(now, pause);
        self.events.push_back(InitiatorEvent::GaveUp { unanswered });
        self.keep_few_events();
    }

    /// Ends the attempt; the next one begins after a pause.
    pub(super) fn fail(&mut self, now: Duration, pause: Duration) {
        self.not_before = now.saturating_add(pause);
        // A session of a pairing may still be open at the responder; its late completion would leave the responder with an
        // older key than `next` here.
        if let (Phase::Confirming(confirming, _), Trust::Pairing(_)) =
            (&self.phase, &self.config.trust)
        {
            let dead = confirming.since.saturating_add(NO_MORE_HALF_OPEN);
            self.not_before = self.not_before.max(dead);
        }
        (self.phase, self.due, self.wanted) = (Phase::Idle, false, true);
    }

    /// Nothing more to do until an exchange is requested again.
    pub(super) fn rest(&mut self) {
        (self.phase, self.due, self.wanted) = (Phase::Idle, false, false);
        self.hinted_by_anyone = false;
        self.pauses.reset();
    }

    /// Anyone can cause some of the events, so their number is bounded.
    pub(super) fn keep_few_events(&mut self) {
        while self.events.len() > MAX_EVENTS {
            self.events.pop_front();
        }
    }
}

fn gate(config: &InitiatorConfig) -> Option<Gate> {
    match &config.trust {
        Trust::Pinned(peer) => Gate::of_peers(&config.identity, peer),
        Trust::Pairing(code) => Some(Gate::of_code(code)),
    }
}

/// Cookies accepted in one attempt.
const MAX_COOKIES: u32 = 8;
/// Step 0 starts at most one attempt in this time.
const HINT_EVERY: Duration = Duration::from_secs(10);
/// How often the state of a key is requested.
pub(super) const FOLLOW_EVERY: Duration = Duration::from_secs(5);
/// How long step 4 may be missing before another exchange starts. That exchange does not replace a key that has been sent
/// to the autopilot.
const FOLLOW_SILENCE: Duration = Duration::from_secs(60);
/// After this a session whose step 2 has arrived can no longer be completed at the responder, which drops it after
/// 10 s. In a pairing several sessions are half-open side by side, so that an attacker cannot end an honest one; a late
/// step 3 could complete an older session than the one whose key is `next` here.
const NO_MORE_HALF_OPEN: Duration = Duration::from_secs(12);
/// A step 3 unanswered for so long, while the peer requests another exchange, went to a process that has ended.
const FORGOTTEN: Duration = Duration::from_secs(1);
const MAX_EVENTS: usize = 16;
