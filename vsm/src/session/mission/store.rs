//! The plan that CUCSs have sent, what 13000 has loaded of it, and what the vehicle carries; in memory and on disk.
//!
//! `plan-VVVVVVVV.json` holds the plan whole. A plan comes message by message, and rewriting the record for each would
//! write gigabytes for a long route; so a message is appended to `plan-VVVVVVVV.log`:
//!
//! ```text
//! record 3f0c…            the SHA-256 of the record that the log continues
//! 00000032ea…             13001 as DLI bytes in hex
//! 00000032eb…             13002
//! ```
//!
//! A log is folded into its record once it has grown well beyond it, and when a route is loaded or cleared. It names its
//! record because a process can end between the two files: a log that continues another record is an old one, whose
//! messages are in the new record (or were cleared), and is ignored. Its last line counts only with its line feed:
//! without, it is of a message that was never answered.

use mapping::plan::Plan;
use mavlink_link::store::{Disk, Durability, MAX_RECORD_BYTES, StoreError};
use sha2::{Digest, Sha256};
use stanag_msgs::{Id, Message};

use super::record::{self, UploadedMission};
use crate::session::alerts::Cause;
use crate::session::effects::Effects;
use crate::session::store::{record_fault, record_name};

/// What is stored.
#[derive(Debug, Default)]
pub(super) struct MissionStore {
    plan: Plan,
    files: PlanFiles,
    /// What the vehicle carries, as it was read back from it.
    pub(super) uploaded: Option<UploadedMission>,
    /// What 13000 has loaded.
    pub(super) loaded: Option<UploadedMission>,
}

impl MissionStore {
    /// What CUCSs have sent.
    pub(super) fn plan(&self) -> &Plan {
        &self.plan
    }

    /// 13001, 13002, 13003, 50001, 50002: stored at once, flown after 13000.
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
        let checked = self.plan.check(message, cucs, vehicle);
        checked.map_err(|fault| fault.to_string())?;
        self.write_message(message, cucs, vehicle, effects.disk())
            .map_err(|fault| format!("it cannot be stored: {fault}"))?;
        let stored = self.plan.store(message, cucs, vehicle);
        stored.map_err(|fault| fault.to_string())
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
            self.files.fold(&self.plan, cucs, vehicle, disk)?;
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
        let before = (self.plan.clone(), self.loaded.clone());
        self.clear(Some(id));
        self.save(cucs, effects).inspect_err(|_| {
            (self.plan, self.loaded) = before;
            // The record may have been written without the route already.
            self.files.rewrite = true;
        })
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
        self.clear(route_id);
        self.uploaded = None;
        self.save(cucs, effects)
    }

    fn clear(&mut self, route_id: Option<&str>) {
        match route_id {
            Some(id) => {
                self.plan.clear_route(id);
                self.loaded.take_if(|loaded| loaded.is_of(id));
            }
            None => {
                self.plan.clear();
                self.loaded = None;
            }
        }
    }

    fn save(&mut self, cucs: Id, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        self.fold_log(cucs, effects)?;
        self.save_uploaded(effects)
    }

    /// Writes the plan's record, so that its log can begin anew.
    ///
    /// # Errors
    /// It is not written. Record and log still hold what they held.
    pub(super) fn fold_log(
        &mut self,
        cucs: Id,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        let vehicle = effects.id;
        self.files.fold(&self.plan, cucs, vehicle, effects.disk())
    }

    /// Writes what is loaded, and what the vehicle carries.
    ///
    /// # Errors
    /// One of them is not written.
    pub(super) fn save_uploaded(&self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let vehicle = effects.id;
        for (kind, route) in [(LOADED, &self.loaded), (UPLOADED, &self.uploaded)] {
            let encoded = |route| record::encode_uploaded(route, vehicle);
            let bytes = route.as_ref().map_or_else(Vec::new, encoded);
            let name = record_name(kind, vehicle);
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
        (self.plan, self.files) = PlanFiles::read(vehicle, disk)?;
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

/// The record of the plan and its log, as they are on disk.
#[derive(Debug)]
struct PlanFiles {
    /// What the first line of a log of the record is.
    heading: String,
    /// The first line of the log that is on disk: the log continues the record only where that is `heading`.
    log_heading: Option<String>,
    lines: usize,
    bytes: usize,
    /// Messages in the record.
    recorded: usize,
    /// The record must be written before the next message: the log may end in a part of a line, behind which another
    /// could not be read, or a change of the plan was undone that is on disk.
    rewrite: bool,
}

impl Default for PlanFiles {
    /// Of a vehicle that has none.
    fn default() -> PlanFiles {
        PlanFiles {
            heading: heading(&[]),
            log_heading: None,
            lines: 0,
            bytes: 0,
            recorded: 0,
            rewrite: false,
        }
    }
}

impl PlanFiles {
    /// Reads both.
    fn read(vehicle: Id, disk: &dyn Disk) -> Result<(Plan, PlanFiles), StoreError> {
        let record = disk.read(&record_name(PLAN, vehicle), MAX_RECORD_BYTES)?;
        let record = record.as_deref().map_or(&[] as &[u8], Vec::as_slice);
        let (mut plan, recorded) = match record {
            [] => (Plan::default(), 0),
            bytes => record::decode_plan(bytes, vehicle)
                .map_err(|cause| record_fault(PLAN, vehicle, cause))?,
        };
        let mut files = PlanFiles {
            heading: heading(record),
            recorded,
            ..PlanFiles::default()
        };
        let name = log_name(vehicle);
        let Some(log) = disk.read(&name, MAX_RECORD_BYTES)? else {
            return Ok((plan, files));
        };
        let whole = log.iter().rposition(|byte| *byte == b'\n');
        let text = log.get(..whole.unwrap_or(0)).unwrap_or_default();
        let text = std::str::from_utf8(text).map_err(|cause| StoreError::new(&name, cause))?;
        let (log_heading, lines) = text.split_once('\n').unwrap_or((text, ""));
        files.log_heading = Some(log_heading.to_owned());
        if files.continues() {
            record::store_all(&mut plan, lines.lines(), vehicle)
                .map_err(|cause| StoreError::new(&name, cause))?;
            files.lines = lines.lines().count();
            files.bytes = log.len();
            files.rewrite = log.last() != Some(&b'\n');
        }
        Ok((plan, files))
    }

    /// Whether the log on disk continues the record.
    fn continues(&self) -> bool {
        self.log_heading.as_ref() == Some(&self.heading)
    }

    /// Whether a line must not be appended before the log is folded.
    fn must_fold(&self, line: usize) -> bool {
        // Amortised: a fold writes no more than was appended since the last, but for a constant.
        let long = self.lines >= FOLD_LINES + 2 * self.recorded;
        self.rewrite || self.continues() && (long || self.bytes + line >= FOLD_BYTES)
    }

    /// Adds a message; the first of a log with the log's heading.
    fn append(&mut self, line: &str, vehicle: Id, disk: &mut dyn Disk) -> Result<(), StoreError> {
        // Where anything fails, the next message begins with a fold.
        self.rewrite = true;
        let name = log_name(vehicle);
        if self.continues() {
            let line = format!("{line}\n");
            disk.append(&name, line.as_bytes(), Durability::Process)?;
            self.bytes += line.len();
            self.lines += 1;
        } else {
            let begun = format!("{}\n{line}\n", self.heading);
            disk.replace(&name, begun.as_bytes(), Durability::Process)?;
            self.log_heading = Some(self.heading.clone());
            self.bytes = begun.len();
            self.lines = 1;
        }
        self.rewrite = false;
        Ok(())
    }

    /// Writes the record from the whole plan; its log begins anew with the next message.
    fn fold(
        &mut self,
        plan: &Plan,
        cucs: Id,
        vehicle: Id,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        self.rewrite = true;
        let bytes = record::encode_plan(plan, cucs, vehicle);
        disk.replace(&record_name(PLAN, vehicle), &bytes, Durability::Process)?;
        self.heading = heading(&bytes);
        if self.log_heading.is_some() {
            match disk.remove(&log_name(vehicle)) {
                Ok(()) => self.log_heading = None,
                // The plan has become again what the log once continued.
                Err(fault) if self.continues() => return Err(fault),
                // A log that continues another record is ignored.
                Err(_) => {}
            }
        }
        self.recorded = plan.messages().count();
        (self.lines, self.bytes) = (0, 0);
        self.rewrite = false;
        Ok(())
    }
}

fn heading(record: &[u8]) -> String {
    let digest = Sha256::digest(record);
    let hex: String = digest.iter().map(|byte| format!("{byte:02x}")).collect();
    format!("record {hex}")
}

fn log_name(vehicle: Id) -> String {
    format!("{PLAN}-{:08x}.log", vehicle.0)
}

// The names of records by kind; of files that are on disks, so they stay.
const PLAN: &str = "plan";
const LOADED: &str = "chosen";
const UPLOADED: &str = "aboard";
/// A log of no more lines than this is not worth a fold.
const FOLD_LINES: usize = 1_000;
/// Half of what is read of a file at the start.
const FOLD_BYTES: usize = 8 << 20;
