//! A disk that writes down the order of its operations, and can refuse those on some records.

use std::collections::BTreeMap;

use mavlink_link::store::{Disk, Durability, StoreError};
use zeroize::Zeroizing;

#[derive(Debug, Default)]
pub(super) struct RecordingDisk {
    pub(super) records: BTreeMap<String, Vec<u8>>,
    pub(super) operations: Vec<String>,
    /// Records whose names start so cannot be written.
    pub(super) full: Option<&'static str>,
}

impl RecordingDisk {
    fn note(&mut self, what: &str, name: &str, to: Durability) -> Result<(), StoreError> {
        let refused = self.full.is_some_and(|prefix| name.starts_with(prefix));
        let end = if refused { " FAILS" } else { "" };
        self.operations
            .push(format!("disk {what} {name} {to:?}{end}"));
        if !refused {
            return Ok(());
        }
        Err(StoreError {
            name: name.to_owned(),
            cause: "no space left".to_owned(),
        })
    }
}

impl Disk for RecordingDisk {
    fn read(&self, name: &str, _: u64) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
        Ok(self.records.get(name).cloned().map(Zeroizing::new))
    }

    fn replace(&mut self, name: &str, bytes: &[u8], to: Durability) -> Result<(), StoreError> {
        self.note("save", name, to)?;
        self.records.insert(name.to_owned(), bytes.to_vec());
        Ok(())
    }

    fn append(&mut self, name: &str, bytes: &[u8], to: Durability) -> Result<(), StoreError> {
        self.note("append", name, to)?;
        let record = self.records.entry(name.to_owned()).or_default();
        record.extend_from_slice(bytes);
        Ok(())
    }

    fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
        self.note("rename", from, Durability::Power)?;
        if let Some(bytes) = self.records.remove(from) {
            self.records.insert(to.to_owned(), bytes);
        }
        Ok(())
    }

    fn remove(&mut self, name: &str) -> Result<(), StoreError> {
        self.note("remove", name, Durability::Power)?;
        self.records.remove(name);
        Ok(())
    }
}
