//! A recording as a time line: what is shown of a moment is what was recorded until then, and nothing else.
//!
//! A recording of MAVLink has what the bridge believed of a vehicle and what it sent to it ([`Timeline::frame`]); a recording of the
//! DLI has what stations sent and were sent ([`Timeline::datagram`]). Both are read once, each in its order, into values by
//! time; [`Timeline::status`] and [`Timeline::map`] compose of these what the page shows of a running bridge.
//!
//! - `changes`: values by time
//! - `vehicle`: what a vehicle's frames show: its motion, samples of it, and the plans that were read back from it
//! - `stations`: what the DLI shows: rights, alerts, refusals, commands
//! - `show`: status, map and track at a moment
//!
//! The session's machines are not run again: they would decide anew, and an incident is looked into by what was decided. Signatures are
//! not recorded, so a replay reports none.

mod changes;
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
use super::log::LogEntry;

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
