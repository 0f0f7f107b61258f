//! What the ground side of an exchange reads and writes: its record, and the keys of the vehicle.

use mavlink_link::exchange::{Agreed, InitiatorMemory, InitiatorStore, PublicKey, StoreError};
use mavlink_link::signing::SigningKey;
use mavlink_link::store::{self, Disk};
use stanag_msgs::Id;

use super::record::{ExchangeRecord, Pending};

/// The keys of one vehicle on disk. A change is durable when the call returns, or as soon as the records are that are
/// written with it. A change that fails leaves usable keys.
pub trait Keyring {
    /// The key in force; `None` if there is none yet.
    ///
    /// # Errors
    /// It is there and cannot be used.
    fn current(&self) -> Result<Option<SigningKey>, store::StoreError>;

    /// The key that the vehicle may have been sent.
    ///
    /// # Errors
    /// It is there and cannot be used.
    fn next(&self) -> Result<Option<SigningKey>, store::StoreError>;

    /// Stores a key as the next one. It replaces one that can no longer be sent to the vehicle.
    ///
    /// # Errors
    /// It could not be made durable; the earlier one is still there.
    fn restage(&self, key: &SigningKey) -> Result<(), store::StoreError>;

    /// The vehicle has the next key: it becomes the current one.
    ///
    /// # Errors
    /// A step could not be made durable: both keys are still there.
    fn commit(&self) -> Result<(), store::StoreError>;

    /// The vehicle keeps the current key: the next one is deleted.
    ///
    /// # Errors
    /// It could not be deleted.
    fn drop_next(&self) -> Result<(), store::StoreError>;

    /// Deletes the signing clocks of keys that none of these files holds any more.
    ///
    /// # Errors
    /// They are deleted at the next call, or the next start.
    fn bury(&self, disk: &mut dyn Disk) -> Result<(), store::StoreError>;
}

/// What the machine must know about the stored keys.
pub(crate) fn memory(record: &ExchangeRecord, keys: &dyn Keyring) -> InitiatorMemory {
    let id = |key: SigningKey| key.id();
    InitiatorMemory {
        counter: record.counter,
        epoch: record.epoch,
        current: keys.current().ok().flatten().map(id),
        next: keys.next().ok().flatten().map(id),
    }
}

/// The disk of the exchange's records.
pub(crate) fn records<'a>(
    store: &'a mut dyn Disk,
    records: &'a mut Option<&mut dyn Disk>,
) -> &'a mut dyn Disk {
    match records {
        Some(records) => &mut **records,
        None => store,
    }
}

/// The files that an exchange writes.
pub(crate) struct GroundKeys<'a, 'b> {
    pub(crate) store: &'a mut dyn Disk,
    pub(crate) records: &'a mut Option<&'b mut dyn Disk>,
    pub(crate) keys: &'a dyn Keyring,
    pub(crate) record: &'a mut ExchangeRecord,
    pub(crate) vehicle: Id,
}

impl GroundKeys<'_, '_> {
    /// Changes the record on disk, and then in memory.
    fn change(&mut self, change: impl FnOnce(&mut ExchangeRecord)) -> Result<(), StoreError> {
        let mut record = self.record.clone();
        change(&mut record);
        let disk = records(self.store, self.records);
        record.save(disk, self.vehicle).map_err(reason)?;
        *self.record = record;
        Ok(())
    }

    /// A failure is ignored: the remaining clocks do no harm and are deleted at the next start.
    fn bury(&mut self) {
        let _ = self.keys.bury(self.store);
    }
}

impl InitiatorStore for GroundKeys<'_, '_> {
    fn store_counter(&mut self, counter: u64) -> Result<(), StoreError> {
        self.change(|record| record.counter = counter)
    }

    fn promote_next(&mut self) -> Result<(), StoreError> {
        self.keys.commit().map_err(reason)?;
        self.bury();
        Ok(())
    }

    fn store_next(&mut self, agreed: &Agreed) -> Result<(), StoreError> {
        // The record goes first: a pending pairing whose key was never stored is never proven, and does no harm.
        let (peer, key) = (*agreed.peer.bytes(), *agreed.key.id().bytes());
        self.change(|record| {
            record.epoch = agreed.epoch;
            // An agent that is already pinned needs no proof.
            record.pending = (record.peer != Some(peer)).then_some(Pending {
                peer: Some(peer),
                key: Some(key),
            });
        })?;
        self.keys.restage(&agreed.key).map_err(reason)?;
        self.bury();
        Ok(())
    }

    fn drop_next(&mut self) -> Result<(), StoreError> {
        self.keys.drop_next().map_err(reason)?;
        self.bury();
        Ok(())
    }

    fn pin(&mut self, peer: &PublicKey) -> Result<(), StoreError> {
        // The agent has proved that it has the key.
        let agreed = self.keys.next().map_err(reason)?;
        self.change(|record| {
            (record.peer, record.pending) = (Some(*peer.bytes()), None);
            record.agreed = agreed.map(|key| *key.id().bytes());
        })
    }
}

fn reason(fault: impl std::fmt::Display) -> StoreError {
    StoreError {
        reason: fault.to_string(),
    }
}
