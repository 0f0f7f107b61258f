//! What each end keeps on disk, and what must be there when a process starts again.
//!
//! The machines decide the order. A call returns only once its data would survive a power cut, or the caller takes nothing
//! from `poll_transmit` before that. A call that fails ends the attempt, and nothing more of that attempt is sent. The
//! process may die between any two of the calls.

use thiserror::Error;

use super::identity::PublicKey;
use super::keys::Agreed;
use crate::signing::KeyId;

/// Something could not be made durable.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
#[error("{reason}")]
pub struct StoreError {
    /// The reason, for a person.
    pub reason: String,
}

/// The disk of the ground side.
pub trait InitiatorStore {
    /// Keeps the counter of the attempt that begins now.
    ///
    /// # Errors
    /// It is not durable.
    fn store_counter(&mut self, counter: u64) -> Result<(), StoreError>;

    /// The responder already uses our `next`: makes it the current key, and the current one the previous.
    ///
    /// # Errors
    /// It is not durable.
    fn promote_next(&mut self) -> Result<(), StoreError>;

    /// Keeps a key as `next`, in place of any other, with its epoch. For a pairing, keeps the peer's static key too, which
    /// is not proven yet.
    ///
    /// # Errors
    /// It is not durable.
    fn store_next(&mut self, agreed: &Agreed) -> Result<(), StoreError>;

    /// The responder does not have `next`, and reports so under the keys of the exchange: it may be deleted.
    ///
    /// # Errors
    /// It is not durable.
    fn drop_next(&mut self) -> Result<(), StoreError>;

    /// The peer of a pairing is proven: only suite 1 with this key is used from now on.
    ///
    /// # Errors
    /// It is not durable.
    fn pin(&mut self, peer: &PublicKey) -> Result<(), StoreError>;
}

/// What the ground side must know when it starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct InitiatorMemory {
    /// As last given to [`InitiatorStore::store_counter`]; 0 at first.
    pub counter: u64,
    /// The highest epoch ever stored; 0 at first.
    pub epoch: u32,
    /// The key in force.
    pub current: Option<KeyId>,
    /// The key that is agreed and not known to be in use.
    pub next: Option<KeyId>,
}

/// The disk of the air side.
pub trait ResponderStore {
    /// `next`, which has not been sent to the autopilot, is withdrawn before another one is agreed on. After this it must
    /// never be sent.
    ///
    /// # Errors
    /// It is not durable.
    fn withdraw_next(&mut self) -> Result<(), StoreError>;

    /// Keeps the result of an exchange: the peer's static key and the counter of its last exchange, the one peer from now
    /// on; and the key as `next`, with its epoch. It may be installed in the autopilot from now on.
    ///
    /// One call, so that no failure leaves a peer whose key is missing: it would keep out the previous peer, and the new one
    /// has not received step 4. Where they are two files, the peer is written first: a power cut in between costs another
    /// pairing, while a key without its peer could be installed for a ground that nobody here knows.
    ///
    /// # Errors
    /// One of them is not durable; then peer and `next` are as before.
    fn store_agreed(&mut self, peer: &PinnedPeer, agreed: &Agreed) -> Result<(), StoreError>;
}

/// The ground side, as the air side knows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PinnedPeer {
    /// Its static key.
    pub key: PublicKey,
    /// The counter of its last completed exchange.
    pub counter: u64,
}

/// What the air side must know when it starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ResponderMemory {
    /// As last given to [`ResponderStore::store_agreed`].
    pub peer: Option<PinnedPeer>,
    /// The highest epoch ever stored; 0 at first.
    pub epoch: u32,
    /// The key in force.
    pub current: Option<KeyId>,
    /// The key that is staged, and whether it may have been sent to the autopilot.
    pub next: Option<StagedKey>,
}

/// `next` at the air side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StagedKey {
    /// Its name.
    pub id: KeyId,
    /// Whether it may have been sent to the autopilot: if so, it is not replaced before the outcome is known.
    pub sent: bool,
}
