//! What the agent needs on a disk: the ceilings of its signing clocks, and the keys in their order.

use mavlink_link::Now;
use mavlink_link::clock::Origin;
use mavlink_link::exchange::{PinnedPeer, ResponderStore};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::{Disk, StoreError};

/// The key files, the clocks, and what the exchange keeps. Each call returns only when a power cut could not undo it, or
/// [`Keys::is_stored`] reports when.
pub trait Keys {
    /// The disk with the ceilings of the signing clocks.
    fn disk(&mut self) -> &mut dyn Disk;

    /// The same disk, as the exchange uses it.
    fn for_exchange(&mut self) -> &mut dyn ResponderStore;

    /// Whether everything written is durable. Until then no message of the exchange and no key is sent; frames are relayed.
    fn is_stored(&self) -> bool;

    /// The key that will be installed next.
    ///
    /// # Errors
    /// It exists and cannot be used.
    fn next(&mut self) -> Result<Option<SigningKey>, StoreError>;

    /// The next key becomes the current one, and the current the previous.
    ///
    /// # Errors
    /// It could not be made durable; both keys are still there.
    fn commit(&mut self) -> Result<(), StoreError>;

    /// The next key is deleted: PX4 keeps the current one.
    ///
    /// # Errors
    /// It could not be deleted.
    fn drop_next(&mut self) -> Result<(), StoreError>;

    /// The previous key is deleted: PX4 has restarted and still signs with the current one.
    ///
    /// # Errors
    /// It could not be deleted.
    fn drop_previous(&mut self) -> Result<(), StoreError>;
}

/// The keys on disk at the start.
#[derive(Debug, Default)]
pub struct Held {
    /// In force.
    pub current: Option<SigningKey>,
    /// It may have been sent to PX4.
    pub next: Option<SigningKey>,
    /// The one before the current key.
    pub previous: Option<SigningKey>,
    /// The paired ground.
    pub peer: Option<PinnedPeer>,
    /// The highest epoch ever stored.
    pub epoch: u32,
}

/// A key with its clock, read from disk.
pub(super) fn with_clock(
    key: SigningKey,
    not_before: Stamp,
    now: Now,
    keys: &mut dyn Keys,
) -> Result<KeyState, StoreError> {
    KeyState::start(key, Origin::KeyFile, not_before, now, keys.disk())
}
