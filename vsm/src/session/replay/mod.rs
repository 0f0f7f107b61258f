//! A recording as a time line: what is shown of a moment is what was recorded until then, and nothing else.
//!
//! A recording of MAVLink has what the bridge believed of a vehicle and what it sent to it ([`Timeline::frame`]); a recording of the
//! DLI has what stations sent and were sent ([`Timeline::datagram`]). Both are read once, each in its order, into values by
//! time; [`Timeline::status`] and [`Timeline::map`] compose of these what the page shows of a running bridge.
//!
//! - `vehicle`: what a vehicle's frames show: its motion, samples of it, and the plans that were read back from it
//! - `stations`: what the DLI shows: rights, alerts, refusals, commands
//! - `show`: status, map and track at a moment
//!
//! The session's machines are not run again: they would decide anew, and an incident is looked into by what was decided. Signatures are
//! not recorded, so a replay reports none.

mod show;
mod stations;
mod vehicle;

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::frame::FrameView;
use stanag_msgs::Id;

pub use self::show::TrackPoint;
use self::stations::Stations;
use self::vehicle::Vehicle;
use super::log::{LogEntry, LogLevel};

/// A recording, read.
#[derive(Debug, Default)]
pub struct Timeline {
    vehicles: BTreeMap<Id, Vehicle>,
    stations: Stations,
    /// By time, once [`Timeline::end`] has sorted them.
    events: Vec<(Duration, LogEntry)>,
    span: Option<(Duration, Duration)>,
    notes: Vec<String>,
}

impl Timeline {
    /// A recorded frame of this vehicle, or to it.
    pub fn frame(&mut self, of: Id, wall: Duration, frame: &FrameView<'_>) {
        self.extend(wall);
        let vehicle = self.vehicles.entry(of).or_default();
        vehicle.take(of, wall, frame, &mut self.events);
    }

    /// A recorded datagram between a station and the VSM.
    pub fn datagram(&mut self, wall: Duration, from: SocketAddr, bytes: &[u8]) {
        self.extend(wall);
        self.stations.take(wall, from, bytes, &mut self.events);
    }

    /// Something about the recording that whoever looks at it should know.
    pub fn note(&mut self, text: String) {
        self.notes.push(text);
    }

    /// All is read.
    pub fn end(&mut self) {
        // What a vehicle complained of came as alerts to stations too: their recording has it with the alert's priority.
        if self.stations.any() {
            self.events
                .retain(|(_, entry)| !entry.text.starts_with(vehicle::TEXT));
        }
        self.events.sort_by_key(|(at, _)| *at);
        let unread = self.stations.of_edition_25;
        if unread > 0 {
            self.notes.push(format!(
                "{unread} datagrams are of Edition 2.5: rights, alerts and commands of those stations are not shown"
            ));
        }
    }

    /// The first and the last moment, since 1970; `None` of an empty recording.
    #[must_use]
    pub fn span(&self) -> Option<(Duration, Duration)> {
        self.span
    }

    /// What happened, by time.
    #[must_use]
    pub fn events(&self) -> &[(Duration, LogEntry)] {
        &self.events
    }

    fn extend(&mut self, wall: Duration) {
        let (first, last) = self.span.unwrap_or((wall, wall));
        self.span = Some((first.min(wall), last.max(wall)));
    }
}

/// Values of one thing by time: each holds until the next.
#[derive(Debug)]
struct Changes<T>(Vec<(Duration, T)>);

impl<T> Default for Changes<T> {
    fn default() -> Self {
        Changes(Vec::new())
    }
}

impl<T: PartialEq> Changes<T> {
    /// From now on it is this; true where it was not before.
    fn set(&mut self, at: Duration, value: T) -> bool {
        if self.0.last().is_some_and(|(_, last)| *last == value) {
            return false;
        }
        self.push(at, value);
        true
    }
}

impl<T> Changes<T> {
    fn push(&mut self, at: Duration, value: T) {
        // A clock that was set back repeats times: what came later stays later.
        let at = self.0.last().map_or(at, |(last, _)| at.max(*last));
        self.0.push((at, value));
    }

    /// The value at this moment, and since when.
    fn at(&self, moment: Duration) -> Option<&(Duration, T)> {
        let until = self.0.partition_point(|(at, _)| *at <= moment);
        self.0.get(until.checked_sub(1)?)
    }
}

fn entry(level: LogLevel, about: Id, text: String) -> LogEntry {
    LogEntry { level, about, text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_value_holds_until_the_next_also_where_the_clock_was_set_back() {
        let s = Duration::from_secs;
        let mut changes = Changes::default();
        assert!(changes.set(s(10), 'a') && !changes.set(s(11), 'a') && changes.set(s(20), 'b'));
        // Set back by 15 s.
        assert!(changes.set(s(5), 'c'));
        assert_eq!(changes.at(s(9)), None);
        assert_eq!(changes.at(s(19)), Some(&(s(10), 'a')));
        assert_eq!(changes.at(s(20)), Some(&(s(20), 'c')));
        assert_eq!(changes.at(s(12)), Some(&(s(10), 'a')));
    }
}
