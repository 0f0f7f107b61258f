//! The file system of a thread that may outlive the store for which it writes.
//!
//! The end of a bridge or an agent waits some seconds for what is still to be written, and not for a disk that hangs. When that thread
//! continues, the store may be somebody else's: to be erased (`erase`), or to be served from again. So a thread changes a file only
//! while its process has the store, and keeps the store's lock until the change is made: whoever opens the store next finds every
//! change made, and none follows. A synchronisation changes no file, so it is not waited for.

use std::fs::File;
use std::io;
use std::path::Path;
use std::sync::{Arc, Weak};

use mavlink_link::store::{Changes, Progress};
use zeroize::Zeroizing;

use super::disk::{Added, FileDisk, FileSystem};

/// A file system, as long as a store is held.
#[derive(Debug)]
pub(super) struct LentFiles {
    system: Arc<dyn FileSystem>,
    lock: Weak<File>,
}

impl LentFiles {
    /// That of this store.
    pub(super) fn of(store: &FileDisk) -> LentFiles {
        LentFiles {
            system: store.system(),
            lock: store.lock(),
        }
    }

    /// The store's lock, which is kept as long as the result is there.
    fn held(&self) -> io::Result<Arc<File>> {
        let given_up = || io::Error::other("this process no longer has the store");
        self.lock.upgrade().ok_or_else(given_up)
    }
}

impl FileSystem for LentFiles {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let _held = self.held()?;
        self.system.write(path, bytes)
    }

    fn add(&self, path: &Path, bytes: &[u8]) -> io::Result<Added> {
        let _held = self.held()?;
        self.system.add(path, bytes)
    }

    fn check_room(&self, folder: &Path, bytes: u64) -> io::Result<()> {
        self.system.check_room(folder, bytes)
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        drop(self.held()?);
        self.system.sync(path)
    }

    fn sync_open(&self, file: &File) -> io::Result<()> {
        drop(self.held()?);
        self.system.sync_open(file)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        let _held = self.held()?;
        self.system.rename(from, to)
    }

    fn rename_locked(&self, from: &Path, to: &Path) -> io::Result<Option<File>> {
        let _held = self.held()?;
        self.system.rename_locked(from, to)
    }

    fn write_over(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let _held = self.held()?;
        self.system.write_over(path, bytes)
    }

    fn overwrite(&self, path: &Path) -> io::Result<()> {
        let _held = self.held()?;
        self.system.overwrite(path)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        let _held = self.held()?;
        self.system.remove(path)
    }

    fn is_shared(&self) -> bool {
        self.system.is_shared()
    }

    fn queued(&self) -> u64 {
        self.system.queued()
    }

    fn progress(&self, of: Changes) -> Progress {
        self.system.progress(of)
    }

    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        self.system.read(path, most)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::{Receiver, Sender, channel};
    use std::sync::{Mutex, PoisonError};
    use std::thread;

    use super::*;
    use crate::shell::disk::{NativeFileSystem, OpenError};

    /// A disk that takes a write only once it is let.
    #[derive(Debug)]
    struct Slow {
        begun: Sender<()>,
        let_on: Mutex<Receiver<()>>,
    }

    impl FileSystem for Slow {
        fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
            let _ = self.begun.send(());
            let let_on = self.let_on.lock().unwrap_or_else(PoisonError::into_inner);
            let_on.recv().map_err(io::Error::other)?;
            NativeFileSystem.write(path, bytes)
        }

        fn sync(&self, path: &Path) -> io::Result<()> {
            NativeFileSystem.sync(path)
        }

        fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
            NativeFileSystem.rename(from, to)
        }

        fn remove(&self, path: &Path) -> io::Result<()> {
            NativeFileSystem.remove(path)
        }

        fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
            NativeFileSystem.read(path, most)
        }
    }

    #[test]
    fn a_store_that_is_given_up_has_every_change_made_and_none_follows() {
        let folder = tempfile::tempdir().unwrap();
        let dir = folder.path().join("state");
        let path = |name: &str| dir.join(name);
        let ((begun, begins), (lets, let_on)) = (channel(), channel());
        let let_on = Mutex::new(let_on);
        let store = FileDisk::open_on(&dir, Box::new(Slow { begun, let_on })).unwrap();
        let lent = LentFiles::of(&store);

        thread::scope(|scope| {
            let writes = scope.spawn(|| lent.write(&path("1"), b"1"));
            begins.recv().unwrap();
            drop(store);
            let other = FileDisk::open(&dir);
            let waits = matches!(&other, Err(OpenError::Locked { .. }));
            lets.send(()).unwrap();
            writes.join().unwrap().unwrap();
            assert!(waits, "{other:?}");
        });
        let next = FileDisk::open(&dir).unwrap();
        assert_eq!(std::fs::read(path("1")).unwrap(), b"1");
        for changed in [
            lent.write(&path("2"), b"2"),
            lent.add(&path("2"), b"2").map(drop),
            lent.rename(&path("1"), &path("2")),
            lent.rename_locked(&path("1"), &path("2")).map(drop),
            lent.write_over(&path("1"), b"2"),
            lent.overwrite(&path("1")),
            lent.remove(&path("1")),
            lent.sync(&path("1")),
        ] {
            let why = changed.unwrap_err().to_string();
            assert_eq!(why, "this process no longer has the store");
        }
        assert_eq!(next.names().unwrap().len(), 2, "that file, and the lock");
        assert_eq!(std::fs::read(path("1")).unwrap(), b"1");
    }
}
