//! Checks the ownership of files: keys, clocks and authority come from files, and anyone who can write them controls the
//! aircraft.
//!
//! A file or folder must belong to this process's user or to root, and nobody else may write the folder: the right to write
//! a folder is the right to put another file in the place of one in it. A folder with the sticky bit (/tmp) is not open in
//! this sense. Files are opened without following a symbolic link, except where a person has named one in the configuration.

use std::fs::{self, File, Metadata, OpenOptions};
use std::io;
use std::os::unix::fs::{MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};

use rustix::fs::OFlags;

/// A file or folder that must not be trusted.
#[derive(Debug, thiserror::Error)]
pub enum OwnershipError {
    /// It belongs to somebody else.
    #[error(
        "{path} belongs to user {owner}, expected user {expected} or root: chown it",
        path = path.display()
    )]
    Owner {
        /// The file or folder.
        path: PathBuf,
        /// Its owner's number.
        owner: u32,
        /// This process's user.
        expected: u32,
    },
    /// Others may put files into it.
    #[error(
        "folder {path} can be written by others (mode {mode:03o}): chmod go-w it",
        path = path.display()
    )]
    Writable {
        /// The folder.
        path: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// It is not a regular file: a device, a pipe, a folder.
    #[error("{path} is not a regular file", path = path.display())]
    NoFile {
        /// The path.
        path: PathBuf,
    },
    /// The system reports no owner.
    #[error("{path}: {cause}", path = path.display())]
    Io {
        /// The path.
        path: PathBuf,
        /// The system's reason.
        cause: io::Error,
    },
}

impl From<OwnershipError> for io::Error {
    fn from(fault: OwnershipError) -> io::Error {
        io::Error::new(io::ErrorKind::PermissionDenied, fault)
    }
}

/// Checks whether an opened file may be trusted. The check is on the open file, since its name may lead to another file by
/// now.
///
/// # Errors
/// It may not.
pub(super) fn check_file(file: &File, path: &Path) -> Result<(), OwnershipError> {
    let about = file.metadata().map_err(|cause| io_fault(path, cause))?;
    check_owner(&about, path)?;
    if about.is_file() {
        Ok(())
    } else {
        let path = path.to_owned();
        Err(OwnershipError::NoFile { path })
    }
}

/// Checks whether the content of a folder may be trusted.
///
/// # Errors
/// It may not.
pub(super) fn check_folder(path: &Path) -> Result<(), OwnershipError> {
    let about = fs::metadata(path).map_err(|cause| io_fault(path, cause))?;
    check_owner(&about, path)?;
    let mode = about.mode() & 0o7777;
    if mode & 0o022 != 0 && mode & STICKY == 0 {
        let path = path.to_owned();
        return Err(OwnershipError::Writable { path, mode });
    }
    Ok(())
}

/// Opens as `how` says, but not through a symbolic link.
///
/// # Errors
/// The system's; ELOOP for a link.
pub(super) fn open_no_link(how: &mut OpenOptions, path: &Path) -> io::Result<File> {
    // Opening a pipe would block until its other end is opened. With NONBLOCK it opens at once, and `check_file` refuses
    // it.
    let flags = OFlags::NOFOLLOW | OFlags::NONBLOCK;
    how.custom_flags(flags.bits().cast_signed()).open(path)
}

fn check_owner(about: &Metadata, path: &Path) -> Result<(), OwnershipError> {
    let (owner, expected) = (about.uid(), rustix::process::geteuid().as_raw());
    if is_trusted(owner, expected) {
        return Ok(());
    }
    Err(OwnershipError::Owner {
        path: path.to_owned(),
        owner,
        expected,
    })
}

fn is_trusted(owner: u32, own: u32) -> bool {
    // Root could change the file in any case.
    owner == own || owner == 0
}

fn io_fault(path: &Path, cause: io::Error) -> OwnershipError {
    OwnershipError::Io {
        path: path.to_owned(),
        cause,
    }
}

const STICKY: u32 = 0o1000;

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt as _, chown, symlink};

    use super::*;
    use crate::shell::disk::FileDisk;
    use crate::shell::key_file;
    use crate::shell::key_store::KeyStore;
    use mavlink_link::store::{Disk as _, Durability};

    #[test]
    fn own_files_and_roots_are_believed() {
        for (owner, own, trusted) in [(7, 7, true), (0, 7, true), (8, 7, false), (7, 0, false)] {
            assert_eq!(is_trusted(owner, own), trusted, "{owner} {own}");
        }
    }

    #[test]
    fn keys_and_store_of_another_user_are_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let (key, store) = (folder.path().join("uav1.key"), folder.path().join("state"));
        key_file::generate(&key).unwrap();
        drop(FileDisk::open(&store).unwrap());
        if chown(&key, Some(12_345), None).is_err() {
            // Only root can give files away. `own_files_and_roots_are_believed` is the rule without it.
            return;
        }
        let expected = format!(
            "{} belongs to user 12345, expected user 0 or root",
            key.display()
        );
        for refused in [
            key_file::read(&key).unwrap_err().to_string(),
            KeyStore::open(&key).unwrap_err().to_string(),
        ] {
            assert!(refused.contains(&expected), "{refused}");
        }
        chown(&store, Some(12_345), None).unwrap();
        let refused = FileDisk::open(&store).unwrap_err().to_string();
        assert!(refused.contains("belongs to user 12345"), "{refused}");
        chown(&store, Some(0), None).unwrap();
        // A single record that somebody else has put there.
        let mut disk = FileDisk::open(&store).unwrap();
        disk.replace("record", b"1", Durability::Process).unwrap();
        chown(store.join("record"), Some(12_345), None).unwrap();
        let refused = disk.read("record", 10).unwrap_err().to_string();
        assert!(refused.contains("belongs to user 12345"), "{refused}");
    }

    #[test]
    fn a_key_in_a_folder_that_others_may_write_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let key = folder.path().join("uav1.key");
        key_file::generate(&key).unwrap();
        for (mode, good) in [
            (0o777, false),
            (0o770, false),
            (0o1777, true),
            (0o755, true),
        ] {
            fs::set_permissions(folder.path(), fs::Permissions::from_mode(mode)).unwrap();
            let opened = KeyStore::open(&key).map(drop).map_err(|e| e.to_string());
            assert_eq!(opened.is_ok(), good, "{mode:o}: {opened:?}");
            if let Err(fault) = opened {
                assert!(fault.contains("can be written by others"), "{fault}");
            }
        }
    }

    #[test]
    fn no_symbolic_link_in_the_store_is_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (store, target) = (folder.path().join("state"), folder.path().join("target"));
        fs::write(&target, "somebody's").unwrap();
        let mut disk = FileDisk::open(&store).unwrap();
        for name in ["record", "record.new", "log"] {
            symlink(&target, store.join(name)).unwrap();
        }
        assert!(disk.read("record", 100).is_err());
        assert!(disk.append("log", b"line\n", Durability::Process).is_err());
        // The link is replaced, and not what it leads to.
        disk.replace("record", b"mine", Durability::Power).unwrap();
        assert_eq!(&**disk.read("record", 100).unwrap().unwrap(), b"mine");
        assert_eq!(fs::read(&target).unwrap(), b"somebody's");
        drop(disk);
        // The lock, and the files beside a key.
        fs::remove_file(store.join("lock")).unwrap();
        symlink(&target, store.join("lock")).unwrap();
        assert!(FileDisk::open(&store).is_err());
        let key = folder.path().join("uav1.key");
        key_file::generate(&key).unwrap();
        let other = folder.path().join("other.key");
        key_file::generate(&other).unwrap();
        symlink(&other, folder.path().join("uav1.key.next")).unwrap();
        let keys = KeyStore::open(&key).unwrap();
        assert!(keys.next().is_err());
        drop(keys);
        symlink(&target, folder.path().join("other.key.lock")).unwrap();
        assert!(KeyStore::open(&other).is_err());
    }

    #[test]
    fn a_pipe_in_the_place_of_a_record_keeps_nobody_waiting() {
        let folder = tempfile::tempdir().unwrap();
        let store = folder.path().join("state");
        let disk = FileDisk::open(&store).unwrap();
        let made = std::process::Command::new("mkfifo")
            .arg(store.join("record"))
            .status();
        assert!(made.unwrap().success());
        let refused = disk.read("record", 10).unwrap_err().to_string();
        assert!(refused.contains("not a regular file"), "{refused}");
    }
}
