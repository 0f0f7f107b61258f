//! The disk of a running bridge: nobody waits while it synchronises.
//!
//! A change that must survive a power cut is written at once, so that a disk that is full or read-only refuses it at
//! once, and is made durable by a thread of its own: `disk-writer` synchronises, renames and synchronises the folder,
//! once for all that has gathered meanwhile (a group commit). [`Disk::durable`] says how far it has come, and the bridge
//! holds what depends on it until then. What need survive the end of the process only is written as by [`FileDisk`].
//!
//! A record is written under a name of its own (`authority-1b000101.json.new-7`) and gets its own by the thread; a start
//! removes what a crash left. Until then the new bytes are read from memory.
//!
//! Where the thread fails (the device, not the room on it), it tries again, what waits goes on waiting, and further
//! changes are refused.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use mavlink_link::store::{Disk, Durability, StoreError};
use tokio::sync::Notify;
use zeroize::Zeroizing;

use super::disk::{FileDisk, FileSystem};

/// A [`FileDisk`] with a thread that synchronises.
#[derive(Debug)]
pub struct QueuedDisk {
    disk: FileDisk,
    /// Records that the thread has not renamed yet, by their names.
    waiting: BTreeMap<String, Waiting>,
    /// What the thread is given next.
    next: Batch,
    /// The thread has work.
    busy: bool,
    queued: u64,
    durable: u64,
    /// What [`QueuedDisk::poll`] last reported.
    reported: u64,
    /// Why the thread cannot go on.
    fault: Option<String>,
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
    logs: BTreeMap<String, File>,
    /// Files that were deleted while a record of that name was on its way.
    removed: Vec<String>,
    /// Names have changed.
    folder: bool,
}

impl Batch {
    fn is_empty(&self) -> bool {
        self.records.is_empty() && self.logs.is_empty() && self.removed.is_empty() && !self.folder
    }
}

/// What the thread reports.
#[derive(Debug)]
enum Done {
    /// All up to this change is durable.
    Durable(u64),
    /// It is not, and will be tried again.
    Failed(String),
}

impl QueuedDisk {
    /// Starts the thread. `progress` is notified whenever [`QueuedDisk::poll`] has something to take.
    ///
    /// # Errors
    /// What a crash left cannot be removed, or there can be no thread.
    pub fn new(disk: FileDisk, progress: Arc<Notify>) -> io::Result<QueuedDisk> {
        sweep(&disk)?;
        let (work, batches) = channel();
        let (reports, done) = channel();
        let (system, folder) = (disk.system(), disk.folder().to_owned());
        std::thread::Builder::new()
            .name("disk-writer".to_owned())
            .spawn(move || write(&*system, &folder, &batches, &reports, &progress))?;
        Ok(QueuedDisk {
            disk,
            waiting: BTreeMap::new(),
            next: Batch::default(),
            busy: false,
            queued: 0,
            durable: 0,
            reported: 0,
            fault: None,
            work,
            done,
        })
    }

    /// Takes what the thread has done; true where more is durable than at the call before.
    pub fn poll(&mut self) -> bool {
        while let Ok(done) = self.done.try_recv() {
            self.take(done);
        }
        // Not compared with the start of this call: whoever waited in between has taken the reports already.
        let before = std::mem::replace(&mut self.reported, self.durable);
        self.durable > before
    }

    /// Waits until all is durable; false where it fails, or is not within this time.
    pub fn wait(&mut self, within: Duration) -> bool {
        let end = Instant::now() + within;
        while self.busy {
            match self
                .done
                .recv_timeout(end.saturating_duration_since(Instant::now()))
            {
                Ok(done) => self.take(done),
                Err(_) => return false,
            }
            if self.fault.is_some() {
                return false;
            }
        }
        true
    }

    /// The same disk for who cannot be answered later: each change is durable when its call returns.
    pub fn waiting(&mut self) -> WaitingDisk<'_> {
        WaitingDisk(self)
    }

    fn take(&mut self, done: Done) {
        match done {
            Done::Durable(change) => {
                if self.fault.take().is_some() {
                    tracing::info!("the store can be written again");
                }
                self.durable = change;
                self.waiting.retain(|_, one| one.change > change);
                self.busy = false;
                self.start();
            }
            Done::Failed(fault) => {
                if self.fault.is_none() {
                    tracing::error!("the store cannot be written: {fault}");
                }
                self.fault = Some(fault);
            }
        }
    }

    /// Gives the thread what has gathered, where it has nothing to do.
    fn start(&mut self) {
        if !self.busy && !self.next.is_empty() {
            let mut batch = std::mem::take(&mut self.next);
            batch.change = self.queued;
            // It ends with this disk.
            self.busy = self.work.send(batch).is_ok();
        }
    }

    fn check(&self, name: &str) -> Result<(), StoreError> {
        match &self.fault {
            Some(fault) => Err(StoreError::new(name, fault)),
            None => Ok(()),
        }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.disk.folder().join(name)
    }

    /// A change that the thread makes durable.
    fn queue(&mut self) -> u64 {
        self.queued += 1;
        self.queued
    }
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
        let beside = self.path(&format!("{name}{BESIDE}{}", self.queued + 1));
        let system = self.disk.system();
        if let Err(cause) = system.write(&beside, bytes) {
            let _ = system.remove(&beside);
            return Err(StoreError::new(name, cause));
        }
        let waiting = Waiting {
            change: self.queue(),
            beside,
            bytes: Arc::new(Zeroizing::new(bytes.to_vec())),
        };
        self.waiting.insert(name.to_owned(), waiting.clone());
        // Only the last of several that gather is synchronised.
        if let Some(before) = self.next.records.insert(name.to_owned(), waiting) {
            let _ = system.remove(&before.beside);
        }
        self.next.removed.retain(|removed| removed != name);
        self.start();
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
        self.next.folder |= new;
        if power {
            self.queue();
            self.next.logs.insert(name.to_owned(), file);
        }
        self.start();
        Ok(())
    }

    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
        self.check(from)?;
        match self.disk.system().rename(&self.path(from), &self.path(to)) {
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(()),
            Err(cause) => return Err(StoreError::new(from, cause)),
            Ok(()) => {}
        }
        // Lines of it that are not durable yet stay so under its new name.
        if let Some(file) = self.next.logs.remove(from) {
            self.next.logs.insert(to.to_owned(), file);
        }
        self.queue();
        self.next.folder = true;
        self.start();
        Ok(())
    }

    fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        self.check(name)?;
        let removed = self.disk.system().remove(&self.path(name));
        removed.map_err(|cause| StoreError::new(name, cause))?;
        if self.waiting.remove(name).is_some() {
            if let Some(record) = self.next.records.remove(name) {
                let _ = self.disk.system().remove(&record.beside);
            }
            self.next.removed.push(name.to_owned());
        }
        self.queue();
        self.next.folder = true;
        self.start();
        Ok(())
    }

    fn queues(&self) -> bool {
        true
    }

    fn queued(&self) -> u64 {
        self.queued
    }

    fn durable(&self) -> u64 {
        self.durable
    }
}

/// A [`QueuedDisk`] of which each change is durable when its call returns: the key exchange writes rarely, and sends in
/// the same call.
#[derive(Debug)]
pub struct WaitingDisk<'a>(&'a mut QueuedDisk);

impl WaitingDisk<'_> {
    fn finish(&mut self, name: &str, done: Result<(), StoreError>) -> Result<(), StoreError> {
        done?;
        if self.0.wait(AN_EXCHANGE_WAITS) {
            return Ok(());
        }
        self.0.check(name)?;
        Err(StoreError::new(name, "not durable within 2 s"))
    }
}

impl Disk for WaitingDisk<'_> {
    fn read(&self, name: &str, max_bytes: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        self.0.read(name, max_bytes)
    }

    fn replace(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        let done = self.0.replace(name, bytes, durability);
        self.finish(name, done)
    }

    fn append(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        let done = self.0.append(name, bytes, durability);
        self.finish(name, done)
    }

    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
        let done = self.0.rename(from, to);
        self.finish(from, done)
    }

    fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        let done = self.0.remove(name);
        self.finish(name, done)
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
    while let Ok(batch) = batches.recv() {
        let mut first = true;
        while let Err(cause) = make_durable(system, folder, &batch, first) {
            first = false;
            let _ = reports.send(Done::Failed(cause.to_string()));
            progress.notify_one();
            std::thread::sleep(TRY_AGAIN);
        }
        let _ = reports.send(Done::Durable(batch.change));
        progress.notify_one();
    }
}

/// The logs before the records: a crash in between leaves a line too many, never a change without its line.
fn make_durable(
    system: &dyn FileSystem,
    folder: &Path,
    batch: &Batch,
    first: bool,
) -> io::Result<()> {
    for file in batch.logs.values() {
        system.sync_open(file)?;
    }
    for record in batch.records.values() {
        if !first {
            // What a failed synchronisation leaves in the system's memory may look as if it were on the disk.
            system.write(&record.beside, &record.bytes)?;
        }
        system.sync(&record.beside)?;
    }
    for (name, record) in &batch.records {
        system.rename(&record.beside, &folder.join(name))?;
    }
    for name in &batch.removed {
        system.remove(&folder.join(name))?;
    }
    // Names and deletions are entries of the folder.
    system.sync(folder)
}

/// Between the name of a record and the number of the change that wrote it.
const BESIDE: &str = ".new-";
/// How long the bridge stands still for a key at most: less than any watchdog.
const AN_EXCHANGE_WAITS: Duration = Duration::from_secs(2);
/// The pause after a failure.
const TRY_AGAIN: Duration = Duration::from_secs(1);
