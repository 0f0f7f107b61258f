//! Whatever step of writing a key or a clock fails, the old key and the old clock can still be used; and two processes
//! never share a key.

use std::io;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use mavlink_link::clock::Ceiling;
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::{Disk as _, Durability, Store as _};
use vsm::shell::disk::FileDisk;
use vsm::shell::disk::{FileSystem, NativeFileSystem};
use vsm::shell::key_file;
use vsm::shell::key_store::{KeyStore, KeyStoreError};
use zeroize::Zeroizing;

/// How a step fails.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    /// Half of the bytes are written, then the disk is full.
    Full,
    /// Nothing can be written.
    ReadOnly,
    /// The step itself fails.
    Io,
}

/// The real disk, of which the nth changing step fails, and all after it.
#[derive(Debug, Clone)]
struct Failing {
    steps: Arc<AtomicUsize>,
    from: usize,
    fault: Fault,
}

impl Failing {
    fn new(from: usize, fault: Fault) -> Self {
        let steps = Arc::default();
        Self { steps, from, fault }
    }

    fn fails(&self) -> bool {
        self.steps.fetch_add(1, Ordering::Relaxed) >= self.from
    }

    fn error(&self) -> io::Error {
        match self.fault {
            Fault::Full => io::ErrorKind::StorageFull.into(),
            Fault::ReadOnly => io::ErrorKind::ReadOnlyFilesystem.into(),
            Fault::Io => io::Error::other("the disk has failed"),
        }
    }
}

impl FileSystem for Failing {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        if !self.fails() {
            return NativeFileSystem.write(path, bytes);
        }
        if self.fault == Fault::Full {
            NativeFileSystem.write(path, &bytes[..bytes.len() / 2])?;
        }
        Err(self.error())
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        if self.fails() {
            Err(self.error())
        } else {
            NativeFileSystem.sync(path)
        }
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        if self.fails() {
            Err(self.error())
        } else {
            NativeFileSystem.rename(from, to)
        }
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        if self.fails() {
            Err(self.error())
        } else {
            NativeFileSystem.remove(path)
        }
    }

    fn read(&self, path: &Path, max: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        NativeFileSystem.read(path, max)
    }
}

const FAULTS: [Fault; 3] = [Fault::Full, Fault::ReadOnly, Fault::Io];

fn key(byte: u8) -> SigningKey {
    SigningKey::new([byte; 32]).unwrap()
}

fn holds(found: Option<SigningKey>, byte: u8) -> bool {
    found.is_some_and(|found| found.same_as(&key(byte)))
}

/// A folder with a key in force and one being handed over.
fn prepared() -> (tempfile::TempDir, std::path::PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("uav1.key");
    let keys = KeyStore::open(&path).unwrap();
    keys.stage(&key(1)).unwrap();
    keys.commit().unwrap();
    keys.stage(&key(2)).unwrap();
    (folder, path)
}

#[test]
fn a_commit_that_fails_at_any_step_loses_no_key_and_can_be_done_again() {
    for fault in FAULTS {
        for step in 0..14 {
            let (_folder, path) = prepared();
            let keys = KeyStore::open_on(&path, Box::new(Failing::new(step, fault))).unwrap();
            let done = keys.commit();
            drop(keys);
            // The next process finds both keys, whatever happened, and ends the same way.
            let keys = KeyStore::open(&path).unwrap();
            let current = keys.current().unwrap();
            if done.is_ok() || keys.next().unwrap().is_none() {
                assert!(holds(current, 2), "{fault:?} at step {step}");
                assert!(holds(keys.previous().unwrap(), 1));
            } else {
                assert!(holds(current, 1), "{fault:?} at step {step}");
                assert!(holds(keys.next().unwrap(), 2));
            }
            keys.commit().unwrap();
            assert!(holds(keys.current().unwrap(), 2));
            assert!(holds(keys.previous().unwrap(), 1));
        }
    }
}

#[test]
fn a_key_that_cannot_be_staged_leaves_the_old_one_in_force() {
    for fault in FAULTS {
        for step in 0..3 {
            let folder = tempfile::tempdir().unwrap();
            let path = folder.path().join("uav1.key");
            let keys = KeyStore::open(&path).unwrap();
            keys.stage(&key(1)).unwrap();
            keys.commit().unwrap();
            drop(keys);
            let keys = KeyStore::open_on(&path, Box::new(Failing::new(step, fault))).unwrap();
            let refused = keys.stage(&key(2)).unwrap_err();
            assert!(matches!(refused, KeyStoreError::Change { .. }), "{refused}");
            assert!(!refused.to_string().contains("0202"));
            assert!(holds(keys.current().unwrap(), 1));
            assert!(
                keys.next().unwrap().is_none(),
                "nothing that is half a key is taken for one"
            );
        }
    }
}

#[test]
fn a_clock_that_cannot_be_stored_stays_at_its_old_value() {
    for fault in FAULTS {
        for step in 0..4 {
            let folder = tempfile::tempdir().unwrap();
            let dir = folder.path().join("state");
            FileDisk::open(&dir)
                .unwrap()
                .replace("clock-1", b"100\n", Durability::Power)
                .unwrap();
            let mut store = FileDisk::open_on(&dir, Box::new(Failing::new(step, fault))).unwrap();
            store
                .replace("clock-1", b"200\n", Durability::Power)
                .unwrap_err();
            let found = store.read("clock-1", 64).unwrap().unwrap();
            // Only where the rename was done and the folder not synchronised the new one stands: it is the higher.
            let expected: &[u8] = if step == 3 { b"200\n" } else { b"100\n" };
            assert_eq!(*found, expected, "{fault:?} at step {step}");
        }
    }
}

#[test]
fn pitfall_28_two_processes_do_not_share_a_key() {
    let (_folder, path) = prepared();
    let first = KeyStore::open(&path).unwrap();
    let refused = KeyStore::open(&path).unwrap_err();
    assert!(matches!(refused, KeyStoreError::Locked { .. }), "{refused}");
    drop(first);
    KeyStore::open(&path).unwrap();
}

#[test]
fn a_key_that_the_vehicle_may_have_is_not_replaced() {
    let (_folder, path) = prepared();
    let keys = KeyStore::open(&path).unwrap();
    let refused = keys.stage(&key(3)).unwrap_err();
    assert!(
        matches!(refused, KeyStoreError::Unfinished { .. }),
        "{refused}"
    );
    keys.stage(&key(2)).unwrap();
    assert!(holds(keys.next().unwrap(), 2));
}

#[test]
fn keys_are_for_their_owner_alone() {
    use std::os::unix::fs::PermissionsExt as _;
    let (_folder, path) = prepared();
    let keys = KeyStore::open(&path).unwrap();
    for file in ["uav1.key", "uav1.key.next", "uav1.key.lock"] {
        let mode = path
            .with_file_name(file)
            .metadata()
            .unwrap()
            .permissions()
            .mode();
        assert_eq!(mode & 0o777, 0o600, "{file}");
    }
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o644)).unwrap();
    assert!(keys.current().unwrap_err().to_string().contains("0600"));
}

#[test]
fn pitfall_18_a_pass_phrase_is_refused_with_the_reason() {
    use std::os::unix::fs::OpenOptionsExt as _;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("phrase.key");
    let mut file = std::fs::OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(true)
        .mode(0o600)
        .open(&path)
        .unwrap();
    io::Write::write_all(&mut file, b"correct horse battery staple\n").unwrap();
    let refused = key_file::read(&path).unwrap_err().to_string();
    assert!(
        refused.contains("pass phrase") && refused.contains("dictionary"),
        "{refused}"
    );
    assert!(!refused.contains("horse"));
}

#[test]
fn a_leftover_of_a_write_neither_opens_a_key_to_others_nor_leads_it_elsewhere() {
    use std::os::unix::fs::PermissionsExt as _;
    let (folder, path) = prepared();
    let keys = KeyStore::open(&path).unwrap();
    keys.commit().unwrap();
    let beside = path.with_file_name("uav1.key.next.new");
    std::fs::write(&beside, b"").unwrap();
    std::fs::set_permissions(&beside, std::fs::Permissions::from_mode(0o644)).unwrap();
    keys.stage(&key(3)).unwrap();
    let next = path.with_file_name("uav1.key.next");
    assert_eq!(next.metadata().unwrap().permissions().mode() & 0o777, 0o600);

    let elsewhere = folder.path().join("elsewhere");
    std::fs::write(&elsewhere, b"as it was").unwrap();
    std::os::unix::fs::symlink(&elsewhere, &beside).unwrap();
    keys.restage(&key(4)).unwrap();
    assert_eq!(std::fs::read(&elsewhere).unwrap(), b"as it was");
    assert!(holds(keys.next().unwrap(), 4) && !next.is_symlink());
}

#[test]
fn a_key_by_another_name_is_the_same_key() {
    let (folder, path) = prepared();
    let (soft, hard) = (
        folder.path().join("soft.key"),
        folder.path().join("hard.key"),
    );
    std::os::unix::fs::symlink(&path, &soft).unwrap();
    std::fs::hard_link(&path, &hard).unwrap();
    let first = KeyStore::open(&path).unwrap();
    for other in [&soft, &hard] {
        let refused = KeyStore::open(other).unwrap_err();
        assert!(matches!(refused, KeyStoreError::Locked { .. }), "{refused}");
    }
    // A change brings another file under the name: it is locked too, and lies where the name leads.
    first.commit().unwrap();
    let later = folder.path().join("later.key");
    std::fs::hard_link(&path, &later).unwrap();
    assert!(matches!(
        KeyStore::open(&later),
        Err(KeyStoreError::Locked { .. })
    ));
    drop(first);
    let by_link = KeyStore::open(&soft).unwrap();
    assert!(holds(by_link.current().unwrap(), 2));
    by_link.stage(&key(3)).unwrap();
    by_link.commit().unwrap();
    assert!(soft.is_symlink(), "the link is still one");
    drop(by_link);
    assert!(holds(KeyStore::open(&path).unwrap().current().unwrap(), 3));
}

#[test]
fn a_revoked_key_is_deleted_by_whichever_process_finds_the_new_one_in_use() {
    for fault in FAULTS {
        for step in 0..24 {
            let (_folder, path) = prepared();
            KeyStore::open(&path).unwrap().revoke_current().unwrap();
            let keys = KeyStore::open_on(&path, Box::new(Failing::new(step, fault))).unwrap();
            let _ = keys.commit();
            drop(keys);
            let keys = KeyStore::open(&path).unwrap();
            keys.commit().unwrap();
            assert!(
                holds(keys.current().unwrap(), 2),
                "{fault:?} at step {step}"
            );
            assert!(
                keys.previous().unwrap().is_none(),
                "{fault:?} at step {step}"
            );
            // The wish was about that key alone.
            keys.stage(&key(3)).unwrap();
            keys.commit().unwrap();
            assert!(holds(keys.previous().unwrap(), 2));
        }
    }
}

#[test]
fn a_revocation_that_the_vehicle_did_not_take_is_over() {
    let (_folder, path) = prepared();
    let keys = KeyStore::open(&path).unwrap();
    keys.revoke_current().unwrap();
    keys.drop_next().unwrap();
    keys.stage(&key(3)).unwrap();
    keys.commit().unwrap();
    assert!(holds(keys.previous().unwrap(), 1));
}

#[test]
fn a_new_key_file_is_whole_and_takes_the_place_of_none() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("uav1.key");
    // What a power cut left of an earlier try.
    std::fs::write(folder.path().join("uav1.key.new"), b"").unwrap();
    key_file::generate(&path).unwrap();
    let made = key_file::read(&path).unwrap();
    assert_eq!(path.metadata().unwrap().permissions().mode() & 0o777, 0o600);
    key_file::generate(&path).unwrap_err();
    assert!(key_file::read(&path).unwrap().same_as(&made));
    assert!(!folder.path().join("uav1.key.new").exists());
}

/// What is done to the keys, and which of 1 (in force), 2 (next) and 9 (the one before) is dead then.
type Change = (fn(&KeyStore) -> Result<(), KeyStoreError>, &'static [u8]);

const CHANGES: [Change; 4] = [
    (KeyStore::commit, &[9]),
    (KeyStore::drop_next, &[2]),
    (|keys| keys.restage(&key(3)), &[2]),
    (KeyStore::drop_previous, &[9]),
];

#[test]
fn the_clock_of_a_dead_key_is_deleted_whatever_step_is_the_last_before_a_restart() {
    for (nth, (change, dead)) in CHANGES.into_iter().enumerate() {
        for step in 0..24 {
            let folder = tempfile::tempdir().unwrap();
            let (path, dir) = (folder.path().join("uav1.key"), folder.path().join("state"));
            let keys = KeyStore::open(&path).unwrap();
            for byte in [9, 1] {
                keys.stage(&key(byte)).unwrap();
                keys.commit().unwrap();
            }
            keys.stage(&key(2)).unwrap();
            let mut store = FileDisk::open(&dir).unwrap();
            for byte in [1, 2, 9] {
                let clock = Ceiling(Stamp::new(byte.into()));
                store.save(&key(byte).id(), &clock).unwrap();
            }
            // What the preparation may have left to be looked at.
            keys.bury(&mut store).unwrap();
            drop((keys, store));
            let at = format!("change {nth}, step {step}");
            let failing = Failing::new(step, Fault::Io);
            let keys = KeyStore::open_on(&path, Box::new(failing.clone())).unwrap();
            let mut store = FileDisk::open_on(&dir, Box::new(failing)).unwrap();
            let done = change(&keys).is_ok() && keys.bury(&mut store).is_ok();
            drop((keys, store));
            let has = |store: &FileDisk, byte: u8| {
                store.load::<Ceiling>(&key(byte).id()).unwrap().is_some()
            };
            // The next process.
            let keys = KeyStore::open(&path).unwrap();
            let mut store = FileDisk::open(&dir).unwrap();
            let held = [keys.current(), keys.next(), keys.previous()];
            let held: Vec<SigningKey> = held.into_iter().filter_map(Result::unwrap).collect();
            for byte in [1, 2, 9] {
                let alive = held.iter().any(|one| one.same_as(&key(byte)));
                assert!(
                    !alive || has(&store, byte),
                    "{at}: the clock of a live key is gone"
                );
                assert!(
                    alive || !done || !has(&store, byte),
                    "{at}: a dead key has a clock"
                );
            }
            keys.bury(&mut store).unwrap();
            if !done {
                change(&keys).unwrap();
                keys.bury(&mut store).unwrap();
            }
            for byte in [1, 2, 9] {
                assert_eq!(has(&store, byte), !dead.contains(&byte), "{at}: key {byte}");
            }
            assert!(!path.with_file_name("uav1.key.dead").exists());
        }
    }
}

#[test]
fn twenty_rotations_leave_the_clocks_of_the_keys_that_are_there() {
    let folder = tempfile::tempdir().unwrap();
    let keys = KeyStore::open(&folder.path().join("uav1.key")).unwrap();
    let mut store = FileDisk::open(&folder.path().join("state")).unwrap();
    for byte in 1..=20 {
        keys.stage(&key(byte)).unwrap();
        let clock = Ceiling(Stamp::new(byte.into()));
        store.save(&key(byte).id(), &clock).unwrap();
        keys.commit().unwrap();
        keys.bury(&mut store).unwrap();
    }
    let files = std::fs::read_dir(folder.path().join("state")).unwrap();
    let clocks = files.filter(|file| {
        let name = file.as_ref().unwrap().file_name();
        name.to_str().unwrap().starts_with("clock-")
    });
    assert_eq!(clocks.count(), 2);
}
