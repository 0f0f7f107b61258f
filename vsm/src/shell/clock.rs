//! The two clocks, read for the sessions.

use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use mavlink_link::Now;

/// Monotonic time since its creation, and the wall clock.
#[derive(Debug, Clone, Copy)]
pub struct Clock(Instant);

impl Default for Clock {
    fn default() -> Self {
        Clock(Instant::now())
    }
}

impl Clock {
    /// Both clocks now. A wall clock before 1970 reads as 1970.
    #[must_use]
    pub fn now(&self) -> Now {
        Now {
            mono: self.mono(),
            wall: SystemTime::now()
                .duration_since(UNIX_EPOCH)
                // The signing clock does not start before `NOT_BEFORE`, so a clock that is not set is harmless.
                .unwrap_or_default(),
        }
    }

    /// Monotonic time now.
    #[must_use]
    pub fn mono(&self) -> Duration {
        self.0.elapsed()
    }

    /// The instant of a monotonic time.
    #[must_use]
    pub fn instant(&self, mono: Duration) -> Instant {
        self.0 + mono
    }
}

/// 2026-01-01: no clock of ours starts before the program was written.
pub(super) const NOT_BEFORE: Duration = Duration::from_secs(1_767_225_600);
