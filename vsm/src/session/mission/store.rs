//! The stored plan and the upload that will change it, the loaded route, and the mission that the vehicle carries; in memory
//! and on disk.
//!
//! Messages form an upload, which a 13000 ends ([`super::received`]); each message is written to disk before it is kept in
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
use crate::session::editions::Unfit;
use crate::session::effects::Effects;
use crate::session::store::{record_fault, record_name};

/// The store.
#[derive(Debug, Default)]
pub(super) struct MissionStore {
    received: ReceivedPlan,
    files: PlanFiles,
    /// When the staged upload is dropped if no further message arrives.
    staged_until: Option<Duration>,
    /// The 13000 that is refused when it is carried out, and why.
    pub(super) unfit: Option<((Id, Option<TimeStamp>), Unfit)>,
    /// The mission that the vehicle carries, as read back from it.
    pub(super) uploaded: Option<UploadedMission>,
    /// The vehicle has flown it to its end, as its record has it.
    pub(super) ended: bool,
    /// That could not be written: when it is tried again.
    end_due: Option<Duration>,
    /// The route that 13000 loaded.
    pub(super) loaded: Option<UploadedMission>,
}

impl MissionStore {
    /// The stored plan, without any upload that is not loaded.
    pub(super) fn plan(&self) -> &Plan {
        &self.received.stored
    }

    /// The plan that a 13000 of this CUCS loads: the stored plan changed by its upload.
    pub(super) fn offered(&self, cucs: Id) -> &Plan {
        self.received.offered(cucs)
    }

    /// The same, and the messages sent since its last 13000.
    pub(super) fn upload_of(&self, cucs: Id) -> (&Plan, Option<&Plan>) {
        let staged = self.received.staged.as_ref();
        let own = staged.filter(|staged| staged.owner == cucs);
        (self.offered(cucs), own.map(|staged| &staged.sent))
    }

    /// The 13000 with this stamp, if a restart has cut it off while it loaded an upload.
    pub(super) fn cut_off(&self, stamp: TimeStamp) -> Option<&MissionTransferCommand> {
        let command = self.files.cut_off.as_ref();
        command.filter(|command| command.time_stamp == Some(stamp))
    }

    /// The plan that the 13000 in progress loads: as sent when it began.
    pub(super) fn to_load(&self) -> &Plan {
        self.received.to_load()
    }

    /// Why a message is not stored that was sent before the 13000 that ended its upload.
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
    /// The plan or the disk does not accept it; nothing has changed.
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
        // Check before writing: a message in the log that the plan refuses would fail the next start.
        let checked = self.received.check(message, cucs, vehicle);
        checked.map_err(|fault| fault.to_string())?;
        // Disk before memory: a message that is only in memory would be acknowledged but lost in a restart.
        self.write_message(message, cucs, vehicle, effects.disk())
            .map_err(not_stored)?;
        let stored = self.received.store(message, cucs, vehicle);
        stored.map_err(|fault| fault.to_string())?;
        self.staged_until = Some(effects.dli.now.mono + STAGED_WITHIN);
        Ok(())
    }

    /// Replaces the staged upload by the upload of this message, if it belongs to another.
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

    /// Drops an upload that its owner can no longer load or has abandoned.
    pub(super) fn watch_upload(
        &mut self,
        now: Duration,
        controller: Option<Id>,
        effects: &mut Effects<'_>,
    ) {
        let Some(owner) = self.received.staged.as_ref().map(|staged| staged.owner) else {
            return;
        };
        // After a restart its age is unknown.
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

    /// When [`MissionStore::watch_upload`] is next needed, apart from a change of control.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        let staged = self.received.staged.is_some();
        self.staged_until.filter(|_| staged)
    }

    fn advise_of_drop(&self, dropped: bool, effects: &mut Effects<'_>) {
        if let Some(why) = self.received.dropped.as_ref().filter(|_| dropped) {
            effects.advise(format!("{why}; the stored plan is as it was"));
        }
    }

    /// Checks whether a 13000 may load a route of [`MissionStore::offered`]. After a dropped upload it may only load a route
    /// that was completely sent since.
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

    /// A 13000 begins to load the upload.
    ///
    /// # Errors
    /// The end of the upload cannot be written; nothing has changed.
    pub(super) fn begin_load(
        &mut self,
        command: &MissionTransferCommand,
        cucs: Id,
        effects: &mut Effects<'_>,
    ) -> Result<(), String> {
        let vehicle = effects.id;
        if self.received.offered(cucs) != self.received.to_load() {
            // If a restart interrupts the load, later messages belong to a new upload.
            let command = Message::MissionTransferCommand(command.clone());
            self.write_message(&command, cucs, vehicle, effects.disk())
                .map_err(not_stored)?;
        }
        self.received.begin_load(cucs);
        Ok(())
    }

    /// The 13000 has failed and can be repeated. `begun`: it was the one in progress.
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

    /// The 13000 was refused because of the upload's content: drops the upload.
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

    /// 13000 mode 5: drops the upload.
    ///
    /// # Errors
    /// The upload is dropped, but that cannot be written: a restart could restore it.
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

    /// Writes the end of an upload. A failed write is retried with the next message; a restart before that restores the
    /// upload.
    fn save_upload(&mut self, cucs: Id, effects: &mut Effects<'_>) {
        if let Err(fault) = self.fold_log(cucs, effects) {
            effects.warn(Cause::Store, format!("the plan cannot be stored: {fault}"));
        }
    }

    /// The 13000 has loaded the upload: stores it.
    ///
    /// # Errors
    /// It could not be written; it is staged as before.
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
    /// It could not be stored; the route is still there.
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
            // The record may already have been written without the route.
            self.files.rewrite = true;
        })
    }

    /// 13000 mode 1 has begun: later messages are kept.
    pub(super) fn begin_clear(&mut self) {
        self.received.begin_clear();
    }

    /// The vehicle no longer carries a mission: clears a route or everything, on disk too.
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
        // The log is append-only: a clearing needs a new record.
        self.fold_log(cucs, effects)?;
        self.save_uploaded(effects)
    }

    /// Writes the plan's record, so that a new log can begin.
    ///
    /// # Errors
    /// It is not written. Record and log are unchanged.
    fn fold_log(&mut self, cucs: Id, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let vehicle = effects.id;
        self.files
            .fold(&self.received, cucs, vehicle, effects.disk())
    }

    /// Writes the loaded route and the mission that the vehicle carries.
    ///
    /// # Errors
    /// One of them is not written.
    pub(super) fn save_uploaded(&self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        save_route(LOADED, self.loaded.as_ref(), false, effects)?;
        save_route(UPLOADED, self.uploaded.as_ref(), self.ended, effects)
    }

    /// Stores whether the vehicle has flown its mission to the end, where that has changed. What fails is tried again.
    pub(super) fn keep_end(&mut self, ended: bool, now: Duration, effects: &mut Effects<'_>) {
        let waits = self.end_due.is_some_and(|due| now < due);
        if self.ended == ended || self.uploaded.is_none() || waits {
            return;
        }
        match save_route(UPLOADED, self.uploaded.as_ref(), ended, effects) {
            Ok(()) => (self.ended, self.end_due) = (ended, None),
            Err(fault) => {
                self.end_due = Some(now + TRY_AGAIN);
                let what = if ended {
                    "flown to its end"
                } else {
                    "begun again"
                };
                effects.warn(
                    Cause::Store,
                    format!(
                        "that the route was {what} cannot be stored: {fault}; after a restart of the VSM mode 11 (waypoint) may begin \
                         at another waypoint"
                    ),
                );
            }
        }
    }

    /// The vehicle may carry a different mission: no route is flown before the next load.
    pub(super) fn forget_uploaded(&mut self, effects: &mut Effects<'_>) {
        self.uploaded = None;
        if let Err(fault) = self.save_uploaded(effects) {
            effects.warn(Cause::Store, format!("the plan cannot be stored: {fault}"));
        }
    }

    /// Restores the records after a restart.
    ///
    /// # Errors
    /// A record exists but cannot be read. Starting without it would break what was acknowledged.
    pub(super) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let (vehicle, disk) = (effects.id, effects.disk());
        (self.received, self.files) = PlanFiles::read(vehicle, disk)?;
        for (kind, route) in [(UPLOADED, &mut self.uploaded), (LOADED, &mut self.loaded)] {
            let bytes = disk.read_whole(&record_name(kind, vehicle), MAX_RECORD_BYTES)?;
            if let Some(bytes) = bytes.filter(|bytes| !bytes.is_empty()) {
                let (read, ended) = record::decode_uploaded(&bytes, vehicle)
                    .map_err(|cause| record_fault(kind, vehicle, cause))?;
                *route = Some(read);
                // Only the record of the vehicle's mission has that.
                self.ended |= ended;
            }
        }
        Ok(())
    }
}

/// Writes the record of a route, with whether the vehicle has flown it to its end.
///
/// # Errors
/// It is not written.
fn save_route(
    kind: &str,
    route: Option<&UploadedMission>,
    ended: bool,
    effects: &mut Effects<'_>,
) -> Result<(), StoreError> {
    let vehicle = effects.id;
    let name = record_name(kind, vehicle);
    let encoded = route.map(|route| record::encode_uploaded(route, ended, vehicle));
    // An empty record means no route: `restore` reads it as absent.
    let bytes = encoded
        .transpose()
        .map_err(|cause| StoreError::new(&name, cause))?
        .unwrap_or_default();
    // Rare enough to be synchronised; the messages of a plan are too many for that.
    effects.disk().replace(&name, &bytes, Durability::Power)
}

fn not_stored(fault: StoreError) -> String {
    format!("it cannot be stored: {fault}")
}

/// Maximum number of waypoints named in a text.
const SHOWN: usize = 8;

/// An upload without further messages for this long is dropped: its operator may have forgotten it, and later messages
/// without a 13001 would be added to it.
const STAGED_WITHIN: Duration = Duration::from_secs(5 * 60);
/// How often it is tried again to store the end of a route.
const TRY_AGAIN: Duration = Duration::from_secs(1);

// The records' file names. They must not change, since such files exist on disks.
const LOADED: &str = "chosen";
const UPLOADED: &str = "aboard";

#[cfg(test)]
mod tests;
