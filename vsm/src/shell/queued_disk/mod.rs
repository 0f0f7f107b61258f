//! The disk of a running bridge: no caller waits while it synchronises.
//!
//! A change that must survive a power cut is written at once, so that a full or read-only disk refuses it at once (but what a
//! link lives by, below). A separate thread makes it durable: `disk-writer` synchronises, renames and synchronises the
//! folder, once for all changes that have gathered meanwhile (a group commit). [`Disk::progress`] reports how far it is, and
//! the bridge holds back what depends on it until then. A change that must survive only the end of the process is written as
//! by [`FileDisk`], unless the store is shared with other nodes: they do not see this folder.
//!
//! The ceilings of signing clocks and the epochs of encrypted links have their own thread: a link must not fall silent because
//! another part has much to write, or cannot be written. That thread does all of it: with a thousand vehicles some forty ceilings
//! are due together, and no vehicle waits for forty new files. Once known, ceilings are read from memory, since each new one is
//! compared with the one before.
//!
//! A record is first written under a temporary name (`authority-1b000101.json.new-7`); the thread renames it. Until then
//! the new bytes are read from memory. A start removes what a crash left. Where a full disk has no room for that, the thread
//! writes what a link lives by over what is there (`keeps_its_room`).
//!
//! If a thread cannot make a file durable, it tries that file again. What depends on the file continues to wait, and
//! further changes of it are refused: an accepted change takes effect in the end, or never if the process ends; a refused
//! one never does. The other files are not affected.
//!
//! It never synchronises the same bytes in memory again. Linux reports a failed write-back to one `fsync` and may then
//! count the pages as clean, so the next `fsync` succeeds with nothing written. Therefore a record is rewritten. So is a
//! log: its end is kept here until it is durable (`Tail`), and on a failure the log becomes a record, written beside and
//! renamed. A start does the same to the audit logs that it finds, since the process before may have ended in that state,
//! and the first line of a process does it to any other log. A folder gets a new name before its names are synchronised
//! again.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::ops::Bound::{Excluded, Included};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use mavlink_link::clock::CEILING;
use mavlink_link::store::{
    Changes, Disk, Durability, MAX_RECORD_BYTES, Progress, StoreError, remedy,
};
use tokio::sync::Notify;
use zeroize::Zeroizing;

pub(super) use self::writer::dirty_names;
use self::writer::{BESIDE, Batch, Done, Grown, Waiting, write};
use super::disk::{Added, FileDisk, is_numbered, keeps_its_room, replace};
use super::lent_files::LentFiles;
use crate::session::MAX_LOG_BYTES;

mod writer;

/// A [`FileDisk`] with threads that synchronise.
#[derive(Debug)]
pub struct QueuedDisk {
    disk: FileDisk,
    /// Records, and logs written whole, that have not been renamed yet, by their names.
    waiting: BTreeMap<String, Waiting>,
    /// The ends of logs that may not be on the disk yet.
    tails: BTreeMap<String, Tail>,
    /// Logs that this process created, or has written whole.
    begun: BTreeSet<String>,
    /// The ceilings of clocks, as last written or read. Nobody else writes them, since the store is locked.
    ceilings: RefCell<BTreeMap<String, Option<Zeroizing<Vec<u8>>>>>,
    queued: u64,
    /// The changes that are not durable yet, and the file of each.
    open: BTreeMap<u64, String>,
    /// Why a file cannot be made durable.
    faults: BTreeMap<String, String>,
    /// There is news since the last [`QueuedDisk::poll`].
    news: bool,
    /// What links live by, and everything else.
    lanes: [Lane; 2],
}

/// A thread, and its next work.
#[derive(Debug)]
struct Lane {
    next: Batch,
    /// The last change that was passed to it.
    given: u64,
    /// It has work.
    busy: bool,
    work: Sender<Batch>,
    done: Receiver<Done>,
}

/// The end of a log, which is lost if a synchronisation fails.
#[derive(Debug)]
struct Tail {
    /// Identifies the file, whatever its name is by now.
    id: u64,
    /// Where it begins.
    start: u64,
    bytes: Vec<u8>,
}

impl QueuedDisk {
    /// Starts the threads. `progress` is notified whenever [`QueuedDisk::poll`] has news.
    ///
    /// # Errors
    /// What a crash left cannot be removed, or there can be no thread.
    pub fn new(disk: FileDisk, progress: Arc<Notify>) -> io::Result<QueuedDisk> {
        sweep(&disk)?;
        let lane = |name: &str| {
            let (work, batches) = channel();
            let (reports, done) = channel();
            let (system, folder) = (LentFiles::of(&disk), disk.folder().to_owned());
            let progress = progress.clone();
            std::thread::Builder::new()
                .name(name.to_owned())
                .spawn(move || write(&system, &folder, &batches, &reports, &progress))?;
            io::Result::Ok(Lane {
                next: Batch::default(),
                given: 0,
                busy: false,
                work,
                done,
            })
        };
        let lanes = [lane("clock-writer")?, lane("disk-writer")?];
        // The process before may have ended with names that could not be synchronised.
        dirty_names(&*disk.system(), disk.folder())?;
        disk.system().sync(disk.folder())?;
        let begun = renew(&disk)?;
        Ok(QueuedDisk {
            disk,
            waiting: BTreeMap::new(),
            tails: BTreeMap::new(),
            begun,
            ceilings: RefCell::default(),
            queued: 0,
            open: BTreeMap::new(),
            faults: BTreeMap::new(),
            news: false,
            lanes,
        })
    }

    /// The files below: writing there takes effect at once.
    #[must_use]
    pub fn files(&self) -> &FileDisk {
        &self.disk
    }

    /// The ceiling of a clock, as another thread has read it.
    pub(super) fn know(&self, name: &str, bytes: Option<Zeroizing<Vec<u8>>>) {
        if name.starts_with(CEILING) {
            let mut ceilings = self.ceilings.borrow_mut();
            ceilings.entry(name.to_owned()).or_insert(bytes);
        }
    }

    /// Collects the results of the threads; true if there is news since the last call.
    pub fn poll(&mut self) -> bool {
        for lane in 0..self.lanes.len() {
            while let Ok(done) = self.lanes[lane].done.try_recv() {
                self.take(lane, done);
            }
        }
        std::mem::take(&mut self.news)
    }

    /// Waits until everything that can be is durable; false if that takes longer, or something cannot be.
    pub fn wait(&mut self, within: Duration) -> bool {
        let end = Instant::now() + within;
        loop {
            // A result that is taken here must still be reported to the next poll.
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
            synced,
            lost,
        } = done;
        for name in &files {
            if self.faults.remove(name).is_some() {
                tracing::info!("{name} in the store can be written again");
            }
        }
        let is_done = |name: &String, of: u64| of <= change && files.contains(name);
        // By change number: a newer change of the same file stays open.
        self.open.retain(|of, name| !is_done(name, *of));
        self.waiting.retain(|name, one| !is_done(name, one.change));
        for (id, end) in synced {
            self.tails.retain(|_, tail| tail.id != id || tail.cut(end));
        }
        let mut failed = failed;
        for (name, id) in lost {
            self.write_whole(lane, name, id, change, &mut failed);
        }
        for (name, cause) in failed {
            if self.faults.insert(name.clone(), cause.clone()).is_none() {
                tracing::error!(
                    "{name} in the store cannot be written: {cause}{}",
                    remedy(&cause)
                );
            }
        }
        self.news = true;
        // The thread itself repeats a failed batch; it is idle only once it has reported a new one.
        self.lanes[lane].busy &= again;
        self.start(lane);
    }

    /// Has a log written whole, under its present name, whose end a thread could not synchronise.
    fn write_whole(
        &mut self,
        lane: usize,
        name: String,
        id: u64,
        change: u64,
        failed: &mut BTreeMap<String, String>,
    ) {
        let Some(now) = self.tails.iter().find(|(_, tail)| tail.id == id) else {
            // Deleted or replaced meanwhile: whatever is there is stored as it is.
            self.share_again(&name);
            return;
        };
        let now = now.0.clone();
        if now != name {
            // The log was renamed meanwhile: its open changes and its fault belong to the new name.
            for (_, of) in self.open.range_mut(..=change).filter(|one| *one.1 == name) {
                of.clone_from(&now);
            }
            let cause = failed.remove(&name);
            failed.extend(cause.map(|cause| (now.clone(), cause)));
        }
        let Some(tail) = self.tails.remove(&now) else {
            // Replaced meanwhile: what is there is stored as it is.
            self.share_again(&now);
            return;
        };
        // One that something else has made longer than any log becomes would fill the memory, and is not read.
        let mut bytes = match self.disk.read(&now, tail.start.min(MAX_RECORD_BYTES)) {
            Ok(Some(bytes)) if bytes.len() as u64 == tail.start => bytes,
            read => {
                // It cannot be repaired: it stays as it is, and is refused until a restart checks it.
                let cause = match read {
                    Err(fault) => fault.cause,
                    Ok(_) if tail.start > MAX_RECORD_BYTES => format!(
                        "it has more than {MAX_RECORD_BYTES} bytes: something else has written to it; keep a copy and restart"
                    ),
                    Ok(_) => "it is cut off".to_owned(),
                };
                failed.insert(now.clone(), cause);
                self.share_again(&now);
                return;
            }
        };
        bytes.extend_from_slice(&tail.bytes);
        let change = self.queue(&now);
        let waiting = Waiting {
            change,
            beside: self.beside(&now, change),
            bytes: Arc::new(bytes),
            log: true,
            written: false,
        };
        self.wait_for(&now, waiting);
        debug_assert_eq!(lane, lane_of(&now));
    }

    fn beside(&self, name: &str, change: u64) -> PathBuf {
        self.disk.folder().join(format!("{name}{BESIDE}{change}"))
    }

    /// Queues a record for renaming.
    fn wait_for(&mut self, name: &str, waiting: Waiting) {
        self.waiting.insert(name.to_owned(), waiting.clone());
        let next = &mut self.lanes[lane_of(name)].next;
        // Only the last of several gathered versions is synchronised.
        let before = next.records.insert(name.to_owned(), waiting);
        if let Some(before) = before.filter(|before| before.written) {
            let _ = self.disk.system().remove(&before.beside);
        }
        next.logs.retain(|log| log.name != name);
        next.removed.remove(name);
    }

    /// Queues a record, or a whole log, which is written beside at once.
    fn put(&mut self, name: &str, bytes: Zeroizing<Vec<u8>>, log: bool) -> Result<(), StoreError> {
        let beside = self.beside(name, self.queued + 1);
        // Nothing is promised before such a record is durable, and a full disk has room for it: so its thread writes it too.
        // To create a file may take as long as the file system is busy with others.
        let later = keeps_its_room(name) && self.disk.has(name);
        let system = self.disk.system();
        if !later && let Err(cause) = system.write(&beside, &bytes) {
            let _ = system.remove(&beside);
            return Err(StoreError::new(name, cause));
        }
        let waiting = Waiting {
            change: self.queue(name),
            beside,
            bytes: Arc::new(bytes),
            log,
            written: !later,
        };
        self.wait_for(name, waiting);
        self.start(lane_of(name));
        Ok(())
    }

    /// Passes the gathered work to a thread that is idle.
    fn start(&mut self, lane: usize) {
        let lane = &mut self.lanes[lane];
        if !lane.busy && !lane.next.is_empty() {
            let mut batch = std::mem::take(&mut lane.next);
            batch.change = self.queued;
            lane.given = self.queued;
            // The thread ends with this disk.
            lane.busy = lane.work.send(batch).is_ok();
        }
    }

    /// Has a log stored elsewhere as it is, if a thread could not synchronise it and it is not written whole. Until then
    /// the thread tries nothing again that it was given before.
    fn share_again(&mut self, name: &str) {
        if self.disk.system().is_shared() {
            let lane = lane_of(name);
            self.lanes[lane].next.names.insert(name.to_owned());
            self.queue(name);
            self.start(lane);
        }
    }

    fn check(&self, name: &str) -> Result<(), StoreError> {
        match self.faults.get(name) {
            Some(fault) => Err(StoreError::new(name, fault)),
            None => Ok(()),
        }
    }

    /// Numbers a change of this file that a thread makes durable.
    fn queue(&mut self, name: &str) -> u64 {
        self.queued += 1;
        self.open.insert(self.queued, name.to_owned());
        self.queued
    }
}

/// The thread of a file.
fn lane_of(name: &str) -> usize {
    usize::from(!keeps_its_room(name))
}

impl Disk for QueuedDisk {
    fn read(&self, name: &str, max_bytes: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        let Some(waiting) = self.waiting.get(name) else {
            if let Some(known) = self.ceilings.borrow().get(name) {
                return Ok(known.clone());
            }
            let read = self.disk.read(name, max_bytes)?;
            self.know(name, read.clone());
            return Ok(read);
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
        // A write that follows a queued record must be queued too: otherwise the queued one would overwrite it. So must every
        // write of a shared store: a file that is in the folder is stored with the next one, perhaps before the line of its
        // log, and the node that takes over in between would find a change without its line.
        let shared = self.disk.system().is_shared();
        if durability == Durability::Process && !shared && !self.waiting.contains_key(name) {
            self.ceilings.get_mut().remove(name);
            self.disk.replace(name, bytes, durability)?;
            // The end of a replaced log does not belong to the new one.
            self.tails.remove(name);
            self.lanes[lane_of(name)]
                .next
                .logs
                .retain(|log| log.name != name);
            return Ok(());
        }
        self.check(name)?;
        self.put(name, Zeroizing::new(bytes.to_vec()), false)?;
        self.ceilings.get_mut().remove(name);
        self.know(name, Some(Zeroizing::new(bytes.to_vec())));
        Ok(())
    }

    fn append(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        let power = durability == Durability::Power;
        let shared = self.disk.system().is_shared();
        if power || shared {
            self.check(name)?;
        }
        // A log that this process did not begin may have an end that a failed synchronisation lost: see the head of this
        // file.
        if self.waiting.contains_key(name) || (power && !self.begun.contains(name)) {
            let is_there = self.waiting.contains_key(name) || self.disk.has(name);
            let read = || self.read_whole(name, MAX_RECORD_BYTES);
            let before = is_there.then(read).transpose()?;
            let mut all = before.flatten().unwrap_or_default();
            // Allocated in full: a growing buffer copies its content.
            all.reserve_exact(bytes.len());
            all.extend_from_slice(bytes);
            self.put(name, all, true)?;
            self.begun.insert(name.to_owned());
            return Ok(());
        }
        let added = self.disk.add(name, bytes);
        let Added { file, start, new } = added.map_err(|cause| StoreError::new(name, cause))?;
        let lane = lane_of(name);
        if power || shared {
            let id = self.queue(name);
            let tail = self.tails.entry(name.to_owned()).or_insert(Tail {
                id,
                start,
                bytes: Vec::new(),
            });
            tail.bytes.extend_from_slice(bytes);
            let logs = &mut self.lanes[lane].next.logs;
            logs.retain(|log| log.name != name);
            logs.push(Grown {
                name: name.to_owned(),
                file,
                id: tail.id,
                end: tail.end(),
            });
        } else if let Some(tail) = self.tails.get_mut(name) {
            // Not durable by request, but part of what a rewrite must contain.
            tail.bytes.extend_from_slice(bytes);
        }
        if new {
            self.lanes[lane].next.names.insert(name.to_owned());
        }
        self.start(lane);
        Ok(())
    }

    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
        for name in [from, to] {
            self.check(name)?;
            // A queued record would be renamed after this, and undo it.
            if self.waiting.contains_key(name) {
                return Err(StoreError::new(name, "it is still being written"));
            }
        }
        let moved = self.disk.move_file(from, to);
        if !moved.map_err(|cause| StoreError::new(from, cause))? {
            return Ok(());
        }
        let lane = lane_of(from);
        let Lane { next, given, .. } = &mut self.lanes[lane];
        // Lines that are not durable yet are followed under the new name.
        for log in next.logs.iter_mut().filter(|log| log.name == from) {
            to.clone_into(&mut log.name);
        }
        self.tails.remove(to);
        if let Some(tail) = self.tails.remove(from) {
            self.tails.insert(to.to_owned(), tail);
        }
        self.begun.remove(to);
        if self.begun.remove(from) {
            self.begun.insert(to.to_owned());
        }
        // Changes already given to the thread keep the old name, under which it reports them.
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
        self.ceilings.get_mut().remove(name);
        self.tails.remove(name);
        self.begun.remove(name);
        let lane = lane_of(name);
        let next = &mut self.lanes[lane].next;
        // Its thread may still rename the record: deleting the name again comes after that.
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

    fn failing(&self) -> Option<StoreError> {
        let first = self.faults.first_key_value();
        first.map(|(name, cause)| StoreError::new(&**name, cause))
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

impl Tail {
    fn end(&self) -> u64 {
        self.start + self.bytes.len() as u64
    }

    /// Everything before `end` is durable; returns whether anything is left.
    fn cut(&mut self, end: u64) -> bool {
        let done = usize::try_from(end.saturating_sub(self.start)).unwrap_or(usize::MAX);
        self.bytes.drain(..done.min(self.bytes.len()));
        self.start = self.start.max(end);
        !self.bytes.is_empty()
    }
}

/// Removes temporary files of records that a crash has left.
fn sweep(disk: &FileDisk) -> io::Result<()> {
    for entry in std::fs::read_dir(disk.folder())? {
        let entry = entry?;
        if is_numbered(&entry.file_name().to_string_lossy()) {
            let path = entry.path();
            disk.system().remove(&path).map_err(|cause| {
                io::Error::new(cause.kind(), format!("{}: {cause}", path.display()))
            })?;
        }
    }
    Ok(())
}

/// Rewrites the audit logs of the process before: up to 1 MB each, which must not be done while a vehicle waits. A log that
/// cannot be written is tried again with its first line. One that something else has made longer is left as it is: it is put
/// aside before the next line. Returns the names of those that were rewritten.
fn renew(disk: &FileDisk) -> io::Result<BTreeSet<String>> {
    let mut renewed = BTreeSet::new();
    for name in disk.names().map_err(io::Error::other)? {
        if !name.starts_with(LOGS) || !name.ends_with(".log") {
            continue;
        }
        let (system, path) = (disk.system(), disk.folder().join(&name));
        let read = system.read(&path, MAX_LOG_BYTES + 1)?;
        if let Some(bytes) = read
            && bytes.len() as u64 <= MAX_LOG_BYTES
            && replace(&*system, &path, &bytes, true).is_ok()
        {
            renewed.insert(name);
        }
    }
    Ok(renewed)
}

/// Prefix of the names of audit logs.
pub(super) const LOGS: &str = "audit-";
/// How often the end of the program checks whether all is written.
const LOOK_AGAIN: Duration = Duration::from_millis(5);

#[cfg(test)]
mod tests;
