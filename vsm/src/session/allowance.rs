//! Token buckets: what one sender may cost, so that a flood of one costs nobody else.
//!
//! A bucket is one moment: when it would be full again. Each message moves that by its cost; one that would move it
//! further than [`Rate::burst`] from now is not taken. Nothing has to be counted up as time passes.

use std::time::Duration;

use super::limits::Rate;

/// One bucket, full at first.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Allowance {
    full_at: Duration,
}

impl Allowance {
    /// Whether nothing has been taken out of it lately.
    pub(crate) fn is_full(&self, now: Duration) -> bool {
        self.full_at <= now
    }

    /// When this many can be taken out of it at the earliest.
    pub(crate) fn next_at(&self, rate: Rate, count: u32) -> Duration {
        (self.full_at + rate.cost_of(count)).saturating_sub(rate.burst())
    }

    /// Takes one message out of it; false where there is none left.
    pub(crate) fn take(&mut self, now: Duration, rate: Rate) -> bool {
        self.take_all(now, rate, 1)
    }

    /// Takes this many messages that are sent together, or none; more than a full bucket has are a full bucket.
    pub(crate) fn take_all(&mut self, now: Duration, rate: Rate, count: u32) -> bool {
        let full_at = self.full_at.max(now) + rate.cost_of(count);
        let has = full_at <= now + rate.burst();
        if has {
            self.full_at = full_at;
        }
        has
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RATE: Rate = Rate::one_in(Duration::from_millis(10), 100);

    #[test]
    fn a_bucket_gives_its_burst_and_then_its_rate() {
        let mut bucket = Allowance::default();
        let now = Duration::from_secs(50);
        let taken = (0..1_000).filter(|_| bucket.take(now, RATE)).count();
        assert_eq!(taken, 100);
        let later = now + Duration::from_millis(250);
        let taken = (0..1_000).filter(|_| bucket.take(later, RATE)).count();
        assert_eq!(taken, 25);
        // What is not used does not gather beyond the burst.
        let taken = (0..1_000).filter(|_| bucket.take(Duration::from_secs(900), RATE));
        assert_eq!(taken.count(), 100);
    }

    #[test]
    fn what_is_sent_together_is_taken_together_or_not_at_all() {
        let mut bucket = Allowance::default();
        let now = Duration::from_secs(50);
        let taken = (0..1_000).filter(|_| bucket.take_all(now, RATE, 30));
        assert_eq!(taken.count(), 3);
        assert_eq!((0..1_000).filter(|_| bucket.take(now, RATE)).count(), 10);
        let next = bucket.next_at(RATE, 30);
        assert_eq!(next, now + 30 * RATE.cost);
        assert!(!bucket.take_all(next - RATE.cost, RATE, 30));
        assert!(bucket.take_all(next, RATE, 30));
        // More than fits waits for a full bucket, not for ever.
        let next = bucket.next_at(RATE, 1_000);
        assert!(bucket.take_all(next, RATE, 1_000));
        assert!(!bucket.take(next, RATE));
    }
}
