//! The thread of a queued disk: it synchronises, renames, and synchronises the folder.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender};
use std::time::{Duration, Instant};

use tokio::sync::Notify;
use zeroize::Zeroizing;

use crate::shell::disk::{self, FileSystem};

/// The content of a record, or of a log written whole, that has not been renamed yet.
#[derive(Debug, Clone)]
pub(super) struct Waiting {
    /// The change that wrote it.
    pub(super) change: u64,
    pub(super) beside: PathBuf,
    pub(super) bytes: Arc<Zeroizing<Vec<u8>>>,
    /// It is a log, which becomes durable before any record.
    pub(super) log: bool,
    /// The temporary file is written already.
    pub(super) written: bool,
}

/// A log that has grown.
#[derive(Debug)]
pub(super) struct Grown {
    pub(super) name: String,
    /// Open: it may be renamed meanwhile.
    pub(super) file: File,
    /// Its tail.
    pub(super) id: u64,
    /// The length up to which it is to be synchronised.
    pub(super) end: u64,
}

/// The changes made durable together.
#[derive(Debug, Default)]
pub(super) struct Batch {
    /// The last change in it.
    pub(super) change: u64,
    pub(super) records: BTreeMap<String, Waiting>,
    /// Logs that have grown.
    pub(super) logs: Vec<Grown>,
    /// Files that were deleted while a record with that name was queued.
    pub(super) removed: BTreeSet<String>,
    /// Files created, deleted or renamed: their folder is synchronised.
    pub(super) names: BTreeSet<String>,
    /// It has failed before.
    pub(super) again: bool,
    /// Logs that are lost and not rewritten yet: no record may become durable before them.
    behind: BTreeSet<String>,
}

impl Batch {
    pub(super) fn is_empty(&self) -> bool {
        self.records.is_empty()
            && self.logs.is_empty()
            && self.removed.is_empty()
            && self.names.is_empty()
    }

    fn all(&self) -> BTreeSet<String> {
        let logs = self.logs.iter().map(|log| &log.name);
        let others = self.records.keys().chain(&self.removed).chain(&self.names);
        logs.chain(others).cloned().collect()
    }

    fn all_failed(&self, cause: &io::Error) -> BTreeMap<String, String> {
        let all = self.all().into_iter();
        all.map(|name| (name, cause.to_string())).collect()
    }

    /// Keeps only what belongs to these files.
    fn retain(&mut self, keep: impl Fn(&str) -> bool) {
        self.records.retain(|name, _| keep(name));
        self.logs.retain(|log| keep(&log.name));
        self.removed.retain(|name| keep(name));
        self.names.retain(|name| keep(name));
    }

    /// Adds the failed part of a newer batch.
    fn add(&mut self, mut newer: Batch) {
        self.change = self.change.max(newer.change);
        self.records.append(&mut newer.records);
        self.removed.append(&mut newer.removed);
        self.names.append(&mut newer.names);
    }
}

/// What a thread reports of a batch.
#[derive(Debug)]
pub(super) struct Done {
    /// All changes of these files up to this one are durable.
    pub(super) change: u64,
    pub(super) files: BTreeSet<String>,
    /// These are not, and are tried again.
    pub(super) failed: BTreeMap<String, String>,
    /// Tails of logs that are durable, up to where.
    pub(super) synced: Vec<(u64, u64)>,
    /// Logs, by the names that they had, and their tails: to be written whole.
    pub(super) lost: Vec<(String, u64)>,
    /// It was tried again.
    pub(super) again: bool,
}

/// The thread; it runs until its disk is dropped.
pub(super) fn write(
    system: &dyn FileSystem,
    folder: &Path,
    batches: &Receiver<Batch>,
    reports: &Sender<Done>,
    progress: &Notify,
) {
    // What has failed, and when it is tried again.
    let (mut failed, mut again_at) = (Batch::default(), Instant::now());
    loop {
        let batch = if failed.is_empty() {
            batches.recv().map_err(|_| RecvTimeoutError::Disconnected)
        } else {
            batches.recv_timeout(again_at.saturating_duration_since(Instant::now()))
        };
        let mut batch = match batch {
            Ok(batch) => {
                // The newer content of a file replaces the older.
                for record in batch.all() {
                    if let Some(older) = failed.records.remove(&record) {
                        let _ = system.remove(&older.beside);
                    }
                    failed.removed.remove(&record);
                    failed.names.remove(&record);
                    if failed.behind.remove(&record) {
                        again_at = Instant::now();
                    }
                }
                batch
            }
            // Records wait until the disk has the lost log written whole: a record must not be durable before its log line.
            Err(RecvTimeoutError::Timeout) if !failed.behind.is_empty() => {
                again_at = Instant::now() + TRY_AGAIN;
                continue;
            }
            Err(RecvTimeoutError::Timeout) => std::mem::take(&mut failed),
            Err(RecvTimeoutError::Disconnected) => return,
        };
        let mut files = batch.all();
        let causes = make_durable(system, folder, &batch);
        let (change, again) = (batch.change, batch.again);
        let durable = |log: &&Grown| !causes.contains_key(&log.name);
        let synced = batch.logs.iter().filter(durable);
        let synced = synced.map(|log| (log.id, log.end)).collect();
        batch.retain(|name| causes.contains_key(name));
        // A log is not tried again: after a failed synchronisation the system may count its cached pages as written.
        let mut lost = Vec::new();
        for log in std::mem::take(&mut batch.logs) {
            failed.behind.insert(log.name.clone());
            lost.push((log.name, log.id));
        }
        if !causes.is_empty() {
            failed.add(batch);
            failed.again = true;
            again_at = Instant::now() + TRY_AGAIN;
        }
        let left = failed.all();
        files.retain(|name| !left.contains(name) && !causes.contains_key(name));
        let _ = reports.send(Done {
            change,
            files,
            failed: causes,
            synced,
            lost,
            again,
        });
        progress.notify_one();
    }
}

/// Returns what could not be made durable, and why. Logs before records: a crash in between leaves a line too many, never a
/// change without its line.
fn make_durable(system: &dyn FileSystem, folder: &Path, batch: &Batch) -> BTreeMap<String, String> {
    let mut failed = BTreeMap::new();
    for log in &batch.logs {
        if let Err(cause) = system.sync_open(&log.file) {
            failed.insert(log.name.clone(), cause.to_string());
        }
    }
    let mut renamed = false;
    for (name, log) in batch.records.iter().filter(|(_, one)| one.log) {
        let done = sync_beside(system, batch, log)
            .and_then(|()| system.rename(&log.beside, &folder.join(name)));
        match done {
            Ok(()) => renamed = true,
            Err(cause) => drop(failed.insert(name.clone(), cause.to_string())),
        }
    }
    if renamed && let Err(cause) = system.sync(folder) {
        return batch.all_failed(&cause);
    }
    if let Some((log, cause)) = failed.clone().first_key_value() {
        // Any of the records may be the one that a failed line is about.
        let cause = format!("{log}: {cause}");
        let records = batch.records.iter().filter(|(_, one)| !one.log);
        failed.extend(records.map(|(name, _)| (name.clone(), cause.clone())));
    }
    // All contents first, then all renames: the folder is synchronised once for all of them.
    let mut ready = Vec::new();
    for (name, record) in batch.records.iter().filter(|(_, one)| !one.log) {
        if failed.contains_key(name) {
            continue;
        }
        match sync_beside(system, batch, record) {
            Ok(()) => ready.push((name, record)),
            Err(cause) => {
                if let Err(cause) = write_over(system, &folder.join(name), record, cause) {
                    failed.insert(name.clone(), cause.to_string());
                }
            }
        }
    }
    for (name, record) in ready {
        if let Err(cause) = system.rename(&record.beside, &folder.join(name)) {
            failed.insert(name.clone(), cause.to_string());
        }
    }
    for name in &batch.removed {
        if let Err(cause) = system.remove(&folder.join(name)) {
            failed.insert(name.clone(), cause.to_string());
        }
    }
    // Names and deletions are entries of the folder.
    let names = if batch.again {
        dirty_names(system, folder)
    } else {
        Ok(())
    };
    match names.and_then(|()| system.sync(folder)) {
        Ok(()) => failed,
        Err(cause) => batch.all_failed(&cause),
    }
}

/// Synchronises a temporary file.
fn sync_beside(system: &dyn FileSystem, batch: &Batch, record: &Waiting) -> io::Result<()> {
    if batch.again || !record.written {
        // After a failed synchronisation the system may count its cached pages as written, so they are written again.
        system.write(&record.beside, &record.bytes)?;
    }
    system.sync(&record.beside)
}

/// Writes a record over what is there, where no link works without it and the disk has no room beside.
///
/// # Errors
/// `cause`, which the other way has failed for, or the record is none of these.
fn write_over(
    system: &dyn FileSystem,
    path: &Path,
    record: &Waiting,
    cause: io::Error,
) -> io::Result<()> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    if !disk::keeps_its_room(&name) || !disk::is_no_room(&cause) {
        return Err(cause);
    }
    let _ = system.remove(&record.beside);
    disk::write_over(system, path, &record.bytes, true).map_err(|_| cause)
}

/// Changes the names of a folder, so that its next synchronisation writes them: after a failed one they may count as
/// written.
///
/// # Errors
/// The system's.
pub(in crate::shell) fn dirty_names(system: &dyn FileSystem, folder: &Path) -> io::Result<()> {
    let name = folder.join(format!("names{BESIDE}0"));
    system.write(&name, b"")?;
    system.remove(&name)
}

/// Separates the name of a record from the number of the change that wrote it.
pub(super) const BESIDE: &str = ".new-";
/// The pause after a failure.
const TRY_AGAIN: Duration = Duration::from_secs(1);
