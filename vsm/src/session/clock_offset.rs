//! How far the clock of a station is from this computer's, by the stamps of what it sends.
//!
//! A message is on its way for a while, and one that is sent again keeps its stamp: each shows the station's clock further
//! behind than it is, never further ahead. So of the messages of some seconds the one that shows it furthest ahead counts.

use std::time::Duration;

/// The clock of one station against ours.
#[derive(Debug, Default)]
pub(crate) struct ClockOffset {
    /// When the present window began.
    began: Option<Duration>,
    /// How far ahead the clock was at most in the window before this, and in this, ms.
    ahead_ms: [Option<i64>; 2],
    /// Messages of both.
    messages: [u32; 2],
    /// What is reported.
    off_ms: Option<i64>,
}

impl ClockOffset {
    /// A message was stamped so far ahead of this computer's clock, ms; negative where it was behind.
    pub(crate) fn note(&mut self, now: Duration, ahead_ms: i64) {
        let began = *self.began.get_or_insert(now);
        if now.saturating_sub(began) >= WINDOW {
            // After a pause what was seen before it is no longer true.
            let fresh = now.saturating_sub(began) < 2 * WINDOW;
            let ([_, last], [_, count]) = (self.ahead_ms, self.messages);
            self.ahead_ms = [last.filter(|_| fresh), None];
            self.messages = [if fresh { count } else { 0 }, 0];
            self.began = Some(now);
        }
        let latest = &mut self.ahead_ms[1];
        *latest = Some(latest.map_or(ahead_ms, |known| known.max(ahead_ms)));
        self.messages[1] = self.messages[1].saturating_add(1);
        if self.messages.iter().sum::<u32>() < MIN_MESSAGES {
            return;
        }
        let [before, latest] = self.ahead_ms;
        let Some(ahead_ms) = before.max(latest) else {
            return;
        };
        self.off_ms = match self.off_ms {
            None => (ahead_ms.unsigned_abs() > OFF_MS).then_some(ahead_ms),
            Some(_) if ahead_ms.unsigned_abs() < RIGHT_MS => None,
            // A text that changed with each message would be an alert each time.
            Some(known) => {
                let moved = known.abs_diff(ahead_ms) > (known.unsigned_abs() / 4).max(STEP_MS);
                Some(if moved { ahead_ms } else { known })
            }
        };
    }

    /// How far it is ahead, ms, negative where it is behind; `None` where it is right within a second.
    pub(crate) fn off_ms(&self) -> Option<i64> {
        self.off_ms
    }
}

/// A clock that is further off than this is reported.
const OFF_MS: u64 = 1_000;
/// Until it is nearer than this.
const RIGHT_MS: u64 = 700;
/// The least change that is reported again.
const STEP_MS: u64 = 1_000;
/// A window: several heartbeats, of which one is not delayed.
const WINDOW: Duration = Duration::from_secs(10);
/// Single messages show no clock: they may be late.
const MIN_MESSAGES: u32 = 5;

#[cfg(test)]
mod tests {
    use super::*;

    /// Messages at 1 Hz that show these offsets.
    fn shown(
        clock: &mut ClockOffset,
        from_s: u64,
        offsets: impl IntoIterator<Item = i64>,
    ) -> Vec<Option<i64>> {
        let noted = offsets.into_iter().zip(from_s..).map(|(ahead_ms, at_s)| {
            clock.note(Duration::from_secs(at_s), ahead_ms);
            clock.off_ms()
        });
        noted.collect()
    }

    #[test]
    fn a_clock_is_off_beyond_a_second_either_way_and_right_again_below() {
        for sign in [1, -1] {
            let mut clock = ClockOffset::default();
            let at_first = shown(&mut clock, 0, [sign * 1_100; 20]);
            assert_eq!(at_first[..4], [None; 4]);
            assert_eq!(at_first[4..], [Some(sign * 1_100); 16]);
            assert_eq!(
                shown(&mut clock, 20, [sign * 800; 30]).last(),
                Some(&Some(sign * 1_100))
            );
            assert_eq!(shown(&mut clock, 50, [sign * 600; 30]).last(), Some(&None));
            assert_eq!(shown(&mut clock, 80, [sign * 900; 30]).last(), Some(&None));
        }
    }

    #[test]
    fn messages_that_are_late_show_no_clock_that_is_off() {
        let mut clock = ClockOffset::default();
        // Seven of eight are sent again for up to 30 s.
        let late = (0..200).map(|n| if n % 8 == 0 { -40 } else { -5_000 * (n % 7) });
        assert!(shown(&mut clock, 0, late).iter().all(Option::is_none));
    }

    #[test]
    fn the_report_does_not_change_with_every_message() {
        let mut clock = ClockOffset::default();
        let reported = shown(&mut clock, 0, (0..120).map(|n| 20_000 + (n * 377) % 900));
        let mut reported: Vec<i64> = reported.into_iter().flatten().collect();
        reported.dedup();
        assert_eq!(reported.len(), 1, "{reported:?}");
        assert_eq!(
            shown(&mut clock, 200, [7_200_000; 20]).last(),
            Some(&Some(7_200_000))
        );
    }
}
