//! The agent's disk: the ceilings of its clocks in its store folder, its keys beside their file.

use mavlink_link::clock::{CeilingStore, StoreError};
use mavlink_link::signing::{KeyId, SigningKey, Stamp};

use super::file_store::FileStore;
use super::key_store::{KeyStore, KeyStoreError};
use crate::airside::{Held, Keys};
use crate::session::Ceilings;

/// Both, locked for this process.
#[derive(Debug)]
pub struct AirsideDisk {
    pub(super) store: FileStore,
    pub(super) keys: KeyStore,
}

impl AirsideDisk {
    /// The keys as they lie there.
    ///
    /// # Errors
    /// One is there and cannot be used.
    pub fn held(&self) -> Result<Held, KeyStoreError> {
        Ok(Held {
            current: self.keys.current()?,
            next: self.keys.next()?,
            previous: self.keys.previous()?,
        })
    }
}

impl CeilingStore for AirsideDisk {
    fn load(&mut self, key: &KeyId) -> Result<Option<Stamp>, StoreError> {
        Ceilings(&mut self.store).load(key)
    }

    fn store(&mut self, key: &KeyId, ceiling: Stamp) -> Result<(), StoreError> {
        Ceilings(&mut self.store).store(key, ceiling)
    }
}

impl Keys for AirsideDisk {
    fn stage(&mut self, key: &SigningKey) -> Result<(), StoreError> {
        self.keys.stage(key).map_err(fault)
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        self.keys.commit().map_err(fault)
    }

    fn drop_next(&mut self) -> Result<(), StoreError> {
        self.keys.drop_next().map_err(fault)
    }

    fn drop_previous(&mut self) -> Result<(), StoreError> {
        self.keys.drop_previous().map_err(fault)
    }
}

fn fault(cause: KeyStoreError) -> StoreError {
    StoreError {
        reason: cause.to_string(),
    }
}
