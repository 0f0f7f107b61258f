//! The delay of a station's message, as far as it can be measured one-way: how much later it is than the fastest messages of
//! the last minute.
//!
//! [`StationClock`](super::stamps::StationClock) is not enough for messages that must be fresh: it follows the newest stamp,
//! so that a link that delays everything by half a minute shifts it, and a delayed command would look new. The fastest
//! message of a minute is not affected. A message that the clock does not follow, such as a single one with a different
//! time, is ignored here too.
//!
//! More cannot be measured one-way: a link that delays everything evenly for longer than a minute looks like a station whose
//! clock is behind.

use std::time::Duration;

use stanag_msgs::TimeStamp;

/// The delay of a message.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) enum Delay {
    /// Too few messages were received recently, or the station's clock was set.
    #[default]
    Unknown,
    /// Its stamp is ahead of its station's clock.
    Ahead(Duration),
    /// Longer by this than the fastest message of the last minute.
    Behind(Duration),
}

/// The fastest messages of one station.
#[derive(Debug, Clone, Default)]
pub(crate) struct FastestWay {
    /// The fastest of the present half minute, and of the previous one.
    spans: [Option<Fastest>; 2],
    /// When this half began.
    began: Duration,
    /// Since when messages have been received without a longer pause.
    since: Option<Duration>,
}

/// The message whose stamp was the latest relative to its time of arrival.
#[derive(Debug, Clone, Copy)]
struct Fastest {
    stamp: TimeStamp,
    at: Duration,
}

impl Fastest {
    /// How far a stamp that is received now is ahead of this one, carried on by our clock, ms.
    fn lead_ms(&self, stamp: TimeStamp, now: Duration) -> i64 {
        let elapsed = now.saturating_sub(self.at).as_millis();
        stamps_apart_ms(stamp, self.stamp) - i64::try_from(elapsed).unwrap_or(i64::MAX / 2)
    }
}

impl FastestWay {
    /// Notes a message that fits its station's clock.
    pub(super) fn note(&mut self, stamp: TimeStamp, now: Duration) {
        let elapsed = now.saturating_sub(self.began);
        if elapsed >= SPAN {
            let [this, _] = self.spans;
            self.spans = [None, this.filter(|_| elapsed < 2 * SPAN)];
            self.began = now;
        }
        if self.spans == [None; 2] {
            self.since = Some(now);
        }
        let [this, _] = &mut self.spans;
        if this.is_none_or(|one| one.lead_ms(stamp, now) >= 0) {
            *this = Some(Fastest { stamp, at: now });
        }
    }

    /// The station's clock was set: forgets earlier measurements.
    pub(super) fn forget(&mut self) {
        *self = FastestWay::default();
    }

    /// The delay of a message that is received now.
    pub(super) fn delay(&self, stamp: TimeStamp, now: Duration) -> Delay {
        let fresh = self.spans.iter().flatten();
        let fresh = fresh.filter(|one| now.saturating_sub(one.at) < 3 * SPAN);
        let lead_ms = fresh.map(|one| one.lead_ms(stamp, now)).min();
        let measured = self
            .since
            .filter(|since| now.saturating_sub(*since) >= MEASURED);
        let (Some(lead_ms), Some(_)) = (lead_ms, measured) else {
            return Delay::Unknown;
        };
        let by = Duration::from_millis(lead_ms.unsigned_abs());
        if lead_ms > NEAR_MS {
            Delay::Ahead(by)
        } else if lead_ms >= 0 {
            Delay::Behind(Duration::ZERO)
        } else {
            Delay::Behind(by)
        }
    }
}

impl PartialEq for Fastest {
    fn eq(&self, other: &Fastest) -> bool {
        (self.stamp, self.at) == (other.stamp, other.at)
    }
}

/// How much later `one` is than `other`, ms. The counter has 40 bits and rolls over on 2034-11-03: of the two ways round
/// the shorter counts.
pub(crate) fn stamps_apart_ms(one: TimeStamp, other: TimeStamp) -> i64 {
    let forward = one.0.wrapping_sub(other.0) % TimeStamp::PERIOD_MS;
    let signed = i64::try_from(forward).unwrap_or_default();
    if forward < TimeStamp::PERIOD_MS / 2 {
        signed
    } else {
        signed - TimeStamp::PERIOD_MS as i64
    }
}

/// Traffic that is ahead by at most this fits the clock: the first message may have had a longer delay.
pub(crate) const NEAR_MS: i64 = 2_000;
/// Half of the measurement window: a station whose clock was set back by seconds is measured again within a minute.
const SPAN: Duration = Duration::from_secs(30);
/// Delayed messages arrive in one burst: only messages over a longer time show a running clock.
const MEASURED: Duration = Duration::from_secs(3);

#[cfg(test)]
mod tests {
    use super::*;

    const NOON: u64 = 850_000_000_000;

    fn s(seconds: f64) -> Duration {
        Duration::from_secs_f64(seconds)
    }

    fn stamp(seconds: f64) -> TimeStamp {
        TimeStamp(NOON + (seconds * 1e3) as u64)
    }

    /// Heartbeats at 1 Hz, each on its way for `way` seconds.
    fn beats(fastest: &mut FastestWay, from: u32, to: u32, way: f64) {
        for n in from..to {
            fastest.note(stamp(f64::from(n)), s(f64::from(n) + way));
        }
    }

    fn behind(seconds: f64) -> Delay {
        Delay::Behind(s(seconds))
    }

    #[test]
    fn a_message_is_measured_by_the_fastest_of_a_minute() {
        let mut way = FastestWay::default();
        beats(&mut way, 0, 10, 0.1);
        beats(&mut way, 10, 20, 0.6);
        assert_eq!(way.delay(stamp(20.0), s(20.1)), behind(0.0));
        assert_eq!(way.delay(stamp(20.0), s(20.6)), behind(0.5));
        assert_eq!(way.delay(stamp(20.0), s(23.1)), behind(3.0));
        assert_eq!(way.delay(stamp(25.0), s(20.1)), Delay::Ahead(s(5.0)));
        // A little faster than all others is no fault.
        assert_eq!(way.delay(stamp(20.05), s(20.1)), behind(0.0));
    }

    #[test]
    fn a_link_that_holds_everything_back_makes_nothing_fresh() {
        let mut way = FastestWay::default();
        beats(&mut way, 0, 60, 0.1);
        // For 20 s everything waits, and is delivered at once; then continues so late.
        for n in 60..80 {
            way.note(stamp(f64::from(n)), s(80.1));
        }
        assert_eq!(way.delay(stamp(60.5), s(80.1)), behind(19.5));
        beats(&mut way, 80, 85, 20.1);
        assert_eq!(way.delay(stamp(85.0), s(105.1)), behind(20.0));
    }

    #[test]
    fn what_comes_in_one_burst_after_silence_or_a_start_is_not_measured() {
        let mut way = FastestWay::default();
        assert_eq!(way.delay(stamp(0.0), s(0.0)), Delay::Unknown);
        for n in 0..30 {
            way.note(stamp(f64::from(n)), s(30.0));
        }
        assert_eq!(way.delay(stamp(29.0), s(30.0)), Delay::Unknown);
        beats(&mut way, 30, 40, 0.1);
        assert_eq!(way.delay(stamp(40.0), s(40.1)), behind(0.0));
        // Silence for longer than a minute.
        way.note(stamp(50.0), s(200.0));
        assert_eq!(way.delay(stamp(50.0), s(200.0)), Delay::Unknown);
        assert_eq!(way.delay(stamp(51.0), s(202.9)), Delay::Unknown);
    }

    #[test]
    fn a_clock_that_was_set_back_is_measured_anew_within_a_minute() {
        let mut way = FastestWay::default();
        beats(&mut way, 0, 60, 0.1);
        let back = 5.0;
        let mut fresh = None;
        for n in 60..200_u32 {
            let (stamp, at) = (stamp(f64::from(n) - back), s(f64::from(n) + 0.1));
            way.note(stamp, at);
            if way.delay(stamp, at) == behind(0.0) {
                fresh = fresh.or(Some(n));
            } else {
                assert_eq!(way.delay(stamp, at), behind(back));
                assert_eq!(fresh, None);
            }
        }
        assert!(fresh.is_some_and(|n| (90..=121).contains(&n)), "{fresh:?}");
    }

    #[test]
    fn a_clock_that_was_set_is_unknown_until_it_was_measured() {
        let mut way = FastestWay::default();
        beats(&mut way, 0, 60, 0.1);
        way.forget();
        way.note(stamp(5_000.0), s(60.1));
        assert_eq!(way.delay(stamp(5_000.0), s(60.1)), Delay::Unknown);
        way.note(stamp(5_003.0), s(63.1));
        assert_eq!(way.delay(stamp(5_003.0), s(63.1)), behind(0.0));
    }
}
