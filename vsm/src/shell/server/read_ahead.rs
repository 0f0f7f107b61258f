//! The store's records of the vehicles and stations that a reload adds. The thread that reads the configuration reads them
//! too, so that the bridge, which serves meanwhile, waits for no disk.
//!
//! A file belongs to an added vehicle or station if its name contains that id, or the id of its key. Nobody else writes it
//! before the bridge serves them, so the bridge would read the same content.

use std::cell::RefCell;
use std::collections::{BTreeMap, BTreeSet};

use mavlink_link::store::{Changes, Disk, Durability, MAX_RECORD_BYTES, Progress, StoreError};
use zeroize::Zeroizing;

use crate::key_exchange::IDENTITY;
use crate::session::AUDIT_KEY;
use crate::shell::disk::FileDisk;

/// The files, by their names.
#[derive(Debug, Default)]
pub(super) struct ReadAhead {
    /// The ids of what is added, as file names contain them, and names of files.
    ids: Vec<String>,
    files: BTreeMap<String, Zeroizing<Vec<u8>>>,
    /// Files written since then: they are read from the disk again.
    changed: RefCell<BTreeSet<String>>,
}

impl ReadAhead {
    /// Reads them. Blocks.
    ///
    /// # Errors
    /// The folder, or one of them, cannot be read.
    pub(super) fn of(store: &FileDisk, ids: Vec<String>) -> Result<ReadAhead, StoreError> {
        let mut ahead = ReadAhead {
            ids,
            ..ReadAhead::default()
        };
        for name in store.names()? {
            if ahead.covers(&name)
                // By one byte more, so that whoever reads it sees that it is too long.
                && let Some(bytes) = store.read(&name, MAX_RECORD_BYTES + 1)?
            {
                ahead.files.insert(name, bytes);
            }
        }
        Ok(ahead)
    }

    /// The content of the ids that are names of files; `None` for a missing file.
    pub(super) fn named(&self) -> impl Iterator<Item = (&str, Option<Zeroizing<Vec<u8>>>)> {
        let each = self.ids.iter();
        each.map(|name| (&**name, self.files.get(name).cloned()))
    }

    /// Whether the file was read ahead, or is known to be missing.
    fn covers(&self, name: &str) -> bool {
        let is_one = |part: &str| self.ids.iter().any(|id| id == part);
        [AUDIT_KEY, IDENTITY].contains(&name) || is_one(name) || name.split(['-', '.']).any(is_one)
    }
}

/// A disk whose files were partly read ahead.
pub(super) struct Ahead<'a> {
    disk: &'a mut dyn Disk,
    read: &'a ReadAhead,
}

impl<'a> Ahead<'a> {
    pub(super) fn new(disk: &'a mut dyn Disk, read: &'a ReadAhead) -> Ahead<'a> {
        Ahead { disk, read }
    }

    fn change(&mut self, name: &str) -> &mut dyn Disk {
        self.read.changed.borrow_mut().insert(name.to_owned());
        self.disk
    }
}

impl Disk for Ahead<'_> {
    fn read(&self, name: &str, max_bytes: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        if self.read.changed.borrow().contains(name) || !self.read.covers(name) {
            return self.disk.read(name, max_bytes);
        }
        let max = usize::try_from(max_bytes).unwrap_or(usize::MAX);
        let bytes = self.read.files.get(name);
        Ok(bytes.map(|bytes| Zeroizing::new(bytes.get(..max).unwrap_or(bytes).to_vec())))
    }

    fn replace(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        self.change(name).replace(name, bytes, durability)
    }

    fn append(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        self.change(name).append(name, bytes, durability)
    }

    fn compact(&mut self, name: &str, bytes: &[u8]) -> Result<(), StoreError> {
        self.change(name).compact(name, bytes)
    }

    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
        self.change(to);
        self.change(from).rename(from, to)
    }

    fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        self.change(name).remove(name)
    }

    fn queues(&self) -> bool {
        self.disk.queues()
    }

    fn queued(&self) -> u64 {
        self.disk.queued()
    }

    fn progress(&self, of: Changes) -> Progress {
        self.disk.progress(of)
    }

    fn failing(&self) -> Option<StoreError> {
        self.disk.failing()
    }
}
