//! When each report is due for each station: 3001, 3002, 4000 and 4001 from the grant of LOI 2, and reports scheduled by
//! 17001.

use std::collections::BTreeMap;
use std::time::Duration;

/// When each message is next due for each station of one vehicle.
#[derive(Debug, Default)]
pub(super) struct Push {
    due: BTreeMap<(usize, u16), Duration>,
    /// What stations have scheduled by 17001: (station, message type) to period.
    scheduled: BTreeMap<(usize, u16), Period>,
}

/// How often a message goes to a station.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Period {
    /// 17001 with frequency 0: not at all.
    Never,
    Every(Duration),
}

impl Push {
    /// 17001: all of a station's messages are due again.
    pub(super) fn schedule(&mut self, station: usize, message: u16, period: Period) {
        // Keep `Never` too: without an entry the default period of that message would apply.
        self.scheduled.insert((station, message), period);
        self.reset(station);
    }

    /// The station starts or stops listening: its schedule is forgotten.
    pub(super) fn forget(&mut self, station: usize) {
        self.scheduled.retain(|(of, _), _| *of != station);
        self.reset(station);
    }

    /// The station begins to listen: its first reports are due now.
    pub(super) fn begin(&mut self, now: Duration, station: usize) {
        let messages = DEFAULTS.iter().map(|(message, _)| (station, *message));
        self.due.extend(messages.map(|place| (place, now)));
    }

    fn reset(&mut self, station: usize) {
        self.due.retain(|(of, _), _| *of != station);
    }

    /// A message that is due now for a listening station, until there is none. Each is due again a period later.
    /// `payload`: it holds a payload station.
    pub(super) fn next_due(&mut self, now: Duration, station: usize, payload: bool) -> Option<u16> {
        let Push { due, scheduled } = self;
        let own = (station, PAYLOAD.0);
        if !payload && !scheduled.contains_key(&own) {
            // An entry that is never sent would stay in the past, and `poll_timeout` would wake the timer in a busy loop.
            due.remove(&own);
        }
        // What a station has scheduled replaces the default of that message, for that station alone.
        let defaults = DEFAULTS
            .iter()
            .chain(payload.then_some(&PAYLOAD))
            .filter(|(message, _)| !scheduled.contains_key(&(station, *message)))
            .copied();
        let all = scheduled
            .range((station, 0)..=(station, u16::MAX))
            .filter_map(|((_, message), period)| match period {
                Period::Every(period) => Some((*message, *period)),
                Period::Never => None,
            });
        for (message, period) in defaults.chain(all) {
            let due = due.entry((station, message)).or_insert(now);
            if *due > now {
                continue;
            }
            // Keep the phase, unless a pause was longer than the period.
            *due = if *due + period > now {
                *due + period
            } else {
                now + period
            };
            return Some(message);
        }
        None
    }

    /// When the next message is due.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        self.due.values().min().copied()
    }
}

/// Reports pushed without any 17001; 3001 and 3002 on change too. At most 500 ms apart, with a margin for a late timer.
const DEFAULTS: &[(u16, Duration)] = &[
    (3001, Duration::from_millis(400)),
    (3002, Duration::from_millis(400)),
    (4000, Duration::from_millis(200)),
    (4001, Duration::from_millis(400)),
    (16002, Duration::from_millis(1_000)),
];

/// In addition for holders of LOI 3 of a payload station.
const PAYLOAD: (u16, Duration) = (21101, Duration::from_millis(500));

#[cfg(test)]
mod tests {
    use super::*;

    fn ms(millis: u64) -> Duration {
        Duration::from_millis(millis)
    }

    fn due(push: &mut Push, now: Duration, station: usize) -> Vec<u16> {
        let mut messages: Vec<u16> =
            std::iter::from_fn(|| push.next_due(now, station, false)).collect();
        messages.sort_unstable();
        messages
    }

    #[test]
    fn a_new_listener_is_sent_each_report_at_once_and_then_in_its_period() {
        let mut push = Push::default();
        push.begin(ms(0), 0);
        assert_eq!(due(&mut push, ms(0), 0), [3001, 3002, 4000, 4001, 16002]);
        assert!(due(&mut push, ms(0), 0).is_empty());
        assert_eq!(push.poll_timeout(), Some(ms(200)));
        assert_eq!(due(&mut push, ms(200), 0), [4000]);
        assert_eq!(due(&mut push, ms(400), 0), [3001, 3002, 4000, 4001]);
        assert_eq!(
            due(&mut push, ms(1_000), 0),
            [3001, 3002, 4000, 4001, 16002]
        );
    }

    #[test]
    fn a_late_timer_does_not_shift_the_period_and_a_long_pause_is_not_made_up_for() {
        let mut push = Push::default();
        push.begin(ms(0), 0);
        due(&mut push, ms(0), 0);
        assert_eq!(due(&mut push, ms(250), 0), [4000]);
        assert!(due(&mut push, ms(399), 0).is_empty());
        assert!(due(&mut push, ms(400), 0).contains(&4000));
        let after_a_pause = due(&mut push, ms(10_000), 0);
        assert_eq!(after_a_pause, [3001, 3002, 4000, 4001, 16002], "each once");
        assert_eq!(push.poll_timeout(), Some(ms(10_200)));
    }

    #[test]
    fn a_schedule_holds_for_its_station_until_it_no_longer_listens() {
        let mut push = Push::default();
        for station in [0, 1] {
            push.begin(ms(0), station);
            due(&mut push, ms(0), station);
        }
        push.schedule(0, 4000, Period::Never);
        push.schedule(0, 3001, Period::Every(ms(100)));
        push.schedule(0, 101, Period::Every(ms(1_000)));
        assert_eq!(due(&mut push, ms(0), 0), [101, 3001, 3002, 4001, 16002]);
        assert_eq!(due(&mut push, ms(100), 0), [3001]);
        assert_eq!(due(&mut push, ms(200), 0), [3001], "4000 is cancelled");
        assert_eq!(due(&mut push, ms(200), 1), [4000], "by the other");
        push.forget(0);
        assert_eq!(due(&mut push, ms(300), 0), [3001, 3002, 4000, 4001, 16002]);
    }
}
