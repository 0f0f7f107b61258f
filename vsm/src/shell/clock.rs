//! The clocks, read for the sessions.

use std::env;
use std::fs;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use mavlink_link::Now;
use rustix::time::{ClockId, clock_gettime};

use crate::session::Boot;

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

    /// The present boot of the computer; `None` where the system does not name it.
    #[must_use]
    pub fn boot(&self) -> Option<Boot> {
        let name = fs::read_to_string("/proc/sys/kernel/random/boot_id").ok();
        let name = name.or_else(|| env::var(BOOT_ID).ok())?;
        Some(Boot {
            id: boot_id(&name)?,
            zero: self.zero(),
        })
    }

    /// The time since boot at which the monotonic time was 0: later by as long as the computer has slept since.
    pub(super) fn zero(&self) -> Duration {
        since_boot().saturating_sub(self.mono())
    }

    /// The instant of a monotonic time.
    #[must_use]
    pub fn instant(&self, mono: Duration) -> Instant {
        self.0 + mono
    }
}

/// The time since boot, sleep of the computer included.
pub(super) fn since_boot() -> Duration {
    let at = clock_gettime(ClockId::Boottime);
    Duration::try_from(at).unwrap_or_default()
}

/// The first 64 bits of a boot's name, which the kernel writes with dashes, and systemd without.
fn boot_id(name: &str) -> Option<u64> {
    let digits: String = name.chars().filter(char::is_ascii_hexdigit).collect();
    u64::from_str_radix(digits.get(..16)?, 16).ok()
}

/// Names the boot where a service manager hides that part of /proc (`packaging/vsm.service`).
const BOOT_ID: &str = "VSM_BOOT_ID";

/// 2026-01-01: no clock of ours starts before the program was written.
pub(super) const NOT_BEFORE: Duration = Duration::from_secs(1_767_225_600);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kernel_and_systemd_name_one_boot() {
        let id = Some(0x9273_c9a0_399d_4857);
        assert_eq!(boot_id("9273c9a0-399d-4857-ade4-86e7b2d900fd\n"), id);
        assert_eq!(boot_id("9273c9a0399d4857ade486e7b2d900fd"), id);
        assert_eq!(boot_id(""), None);
    }

    #[test]
    fn a_later_process_of_one_boot_begins_later() {
        let first = Clock::default();
        std::thread::sleep(Duration::from_millis(20));
        let later = Clock::default();
        let zero = |clock: Clock| clock.boot().expect("the system names its boot").zero;
        let between = zero(later) - zero(first);
        assert!(between >= Duration::from_millis(19), "{between:?}");
        assert_eq!(
            first.boot().map(|boot| boot.id),
            later.boot().map(|boot| boot.id)
        );
    }
}
