//! The disk of a running bridge: no caller waits for it.
//!
//! A change gets a number and goes to a thread, which does all of it: it creates and writes files, synchronises them, renames, and
//! synchronises the folder, once for all changes that have gathered meanwhile (a group commit). To create a file takes as long
//! as the file system is busy with others, so that is no different from a synchronisation. [`Disk::progress`] reports how far the
//! thread is, and the bridge holds back what depends on it until then; until then the new content is read from memory.
//!
//! A full or read-only disk refuses a change at once all the same: how much room there is, the system knows without asking the
//! disk ([`FileSystem::check_room`](super::disk::FileSystem::check_room)). Where something else takes the last of it in between,
//! the change is one that cannot be made durable, as below, and nothing more is accepted before it is written.
//!
//! What must survive `kill -9` before its call returns ([`Durability::Process`]) the caller writes itself, since memory does not
//! survive that: a line of a log that is there is one call of the system, and no file is created. A log is rewritten shorter
//! beside that (`compaction`). Such a write goes to the thread too where another of the same files is on its way, which would
//! come after it; and in a store that is shared with other nodes: they do not see this folder.
//!
//! The ceilings of signing clocks and the epochs of encrypted links have their own thread: a link must not fall silent because
//! another part has much to write, or cannot be written. With a thousand vehicles some forty ceilings are due together. Once known,
//! ceilings are read from memory, since each new one is compared with the one before. Where a full disk has no room beside them,
//! the thread writes over what is there (`keeps_its_room`).
//!
//! A file is first written under a temporary name (`authority-1b000101.json.new-1`), which a thread synchronises even where the file
//! need not survive a power cut: that must not leave its name on an empty file. A start removes what a crash left.
//!
//! If a thread cannot make a file durable, it tries that file again. What depends on the file continues to wait, and
//! further changes of its family (`steps`) are refused: an accepted change takes effect in the end, or never if the process ends; a
//! refused one never does. The other files are not affected, unless the disk is full.
//!
//! It never synchronises the same bytes in memory again. Linux reports a failed write-back to one `fsync` and may then
//! count the pages as clean, so the next `fsync` succeeds with nothing written. Therefore a record is rewritten. So is a
//! log: what was added is kept until it is durable, and on a failure the log is written whole, beside, and renamed. A start does the
//! same to the audit logs that it finds, since the process before may have ended in that state, and the first line of a process does
//! it to any other log. A folder gets a new name before its names are synchronised again.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::ops::Bound::{Excluded, Included};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::{Duration, Instant};

use mavlink_link::clock::CEILING;
use mavlink_link::store::{Changes, Disk, Durability, Progress, StoreError, remedy};
use tokio::sync::Notify;
use zeroize::Zeroizing;

use self::compaction::{Compact, Compacted, Compaction};
use self::steps::{Content, Step, Written, family_of};
use self::unwritten::{Base, Unwritten};
pub(super) use self::writer::dirty_names;
use self::writer::{Batch, Done, Fault, write};
use super::disk::{FileDisk, is_numbered, keeps_its_room, replace};
use super::lent_files::LentFiles;
use crate::session::MAX_LOG_BYTES;

mod compaction;
mod steps;
mod unwritten;
mod writer;

/// A [`FileDisk`] with threads that write.
#[derive(Debug)]
pub struct QueuedDisk {
    disk: FileDisk,
    /// Files with changes that are not done yet, by their names.
    unwritten: BTreeMap<String, Unwritten>,
    /// How much of them is in memory alone.
    bytes: u64,
    /// The lengths of files without such changes, where known.
    lengths: BTreeMap<String, u64>,
    /// Logs that are being rewritten shorter.
    compactions: BTreeMap<String, Compaction>,
    /// The ceilings of clocks, as last written or read. Nobody else writes them, since the store is locked.
    ceilings: RefCell<BTreeMap<String, Option<Zeroizing<Vec<u8>>>>>,
    queued: u64,
    /// The changes that are not done yet, and the family of each.
    open: BTreeMap<u64, String>,
    /// The last of them in each family.
    latest: BTreeMap<String, u64>,
    /// Why a family cannot be written.
    faults: BTreeMap<String, Fault>,
    /// There is news since the last [`QueuedDisk::poll`].
    news: bool,
    /// What links live by, and everything else.
    lanes: [Lane; 2],
}

/// A thread, and its next work.
#[derive(Debug)]
struct Lane {
    next: Batch,
    /// It has work.
    busy: bool,
    work: Sender<Batch>,
    done: Receiver<Done>,
}

impl QueuedDisk {
    /// Starts the threads. `progress` is notified whenever [`QueuedDisk::poll`] has news.
    ///
    /// # Errors
    /// What a crash left cannot be removed, or there can be no thread.
    pub fn new(disk: FileDisk, progress: Arc<Notify>) -> io::Result<QueuedDisk> {
        sweep(&disk)?;
        // The process before may have ended with names that could not be synchronised.
        dirty_names(&*disk.system(), disk.folder())?;
        disk.system().sync(disk.folder())?;
        let begun = renew(&disk)?;
        let lane = |name: &str, begun: BTreeSet<String>| {
            let (work, batches) = channel();
            let (reports, done) = channel();
            let (system, folder) = (LentFiles::of(&disk), disk.folder().to_owned());
            let progress = progress.clone();
            std::thread::Builder::new()
                .name(name.to_owned())
                .spawn(move || {
                    write(
                        (&system, folder.as_path()),
                        begun,
                        &batches,
                        &reports,
                        &progress,
                    )
                })?;
            io::Result::Ok(Lane {
                next: Batch::default(),
                busy: false,
                work,
                done,
            })
        };
        let lanes = [
            lane("clock-writer", BTreeSet::new())?,
            lane("disk-writer", begun)?,
        ];
        Ok(QueuedDisk {
            disk,
            unwritten: BTreeMap::new(),
            bytes: 0,
            lengths: BTreeMap::new(),
            compactions: BTreeMap::new(),
            ceilings: RefCell::default(),
            queued: 0,
            open: BTreeMap::new(),
            latest: BTreeMap::new(),
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

    /// Whether all changes up to this one are done, or cannot be.
    pub(super) fn is_tried(&self, until: u64) -> bool {
        let mut open = self.open.range(..=until);
        open.all(|(_, family)| self.faults.contains_key(family))
    }

    /// Waits until everything that can be is done; false if that takes longer, or something cannot be.
    pub fn wait(&mut self, within: Duration) -> bool {
        let end = Instant::now() + within;
        loop {
            // A result that is taken here must still be reported to the next poll.
            self.news |= self.poll();
            if self.compactions.is_empty() && self.is_tried(self.queued) {
                return self.open.is_empty();
            }
            if Instant::now() >= end {
                return false;
            }
            std::thread::sleep(LOOK_AGAIN);
        }
    }

    fn take(&mut self, lane: usize, report: Done) {
        let Done {
            done,
            failed,
            log_failed,
            compacted,
            again,
        } = report;
        for family in done.keys() {
            if let Some(fault) = self.faults.remove(family) {
                tracing::info!("{} in the store can be written again", fault.file);
            }
        }
        // By change number: a newer change of the same files stays open.
        let is_done = |family: &str, of: u64| done.get(family).is_some_and(|change| of <= *change);
        self.open.retain(|of, family| !is_done(family, *of));
        self.latest.retain(|family, of| !is_done(family, *of));
        let lengths = &mut self.lengths;
        self.unwritten.retain(|name, one| {
            let Some(change) = done.get(family_of(name)) else {
                return true;
            };
            if one.is_left_after(*change) {
                return true;
            }
            if let Some(length) = one.length().filter(|_| one.is_there()) {
                lengths.insert(name.clone(), length);
            }
            false
        });
        self.bytes = self.unwritten.values().map(Unwritten::bytes).sum();
        let mut is_news = false;
        for (family, fault) in failed {
            let text = format!(
                "{} in the store cannot be written: {}{}",
                fault.file,
                fault.cause,
                remedy(&fault.cause)
            );
            if self.faults.insert(family, fault).is_none() {
                is_news = true;
                tracing::error!("{text}");
            }
        }
        self.news = true;
        let next = &mut self.lanes[lane].next;
        next.blind |= log_failed && is_news && !next.is_empty();
        for one in compacted {
            self.continue_compaction(one);
        }
        // The thread itself repeats what failed; it is idle only once it has reported a new batch.
        self.lanes[lane].busy &= again;
        self.start(lane);
    }

    /// Passes the gathered work to a thread that is idle.
    fn start(&mut self, lane: usize) {
        let Lane {
            next, busy, work, ..
        } = &mut self.lanes[lane];
        if *busy || next.is_empty() {
            return;
        }
        for (name, one) in &mut self.unwritten {
            if lane_of(name) == lane {
                one.note_given();
            }
        }
        // The thread ends with this disk.
        *busy = work.send(std::mem::take(next)).is_ok();
    }

    /// Numbers a change of this file, and has its thread make it with the next ones.
    fn queue(&mut self, name: &str, power: bool, step: Step) {
        self.queued += 1;
        let family = family_of(name);
        self.open.insert(self.queued, family.to_owned());
        self.latest.insert(family.to_owned(), self.queued);
        let families = &mut self.lanes[lane_of(name)].next.families;
        let next = families.entry(family.to_owned()).or_default();
        next.change = self.queued;
        next.power |= power;
        next.push(step);
    }

    /// What a file holds once the last change is done.
    fn note(&mut self, name: &str, base: Base) {
        let one = Unwritten::new(base, self.queued);
        self.bytes += one.bytes();
        self.lengths.remove(name);
        if let Some(before) = self.unwritten.insert(name.to_owned(), one) {
            self.bytes = self.bytes.saturating_sub(before.bytes());
        }
    }

    /// Whether a change must survive more than the end of the process.
    fn is_power(&self, durability: Durability) -> bool {
        durability == Durability::Power || self.disk.system().is_shared()
    }

    /// Whether the caller itself writes this.
    ///
    /// Not in a shared store: a file that is in the folder is stored with the next one, perhaps before the line of its log, and
    /// the node that takes over in between would find a change without its line.
    fn is_at_once(&self, name: &str, durability: Durability) -> bool {
        durability == Durability::Process
            && !self.latest.contains_key(family_of(name))
            && !self.disk.system().is_shared()
    }

    /// Whether a change by so many bytes is accepted; by none, if it is a name alone.
    fn check(&self, name: &str, bytes: u64) -> Result<(), StoreError> {
        if let Some(fault) = self.faults.get(family_of(name)) {
            return Err(StoreError::new(name, &fault.cause));
        }
        if self.compactions.contains_key(name) {
            return Err(StoreError::new(name, "it is still being rewritten"));
        }
        // Of what no link works without a full disk takes the next version too, but the first.
        if keeps_its_room(name) && self.is_there(name) {
            return Ok(());
        }
        let full = self.faults.values().find(|one| one.no_room);
        if let Some(full) = full.filter(|_| bytes > 0) {
            return Err(StoreError::new(name, &full.cause));
        }
        self.check_memory(name)?;
        let more = if bytes > 0 { self.bytes + bytes } else { 0 };
        let room = self.disk.system().check_room(self.disk.folder(), more);
        room.map_err(|cause| StoreError::new(name, cause))
    }

    /// What waits for a disk that hangs must not fill the memory.
    fn check_memory(&self, name: &str) -> Result<(), StoreError> {
        match self.bytes < MAX_WAITING {
            true => Ok(()),
            false => Err(StoreError::new(name, "the disk is too slow")),
        }
    }

    /// Whether a file is there, once all changes are done.
    fn is_there(&self, name: &str) -> bool {
        match self.unwritten.get(name) {
            Some(one) => one.is_there(),
            None => self.lengths.contains_key(name) || self.disk.has(name),
        }
    }

    /// Adds lines to a log, of which it is known that the caller does that.
    fn append_at_once(&mut self, name: &str, lines: &[u8]) -> io::Result<()> {
        let disk = &self.disk;
        let add = || disk.add(name, lines).map(drop);
        match self.compactions.get_mut(name) {
            Some(compaction) => compaction.append(lines, add)?,
            None => add()?,
        }
        if let Some(length) = self.lengths.get_mut(name) {
            *length += lines.len() as u64;
        }
        Ok(())
    }

    fn continue_compaction(&mut self, done: Compacted) {
        let (name, failed) = match done {
            Compacted::Written(name, written) => {
                let Some(compaction) = self.compactions.get_mut(&name) else {
                    return;
                };
                let both = written
                    .and_then(|new| Ok((self.disk.open_log(&name)?, new)))
                    .and_then(|(old, new)| compaction.write_both(old, new));
                let next = match &both {
                    Ok(()) => Compact::Place(name.clone()),
                    Err(_) => Compact::Drop(name.clone()),
                };
                self.lanes[lane_of(&name)].next.compactions.push(next);
                (name, both.err())
            }
            Compacted::Placed(name, placed) => {
                self.compactions.remove(&name);
                self.lengths.remove(&name);
                (name, placed.err())
            }
        };
        if let Some(cause) = failed {
            self.compactions.remove(&name);
            let remedy = remedy(&cause.to_string());
            tracing::warn!("{name} in the store is not made shorter: {cause}{remedy}");
        }
    }
}

/// The thread of a file.
fn lane_of(name: &str) -> usize {
    usize::from(!keeps_its_room(name))
}

impl Disk for QueuedDisk {
    fn read(&self, name: &str, max_bytes: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        if max_bytes == 0 {
            return Ok(self.is_there(name).then(Zeroizing::default));
        }
        if let Some(one) = self.unwritten.get(name) {
            return one.read(name, max_bytes, |most| self.disk.read(name, most));
        }
        if let Some(known) = self.ceilings.borrow().get(name) {
            return Ok(known.clone());
        }
        let read = self.disk.read(name, max_bytes)?;
        self.know(name, read.clone());
        Ok(read)
    }

    fn replace(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        if self.is_at_once(name, durability) && !self.compactions.contains_key(name) {
            self.ceilings.get_mut().remove(name);
            self.disk.replace(name, bytes, durability)?;
            self.lengths.insert(name.to_owned(), bytes.len() as u64);
            return Ok(());
        }
        self.check(name, bytes.len() as u64)?;
        let content: Content = Arc::new(Zeroizing::new(bytes.to_vec()));
        let step = Step::Replace {
            name: name.to_owned(),
            content: content.clone(),
            written: Written::No,
        };
        self.queue(name, self.is_power(durability), step);
        self.note(name, Base::Content(content));
        self.ceilings.get_mut().remove(name);
        self.know(name, Some(Zeroizing::new(bytes.to_vec())));
        self.start(lane_of(name));
        Ok(())
    }

    fn append(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        if self.is_at_once(name, durability) {
            let added = self.append_at_once(name, bytes);
            return added.map_err(|cause| StoreError::new(name, cause));
        }
        let power = self.is_power(durability);
        // What the caller writes otherwise is not refused here for a fault.
        match power || durability != Durability::Process {
            true => self.check(name, bytes.len() as u64)?,
            false => self.check_memory(name)?,
        }
        let step = Step::Append {
            name: name.to_owned(),
            lines: bytes.to_vec(),
        };
        self.queue(name, power, step);
        self.bytes += bytes.len() as u64;
        let change = self.queued;
        let (lengths, disk) = (&self.lengths, &self.disk);
        let one = self.unwritten.entry(name.to_owned()).or_insert_with(|| {
            let length = lengths.get(name).copied();
            let length = length.unwrap_or_else(|| disk.length(name));
            Unwritten::new(Base::Disk(length), change)
        });
        one.append(bytes, change);
        self.start(lane_of(name));
        Ok(())
    }

    fn compact(&mut self, name: &str, bytes: &[u8]) -> Result<(), StoreError> {
        if !self.is_at_once(name, Durability::Process) {
            return self.replace(name, bytes, Durability::Process);
        }
        if self.compactions.contains_key(name) {
            // It is rewritten already; a later one finds more to leave out.
            return Ok(());
        }
        self.check(name, bytes.len() as u64)?;
        let content: Content = Arc::new(Zeroizing::new(bytes.to_vec()));
        self.compactions
            .insert(name.to_owned(), Compaction::default());
        let lane = lane_of(name);
        let next = &mut self.lanes[lane].next;
        next.compactions
            .push(Compact::Write(name.to_owned(), content));
        self.start(lane);
        Ok(())
    }

    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
        debug_assert_eq!(family_of(from), family_of(to), "their steps have an order");
        self.check(from, 0)?;
        if !self.is_there(from) {
            return Ok(());
        }
        let step = Step::Rename {
            from: from.to_owned(),
            to: to.to_owned(),
        };
        self.queue(from, true, step);
        for (name, base) in [(from, Base::Missing), (to, Base::Renamed)] {
            self.note(name, base);
        }
        self.start(lane_of(from));
        Ok(())
    }

    fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        self.check(name, 0)?;
        let step = Step::Remove {
            name: name.to_owned(),
        };
        self.queue(name, true, step);
        self.ceilings.get_mut().remove(name);
        self.note(name, Base::Missing);
        self.start(lane_of(name));
        Ok(())
    }

    fn queues(&self) -> bool {
        true
    }

    fn queued(&self) -> u64 {
        self.queued
    }

    fn failing(&self) -> Option<StoreError> {
        let first = self.faults.values().next();
        first.map(|fault| StoreError::new(&*fault.file, &fault.cause))
    }

    fn progress(&self, of: Changes) -> Progress {
        if of.is_empty() {
            return Progress::Durable;
        }
        let mut open = (self.open).range((Excluded(of.after), Included(of.until)));
        let failing = |(_, family): (_, &String)| self.faults.contains_key(family);
        if open.clone().any(failing) {
            Progress::Failing
        } else if open.next().is_some() {
            Progress::Waiting
        } else {
            Progress::Durable
        }
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
/// The most that waits for the disk, bytes: some of the largest records.
const MAX_WAITING: u64 = 64 << 20;
/// How often the end of the program checks whether all is written.
const LOOK_AGAIN: Duration = Duration::from_millis(5);

#[cfg(test)]
mod tests;
