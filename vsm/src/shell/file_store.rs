//! Records as files of one folder: written beside, synchronised, renamed; locked against a second process.

use std::fs::{self, DirBuilder, File, OpenOptions};
use std::io;
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use super::audit_log;
use super::durable::{self, Disk, SystemDisk};
use crate::session::{Durability, Store, StoreError, log_name};

/// The folder of `[store] dir`. Only one process holds it at a time.
#[derive(Debug)]
pub struct FileStore {
    folder: PathBuf,
    disk: Box<dyn Disk>,
    /// Held open for its lock.
    _lock: File,
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
    /// Others may read or write it: it holds what decides which frames are believed.
    #[error("[store] dir {folder} is open to others (mode {mode:03o}), expected 0700: chmod 700 it", folder = folder.display())]
    Permissions {
        /// The folder.
        folder: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// Another process has it.
    #[error("[store] dir {folder} is in use by another vsm: two must not share one signing clock", folder = folder.display())]
    Locked {
        /// The folder.
        folder: PathBuf,
    },
}

impl FileStore {
    /// Opens a folder, made with mode 0700 where it is missing, and locks it for this process.
    ///
    /// # Errors
    /// It cannot be made or written, others may use it, or another process has it.
    pub fn open(folder: &Path) -> Result<FileStore, OpenError> {
        FileStore::open_on(folder, Box::new(SystemDisk))
    }

    /// As [`FileStore::open`], with all writing by `disk`.
    ///
    /// # Errors
    /// As [`FileStore::open`].
    pub fn open_on(folder: &Path, disk: Box<dyn Disk>) -> Result<FileStore, OpenError> {
        let fault = |cause| OpenError::Folder {
            folder: folder.to_owned(),
            cause,
        };
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
        let lock = OpenOptions::new()
            .write(true)
            .create(true)
            .truncate(false)
            .mode(0o600)
            .open(folder.join("lock"))
            .map_err(fault)?;
        if !durable::lock(&lock).map_err(fault)? {
            return Err(OpenError::Locked {
                folder: folder.to_owned(),
            });
        }
        Ok(FileStore {
            folder: folder.to_owned(),
            disk,
            _lock: lock,
        })
    }

    fn write(&self, name: &str, bytes: &[u8], durability: Durability) -> io::Result<()> {
        let power = durability == Durability::Power;
        durable::replace(&*self.disk, &self.folder.join(name), bytes, power)
    }

    fn read(&self, name: &str) -> io::Result<Option<Vec<u8>>> {
        // Moved out, not copied: the identity is among the records, and its reader wipes it.
        let bytes = self.disk.read(&self.folder.join(name), MAX_BYTES)?;
        Ok(bytes.map(|mut bytes| std::mem::take(&mut *bytes)))
    }
}

impl Store for FileStore {
    fn save(&mut self, name: &str, bytes: &[u8], durability: Durability) -> Result<(), StoreError> {
        self.write(name, bytes, durability)
            .map_err(|cause| StoreError {
                name: name.to_owned(),
                cause: cause.to_string(),
            })
    }

    fn load(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        self.read(name).map_err(|cause| StoreError {
            name: name.to_owned(),
            cause: cause.to_string(),
        })
    }

    fn append(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        let power = durability == Durability::Power;
        audit_log::append(&self.folder.join(name), bytes, power).map_err(|cause| StoreError {
            name: name.to_owned(),
            cause: cause.to_string(),
        })
    }

    fn rotate(&mut self, name: &str, keep: u32) -> Result<(), StoreError> {
        let paths: Vec<PathBuf> = (0..=keep)
            .rev()
            .map(|number| self.folder.join(log_name(name, number)))
            .collect();
        let paths: Vec<&Path> = paths.iter().map(PathBuf::as_path).collect();
        audit_log::shift(&paths).map_err(|cause| StoreError {
            name: name.to_owned(),
            cause: cause.to_string(),
        })
    }

    fn load_whole(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        audit_log::read(&self.folder.join(name)).map_err(|cause| StoreError {
            name: name.to_owned(),
            cause: cause.to_string(),
        })
    }
}

/// Bound on a record that is read back: a full plan of 10,000 waypoints is a quarter of it.
const MAX_BYTES: u64 = 16 << 20;
