//! How old a frame can be at most.
//!
//! A verified frame may have been recorded and held back, so it must not confirm a command or a state unless its age is
//! bounded. PX4 lifts its own timestamps to each heartbeat of ours that reaches it. A frame stamped at or above a
//! heartbeat was therefore made after that heartbeat was sent, and its age is bounded by the time since.

use core::time::Duration;

use crate::signing::Stamp;

/// A bound of a frame's age.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Age {
    /// At most so old.
    AtMost(Duration),
    /// Nothing bounds it: unsigned, or stamped below every heartbeat of the last minute.
    Unknown,
}

impl Age {
    /// Whether the sender can only have made the frame within the last 3 s: no earlier recording can be mistaken
    /// for it.
    #[must_use]
    pub fn is_now(self) -> bool {
        matches!(self, Self::AtMost(age) if age <= NOW)
    }

    /// Whether the frame may be older than 60 s: it may be shown, but confirms nothing.
    #[must_use]
    pub fn is_late(self) -> bool {
        match self {
            Self::AtMost(age) => age > FRESH,
            Self::Unknown => true,
        }
    }
}

/// The stamps of our heartbeats of the last minute and when they were sent.
#[derive(Debug)]
pub(super) struct HeartbeatLog {
    ring: [(Stamp, Duration); HEARTBEATS],
    len: usize,
    next: usize,
}

impl HeartbeatLog {
    pub(super) fn new() -> Self {
        Self {
            ring: [(Stamp::ZERO, Duration::ZERO); HEARTBEATS],
            len: 0,
            next: 0,
        }
    }

    /// Records a heartbeat. One that closely follows another improves no bound and is ignored.
    pub(super) fn record(&mut self, stamp: Stamp, mono: Duration) {
        let newest = self.ring[(self.next + HEARTBEATS - 1) % HEARTBEATS].1;
        // 128 entries 0.5 s apart cover the 60 s of `FRESH`; unspaced, quick heartbeats would shorten that.
        if self.len > 0 && mono.saturating_sub(newest) < SPACING {
            return;
        }
        self.ring[self.next] = (stamp, mono);
        self.next = (self.next + 1) % HEARTBEATS;
        self.len = (self.len + 1).min(HEARTBEATS);
    }

    /// The bound for a frame with this stamp: our largest heartbeat stamp that is not above it.
    pub(super) fn age(&self, stamp: Stamp, mono: Duration) -> Age {
        // Newest first: almost every frame is bounded by the last heartbeat or the one before.
        (1..=self.len)
            .map(|back| self.ring[(self.next + HEARTBEATS - back) % HEARTBEATS])
            .find(|(heartbeat, _)| *heartbeat <= stamp)
            .map_or(Age::Unknown, |(_, sent)| {
                Age::AtMost(mono.saturating_sub(sent))
            })
    }

    /// Whether none was sent within the last minute.
    pub(super) fn bounds_nothing(&self, mono: Duration) -> bool {
        let newest = self.ring[(self.next + HEARTBEATS - 1) % HEARTBEATS].1;
        self.len == 0 || mono.saturating_sub(newest) > FRESH
    }
}

/// The age up to which a frame shows that its sender is live now. Some heartbeats may be lost or late.
const NOW: Duration = Duration::from_secs(3);
/// The age beyond which a frame is late.
const FRESH: Duration = Duration::from_secs(60);
const SPACING: Duration = Duration::from_millis(500);
/// Enough at the closest spacing to reach past [`FRESH`].
const HEARTBEATS: usize = 128;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_largest_heartbeat_not_above_the_frame_bounds_its_age() {
        let mut log = HeartbeatLog::new();
        let s = Duration::from_secs;
        assert_eq!(log.age(Stamp::new(5), s(0)), Age::Unknown);
        for n in 1..=300 {
            log.record(Stamp::new(n * 100_000), s(n));
        }
        assert_eq!(log.age(Stamp::new(29_950_000), s(301)), Age::AtMost(s(2)));
        assert_eq!(log.age(Stamp::new(23_999_999), s(300)), Age::AtMost(s(61)));
        assert!(log.age(Stamp::new(23_999_999), s(300)).is_late());
        assert!(!log.age(Stamp::new(24_000_000), s(300)).is_late());
        assert_eq!(log.age(Stamp::new(100_000), s(300)), Age::Unknown);
    }
}
