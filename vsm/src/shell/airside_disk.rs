//! The agent's disk: the ceilings of its clocks in its store folder, its keys beside their file. Separate threads
//! synchronise both, so that frames are relayed meanwhile.

use mavlink_link::exchange::{self, Agreed, PinnedPeer, ResponderStore};
use mavlink_link::signing::SigningKey;
use mavlink_link::store::{Disk, StoreError};
use stanag_msgs::Id;

use super::key_store::KeyStoreError;
use super::ordered_files::OrderedKeys;
use super::queued_disk::QueuedDisk;
use crate::airside::Keys;
use crate::key_exchange::ExchangeRecord;

/// Both, locked for this process.
#[derive(Debug)]
pub struct AirsideDisk {
    pub(super) store: QueuedDisk,
    pub(super) ordered: OrderedKeys,
    pub(super) vehicle: Id,
}

impl AirsideDisk {
    fn change(&mut self, to: impl FnOnce(&mut ExchangeRecord)) -> Result<(), exchange::StoreError> {
        let disk = &mut self.ordered.records;
        let mut record = ExchangeRecord::load(disk, self.vehicle).map_err(exchange_fault)?;
        to(&mut record);
        record.save(disk, self.vehicle).map_err(exchange_fault)
    }
}

impl AirsideDisk {
    /// Deletes the signing clocks of dead keys. A file that stays behind is harmless; the next start deletes it.
    pub(super) fn bury(&mut self) {
        if let Err(fault) = self.ordered.keys.bury(&mut self.store) {
            tracing::debug!("the clock of a dead key cannot be deleted: {fault}");
        }
    }
}

impl ResponderStore for AirsideDisk {
    fn withdraw_next(&mut self) -> Result<(), exchange::StoreError> {
        self.ordered.keys.drop_next().map_err(exchange_fault)?;
        self.bury();
        Ok(())
    }

    fn store_peer(&mut self, peer: &PinnedPeer) -> Result<(), exchange::StoreError> {
        self.change(|record| {
            record.peer = Some(*peer.key.bytes());
            record.counter = peer.counter;
        })
    }

    fn store_next(&mut self, agreed: &Agreed) -> Result<(), exchange::StoreError> {
        // The epoch goes first: a power cut in between skips an epoch, and never uses one twice.
        self.change(|record| record.epoch = record.epoch.max(agreed.epoch))?;
        // `stage`, not `restage`: a key that PX4 may have been sent is not replaced here.
        self.ordered.keys.stage(&agreed.key).map_err(exchange_fault)
    }
}

fn exchange_fault(cause: impl std::fmt::Display) -> exchange::StoreError {
    exchange::StoreError {
        reason: cause.to_string(),
    }
}

impl Keys for AirsideDisk {
    fn disk(&mut self) -> &mut dyn Disk {
        &mut self.store
    }

    fn for_exchange(&mut self) -> &mut dyn ResponderStore {
        self
    }

    fn is_stored(&self) -> bool {
        self.ordered.files.is_durable()
    }

    fn next(&mut self) -> Result<Option<SigningKey>, StoreError> {
        self.ordered.keys.next().map_err(fault)
    }

    fn commit(&mut self) -> Result<(), StoreError> {
        self.ordered.keys.commit().map_err(fault)?;
        self.bury();
        Ok(())
    }

    fn drop_next(&mut self) -> Result<(), StoreError> {
        self.ordered.keys.drop_next().map_err(fault)?;
        self.bury();
        Ok(())
    }

    fn drop_previous(&mut self) -> Result<(), StoreError> {
        self.ordered.keys.drop_previous().map_err(fault)?;
        self.bury();
        Ok(())
    }
}

fn fault(cause: KeyStoreError) -> StoreError {
    StoreError::new("key", cause)
}
