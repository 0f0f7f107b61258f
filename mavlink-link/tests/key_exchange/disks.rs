//! The two disks, with a process that may die at any write.

use mavlink_link::exchange::{
    Agreed, InitiatorMemory, InitiatorStore, PinnedPeer, PublicKey, ResponderMemory,
    ResponderStore, StagedKey, StoreError,
};
use mavlink_link::signing::{KeyId, SigningKey};

/// A signing key as the disks and the model of the vehicle hold it.
pub(crate) type Key = [u8; 32];

/// The name of a key.
pub(crate) fn id(key: &Key) -> KeyId {
    SigningKey::new(*key).unwrap().id()
}

/// What happens at a write.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Fault {
    /// The process dies, and nothing has been written.
    DiesBefore,
    /// It is written, and the process dies.
    DiesAfter,
    /// The disk fails, and the process continues.
    Fails,
}

/// Counts writes and lets one of them go wrong.
#[derive(Debug, Default, Clone)]
pub(crate) struct Writes {
    pub(crate) count: usize,
    pub(crate) fault: Option<(usize, Fault)>,
    pub(crate) died: bool,
}

impl Writes {
    fn write(&mut self, act: impl FnOnce()) -> Result<(), StoreError> {
        let here = self.count;
        self.count += 1;
        let fault = self
            .fault
            .filter(|(at, _)| *at == here)
            .map(|(_, fault)| fault);
        if matches!(fault, None | Some(Fault::DiesAfter)) {
            act();
        }
        self.died |= matches!(fault, Some(Fault::DiesBefore | Fault::DiesAfter));
        match fault {
            None => Ok(()),
            Some(fault) => Err(StoreError {
                reason: format!("{fault:?}"),
            }),
        }
    }
}

/// The ground side's.
#[derive(Debug, Default, Clone)]
pub(crate) struct GroundDisk {
    pub(crate) writes: Writes,
    pub(crate) counter: u64,
    pub(crate) epoch: u32,
    pub(crate) current: Option<Key>,
    pub(crate) next: Option<Key>,
    pub(crate) peer: Option<PublicKey>,
    pub(crate) pending: Option<(PublicKey, Key)>,
}

impl GroundDisk {
    pub(crate) fn memory(&self) -> InitiatorMemory {
        InitiatorMemory {
            counter: self.counter,
            epoch: self.epoch,
            current: self.current.as_ref().map(id),
            next: self.next.as_ref().map(id),
        }
    }

    pub(crate) fn has(&self, key: &Key) -> bool {
        self.current.as_ref() == Some(key) || self.next.as_ref() == Some(key)
    }
}

impl InitiatorStore for GroundDisk {
    fn store_counter(&mut self, counter: u64) -> Result<(), StoreError> {
        let Self {
            writes,
            counter: kept,
            ..
        } = self;
        writes.write(|| {
            assert!(counter > *kept, "the counter rises");
            *kept = counter;
        })
    }

    fn promote_next(&mut self) -> Result<(), StoreError> {
        let Self {
            writes,
            current,
            next,
            ..
        } = self;
        writes.write(|| {
            if let Some(key) = next.take() {
                *current = Some(key);
            }
        })
    }

    fn store_next(&mut self, agreed: &Agreed) -> Result<(), StoreError> {
        let Self {
            writes,
            next,
            epoch,
            pending,
            peer,
            ..
        } = self;
        writes.write(|| {
            assert!(agreed.epoch > *epoch, "the epoch rises");
            (*next, *epoch) = (Some(*agreed.key.expose()), agreed.epoch);
            *pending = (*peer != Some(agreed.peer)).then_some((agreed.peer, *agreed.key.expose()));
        })
    }

    fn drop_next(&mut self) -> Result<(), StoreError> {
        let Self { writes, next, .. } = self;
        writes.write(|| *next = None)
    }

    fn pin(&mut self, key: &PublicKey) -> Result<(), StoreError> {
        let Self {
            writes,
            peer,
            pending,
            ..
        } = self;
        writes.write(|| (*peer, *pending) = (Some(*key), None))
    }
}

/// The air side's.
#[derive(Debug, Default, Clone)]
pub(crate) struct AirDisk {
    pub(crate) writes: Writes,
    pub(crate) peer: Option<PinnedPeer>,
    pub(crate) epoch: u32,
    pub(crate) current: Option<Key>,
    pub(crate) next: Option<(Key, bool)>,
}

impl AirDisk {
    pub(crate) fn memory(&self) -> ResponderMemory {
        ResponderMemory {
            peer: self.peer,
            epoch: self.epoch,
            current: self.current.as_ref().map(id),
            next: self.next.as_ref().map(|(key, sent)| StagedKey {
                id: id(key),
                sent: *sent,
            }),
        }
    }
}

impl ResponderStore for AirDisk {
    fn withdraw_next(&mut self) -> Result<(), StoreError> {
        let Self { writes, next, .. } = self;
        writes.write(|| {
            assert!(!next.is_some_and(|(_, sent)| sent), "it may be in use");
            *next = None;
        })
    }

    fn store_agreed(&mut self, pinned: &PinnedPeer, agreed: &Agreed) -> Result<(), StoreError> {
        let Self {
            writes,
            next,
            epoch,
            peer,
            ..
        } = self;
        // Two files: the record, then the key. A process that dies in between leaves the first of them.
        let before = (*peer, *epoch);
        writes.write(|| {
            assert!(agreed.epoch > *epoch, "the epoch rises");
            (*peer, *epoch) = (Some(*pinned), agreed.epoch);
        })?;
        let stored = writes.write(|| {
            assert!(next.is_none(), "withdrawn first");
            *next = Some((*agreed.key.expose(), false));
        });
        if stored.is_err() && !writes.died {
            (*peer, *epoch) = before;
        }
        stored
    }
}
