//! Which verified datagrams of the other end are answered, and how often.

use std::time::Duration;

use mavlink_link::signing::Stamp;
use stanag_msgs::guard::ClockDatagram;

/// Which of what has verified under a key is answered: each once, one above the other, and so often at most, by the clock of either
/// end.
#[derive(Debug, Default)]
pub(super) struct Turn {
    newest: Stamp,
    next: Duration,
}

impl Turn {
    /// Whether it is the turn of what has this stamp.
    pub(super) fn take(&mut self, stamp: Stamp, now: Duration, every: Duration) -> bool {
        // No stamp twice, and the sender's own lies above all that were recorded of it: whoever replays those gets the answer of each
        // once, and cannot take the one of the sender.
        let later = stamp >= self.newest.plus(every);
        if stamp <= self.newest || (now < self.next && !later) {
            return false;
        }
        (self.newest, self.next) = (stamp, now + every);
        true
    }

    /// It has led to nothing: the next one has its turn sooner.
    pub(super) fn repeat(&mut self, at: Duration) {
        self.next = at;
    }
}

/// What one end has asked the other under a key, and has been asked.
#[derive(Debug, Default)]
pub(super) struct Asked {
    /// Our challenge, and when it was made.
    pub(super) waiting: Option<(ClockDatagram, Duration)>,
    pub(super) challenges: Turn,
    pub(super) answers: Turn,
}
