//! What an exchange reads and writes: its record, and the key files.

use mavlink_link::exchange::{Agreed, InitiatorMemory, InitiatorStore, PublicKey, StoreError};
use mavlink_link::signing::SigningKey;
use stanag_msgs::Id;

use crate::shell::disk::FileDisk;
use crate::shell::exchange_record::{ExchangeRecord, Pending};
use crate::shell::key_store::KeyStore;

/// What the machine must know of the stored keys.
pub(in crate::shell) fn memory(record: &ExchangeRecord, keys: &KeyStore) -> InitiatorMemory {
    let id = |key: SigningKey| key.id();
    InitiatorMemory {
        counter: record.counter,
        epoch: record.epoch,
        current: keys.current().ok().flatten().map(id),
        next: keys.next().ok().flatten().map(id),
    }
}

/// The files that an exchange writes.
pub(in crate::shell) struct Disk<'a> {
    pub(in crate::shell) store: &'a mut FileDisk,
    pub(in crate::shell) keys: &'a KeyStore,
    pub(in crate::shell) record: &'a mut ExchangeRecord,
    pub(in crate::shell) vehicle: Id,
}

impl Disk<'_> {
    /// Changes the record on disk, and then here.
    fn change(&mut self, change: impl FnOnce(&mut ExchangeRecord)) -> Result<(), StoreError> {
        let mut record = self.record.clone();
        change(&mut record);
        record.save(self.store, self.vehicle).map_err(reason)?;
        *self.record = record;
        Ok(())
    }
}

impl InitiatorStore for Disk<'_> {
    fn store_counter(&mut self, counter: u64) -> Result<(), StoreError> {
        self.change(|record| record.counter = counter)
    }

    fn promote_next(&mut self) -> Result<(), StoreError> {
        self.keys.commit().map_err(reason)
    }

    fn store_next(&mut self, agreed: &Agreed) -> Result<(), StoreError> {
        let (peer, key) = (*agreed.peer.bytes(), *agreed.key.id().bytes());
        self.change(|record| {
            record.epoch = agreed.epoch;
            record.pending = (record.peer != Some(peer)).then_some(Pending {
                peer: Some(peer),
                key: Some(key),
            });
        })?;
        self.keys.restage(&agreed.key).map_err(reason)
    }

    fn drop_next(&mut self) -> Result<(), StoreError> {
        self.keys.drop_next().map_err(reason)
    }

    fn pin(&mut self, peer: &PublicKey) -> Result<(), StoreError> {
        self.change(|record| (record.peer, record.pending) = (Some(*peer.bytes()), None))
    }
}

fn reason(fault: impl std::fmt::Display) -> StoreError {
    StoreError {
        reason: fault.to_string(),
    }
}
