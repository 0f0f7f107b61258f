//! The keys of one vehicle: the current one, the next one during a rotation, and the previous one.
//!
//! `uav1.key` is the current key, `uav1.key.next` one that the vehicle may have been sent, and `uav1.key.previous` the one
//! before. `uav1.key.revoked` names a key that is deleted as soon as it is no longer current, whichever process finds that
//! out. A process locks `uav1.key.lock` and the key file itself while it uses them. So no two processes sign with one key
//! and one stream, by whatever names they know it: a symbolic link is followed first, and a hard link is the same file. A
//! copy is not noticed here. Every change is durable when it returns, and a change that fails leaves a usable key file.
//!
//! A key in none of these files is dead, and its signing clock is deleted: before each change `uav1.key.dead` names the
//! keys that it may end, and [`KeyStore::bury`] deletes the clocks of the dead ones, now or after a restart.

use std::cell::RefCell;
use std::fs::{self, File, OpenOptions};
use std::io;
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use mavlink_link::clock::Ceiling;
use mavlink_link::signing::{KeyId, SigningKey};
use mavlink_link::store::{Disk, Record as _, StoreError};
use rustix::io::Errno;
use zeroize::Zeroizing;

use super::disk::{self, FileSystem, InTheWay, NativeFileSystem};
use super::key_file::{self, KeyFileError};
use super::ownership;
use crate::config::open_at_once;
use crate::key_exchange::Keyring;

/// The key files of one vehicle, locked for this process.
#[derive(Debug)]
pub struct KeyStore {
    path: PathBuf,
    system: Box<dyn FileSystem>,
    /// Held open for its lock.
    _lock: Option<File>,
    /// The key file, held open for its lock; each change replaces it.
    key_lock: RefCell<Option<File>>,
}

/// The keys cannot be used or changed.
#[derive(Debug, thiserror::Error)]
pub enum KeyStoreError {
    /// A key file that is there cannot be used.
    #[error(transparent)]
    File(#[from] KeyFileError),
    /// Another process uses the key.
    #[error("the key {path} is in use by another vsm, such as `vsm run`: two must not sign with one key. Stop that one first (a service: `systemctl stop vsm`), and start it again afterwards", path = path.display())]
    Locked {
        /// The key file.
        path: PathBuf,
    },
    /// A change could not be made durable.
    #[error("key file {path}: {cause}; the keys stay as they were", path = path.display())]
    Change {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: io::Error,
    },
    /// A key that the vehicle may have accepted is still stored as the next one.
    #[error("{path} holds a key that the vehicle may have: it must not be replaced before that is known", path = path.display())]
    Unfinished {
        /// The file of the next key.
        path: PathBuf,
    },
}

impl KeyStore {
    /// Opens and locks the keys whose current one is at `path`, which need not exist yet.
    ///
    /// # Errors
    /// The folder cannot be written, or another process has the lock.
    pub fn open(path: &Path) -> Result<KeyStore, KeyStoreError> {
        KeyStore::open_on(path, Box::new(NativeFileSystem))
    }

    /// As [`KeyStore::open`], with all reading and writing of keys by `system`.
    ///
    /// # Errors
    /// As [`KeyStore::open`].
    pub fn open_on(path: &Path, system: Box<dyn FileSystem>) -> Result<KeyStore, KeyStoreError> {
        let change = |cause| KeyStoreError::Change {
            path: path.to_owned(),
            cause,
        };
        let locked = |file: File| match disk::lock(&file) {
            Ok(true) => Ok(file),
            Ok(false) => Err(KeyStoreError::Locked {
                path: path.to_owned(),
            }),
            Err(cause) => Err(change(cause)),
        };
        let real = trusted_path(path)?;
        let mut how = OpenOptions::new();
        how.write(true).create(true).truncate(false).mode(0o600);
        let beside = ownership::open_no_link(&mut how, &with(&real, "lock"));
        // Two locks. The key file's own is found through any hard link to it; the one beside covers a missing key file.
        let key = match open_at_once(&real) {
            Ok(file) => {
                ownership::check_file(&file, &real).map_err(KeyFileError::from)?;
                Some(locked(file)?)
            }
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => None,
            Err(cause) => return Err(change(ownership::explain(&real, cause))),
        };
        let beside = match beside {
            Ok(file) => Some(locked(file)?),
            // A planted link would hold the lock of another file.
            Err(cause) if cause.raw_os_error() == Some(Errno::LOOP.raw_os_error()) => {
                return Err(change(cause));
            }
            // In a folder that cannot be written nothing is ever replaced, so the key file's own lock is enough.
            Err(_) if key.is_some() => None,
            Err(cause) => return Err(change(cause)),
        };
        let keys = KeyStore {
            path: real,
            system,
            _lock: beside,
            key_lock: RefCell::new(key),
        };
        keys.finish_revocation()?;
        Ok(keys)
    }

    /// The keys at `path` for a look at them: nothing is locked, made or changed.
    ///
    /// # Errors
    /// The folder is not there, or must not be trusted.
    pub(super) fn look(path: &Path) -> Result<KeyStore, KeyStoreError> {
        let real = trusted_path(path).map_err(|fault| match fault {
            KeyStoreError::Change { path, cause } if cause.kind() == io::ErrorKind::NotFound => {
                KeyFileError::Absent { path }.into()
            }
            other => other,
        })?;
        Ok(KeyStore {
            path: real,
            system: Box::new(NativeFileSystem),
            _lock: None,
            key_lock: RefCell::new(None),
        })
    }

    /// From here on `system` does all reading and writing of keys.
    pub fn write_through(&mut self, system: Box<dyn FileSystem>) {
        self.system = system;
    }

    /// The current key; `None` if there is none yet.
    ///
    /// # Errors
    /// It is there and cannot be used.
    pub fn current(&self) -> Result<Option<SigningKey>, KeyStoreError> {
        self.load(&self.path)
    }

    /// The key that the vehicle may have been sent.
    ///
    /// # Errors
    /// It is there and cannot be used.
    pub fn next(&self) -> Result<Option<SigningKey>, KeyStoreError> {
        self.load(&with(&self.path, "next"))
    }

    /// The key before the current one.
    ///
    /// # Errors
    /// It is there and cannot be used.
    pub fn previous(&self) -> Result<Option<SigningKey>, KeyStoreError> {
        self.load(&with(&self.path, "previous"))
    }

    /// The names of the keys that are, or may be, in use.
    ///
    /// # Errors
    /// One is there and cannot be used.
    pub fn ids(&self) -> Result<Vec<KeyId>, KeyStoreError> {
        let keys = [self.current()?, self.next()?];
        Ok(keys.iter().flatten().map(SigningKey::id).collect())
    }

    /// The same keys for reading in another thread: only the holder of the store changes them.
    #[must_use]
    pub(super) fn view(&self, system: Box<dyn FileSystem>) -> KeyStore {
        KeyStore {
            path: self.path.clone(),
            system,
            _lock: None,
            key_lock: RefCell::new(None),
        }
    }

    /// All files of these keys, whether they exist or not.
    pub(super) fn files(&self) -> Vec<PathBuf> {
        files_of(&self.path)
    }

    /// Deletes the signing clocks of keys that are no longer in any of the files: otherwise every change of a key would
    /// leave a file behind forever. Call it after each change, and at the start.
    ///
    /// # Errors
    /// A clock could not be deleted, or a key file not be read: done at the next call.
    pub fn bury(&self, disk: &mut dyn Disk) -> Result<(), StoreError> {
        let path = with(&self.path, "dead");
        let read = self.system.read(&path, MAX_NAMED);
        let Some(named) = read.map_err(|cause| StoreError::new("dead", cause))? else {
            return Ok(());
        };
        let held = self.held().map_err(fault)?;
        for name in String::from_utf8_lossy(&named).lines() {
            if let Some(id) = KeyId::parse(name)
                && !held.contains(&id)
            {
                disk.remove(&Ceiling::name(&id))?;
            }
        }
        // Deleted last: after a power cut in between the next start looks again. On a disk that queues, the clocks'
        // deletions may become durable later; a file that stays behind is harmless.
        self.delete(&path).map_err(fault)
    }

    /// The names of all keys in the files.
    fn held(&self) -> Result<Vec<KeyId>, KeyStoreError> {
        let keys = [self.current()?, self.next()?, self.previous()?];
        Ok(keys.iter().flatten().map(SigningKey::id).collect())
    }

    /// Names the keys that the next change may end.
    fn mark(&self) {
        let path = with(&self.path, "dead");
        let before = self.system.read(&path, MAX_NAMED).ok().flatten();
        let mut names = before
            .map(|named| String::from_utf8_lossy(&named).into_owned())
            .unwrap_or_default();
        let Ok(held) = self.held() else { return };
        for id in held {
            let name = id.to_string();
            if !names.lines().any(|known| known == name) {
                names += &name;
                names.push('\n');
            }
        }
        // On a full disk the key is changed or deleted all the same; only the clock's file stays behind.
        let _ = disk::replace(&*self.system, &path, names.as_bytes(), true);
    }

    /// Marks the current key for deletion as soon as the vehicle has another one, in place of keeping it as the previous
    /// one. The mark survives restarts, until the deletion or until the vehicle is known to keep the key.
    ///
    /// # Errors
    /// It could not be made durable.
    pub fn revoke_current(&self) -> Result<(), KeyStoreError> {
        let Some(current) = self.current()? else {
            return Ok(());
        };
        let path = with(&self.path, "revoked");
        let text = format!("{}\n", current.id());
        disk::replace(&*self.system, &path, text.as_bytes(), true)
            .map_err(|cause| KeyStoreError::Change { path, cause })
    }

    /// Whether [`KeyStore::revoke_current`] has marked this key.
    fn is_revoked(&self, key: &SigningKey) -> Result<bool, KeyStoreError> {
        let named = self.revoked()?;
        Ok(named.is_some_and(|name| name == key.id().to_string()))
    }

    fn revoked(&self) -> Result<Option<String>, KeyStoreError> {
        let path = with(&self.path, "revoked");
        let read = self.system.read(&path, key_file::MAX_BYTES);
        let bytes = read.map_err(|cause| KeyFileError::Io { path, cause })?;
        Ok(bytes.map(|bytes| String::from_utf8_lossy(&bytes).trim().to_owned()))
    }

    /// Deletes a revoked key that is no longer current.
    fn finish_revocation(&self) -> Result<(), KeyStoreError> {
        if self.revoked()?.is_none() {
            return Ok(());
        }
        match self.current()? {
            Some(current) if !self.is_revoked(&current)? => {
                // The mark goes last: after a power cut in between the next start deletes the key again.
                self.drop_previous()?;
                self.delete(&with(&self.path, "revoked"))
            }
            _ => Ok(()),
        }
    }

    /// Stores a key that will be sent to the vehicle. It must be stored before the vehicle receives it.
    ///
    /// # Errors
    /// Another one is here already, or it could not be made durable.
    pub fn stage(&self, key: &SigningKey) -> Result<(), KeyStoreError> {
        let path = with(&self.path, "next");
        match self.next()? {
            Some(next) if next.same_as(key) => Ok(()),
            Some(_) => Err(KeyStoreError::Unfinished { path }),
            None => self.save(&path, key),
        }
    }

    /// Stores a key as the next one, replacing any other, which can then no longer be sent to the vehicle.
    ///
    /// # Errors
    /// It could not be made durable; what was there before still is.
    pub fn restage(&self, key: &SigningKey) -> Result<(), KeyStoreError> {
        self.mark();
        self.save(&with(&self.path, "next"), key)
    }

    /// The vehicle has the next key: it becomes the current one, and the current one the previous, or is deleted if it is
    /// revoked.
    ///
    /// Repeating it after a failure, or after a power cut in the middle, has the same result.
    ///
    /// # Errors
    /// A step could not be made durable: both keys are still here.
    pub fn commit(&self) -> Result<(), KeyStoreError> {
        let next = with(&self.path, "next");
        if self.next()?.is_none() {
            return self.finish_revocation();
        }
        self.mark();
        // The previous key is saved before the rename takes the current one's place: no step leaves a key nowhere.
        if let Some(current) = self.current()?
            && !self.is_revoked(&current)?
        {
            self.save(&with(&self.path, "previous"), &current)?;
        }
        let change = |cause| KeyStoreError::Change {
            path: self.path.clone(),
            cause,
        };
        match self.system.rename_locked(&next, &self.path) {
            Ok(Some(file)) => drop(self.key_lock.replace(Some(file))),
            // A system that renames later locks the file itself.
            Ok(None) => {}
            Err(cause) if cause.kind() == io::ErrorKind::WouldBlock => {
                let path = next;
                return Err(KeyStoreError::Locked { path });
            }
            Err(cause) => return Err(change(cause)),
        }
        self.system
            .sync(disk::folder_of(&self.path))
            .map_err(change)?;
        self.finish_revocation()
    }

    /// The vehicle keeps the current key: the next one is deleted.
    ///
    /// # Errors
    /// It could not be deleted.
    pub fn drop_next(&self) -> Result<(), KeyStoreError> {
        self.mark();
        // The vehicle keeps the current key, so the mark to revoke it is void: the key must stay usable.
        self.delete(&with(&self.path, "next"))?;
        match self.revoked()? {
            Some(_) => self.delete(&with(&self.path, "revoked")),
            None => Ok(()),
        }
    }

    /// Deletes the previous key: it is no longer needed, or must not be used.
    ///
    /// # Errors
    /// It could not be deleted.
    pub fn drop_previous(&self) -> Result<(), KeyStoreError> {
        self.mark();
        self.delete(&with(&self.path, "previous"))
    }

    fn load(&self, path: &Path) -> Result<Option<SigningKey>, KeyStoreError> {
        let io = |cause| KeyFileError::Io {
            path: path.to_owned(),
            cause,
        };
        let Some(text) = self.system.read(path, key_file::MAX_BYTES).map_err(io)? else {
            return Ok(None);
        };
        let mode = match fs::metadata(path) {
            Ok(file) => file.permissions().mode() & 0o777,
            // This process has written it, and it is not on the disk yet.
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => 0o600,
            Err(cause) => return Err(io(cause).into()),
        };
        if mode & 0o077 != 0 {
            return Err(KeyStoreError::File(KeyFileError::Permissions {
                path: path.to_owned(),
                mode,
            }));
        }
        Ok(Some(key_file::parse(path, &text)?))
    }

    fn save(&self, path: &Path, key: &SigningKey) -> Result<(), KeyStoreError> {
        let text: Zeroizing<String> = key_file::hex(key);
        disk::replace(&*self.system, path, text.as_bytes(), true).map_err(|cause| {
            KeyStoreError::Change {
                path: path.to_owned(),
                cause,
            }
        })
    }

    fn delete(&self, path: &Path) -> Result<(), KeyStoreError> {
        self.system
            .remove(path)
            .and_then(|()| self.system.sync(disk::folder_of(path)))
            .map_err(|cause| KeyStoreError::Change {
                path: path.to_owned(),
                cause,
            })
    }
}

impl Keyring for KeyStore {
    fn current(&self) -> Result<Option<SigningKey>, StoreError> {
        KeyStore::current(self).map_err(fault)
    }

    fn next(&self) -> Result<Option<SigningKey>, StoreError> {
        KeyStore::next(self).map_err(fault)
    }

    fn restage(&self, key: &SigningKey) -> Result<(), StoreError> {
        KeyStore::restage(self, key).map_err(fault)
    }

    fn commit(&self) -> Result<(), StoreError> {
        KeyStore::commit(self).map_err(fault)
    }

    fn drop_next(&self) -> Result<(), StoreError> {
        KeyStore::drop_next(self).map_err(fault)
    }

    fn bury(&self, disk: &mut dyn Disk) -> Result<(), StoreError> {
        KeyStore::bury(self, disk)
    }
}

fn fault(cause: KeyStoreError) -> StoreError {
    StoreError::new("key", cause)
}

/// As [`real_path`], where the folders on the way may be trusted, and each file of the keys can be replaced.
fn trusted_path(path: &Path) -> Result<PathBuf, KeyStoreError> {
    // Before anything is made beside the file that a link leads to.
    let there = fs::symlink_metadata(path).is_ok();
    let way = if there { path } else { disk::folder_of(path) };
    ownership::check_way(way).map_err(KeyFileError::from)?;
    let real = real_path(path).map_err(|cause| KeyStoreError::Change {
        path: path.to_owned(),
        cause,
    })?;
    // The folder of a link and that of its target: anyone who can write either decides which key is used.
    for folder in [disk::folder_of(path), disk::folder_of(&real)] {
        ownership::check_folder(folder).map_err(KeyFileError::from)?;
    }
    check_names(&real).map_err(KeyFileError::from)?;
    Ok(real)
}

/// Whether each file of the keys whose current one is at `path` can be replaced.
///
/// # Errors
/// A folder has the name of one that is being written.
pub(crate) fn check_names(path: &Path) -> Result<(), InTheWay> {
    let files = files_of(path);
    files.iter().try_for_each(|file| disk::check_name(file))
}

/// All files of the keys whose current one is really at `path`, whether they exist or not.
pub(super) fn files_of(path: &Path) -> Vec<PathBuf> {
    let beside = ["next", "previous", "revoked", "dead", "pairing"];
    let beside = beside.map(|what| with(path, what));
    beside.into_iter().chain([path.to_owned()]).collect()
}

/// Where a key file really is, or will be; the other files are beside it.
///
/// # Errors
/// The folder is not there, or a symbolic link leads nowhere.
pub fn real_path(path: &Path) -> io::Result<PathBuf> {
    match fs::canonicalize(path) {
        Err(cause) if cause.kind() == io::ErrorKind::NotFound && !path.is_symlink() => {
            let folder = fs::canonicalize(disk::folder_of(path))?;
            Ok(folder.join(path.file_name().unwrap_or_default()))
        }
        found => found,
    }
}

/// The names of dead keys have 17 bytes each; each interrupted change adds at most three.
const MAX_NAMED: u64 = 16 * 1024;

/// `uav1.key` with `next`: `uav1.key.next`.
fn with(path: &Path, part: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".");
    name.push(part);
    PathBuf::from(name)
}
