//! What a link has to say beside messages.

use core::time::Duration;
use std::collections::VecDeque;

use crate::frame::{FrameView, Header, MAX_PAYLOAD};
use crate::signing::Stamp;

/// Something that happened on a link.
#[expect(
    clippy::large_enum_variant,
    reason = "boxed, strangers could make us allocate"
)]
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Event<A> {
    /// The peer's address is another one now.
    PeerChanged {
        /// The address before, if any.
        from: Option<A>,
        /// The address now.
        to: A,
    },
    /// The vehicle's stamps have fallen back: its frames verify but are not delivered.
    Behind,
    /// The first frame is accepted, again or at all.
    Live,
    /// A person should know.
    Alert(Alert),
    /// A KEY_EXCHANGE frame, for the key exchange only.
    KeyExchange(KeyExchangeFrame<A>),
}

/// What a person should know; one of a kind is raised at most once in 10 s.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Alert {
    /// The wall clock is more than 366 days beyond the ceiling, and not used until accepted.
    WallFarAhead,
    /// The ceiling of the signing clock cannot be stored: sending and accepting end at the old one.
    CeilingNotStored,
    /// The key's stamps are used up.
    ClockExhausted,
    /// The vehicle's stamps have stayed behind for 5 s, for all our heartbeats.
    StaysBehind,
    /// The autopilot sends unsigned, more than heartbeats: it may have lost its key.
    VehicleUnsigned,
    /// Many frames in the vehicle's name with a wrong signature.
    BadSignatures,
    /// Frames of the vehicle are stamped more than an hour ahead: someone with the key did that.
    Future,
    /// The autopilot's stream has another link id than before.
    LinkIdMoved,
    /// More streams under the key than there are places.
    StreamTableFull,
}

/// A KEY_EXCHANGE frame as it came.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct KeyExchangeFrame<A> {
    /// Where it came from.
    pub from: A,
    /// Its header.
    pub header: Header,
    /// The stamp, where it was verified under the current key.
    pub verified: Option<Stamp>,
    payload: [u8; MAX_PAYLOAD],
    len: usize,
}

impl<A> KeyExchangeFrame<A> {
    pub(super) fn new(from: A, frame: &FrameView<'_>, verified: Option<Stamp>) -> Self {
        let mut payload = [0; MAX_PAYLOAD];
        let len = frame.payload().len();
        payload[..len].copy_from_slice(frame.payload());
        Self {
            from,
            header: frame.header(),
            verified,
            payload,
            len,
        }
    }

    /// The payload as on the wire, trailing zeros trimmed.
    #[must_use]
    pub fn payload(&self) -> &[u8] {
        &self.payload[..self.len]
    }
}

/// Events waiting to be polled; bounded, and allocated once.
#[derive(Debug)]
pub(super) struct Events<A> {
    queue: VecDeque<Event<A>>,
    exchanges: usize,
    raised: [Option<Duration>; ALERTS],
    pub(super) lost: u64,
}

impl<A> Events<A> {
    pub(super) fn new() -> Self {
        Self {
            queue: VecDeque::with_capacity(QUEUE),
            exchanges: 0,
            raised: [None; ALERTS],
            lost: 0,
        }
    }

    pub(super) fn push(&mut self, event: Event<A>) {
        if self.queue.len() < QUEUE {
            self.queue.push_back(event);
        } else {
            self.lost += 1;
        }
    }

    /// Strangers can send these at will, so they may never fill the queue.
    pub(super) fn push_exchange(&mut self, frame: KeyExchangeFrame<A>) {
        if self.exchanges < EXCHANGES && self.queue.len() < QUEUE {
            self.exchanges += 1;
            self.queue.push_back(Event::KeyExchange(frame));
        } else {
            self.lost += 1;
        }
    }

    pub(super) fn alert(&mut self, alert: Alert, mono: Duration) {
        let raised = &mut self.raised[alert as usize];
        if raised.is_none_or(|at| mono.saturating_sub(at) >= ALERT_EVERY) {
            *raised = Some(mono);
            self.push(Event::Alert(alert));
        }
    }

    pub(super) fn pop(&mut self) -> Option<Event<A>> {
        let event = self.queue.pop_front();
        if matches!(event, Some(Event::KeyExchange(_))) {
            self.exchanges -= 1;
        }
        event
    }
}

const QUEUE: usize = 32;
const EXCHANGES: usize = 4;
const ALERTS: usize = Alert::StreamTableFull as usize + 1;
const ALERT_EVERY: Duration = Duration::from_secs(10);
