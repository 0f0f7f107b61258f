//! The access list of a bridge: the entries of each CUCS, what ends with them, and their status.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::signing::SigningKey;
use mavlink_link::store::{Disk, StoreError};
use serde::Serialize;
use stanag_msgs::Id;
use stanag_msgs::enums::LoiBitmap;

use super::Bridge;
use crate::session::access::{
    Access, AccessError, AccessStatus, Gate, Permit, Permits, PreparedAccess, RenewError,
};
use crate::session::authority::Input;
use crate::session::dates::utc;
use crate::session::findings::{Code, Finding};
use crate::session::station::GroundStation;

/// What one CUCS may do with one vehicle.
#[derive(Debug, Clone, Serialize)]
pub struct RightsStatus {
    /// CUCS ID.
    pub cucs: String,
    /// Vehicle ID.
    pub vehicle: String,
    /// LOI bits that it may request now, by configuration and access list.
    pub may_hold: u8,
    /// LOI bits that it holds.
    pub holds: u8,
    /// Its entries of the access list; also empty without a list.
    pub entries: Vec<EntryStatus>,
}

/// One entry of the access list.
#[derive(Debug, Clone, Serialize)]
pub struct EntryStatus {
    /// The group of messages.
    pub group: &'static str,
    /// When it expires; `None`: never.
    pub until: Option<String>,
    /// The id of the guard key that it is for.
    pub key_id: String,
    /// "in force", "ended", or "another key" if the CUCS does not have that key.
    pub state: &'static str,
}

impl Bridge {
    /// Puts the access list of a file in force, or the stored one if that is newer. `file`: its content, or why it cannot
    /// be read.
    ///
    /// # Errors
    /// Neither is a valid list, or the store cannot be used: nothing may be served.
    pub fn set_access(
        &mut self,
        key: &SigningKey,
        file: Result<Vec<u8>, String>,
        now: Now,
        not_before: Duration,
        disk: &mut dyn Disk,
    ) -> Result<(), AccessError> {
        let access = Access::start(key, self.vsm, file, now, not_before, disk)?;
        let (version, key) = (access.version(), access.key_id());
        let changed = match access.before() {
            Some(before) if before == version => None,
            Some(before) => Some(format!(
                "version {before} -> {version}, key {key}, at a start"
            )),
            None => Some(format!("version {version}, key {key}, at its first start")),
        };
        let refused = access.refused().map(str::to_owned);
        self.access = Gate::List(Box::new(access));
        if let Some(why) = changed {
            self.audit_each(AUDITED, &why, now, disk);
        }
        if let Some(why) = refused {
            let why = format!("{why}; started by version {version} of the store");
            self.audit_each(AUDITED_REFUSED, &why, now, disk);
        }
        self.give_permits(now);
        Ok(())
    }

    /// Writes a line to the audit log of each vehicle: the list, or a zeroize, decides about all of them.
    pub(super) fn audit_each(
        &mut self,
        (what, by): (&'static str, Option<Id>),
        why: &str,
        now: Now,
        disk: &mut dyn Disk,
    ) {
        let (mut dli, aircraft) = self.effects(now, disk);
        for one in aircraft.iter_mut() {
            one.ask_authority(&mut dli, Input::Audit { what, by, why });
        }
    }

    /// Checks whether a file is a newer list than the one in force; `None` if it is that one. Changes nothing.
    ///
    /// # Errors
    /// It is not a newer list: why.
    pub fn prepare_access(&self, file: &[u8]) -> Result<Option<PreparedAccess>, RenewError> {
        match &self.access {
            Gate::List(access) => access.prepare(file),
            Gate::Open | Gate::Shut => Err(RenewError::NotConfigured),
        }
    }

    /// The file is not put in force: notes why, for the findings and the audit log.
    pub fn refuse_access(&mut self, why: &str, now: Now, disk: &mut dyn Disk) {
        if let Gate::List(access) = &mut self.access {
            access.note_file(Some(why.to_owned()));
            let version = access.version();
            let why = format!("{why}; version {version} stays in force");
            self.audit_each(AUDITED_REFUSED, &why, now, disk);
        }
    }

    /// Stores a list, before anything that it narrows changes.
    ///
    /// # Errors
    /// It cannot be stored, and [`Bridge::take_access`] must not follow.
    pub fn store_access(
        &self,
        new: Option<&PreparedAccess>,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        match (&self.access, new) {
            (Gate::List(access), Some(new)) => access.store(new, disk),
            _ => Ok(()),
        }
    }

    /// Puts a stored list in force; `None` if the file is the list in force. Rights that it no longer allows end at once,
    /// also in flight. Returns the changes.
    pub fn take_access(
        &mut self,
        new: Option<PreparedAccess>,
        now: Now,
        disk: &mut dyn Disk,
    ) -> Option<String> {
        let Gate::List(access) = &mut self.access else {
            return None;
        };
        let Some(new) = new else {
            access.note_file(None);
            return None;
        };
        let text = access.take(new);
        let why = format!("{text}, key {}", access.key_id());
        self.audit_each(AUDITED, &why, now, disk);
        self.give_permits(now);
        let (mut dli, aircraft) = self.effects(now, disk);
        for one in aircraft.iter_mut() {
            one.ask_authority(&mut dli, Input::Reconfigured);
        }
        self.forget_heartbeats(now.mono);
        Some(text)
    }

    /// Gives each station its entries.
    pub(super) fn give_permits(&mut self, now: Now) {
        for station in &mut self.stations {
            station.permits = Permits(match &self.access {
                Gate::Open => None,
                Gate::Shut => Some(Vec::new()),
                Gate::List(access) => Some(access.permits(station.id(), now)),
            });
        }
    }

    /// Once a second: ends expired entries, and with them the rights over vehicles that do not fly.
    pub(super) fn watch_access(&mut self, now: Now, disk: &mut dyn Disk) {
        if now.mono < self.checks.look_at {
            return;
        }
        let Gate::List(access) = &mut self.access else {
            return;
        };
        access.keep(now, disk);
        self.give_permits(now);
        let (mut dli, aircraft) = self.effects(now, disk);
        for one in aircraft.iter_mut() {
            let (vehicle, flies) = (one.id(), one.vehicle.may_fly());
            let ended = one.authority.rights().holders().any(|(id, held)| {
                let station = dli.stations.iter().find(|one| one.id() == id);
                let keeps = |one: &GroundStation| one.keeper(vehicle, flies).authorised;
                let keeps = station.map_or(LoiBitmap::NONE, keeps);
                !held.levels().without(keeps).is_empty()
            });
            if ended {
                one.ask_authority(&mut dli, Input::Reconfigured);
            }
        }
    }

    /// Findings about the list for an operator.
    pub(super) fn access_findings(&self) -> Vec<Finding> {
        let Gate::List(access) = &self.access else {
            return Vec::new();
        };
        let mut found = Vec::new();
        if let Some(why) = access.refused() {
            found.push(Finding::new(
                Code::AccessList,
                "access list",
                format!("{why}; version {} stays in force", access.version()),
                "sign the file again (vsm access sign), then run vsm reload",
            ));
        }
        for station in self.stations.iter().filter(|one| !one.removed) {
            let Some(guard) = &station.guard else {
                continue;
            };
            let Some(key) = guard.in_force() else {
                continue;
            };
            let entries = station.permits.0.iter().flatten();
            let of_key = |one: &Permit| one.entry.key == key;
            if entries.clone().next().is_some() && !entries.clone().any(of_key) {
                let id = station.id();
                let mut finding = Finding::new(
                    Code::AccessList,
                    id,
                    format!(
                        "CUCS {id} has guard key {key}, and its entries of the access list are for another"
                    ),
                    "grant them for this key too (vsm access grant --guard-key), sign the list, then run vsm reload",
                );
                finding.key = id.0;
                found.push(finding);
            }
        }
        found
    }

    pub(super) fn access_status(&self, now: Duration) -> Option<AccessStatus> {
        match &self.access {
            Gate::List(access) => Some(access.status(now)),
            Gate::Open | Gate::Shut => None,
        }
    }

    pub(super) fn rights_status(&self) -> Vec<RightsStatus> {
        let listed = self.stations.iter().filter(|one| !one.removed);
        let of = |station: &GroundStation| {
            let each = self.aircraft.iter().map(|one| {
                let vehicle = one.id();
                let entries = station.permits.0.iter().flatten();
                let entries = entries.filter(|permit| permit.entry.vehicle == vehicle);
                RightsStatus {
                    cucs: station.id().to_string(),
                    vehicle: vehicle.to_string(),
                    may_hold: station.asker(vehicle).authorised.raw(),
                    holds: one.authority.rights().granted(station.id()).raw(),
                    entries: entries.map(|permit| entry(station, permit)).collect(),
                }
            });
            each.collect::<Vec<_>>()
        };
        listed.flat_map(of).collect()
    }
}

/// Its name in the audit log.
const AUDITED: (&str, Option<Id>) = ("access list", None);
const AUDITED_REFUSED: (&str, Option<Id>) = ("access list refused", None);

fn entry(station: &GroundStation, permit: &Permit) -> EntryStatus {
    let Permit { entry, over } = permit;
    let has = station
        .guard
        .as_ref()
        .is_some_and(|guard| guard.has(entry.key));
    EntryStatus {
        group: entry.group.name(),
        until: entry.until.map(|until| utc(until.get())),
        key_id: entry.key.to_string(),
        state: match (has, over) {
            (false, _) => "another key",
            (true, true) => "ended",
            (true, false) => "in force",
        },
    }
}
