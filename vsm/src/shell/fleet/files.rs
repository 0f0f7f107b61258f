//! A store's folder of which each change is in etcd before it counts as durable.

use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::os::fd::AsRawFd as _;
use std::os::unix::ffi::OsStringExt as _;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use mavlink_link::clock::CEILING;
use sha2::{Digest as _, Sha256};
use zeroize::Zeroizing;

use super::remote::{Head, Last, Remote};
use crate::shell::disk::{ERASE_ORDER, FLEET_EPOCH, FileSystem, NativeFileSystem};

/// The file system of a node that owns its VSM.
///
/// The folder stays as it would be without etcd. What makes a change durable (the synchronisation of a log, or of the folder
/// after a rename or a deletion) stores it in etcd, too, and fails where that does. A node that ends in between has a folder that is
/// ahead of etcd by what nobody was promised; the next owner, which may be this node, continues from what etcd has.
#[derive(Debug)]
pub(super) struct SharedFiles {
    folder: PathBuf,
    /// The same without links and relative parts, as the system names open files.
    real: PathBuf,
    remote: Arc<Remote>,
    /// The ceilings of clocks, and everything else: a link must not wait for a plan that somebody stores.
    lanes: [Lane; 2],
}

#[derive(Debug, Default)]
struct Lane {
    /// Files that were written, renamed or deleted since they were stored. The last to be locked of the two.
    changed: Mutex<BTreeSet<String>>,
    /// What etcd has. Locked as long as that is changed: who finds nothing changed under this lock knows that all is stored.
    stored: Mutex<StoredLane>,
}

#[derive(Debug, Default)]
struct StoredLane {
    files: BTreeMap<String, Stored>,
    last: Last,
}

#[derive(Debug, Clone, Copy, Default)]
struct Stored {
    /// That of the last request with an answer.
    head: Head,
    /// Of its content where it was stored whole: a start writes files again that have not changed.
    digest: Option<[u8; 32]>,
}

thread_local! {
    /// The lanes in which this thread has changed a file since it synchronised the folder: its concern alone. A thread that has changed
    /// none synchronises what others have.
    static TOUCHED: Cell<[bool; 2]> = const { Cell::new([false; 2]) };
    /// This thread has written an order to erase, which must not wait for etcd.
    static ORDERED: Cell<bool> = const { Cell::new(false) };
}

impl StoredLane {
    /// A request about this file goes out: until there is an answer, what etcd has of it is not known.
    fn doubt(&mut self, name: &str) {
        self.files.entry(name.to_owned()).or_default().digest = None;
    }
}

impl SharedFiles {
    /// Of a folder that holds what etcd has.
    pub(super) fn new(
        folder: &Path,
        remote: Arc<Remote>,
        heads: BTreeMap<String, Head>,
    ) -> io::Result<SharedFiles> {
        let lanes: [Lane; 2] = Default::default();
        for (name, head) in heads {
            let digest = fs::read(folder.join(&name))
                .ok()
                .map(|bytes| digest(&bytes));
            let mut stored = locked(&lanes[lane_of(&name)].stored);
            stored.files.insert(name, Stored { head, digest });
        }
        Ok(SharedFiles {
            folder: folder.to_owned(),
            real: fs::canonicalize(folder)?,
            remote,
            lanes,
        })
    }

    /// The name of a file that is in etcd, too.
    fn name_of(&self, path: &Path) -> Option<String> {
        let name = path.strip_prefix(&self.folder).ok()?.to_str()?;
        is_stored(name).then(|| name.to_owned())
    }

    fn note(&self, path: &Path) {
        self.note_all(&[path]);
    }

    /// Notes what one step has changed, at once: nobody sees a part of it. Both names of a file that is put aside are of one lane.
    fn note_all(&self, paths: &[&Path]) {
        if paths.contains(&&*self.folder.join(ERASE_ORDER)) {
            ORDERED.set(true);
        }
        let names: Vec<String> = paths.iter().filter_map(|path| self.name_of(path)).collect();
        let Some(lane) = names.first().map(|name| lane_of(name)) else {
            return;
        };
        debug_assert!(names.iter().all(|name| lane_of(name) == lane), "{names:?}");
        let mut touched = TOUCHED.get();
        touched[lane] = true;
        TOUCHED.set(touched);
        locked(&self.lanes[lane].changed).extend(names);
    }

    /// Stores what has changed in the lanes of this thread, or in all where it has changed nothing itself.
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
        // Before it looks what has changed: another thread may be storing just that, and fail.
        let mut stored = locked(stored);
        let mut left = std::mem::take(&mut *locked(changed));
        let mut done = Ok(());
        // A log that is put aside has its new name in etcd before the old one goes, and the oldest first; a record is there before the
        // lines that it takes the place of are not. A change that comes meanwhile is one of the next time.
        let is_there = |name: &String| self.folder.join(name).exists();
        let (puts, removals): (Vec<String>, Vec<String>) = left.iter().cloned().partition(is_there);
        for name in puts.into_iter().rev().chain(removals) {
            done = self.store_file(lane, &name, &mut stored);
            if done.is_err() {
                break;
            }
            left.remove(&name);
        }
        locked(changed).append(&mut left);
        done
    }

    /// Stores a file as it is by now.
    fn store_file(&self, lane: usize, name: &str, stored: &mut StoredLane) -> io::Result<()> {
        let before = stored.files.get(name).copied();
        let bytes = NativeFileSystem.read(&self.folder.join(name), u64::MAX)?;
        let Some(bytes) = bytes else {
            if before.is_some() {
                stored.doubt(name);
                self.remote.remove((lane, &mut stored.last), name)?;
                stored.files.remove(name);
            }
            return Ok(());
        };
        let digest = Some(digest(&bytes));
        if before.is_some_and(|it| it.digest == digest && it.head.length == bytes.len() as u64) {
            return Ok(());
        }
        stored.doubt(name);
        let head = self
            .remote
            .replace((lane, &mut stored.last), name, &bytes)?;
        stored
            .files
            .insert(name.to_owned(), Stored { head, digest });
        Ok(())
    }

    /// Stores what a log has grown by.
    fn store_end(&self, name: &str, file: &File) -> io::Result<()> {
        let lane = lane_of(name);
        let Lane { changed, stored } = &self.lanes[lane];
        let mut stored = locked(stored);
        let length = file.metadata()?.len();
        let known = stored.files.get(name).copied();
        // Renamed, deleted or replaced meanwhile: what lies under its name is another file than etcd has, and is stored with
        // the others that changed, in their order.
        if locked(changed).contains(name) || known.is_none_or(|it| it.head.length > length) {
            locked(changed).insert(name.to_owned());
            drop(stored);
            return self.store_lane(lane);
        }
        let Some(known) = known else { return Ok(()) };
        stored.doubt(name);
        // This file, whatever bears its name by now.
        let path = format!("/proc/self/fd/{}", file.as_raw_fd());
        let read = |from| {
            let mut file = File::open(&path)?;
            file.seek(SeekFrom::Start(from))?;
            let mut bytes = Zeroizing::new(Vec::new());
            file.take(length - from).read_to_end(&mut bytes)?;
            Ok(bytes)
        };
        let grown = (known.head, length);
        match self
            .remote
            .append((lane, &mut stored.last), name, grown, read)
        {
            Ok(head) => {
                let now = Stored { head, digest: None };
                stored.files.insert(name.to_owned(), now);
                Ok(())
            }
            Err(cause) => {
                // Part of it may be there: next time it is stored whole.
                locked(changed).insert(name.to_owned());
                Err(cause)
            }
        }
    }

    /// Stores the folder as the first owner has it.
    pub(super) fn store_all(&self, names: &[String]) -> io::Result<()> {
        {
            let mut stored = locked(&self.lanes[1].stored);
            self.remote.remove_all(1, &mut stored.last)?;
        }
        for name in names.iter().filter(|name| is_stored(name)) {
            self.note(&self.folder.join(name));
        }
        self.store()?;
        let mut stored = locked(&self.lanes[1].stored);
        self.remote.complete(1, &mut stored.last)
    }
}

impl FileSystem for SharedFiles {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        NativeFileSystem.write(path, bytes)?;
        self.note(path);
        Ok(())
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        NativeFileSystem.sync(path)?;
        if path == self.folder && !ORDERED.take() {
            self.store()?;
        }
        Ok(())
    }

    fn sync_open(&self, file: &File) -> io::Result<()> {
        file.sync_data()?;
        // It may have been put aside under another name since it was opened: the system knows which.
        let path = rustix::fs::readlink(format!("/proc/self/fd/{}", file.as_raw_fd()), Vec::new())?;
        let path = PathBuf::from(OsString::from_vec(path.into_bytes()));
        let name = path.strip_prefix(&self.real).ok().and_then(Path::to_str);
        match name.map(|name| (name, name.strip_suffix(DELETED))) {
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
}

/// Whether a file of the folder belongs into etcd: not a lock, a socket, this node's own mark, nor what is still being written.
pub(super) fn is_stored(name: &str) -> bool {
    let of_this_node = ["lock", FLEET_EPOCH, ERASE_ORDER, "zeroized"].contains(&name)
        // The keys of guards that are paired here are written by who pairs, not through this.
        || (name.starts_with("guard-") && name.contains(".key"))
        || [".sock", ".lock"].iter().any(|end| name.ends_with(end));
    !of_this_node && !name.contains(".new") && !name.contains('/')
}

fn lane_of(name: &str) -> usize {
    usize::from(!name.starts_with(CEILING))
}

fn digest(bytes: &[u8]) -> [u8; 32] {
    Sha256::digest(bytes).into()
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

const LANES: usize = 2;
/// The suffix that the system adds to the name of a deleted open file.
const DELETED: &str = " (deleted)";
