//! A virtual clock: time passes only when a test advances it.
//!
//! A process reads two clocks. The monotonic one starts with the process; the wall clock may be stepped while it runs.
//! [`VirtualClock`] keeps both, so that a test can restart a process or step the clock and everything else stays as it is.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use mavlink_link::Now;

/// 2026-01-01 00:00 UTC: what the wall clock of most tests shows at their start.
pub const START: Duration = Duration::from_secs(1_767_225_600);

/// Time since 1970 by the clock of this computer, for tests in real time.
///
/// # Panics
/// The clock is before 1970.
pub fn wall() -> Duration {
    let wall = SystemTime::now().duration_since(UNIX_EPOCH);
    wall.expect("after 1970")
}

/// The clocks of one process under test.
#[derive(Debug, Clone)]
pub struct VirtualClock {
    elapsed: Duration,
    process_started: Duration,
    wall_start: Duration,
    wall_step_s: f64,
}

impl Default for VirtualClock {
    fn default() -> Self {
        VirtualClock::starting_at(START)
    }
}

impl VirtualClock {
    /// A clock at the start of a test, its wall clock at this time since 1970.
    pub fn starting_at(wall: Duration) -> Self {
        VirtualClock {
            elapsed: Duration::ZERO,
            process_started: Duration::ZERO,
            wall_start: wall,
            wall_step_s: 0.0,
        }
    }

    /// Time since the start of the test. Neither a restart nor a step of the wall clock changes it.
    pub fn elapsed(&self) -> Duration {
        self.elapsed
    }

    /// Both clocks, as the process reads them.
    pub fn now(&self) -> Now {
        let wall_s = self.wall_start.as_secs_f64() + self.elapsed.as_secs_f64() + self.wall_step_s;
        Now {
            mono: self.elapsed - self.process_started,
            wall: Duration::from_secs_f64(wall_s),
        }
    }

    /// Lets this much time pass.
    pub fn advance(&mut self, by: Duration) {
        self.elapsed += by;
    }

    /// Steps the wall clock: from now on it is off by this many seconds, forwards or backwards.
    pub fn set_wall_step(&mut self, seconds: f64) {
        self.wall_step_s = seconds;
    }

    /// Restarts the process: its monotonic clock begins at zero.
    pub fn restart_process(&mut self) {
        self.process_started = self.elapsed;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_restart_resets_the_monotonic_clock_and_a_step_moves_the_wall_clock() {
        let mut clock = VirtualClock::default();
        clock.advance(Duration::from_secs(5));
        clock.set_wall_step(-3600.0);
        clock.restart_process();
        clock.advance(Duration::from_secs(2));
        assert_eq!(clock.elapsed(), Duration::from_secs(7));
        assert_eq!(clock.now().mono, Duration::from_secs(2));
        assert_eq!(
            clock.now().wall,
            START + Duration::from_secs(7) - Duration::from_secs(3600)
        );
    }
}
