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

    fn store_agreed(
        &mut self,
        peer: &PinnedPeer,
        agreed: &Agreed,
    ) -> Result<(), exchange::StoreError> {
        let (vehicle, ordered) = (self.vehicle, &mut self.ordered);
        let (keys, records) = (&ordered.keys, &mut ordered.records);
        let before = ExchangeRecord::load(records, vehicle).map_err(exchange_fault)?;
        let record = ExchangeRecord {
            peer: Some(*peer.key.bytes()),
            counter: peer.counter,
            epoch: before.epoch.max(agreed.epoch),
            ..before.clone()
        };
        let stored = ordered.files.together(|| {
            // The epoch goes first: a power cut in between skips an epoch, and never uses one twice.
            record.save(records, vehicle).map_err(exchange_fault)?;
            // `stage`, not `restage`: a key that PX4 may have been sent is not replaced here.
            let Err(cause) = keys.stage(&agreed.key) else {
                return Ok(());
            };
            before.save(records, vehicle).map_err(|other| {
                exchange_fault(format!("{cause}; the pairing is changed: {other}"))
            })?;
            Err(exchange_fault(cause))
        });
        stored.map_err(exchange_fault)?
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

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::{Duration, Instant};

    use mavlink_link::exchange::PublicKey;
    use tokio::sync::Notify;

    use super::*;
    use crate::shell::disk::FileDisk;
    use crate::shell::key_store::KeyStore;

    const VEHICLE: Id = Id(0x1b00_0101);

    fn agreed(n: u8) -> (PinnedPeer, Agreed) {
        let key = PublicKey::new([n; 32]);
        let agreed = Agreed {
            key: SigningKey::new([n; 32]).unwrap(),
            confidential: None,
            epoch: n.into(),
            peer: key,
        };
        let counter = n.into();
        (PinnedPeer { key, counter }, agreed)
    }

    #[test]
    fn a_key_that_cannot_be_stored_leaves_the_earlier_pairing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("v.key");
        let keys = KeyStore::open(&path).unwrap();
        let store = FileDisk::open(&folder.path().join("store")).unwrap();
        let notify = Arc::new(Notify::new());
        let ordered = OrderedKeys::start(keys, &store, notify.clone());
        let mut disk = AirsideDisk {
            store: QueuedDisk::new(store, notify).unwrap(),
            ordered,
            vehicle: VEHICLE,
        };
        let record = |disk: &AirsideDisk| {
            let files = &disk.ordered.files;
            assert!(files.wait(Instant::now() + Duration::from_secs(20)));
            ExchangeRecord::load(&disk.ordered.records, VEHICLE).unwrap()
        };

        let (peer, first) = agreed(1);
        disk.store_agreed(&peer, &first).unwrap();
        let before = record(&disk);
        assert_eq!(before.peer(), Some(peer.key));
        assert!(Keys::next(&mut disk).unwrap().is_some());

        // The staged key is still there, and may have been sent: another one is refused.
        let (other, second) = agreed(2);
        disk.store_agreed(&other, &second).unwrap_err();
        assert_eq!(record(&disk), before);
        let next = Keys::next(&mut disk).unwrap().unwrap();
        assert!(next.same_as(&first.key));
    }
}
