//! Checks the ownership of files: keys, clocks and authority come from files, and anyone who can write them controls the
//! aircraft.
//!
//! A file or folder must belong to this process's user or to root, and nobody else may write the folder: the right to write
//! a folder is the right to put another file in the place of one in it. A folder with the sticky bit (/tmp) is not open in
//! this sense. Files are opened without following a symbolic link, except where a person has named one in the configuration.
//!
//! A service has a user of its own, and an administrator runs its commands as root. What root then wrote could not be read by
//! the service; and whoever owns a folder decides what each name in it leads to, so that root could be made to write, or
//! erase, anything. So root gives up its rights before it touches the store of another user ([`act_as`]): it can write there
//! what that user can, and what it writes is that user's. It keeps one right, to read, without which the folder of a service
//! with a dynamic user cannot be reached; a file that only this right opens is refused, since the service could not read it. A
//! single file that root writes in another user's folder, or in place of another user's file, is handed to that user
//! (`keep_owner`).
//!
//! Where root stays root, it follows a path only as far as root alone decides where it leads (`first_other`): each folder and
//! each link on the way is root's, and nobody else may write these folders. So nobody can change that way after the look. The
//! sticky bit keeps others from replacing what is there, and not from putting a link where there is nothing yet.

use std::ffi::OsString;
use std::fs::{self, File, Metadata, OpenOptions};
use std::io;
use std::os::unix::fs::{FileTypeExt as _, MetadataExt as _, OpenOptionsExt as _, fchown};
use std::path::{Component, Path, PathBuf};

use rustix::fs::OFlags;
use rustix::io::Errno;
use rustix::process::geteuid;
use rustix::thread::{
    CapabilitySet, CapabilitySets, Gid, Uid, capabilities, set_capabilities, set_keep_capabilities,
    set_thread_groups, set_thread_res_gid, set_thread_res_uid,
};

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
    /// Nothing is there yet, and others may put something there.
    #[error(
        "there is no {path} yet, and others may put a link there, since they can write the folder above it (mode {mode:03o}): as root, make it first, with mode 0700",
        path = path.display()
    )]
    Open {
        /// What is missing.
        path: PathBuf,
        /// The mode of the folder above it.
        mode: u32,
    },
    /// This process's user may not read it.
    #[error(
        "{path} belongs to user {owner}, mode {mode:03o}, and user {user}, as which this runs, must be able to read it: chown {user} it",
        path = path.display()
    )]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Its owner's number.
        owner: u32,
        /// Its mode.
        mode: u32,
        /// This process's user.
        user: u32,
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
        check_readable(&about, path)
    } else {
        let path = path.to_owned();
        Err(OwnershipError::NoFile { path })
    }
}

/// Checks that this process's user may read a file by its owner and mode, and not because root has kept a right.
///
/// # Errors
/// It may not.
pub(crate) fn check_readable(about: &Metadata, path: &Path) -> Result<(), OwnershipError> {
    let (owner, user, mode) = (about.uid(), geteuid().as_raw(), about.mode() & 0o777);
    // Root's group is no reason for another user to read it, where only the right that root has kept opens it.
    let by_group = mode & 0o040 != 0 && (about.gid() != 0 || !reads_all());
    if owner == user || user == 0 || mode & 0o004 != 0 || by_group {
        return Ok(());
    }
    Err(OwnershipError::Unreadable {
        path: path.to_owned(),
        owner,
        mode,
        user,
    })
}

/// Whether this process reads any file, as root does and as [`act_as`] leaves it.
fn reads_all() -> bool {
    let reads = |sets: CapabilitySets| sets.effective.contains(CapabilitySet::DAC_READ_SEARCH);
    capabilities(None).is_ok_and(reads)
}

/// Accepts a file whoever it belongs to: the service manager reads it, as root.
///
/// # Errors
/// It is no regular file.
pub(super) fn check_kind(file: &File, path: &Path) -> Result<(), OwnershipError> {
    let about = file.metadata().map_err(|cause| io_fault(path, cause))?;
    let path = path.to_owned();
    (about.is_file().then_some(())).ok_or(OwnershipError::NoFile { path })
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

/// As [`check_file`], for a command that replaces the file: root may do so for the user that the file belongs to, where root
/// alone can have put it there.
///
/// # Errors
/// It may not be trusted.
pub(super) fn check_file_to_replace(file: &File, path: &Path) -> Result<(), OwnershipError> {
    let folder = fs::metadata(folder_of(path)).map_err(|cause| io_fault(path, cause))?;
    let about = file.metadata().map_err(|cause| io_fault(path, cause))?;
    if geteuid().is_root() && is_of_root_alone(&folder) && about.is_file() {
        return Ok(());
    }
    check_file(file, path)
}

/// A user, and a group of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Owner {
    /// The user's number.
    pub user: u32,
    /// The group's number.
    pub group: u32,
}

/// Whose folder it is, where this is root and another user decides what the path leads to: the owner of the first folder or link on
/// the way that is not root's. Of one that is not there yet: who decides where it would be made.
///
/// # Errors
/// Others than root, and not one alone, decide that: they may write a folder on the way.
pub fn other_owner(folder: &Path) -> Result<Option<Owner>, OwnershipError> {
    if !geteuid().is_root() {
        return Ok(None);
    }
    let other = first_other(folder)?;
    Ok(other.map(|(_, other)| Owner {
        user: other.uid(),
        group: other.gid(),
    }))
}

/// Checks, where this is root, that root alone decides what a path leads to. What is not there yet may be made.
///
/// # Errors
/// Others may decide it.
pub(super) fn check_way(path: &Path) -> Result<(), OwnershipError> {
    if !geteuid().is_root() {
        return Ok(());
    }
    let Some((path, about)) = first_other(path)? else {
        return Ok(());
    };
    Err(OwnershipError::Owner {
        path,
        owner: about.uid(),
        expected: 0,
    })
}

/// The first folder, link or file on the way to a path that is not root's. `None`: root alone decides what it leads to, or what
/// will be made there. What is behind the result was not looked at, since its owner may change it at any time.
fn first_other(path: &Path) -> Result<Option<(PathBuf, Metadata)>, OwnershipError> {
    let path = std::path::absolute(path).map_err(|cause| io_fault(path, cause))?;
    let look = |at: &Path| fs::symlink_metadata(at).map_err(|cause| io_fault(at, cause));
    let mut at = PathBuf::from("/");
    let mut folder = look(&at)?;
    // The next one is the last.
    let mut rest = names(&path);
    let mut links = 0;
    while let Some(name) = rest.pop() {
        let mode = folder.mode() & 0o7777;
        let (shared, sticky) = (mode & 0o022 != 0, mode & STICKY != 0);
        if shared && !sticky {
            return Err(OwnershipError::Writable { path: at, mode });
        }
        // `at` has no links left in it: the folder above it is the one that the system would go to.
        let next = if name == ".." {
            at.parent().unwrap_or(&at).to_owned()
        } else {
            at.join(name)
        };
        let about = match fs::symlink_metadata(&next) {
            Err(cause) if cause.kind() == io::ErrorKind::NotFound && shared => {
                return Err(OwnershipError::Open { path: next, mode });
            }
            // Root would make it. Below a file there is nothing.
            Err(cause)
                if matches!(
                    cause.kind(),
                    io::ErrorKind::NotFound | io::ErrorKind::NotADirectory
                ) =>
            {
                return Ok(None);
            }
            about => about.map_err(|cause| io_fault(&next, cause))?,
        };
        if !is_roots(&about) {
            return Ok(Some((next, about)));
        }
        if !about.is_symlink() {
            (at, folder) = (next, about);
            continue;
        }
        links += 1;
        // A second name of a link of root's: somebody else may have given it that.
        if shared && about.nlink() > 1 {
            return Err(OwnershipError::Open { path: next, mode });
        }
        if links > MAX_LINKS {
            return Err(io_fault(&next, Errno::LOOP.into()));
        }
        let target = fs::read_link(&next).map_err(|cause| io_fault(&next, cause))?;
        if target.is_absolute() {
            at = PathBuf::from("/");
            folder = look(&at)?;
        }
        rest.extend(names(&target));
    }
    Ok(None)
}

/// The names in a path, the last one first.
fn names(path: &Path) -> Vec<OsString> {
    let parts = path.components().rev().filter_map(|part| match part {
        Component::Normal(name) => Some(name.to_owned()),
        Component::ParentDir => Some("..".into()),
        Component::RootDir | Component::CurDir | Component::Prefix(_) => None,
    });
    parts.collect()
}

/// Root's; or of a user that this user namespace does not have: whose it is, is decided outside of it, as all else of it.
fn is_roots(about: &Metadata) -> bool {
    about.uid() == 0 || about.uid() == OVERFLOW_USER && is_in_user_namespace()
}

fn is_in_user_namespace() -> bool {
    let map = fs::read_to_string("/proc/self/uid_map").unwrap_or_default();
    let all = map.split_whitespace().eq(["0", "0", "4294967295"]);
    !map.is_empty() && !all
}

/// Gives up root's rights for good but that to read: this process acts as the owner of a folder from here on. `devices`: serial
/// lines that it is to open; of each it has the group, as the service has. To be called before the process has a second thread.
///
/// # Errors
/// The system's: this process may not change its user.
pub fn act_as(owner: Owner, devices: &[&Path]) -> io::Result<()> {
    let (user, group) = (Uid::from_raw(owner.user), Gid::from_raw(owner.group));
    let lines = devices
        .iter()
        .filter_map(|device| fs::metadata(device).ok());
    // Root's group is nobody's reason to open a line.
    let lines = lines.filter(|about| about.file_type().is_char_device() && about.gid() != 0);
    let mut groups = vec![group];
    groups.extend(lines.map(|about| Gid::from_raw(about.gid())));
    // All are kept through the change of the user, and all but one given up behind it.
    set_keep_capabilities(true)?;
    // Groups first: the user has no right to change them.
    set_thread_groups(&groups)?;
    set_thread_res_gid(group, group, group)?;
    set_thread_res_uid(user, user, user)?;
    let keep = |kept| {
        set_capabilities(
            None,
            CapabilitySets {
                effective: kept,
                permitted: kept,
                inheritable: CapabilitySet::empty(),
            },
        )
    };
    // systemd keeps the folder of a dynamic user below /var/lib/private, which root alone may enter. A container may lack the
    // right, and has no such folder.
    keep(CapabilitySet::DAC_READ_SEARCH).or_else(|_| keep(CapabilitySet::empty()))?;
    Ok(())
}

/// Hands a file that root writes to whom the folder of `place`, in which it will be, belongs, or else the file that it will
/// replace there: otherwise the service whose file it is could not read it. The open file, since the folder's owner may have put
/// another file of root's under its name, and must not be given that.
///
/// # Errors
/// It cannot be handed over.
pub(super) fn keep_owner(written: &File, place: &Path) -> io::Result<()> {
    if !geteuid().is_root() {
        return Ok(());
    }
    let folder = fs::metadata(folder_of(place)).ok();
    let replaced = fs::symlink_metadata(place).ok();
    let mut others = folder.into_iter().chain(replaced);
    match others.find(|about| about.uid() != 0) {
        Some(owner) => fchown(written, Some(owner.uid()), Some(owner.gid())),
        None => Ok(()),
    }
}

/// Hands a file that root has written to whom the file `like` beside it belongs, where root alone writes the folder: elsewhere
/// [`keep_owner`] has handed it to the folder's owner.
///
/// # Errors
/// It cannot be handed over.
pub(super) fn share_owner(written: &Path, like: &Path) -> io::Result<()> {
    if !geteuid().is_root() || !is_of_root_alone(&fs::metadata(folder_of(written))?) {
        return Ok(());
    }
    let owner = match fs::symlink_metadata(like) {
        Ok(about) if about.uid() != 0 => about,
        _ => return Ok(()),
    };
    match open_no_link(OpenOptions::new().read(true), written) {
        Ok(file) => fchown(&file, Some(owner.uid()), Some(owner.gid())),
        // A queue writes it later, in a process that acts as the owner.
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(cause) => Err(cause),
    }
}

fn is_of_root_alone(folder: &Metadata) -> bool {
    folder.uid() == 0 && folder.mode() & 0o022 == 0
}

/// A file that may not be read, with whose it is: the system only says that it is denied.
pub(super) fn explain(path: &Path, cause: io::Error) -> io::Error {
    let Ok(about) = fs::metadata(path) else {
        return cause;
    };
    if cause.kind() != io::ErrorKind::PermissionDenied {
        return cause;
    }
    match check_readable(&about, path) {
        // For another reason than its owner and mode.
        Ok(()) => cause,
        Err(fault) => io::Error::new(io::ErrorKind::PermissionDenied, format!("{cause}: {fault}")),
    }
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
    let (owner, expected) = (about.uid(), geteuid().as_raw());
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

/// The folder that a file is in.
#[must_use]
pub fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if folder != Path::new("") => folder,
        _ => Path::new("."),
    }
}

fn io_fault(path: &Path, cause: io::Error) -> OwnershipError {
    OwnershipError::Io {
        path: path.to_owned(),
        cause,
    }
}

const STICKY: u32 = 0o1000;
/// As which the system shows the users that a user namespace does not have.
const OVERFLOW_USER: u32 = 65_534;
/// As many as the system follows.
const MAX_LINKS: usize = 40;

#[cfg(test)]
mod tests {
    use std::os::unix::fs::{PermissionsExt as _, chown, lchown, symlink};

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
    fn root_acts_as_the_owner_of_a_folder_and_of_a_link_that_leads_to_one() {
        let folder = tempfile::tempdir().unwrap();
        let (own, link) = (folder.path().join("own"), folder.path().join("link"));
        fs::create_dir(&own).unwrap();
        symlink(&own, &link).unwrap();
        assert_eq!(other_owner(&own).unwrap(), None);
        assert_eq!(other_owner(&link).unwrap(), None);
        if lchown(&link, Some(12_345), Some(12_346)).is_err() {
            // Only root can give files away, and only root acts as somebody else.
            return;
        }
        let other = Some(Owner {
            user: 12_345,
            group: 12_346,
        });
        assert_eq!(other_owner(&link).unwrap(), other);
        assert_eq!(other_owner(&link.join("below")).unwrap(), other);
        assert_eq!(other_owner(&own).unwrap(), None);
        // A link of root's to a place that leads over that link.
        symlink("link/below", folder.path().join("outer")).unwrap();
        let outer = folder.path().join("own/../outer");
        assert_eq!(other_owner(&outer).unwrap(), other);
        // Root's folder in that of another user, who may replace it.
        fs::create_dir(own.join("state")).unwrap();
        chown(&own, Some(12_345), Some(12_346)).unwrap();
        assert_eq!(other_owner(&own).unwrap(), other);
        assert_eq!(other_owner(&own.join("state")).unwrap(), other);
        assert_eq!(other_owner(&own.join("to/be/made")).unwrap(), other);
        let refused = check_way(&own.join("state")).unwrap_err().to_string();
        assert!(refused.contains("own belongs to user 12345"), "{refused}");
    }

    #[test]
    fn root_goes_no_way_that_others_may_change() {
        if !geteuid().is_root() {
            // Another user can have nothing of root's erased.
            return;
        }
        let folder = tempfile::tempdir().unwrap();
        let open = folder.path().join("open");
        fs::create_dir(&open).unwrap();
        fs::create_dir(open.join("state")).unwrap();
        symlink("state", open.join("link")).unwrap();
        let mode = |mode| fs::set_permissions(&open, fs::Permissions::from_mode(mode)).unwrap();
        for one in ["state", "link", "absent"] {
            mode(0o777);
            let refused = other_owner(&open.join(one)).unwrap_err().to_string();
            assert!(refused.contains("can be written by others"), "{refused}");
            mode(0o755);
            assert_eq!(other_owner(&open.join(one)).unwrap(), None);
        }
        // What is root's cannot be replaced in a sticky folder, but what is not there can be put there.
        mode(0o1777);
        assert_eq!(other_owner(&open.join("state/new")).unwrap(), None);
        assert_eq!(other_owner(&open.join("link")).unwrap(), None);
        for absent in ["absent", "absent/state"] {
            let refused = other_owner(&open.join(absent)).unwrap_err().to_string();
            assert!(refused.contains("as root, make it first"), "{refused}");
        }
        fs::hard_link(open.join("link"), open.join("planted")).unwrap();
        other_owner(&open.join("planted")).unwrap_err();
        // A circle ends.
        symlink("circle", folder.path().join("circle")).unwrap();
        other_owner(&folder.path().join("circle")).unwrap_err();
    }

    #[test]
    fn what_root_writes_is_handed_to_the_owner_and_nothing_else_is() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let owner = |name: &str| fs::metadata(path(name)).unwrap().uid();
        for name in ["file", "new", "swapped"] {
            fs::write(path(name), name).unwrap();
        }
        let file = |name: &str| File::open(path(name)).unwrap();
        let before = owner("new");
        keep_owner(&file("new"), &path("file")).unwrap();
        assert_eq!(owner("new"), before);
        if chown(path("file"), Some(12_345), None).is_err() {
            // Only root can give files away, and only root hands them over.
            return;
        }
        // In place of another user's file; again; and beside one, perhaps before a queue has written it.
        for _ in 0..2 {
            keep_owner(&file("new"), &path("file")).unwrap();
            assert_eq!(owner("new"), 12_345);
        }
        fs::write(path("previous"), "").unwrap();
        share_owner(&path("previous"), &path("file")).unwrap();
        assert_eq!(owner("previous"), 12_345);
        share_owner(&path("absent"), &path("file")).unwrap();
        chown(folder.path(), Some(12_346), None).unwrap();
        // What the folder's owner has put under the name meanwhile stays root's, here and where only the name is known.
        let written = file("new");
        fs::rename(path("swapped"), path("new")).unwrap();
        keep_owner(&written, &path("other")).unwrap();
        assert_eq!(written.metadata().unwrap().uid(), 12_346);
        share_owner(&path("new"), &path("file")).unwrap();
        assert_eq!(owner("new"), 0);
    }

    #[test]
    fn what_is_denied_for_another_reason_than_owner_and_mode_stays_as_the_system_says_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        let denied = || io::Error::from(io::ErrorKind::PermissionDenied);
        assert_eq!(explain(&path, denied()).to_string(), denied().to_string());
        fs::write(&path, "").unwrap();
        assert_eq!(explain(&path, denied()).to_string(), denied().to_string());
        let other = io::Error::from(io::ErrorKind::NotFound);
        assert_eq!(explain(&path, other).kind(), io::ErrorKind::NotFound);
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
