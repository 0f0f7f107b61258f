//! The key files of the DLI guard: made, rotated and revoked on the VSM's computer, and copied to the CUCS's by its
//! operator, or agreed on with its guard ([`guard_agreed`](super::guard_agreed)).
//!
//! A rotated file has `FILE.previous` beside it, which is accepted until `OVERLAP` after the rotation: the copy may take
//! its time while the station flies. That time is counted by the wall clock, since it passes while no process runs. Where that clock
//! is wrong the bridge decides (`session/bridge/guards`): it is given the key also where its time has passed.

use std::ffi::OsString;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use mavlink_link::Now;
use mavlink_link::signing::SigningKey;
use rustix::fs::FlockOperation;

use super::clock::NOT_BEFORE;
use super::disk::{self, FileSystem, NativeFileSystem};
use super::key_file::{self, KeyFileError};
use super::ownership;
use crate::config::open_file;
use crate::session::GuardKeyUntil;

/// The current key, and the previous one with the time (monotonic) until which it is accepted, which may have passed.
///
/// # Errors
/// A file is missing, readable by others, or holds something else, or could never be replaced.
pub fn read(path: &Path, now: Now) -> Result<Vec<GuardKeyUntil>, KeyFileError> {
    let mut keys = vec![(key_file::read(path)?, None)];
    let before = previous(path);
    for file in [path, &*before, &*pairing(path)] {
        disk::check_name(file)?;
    }
    if let Ok(about) = fs::metadata(&before) {
        let rotated = about.modified().unwrap_or(UNIX_EPOCH);
        let left = time_left(&before, rotated, SystemTime::now());
        let key = key_file::read(&before)?;
        let same = keys.iter().any(|(known, _)| known.same_as(&key));
        if !same {
            keys.push((key, Some(now.mono + left)));
        }
    }
    Ok(keys)
}

/// How much of its time the previous key has left, by the wall clock.
fn time_left(before: &Path, rotated: SystemTime, today: SystemTime) -> Duration {
    let earliest = UNIX_EPOCH + NOT_BEFORE;
    // A clock that was not set yet: by its time the file must not be dated, or the right time ends the key at the next start.
    if today < earliest {
        return OVERLAP;
    }
    match today.duration_since(rotated) {
        Ok(age) if rotated >= earliest => OVERLAP.saturating_sub(age),
        // One of the two times is of a wrong clock. The day counts from now, and must not start again with each start.
        _ if open_file(before).is_ok_and(|it| it.set_modified(today).is_ok()) => OVERLAP,
        _ => Duration::ZERO,
    }
}

/// Replaces the key by a new one, and keeps the old one beside it.
///
/// # Errors
/// There is no key yet, or the system's; if interrupted, the old key stays in use.
pub fn rotate(path: &Path) -> Result<SigningKey, KeyFileError> {
    let _held = hold(path).map_err(|cause| io_fault(path, cause))?;
    let new = other_than(&key_file::read_to_replace(path)?, path)?;
    put_in_force(&NativeFileSystem, path, &new)?;
    Ok(new)
}

/// Makes this key the current one, and keeps the previous one beside it, if any.
///
/// # Errors
/// The system's; if interrupted, the old key stays in use.
pub(super) fn put_in_force(
    system: &dyn FileSystem,
    path: &Path,
    new: &SigningKey,
) -> Result<(), KeyFileError> {
    match key_file::read_to_replace(path) {
        // Written before, and perhaps not durable yet: a repeated step must not take the new key for the old one.
        Ok(old) if old.same_as(new) => {
            let synced = system.sync(disk::folder_of(path));
            return synced.map_err(|cause| io_fault(path, cause));
        }
        // The old key first: an interruption here leaves it in both files, and nobody is locked out.
        Ok(old) => {
            write(system, &previous(path), &old)?;
            // Who may read the key must be able to read this one too.
            ownership::share_owner(&previous(path), path).map_err(|cause| io_fault(path, cause))?;
        }
        Err(KeyFileError::Absent { .. }) => {}
        Err(fault) => return Err(fault),
    }
    write(system, path, new)
}

/// Replaces the key by a new one, and deletes all earlier keys and the pairing. Someone with only those is locked out.
///
/// # Errors
/// As [`rotate`].
pub fn revoke(path: &Path) -> Result<SigningKey, KeyFileError> {
    let _held = hold(path).map_err(|cause| io_fault(path, cause))?;
    let new = other_than(&key_file::read_to_replace(path)?, path)?;
    // The pairing first: a guard that is still paired could agree on the next key.
    remove(&pairing(path))?;
    write(&NativeFileSystem, path, &new)?;
    remove(&previous(path))?;
    Ok(new)
}

fn remove(path: &Path) -> Result<(), KeyFileError> {
    let removed = NativeFileSystem
        .remove(path)
        .and_then(|()| NativeFileSystem.sync(disk::folder_of(path)));
    removed.map_err(|cause| io_fault(path, cause))
}

/// Keeps others from changing the files of a key, as long as the result lives.
pub(super) fn hold(path: &Path) -> io::Result<fs::File> {
    let mut name = path.as_os_str().to_owned();
    name.push(".lock");
    let mut how = fs::OpenOptions::new();
    how.write(true).create(true).truncate(false);
    std::os::unix::fs::OpenOptionsExt::mode(&mut how, 0o600);
    let lock = ownership::open_no_link(&mut how, Path::new(&name))?;
    rustix::fs::flock(&lock, FlockOperation::LockExclusive)?;
    Ok(lock)
}

/// A new key with another key id in its trailers.
fn other_than(old: &SigningKey, path: &Path) -> Result<SigningKey, KeyFileError> {
    loop {
        let new = key_file::random().map_err(|cause| io_fault(path, cause))?;
        // Trailers carry two bytes of the id. With equal ones a receiver could not tell the keys apart.
        if new.id().bytes()[..2] != old.id().bytes()[..2] {
            return Ok(new);
        }
    }
}

fn write(system: &dyn FileSystem, path: &Path, key: &SigningKey) -> Result<(), KeyFileError> {
    let hex = key_file::hex(key);
    disk::replace(system, path, hex.as_bytes(), true).map_err(|cause| io_fault(path, cause))
}

fn io_fault(path: &Path, cause: io::Error) -> KeyFileError {
    let path = path.to_owned();
    KeyFileError::Io { path, cause }
}

fn previous(path: &Path) -> PathBuf {
    with(path, ".previous")
}

/// The file that names the guard with which the key is agreed.
pub(super) fn pairing(path: &Path) -> PathBuf {
    with(path, ".pairing")
}

fn with(path: &Path, part: &str) -> PathBuf {
    let mut name = OsString::from(path);
    name.push(part);
    name.into()
}

/// How long a key is accepted after it was rotated.
const OVERLAP: Duration = Duration::from_secs(86_400);

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    fn ids(path: &Path) -> Vec<String> {
        let now = Now {
            mono: Duration::from_secs(5),
            wall: Duration::ZERO,
        };
        let keys = read(path, now).unwrap();
        let accepted = |until: &Option<Duration>| until.is_none_or(|until| until > now.mono);
        let accepted = keys.iter().filter(|(_, until)| accepted(until));
        accepted.map(|(key, _)| key.id().to_string()).collect()
    }

    /// A disk that fails at the last moment, when the file bears its name already.
    #[derive(Debug)]
    struct NotSynced(std::sync::atomic::AtomicBool);

    impl FileSystem for NotSynced {
        fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
            NativeFileSystem.write(path, bytes)
        }

        fn sync(&self, path: &Path) -> io::Result<()> {
            let fails = self.0.load(std::sync::atomic::Ordering::SeqCst);
            match fails && path.is_dir() {
                true => Err(io::Error::other("not synced")),
                false => NativeFileSystem.sync(path),
            }
        }

        fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
            NativeFileSystem.rename(from, to)
        }

        fn remove(&self, path: &Path) -> io::Result<()> {
            NativeFileSystem.remove(path)
        }

        fn read(&self, path: &Path, most: u64) -> io::Result<Option<zeroize::Zeroizing<Vec<u8>>>> {
            NativeFileSystem.read(path, most)
        }
    }

    #[test]
    fn a_key_that_is_put_in_force_again_leaves_the_one_before_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cucs.key");
        key_file::generate(&path).unwrap();
        let first = ids(&path);
        let new = SigningKey::new([7; 32]).unwrap();
        // The one before is on the disk; the new one has its name, and nobody knows whether it stays.
        write(
            &NativeFileSystem,
            &previous(&path),
            &key_file::read(&path).unwrap(),
        )
        .unwrap();
        let system = NotSynced(true.into());
        assert!(write(&system, &path, &new).is_err());
        assert!(
            put_in_force(&system, &path, &new).is_err(),
            "still not synced"
        );
        system.0.store(false, std::sync::atomic::Ordering::SeqCst);
        put_in_force(&system, &path, &new).unwrap();
        assert_eq!(ids(&path), [new.id().to_string(), first[0].clone()]);
    }

    /// A computer without a battery-backed clock begins in 1970, and is set right later.
    #[test]
    fn a_clock_that_is_not_set_neither_ends_the_day_of_a_key_nor_dates_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cucs.key.previous");
        let file = fs::File::create(&path).unwrap();
        let hour = Duration::from_secs(3_600);
        let (unset, rotated) = (UNIX_EPOCH + hour, UNIX_EPOCH + NOT_BEFORE + 1_000 * OVERLAP);
        file.set_modified(rotated).unwrap();
        assert_eq!(time_left(&path, rotated, unset), OVERLAP);
        let dated = file.metadata().unwrap().modified().unwrap();
        assert_eq!(dated, rotated);
        assert_eq!(time_left(&path, dated, rotated + hour), OVERLAP - hour);
        // It was not set when the key was rotated: the day counts from when it is.
        file.set_modified(unset).unwrap();
        assert_eq!(time_left(&path, unset, rotated), OVERLAP);
        let dated = file.metadata().unwrap().modified().unwrap();
        assert_eq!(dated, rotated);
        assert_eq!(
            time_left(&path, dated, rotated + 2 * OVERLAP),
            Duration::ZERO
        );
    }

    #[test]
    fn a_rotated_key_is_accepted_for_a_day_and_a_revoked_one_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cucs.key");
        assert!(matches!(rotate(&path), Err(KeyFileError::Absent { .. })));
        key_file::generate(&path).unwrap();
        let first = ids(&path);
        let second = rotate(&path).unwrap().id().to_string();
        assert_eq!(ids(&path), [second.clone(), first[0].clone()]);
        for file in [path.clone(), previous(&path)] {
            let mode = fs::metadata(file).unwrap().permissions().mode() & 0o777;
            assert_eq!(mode, 0o600);
        }
        // A day later; and one that was cut off after its first step.
        let at = SystemTime::now() - OVERLAP - Duration::from_secs(1);
        let before = fs::File::options().write(true).open(previous(&path));
        before.unwrap().set_modified(at).unwrap();
        assert_eq!(ids(&path), [&*second]);
        fs::copy(&path, previous(&path)).unwrap();
        assert_eq!(ids(&path), [&*second]);
        // The clock was set back since: a day from now, and not from each start.
        rotate(&path).unwrap();
        let ahead = SystemTime::now() + 30 * OVERLAP;
        let before = fs::File::open(previous(&path)).unwrap();
        before.set_modified(ahead).unwrap();
        assert_eq!(ids(&path).len(), 2);
        let since = before.metadata().unwrap().modified().unwrap();
        assert!(since < SystemTime::now() + Duration::from_secs(1));
        rotate(&path).unwrap();
        let third = revoke(&path).unwrap().id().to_string();
        assert_eq!(ids(&path), [third]);
        fs::write(previous(&path), "words").unwrap();
        let now = Now {
            mono: Duration::ZERO,
            wall: Duration::ZERO,
        };
        fs::set_permissions(previous(&path), fs::Permissions::from_mode(0o644)).unwrap();
        assert!(matches!(
            read(&path, now),
            Err(KeyFileError::Permissions { .. })
        ));
    }
}
