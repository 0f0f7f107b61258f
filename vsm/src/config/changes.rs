//! What a reloaded configuration changes in a running bridge, and what waits for a restart.
//!
//! A running bridge keeps its addresses, its store and its identity, and a vehicle keeps its link and its key. Everything
//! else in a new file is applied. The file is applied as a whole or not at all: if the applicable part does not fit what
//! the bridge keeps, it is refused.

use serde::{Deserialize, Serialize};
use stanag_msgs::Id;

use super::bridge::Config;
use super::error::Fault;
use super::forward::Forward;
use super::station::Cucs;
use super::vehicle::Vehicle;

/// From one configuration to the next.
#[derive(Debug, Clone)]
pub struct Changes {
    /// What the bridge continues with: the new configuration, with what it keeps until a restart.
    pub config: Config,
    /// The report for the operator.
    pub report: Report,
}

/// The result of a reload.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Report {
    /// Why nothing of it was applied.
    pub refused: Option<String>,
    /// What has changed.
    pub applied: Vec<String>,
    /// Keys that differ from those that the bridge runs with, and wait for a restart.
    pub restart: Vec<String>,
    /// Guard keys that stay in force since their files cannot be read: whose, and why.
    #[serde(default)]
    pub kept: Vec<String>,
}

/// Keys of `[dli]` that change while the bridge runs.
const DLI: [&str; 5] = [
    "provisional",
    "disputed",
    "lease_s",
    "max_bytes_s",
    "max_messages_s",
];
/// Keys of `[[vehicle]]` that do not: its link and what is signed on it.
const VEHICLE: [&str; 8] = [
    "logical_id",
    "link",
    "system_id",
    "signing",
    "link_id",
    "vehicle_link_id",
    "rate_bps",
    "encrypt",
];

impl Config {
    /// What `new` changes of a bridge that runs with this configuration.
    ///
    /// # Errors
    /// What can be applied of it does not fit what the bridge keeps: why.
    pub fn changes(&self, new: &Config) -> Result<Changes, String> {
        let mut report = Report::default();
        let mut config = self.clone();
        for table in self.differing(new) {
            match table {
                "dli" => self.change_dli(new, &mut config, &mut report),
                // Every change in the file also moves the positions of these values, so they are compared below, entry by
                // entry.
                "cucs" | "vehicle" | "authority" | "forward" => {}
                other => report.restart.push(other.to_owned()),
            }
        }
        let (before, after) = (self.authority.get_ref(), new.authority.get_ref());
        for key in before.differing(after) {
            report.applied.push(format!("authority.{key}"));
        }
        config.authority = new.authority.clone();
        self.compare_stations(new, &mut report);
        config.cucs.clone_from(&new.cucs);
        self.change_vehicles(new, &mut config, &mut report);
        self.compare_forwards(new, &mut report);
        config.forward.clone_from(&new.forward);
        // A mixture of kept and new values can be invalid even if both files are valid.
        config.check().map_err(|fault| conflict(&fault))?;
        Ok(Changes { config, report })
    }

    fn change_dli(&self, new: &Config, config: &mut Config, report: &mut Report) {
        for key in self.dli.differing(&new.dli) {
            let list = if DLI.contains(&key) {
                &mut report.applied
            } else {
                &mut report.restart
            };
            list.push(format!("dli.{key}"));
        }
        config.dli.provisional = new.dli.provisional;
        config.dli.disputed.clone_from(&new.dli.disputed);
        config.dli.lease_s = new.dli.lease_s;
        config.dli.max_bytes_s = new.dli.max_bytes_s;
        config.dli.max_messages_s = new.dli.max_messages_s;
    }

    fn compare_stations(&self, new: &Config, report: &mut Report) {
        let find = |config: &Config, id: Id| config.stations().find(|one| one.id == id).cloned();
        for station in new.stations() {
            match find(self, station.id) {
                None => report.applied.push(format!("cucs {} added", station.id)),
                Some(before) => {
                    let keys = Cucs::differing(&before, station);
                    report.changed("cucs", station.id, &keys);
                }
            }
        }
        for station in self.stations() {
            if find(new, station.id).is_none() {
                report.applied.push(format!("cucs {} removed", station.id));
            }
        }
    }

    fn compare_forwards(&self, new: &Config, report: &mut Report) {
        for forward in new.forwards() {
            let name = &forward.name;
            match self.forwards().find(|one| one.name == *name) {
                None => report.applied.push(format!("forward {name} added")),
                Some(before) => {
                    let keys = Forward::differing(before, forward);
                    report.changed("forward", name, &keys);
                }
            }
        }
        for before in self.forwards() {
            let name = &before.name;
            if new.forwards().all(|one| one.name != *name) {
                report.applied.push(format!("forward {name} removed"));
            }
        }
    }

    fn change_vehicles(&self, new: &Config, config: &mut Config, report: &mut Report) {
        config.vehicle.clone_from(&new.vehicle);
        for vehicle in &mut config.vehicle {
            let vehicle = vehicle.get_mut();
            let Some(before) = self.vehicles().find(|one| one.id == vehicle.id) else {
                report.applied.push(format!("vehicle {} added", vehicle.id));
                continue;
            };
            let keys = Vehicle::differing(before, vehicle);
            let (kept, changed): (Vec<_>, Vec<_>) =
                keys.into_iter().partition(|key| VEHICLE.contains(key));
            report.changed("vehicle", vehicle.id, &changed);
            let kept = kept
                .iter()
                .map(|key| format!("vehicle {}: {key}", before.id));
            report.restart.extend(kept);
            // These keys need a restart: until then the bridge runs with their earlier values.
            vehicle.link.clone_from(&before.link);
            vehicle.logical_id = before.logical_id;
            vehicle.system_id = before.system_id;
            vehicle.signing.clone_from(&before.signing);
            vehicle.link_id = before.link_id;
            vehicle.vehicle_link_id = before.vehicle_link_id;
            vehicle.rate_bps = before.rate_bps;
            vehicle.encrypt = before.encrypt;
        }
        for before in self.vehicles() {
            if new.vehicles().all(|one| one.id != before.id) {
                report
                    .applied
                    .push(format!("vehicle {} removed", before.id));
            }
        }
    }
}

impl Report {
    /// That nothing is applied.
    #[must_use]
    pub fn refused(why: impl Into<String>) -> Report {
        Report {
            refused: Some(why.into()),
            ..Report::default()
        }
    }

    fn changed(&mut self, what: &str, id: impl std::fmt::Display, keys: &[&str]) {
        if !keys.is_empty() {
            self.applied
                .push(format!("{what} {id}: {}", keys.join(", ")));
        }
    }
}

fn conflict(fault: &Fault) -> String {
    let Fault {
        key,
        found,
        expected,
        ..
    } = fault;
    format!(
        "{key} is {found}, expected {expected}; it does not fit what the running bridge keeps until a restart: restart it \
         instead"
    )
}

#[cfg(test)]
mod tests {
    use super::super::bridge::Dli;
    use super::*;

    #[test]
    fn the_guide_lists_what_a_reload_applies_and_what_it_leaves() {
        let page = include_str!("../../../docs/guide/install.md");
        let (_, section) = page
            .split_once("## Another configuration without a restart")
            .expect("a section");
        let item = |begins: &str| {
            let (_, rest) = section.split_once(begins).expect(begins);
            rest.split("\n- ").next().unwrap_or_default().to_owned()
        };
        let applied = item("- Applied: ");
        let left = item("- Named and left until a restart: ");
        let check = |key: &str, is_applied: bool| {
            let key = format!("`{key}`");
            assert_eq!(applied.contains(&key), is_applied, "{key}");
            assert_eq!(left.contains(&key), !is_applied, "{key}");
        };
        for key in Dli::KEYS {
            check(key.name, DLI.contains(&key.name));
        }
        // These two say which vehicles there are.
        let which = ["id", "count"];
        for key in Vehicle::KEYS
            .iter()
            .filter(|key| !which.contains(&key.name))
        {
            check(key.name, !VEHICLE.contains(&key.name));
        }
        for table in Config::KEYS {
            match table.name {
                "dli" => {}
                list @ ("cucs" | "vehicle" | "forward") => check(&format!("[[{list}]]"), true),
                "authority" => check("[authority]", true),
                other => check(&format!("[{other}]"), false),
            }
        }
    }
}
