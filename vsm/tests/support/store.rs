//! A store in memory that outlives the bridge, and can be full.

use std::collections::BTreeMap;

use vsm::session::{Durability, Store, StoreError};

/// The records, and whether more can be written.
#[derive(Debug, Default, Clone)]
pub struct MemoryStore {
    pub records: BTreeMap<String, Vec<u8>>,
    /// Records whose names start so cannot be written: a full disk. An empty text is every record.
    pub full: Option<&'static str>,
    /// How many writes were refused.
    pub refused: u64,
    /// How many had to outlive a power cut.
    pub synced: u64,
}

impl MemoryStore {
    fn admit(&mut self, name: &str, durability: Durability) -> Result<(), StoreError> {
        if self.full.is_some_and(|prefix| name.starts_with(prefix)) {
            self.refused += 1;
            return Err(StoreError {
                name: name.to_owned(),
                cause: "No space left on device".to_owned(),
            });
        }
        self.synced += u64::from(durability == Durability::Power);
        Ok(())
    }
}

impl Store for MemoryStore {
    fn save(&mut self, name: &str, bytes: &[u8], durability: Durability) -> Result<(), StoreError> {
        self.admit(name, durability)?;
        self.records.insert(name.to_owned(), bytes.to_vec());
        Ok(())
    }

    fn append(
        &mut self,
        name: &str,
        bytes: &[u8],
        durability: Durability,
    ) -> Result<(), StoreError> {
        let mut whole = self.records.remove(name).unwrap_or_default();
        let before = whole.len();
        whole.extend_from_slice(bytes);
        let written = self.admit(name, durability);
        if written.is_err() {
            whole.truncate(before);
        }
        if before > 0 || written.is_ok() {
            self.records.insert(name.to_owned(), whole);
        }
        written
    }

    fn load(&self, name: &str) -> Result<Option<Vec<u8>>, StoreError> {
        Ok(self.records.get(name).cloned())
    }
}
