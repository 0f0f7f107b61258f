//! Files that are replaced whole: after a power cut there are the old bytes or the new, never a part.
//!
//! Written beside, synchronised, renamed, and the folder synchronised. Whatever step fails, the file
//! that was there before can still be read. The steps go through [`Disk`], so that a test can let each
//! of them fail.

use std::fmt;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::OpenOptionsExt;
use std::path::{Path, PathBuf};

use rustix::fs::FlockOperation;
use rustix::io::Errno;
use zeroize::Zeroizing;

/// The steps of writing and reading a file.
pub trait Disk: fmt::Debug + Send + Sync {
    /// Writes a new file, mode 0600, in place of what bears its name.
    ///
    /// # Errors
    /// The system's; part of the bytes may have been written.
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()>;

    /// Brings a file, or the names in a folder, to the disk.
    ///
    /// # Errors
    /// The system's.
    fn sync(&self, path: &Path) -> io::Result<()>;

    /// Puts a file in the place of another.
    ///
    /// # Errors
    /// The system's; nothing has changed then.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;

    /// Deletes a file; one that is not there is deleted already.
    ///
    /// # Errors
    /// The system's.
    fn remove(&self, path: &Path) -> io::Result<()>;

    /// The first `most` bytes of a file; `None` where there is none.
    ///
    /// # Errors
    /// The system's.
    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>>;
}

/// The disk of this computer.
#[derive(Debug, Clone, Copy, Default)]
pub struct SystemDisk;

impl Disk for SystemDisk {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        // One that is there has a mode and an owner of its own, or is a link to somewhere else.
        self.remove(path)?;
        OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(path)?
            .write_all(bytes)
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        File::open(path)?.sync_all()
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        fs::rename(from, to)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        match fs::remove_file(path) {
            Err(cause) if cause.kind() != io::ErrorKind::NotFound => Err(cause),
            _ => Ok(()),
        }
    }

    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        let file = match File::open(path) {
            Ok(file) => file,
            Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(None),
            Err(cause) => return Err(cause),
        };
        // Room from the start: a buffer that grows leaves copies of what it held behind.
        let size = file.metadata()?.len().min(most);
        let mut bytes = Zeroizing::new(Vec::with_capacity(usize::try_from(size).unwrap_or(0) + 1));
        file.take(most).read_to_end(&mut bytes)?;
        Ok(Some(bytes))
    }
}

/// Replaces the file at `path`. With `power` it has survived a power cut when this returns.
///
/// # Errors
/// The first step that fails. The old file is still there, or, where only the folder's names could not
/// be synchronised, the new one.
pub fn replace(disk: &dyn Disk, path: &Path, bytes: &[u8], power: bool) -> io::Result<()> {
    let beside = &beside(path);
    let written = disk
        .write(beside, bytes)
        .and_then(|()| if power { disk.sync(beside) } else { Ok(()) })
        .and_then(|()| disk.rename(beside, path));
    if written.is_err() {
        // What lies there may be part of a key. On a disk that fails, that may fail too.
        let _ = disk.remove(beside);
        return written;
    }
    if power {
        disk.sync(folder_of(path))?;
    }
    Ok(())
}

/// Makes a file that does not exist yet. It has survived a power cut when this returns, and is whole whenever it is
/// there.
///
/// # Errors
/// It exists, or a step fails; where only the folder's names could not be synchronised it is there.
pub fn create(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let beside = &beside(path);
    let disk = SystemDisk;
    // A second name, and not a new name: that would take the place of a file that is there.
    let made = disk
        .write(beside, bytes)
        .and_then(|()| disk.sync(beside))
        .and_then(|()| fs::hard_link(beside, path));
    let removed = disk.remove(beside);
    made.and(removed).and_then(|()| disk.sync(folder_of(path)))
}

/// `uav1.key` while it is being written: `uav1.key.new`.
fn beside(path: &Path) -> PathBuf {
    let mut beside = path.as_os_str().to_owned();
    beside.push(".new");
    PathBuf::from(beside)
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

/// The folder that a file is in.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}
