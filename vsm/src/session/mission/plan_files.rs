//! The plan on disk: a record, and a log of later messages.
//!
//! `plan-VVVVVVVV.json` holds the whole plan. A plan arrives message by message, and rewriting the record for each would
//! write gigabytes for a long route, so each message is appended to `plan-VVVVVVVV.log`:
//!
//! ```text
//! record 3f0c…            the SHA-256 of the record that the log continues
//! 00000032ea…             13001 as DLI bytes in hex
//! 00000032eb…             13002
//! 00000032c8…             13000, where it began to load them
//! ```
//!
//! A log is folded into its record once it has grown well beyond it, and when an upload ends or a route is cleared. The
//! messages of a log belong to an upload, which the record holds apart from the stored plan. The log names its record
//! because a process can end between the two writes: a log that continues another record is old, its messages are in the new
//! record (or were cleared), and it is ignored. A last line without its line feed is ignored: that message was never
//! answered.

use data_encoding::HEXLOWER;
use mavlink_link::store::{Disk, Durability, MAX_RECORD_BYTES, StoreError};
use sha2::{Digest, Sha256};
use stanag_msgs::Id;
use stanag_msgs::messages::MissionTransferCommand;

use super::received::ReceivedPlan;
use super::record;
use crate::session::store::{record_fault, record_name};

/// The state of the record and its log on disk.
#[derive(Debug)]
pub(super) struct PlanFiles {
    /// The first line of a log that continues the record.
    heading: String,
    /// The first line of the log on disk: the log continues the record only if this equals `heading`.
    log_heading: Option<String>,
    lines: usize,
    bytes: usize,
    /// Messages in the record.
    recorded: usize,
    /// The record must be written before the next message: either the log may end in an incomplete line, after which another
    /// could not be read, or a change that is on disk was undone in memory.
    pub(super) rewrite: bool,
    /// The 13000 that a restart has cut off while it loaded an upload.
    pub(super) cut_off: Option<MissionTransferCommand>,
}

impl Default for PlanFiles {
    /// The state of a vehicle without a plan.
    fn default() -> PlanFiles {
        PlanFiles {
            heading: heading(&[]),
            log_heading: None,
            lines: 0,
            bytes: 0,
            recorded: 0,
            rewrite: false,
            cut_off: None,
        }
    }
}

impl PlanFiles {
    /// Reads both.
    pub(super) fn read(
        vehicle: Id,
        disk: &dyn Disk,
    ) -> Result<(ReceivedPlan, PlanFiles), StoreError> {
        let record = disk.read_whole(&record_name(PLAN, vehicle), MAX_RECORD_BYTES)?;
        let record = record.as_deref().map_or(&[] as &[u8], Vec::as_slice);
        let (mut plan, recorded) = match record {
            [] => (ReceivedPlan::default(), 0),
            bytes => record::decode_plan(bytes, vehicle)
                .map_err(|cause| record_fault(PLAN, vehicle, cause))?,
        };
        let mut files = PlanFiles {
            heading: heading(record),
            recorded,
            ..PlanFiles::default()
        };
        let name = log_name(vehicle);
        let Some(log) = disk.read_whole(&name, MAX_RECORD_BYTES)? else {
            return Ok((plan, files));
        };
        let whole = log.iter().rposition(|byte| *byte == b'\n');
        let text = log.get(..whole.unwrap_or(0)).unwrap_or_default();
        let text = std::str::from_utf8(text).map_err(|cause| StoreError::new(&name, cause))?;
        let (log_heading, lines) = text.split_once('\n').unwrap_or((text, ""));
        files.log_heading = Some(log_heading.to_owned());
        if files.continues() {
            files.cut_off = record::store_log(&mut plan, lines.lines(), vehicle)
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
    pub(super) fn must_fold(&self, line: usize) -> bool {
        // Amortised: a fold writes no more than was appended since the last one, plus a constant.
        let long = self.lines >= FOLD_LINES + 2 * self.recorded;
        self.rewrite || self.continues() && (long || self.bytes + line >= FOLD_BYTES)
    }

    /// Adds a message; the first of a log with the log's heading.
    pub(super) fn append(
        &mut self,
        line: &str,
        vehicle: Id,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        // If anything fails, the next message begins with a fold.
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

    /// Writes the record from the whole plan; a new log begins with the next message.
    pub(super) fn fold(
        &mut self,
        received: &ReceivedPlan,
        cucs: Id,
        vehicle: Id,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        self.rewrite = true;
        let name = record_name(PLAN, vehicle);
        let bytes = record::encode_plan(received, cucs, vehicle)
            .map_err(|cause| StoreError::new(&name, cause))?;
        // Write the record before the log: if the process ends in between, the log belongs to another record and is ignored.
        disk.replace(&name, &bytes, Durability::Process)?;
        self.heading = heading(&bytes);
        if self.log_heading.is_some() {
            match disk.remove(&log_name(vehicle)) {
                Ok(()) => self.log_heading = None,
                // The plan is again the one that the log continues.
                Err(fault) if self.continues() => return Err(fault),
                // A log that continues another record is ignored.
                Err(_) => {}
            }
        }
        let staged = received.staged.as_ref().map(|staged| &staged.plan);
        self.recorded = staged.unwrap_or(&received.stored).messages().count();
        (self.lines, self.bytes) = (0, 0);
        self.rewrite = false;
        Ok(())
    }
}

fn heading(record: &[u8]) -> String {
    format!("record {}", HEXLOWER.encode(&Sha256::digest(record)))
}

pub(super) fn log_name(vehicle: Id) -> String {
    format!("{PLAN}-{:08x}.log", vehicle.0)
}

// The record's file name. It must not change, since such files exist on disks.
const PLAN: &str = "plan";
/// A log with at most this many lines is not folded.
pub(super) const FOLD_LINES: usize = 1_000;
/// Half of what is read of a file at the start.
const FOLD_BYTES: usize = 8 << 20;
