//! Sticks (2010) and their Time Stamps: which were accepted, and their order.
//!
//! They arrive 50 times a second, too many for the memory of commands. Each must be newer than the last. The last
//! [`MAX_TAKEN`] are known exactly, by stamp and 24 bits of their digest: a replay of one is refused however the station's
//! clock was set since, but a different stick with the same stamp is not. Of older sticks, and those from before a restart
//! of the VSM, only the spans of time are known, and no stick within them is accepted.
//!
//! If the station's clock was set back, its sticks are older than the last accepted one. They are accepted again once they
//! have arrived in rising order for [`SETTLE`], without a replay and without a stick newer than the last one in between.
//! Sticks that an attacker held back need the same, and achieve it only if the station's own sticks are blocked.
//!
//! A stick ahead of the station's clock may be genuine, after a clock step, or forged: it is accepted, and sticks that fit
//! the clock are still accepted in their own order, until the clock has followed the step.

use std::collections::VecDeque;
use std::time::Duration;

use stanag_msgs::TimeStamp;

use super::stamps::{NEAR_MS, SETTLE, UsedStamps, stamps_apart_ms};

/// The sticks of one station.
#[derive(Debug, Default)]
pub(crate) struct StickStamps {
    /// The exactly known sticks, in runs with rising stamps; the last one is in use.
    runs: VecDeque<VecDeque<Taken>>,
    /// The last one that was not ahead of the station's clock.
    newest_in_time: Option<TimeStamp>,
    /// Spans of time of all other sticks.
    spans: UsedStamps,
    /// Sticks that are not newer than the last one: the newest of them, its time of arrival, and since when they have been
    /// rising.
    set_back: Option<(TimeStamp, Duration, Duration)>,
    /// Since when every stick was refused.
    refused_since: Option<Duration>,
}

/// An accepted stick: 40 bits of stamp and 24 bits of digest.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Taken(u64);

/// The decision about a stick.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Stick {
    /// Newer than all earlier ones.
    New,
    /// A repetition of an accepted stick.
    Repeated,
    /// Within a span of time in which sticks were accepted.
    Flown,
    /// Older than an accepted stick.
    Older,
}

impl StickStamps {
    /// Decides about a stick that is received now. `ahead`: whether it is ahead of the station's clock.
    pub(crate) fn judge(
        &mut self,
        stamp: TimeStamp,
        digest: [u8; 16],
        ahead: bool,
        now: Duration,
    ) -> Stick {
        let taken = Taken::new(stamp, digest);
        if self
            .runs
            .iter()
            .any(|run| run.binary_search(&taken).is_ok())
        {
            // A replay proves nothing.
            return Stick::Repeated;
        }
        if self.spans.contains(stamp) {
            self.refused(now);
            return Stick::Flown;
        }
        let taken_last = || Some(self.runs.back()?.back()?.stamp());
        let newest = if ahead {
            taken_last()
        } else {
            self.newest_in_time
        };
        if newest.is_none_or(|newest| stamps_apart_ms(stamp, newest) > 0) {
            return Stick::New;
        }
        self.refused(now);
        match &mut self.set_back {
            Some((newest, at, since)) if now.saturating_sub(*at) <= MAX_PAUSE => {
                if stamps_apart_ms(stamp, *newest) > 0 {
                    (*newest, *at) = (stamp, now);
                    if now.saturating_sub(*since) >= SETTLE {
                        // The clock was set back: a new order begins here.
                        self.begin_run();
                        return Stick::New;
                    }
                }
            }
            set_back => *set_back = Some((stamp, now, now)),
        }
        Stick::Older
    }

    /// An authorised stick is accepted. `reading`: the time of the station's clock.
    pub(crate) fn take(&mut self, stamp: TimeStamp, digest: [u8; 16], reading: TimeStamp) {
        let taken = Taken::new(stamp, digest);
        // The counter rolls over: in a run it rises.
        let rises = |run: &VecDeque<Taken>| run.back().is_none_or(|last| *last < taken);
        if !self.runs.back().is_some_and(rises) {
            self.begin_run();
        }
        if let Some(run) = self.runs.back_mut() {
            run.push_back(taken);
        }
        if stamps_apart_ms(stamp, reading) <= NEAR_MS {
            self.newest_in_time = Some(stamp);
        }
        (self.set_back, self.refused_since) = (None, None);
        let known: usize = self.runs.iter().map(VecDeque::len).sum();
        if known > MAX_TAKEN || self.runs.len() > MAX_RUNS {
            self.forget_oldest(reading);
        }
    }

    /// Sticks of an earlier run of the VSM.
    pub(crate) fn restore(&mut self, spans: UsedStamps) {
        self.spans = spans;
    }

    /// A stick is refused for another reason.
    pub(crate) fn refused(&mut self, now: Duration) {
        self.refused_since.get_or_insert(now);
    }

    /// Whether no stick was accepted for so long that it cannot be an accident.
    pub(crate) fn are_refused(&self, now: Duration) -> bool {
        let since = self.refused_since;
        since.is_some_and(|since| now.saturating_sub(since) >= MAX_PAUSE)
    }

    /// How many spans of time, and sticks, are ahead of a clock.
    pub(crate) fn ahead(&self, reading: TimeStamp) -> usize {
        let is_ahead = |taken: &&Taken| stamps_apart_ms(taken.stamp(), reading) > 0;
        let last = self.runs.back().into_iter().flatten().rev();
        self.spans.ahead(reading) + last.take_while(is_ahead).count()
    }

    fn begin_run(&mut self) {
        self.runs.push_back(VecDeque::new());
    }

    /// Keeps only the span of time of the oldest stick, or of the oldest run if there are too many.
    fn forget_oldest(&mut self, reading: TimeStamp) {
        let whole = self.runs.len() > MAX_RUNS;
        while let Some(oldest) = self.runs.front_mut() {
            if let Some(taken) = oldest.pop_front() {
                self.spans.insert(taken.stamp());
                if whole {
                    continue;
                }
            }
            if oldest.is_empty() {
                self.runs.pop_front();
            }
            break;
        }
        self.spans.bound(reading);
    }
}

impl Taken {
    fn new(stamp: TimeStamp, digest: [u8; 16]) -> Taken {
        let [a, b, c, ..] = digest;
        let tag = u64::from(u32::from_be_bytes([0, a, b, c]));
        Taken(((stamp.0 % TimeStamp::PERIOD_MS) << 24) | tag)
    }

    fn stamp(self) -> TimeStamp {
        TimeStamp(self.0 >> 24)
    }
}

/// Number of exactly known sticks: 44 minutes at 50 Hz, in 1 MiB.
const MAX_TAKEN: usize = 131_072;
/// Maximum number of runs, separated by steps of the clock.
const MAX_RUNS: usize = 16;
/// A longer pause ends a stream of sticks.
const MAX_PAUSE: Duration = Duration::from_secs(1);

#[cfg(test)]
mod tests {
    use super::*;

    const NOON: u64 = 850_000_000_000;

    fn ms(ms: u64) -> Duration {
        Duration::from_millis(ms)
    }

    fn digest(n: u64) -> [u8; 16] {
        let mut digest = [0; 16];
        digest[..8].copy_from_slice(&(n << 40).to_be_bytes());
        digest
    }

    /// One stick, which is taken where it is new.
    fn send(sticks: &mut StickStamps, at: u64, stamp: u64, number: u64) -> Stick {
        let (stamp, digest) = (TimeStamp(stamp), digest(number));
        let verdict = sticks.judge(stamp, digest, false, ms(at));
        if verdict == Stick::New {
            sticks.take(stamp, digest, stamp);
        }
        verdict
    }

    #[test]
    fn a_stick_from_the_future_stops_none_that_fits_the_clock() {
        let mut sticks = StickStamps::default();
        for n in 0..500 {
            assert_eq!(send(&mut sticks, 20 * n, NOON + 20 * n, n), Stick::New);
            if n % 10 == 5 {
                let (stamp, forged) = (TimeStamp(NOON + 1_000_000_000 * n), digest(1_000 + n));
                assert_eq!(sticks.judge(stamp, forged, true, ms(20 * n)), Stick::New);
                sticks.take(stamp, forged, TimeStamp(NOON + 20 * n));
            }
        }
    }

    #[test]
    fn sticks_of_a_clock_that_was_set_back_count_in_seconds_and_recordings_never() {
        for back in [3_000, 30_000, 50_000] {
            let mut sticks = StickStamps::default();
            for n in 0..3_000 {
                assert_eq!(send(&mut sticks, 20 * n, NOON + 20 * n, n), Stick::New);
            }
            // The very moments that were flown before, to the millisecond.
            let mut taken = 0;
            for n in 3_000..6_000 {
                let (at, stamp) = (20 * n, NOON + 20 * n - back);
                let verdict = send(&mut sticks, at, stamp, n);
                let set_s = (20 * (n - 3_000)) as f64 / 1_000.0;
                // Or as soon as the clock has passed what was flown.
                let counts_s = 5.0_f64.min(back as f64 / 1_000.0);
                assert_eq!(verdict == Stick::New, set_s >= counts_s, "{back} {set_s} s");
                assert_eq!(sticks.are_refused(ms(at)), (1.0..counts_s).contains(&set_s));
                taken += u32::from(verdict == Stick::New);
                // Each that was recorded in the first pass, whenever it is played.
                for recorded in [n - 3_000, (stamp - NOON) / 20, n - 1_000] {
                    if recorded < 3_000 {
                        let of = NOON + 20 * recorded;
                        let verdict = send(&mut sticks, at + 1, of, recorded);
                        assert_eq!(verdict, Stick::Repeated, "{back} {n} {recorded}");
                    }
                }
            }
            assert!(taken >= 2_750);
        }
    }

    #[test]
    fn of_what_is_not_known_exactly_the_time_stays_used() {
        let mut sticks = StickStamps::default();
        let last = MAX_TAKEN as u64 + 5_000;
        for n in 0..last {
            assert_eq!(send(&mut sticks, 20 * n, NOON + 20 * n, n), Stick::New);
        }
        let known: usize = sticks.runs.iter().map(VecDeque::len).sum();
        assert_eq!(known, MAX_TAKEN);
        let at = 20 * last;
        for n in (0..last).step_by(77) {
            let verdict = send(&mut sticks, at, NOON + 20 * n, n);
            let expected = if n < 5_000 {
                Stick::Flown
            } else {
                Stick::Repeated
            };
            assert_eq!(verdict, expected, "{n}");
        }
        assert!(sticks.runs.len() <= MAX_RUNS && sticks.spans.spans().count() == 1);
    }

    #[test]
    fn single_old_sticks_beside_the_stream_never_begin_another_order() {
        let mut sticks = StickStamps::default();
        for n in 0..2_000 {
            let verdict = send(&mut sticks, 20 * n, NOON + 20 * n, n);
            assert_eq!(verdict, Stick::New, "{n}");
            // Held back for 40 s, and played beside it in their own rhythm.
            let held = NOON - 40_000 + 20 * n;
            assert_ne!(
                send(&mut sticks, 20 * n + 5, held, 1_000_000 + n),
                Stick::New
            );
        }
    }
}
