//! What a link reports beside messages: events, alerts and counters.

use core::time::Duration;
use std::collections::VecDeque;

use crate::frame::{FrameView, Header, MAX_PAYLOAD};
use crate::signing::Stamp;

/// Something that happened on a link.
#[expect(
    clippy::large_enum_variant,
    reason = "if it were boxed, any sender could make us allocate"
)]
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Event<A> {
    /// The peer's address has changed.
    PeerChanged {
        /// The address before, if any.
        from: Option<A>,
        /// The address now.
        to: A,
    },
    /// The vehicle's timestamps have fallen back: its frames verify but are not delivered.
    Behind,
    /// The vehicle's frames verify and are stamped too far ahead: they are not delivered, and it is asked for a proof.
    Ahead,
    /// The first frame is accepted, or the first after [`Event::Behind`] or [`Event::Ahead`].
    Live,
    /// The signing clock has moved up to the vehicle's, which has proved to run so far ahead.
    ClockMet(Duration),
    /// For a person.
    Alert(Alert),
    /// A KEY_EXCHANGE frame, for the key exchange only.
    KeyExchange(KeyExchangeFrame<A>),
}

/// An alert for a person; each kind is raised at most once in 10 s.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Alert {
    /// The wall clock is more than 366 days beyond the ceiling, and not used until accepted.
    WallFarAhead,
    /// The ceiling of the signing clock cannot be stored: sending and accepting stop at the old one.
    CeilingNotStored,
    /// The key's stamps are used up.
    ClockExhausted,
    /// The vehicle's timestamps have stayed behind for 5 s in spite of our heartbeats.
    StaysBehind,
    /// The autopilot sends unsigned, more than heartbeats: it may have lost its key.
    VehicleUnsigned,
    /// Many frames under the vehicle's system id with a wrong signature.
    BadSignatures,
    /// Frames of the vehicle are stamped more than an hour ahead: somebody who has the key did that, or one of the two ends
    /// started with a wrong wall clock.
    Future,
    /// The autopilot's stream has another link id than before.
    LinkIdMoved,
    /// More streams under the key than there are places.
    StreamTableFull,
    /// The vehicle's frames are accepted, but it has received none of ours for 10 s.
    Unanswered,
    /// Frames came from elsewhere before they came from the vehicle: somebody on the way copies them. The link stays.
    Copied,
}

/// A KEY_EXCHANGE frame as received.
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

    /// Anybody can send these, so they may never fill the queue.
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
const ALERTS: usize = Alert::Copied as usize + 1;
const ALERT_EVERY: Duration = Duration::from_secs(10);

/// Declares the counters once, and lists them by name.
macro_rules! counters {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// What one link has received and sent since its start; each drop has its own name.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        pub struct LinkStats { $($(#[$doc])* pub $name: u64,)* }

        impl LinkStats {
            /// Every counter with its name, in a fixed order.
            pub fn iter(&self) -> impl Iterator<Item = (&'static str, u64)> + use<> {
                [$((stringify!($name), self.$name),)*].into_iter()
            }
        }
    };
}

counters! {
    /// Datagrams, or reads of a serial port.
    datagrams,
    /// Bytes in them.
    bytes,
    /// Frames with a correct checksum; on a signed link those of the vehicle without a signature that verifies are left out.
    good_frames,
    /// Candidates with a wrong checksum.
    bad_crc,
    /// Frames with an unknown incompatibility flag.
    unknown_incompat,
    /// MAVLink 1 frames, refused.
    mavlink1,
    /// Frames of a message without known CRC_EXTRA that no signature proves.
    unknown_id,
    /// Frames whose end never came.
    truncated,
    /// Bytes outside any frame.
    garbage_bytes,
    /// Frames with our own system id.
    reflected,
    /// Frames of another system than the vehicle.
    unexpected_system,
    /// Signed frames of a stream that is not on the list of accepted streams.
    not_listed,
    /// Frames of component 1 with another link id than it has here.
    unexpected_link,
    /// Unsigned frames under the vehicle's system id, not of an accepted message.
    unsigned_vehicle,
    /// Unsigned frames of an accepted message from elsewhere than the peer.
    unsigned_stranger,
    /// Frames with the vehicle's system id and a wrong signature.
    bad_signature,
    /// Verified frames of a stream for which the table has no place.
    stream_table_full,
    /// Verified frames stamped more than an hour beyond our base.
    future,
    /// Verified frames stamped at or below the last accepted: replays, reordered frames, or a vehicle that has restarted.
    stale,
    /// Stale frames of the peer among them that somebody else had delivered first, from another address.
    copied,
    /// Verified frames not accepted because the clock's ceiling could not be stored.
    ceiling_not_stored,
    /// Frames on an unsigned link from elsewhere than the peer.
    wrong_peer,
    /// Frames received or to be sent while there was no key.
    no_key,
    /// Frames delivered as verified.
    delivered_verified,
    /// Frames delivered unverified.
    delivered_unverified,
    /// Verified frames that may be older than 60 s; delivered and marked.
    late,
    /// Delivered frames of a message the dialect does not know.
    undecoded_id,
    /// Delivered frames with a value or size that the dialect cannot decode.
    undecoded_value,
    /// KEY_EXCHANGE frames passed to the key exchange.
    key_exchange,
    /// Verified challenges of signing clocks that are apart, PINGs that ask whether we receive, and answers to both.
    clock_pings,
    /// Challenges sent to senders whose frames are stamped too far ahead.
    clock_challenges,
    /// PINGs sent to learn whether the other end receives us.
    receipt_pings,
    /// Challenges and such PINGs of the other end answered.
    clock_answers,
    /// How often our signing clock has moved up to the other end's.
    clock_met,
    /// Events lost because nobody polled for them.
    events_lost,
    /// Frames sent.
    sent,
    /// Bytes of them.
    sent_bytes,
    /// Heartbeats among them.
    sent_heartbeats,
    /// Frames not sent because the signing clock had no timestamp.
    send_refused,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_counter_is_listed_under_its_name() {
        let stats = LinkStats {
            stale: 7,
            ..LinkStats::default()
        };
        assert_eq!(
            stats.iter().filter(|&(_, n)| n > 0).collect::<Vec<_>>(),
            [("stale", 7)]
        );
    }
}
