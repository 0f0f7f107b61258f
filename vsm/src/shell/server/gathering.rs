//! Lets frames of vehicles gather where they come so fast that waking up for each costs more than handling it, as network cards do
//! with interrupts.
//!
//! From [`DENSE`] frames a second on, the thread stands still for [`PAUSE`] before it waits for its sockets, so that one
//! wake-up serves all that has arrived meanwhile. It adds that time to whatever arrives then, commands of stations too. The telemetry of
//! one vehicle never comes so fast; its commands wait for nothing. What does is a mission, parameters or a file, where each frame of the
//! vehicle asks for the next of the bridge: there nothing more comes until that is sent, and a pause would gather nothing. So a frame that is
//! sent to a vehicle counts against one that has arrived, whatever is in it: with many vehicles that are steered less is gathered than
//! could be.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Counts what arrives, and waits by it.
#[derive(Debug, Default)]
pub struct Gathering {
    arrived: AtomicU64,
    sent: AtomicU64,
    rate: Mutex<Rate>,
}

impl Gathering {
    /// So many datagrams of vehicles have arrived.
    pub(super) fn count_arrived(&self, datagrams: u64) {
        self.arrived.fetch_add(datagrams, Ordering::Relaxed);
    }

    /// A frame is sent to a vehicle.
    pub(super) fn count_sent(&self) {
        self.sent.fetch_add(1, Ordering::Relaxed);
    }

    /// To be called by the thread of the sockets when all that has arrived is handled, before it waits for more.
    pub fn gather(&self) {
        if self.is_dense(Instant::now()) {
            thread::sleep(PAUSE);
        }
    }

    fn is_dense(&self, now: Instant) -> bool {
        let [arrived, sent] = [&self.arrived, &self.sent].map(|one| one.load(Ordering::Relaxed));
        let mut rate = self.rate.lock().unwrap_or_else(PoisonError::into_inner);
        rate.is_dense(now, arrived, sent)
    }
}

/// How fast datagrams arrive that answer nothing.
#[derive(Debug, Default)]
struct Rate {
    /// When it was measured last, and how many had arrived and were sent by then.
    measured: Option<(Instant, u64, u64)>,
    dense: bool,
}

impl Rate {
    fn is_dense(&mut self, now: Instant, arrived: u64, sent: u64) -> bool {
        let (since, arrived_before, sent_before) =
            *self.measured.get_or_insert((now, arrived, sent));
        let elapsed = now.saturating_duration_since(since);
        if elapsed >= MEASURED_OVER {
            let of_themselves = (arrived - arrived_before).saturating_sub(sent - sent_before);
            let a_second = of_themselves as f64 / elapsed.as_secs_f64();
            // A rate at the border does not switch it on and off.
            self.dense = a_second >= if self.dense { DENSE / 2.0 } else { DENSE };
            self.measured = Some((now, arrived, sent));
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

    /// Whether it is dense after a tenth of a second of so many datagrams a second each way, as seen each millisecond.
    fn after(gathering: &Gathering, begin: Instant, arrived: u64, sent: u64) -> bool {
        (1..=100).fold(false, |_, ms| {
            gathering.count_arrived(arrived / 1_000);
            (0..sent / 1_000).for_each(|_| gathering.count_sent());
            gathering.is_dense(begin + Duration::from_millis(ms))
        })
    }

    #[test]
    fn only_what_comes_fast_gathers_and_no_longer_than_it_does() {
        let (gathering, begin) = (Gathering::default(), Instant::now());
        let at = |n: u32| begin + n * Duration::from_millis(100);
        assert!(!after(&gathering, at(0), 0, 0));
        assert!(!after(&gathering, at(1), 1_000, 0));
        assert!(!after(&gathering, at(2), 3_000, 0));
        assert!(after(&gathering, at(3), 20_000, 0));
        // It stays so while they come half as fast, and ends with them.
        assert!(after(&gathering, at(4), 3_000, 0));
        assert!(!after(&gathering, at(5), 1_000, 0));
        assert!(after(&gathering, at(6), 20_000, 0));
        assert!(!gathering.is_dense(at(30)));
    }

    #[test]
    fn requests_that_are_answered_do_not_gather() {
        let (gathering, begin) = (Gathering::default(), Instant::now());
        let at = |n: u32| begin + n * Duration::from_millis(100);
        // A mission is uploaded beside the telemetry of its vehicle.
        assert!(!after(&gathering, at(0), 8_000, 8_000));
        assert!(!after(&gathering, at(1), 8_000, 7_000));
        // What is sent beyond them is owed to nobody later.
        assert!(!after(&gathering, at(2), 0, 8_000));
        assert!(after(&gathering, at(3), 20_000, 8_000));
        assert!(!after(&gathering, at(4), 8_000, 8_000));
    }
}
