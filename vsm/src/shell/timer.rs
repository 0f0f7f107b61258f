//! A timer of the kernel.
//!
//! A runtime that waits wakes up once for it. For a timer of tokio it wakes up twice where that is more than 64 ms away: its
//! wheel moves the timer to a finer one at the border of 64 ms before.

use std::io;
use std::os::fd::OwnedFd;
use std::time::Duration;

use rustix::io::read;
use rustix::time::{
    Itimerspec, TimerfdClockId, TimerfdFlags, TimerfdTimerFlags, Timespec, timerfd_create,
    timerfd_settime,
};
use tokio::io::Interest;
use tokio::io::unix::AsyncFd;

/// A timer that is set again each time it is waited for.
#[derive(Debug)]
pub(super) struct Timer(AsyncFd<OwnedFd>);

impl Timer {
    /// Must be called within a tokio runtime.
    ///
    /// # Errors
    /// The system's: no more file descriptors.
    pub(super) fn new() -> io::Result<Self> {
        let flags = TimerfdFlags::NONBLOCK | TimerfdFlags::CLOEXEC;
        let timer = timerfd_create(TimerfdClockId::Monotonic, flags)?;
        readable(timer).map(Timer)
    }

    /// Waits so long; may be dropped and called again before that.
    ///
    /// # Errors
    /// The system's.
    pub(super) async fn sleep(&self, pause: Duration) -> io::Result<()> {
        let once = Itimerspec {
            it_interval: Timespec::default(),
            // A time of zero would stop it.
            it_value: (pause.max(Duration::from_nanos(1)))
                .try_into()
                .unwrap_or(LONGEST),
        };
        timerfd_settime(self.0.get_ref(), TimerfdTimerFlags::empty(), &once)?;
        loop {
            let mut ready = self.0.readable().await?;
            // One that ended before it was set again has nothing to be read.
            if let Ok(read) = ready.try_io(|timer| Ok(read(timer.get_ref(), &mut [0; 8])?)) {
                return read.map(drop);
            }
        }
    }
}

/// A descriptor of the kernel that a task waits for until there is something to be read. Must be called within a tokio runtime.
///
/// # Errors
/// The system's.
#[expect(
    deprecated,
    reason = "unsound for a type that shows another descriptor each time, which this one does not; the call in its place is unsafe"
)]
pub(super) fn readable(descriptor: OwnedFd) -> io::Result<AsyncFd<OwnedFd>> {
    AsyncFd::with_interest(descriptor, Interest::READABLE)
}

/// For what is due at no time that a clock shows.
const LONGEST: Timespec = Timespec {
    tv_sec: i64::MAX,
    tv_nsec: 0,
};

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use super::*;

    #[tokio::test]
    async fn it_ends_at_its_time_and_one_that_is_dropped_ends_nothing_else() {
        const MS: Duration = Duration::from_millis(1);
        let timer = Timer::new().unwrap();
        let begin = Instant::now();
        timer.sleep(20 * MS).await.unwrap();
        assert!(begin.elapsed() >= 20 * MS);
        timer.sleep(Duration::ZERO).await.unwrap();
        // It ends while nobody waits for it; the next is not shorter by that.
        let ended = tokio::time::timeout(Duration::ZERO, timer.sleep(5 * MS)).await;
        assert!(ended.is_err());
        tokio::time::sleep(20 * MS).await;
        let begin = Instant::now();
        timer.sleep(20 * MS).await.unwrap();
        assert!(begin.elapsed() >= 20 * MS);
        // Further away than any clock shows.
        let ended = tokio::time::timeout(20 * MS, timer.sleep(Duration::MAX)).await;
        assert!(ended.is_err());
    }
}
