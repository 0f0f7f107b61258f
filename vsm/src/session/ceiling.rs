//! The signing clock's ceiling as a record of the store.

use mavlink_link::clock::{CeilingStore, StoreError};
use mavlink_link::signing::{KeyId, Stamp};

use super::store::{Durability, Store};

/// A [`Store`] as the signing clock sees it: one record a key, which never goes back, whoever writes it.
pub(crate) struct Ceilings<'a>(pub(crate) &'a mut dyn Store);

impl CeilingStore for Ceilings<'_> {
    fn load(&mut self, key: &KeyId) -> Result<Option<Stamp>, StoreError> {
        let bytes = self.0.load(&name(key)).map_err(|fault| StoreError {
            reason: fault.to_string(),
        })?;
        let Some(bytes) = bytes else {
            return Ok(None);
        };
        let text = String::from_utf8_lossy(&bytes);
        match text.trim().parse::<u64>() {
            Ok(units) if units <= Stamp::MAX.get() => Ok(Some(Stamp::new(units))),
            // A ceiling that cannot be read is not a missing one: starting below it would repeat stamps.
            _ => Err(StoreError {
                reason: format!(
                    "record {} holds {text:?}, expected a number below 2^48",
                    name(key)
                ),
            }),
        }
    }

    fn store(&mut self, key: &KeyId, ceiling: Stamp) -> Result<(), StoreError> {
        if self.load(key)?.is_some_and(|stored| stored >= ceiling) {
            return Ok(());
        }
        let text = format!("{}\n", ceiling.get());
        self.0
            .save(&name(key), text.as_bytes(), Durability::Power)
            .map_err(|fault| StoreError {
                reason: fault.to_string(),
            })
    }
}

fn name(key: &KeyId) -> String {
    format!("clock-{key}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shell::file_store::FileStore;

    #[test]
    fn a_ceiling_is_never_lowered() {
        let folder = tempfile::tempdir().unwrap();
        let mut store = FileStore::open(&folder.path().join("state")).unwrap();
        let key = KeyId::from_bytes([7; 8]);
        let mut ceilings = Ceilings(&mut store);
        for (written, held) in [(100, 100), (50, 100), (101, 101)] {
            ceilings.store(&key, Stamp::new(written)).unwrap();
            assert_eq!(ceilings.load(&key).unwrap(), Some(Stamp::new(held)));
        }
    }
}
