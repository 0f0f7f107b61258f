//! The rate limit of bytes and messages, as configured, and the kinds of messages that it distinguishes.

use std::time::Duration;

use stanag_msgs::messages::{MessageAcknowledgement, VsmAuthorisationResponse};

use crate::session::limits::Limits;
use crate::session::outbox::Datagram;

/// The kind of a message, by importance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// 17000 and 2: the answers to commands and requests. Alerts about others leave credit for these.
    Acknowledgement,
    /// Another answer, or an alert: it waits if it has no credit.
    Answer,
    /// A report of this type: the next one replaces it.
    Report(u16),
}

impl Kind {
    /// The kind of a datagram that is not a report.
    pub(crate) fn of_answer(datagram: &Datagram) -> Kind {
        match datagram.message_type() {
            MessageAcknowledgement::ID | VsmAuthorisationResponse::ID => Kind::Acknowledgement,
            _ => Kind::Answer,
        }
    }
}

/// A rate with a burst: the time at which everything sent so far would have been paid for.
#[derive(Debug, Default)]
pub(super) struct Rate {
    bytes: Duration,
    messages: Duration,
}

impl Rate {
    /// Whether it may be sent now. Reports leave the last part of the burst to answers.
    pub(super) fn take(
        &mut self,
        now: Duration,
        bytes: usize,
        kind: Kind,
        limits: &Limits,
    ) -> bool {
        if !self.has_room(now, kind, limits) {
            return false;
        }
        let nanos = |count: u64, a_second: u32| {
            Duration::from_nanos(count * 1_000_000_000 / u64::from(a_second.max(1)))
        };
        self.bytes = self.bytes.max(now) + nanos(bytes as u64, limits.bytes_s);
        self.messages = self.messages.max(now) + nanos(1, limits.messages_s);
        true
    }

    /// Whether [`Rate::take`] would allow it.
    pub(super) fn has_room(&self, now: Duration, kind: Kind, limits: &Limits) -> bool {
        let burst = match kind {
            Kind::Report(_) => limits.burst / 2,
            _ => limits.burst,
        };
        let paid = |at: Duration| at.saturating_sub(now) <= burst;
        paid(self.bytes) && paid(self.messages)
    }

    /// Corrects a charge: the datagram that was charged as `taken` bytes has `bytes`.
    pub(super) fn settle(&mut self, taken: usize, bytes: usize, limits: &Limits) {
        let a_second = u64::from(limits.bytes_s.max(1));
        let nanos = |bytes: usize| Duration::from_nanos(bytes as u64 * 1_000_000_000 / a_second);
        self.bytes = (self.bytes + nanos(bytes)).saturating_sub(nanos(taken));
    }
}
