//! A disk for a start that is only tried: it reads what is there, and what is written stays in memory.
//!
//! `vsm doctor` opens with it what `vsm run` opens ([`server::checks`](super::server::checks)), and leaves nothing behind.

use std::collections::BTreeMap;
use std::fs::File;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use mavlink_link::store::{Disk, Durability, StoreError};
use zeroize::Zeroizing;

use super::disk::{FileSystem, NativeFileSystem};

/// Files as they would be: the disk, and above it what was written.
#[derive(Debug, Clone, Default)]
pub(super) struct TrialFiles(Arc<Mutex<Written>>);

/// Contents by their paths; `None` for what was deleted.
type Written = BTreeMap<PathBuf, Option<Zeroizing<Vec<u8>>>>;

impl TrialFiles {
    fn written(&self) -> MutexGuard<'_, Written> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl FileSystem for TrialFiles {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        let bytes = Zeroizing::new(bytes.to_vec());
        self.written().insert(path.to_owned(), Some(bytes));
        Ok(())
    }

    fn sync(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }

    fn sync_open(&self, _: &File) -> io::Result<()> {
        Ok(())
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        let content = self.read(from, u64::MAX)?;
        let content = content.ok_or(io::ErrorKind::NotFound)?;
        let mut written = self.written();
        written.insert(from.to_owned(), None);
        written.insert(to.to_owned(), Some(content));
        Ok(())
    }

    fn rename_locked(&self, from: &Path, to: &Path) -> io::Result<Option<File>> {
        self.rename(from, to).map(|()| None)
    }

    fn overwrite(&self, _: &Path) -> io::Result<()> {
        Ok(())
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.written().insert(path.to_owned(), None);
        Ok(())
    }

    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        if let Some(content) = self.written().get(path) {
            let most = usize::try_from(most).unwrap_or(usize::MAX);
            let first = |bytes: &Zeroizing<Vec<u8>>| bytes.get(..most).unwrap_or(bytes).to_vec();
            return Ok(content.as_ref().map(first).map(Zeroizing::new));
        }
        NativeFileSystem.read(path, most)
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
        let mut all = self.read(name, u64::MAX)?.unwrap_or_default();
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
