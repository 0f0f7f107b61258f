//! The contingencies named by waypoints of Edition 2.5, kept over a restart: `contingencies-VVVVVVVV-CCCCCCCC.log` for a
//! vehicle and the station that has sent them. The plan itself has no place for them ([`editions`](crate::session)).
//!
//! A line is written before its #802 is acknowledged, and is as durable as the plan. If writing fails the upload continues;
//! a load after a restart then names the waypoint that must be sent again.

use mavlink_link::store::{Disk, Durability, MAX_RECORD_BYTES};
use stanag_msgs::Id;

use super::Bridge;
use crate::session::editions::{Contingencies, Kept};
use crate::session::log::{LogEntry, LogLevel};

impl Bridge {
    /// Reads what earlier processes have written, for stations and vehicles that were not served before.
    pub(super) fn restore_contingencies(&mut self, disk: &dyn Disk) {
        for station in &mut self.stations {
            let id = station.id();
            for vehicle in self.aircraft.iter().map(|one| one.id()) {
                if station.translator.has_plan(vehicle) {
                    continue;
                }
                match disk.read_whole(&file(vehicle, id), MAX_RECORD_BYTES) {
                    // Noted as known, so that a reload does not read it again.
                    Ok(None) => station.translator.restore(vehicle, ""),
                    Ok(Some(bytes)) => {
                        let text = String::from_utf8_lossy(&bytes);
                        station.translator.restore(vehicle, &text);
                    }
                    // A load will name the missing waypoints: this is no reason to stop serving.
                    Err(fault) => self.records.log.push_back(LogEntry {
                        level: LogLevel::Warning,
                        about: vehicle,
                        text: fault.to_string(),
                    }),
                }
            }
        }
    }

    /// The plan holds a waypoint of Edition 2.5.
    pub(super) fn keep_contingencies(
        &mut self,
        index: usize,
        vehicle: Id,
        waypoint: Contingencies,
        disk: &mut dyn Disk,
    ) {
        let station = &mut self.stations[index];
        let name = file(vehicle, station.id());
        let cucs = station.id();
        let of_it = self.aircraft.find(vehicle);
        let holds = |number| of_it.is_some_and(|one| one.mission.holds(cucs, number));
        let written = match station.translator.stored(vehicle, waypoint, holds) {
            None => return,
            Some(Kept::Line(line)) => disk.append(&name, line.as_bytes(), Durability::Process),
            Some(Kept::All(all)) => disk.replace(&name, all.as_bytes(), Durability::Process),
        };
        if written.is_err() {
            self.counters.count("contingency of a waypoint not stored");
        }
    }
}

fn file(vehicle: Id, station: Id) -> String {
    format!("contingencies-{:08x}-{:08x}.log", vehicle.0, station.0)
}
