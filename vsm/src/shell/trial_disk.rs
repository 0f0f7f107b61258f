//! A disk for a start that is only tried: it reads what is there, and what is written stays in memory.
//!
//! `vsm doctor` opens with it what `vsm run` opens ([`server::checks`](super::server::checks)), and leaves nothing behind.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use mavlink_link::store::{Disk, Durability, MAX_RECORD_BYTES, StoreError};
use zeroize::Zeroizing;

use super::disk::{FileSystem, NativeFileSystem};

/// Files as they would be: the disk, and above it what was written.
#[derive(Debug, Clone, Default)]
pub(super) struct TrialFiles(Arc<Mutex<Written>>);

/// What has changed, by its path.
type Written = BTreeMap<PathBuf, Change>;

#[derive(Debug, Clone)]
enum Change {
    /// It has this content.
    Content(Zeroizing<Vec<u8>>),
    /// It has the content of that file of the disk, which was renamed.
    Renamed(PathBuf),
    /// It is deleted.
    Gone,
}

impl TrialFiles {
    fn written(&self) -> MutexGuard<'_, Written> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl FileSystem for TrialFiles {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let content = Change::Content(Zeroizing::new(bytes.to_vec()));
        self.written().insert(path.to_owned(), content);
        Ok(())
    }

    fn sync(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }

    fn sync_open(&self, _: &File) -> io::Result<()> {
        Ok(())
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        // It is not read: a log may have any length.
        self.read(from, 0)?.ok_or(io::ErrorKind::NotFound)?;
        let mut written = self.written();
        let before = written.insert(from.to_owned(), Change::Gone);
        let moved = before.unwrap_or_else(|| Change::Renamed(from.to_owned()));
        written.insert(to.to_owned(), moved);
        Ok(())
    }

    fn rename_locked(&self, from: &Path, to: &Path) -> io::Result<Option<File>> {
        self.rename(from, to).map(|()| None)
    }

    fn overwrite(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.written().insert(path.to_owned(), Change::Gone);
        Ok(())
    }

    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        match self.written().get(path) {
            Some(Change::Content(bytes)) => {
                let most = usize::try_from(most).unwrap_or(usize::MAX);
                let first = bytes.get(..most).unwrap_or(bytes).to_vec();
                Ok(Some(Zeroizing::new(first)))
            }
            Some(Change::Renamed(of)) => NativeFileSystem.read(of, most),
            Some(Change::Gone) => Ok(None),
            None => NativeFileSystem.read(path, most),
        }
    }
}

/// The records of a store on such files. The folder need not be there.
#[derive(Debug)]
pub(super) struct TrialDisk {
    folder: PathBuf,
    files: TrialFiles,
}

impl TrialDisk {
    pub(super) fn new(folder: &Path, files: TrialFiles) -> TrialDisk {
        TrialDisk {
            folder: folder.to_owned(),
            files,
        }
    }
}

impl Disk for TrialDisk {
    fn read(&self, name: &str, max_bytes: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        let read = self.files.read(&self.folder.join(name), max_bytes);
        read.map_err(|cause| StoreError::new(name, cause))
    }

    fn replace(&mut self, name: &str, bytes: &[u8], _: Durability) -> Result<(), StoreError> {
        let written = self.files.write(&self.folder.join(name), bytes);
        written.map_err(|cause| StoreError::new(name, cause))
    }

    fn append(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        let before = self.read_whole(name, MAX_RECORD_BYTES)?;
        let mut all = before.unwrap_or_default();
        all.extend_from_slice(bytes);
        self.replace(name, &all, durability)
    }

    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
        let (old, new) = (self.folder.join(from), self.folder.join(to));
        match self.files.rename(&old, &new) {
            Err(cause) if cause.kind() != io::ErrorKind::NotFound => {
                Err(StoreError::new(from, cause))
            }
            _ => Ok(()),
        }
    }

    fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        let removed = self.files.remove(&self.folder.join(name));
        removed.map_err(|cause| StoreError::new(name, cause))
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn what_is_written_is_read_again_and_the_folder_stays_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("record"), "1").unwrap();
        fs::write(folder.path().join("log"), "a\n").unwrap();
        let mut disk = TrialDisk::new(folder.path(), TrialFiles::default());
        let text = |disk: &TrialDisk, name: &str| {
            let read = disk.read(name, 100).unwrap();
            read.map(|bytes| String::from_utf8(bytes.to_vec()).unwrap())
        };
        assert_eq!(text(&disk, "record").as_deref(), Some("1"));
        disk.replace("record", b"2", Durability::Power).unwrap();
        disk.append("log", b"b\n", Durability::Power).unwrap();
        disk.append("new", b"c\n", Durability::Process).unwrap();
        assert_eq!(text(&disk, "record").as_deref(), Some("2"));
        assert_eq!(text(&disk, "log").as_deref(), Some("a\nb\n"));
        disk.rename("log", "log.1").unwrap();
        disk.rename("none", "other").unwrap();
        disk.remove("record").unwrap();
        assert_eq!(text(&disk, "log"), None);
        assert_eq!(text(&disk, "log.1").as_deref(), Some("a\nb\n"));
        assert_eq!(text(&disk, "record"), None);
        assert_eq!(text(&disk, "other"), None);

        let mut names: Vec<_> = fs::read_dir(folder.path())
            .unwrap()
            .map(|one| one.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        assert_eq!(names, ["log", "record"]);
        assert_eq!(fs::read(folder.path().join("record")).unwrap(), b"1");
    }
}
