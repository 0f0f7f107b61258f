//! The stored signing clock of a key, for `vsm key clock`. The store's lock is held, so no bridge uses it meanwhile.

use mavlink_link::clock::{CeilingStore as _, StoreError};
use mavlink_link::signing::{KeyId, Stamp};

use super::file_store::FileStore;
use crate::session::Ceilings;

/// The stamp beyond which nothing has been sent or accepted; `None` where the key has not been used.
///
/// # Errors
/// The record cannot be read.
pub fn ceiling(store: &mut FileStore, key: &KeyId) -> Result<Option<Stamp>, StoreError> {
    Ceilings(store).load(key)
}

/// Moves the stored clock up to a wall clock that a person vouches for; never back.
///
/// # Errors
/// The record cannot be read or made durable.
pub fn accept_wall(store: &mut FileStore, key: &KeyId, wall: Stamp) -> Result<(), StoreError> {
    Ceilings(store).store(key, wall)
}
