//! A store's folder whose changes are all in etcd before they count as durable.
//!
//! What etcd gets of a file is bounded, whatever something else has written to it ([`max_bytes`]): a log of gigabytes would
//! fill etcd's quota, and delay every other file for minutes. Of one that is longer the beginning and the end are stored, so
//! that a line behind what does not belong there is stored before it counts.

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::os::fd::AsRawFd as _;
use std::os::unix::ffi::OsStringExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use mavlink_link::store::MAX_RECORD_BYTES;
use sha2::{Digest as _, Sha256};
use zeroize::Zeroizing;

use super::remote::{Head, LANES, Last, Remote};
use crate::session::MAX_LOG_BYTES;
use crate::shell::clock::since_boot;
use crate::shell::disk::{
    ERASE_ORDER, FLEET_EPOCH, FileSystem, NativeFileSystem, is_being_written, keeps_its_room,
};
use crate::shell::queued_disk::LOGS;

/// The file system of a node that owns its VSM.
///
/// The folder has the same content as without etcd. The steps that make a change durable (the synchronisation of a log, or
/// of the folder after a rename or a deletion) also store it in etcd, and fail if that fails. A node that ends in between
/// has a folder ahead of etcd by changes that nobody was promised; the next owner, which may be this node, continues from
/// etcd's state.
#[derive(Debug)]
pub(super) struct SharedFiles {
    folder: PathBuf,
    /// The same without links and relative parts, as the system names open files.
    real: PathBuf,
    remote: Arc<Remote>,
    /// The files that another node wrote, and after which moment since the boot of this computer, where that is known.
    since: BTreeMap<String, Duration>,
    /// What links live by, and everything else: a link must not wait while a plan is stored.
    lanes: [Lane; LANES],
}

#[derive(Debug, Default)]
struct Lane {
    /// Files written, renamed or deleted since they were last stored. Lock this one after `stored`.
    changed: Mutex<BTreeSet<String>>,
    /// What etcd has. Locked as long as it is being changed: a thread that finds no change under this lock knows that all
    /// is stored.
    stored: Mutex<StoredLane>,
}

#[derive(Debug, Default)]
struct StoredLane {
    files: BTreeMap<String, Stored>,
    last: Last,
}

#[derive(Debug, Clone, Copy, Default)]
struct Stored {
    /// The head of the last request with an answer.
    head: Head,
    /// The digest of the content if it was stored whole: a start rewrites files that have not changed.
    digest: Option<[u8; 32]>,
    /// How many bytes of a file that is too long are not stored; its last [`max_bytes`] / 2 at least are.
    left_out: u64,
}

/// What is stored of a file.
struct Part {
    bytes: Zeroizing<Vec<u8>>,
    left_out: u64,
}

thread_local! {
    /// The lanes in which this thread has changed a file since it synchronised the folder: the thread waits for these only.
    /// A thread that has changed no file synchronises the changes of others.
    static TOUCHED: Cell<[bool; 2]> = const { Cell::new([false; 2]) };
    /// This thread has written an order to erase, which must not wait for etcd.
    static ORDERED: Cell<bool> = const { Cell::new(false) };
}

impl StoredLane {
    /// A request about this file is sent: until it is answered, etcd's version of the file is unknown.
    fn doubt(&mut self, name: &str) {
        self.files.entry(name.to_owned()).or_default().digest = None;
    }
}

impl SharedFiles {
    /// For a folder that holds what etcd has. `since`: see there.
    pub(super) fn new(
        folder: &Path,
        remote: Arc<Remote>,
        heads: BTreeMap<String, Head>,
        since: BTreeMap<String, Duration>,
    ) -> io::Result<SharedFiles> {
        let lanes: [Lane; 2] = Default::default();
        for (name, head) in heads {
            let part = part_of(&name, &folder.join(&name)).ok().flatten();
            let digest = part.map(|part| digest(&part.bytes));
            let known = Stored {
                head,
                digest,
                left_out: 0,
            };
            let mut stored = locked(&lanes[lane_of(&name)].stored);
            stored.files.insert(name, known);
        }
        Ok(SharedFiles {
            folder: folder.to_owned(),
            real: fs::canonicalize(folder)?,
            remote,
            since,
            lanes,
        })
    }

    /// The name of a file that is also in etcd.
    fn name_of(&self, path: &Path) -> Option<String> {
        let name = path.strip_prefix(&self.folder).ok()?.to_str()?;
        is_stored(name).then(|| name.to_owned())
    }

    fn note(&self, path: &Path) {
        self.note_all(&[path]);
    }

    /// Notes the changes of one step at once, so that no thread sees a part of it. Both names of a rotated file are of one
    /// lane.
    fn note_all(&self, paths: &[&Path]) {
        if paths.contains(&&*self.folder.join(ERASE_ORDER)) {
            ORDERED.set(true);
        }
        let names: Vec<String> = paths.iter().filter_map(|path| self.name_of(path)).collect();
        let Some(lane) = names.first().map(|name| lane_of(name)) else {
            return;
        };
        // A rename across lanes could be stored half by another thread.
        debug_assert!(names.iter().all(|name| lane_of(name) == lane), "{names:?}");
        let mut touched = TOUCHED.get();
        touched[lane] = true;
        TOUCHED.set(touched);
        locked(&self.lanes[lane].changed).extend(names);
    }

    /// Stores the changes in the lanes of this thread, or in all lanes if it has changed nothing itself.
    fn store(&self) -> io::Result<()> {
        let touched = TOUCHED.get();
        let none = touched == [false; 2];
        for lane in (0..LANES).filter(|lane| touched[*lane] || none) {
            self.store_lane(lane)?;
        }
        TOUCHED.set([false; 2]);
        Ok(())
    }

    fn store_lane(&self, lane: usize) -> io::Result<()> {
        let Lane { changed, stored } = &self.lanes[lane];
        // Locked before the list of changes is read: another thread may be storing just these, and fail.
        let mut stored = locked(stored);
        let mut left = std::mem::take(&mut *locked(changed));
        let mut done = Ok(());
        // Puts before removals. A change that arrives meanwhile is stored next time.
        let is_there = |name: &String| self.folder.join(name).exists();
        let (puts, removals): (Vec<String>, Vec<String>) = left.iter().cloned().partition(is_there);
        for name in in_order(puts).chain(removals) {
            done = self.store_file(lane, &name, &mut stored);
            if done.is_err() {
                break;
            }
            left.remove(&name);
        }
        // What failed is tried again with the next synchronisation.
        locked(changed).append(&mut left);
        done
    }

    /// Stores the present content of a file.
    fn store_file(&self, lane: usize, name: &str, stored: &mut StoredLane) -> io::Result<()> {
        let before = stored.files.get(name).copied();
        let Some(part) = part_of(name, &self.folder.join(name))? else {
            if before.is_some() {
                stored.doubt(name);
                self.remote.remove((lane, &mut stored.last), name)?;
                stored.files.remove(name);
            }
            return Ok(());
        };
        let Part { bytes, left_out } = part;
        let digest = Some(digest(&bytes));
        if before.is_some_and(|it| {
            (it.digest, it.head.length, it.left_out) == (digest, bytes.len() as u64, left_out)
        }) {
            return Ok(());
        }
        if left_out > 0 {
            warn_of_part(name, left_out);
        }
        stored.doubt(name);
        let head = self
            .remote
            .replace((lane, &mut stored.last), name, &bytes)?;
        let now = Stored {
            head,
            digest,
            left_out,
        };
        stored.files.insert(name.to_owned(), now);
        Ok(())
    }

    /// Stores the new end of a log.
    fn store_end(&self, name: &str, file: &File) -> io::Result<()> {
        let lane = lane_of(name);
        let Lane { changed, stored } = &self.lanes[lane];
        let mut stored = locked(stored);
        let length = file.metadata()?.len();
        let most = max_bytes(name);
        // What etcd lacks, and what is sent of it; `None` where the file is shorter than what etcd has, or something else makes it
        // longer again and again: then etcd has beginning and end of it from now on.
        let lacks = |known: Stored| {
            let lacking = length.checked_sub(known.left_out + known.head.length)?;
            let sent = if lacking > most { most / 2 } else { lacking };
            let is_bounded = known.head.length + sent <= MAX_TAKEN_OVER * most;
            is_bounded.then_some((known, lacking, sent))
        };
        let grown = stored.files.get(name).copied().and_then(lacks);
        // Renamed, deleted or replaced meanwhile: the file now under this name is not the one that etcd has. It is stored
        // with the other changed files, in their order.
        let is_same = !locked(changed).contains(name);
        let Some((known, lacking, sent)) = grown.filter(|_| is_same) else {
            locked(changed).insert(name.to_owned());
            drop(stored);
            return self.store_lane(lane);
        };
        stored.doubt(name);
        // This open file, whatever its name is now.
        let path = format!("/proc/self/fd/{}", file.as_raw_fd());
        let before = known.head.length;
        let left_out = known.left_out + (lacking - sent);
        if sent < lacking {
            warn_of_part(name, left_out);
        }
        let read = |from: u64| {
            let mut file = File::open(&path)?;
            let mut bytes = Zeroizing::new(Vec::new());
            // What etcd has of the last piece, and what it lacks.
            let has = (from + known.left_out, before - from);
            for (start, count) in [has, (length - sent, sent)] {
                file.seek(SeekFrom::Start(start))?;
                file.by_ref().take(count).read_to_end(&mut bytes)?;
            }
            Ok(bytes)
        };
        let grown = (known.head, before + sent);
        match self
            .remote
            .append((lane, &mut stored.last), name, grown, read)
        {
            Ok(head) => {
                let now = Stored {
                    head,
                    digest: None,
                    left_out,
                };
                stored.files.insert(name.to_owned(), now);
                Ok(())
            }
            Err(cause) => {
                // Part of it may be stored: next time the file is stored whole.
                locked(changed).insert(name.to_owned());
                Err(cause)
            }
        }
    }

    /// Stores the whole folder, as the first owner.
    pub(super) fn store_all(&self, names: &[String]) -> io::Result<()> {
        for name in names.iter().filter(|name| is_stored(name)) {
            self.check_length(name)?;
        }
        {
            let mut stored = locked(&self.lanes[1].stored);
            self.remote.remove_all(1, &mut stored.last)?;
        }
        for name in names.iter().filter(|name| is_stored(name)) {
            self.note(&self.folder.join(name));
        }
        self.store()?;
        let mut stored = locked(&self.lanes[1].stored);
        // Only now do other nodes take this state for whole.
        self.remote.complete(1, &mut stored.last)
    }
}

impl SharedFiles {
    /// Refuses a file that no start would read: a part of it would be a record that is damaged. Of an audit log the beginning is
    /// read, whatever follows.
    ///
    /// Whatever its name: one that is left out would be deleted by the next start, as all that [`is_stored`] and etcd lacks.
    fn check_length(&self, name: &str) -> io::Result<()> {
        let (length, most) = (
            fs::symlink_metadata(self.folder.join(name))?.len(),
            max_bytes(name),
        );
        if length <= most || name.starts_with(LOGS) {
            return Ok(());
        }
        let fault = format!(
            "{name} in [store] dir has {length} bytes, more than the {most} that a file of a store has: it is of something else, or was written to by something else. Move it away, or put back a copy of it, and start this node again"
        );
        Err(io::Error::new(io::ErrorKind::InvalidData, fault))
    }
}

/// Reads what is stored of a file.
fn part_of(name: &str, path: &Path) -> io::Result<Option<Part>> {
    let most = max_bytes(name);
    let Some(mut bytes) = NativeFileSystem.read(path, most + 1)? else {
        return Ok(None);
    };
    if bytes.len() as u64 <= most {
        return Ok(Some(Part { bytes, left_out: 0 }));
    }
    // In all one byte more than anybody reads: that shows the next node, too, that it is too long.
    let end = most / 2;
    bytes.truncate(usize::try_from(most + 1 - end).unwrap_or(usize::MAX));
    let mut file = File::open(path)?;
    let length = file.metadata()?.len();
    file.seek(SeekFrom::Start(length.saturating_sub(end)))?;
    file.take(end).read_to_end(&mut bytes)?;
    let left_out = length.saturating_sub(bytes.len() as u64);
    Ok(Some(Part { bytes, left_out }))
}

fn warn_of_part(name: &str, left_out: u64) {
    tracing::warn!(
        "{name} is longer than it becomes: something else has written to it. etcd gets its beginning and its end, without {left_out} bytes between; keep a copy of it, since the next node, and the next start of this one, have only these"
    );
}

/// How many times [`max_bytes`] a copy in etcd may have at most: a part of a log that is too long, and lines since.
pub(super) const MAX_TAKEN_OVER: u64 = 2;

/// How many bytes of a file anybody reads at most.
pub(super) fn max_bytes(name: &str) -> u64 {
    if name.starts_with(LOGS) {
        MAX_LOG_BYTES
    } else {
        MAX_RECORD_BYTES
    }
}

impl FileSystem for SharedFiles {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        NativeFileSystem.write(path, bytes)?;
        self.note(path);
        Ok(())
    }

    fn write_over(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        NativeFileSystem.write_over(path, bytes)?;
        self.note(path);
        Ok(())
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        NativeFileSystem.sync(path)?;
        // An order to erase must take effect on this computer even when etcd does not answer.
        if path == self.folder && !ORDERED.take() {
            self.store()?;
        }
        Ok(())
    }

    fn check_room(&self, folder: &Path, bytes: u64) -> io::Result<()> {
        NativeFileSystem.check_room(folder, bytes)
    }

    fn sync_open(&self, file: &File) -> io::Result<()> {
        file.sync_data()?;
        // The log may have been rotated since it was opened; the system knows its present name.
        let path = rustix::fs::readlink(format!("/proc/self/fd/{}", file.as_raw_fd()), Vec::new())?;
        let path = PathBuf::from(OsString::from_vec(path.into_bytes()));
        let name = path.strip_prefix(&self.real).ok().and_then(Path::to_str);
        match name.map(|name| (name, name.strip_suffix(DELETED))) {
            // A deleted log needs no copy in etcd.
            Some((_, Some(_))) => Ok(()),
            Some((name, None)) => self.store_end(name, file),
            None => Err(io::Error::other(format!(
                "{} is not in {}: was the folder moved?",
                path.display(),
                self.real.display()
            ))),
        }
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        NativeFileSystem.rename(from, to)?;
        self.note_all(&[from, to]);
        Ok(())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        NativeFileSystem.remove(path)?;
        self.note(path);
        Ok(())
    }

    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        NativeFileSystem.read(path, most)
    }

    fn is_shared(&self) -> bool {
        true
    }

    fn written_within(&self, path: &Path) -> Option<Duration> {
        let since = self.since.get(&self.name_of(path)?)?;
        since_boot().checked_sub(*since)
    }
}

/// Records before logs, and the highest number of a log first. So a record has in etcd what it replaces before these lines are
/// deleted, or give way to others; and a rotated log has its new name before the old one is removed.
fn in_order(puts: Vec<String>) -> impl Iterator<Item = String> {
    let is_log = |name: &String| name.contains(".log");
    let (logs, records): (Vec<String>, Vec<String>) = puts.into_iter().rev().partition(is_log);
    records.into_iter().chain(logs)
}

/// Whether a file of the folder is stored in etcd: not locks, sockets, this node's own mark, or files still being written.
/// Everything else is, whoever has put it there: a start has the folder equal etcd, and deletes the rest.
pub(super) fn is_stored(name: &str) -> bool {
    let of_this_node = ["lock", FLEET_EPOCH, ERASE_ORDER, "zeroized"].contains(&name)
        // The keys of guards paired here are written by the pairing process, not through this file system.
        || (name.starts_with("guard-") && name.contains(".key"))
        || [".sock", ".lock"].iter().any(|end| name.ends_with(end));
    !of_this_node && !is_being_written(name) && !name.contains('/')
}

fn lane_of(name: &str) -> usize {
    usize::from(!keeps_its_room(name))
}

fn digest(bytes: &[u8]) -> [u8; 32] {
    Sha256::digest(bytes).into()
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The suffix that the system adds to the name of a deleted open file.
const DELETED: &str = " (deleted)";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plan_is_stored_before_the_log_that_continues_it_and_an_old_log_before_a_new_one() {
        let changed = [
            "audit-1.log",
            "audit-1.log.1",
            "audit-1.log.2",
            "authority-1.json",
            "plan-1.json",
            "plan-1.log",
        ];
        let stored: Vec<String> = in_order(changed.map(String::from).to_vec()).collect();
        let order = [
            "plan-1.json",
            "authority-1.json",
            "plan-1.log",
            "audit-1.log.2",
            "audit-1.log.1",
            "audit-1.log",
        ];
        assert_eq!(stored, order);
    }
}
