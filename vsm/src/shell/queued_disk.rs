//! The disk of a running bridge: nobody waits while it synchronises.
//!
//! A change that must survive a power cut is written at once, so that a disk that is full or read-only refuses it at
//! once, and is made durable by a thread of its own: `disk-writer` synchronises, renames and synchronises the folder,
//! once for all that has gathered meanwhile (a group commit). [`Disk::progress`] reports how far it has come, and the bridge
//! holds what depends on it until then. What need survive the end of the process only is written as by [`FileDisk`].
//!
//! The ceilings of signing clocks have a thread of their own: a link must not fall silent because somebody else has much
//! to write.
//!
//! A record is written under a name of its own (`authority-1b000101.json.new-7`) and gets its own by the thread; a start
//! removes what a crash left. Until then the new bytes are read from memory.
//!
//! Where a thread cannot make a file durable it tries that file again, what depends on it continues to wait, and further
//! changes of it are refused: what was taken takes effect in the end or with the process never, and what was refused
//! never does. The other files are not affected.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::File;
use std::io;
use std::ops::Bound::{Excluded, Included};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

use mavlink_link::clock::CEILING;
use mavlink_link::store::{Changes, Disk, Durability, Progress, StoreError};
use tokio::sync::Notify;
use zeroize::Zeroizing;

use super::disk::{FileDisk, FileSystem};

/// A [`FileDisk`] with threads that synchronise.
#[derive(Debug)]
pub struct QueuedDisk {
    disk: FileDisk,
    /// Records that have not been renamed yet, by their names.
    waiting: BTreeMap<String, Waiting>,
    queued: u64,
    /// The changes that are not durable yet, and the file of each.
    open: BTreeMap<u64, String>,
    /// Why a file cannot be made durable.
    faults: BTreeMap<String, String>,
    /// Something has come of it since the last [`QueuedDisk::poll`].
    news: bool,
    /// The ceilings of clocks, and everything else.
    lanes: [Lane; 2],
}

/// A thread, and what it is given next.
#[derive(Debug)]
struct Lane {
    next: Batch,
    /// The last change that it was given.
    given: u64,
    /// It has work.
    busy: bool,
    work: Sender<Batch>,
    done: Receiver<Done>,
}

/// The content of a record that is not in its place yet.
#[derive(Debug, Clone)]
struct Waiting {
    /// The change that wrote it.
    change: u64,
    beside: PathBuf,
    bytes: Arc<Zeroizing<Vec<u8>>>,
}

/// What is made durable in one go.
#[derive(Debug, Default)]
struct Batch {
    /// The last change in it.
    change: u64,
    records: BTreeMap<String, Waiting>,
    /// Logs that have grown, open: they may be put aside under another name meanwhile.
    logs: Vec<(String, File)>,
    /// Files that were deleted while a record of that name was on its way.
    removed: BTreeSet<String>,
    /// Files that have come, gone or changed their names: their folder is synchronised.
    names: BTreeSet<String>,
    /// It has failed before.
    again: bool,
}

impl Batch {
    fn is_empty(&self) -> bool {
        self.records.is_empty()
            && self.logs.is_empty()
            && self.removed.is_empty()
            && self.names.is_empty()
    }

    fn all(&self) -> BTreeSet<String> {
        let logs = self.logs.iter().map(|(name, _)| name);
        let others = self.records.keys().chain(&self.removed).chain(&self.names);
        logs.chain(others).cloned().collect()
    }

    /// Keeps what is of one of these files.
    fn retain(&mut self, keep: impl Fn(&str) -> bool) {
        self.records.retain(|name, _| keep(name));
        self.logs.retain(|(name, _)| keep(name));
        self.removed.retain(|name| keep(name));
        self.names.retain(|name| keep(name));
    }

    /// Takes what has failed of a newer batch.
    fn add(&mut self, mut newer: Batch) {
        self.change = self.change.max(newer.change);
        self.records.append(&mut newer.records);
        self.logs.append(&mut newer.logs);
        self.removed.append(&mut newer.removed);
        self.names.append(&mut newer.names);
    }
}

/// What a thread reports of a batch.
#[derive(Debug)]
struct Done {
    /// All changes of these files up to this one are durable.
    change: u64,
    files: BTreeSet<String>,
    /// These are not, and are tried again.
    failed: BTreeMap<String, String>,
    /// It was tried again.
    again: bool,
}

impl QueuedDisk {
    /// Starts the threads. `progress` is notified whenever [`QueuedDisk::poll`] has something to take.
    ///
    /// # Errors
    /// What a crash left cannot be removed, or there can be no thread.
    pub fn new(disk: FileDisk, progress: Arc<Notify>) -> io::Result<QueuedDisk> {
        sweep(&disk)?;
        let lane = |name: &str| {
            let (work, batches) = channel();
            let (reports, done) = channel();
            let (system, folder) = (disk.system(), disk.folder().to_owned());
            let progress = progress.clone();
            std::thread::Builder::new()
                .name(name.to_owned())
                .spawn(move || write(&*system, &folder, &batches, &reports, &progress))?;
            io::Result::Ok(Lane {
                next: Batch::default(),
                given: 0,
                busy: false,
                work,
                done,
            })
        };
        let lanes = [lane("clock-writer")?, lane("disk-writer")?];
        Ok(QueuedDisk {
            disk,
            waiting: BTreeMap::new(),
            queued: 0,
            open: BTreeMap::new(),
            faults: BTreeMap::new(),
            news: false,
            lanes,
        })
    }

    /// The files below: what writes there writes at once.
    #[must_use]
    pub fn files(&self) -> &FileDisk {
        &self.disk
    }

    /// Takes what the threads have done; true where something has come of it since the call before.
    pub fn poll(&mut self) -> bool {
        for lane in 0..self.lanes.len() {
            while let Ok(done) = self.lanes[lane].done.try_recv() {
                self.take(lane, done);
            }
        }
        std::mem::take(&mut self.news)
    }

    /// Waits until all is durable that can be; false where that takes longer, or something cannot.
    pub fn wait(&mut self, within: Duration) -> bool {
        let end = Instant::now() + within;
        loop {
            // What is taken here is still news for whoever polls.
            self.news |= self.poll();
            if self
                .open
                .values()
                .all(|name| self.faults.contains_key(name))
            {
                return self.open.is_empty();
            }
            if Instant::now() >= end {
                return false;
            }
            std::thread::sleep(LOOK_AGAIN);
        }
    }

    fn take(&mut self, lane: usize, done: Done) {
        let Done {
            change,
            files,
            failed,
            again,
        } = done;
        for name in &files {
            if self.faults.remove(name).is_some() {
                tracing::info!("{name} in the store can be written again");
            }
        }
        let is_done = |name: &String, of: u64| of <= change && files.contains(name);
        self.open.retain(|of, name| !is_done(name, *of));
        self.waiting.retain(|name, one| !is_done(name, one.change));
        for (name, cause) in failed {
            if self.faults.insert(name.clone(), cause.clone()).is_none() {
                tracing::error!("{name} in the store cannot be written: {cause}");
            }
        }
        self.news = true;
        self.lanes[lane].busy &= again;
        self.start(lane);
    }

    /// Gives a thread what has gathered, where it has nothing to do.
    fn start(&mut self, lane: usize) {
        let lane = &mut self.lanes[lane];
        if !lane.busy && !lane.next.is_empty() {
            let mut batch = std::mem::take(&mut lane.next);
            batch.change = self.queued;
            lane.given = self.queued;
            // It ends with this disk.
            lane.busy = lane.work.send(batch).is_ok();
        }
    }

    fn check(&self, name: &str) -> Result<(), StoreError> {
        match self.faults.get(name) {
            Some(fault) => Err(StoreError::new(name, fault)),
            None => Ok(()),
        }
    }

    /// A change of this file that a thread makes durable.
    fn queue(&mut self, name: &str) -> u64 {
        self.queued += 1;
        self.open.insert(self.queued, name.to_owned());
        self.queued
    }
}

/// The thread of a file.
fn lane_of(name: &str) -> usize {
    usize::from(!name.starts_with(CEILING))
}

impl Disk for QueuedDisk {
    fn read(&self, name: &str, max_bytes: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        let Some(waiting) = self.waiting.get(name) else {
            return self.disk.read(name, max_bytes);
        };
        let max = usize::try_from(max_bytes).unwrap_or(usize::MAX);
        let bytes = waiting.bytes.get(..max).unwrap_or(&waiting.bytes);
        Ok(Some(Zeroizing::new(bytes.to_vec())))
    }

    fn replace(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        // One that follows a record on its way goes the same way: it would be overwritten otherwise.
        if durability == Durability::Process && !self.waiting.contains_key(name) {
            return self.disk.replace(name, bytes, durability);
        }
        self.check(name)?;
        let beside = format!("{name}{BESIDE}{}", self.queued + 1);
        let beside = self.disk.folder().join(beside);
        let system = self.disk.system();
        if let Err(cause) = system.write(&beside, bytes) {
            let _ = system.remove(&beside);
            return Err(StoreError::new(name, cause));
        }
        let waiting = Waiting {
            change: self.queue(name),
            beside,
            bytes: Arc::new(Zeroizing::new(bytes.to_vec())),
        };
        self.waiting.insert(name.to_owned(), waiting.clone());
        let lane = lane_of(name);
        let next = &mut self.lanes[lane].next;
        // Only the last of several that gather is synchronised.
        if let Some(before) = next.records.insert(name.to_owned(), waiting) {
            let _ = system.remove(&before.beside);
        }
        next.removed.remove(name);
        self.start(lane);
        Ok(())
    }

    fn append(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        let power = durability == Durability::Power;
        if power {
            self.check(name)?;
        }
        let added = self.disk.add(name, bytes);
        let (file, new) = added.map_err(|cause| StoreError::new(name, cause))?;
        let lane = lane_of(name);
        if power {
            self.queue(name);
            let logs = &mut self.lanes[lane].next.logs;
            logs.retain(|(known, _)| known != name);
            logs.push((name.to_owned(), file));
        }
        if new {
            self.lanes[lane].next.names.insert(name.to_owned());
        }
        self.start(lane);
        Ok(())
    }

    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
        self.check(from)?;
        let moved = self.disk.move_file(from, to);
        if !moved.map_err(|cause| StoreError::new(from, cause))? {
            return Ok(());
        }
        let lane = lane_of(from);
        let Lane { next, given, .. } = &mut self.lanes[lane];
        // Lines of it that are not durable yet stay so under its new name.
        for (name, _) in next.logs.iter_mut().filter(|(name, _)| name == from) {
            to.clone_into(name);
        }
        let later = self.open.range_mut((Excluded(*given), Included(u64::MAX)));
        for (_, name) in later.filter(|(_, name)| *name == from) {
            to.clone_into(name);
        }
        next.names.insert(to.to_owned());
        self.queue(to);
        self.start(lane);
        Ok(())
    }

    fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        self.check(name)?;
        let removed = self.disk.delete(name);
        removed.map_err(|cause| StoreError::new(name, cause))?;
        let lane = lane_of(name);
        let next = &mut self.lanes[lane].next;
        if self.waiting.remove(name).is_some() {
            if let Some(record) = next.records.remove(name) {
                let _ = self.disk.system().remove(&record.beside);
            }
            next.removed.insert(name.to_owned());
        }
        next.names.insert(name.to_owned());
        self.queue(name);
        self.start(lane);
        Ok(())
    }

    fn queues(&self) -> bool {
        true
    }

    fn queued(&self) -> u64 {
        self.queued
    }

    fn progress(&self, of: Changes) -> Progress {
        if of.is_empty() {
            return Progress::Durable;
        }
        let mut open = (self.open).range((Excluded(of.after), Included(of.until)));
        let failing = |(_, name): (_, &String)| self.faults.contains_key(name);
        if open.clone().any(failing) {
            Progress::Failing
        } else if open.next().is_some() {
            Progress::Waiting
        } else {
            Progress::Durable
        }
    }
}

/// Removes records that a crash has left under their names beside.
fn sweep(disk: &FileDisk) -> io::Result<()> {
    for entry in std::fs::read_dir(disk.folder())? {
        let entry = entry?;
        if entry.file_name().to_string_lossy().contains(BESIDE) {
            disk.system().remove(&entry.path())?;
        }
    }
    Ok(())
}

/// The thread: until its disk is dropped.
fn write(
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
                // The newer content of a file stands. Lines of a log are synchronised by either.
                for record in batch.all() {
                    if let Some(older) = failed.records.remove(&record) {
                        let _ = system.remove(&older.beside);
                    }
                    failed.removed.remove(&record);
                    failed.names.remove(&record);
                }
                batch
            }
            Err(RecvTimeoutError::Timeout) => std::mem::take(&mut failed),
            Err(RecvTimeoutError::Disconnected) => return,
        };
        let mut files = batch.all();
        let causes = make_durable(system, folder, &batch);
        let (change, again) = (batch.change, batch.again);
        batch.retain(|name| causes.contains_key(name));
        if !causes.is_empty() {
            failed.add(batch);
            failed.again = true;
            again_at = Instant::now() + TRY_AGAIN;
        }
        let left = failed.all();
        files.retain(|name| !left.contains(name));
        let _ = reports.send(Done {
            change,
            files,
            failed: causes,
            again,
        });
        progress.notify_one();
    }
}

/// What could not be made durable, and why. The logs before the records: a crash in between leaves a line too many, never
/// a change without its line.
fn make_durable(system: &dyn FileSystem, folder: &Path, batch: &Batch) -> BTreeMap<String, String> {
    let mut failed = BTreeMap::new();
    for (name, file) in &batch.logs {
        if let Err(cause) = system.sync_open(file) {
            failed.insert(name.clone(), cause.to_string());
        }
    }
    if let Some((log, cause)) = failed.clone().first_key_value() {
        // Each of the records may be the one that a line is about.
        let cause = format!("{log}: {cause}");
        failed.extend(
            batch
                .records
                .keys()
                .map(|name| (name.clone(), cause.clone())),
        );
    }
    let mut ready = Vec::new();
    for (name, record) in &batch.records {
        if failed.contains_key(name) {
            continue;
        }
        let mut written = Ok(());
        if batch.again {
            // What a failed synchronisation leaves in the system's memory may look as if it were on the disk.
            written = system.write(&record.beside, &record.bytes);
        }
        match written.and_then(|()| system.sync(&record.beside)) {
            Ok(()) => ready.push((name, record)),
            Err(cause) => drop(failed.insert(name.clone(), cause.to_string())),
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
    if let Err(cause) = system.sync(folder) {
        let all = batch.all().into_iter();
        return all.map(|name| (name, cause.to_string())).collect();
    }
    failed
}

/// Between the name of a record and the number of the change that wrote it.
const BESIDE: &str = ".new-";
/// The pause after a failure.
const TRY_AGAIN: Duration = Duration::from_secs(1);
/// How often the end of the program looks whether all is written.
const LOOK_AGAIN: Duration = Duration::from_millis(5);

#[cfg(test)]
mod tests {
    use super::*;

    fn disk(folder: &Path) -> QueuedDisk {
        let disk = FileDisk::open(folder).expect("a store");
        QueuedDisk::new(disk, Arc::new(Notify::new())).expect("a thread")
    }

    /// Makes a change; its progress as soon as that is no longer [`Progress::Waiting`].
    fn outcome(disk: &mut QueuedDisk, change: impl FnOnce(&mut QueuedDisk)) -> Progress {
        let after = disk.queued();
        change(disk);
        let until = disk.queued();
        wait(disk, Changes { after, until })
    }

    fn wait(disk: &mut QueuedDisk, of: Changes) -> Progress {
        let end = Instant::now() + Duration::from_secs(20);
        while disk.progress(of) == Progress::Waiting && Instant::now() < end {
            disk.poll();
            std::thread::sleep(Duration::from_millis(2));
        }
        disk.progress(of)
    }

    fn save(name: &'static str) -> impl FnOnce(&mut QueuedDisk) {
        move |disk| {
            disk.replace(name, name.as_bytes(), Durability::Power)
                .unwrap();
        }
    }

    #[test]
    fn one_record_that_became_a_folder_holds_back_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let store = folder.path().join("state");
        let mut disk = disk(&store);
        std::fs::create_dir(store.join("authority-1.json")).unwrap();
        let after = disk.queued();
        save("authority-1.json")(&mut disk);
        let stuck = Changes {
            after,
            until: disk.queued(),
        };
        // Side by side, and once the fault is known.
        for _ in 0..2 {
            let clock = outcome(&mut disk, save("clock-0102030405060708"));
            assert_eq!(clock, Progress::Durable);
            assert_eq!(
                outcome(&mut disk, save("authority-2.json")),
                Progress::Durable
            );
            let line = outcome(&mut disk, |disk| {
                disk.append("audit-2.log", b"line", Durability::Power)
                    .unwrap();
            });
            assert_eq!(line, Progress::Durable);
            assert_eq!(wait(&mut disk, stuck), Progress::Failing);
            // What is refused never takes effect.
            disk.replace("authority-1.json", b"3", Durability::Power)
                .unwrap_err();
        }
        // What was taken does, as soon as it can.
        std::fs::remove_dir(store.join("authority-1.json")).unwrap();
        assert!(!disk.wait(Duration::ZERO));
        let end = Instant::now() + Duration::from_secs(20);
        while disk.progress(stuck) != Progress::Durable && Instant::now() < end {
            disk.poll();
            std::thread::sleep(Duration::from_millis(10));
        }
        assert!(disk.wait(Duration::ZERO));
        let written = std::fs::read(store.join("authority-1.json")).unwrap();
        assert_eq!(written, b"authority-1.json");
        assert_eq!(
            outcome(&mut disk, save("authority-1.json")),
            Progress::Durable
        );
    }
}
