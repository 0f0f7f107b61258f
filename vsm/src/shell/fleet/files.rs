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
use mavlink_link::store::Durability;
use sha2::{Digest as _, Sha256};
use zeroize::Zeroizing;

use super::remote::{Head, Remote};
use crate::shell::disk::{FileSystem, NativeFileSystem};

/// The file system of a node that owns its VSM.
///
/// The folder stays as it would be without etcd. What makes a change durable (the synchronisation of a log, or of the folder
/// after a rename or a deletion) stores it in etcd, too, and fails where that does. A node that ends in between has a folder that is
/// ahead of etcd by what nobody was promised; the next owner, which may be this node, continues from what etcd has.
#[derive(Debug)]
pub(super) struct SharedFiles {
    folder: PathBuf,
    remote: Arc<Remote>,
    /// The ceilings of clocks, and everything else: a link must not wait for a plan that somebody stores.
    lanes: [Lane; 2],
}

#[derive(Debug, Default)]
struct Lane {
    /// Files that were renamed or deleted since they were stored. The last to be locked of the two.
    changed: Mutex<BTreeSet<String>>,
    /// What etcd has. Locked as long as it is changed.
    stored: Mutex<BTreeMap<String, Stored>>,
}

#[derive(Debug, Clone, Copy)]
struct Stored {
    head: Head,
    /// Of its content where it was stored whole: a start writes files again that have not changed.
    digest: Option<[u8; 32]>,
}

thread_local! {
    /// The lanes in which this thread has changed a file since it synchronised the folder. Only those are its concern.
    static TOUCHED: Cell<[bool; 2]> = const { Cell::new([false; 2]) };
}

impl SharedFiles {
    /// Of a folder that holds what etcd has.
    pub(super) fn new(
        folder: &Path,
        remote: Arc<Remote>,
        heads: BTreeMap<String, Head>,
    ) -> SharedFiles {
        let lanes: [Lane; 2] = Default::default();
        for (name, head) in heads {
            let digest = fs::read(folder.join(&name))
                .ok()
                .map(|bytes| digest(&bytes));
            locked(&lanes[lane_of(&name)].stored).insert(name, Stored { head, digest });
        }
        SharedFiles {
            folder: folder.to_owned(),
            remote,
            lanes,
        }
    }

    /// The name of a file that is in etcd, too.
    fn name_of(&self, path: &Path) -> Option<String> {
        let name = path.strip_prefix(&self.folder).ok()?.to_str()?;
        is_stored(name).then(|| name.to_owned())
    }

    fn note(&self, path: &Path) {
        if let Some(name) = self.name_of(path) {
            let lane = lane_of(&name);
            let mut touched = TOUCHED.get();
            touched[lane] = true;
            TOUCHED.set(touched);
            locked(&self.lanes[lane].changed).insert(name);
        }
    }

    /// Stores what has changed in the lanes of this thread, or in all where it has changed nothing itself.
    fn store(&self) -> io::Result<()> {
        let touched = TOUCHED.get();
        let none = touched == [false; 2];
        for (lane, _) in self
            .lanes
            .iter()
            .zip(touched)
            .filter(|(_, mine)| *mine || none)
        {
            self.store_lane(lane)?;
        }
        TOUCHED.set([false; 2]);
        Ok(())
    }

    fn store_lane(&self, lane: &Lane) -> io::Result<()> {
        if locked(&lane.changed).is_empty() {
            return Ok(());
        }
        let mut stored = locked(&lane.stored);
        loop {
            let Some(name) = locked(&lane.changed).pop_first() else {
                return Ok(());
            };
            if let Err(cause) = self.store_file(&name, &mut stored) {
                locked(&lane.changed).insert(name);
                return Err(cause);
            }
        }
    }

    /// Stores a file as it is by now.
    fn store_file(&self, name: &str, stored: &mut BTreeMap<String, Stored>) -> io::Result<()> {
        let before = stored.get(name).copied();
        let bytes = NativeFileSystem.read(&self.folder.join(name), u64::MAX)?;
        let Some(bytes) = bytes else {
            if let Some(before) = before {
                self.remote.remove(name, before.head)?;
                stored.remove(name);
            }
            return Ok(());
        };
        let digest = Some(digest(&bytes));
        if before.is_some_and(|it| it.digest == digest && it.head.length == bytes.len() as u64) {
            return Ok(());
        }
        let head = self
            .remote
            .replace(name, before.map(|it| it.head), &bytes)?;
        stored.insert(name.to_owned(), Stored { head, digest });
        Ok(())
    }

    /// Stores what a log has grown by.
    fn store_end(&self, name: &str, file: &File) -> io::Result<()> {
        let lane = &self.lanes[lane_of(name)];
        let mut stored = locked(&lane.stored);
        let length = file.metadata()?.len();
        let known = stored.get(name).copied();
        // Renamed, deleted or written anew meanwhile: what lies under its name is another file than etcd has.
        let anew = locked(&lane.changed).remove(name);
        let Some(known) = known.filter(|known| !anew && known.head.length <= length) else {
            let done = self.store_file(name, &mut stored);
            if done.is_err() {
                locked(&lane.changed).insert(name.to_owned());
            }
            return done;
        };
        let path = self.folder.join(name);
        let read = |from| {
            let mut file = File::open(&path)?;
            file.seek(SeekFrom::Start(from))?;
            let mut bytes = Zeroizing::new(Vec::new());
            file.take(length - from).read_to_end(&mut bytes)?;
            Ok(bytes)
        };
        match self.remote.append(name, known.head, length, read) {
            Ok(head) => {
                let now = Stored { head, digest: None };
                stored.insert(name.to_owned(), now);
                Ok(())
            }
            Err(cause) => {
                // Part of it may be there: next time it is stored whole.
                locked(&lane.changed).insert(name.to_owned());
                Err(cause)
            }
        }
    }

    /// Stores the folder as the first owner has it.
    pub(super) fn store_all(&self, names: &[String]) -> io::Result<()> {
        for name in names.iter().filter(|name| is_stored(name)) {
            self.note(&self.folder.join(name));
        }
        self.store()?;
        self.remote.complete()
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
        if path == self.folder {
            self.store()?;
        }
        Ok(())
    }

    fn sync_open(&self, file: &File) -> io::Result<()> {
        file.sync_data()?;
        // It may have been put aside under another name since it was opened: the system knows which.
        let path = rustix::fs::readlink(format!("/proc/self/fd/{}", file.as_raw_fd()), Vec::new())?;
        let path = PathBuf::from(OsString::from_vec(path.into_bytes()));
        match self.name_of(&path) {
            Some(name) => self.store_end(&name, file),
            None => Ok(()),
        }
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        NativeFileSystem.rename(from, to)?;
        self.note(from);
        self.note(to);
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

    /// What need survive the end of the process only has to survive that of the computer here: another continues.
    fn durability(&self, _: Durability) -> Durability {
        Durability::Power
    }
}

/// Whether a file of the folder belongs into etcd: not a lock, a socket, this node's own mark, nor what is still being written.
pub(super) fn is_stored(name: &str) -> bool {
    let own = ["lock", EPOCH].contains(&name) || name.ends_with(".sock") || name.ends_with(".lock");
    !own && !name.contains(".new") && !name.contains('/')
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

/// Which epoch the folder was served in last.
pub(super) const EPOCH: &str = "fleet-epoch";
