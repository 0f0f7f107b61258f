//! Files that a thread writes one step after the other, so that nobody waits for the disk: for the keys of a vehicle, or of a guard,
//! whose files depend on each other, and for the records of the key exchange.
//!
//! Each vehicle has a thread of its own, so that a disk which hangs under one vehicle's files holds up no other's. It is there only
//! while there is something to write: with a thousand vehicles a thousand threads would sleep until the next change of a key.
//!
//! It is a [`FileSystem`]: a user of it (a `KeyStore`, a `FileDisk`) takes the same steps in the same order as on the
//! system's own, and reads back what it has written. [`FileSystem::progress`] reports how far the thread is; a caller that
//! sends something which depends on a step waits for that step. A process that ends in between leaves the files as one
//! killed in the middle of the same steps.
//!
//! A step that fails is tried again until it succeeds. The steps after it wait, and nothing new is started: an accepted
//! change takes effect, a refused one never does.

use std::collections::{BTreeMap, VecDeque};
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use mavlink_link::store::{Changes, Progress, remedy};
use tokio::sync::Notify;
use zeroize::Zeroizing;

use super::disk::{FileDisk, FileSystem};
use super::key_store::KeyStore;
use super::lent_files::LentFiles;
use super::queued_disk::dirty_names;

/// The steps of one vehicle's files. Clones share them.
#[derive(Debug, Clone)]
pub struct OrderedFiles(Arc<Owner>);

#[derive(Debug)]
struct Owner {
    shared: Arc<Shared>,
    system: Arc<dyn FileSystem>,
    progress: Arc<Notify>,
}

#[derive(Debug, Default)]
struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// The steps to do; the first is in progress.
    steps: VecDeque<Step>,
    /// What the files will hold then; `None` for a deleted one.
    files: BTreeMap<PathBuf, Option<Bytes>>,
    /// Files that are locked for this process, by their names.
    locks: BTreeMap<PathBuf, File>,
    queued: u64,
    durable: u64,
    fault: Option<String>,
    /// The thread is there.
    writing: bool,
    /// Changes that are accepted together are being queued; see [`OrderedFiles::together`].
    together: bool,
    closed: bool,
}

type Bytes = Arc<Zeroizing<Vec<u8>>>;

#[derive(Debug, Clone)]
enum Step {
    Write(PathBuf, Bytes),
    Sync(PathBuf),
    Rename(PathBuf, PathBuf),
    RenameLocked(PathBuf, PathBuf),
    Remove(PathBuf),
}

impl OrderedFiles {
    /// `progress` is notified when all is written, or when that fails.
    #[must_use]
    pub fn new(system: Arc<dyn FileSystem>, progress: Arc<Notify>) -> OrderedFiles {
        OrderedFiles(Arc::new(Owner {
            shared: Arc::default(),
            system,
            progress,
        }))
    }

    /// Reads these files now; they are read from memory until [`OrderedFiles::release`].
    ///
    /// # Errors
    /// One is there and cannot be read.
    pub fn hold(&self, paths: impl IntoIterator<Item = PathBuf>) -> io::Result<()> {
        for path in paths {
            let bytes = self.0.system.read(&path, MAX_READ)?.map(Arc::new);
            // The result of a queued step is newer.
            self.state().files.entry(path).or_insert(bytes);
        }
        Ok(())
    }

    /// Discards what was read ahead.
    pub fn release(&self) {
        let mut state = self.state();
        if state.steps.is_empty() {
            state.files.clear();
        }
    }

    /// Queues changes that must not be accepted in part: a fault refuses all of them, before the first, or none. Without
    /// that a fault between two changes would leave the first one alone, and refuse its reversal too.
    ///
    /// # Errors
    /// The files cannot be written at present; `changes` was not called.
    pub fn together<T>(&self, changes: impl FnOnce() -> T) -> io::Result<T> {
        let mut state = self.state();
        // It stays until all of them are queued.
        self.0.start_writing(&mut state)?;
        if let Some(fault) = &state.fault {
            return Err(io::Error::other(fault.clone()));
        }
        state.together = true;
        drop(state);
        let result = changes();
        self.state().together = false;
        Ok(result)
    }

    /// Whether all that was written so far is durable.
    #[must_use]
    pub fn is_durable(&self) -> bool {
        let state = self.state();
        state.durable == state.queued
    }

    /// Waits until all is durable; false if it is not by then.
    pub fn wait(&self, until: Instant) -> bool {
        let mut state = self.state();
        while state.durable < state.queued {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return false;
            }
            let waited = self.0.shared.changed.wait_timeout(state, left);
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
        true
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.0.shared.lock()
    }

    /// Queues a step. `first`: it begins a change, which a fault refuses; the other steps complete one.
    fn push(
        &self,
        first: bool,
        step: impl FnOnce(&mut State) -> io::Result<Step>,
    ) -> io::Result<()> {
        let mut state = self.state();
        let started = self.0.start_writing(&mut state);
        if first && !state.together {
            started?;
            if let Some(fault) = &state.fault {
                return Err(io::Error::other(fault.clone()));
            }
        } else if let Err(cause) = started {
            // Of a change that was accepted: done with the next one.
            tracing::error!("the keys cannot be written: {cause}");
            state.fault = Some(cause.to_string());
            self.0.progress.notify_one();
        }
        let step = step(&mut state)?;
        state.steps.push_back(step);
        state.queued += 1;
        drop(state);
        self.0.shared.changed.notify_all();
        Ok(())
    }

    /// Notes a rename, and fails if there is nothing to rename.
    fn moved(&self, state: &mut State, from: &Path, to: &Path) -> io::Result<()> {
        let content = match state.files.get(from) {
            Some(known) => known.clone(),
            None => {
                let read = self.0.system.read(from, MAX_READ)?;
                read.map(Arc::new)
            }
        };
        let content = content.ok_or(io::ErrorKind::NotFound)?;
        state.files.insert(from.to_owned(), None);
        state.files.insert(to.to_owned(), Some(content));
        Ok(())
    }
}

impl FileSystem for OrderedFiles {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        self.push(true, |state| {
            let bytes = Arc::new(Zeroizing::new(bytes.to_vec()));
            state.files.insert(path.to_owned(), Some(bytes.clone()));
            Ok(Step::Write(path.to_owned(), bytes))
        })
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        // Not refused by a fault: it completes a change that was accepted.
        self.push(false, |_| Ok(Step::Sync(path.to_owned())))
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.push(false, |state| {
            self.moved(state, from, to)?;
            Ok(Step::Rename(from.to_owned(), to.to_owned()))
        })
    }

    fn rename_locked(&self, from: &Path, to: &Path) -> io::Result<Option<File>> {
        self.push(true, |state| {
            self.moved(state, from, to)?;
            Ok(Step::RenameLocked(from.to_owned(), to.to_owned()))
        })?;
        // The thread locks the file later; see [`FileSystem::rename_locked`].
        Ok(None)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.push(true, |state| {
            state.files.insert(path.to_owned(), None);
            Ok(Step::Remove(path.to_owned()))
        })
    }

    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        if let Some(known) = self.state().files.get(path) {
            let most = usize::try_from(most).unwrap_or(usize::MAX);
            let first = |bytes: &Bytes| bytes.get(..most).unwrap_or(bytes).to_vec();
            return Ok(known.as_ref().map(first).map(Zeroizing::new));
        }
        self.0.system.read(path, most)
    }

    fn queued(&self) -> u64 {
        self.state().queued
    }

    fn progress(&self, of: Changes) -> Progress {
        let state = self.state();
        if of.is_empty() || of.until <= state.durable {
            Progress::Durable
        } else if state.fault.is_some() {
            Progress::Failing
        } else {
            Progress::Waiting
        }
    }
}

/// The keys of a vehicle, or of a guard, and what the exchange keeps of it, written by one thread.
#[derive(Debug)]
pub struct OrderedKeys {
    /// The key files.
    pub keys: KeyStore,
    /// The steps of these, and of the records.
    pub files: OrderedFiles,
    /// The store, for records of the exchange. Dropped last: the thread ends before it would find that nobody has the store.
    pub records: FileDisk,
}

impl OrderedKeys {
    /// From here on nobody waits for these files.
    #[must_use]
    pub fn start(mut keys: KeyStore, store: &FileDisk, progress: Arc<Notify>) -> OrderedKeys {
        let files = OrderedFiles::new(Arc::new(LentFiles::of(store)), progress);
        keys.write_through(Box::new(files.clone()));
        OrderedKeys {
            keys,
            records: store.through(Arc::new(files.clone())),
            files,
        }
    }
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        // A panic of the thread ends the process; it leaves no half-made change in the state.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Owner {
    /// Starts the thread, if it is not there.
    fn start_writing(&self, state: &mut State) -> io::Result<()> {
        if state.writing {
            return Ok(());
        }
        let (shared, system) = (self.shared.clone(), self.system.clone());
        let progress = self.progress.clone();
        std::thread::Builder::new()
            .name("key-writer".to_owned())
            .spawn(move || write(&shared, &*system, &progress))?;
        state.writing = true;
        Ok(())
    }
}

impl Drop for Owner {
    fn drop(&mut self) {
        self.shared.lock().closed = true;
        self.shared.changed.notify_all();
    }
}

/// The thread. It ends once there was nothing to write for a while, but not within a change, or with the last of those who write.
fn write(shared: &Shared, system: &dyn FileSystem, progress: &Notify) {
    // Until a later step is done: its synchronisation may have to write it again.
    let mut written: Option<(PathBuf, Bytes)> = None;
    let mut again = false;
    loop {
        let mut state = shared.lock();
        let step = loop {
            if state.closed {
                return;
            }
            if let Some(step) = state.steps.front() {
                break step.clone();
            }
            let woken = shared.changed.wait_timeout(state, LINGERS);
            let (woken, waited) = woken.unwrap_or_else(PoisonError::into_inner);
            state = woken;
            let is_between = state.together || written.is_some();
            if waited.timed_out() && state.steps.is_empty() && !is_between {
                state.writing = false;
                return;
            }
        };
        drop(state);
        let done = match &step {
            Step::Write(path, bytes) => {
                written = Some((path.clone(), bytes.clone()));
                system.write(path, bytes).map(|()| None)
            }
            Step::Sync(path) => {
                // After a failed synchronisation the system may count its cached pages, of the file or of the folder's
                // names, as written. They are made dirty again.
                let anew = match &written {
                    _ if !again => Ok(()),
                    Some((of, bytes)) if of == path => system.write(path, bytes),
                    _ => dirty_names(system, path),
                };
                anew.and_then(|()| system.sync(path)).map(|()| None)
            }
            Step::Rename(from, to) => system.rename(from, to).map(|()| None),
            Step::RenameLocked(from, to) => system
                .rename_locked(from, to)
                .map(|file| file.map(|file| (to.clone(), file))),
            Step::Remove(path) => system.remove(path).map(|()| None),
        };
        let mut state = shared.lock();
        again = done.is_err();
        match done {
            Ok(lock) => {
                state.locks.extend(lock);
                state.steps.pop_front();
                written = written.filter(|_| matches!(step, Step::Write(..)));
                state.durable += 1;
                if state.fault.take().is_some() {
                    tracing::info!("the keys can be written again");
                }
                if state.steps.is_empty() {
                    state.files.clear();
                    progress.notify_one();
                }
            }
            Err(cause) => {
                if state.fault.replace(cause.to_string()).is_none() {
                    let remedy = remedy(&cause.to_string());
                    tracing::error!("the keys cannot be written ({step:?}): {cause}{remedy}");
                }
                progress.notify_one();
                let pause = Instant::now() + TRY_AGAIN;
                while !state.closed && Instant::now() < pause {
                    let left = pause.saturating_duration_since(Instant::now());
                    let woken = shared.changed.wait_timeout(state, left);
                    state = woken.unwrap_or_else(PoisonError::into_inner).0;
                }
            }
        }
        drop(state);
        shared.changed.notify_all();
    }
}

/// Larger than any file of keys.
const MAX_READ: u64 = 1 << 20;
/// How long the thread stays without work: the steps of a change are queued at once, one after the other.
const LINGERS: Duration = Duration::from_secs(1);
/// The pause after a failure.
const TRY_AGAIN: Duration = Duration::from_secs(1);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shell::disk::{NativeFileSystem, replace};

    fn wait(files: &OrderedFiles) -> bool {
        files.wait(Instant::now() + Duration::from_secs(20))
    }

    #[test]
    fn what_is_written_is_read_at_once_and_on_the_disk_in_its_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let files = OrderedFiles::new(Arc::new(NativeFileSystem), Arc::new(Notify::new()));
        for round in 0..20_u8 {
            replace(&files, &path("next"), &[round], true).unwrap();
            assert_eq!(**files.read(&path("next"), 9).unwrap().unwrap(), [round]);
            assert!(
                files
                    .rename_locked(&path("next"), &path("key"))
                    .unwrap()
                    .is_none()
            );
            assert!(files.read(&path("next"), 9).unwrap().is_none());
            assert_eq!(**files.read(&path("key"), 9).unwrap().unwrap(), [round]);
        }
        assert!(wait(&files));
        assert_eq!(std::fs::read(path("key")).unwrap(), [19]);
        assert!(!path("next").exists());
        // The last one is locked for this process.
        let other = File::open(path("key")).unwrap();
        assert!(!crate::shell::disk::lock(&other).unwrap());
        let missing = files.rename(&path("next"), &path("key")).unwrap_err();
        assert_eq!(missing.kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn no_key_is_written_once_the_store_is_given_up() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let store = FileDisk::open(&path("state")).unwrap();
        let lent = Arc::new(LentFiles::of(&store));
        let files = OrderedFiles::new(lent, Arc::new(Notify::new()));
        replace(&files, &path("key"), b"1", true).unwrap();
        assert!(wait(&files));
        drop(store);
        let after = files.queued();
        replace(&files, &path("next"), b"2", true).unwrap();
        let of = Changes {
            after,
            until: files.queued(),
        };
        let end = Instant::now() + Duration::from_secs(20);
        while files.progress(of) == Progress::Waiting && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(2));
        }
        assert_eq!(files.progress(of), Progress::Failing);
        let there = std::fs::read_dir(folder.path()).unwrap();
        let there = there.map(|one| one.unwrap().file_name().into_string().unwrap());
        let mut there: Vec<String> = there.collect();
        there.sort();
        assert_eq!(there, ["key", "state"]);
    }

    #[test]
    fn there_is_a_thread_only_while_there_is_something_to_write() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        let files = OrderedFiles::new(Arc::new(NativeFileSystem), Arc::new(Notify::new()));
        assert!(!files.state().writing);
        for round in 0..2_u8 {
            replace(&files, &path, &[round], true).unwrap();
            assert!(files.state().writing);
            assert!(wait(&files));
            assert_eq!(std::fs::read(&path).unwrap(), [round]);
            let end = Instant::now() + Duration::from_secs(20);
            while files.state().writing && Instant::now() < end {
                std::thread::sleep(Duration::from_millis(20));
            }
            assert!(!files.state().writing);
        }
    }

    /// A process that is stopped for a while between two steps: the next of them may need what the thread knows.
    #[test]
    fn the_thread_stays_within_a_change() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("key");
        let files = OrderedFiles::new(Arc::new(NativeFileSystem), Arc::new(Notify::new()));
        let pause = || std::thread::sleep(LINGERS + LINGERS / 2);
        let begun = files.together(|| {
            pause();
            assert!(files.state().writing);
            files.write(&path, b"1")
        });
        begun.unwrap().unwrap();
        pause();
        assert!(files.is_durable() && files.state().writing);
        files.sync(&path).unwrap();
        assert!(wait(&files));
        let end = Instant::now() + Duration::from_secs(20);
        while files.state().writing && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(20));
        }
        assert!(!files.state().writing);
    }

    #[test]
    fn what_was_taken_takes_effect_and_what_was_refused_never_does() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let files = OrderedFiles::new(Arc::new(NativeFileSystem), Arc::new(Notify::new()));
        std::fs::create_dir(path("key")).unwrap();
        replace(&files, &path("key"), b"1", true).unwrap();
        let all = Changes {
            after: 0,
            until: files.queued(),
        };
        let end = Instant::now() + Duration::from_secs(20);
        while files.progress(all) == Progress::Waiting && Instant::now() < end {
            std::thread::sleep(Duration::from_millis(2));
        }
        assert_eq!(files.progress(all), Progress::Failing);
        replace(&files, &path("key"), b"2", true).unwrap_err();
        replace(&files, &path("other"), b"2", true).unwrap_err();
        let part = files.together(|| replace(&files, &path("other"), b"2", true));
        part.unwrap_err();
        std::fs::remove_dir(path("key")).unwrap();
        assert!(wait(&files));
        assert_eq!(std::fs::read(path("key")).unwrap(), b"1");
        assert!(!path("other").exists());
        replace(&files, &path("key"), b"3", true).unwrap();
        assert!(wait(&files));
        assert_eq!(std::fs::read(path("key")).unwrap(), b"3");
    }

    #[test]
    fn a_fault_between_changes_that_belong_together_refuses_none_of_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let files = OrderedFiles::new(Arc::new(NativeFileSystem), Arc::new(Notify::new()));
        std::fs::create_dir(path("record")).unwrap();
        let both = files.together(|| {
            replace(&files, &path("record"), b"1", true).unwrap();
            let all = Changes {
                after: 0,
                until: files.queued(),
            };
            let end = Instant::now() + Duration::from_secs(20);
            while files.progress(all) == Progress::Waiting && Instant::now() < end {
                std::thread::sleep(Duration::from_millis(2));
            }
            assert_eq!(files.progress(all), Progress::Failing);
            replace(&files, &path("key"), b"2", true)
        });
        both.unwrap().unwrap();
        std::fs::remove_dir(path("record")).unwrap();
        assert!(wait(&files));
        assert_eq!(std::fs::read(path("record")).unwrap(), b"1");
        assert_eq!(std::fs::read(path("key")).unwrap(), b"2");
    }
}
