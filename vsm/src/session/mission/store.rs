//! The stored plan and the upload that is to change it, what 13000 has loaded, and what the vehicle carries; in memory
//! and on disk.
//!
//! What is sent becomes an upload, which its 13000 ends ([`super::received`]); each message is on disk before it is in
//! memory ([`super::plan_files`]).

use std::time::Duration;

use mapping::plan::{Plan, purpose, route_name};
use mavlink_link::store::{Disk, Durability, MAX_RECORD_BYTES, StoreError};
use stanag_msgs::enums::{AlertPriority, SubsystemId};
use stanag_msgs::messages::{MissionTransferCommand, UaRoute};
use stanag_msgs::{Id, Message, TimeStamp};

use super::plan_files::{PlanFiles, log_name};
use super::received::{Order, ReceivedPlan};
use super::record::{self, UploadedMission};
use crate::session::alerts::Cause;
use crate::session::effects::Effects;
use crate::session::store::{record_fault, record_name};

/// What is stored.
#[derive(Debug, Default)]
pub(super) struct MissionStore {
    received: ReceivedPlan,
    files: PlanFiles,
    /// When the staged upload is given up, if nothing more comes of it.
    staged_until: Option<Duration>,
    /// What the vehicle carries, as it was read back from it.
    pub(super) uploaded: Option<UploadedMission>,
    /// What 13000 has loaded.
    pub(super) loaded: Option<UploadedMission>,
}

impl MissionStore {
    /// The stored plan: nothing of an upload that 13000 has not loaded.
    pub(super) fn plan(&self) -> &Plan {
        &self.received.stored
    }

    /// What a 13000 of this CUCS loads: what it has sent, to the stored plan.
    pub(super) fn offered(&self, cucs: Id) -> &Plan {
        self.received.offered(cucs)
    }

    /// The same, and what of it was sent since its last 13000.
    pub(super) fn upload_of(&self, cucs: Id) -> (&Plan, Option<&Plan>) {
        let staged = self.received.staged.as_ref();
        let own = staged.filter(|staged| staged.owner == cucs);
        (self.offered(cucs), own.map(|staged| &staged.sent))
    }

    /// What the 13000 that is carried out loads: what had been sent when it began.
    pub(super) fn to_load(&self) -> &Plan {
        self.received.to_load()
    }

    /// Why a message is not stored that was sent before the 13000 which ended its upload.
    pub(super) fn refuse_late(
        &self,
        now: Duration,
        cucs: Id,
        stamp: Option<TimeStamp>,
    ) -> Result<(), String> {
        if self.received.is_late(now, cucs, stamp) {
            return Err("sent before the 13000 that dropped its upload".to_owned());
        }
        Ok(())
    }

    /// 13001 to 13004, 13006, 50001, 50002: staged at once, stored and flown after 13000.
    ///
    /// # Errors
    /// The plan does not take it, or the disk does not: nothing has changed.
    pub(super) fn store(
        &mut self,
        message: &Message,
        cucs: Id,
        effects: &mut Effects<'_>,
    ) -> Result<(), String> {
        let vehicle = effects.id;
        if self.received.gives_way(message, cucs).is_some() {
            self.give_way(message, cucs, effects)?;
        }
        // Checked before it is written: a message in the log that the plan refuses would fail the next start.
        let checked = self.received.check(message, cucs, vehicle);
        checked.map_err(|fault| fault.to_string())?;
        // Disk before memory: a message that is only in memory would be acknowledged, and lost by a restart.
        self.write_message(message, cucs, vehicle, effects.disk())
            .map_err(not_stored)?;
        let stored = self.received.store(message, cucs, vehicle);
        stored.map_err(|fault| fault.to_string())?;
        self.staged_until = Some(effects.dli.now.mono + STAGED_WITHIN);
        Ok(())
    }

    /// The staged upload gives way to the one that this message is of.
    fn give_way(
        &mut self,
        message: &Message,
        cucs: Id,
        effects: &mut Effects<'_>,
    ) -> Result<(), String> {
        let vehicle = effects.id;
        let mut after = self.received.clone();
        after.give_way(message, cucs, vehicle);
        let checked = after.check(message, cucs, vehicle);
        checked.map_err(|fault| fault.to_string())?;
        self.files
            .fold(&after, cucs, vehicle, effects.disk())
            .map_err(not_stored)?;
        let dropped = self.received.open_by().is_some();
        self.received = after;
        self.advise_of_drop(dropped, effects);
        Ok(())
    }

    /// Drops an upload that its owner can load no more, or has left.
    pub(super) fn watch_upload(
        &mut self,
        now: Duration,
        controller: Option<Id>,
        effects: &mut Effects<'_>,
    ) {
        let Some(owner) = self.received.staged.as_ref().map(|staged| staged.owner) else {
            return;
        };
        // After a restart it is not known how old it is.
        let until = *self.staged_until.get_or_insert(now + STAGED_WITHIN);
        let why = if controller != Some(owner) {
            "control of the vehicle has changed".to_owned()
        } else if now >= until {
            format!(
                "no further message of it arrived within {} min",
                STAGED_WITHIN.as_secs() / 60
            )
        } else {
            return;
        };
        if self.received.drop_staged(&why) {
            self.save_upload(owner, effects);
            self.advise_of_drop(true, effects);
        }
    }

    /// When [`MissionStore::watch_upload`] has something to do, beside after a change of control.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        let staged = self.received.staged.is_some();
        self.staged_until.filter(|_| staged)
    }

    fn advise_of_drop(&self, dropped: bool, effects: &mut Effects<'_>) {
        if let Some(why) = self.received.dropped.as_ref().filter(|_| dropped) {
            effects.advise(format!("{why}; the stored plan is as it was"));
        }
    }

    /// Whether a 13000 may load a route of what [`MissionStore::offered`]; after an upload that was dropped it may only
    /// load one that was sent whole since.
    ///
    /// # Errors
    /// The waypoint that is missing, if it is one, and why.
    pub(super) fn admit_load(
        &mut self,
        cucs: Id,
        route: Option<&UaRoute>,
    ) -> Result<(), (Option<u16>, String)> {
        self.received.admit_load(cucs, route)
    }

    /// 13000 begins to load what was sent.
    ///
    /// # Errors
    /// That the upload has ended here cannot be written: nothing has changed.
    pub(super) fn begin_load(
        &mut self,
        command: &MissionTransferCommand,
        cucs: Id,
        effects: &mut Effects<'_>,
    ) -> Result<(), String> {
        let vehicle = effects.id;
        if self.received.offered(cucs) != self.received.to_load() {
            // A restart in the middle of the load: what is sent after it is of another upload than what was before.
            let command = Message::MissionTransferCommand(command.clone());
            self.write_message(&command, cucs, vehicle, effects.disk())
                .map_err(not_stored)?;
        }
        self.received.begin_load(cucs);
        Ok(())
    }

    /// 13000 has not loaded what was sent, and can be repeated. `begun`: it was this one that was carried out.
    pub(super) fn load_failed(&mut self, begun: bool, cucs: Id, effects: &mut Effects<'_>) {
        if begun {
            self.received.load_failed(effects.id);
        } else {
            self.received.load_not_begun(cucs);
        }
        self.staged_until = Some(effects.dli.now.mono + STAGED_WITHIN);
        if self
            .received
            .staged
            .as_ref()
            .is_some_and(|staged| staged.failed)
        {
            self.save_upload(cucs, effects);
        }
    }

    /// 13000 was refused for what was sent: nothing of it stays.
    pub(super) fn refuse_upload(
        &mut self,
        now: Duration,
        (cucs, stamp): (Id, Option<TimeStamp>),
        effects: &mut Effects<'_>,
    ) {
        let order = stamp.map(|stamp| (cucs, stamp));
        self.received.refuse(now, order, effects.id);
        self.save_upload(cucs, effects);
    }

    /// 13000 mode 5: nothing of what was sent stays.
    ///
    /// # Errors
    /// It cannot be written: it is dropped, but a restart could find it.
    pub(super) fn cancel_upload(
        &mut self,
        now: Duration,
        (cucs, stamp): (Id, Option<TimeStamp>),
        effects: &mut Effects<'_>,
    ) -> Result<(), String> {
        let order: Order = stamp.map(|stamp| (cucs, stamp));
        if !self.received.cancel(now, order) {
            return Ok(());
        }
        let written = self.fold_log(cucs, effects);
        written.map_err(|fault| {
            format!(
                "the upload is dropped, but could not be deleted from disk: a restart of the VSM would restore it \
                 ({fault})"
            )
        })
    }

    /// Writes how an upload ended. What cannot be written is tried again with the next message; a restart before it finds
    /// the upload as it was sent.
    fn save_upload(&mut self, cucs: Id, effects: &mut Effects<'_>) {
        if let Err(fault) = self.fold_log(cucs, effects) {
            effects.warn(Cause::Store, format!("the plan cannot be stored: {fault}"));
        }
    }

    /// 13000 has loaded what was sent: it is stored.
    ///
    /// # Errors
    /// It could not be written: it is staged as before.
    pub(super) fn upload_loaded(
        &mut self,
        cucs: Id,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        let before = self.received.clone();
        if !self.received.loaded() {
            return Ok(());
        }
        if let Err(fault) = self.fold_log(cucs, effects) {
            self.received = before;
            return Err(fault);
        }
        for (route, numbers) in self.plan().routes_changed_since(&before.stored) {
            let purpose = purpose(route);
            let name = route_name(route).map_or_else(String::new, |name| format!(" {name}"));
            let shown: Vec<_> = numbers.iter().take(SHOWN).map(u16::to_string).collect();
            let more = match numbers.len().saturating_sub(SHOWN) {
                0 => String::new(),
                more => format!(" and {more} more"),
            };
            let text = format!(
                "this load also changed {purpose} route{name}, which uses the same waypoint numbers: {}{more}; send that route \
                 again, with numbers of its own",
                shown.join(", ")
            );
            effects.notify(AlertPriority::Caution, SubsystemId::VsmStatus, text);
        }
        Ok(())
    }

    fn write_message(
        &mut self,
        message: &Message,
        cucs: Id,
        vehicle: Id,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        let line = record::encode_message(message, cucs, vehicle)
            .map_err(|cause| StoreError::new(log_name(vehicle), cause))?;
        if self.files.must_fold(line.len()) {
            self.files.fold(&self.received, cucs, vehicle, disk)?;
        }
        self.files.append(&line, vehicle, disk)
    }

    /// Clears a route that the vehicle does not carry, on disk too.
    ///
    /// # Errors
    /// It could not be stored: it is there as before.
    pub(super) fn forget_route(
        &mut self,
        id: &str,
        cucs: Id,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        let before = (self.received.clone(), self.loaded.clone());
        self.received.begin_clear();
        self.clear(Some(id), effects.id);
        self.save(cucs, effects).inspect_err(|_| {
            (self.received, self.loaded) = before;
            // The record may have been written without the route already.
            self.files.rewrite = true;
        })
    }

    /// 13000 mode 1 has begun: what is sent from here on is kept.
    pub(super) fn begin_clear(&mut self) {
        self.received.begin_clear();
    }

    /// The vehicle carries nothing any more: clears a route, or everything, on disk too.
    ///
    /// # Errors
    /// It could not be stored.
    pub(super) fn cleared(
        &mut self,
        route_id: Option<&str>,
        cucs: Id,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        self.clear(route_id, effects.id);
        self.uploaded = None;
        self.save(cucs, effects)
    }

    fn clear(&mut self, route_id: Option<&str>, vehicle: Id) {
        self.received.clear(route_id, vehicle);
        let gone = |loaded: &mut UploadedMission| route_id.is_none_or(|id| loaded.is_of(id));
        self.loaded.take_if(gone);
    }

    fn save(&mut self, cucs: Id, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        // The log can only add: what was cleared leaves the disk with a new record.
        self.fold_log(cucs, effects)?;
        self.save_uploaded(effects)
    }

    /// Writes the plan's record, so that a new log can begin.
    ///
    /// # Errors
    /// It is not written. Record and log still hold what they held.
    fn fold_log(&mut self, cucs: Id, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let vehicle = effects.id;
        self.files
            .fold(&self.received, cucs, vehicle, effects.disk())
    }

    /// Writes what is loaded, and what the vehicle carries.
    ///
    /// # Errors
    /// One of them is not written.
    pub(super) fn save_uploaded(&self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let vehicle = effects.id;
        for (kind, route) in [(LOADED, &self.loaded), (UPLOADED, &self.uploaded)] {
            let encoded = |route| record::encode_uploaded(route, vehicle);
            // An empty record stands for no route: `restore` reads it as an absent one.
            let bytes = route.as_ref().map_or_else(Vec::new, encoded);
            let name = record_name(kind, vehicle);
            // Rare enough to be synchronised; the messages of a plan are too many for that.
            effects.disk().replace(&name, &bytes, Durability::Power)?;
        }
        Ok(())
    }

    /// The vehicle may carry something else than what was loaded: nothing is flown before the next load.
    pub(super) fn forget_uploaded(&mut self, effects: &mut Effects<'_>) {
        self.uploaded = None;
        if let Err(fault) = self.save_uploaded(effects) {
            effects.warn(Cause::Store, format!("the plan cannot be stored: {fault}"));
        }
    }

    /// What a restart finds.
    ///
    /// # Errors
    /// A record is there and cannot be read: starting without it would lose what was promised.
    pub(super) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let (vehicle, disk) = (effects.id, effects.disk());
        (self.received, self.files) = PlanFiles::read(vehicle, disk)?;
        for (kind, route) in [(UPLOADED, &mut self.uploaded), (LOADED, &mut self.loaded)] {
            let bytes = disk.read(&record_name(kind, vehicle), MAX_RECORD_BYTES)?;
            if let Some(bytes) = bytes.filter(|bytes| !bytes.is_empty()) {
                let read = record::decode_uploaded(&bytes, vehicle)
                    .map_err(|cause| record_fault(kind, vehicle, cause))?;
                *route = Some(read);
            }
        }
        Ok(())
    }
}

fn not_stored(fault: StoreError) -> String {
    format!("it cannot be stored: {fault}")
}

/// Of the waypoints in a text, so many are named.
const SHOWN: usize = 8;

/// An upload of which nothing more comes for so long is dropped: its operator may have forgotten it, and what is sent
/// later, without a 13001, would be added to it.
const STAGED_WITHIN: Duration = Duration::from_secs(5 * 60);

// The names of records by kind; of files that are on disks, so they stay.
const LOADED: &str = "chosen";
const UPLOADED: &str = "aboard";

#[cfg(test)]
mod tests;
