//! The program's disk: files that are replaced as a whole, in a folder that one process has locked.
//!
//! After a power cut a file has the old or the new content, never a part: it is written beside, synchronised and renamed,
//! and the folder is synchronised. If any step fails, the previous file can still be read. The steps go through
//! [`FileSystem`], so that a test can make each of them fail or delay it.
//!
//! A full disk has no room for a file beside. It refuses every change but those without which no frame passes on a link
//! (`keeps_its_room`): these are then written over what is there.

use std::fmt;
use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{
    DirBuilderExt, FileExt as _, MetadataExt as _, OpenOptionsExt, PermissionsExt,
};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Weak};
use std::time::Duration;

use mavlink_link::clock::CEILING;
use mavlink_link::encrypted::ENCRYPTED;
use mavlink_link::exchange::PublicKey;
use mavlink_link::store::{
    Changes, Disk, Durability, MAX_RECORD_BYTES, Progress, Record, StoreError,
};
use rustix::fs::{FlockOperation, StatVfs, StatVfsMountFlags};
use rustix::io::Errno;
use rustix::process::geteuid;
use zeroize::Zeroizing;

pub use super::ownership::folder_of;
use super::ownership::{self, OwnershipError};
use crate::key_exchange::{IDENTITY, MAX_IDENTITY_BYTES, parse_identity};

/// The folder of `[store] dir`. Only one process holds it at a time.
#[derive(Debug)]
pub struct FileDisk {
    folder: PathBuf,
    system: Arc<dyn FileSystem>,
    /// Held open for its lock.
    lock: Arc<File>,
}

/// What was added to a log.
#[derive(Debug)]
pub struct Added {
    /// The log, open.
    pub file: File,
    /// Its previous length.
    pub start: u64,
    /// It is a new log, whose name is not durable yet.
    pub new: bool,
}

/// A folder has the name under which a file is written before it gets its place, so that this file can never be replaced.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{path} is a folder, and a file is written under that name before it gets its place: remove the folder", path = path.display())]
pub struct InTheWay {
    /// The folder.
    pub path: PathBuf,
}

/// The store cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// The folder cannot be made, entered or written.
    #[error("[store] dir {folder}: {cause}", folder = folder.display())]
    Folder {
        /// The folder.
        folder: PathBuf,
        /// The system's reason.
        cause: io::Error,
    },
    /// Others may read or write it: its content decides which frames are accepted.
    #[error("[store] dir {folder} is open to others (mode {mode:03o}), expected 0700: chmod 700 it", folder = folder.display())]
    Permissions {
        /// The folder.
        folder: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// It belongs to another user.
    #[error("[store] dir: {0}")]
    Ownership(#[from] OwnershipError),
    /// A record of it can never be replaced.
    #[error("[store] dir: {0}")]
    InTheWay(#[from] InTheWay),
    /// Its content is to be erased, which is not finished: nothing is served from it.
    #[error("[store] dir {folder} is being zeroized: start `vsm run`, `vsm airside` or `vsm zeroize` on it, each of which finishes that first", folder = folder.display())]
    Zeroizing {
        /// The folder.
        folder: PathBuf,
    },
    /// Other computers may have served from a later state of it.
    #[error("[store] dir {folder} belongs to a fleet (it has a file fleet-epoch): only `vsm run` with store.kind = \"etcd\" may use it, since another node may have continued from there. To take it out of the fleet for good, stop the other nodes and remove that file", folder = folder.display())]
    OfFleet {
        /// The folder.
        folder: PathBuf,
    },
    /// Another process has locked it.
    #[error("[store] dir {folder} is in use by another vsm, such as `vsm run`: two must not share one signing clock. Stop that one first (a service: `systemctl stop vsm`), and start it again afterwards", folder = folder.display())]
    Locked {
        /// The folder.
        folder: PathBuf,
    },
}

impl FileDisk {
    /// Opens a folder and locks it for this process; creates it with mode 0700 if it is missing.
    ///
    /// # Errors
    /// It cannot be created or written, it is open to others, or another process has locked it.
    pub fn open(folder: &Path) -> Result<FileDisk, OpenError> {
        let disk = FileDisk::open_on(folder, Box::new(NativeFileSystem))?;
        if disk.has(FLEET_EPOCH) {
            let folder = folder.to_owned();
            return Err(OpenError::OfFleet { folder });
        }
        Ok(disk)
    }

    /// As [`FileDisk::open`], with all writing by `system`.
    ///
    /// # Errors
    /// As [`FileDisk::open`].
    pub fn open_on(folder: &Path, system: Box<dyn FileSystem>) -> Result<FileDisk, OpenError> {
        let disk = FileDisk::open_to_erase(folder, system)?;
        if is_to_be_erased(folder) {
            let folder = folder.to_owned();
            return Err(OpenError::Zeroizing { folder });
        }
        check_names(folder)?;
        Ok(disk)
    }

    /// Whether it contains an order to zeroize.
    #[must_use]
    pub fn is_ordered(&self) -> bool {
        is_to_be_erased(&self.folder)
    }

    /// As [`FileDisk::open_on`], but also opens a store with an order to zeroize.
    pub(super) fn open_to_erase(
        folder: &Path,
        system: Box<dyn FileSystem>,
    ) -> Result<FileDisk, OpenError> {
        let fault = |cause| OpenError::Folder {
            folder: folder.to_owned(),
            cause,
        };
        if folder.is_file() {
            let problem = "it is a file, expected a folder, which is made where it is missing";
            return Err(fault(io::Error::new(io::ErrorKind::NotADirectory, problem)));
        }
        if folder.is_symlink() && !folder.exists() {
            let to = fs::read_link(folder).map_err(fault)?;
            let problem = format!(
                "it is a link to {}, which is not there: make that folder, with mode 0700",
                to.display()
            );
            return Err(fault(io::Error::new(io::ErrorKind::NotFound, problem)));
        }
        DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(folder)
            .map_err(fault)?;
        let mode = fs::metadata(folder).map_err(fault)?.permissions().mode() & 0o777;
        if mode & 0o077 != 0 {
            return Err(OpenError::Permissions {
                folder: folder.to_owned(),
                mode,
            });
        }
        // The lock file itself is never removed: a process that had opened it before would hold a lock on a file without a
        // name.
        ownership::check_folder(folder)?;
        let mut how = OpenOptions::new();
        how.write(true).create(true).truncate(false).mode(0o600);
        let lock = ownership::open_no_link(&mut how, &folder.join("lock"))
            .map_err(|cause| fault(ownership::explain(folder, cause)))?;
        if !self::lock(&lock).map_err(fault)? {
            return Err(OpenError::Locked {
                folder: folder.to_owned(),
            });
        }
        Ok(FileDisk {
            folder: folder.to_owned(),
            system: Arc::from(system),
            lock: Arc::new(lock),
        })
    }

    /// The same store, with all writing by `system`.
    pub(super) fn through(&self, system: Arc<dyn FileSystem>) -> FileDisk {
        FileDisk {
            folder: self.folder.clone(),
            system,
            lock: self.lock.clone(),
        }
    }

    /// Its files.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    pub(super) fn system(&self) -> Arc<dyn FileSystem> {
        self.system.clone()
    }

    /// Its lock, as long as anybody here has it.
    pub(super) fn lock(&self) -> Weak<File> {
        Arc::downgrade(&self.lock)
    }

    /// The names of its files.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub(super) fn names(&self) -> Result<Vec<String>, StoreError> {
        let names = fs::read_dir(&self.folder).and_then(|entries| {
            let each = entries.map(|one| Ok(one?.file_name().to_string_lossy().into_owned()));
            each.collect()
        });
        names.map_err(|cause| StoreError::new(self.folder.display().to_string(), cause))
    }

    /// The same store for another thread, or another user of it in this process.
    #[must_use]
    pub fn shared(&self) -> FileDisk {
        self.through(self.system.clone())
    }

    /// Whether a file is there.
    pub(super) fn has(&self, name: &str) -> bool {
        self.folder.join(name).exists()
    }

    /// The length of a file; 0 where there is none.
    pub(super) fn length(&self, name: &str) -> u64 {
        length(&self.folder.join(name))
    }

    /// Appends to a log without synchronising it, as [`FileSystem::add`].
    pub(super) fn add(&self, name: &str, bytes: &[u8]) -> io::Result<Added> {
        self.system.add(&self.folder.join(name), bytes)
    }

    /// Opens a log that is there, to append to it.
    pub(super) fn open_log(&self, name: &str) -> io::Result<File> {
        ownership::open_no_link(OpenOptions::new().append(true), &self.folder.join(name))
    }

    /// Renames a file over another without synchronising the folder. Returns false if the file does not exist: the rotation
    /// of logs relies on that not being an error.
    pub(super) fn move_file(&self, from: &str, to: &str) -> io::Result<bool> {
        let (from, to) = (self.folder.join(from), self.folder.join(to));
        // Not checked before: between check and rename the file could disappear.
        match self.system.rename(&from, &to) {
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => Ok(false),
            moved => moved.map(|()| true),
        }
    }

    /// Deletes a file without synchronising the folder.
    pub(super) fn delete(&self, name: &str) -> io::Result<()> {
        self.system.remove(&self.folder.join(name))
    }
}

impl Disk for FileDisk {
    fn read(&self, name: &str, max_bytes: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        let read = self.system.read(&self.folder.join(name), max_bytes);
        read.map_err(|cause| StoreError::new(name, cause))
    }

    fn written_within(&self, name: &str) -> Option<Duration> {
        self.system.written_within(&self.folder.join(name))
    }

    fn replace(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        let (path, power) = (self.folder.join(name), durability == Durability::Power);
        let replaced = match replace(&*self.system, &path, bytes, power) {
            Err(cause) if keeps_its_room(name) && is_no_room(&cause) => {
                write_over(&*self.system, &path, bytes, power).map_err(|_| cause)
            }
            replaced => replaced,
        };
        replaced.map_err(|cause| StoreError::new(name, cause))
    }

    fn append(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        let added = self.add(name, bytes).and_then(|added| {
            let Added { file, start, new } = added;
            if durability == Durability::Power
                && let Err(cause) = self.system.sync_open(&file)
            {
                // The append is refused, so it must not stay in the log. The next append synchronises the log itself, since
                // it creates the file.
                let _ = file.set_len(start);
                return Err(cause);
            }
            // A new file's name is part of its folder.
            if new {
                self.system.sync(&self.folder)?;
            }
            Ok(())
        });
        added.map_err(|cause| StoreError::new(name, cause))
    }

    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
        let moved = self.move_file(from, to).and_then(|moved| {
            if moved {
                self.system.sync(&self.folder)?;
            }
            Ok(())
        });
        moved.map_err(|cause| StoreError::new(from, cause))
    }

    fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        self.delete(name)
            .and_then(|()| self.system.sync(&self.folder))
            .map_err(|cause| StoreError::new(name, cause))
    }

    fn queued(&self) -> u64 {
        self.system.queued()
    }

    fn progress(&self, of: Changes) -> Progress {
        self.system.progress(of)
    }
}

/// Reads a record of a store that another process may be using, to show it.
///
/// # Errors
/// It exists but cannot be read.
pub fn peek<R: Record>(folder: &Path, key: &R::Key) -> Result<Option<R>, StoreError> {
    let name = R::name(key);
    let read = NativeFileSystem.read(&folder.join(&name), MAX_RECORD_BYTES);
    let bytes = read.map_err(|cause| StoreError::new(&*name, cause))?;
    bytes
        .map(|bytes| R::decode(&bytes).map_err(|cause| StoreError { name, cause }))
        .transpose()
}

/// The static key of a VSM whose store another process may hold: its public half, to be shown.
#[must_use]
pub fn peek_identity(folder: &Path) -> Option<PublicKey> {
    let path = folder.join(IDENTITY);
    let bytes = NativeFileSystem.read(&path, MAX_IDENTITY_BYTES).ok()??;
    Some(parse_identity(&bytes)?.public())
}

/// The folder of a store that another process may be using, opened for reading.
#[derive(Debug)]
pub struct ReadOnlyDisk {
    folder: PathBuf,
}

impl ReadOnlyDisk {
    /// Opens a folder for reading.
    ///
    /// # Errors
    /// There is none that can be read.
    pub fn open(folder: &Path) -> io::Result<ReadOnlyDisk> {
        fs::read_dir(folder)?;
        Ok(ReadOnlyDisk {
            folder: folder.to_owned(),
        })
    }

    fn refuse(name: &str) -> Result<(), StoreError> {
        Err(StoreError::new(name, "the store is open to be read only"))
    }
}

impl Disk for ReadOnlyDisk {
    fn read(&self, name: &str, max_bytes: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        let read = NativeFileSystem.read(&self.folder.join(name), max_bytes);
        read.map_err(|cause| StoreError::new(name, cause))
    }

    fn replace(&mut self, name: &str, _: &[u8], _: Durability) -> Result<(), StoreError> {
        ReadOnlyDisk::refuse(name)
    }

    fn append(&mut self, name: &str, _: &[u8], _: Durability) -> Result<(), StoreError> {
        ReadOnlyDisk::refuse(name)
    }

    fn rename(&mut self, from: &str, _: &str) -> Result<(), StoreError> {
        ReadOnlyDisk::refuse(from)
    }

    fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        ReadOnlyDisk::refuse(name)
    }
}

/// The steps of writing and reading a file.
pub trait FileSystem: fmt::Debug + Send + Sync {
    /// Writes a new file, mode 0600, replacing any file with its name. Where root writes, the file is handed to whom it belongs
    /// where it will be: see `shell::ownership`.
    ///
    /// # Errors
    /// The system's; part of the bytes may have been written.
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()>;

    /// Appends to a log, which is created if missing, without synchronising it. After a failure nothing has been appended, or,
    /// if that cannot be undone either, a part: the next start finds an incomplete line and closes it.
    ///
    /// # Errors
    /// The system's.
    fn add(&self, path: &Path, bytes: &[u8]) -> io::Result<Added> {
        // To open a file that may have to be made waits for whoever changes names in its folder, and a disk may take long
        // for that.
        let mut how = OpenOptions::new();
        how.append(true).mode(0o600);
        let (mut file, new) = match ownership::open_no_link(&mut how, path) {
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => {
                (ownership::open_no_link(how.create(true), path)?, true)
            }
            opened => (opened?, false),
        };
        let start = append_to(&mut file, bytes)?;
        Ok(Added { file, start, new })
    }

    /// Whether so many bytes more find room in a folder; 0 asks only whether anything can be changed there. A number that the
    /// system has in memory: it waits for no disk, and what is written later may still fail, since others use the room too.
    ///
    /// # Errors
    /// It is full, or read-only.
    fn check_room(&self, folder: &Path, bytes: u64) -> io::Result<()> {
        let _ = (folder, bytes);
        Ok(())
    }

    /// Brings a file, or the names in a folder, to the disk.
    ///
    /// # Errors
    /// The system's.
    fn sync(&self, path: &Path) -> io::Result<()>;

    /// Synchronises what was added to an open file.
    ///
    /// # Errors
    /// The system's.
    fn sync_open(&self, file: &File) -> io::Result<()> {
        file.sync_data()
    }

    /// Renames a file over another.
    ///
    /// # Errors
    /// The system's; nothing has changed then.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// As [`FileSystem::rename`], for a file that this process locks before it gets its new name: at no time could another
    /// process lock the file of that name. Returns the open file, for a caller that must hold it.
    ///
    /// # Errors
    /// The system's; [`io::ErrorKind::WouldBlock`] where another process has locked it.
    fn rename_locked(&self, from: &Path, to: &Path) -> io::Result<Option<File>> {
        let file = ownership::open_no_link(OpenOptions::new().read(true), from)?;
        if !lock(&file)? {
            return Err(io::ErrorKind::WouldBlock.into());
        }
        self.rename(from, to)?;
        Ok(Some(file))
    }

    /// Writes over what a file holds, and leaves line feeds in what that was longer by: needs no room. For files of one
    /// sector, such as the ceiling of a signing clock.
    ///
    /// # Errors
    /// The system's; it is not there, or the content is longer than a sector.
    fn write_over(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let _ = (path, bytes);
        Err(io::ErrorKind::Unsupported.into())
    }

    /// Overwrites a file in place and synchronises it. Links are not followed.
    ///
    /// # Errors
    /// It does not belong to this user or is not a file, or the system's; part of it may have been overwritten.
    fn overwrite(&self, path: &Path) -> io::Result<()> {
        overwrite(path)
    }

    /// Deletes a file; a missing file is no error.
    ///
    /// # Errors
    /// The system's.
    fn remove(&self, path: &Path) -> io::Result<()>;

    /// Whether a change must survive the loss of this computer, and not only the end of the process, because another
    /// computer continues.
    fn is_shared(&self) -> bool {
        false
    }

    /// As [`Disk::written_within`].
    fn written_within(&self, path: &Path) -> Option<Duration> {
        let _ = path;
        None
    }

    /// The number of the last step that was accepted and is done later.
    fn queued(&self) -> u64 {
        0
    }

    /// The progress of these steps.
    fn progress(&self, of: Changes) -> Progress {
        let _ = of;
        Progress::Durable
    }

    /// The first `most` bytes of a file; `None` where there is none.
    ///
    /// # Errors
    /// The system's.
    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>>;
}

/// The file system of this computer.
#[derive(Debug, Clone, Copy, Default)]
pub struct NativeFileSystem;

impl FileSystem for NativeFileSystem {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        // An existing file may have another mode or owner, or be a link.
        self.remove(path)
            .map_err(|cause| match not_a_folder(path) {
                Err(fault) => io::Error::new(cause.kind(), fault),
                Ok(()) => cause,
            })?;
        let mut file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(path)?;
        ownership::keep_owner(&file, &place_of(path))?;
        file.write_all(bytes)
    }

    fn check_room(&self, folder: &Path, bytes: u64) -> io::Result<()> {
        let about = rustix::fs::statvfs(folder)?;
        if about.f_flag.contains(StatVfsMountFlags::RDONLY) {
            return Err(Errno::ROFS.into());
        }
        let needed = bytes.saturating_add(MIN_FREE_BYTES);
        if bytes > 0 && free_bytes(&about).is_some_and(|free| free < needed) {
            return Err(Errno::NOSPC.into());
        }
        Ok(())
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        File::open(path)?.sync_all()
    }

    fn write_over(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let file = ownership::open_no_link(OpenOptions::new().write(true), path)?;
        ownership::check_file(&file, path)?;
        let before = usize::try_from(file.metadata()?.len()).unwrap_or(usize::MAX);
        let length = bytes.len().max(before);
        if length > SECTOR {
            return Err(io::ErrorKind::FileTooLarge.into());
        }
        // In one step: a process that ends in between leaves the old content or the new.
        let mut all = bytes.to_vec();
        all.resize(length, b'\n');
        file.write_all_at(&all, 0)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to).map_err(|cause| match cause.kind() {
            io::ErrorKind::IsADirectory => {
                let problem = format!("{} is a folder, expected a file: remove it", to.display());
                io::Error::new(cause.kind(), problem)
            }
            _ => cause,
        })
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        match fs::remove_file(path) {
            Err(cause) if cause.kind() != io::ErrorKind::NotFound => Err(cause),
            _ => Ok(()),
        }
    }

    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        let file = match ownership::open_no_link(OpenOptions::new().read(true), path) {
            Ok(file) => file,
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(cause) => return Err(ownership::explain(path, cause)),
        };
        ownership::check_file(&file, path)?;
        // Allocated in full: a growing buffer leaves copies of its content behind.
        let size = file.metadata()?.len().min(most);
        let mut bytes = Zeroizing::new(Vec::with_capacity(usize::try_from(size).unwrap_or(0) + 1));
        file.take(most).read_to_end(&mut bytes)?;
        Ok(Some(bytes))
    }
}

/// Replaces the file at `path`. With `power` the new content survives a power cut once this returns.
///
/// # Errors
/// The first step that fails. The old file is still there, or, where only the folder's names could not
/// be synchronised, the new one.
pub fn replace(system: &dyn FileSystem, path: &Path, bytes: &[u8], power: bool) -> io::Result<()> {
    let beside = &beside(path);
    let written = system
        .write(beside, bytes)
        // Before the rename: otherwise a power cut could leave the new name on an empty file.
        .and_then(|()| if power { system.sync(beside) } else { Ok(()) })
        .and_then(|()| system.rename(beside, path));
    if written.is_err() {
        // It may contain part of a key. On a failing disk the deletion may fail too.
        let _ = system.remove(beside);
        return written;
    }
    // The rename is an entry of the folder, which is on the disk only once the folder is synchronised.
    if power {
        system.sync(folder_of(path))?;
    }
    Ok(())
}

/// Whether no frame passes on a link while this record cannot be written: the ceiling of a signing clock, and the epoch of an
/// encrypted link. A full disk would end the link within seconds, and with it the heartbeats that keep PX4 from its failsafe.
///
/// Such a record is a line of a few digits, which line feeds may follow. A disk writes a sector whole or not at all, so that
/// writing over it leaves the old line or the new one, after a power cut too.
pub(super) fn keeps_its_room(name: &str) -> bool {
    [CEILING, ENCRYPTED]
        .iter()
        .any(|prefix| name.starts_with(prefix))
}

/// Whether a disk, or the quota of a user on it, has no room left.
pub(super) fn is_no_room(cause: &io::Error) -> bool {
    matches!(
        cause.kind(),
        io::ErrorKind::StorageFull | io::ErrorKind::QuotaExceeded
    )
}

/// Writes a record over what is there. With `power` the new content survives a power cut once this returns.
///
/// # Errors
/// The first step that fails; a file system that writes everything elsewhere (btrfs, ZFS) may need room for this too.
pub(super) fn write_over(
    system: &dyn FileSystem,
    path: &Path,
    bytes: &[u8],
    power: bool,
) -> io::Result<()> {
    system.write_over(path, bytes)?;
    if power { system.sync(path) } else { Ok(()) }
}

/// Creates a file that does not exist yet. When this returns it is durable, and whenever it exists it is complete.
///
/// # Errors
/// It exists, or a step fails; where only the folder's names could not be synchronised it is there.
pub fn create(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let beside = &beside(path);
    let system = NativeFileSystem;
    // A hard link, not a rename: a rename would replace an existing file.
    let made = system
        .write(beside, bytes)
        .and_then(|()| system.sync(beside))
        .and_then(|()| fs::hard_link(beside, path));
    let removed = system.remove(beside);
    made.and(removed)
        .and_then(|()| system.sync(folder_of(path)))
}

/// Whether every record of a store can be replaced: no folder has the name of one that is being written.
///
/// # Errors
/// A folder has.
pub fn check_names(store: &Path) -> Result<(), InTheWay> {
    // That the store cannot be read has an error of its own.
    let entries = fs::read_dir(store).into_iter().flatten().flatten();
    for entry in entries {
        if is_being_written(&entry.file_name().to_string_lossy()) {
            not_a_folder(&entry.path())?;
        }
    }
    Ok(())
}

/// The same of one file.
///
/// # Errors
/// As [`check_names`].
pub(super) fn check_name(path: &Path) -> Result<(), InTheWay> {
    not_a_folder(&beside(path))
}

fn not_a_folder(path: &Path) -> Result<(), InTheWay> {
    match fs::symlink_metadata(path) {
        Ok(about) if about.is_dir() => Err(InTheWay {
            path: path.to_owned(),
        }),
        _ => Ok(()),
    }
}

/// Whether files can be written in a folder, or in what there is of the folders above it: one is, and is removed again.
///
/// # Errors
/// They cannot.
pub(super) fn probe(folder: &Path) -> io::Result<()> {
    let folder = std::path::absolute(folder)?;
    let there = folder.ancestors().find(|one| one.exists());
    let there = there.unwrap_or(Path::new("/"));
    let path = there.join(format!(".vsm-{}", std::process::id()));
    let system = NativeFileSystem;
    let written = system
        .write(&path, &[0; PROBE_BYTES])
        .and_then(|()| system.sync(&path));
    let removed = system.remove(&path);
    written.and(removed)
}

/// How many bytes are free on the disk of a store's folder, where it has no room left, and the system says so.
pub(super) fn is_full(folder: &Path) -> Option<u64> {
    let about = rustix::fs::statvfs(folder).ok()?;
    free_bytes(&about).filter(|free| *free < MIN_FREE_BYTES)
}

/// How many bytes are free for this user; `None` where the file system counts none.
fn free_bytes(about: &StatVfs) -> Option<u64> {
    // What a file system keeps for root is there for root.
    let free = match geteuid().is_root() {
        true => about.f_bfree,
        false => about.f_bavail,
    };
    (about.f_blocks > 0).then(|| free.saturating_mul(about.f_frsize))
}

/// The length of a file; 0 where there is none.
pub(super) fn length(path: &Path) -> u64 {
    fs::metadata(path).map_or(0, |about| about.len())
}

/// Appends to an open log, and returns its previous length. After a failure nothing has been appended, if that can be undone.
///
/// # Errors
/// The system's.
pub(super) fn append_to(file: &mut File, bytes: &[u8]) -> io::Result<u64> {
    let start = file.metadata()?.len();
    if let Err(cause) = file.write_all(bytes) {
        // Otherwise the next line would follow a part of this one.
        let _ = file.set_len(start);
        return Err(cause);
    }
    Ok(start)
}

/// Whether a store contains an order to zeroize. An unreadable one counts too: such a store must not be served.
pub(super) fn is_to_be_erased(store: &Path) -> bool {
    // `exists()` follows links, and takes an error for "no".
    let found = fs::symlink_metadata(store.join(ERASE_ORDER));
    !matches!(found, Err(cause) if cause.kind() == io::ErrorKind::NotFound)
}

/// As [`FileSystem::overwrite`], with zeros. On a medium that writes in place, the old content is gone.
fn overwrite(path: &Path) -> io::Result<()> {
    let open = || ownership::open_no_link(OpenOptions::new().write(true), path);
    let mut file = match open() {
        // The owner may have made it read-only.
        Err(cause) if cause.kind() == io::ErrorKind::PermissionDenied => {
            let changed = fs::set_permissions(path, fs::Permissions::from_mode(0o600));
            changed.map_err(|cause| ownership::explain(path, cause))?;
            // Again without following links: the file could have been replaced since.
            open()?
        }
        opened => opened?,
    };
    ownership::check_file(&file, path)?;
    let about = file.metadata()?;
    // Somebody else may have made one of these names, to have root erase the file under the other one.
    if geteuid().is_root() && about.nlink() > 1 {
        let problem = format!(
            "it is not erased: it has {} names (hard links), and root erases only what has one: remove the others first",
            about.nlink()
        );
        return Err(io::Error::new(io::ErrorKind::PermissionDenied, problem));
    }
    let mut left = about.len();
    let zeros = [0; 4_096];
    while left > 0 {
        let now = zeros.len().min(usize::try_from(left).unwrap_or(usize::MAX));
        file.write_all(zeros.get(..now).unwrap_or_default())?;
        left -= now as u64;
    }
    file.sync_all()
}

/// The order to erase what belongs to a store, in its folder: nothing is served from a store that has one.
pub(super) const ERASE_ORDER: &str = "zeroize.order";

/// The mark of a store that a fleet shares: the epoch in which this folder was last served, and etcd's revision at that
/// time.
pub(super) const FLEET_EPOCH: &str = "fleet-epoch";

/// What a disk writes whole or not at all, at least.
const SECTOR: usize = 512;
/// More than the largest record that a start writes.
const PROBE_BYTES: usize = 16_384;
/// Room for a few records.
const MIN_FREE_BYTES: u64 = 65_536;

/// `uav1.key` while it is being written: `uav1.key.new`. An interrupted write may have left it.
pub(super) fn beside(path: &Path) -> PathBuf {
    let mut beside = path.as_os_str().to_owned();
    beside.push(NEW);
    PathBuf::from(beside)
}

/// At the end of the name of every file that is being written; `queued_disk` adds a number.
const NEW: &str = ".new";

/// Whether a name is of a file that is being written.
pub(super) fn is_being_written(name: &str) -> bool {
    name.ends_with(NEW) || is_numbered(name)
}

/// Whether a name is of a file that `queued_disk` is writing: `plan-1.json.new-7`. Not one that a person has made, such as
/// `notes.new-year.txt`.
pub(super) fn is_numbered(name: &str) -> bool {
    let number = name.rsplit_once(NEW);
    let number = number.and_then(|(_, end)| end.strip_prefix('-'));
    number
        .is_some_and(|number| !number.is_empty() && number.bytes().all(|one| one.is_ascii_digit()))
}

/// Where a file is put once it is written: `uav1.key` for `uav1.key.new`.
fn place_of(written: &Path) -> PathBuf {
    match written.extension() {
        Some(last) if last == "new" => written.with_extension(""),
        _ => written.to_owned(),
    }
}

/// Locks a file for this process, until it is closed. False where another process has it.
///
/// # Errors
/// The system's.
pub fn lock(file: &File) -> io::Result<bool> {
    match rustix::fs::flock(file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Ok(true),
        Err(Errno::WOULDBLOCK) => Ok(false),
        Err(cause) => Err(cause.into()),
    }
}

#[cfg(test)]
mod tests;
