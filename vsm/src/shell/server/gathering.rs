//! Lets frames of vehicles gather where they come so fast that waking up for each costs more than handling it, as network cards do
//! with interrupts.
//!
//! From [`DENSE`] frames a second on, the thread stands still for [`PAUSE`] before it waits for its sockets, so that one
//! wake-up serves all that has arrived meanwhile. It adds that time to whatever arrives then, commands of stations too. One vehicle never
//! sends so many; its commands and its telemetry wait for nothing.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Counts what arrives, and waits by it.
#[derive(Debug, Default)]
pub struct Gathering {
    arrived: AtomicU64,
    rate: Mutex<Rate>,
}

impl Gathering {
    /// So many datagrams of vehicles have arrived.
    pub(super) fn count(&self, datagrams: u64) {
        self.arrived.fetch_add(datagrams, Ordering::Relaxed);
    }

    /// To be called by the thread of the sockets when all that has arrived is handled, before it waits for more.
    pub fn gather(&self) {
        let arrived = self.arrived.load(Ordering::Relaxed);
        let mut rate = self.rate.lock().unwrap_or_else(PoisonError::into_inner);
        if rate.is_dense(Instant::now(), arrived) {
            thread::sleep(PAUSE);
        }
    }
}

/// How fast datagrams arrive.
#[derive(Debug, Default)]
struct Rate {
    /// When it was measured last, and how many had arrived by then.
    measured: Option<(Instant, u64)>,
    dense: bool,
}

impl Rate {
    fn is_dense(&mut self, now: Instant, arrived: u64) -> bool {
        let (since, before) = *self.measured.get_or_insert((now, arrived));
        let elapsed = now.saturating_duration_since(since);
        if elapsed >= MEASURED_OVER {
            let a_second = (arrived - before) as f64 / elapsed.as_secs_f64();
            // A rate at the border does not switch it on and off.
            self.dense = a_second >= if self.dense { DENSE / 2.0 } else { DENSE };
            self.measured = Some((now, arrived));
        }
        self.dense
    }
}

/// Datagrams a second: the thread would be woken every 250 us, little less often than it pauses.
const DENSE: f64 = 4_000.0;
/// Far below what a command may wait (20 ms); at 100,000 frames/s some 20 wait in the socket meanwhile.
const PAUSE: Duration = Duration::from_micros(200);
const MEASURED_OVER: Duration = Duration::from_millis(10);

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether it is dense after a tenth of a second of so many datagrams a second, as seen each millisecond.
    fn after(rate: &mut Rate, begin: Instant, arrived: &mut u64, a_second: u64) -> bool {
        (1..=100).fold(false, |_, ms| {
            *arrived += a_second / 1_000;
            rate.is_dense(begin + Duration::from_millis(ms), *arrived)
        })
    }

    #[test]
    fn only_what_comes_fast_gathers_and_no_longer_than_it_does() {
        let (mut rate, mut arrived, begin) = (Rate::default(), 0, Instant::now());
        let at = |n: u32| begin + n * Duration::from_millis(100);
        assert!(!after(&mut rate, at(0), &mut arrived, 0));
        assert!(!after(&mut rate, at(1), &mut arrived, 1_000));
        assert!(!after(&mut rate, at(2), &mut arrived, 3_000));
        assert!(after(&mut rate, at(3), &mut arrived, 20_000));
        // It stays so while they come half as fast, and ends with them.
        assert!(after(&mut rate, at(4), &mut arrived, 3_000));
        assert!(!after(&mut rate, at(5), &mut arrived, 1_000));
        assert!(after(&mut rate, at(6), &mut arrived, 20_000));
        assert!(!rate.is_dense(at(30), arrived));
    }
}
