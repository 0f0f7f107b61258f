//! What the agent needs of a disk: the ceilings of its signing clocks, and the keys with their order.

use mavlink_link::Now;
use mavlink_link::clock::Origin;
use mavlink_link::exchange::{PinnedPeer, ResponderStore};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::{Disk, StoreError};

/// The key files beside the clocks and what the exchange keeps. Each call returns only when a power cut could not undo
/// it, or [`Keys::is_stored`] reports when.
pub trait Keys {
    /// Where the ceilings of the signing clocks are.
    fn disk(&mut self) -> &mut dyn Disk;

    /// The same disk as the exchange sees it.
    fn for_exchange(&mut self) -> &mut dyn ResponderStore;

    /// Whether all that was written is durable. Until then neither the exchange nor a key is sent anything of; frames are
    /// relayed.
    fn is_stored(&self) -> bool;

    /// The key that is going to be handed over.
    ///
    /// # Errors
    /// It is there and cannot be used.
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

/// The keys as they lie on disk at the start.
#[derive(Debug, Default)]
pub struct Held {
    /// In force.
    pub current: Option<SigningKey>,
    /// PX4 may have been sent it.
    pub next: Option<SigningKey>,
    /// The one before.
    pub previous: Option<SigningKey>,
    /// The ground that was paired with.
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
