//! Which verified datagrams of the other end are answered, and how often.

use std::time::Duration;

use mavlink_link::signing::Stamp;
use stanag_msgs::guard::ClockDatagram;

/// Decides which verified datagrams under a key are answered: each stamp once, only rising ones, and at a limited rate by the clock
/// of either end.
#[derive(Debug, Default)]
pub(super) struct Turn {
    newest: Stamp,
    next: Duration,
}

impl Turn {
    /// Whether the datagram with this stamp is answered.
    pub(super) fn take(&mut self, stamp: Stamp, now: Duration, every: Duration) -> bool {
        // No stamp is answered twice, and the sender's own stamp is above all recorded ones: replays get one answer each and
        // cannot use up the answer to the sender.
        let later = stamp >= self.newest.plus(every);
        if stamp <= self.newest || (now < self.next && !later) {
            return false;
        }
        (self.newest, self.next) = (stamp, now + every);
        true
    }

    /// The answer could not be sent: the next one is due sooner.
    pub(super) fn repeat(&mut self, at: Duration) {
        self.next = at;
    }
}

/// The challenges of one end under a key, and its answers to the other's.
#[derive(Debug, Default)]
pub(super) struct Asked {
    /// Our challenge, and when it was made.
    pub(super) waiting: Option<(ClockDatagram, Duration)>,
    pub(super) challenges: Turn,
    pub(super) answers: Turn,
}
