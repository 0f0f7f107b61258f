//! Status that goes out unasked: 3001, 3002, 4000 and 4001 from the grant of LOI 2, and what 17001 schedules.

use std::collections::BTreeMap;
use std::time::Duration;

use stanag_msgs::Id;

use super::station::{Period, Station};

/// When each message is next due for each station of one vehicle.
#[derive(Debug, Default)]
pub(crate) struct Push {
    due: BTreeMap<(usize, u16), Duration>,
}

impl Push {
    /// A message that is due now for a listening station, until there is none. Each is due again a period later.
    pub(crate) fn next_due(
        &mut self,
        now: Duration,
        index: usize,
        station: &Station,
        vehicle: Id,
    ) -> Option<u16> {
        for (message, period) in scheduled(station, vehicle) {
            let due = self.due.entry((index, message)).or_insert(now);
            if *due > now {
                continue;
            }
            // Kept in step, unless a pause was longer than the period.
            *due = if *due + period > now {
                *due + period
            } else {
                now + period
            };
            return Some(message);
        }
        None
    }

    /// The station listens no longer, or its schedule has changed: everything is due anew.
    pub(crate) fn reset(&mut self, index: usize) {
        self.due.retain(|(station, _), _| *station != index);
    }

    /// When the next message is due.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        self.due.values().min().copied()
    }
}

fn scheduled(station: &Station, vehicle: Id) -> impl Iterator<Item = (u16, Duration)> + '_ {
    let own = move |message: u16| station.schedule.get(&(vehicle, message)).copied();
    let defaults = DEFAULTS
        .iter()
        .filter_map(move |(message, period)| match own(*message) {
            None => Some((*message, *period)),
            Some(_) => None,
        });
    let scheduled =
        station
            .schedule
            .iter()
            .filter_map(move |((of, message), period)| match period {
                Period::Every(period) if *of == vehicle => Some((*message, *period)),
                _ => None,
            });
    defaults.chain(scheduled)
}

/// What is pushed without any 17001; 3001 on change too. At most 500 ms apart, with room for a late timer.
const DEFAULTS: &[(u16, Duration)] = &[
    (3001, Duration::from_millis(400)),
    (3002, Duration::from_millis(400)),
    (4000, Duration::from_millis(200)),
    (4001, Duration::from_millis(400)),
    (16002, Duration::from_millis(1_000)),
];
