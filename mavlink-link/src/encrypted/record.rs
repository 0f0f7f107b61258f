//! What one end keeps on disk: the counter of its last exchange and the highest epoch, before a packet of that epoch.

use crate::exchange::{
    Agreed, InitiatorMemory, InitiatorStore, PinnedPeer, PublicKey, ResponderMemory,
    ResponderStore, StoreError,
};
use crate::store::{Disk, Durability, Record, Store as _};

/// The encrypted link of one vehicle, as it is on disk at either end. It holds no secret.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EncryptedRecord {
    /// The counter of the exchange: on the ground of the last attempt, in the air of the last one completed.
    pub counter: u64,
    /// The highest epoch: every key of this end is of a higher one from now on.
    pub epoch: u32,
}

impl EncryptedRecord {
    pub(super) fn of_initiator(self) -> InitiatorMemory {
        InitiatorMemory {
            counter: self.counter,
            epoch: self.epoch,
            ..InitiatorMemory::default()
        }
    }

    pub(super) fn of_responder(self, peer: PublicKey) -> ResponderMemory {
        ResponderMemory {
            peer: Some(PinnedPeer {
                key: peer,
                counter: self.counter,
            }),
            epoch: self.epoch,
            ..ResponderMemory::default()
        }
    }
}

/// How the files of these records begin.
pub const ENCRYPTED: &str = "encrypted-";

impl Record for EncryptedRecord {
    /// The vehicle's identification number.
    type Key = u32;
    const DURABILITY: Durability = Durability::Power;

    fn name(vehicle: &u32) -> String {
        format!("{ENCRYPTED}{vehicle:08x}")
    }

    fn encode(&self) -> Vec<u8> {
        // Always as long: a disk without room writes it over the one before, and a power cut may leave the new content with the old
        // length. A part of an epoch would be an epoch that was used already.
        format!("{:<20} {:<10}\n", self.counter, self.epoch).into_bytes()
    }

    // Line feeds may follow: a disk without room writes a shorter record over a longer one.
    fn decode(bytes: &[u8]) -> Result<Self, String> {
        let text = core::str::from_utf8(bytes).unwrap_or_default();
        let mut words = text.split_ascii_whitespace();
        let counter = words.next().and_then(|word| word.parse().ok());
        let epoch = words.next().and_then(|word| word.parse().ok());
        match (counter, epoch, words.next()) {
            (Some(counter), Some(epoch), None) => Ok(Self { counter, epoch }),
            _ => Err(format!("{text:?}, expected a counter and an epoch")),
        }
    }
}

/// What an exchange of the link writes: the record, and in memory what was agreed on.
pub(super) struct Notes<'a> {
    pub(super) disk: &'a mut dyn Disk,
    pub(super) vehicle: u32,
    pub(super) record: &'a mut EncryptedRecord,
    /// Makes the keys of what was agreed on; false where the other end wants none.
    pub(super) stage: &'a mut dyn FnMut(&Agreed) -> bool,
}

impl Notes<'_> {
    fn change(&mut self, to: impl FnOnce(&mut EncryptedRecord)) -> Result<(), StoreError> {
        let mut record = *self.record;
        to(&mut record);
        let saved = self.disk.save(&self.vehicle, &record);
        saved.map_err(|fault| StoreError {
            reason: fault.to_string(),
        })?;
        *self.record = record;
        Ok(())
    }

    fn agree(
        &mut self,
        agreed: &Agreed,
        to: impl FnOnce(&mut EncryptedRecord),
    ) -> Result<(), StoreError> {
        self.change(|record| {
            record.epoch = record.epoch.max(agreed.epoch);
            to(record);
        })?;
        if (self.stage)(agreed) {
            return Ok(());
        }
        Err(StoreError {
            reason: "the other end wants no encrypted link".to_owned(),
        })
    }
}

/// The signing key that the same handshake yields is never used, and never kept: nothing is promoted or dropped.
impl InitiatorStore for Notes<'_> {
    fn store_counter(&mut self, counter: u64) -> Result<(), StoreError> {
        self.change(|record| record.counter = counter)
    }

    fn promote_next(&mut self) -> Result<(), StoreError> {
        Ok(())
    }

    fn store_next(&mut self, agreed: &Agreed) -> Result<(), StoreError> {
        self.agree(agreed, |_| {})
    }

    fn drop_next(&mut self) -> Result<(), StoreError> {
        Ok(())
    }

    fn pin(&mut self, _: &PublicKey) -> Result<(), StoreError> {
        Ok(())
    }
}

impl ResponderStore for Notes<'_> {
    fn withdraw_next(&mut self) -> Result<(), StoreError> {
        Ok(())
    }

    fn store_agreed(&mut self, peer: &PinnedPeer, agreed: &Agreed) -> Result<(), StoreError> {
        self.agree(agreed, |record| record.counter = peer.counter)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_record_is_read_as_it_was_written_and_nothing_else_is() {
        let record = EncryptedRecord {
            counter: u64::MAX,
            epoch: 7,
        };
        assert_eq!(EncryptedRecord::decode(&record.encode()), Ok(record));
        let longer = [record.encode(), b"\n\n".to_vec()].concat();
        assert_eq!(EncryptedRecord::decode(&longer), Ok(record));
        let longest = EncryptedRecord {
            counter: u64::MAX,
            epoch: u32::MAX,
        };
        for other in [record, EncryptedRecord::default()] {
            assert_eq!(other.encode().len(), longest.encode().len());
        }
        // Cut off behind its counter.
        let cut = &longest.encode()[..21];
        assert!(EncryptedRecord::decode(cut).is_err());
        for text in ["", "1", "1 2 3", "1 -2", "1 4294967296", "x y"] {
            assert!(EncryptedRecord::decode(text.as_bytes()).is_err(), "{text}");
        }
    }
}
