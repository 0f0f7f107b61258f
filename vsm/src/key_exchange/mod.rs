//! The ground side of the key exchange: agrees on a signing key with a vehicle's air-side agent while the bridge flies.
//!
//! A sans-I/O machine: time, randomness, the disk and the keys are passed in. Whatever happens here, the bridge keeps its
//! current key; an agreed key waits as `next` until the vehicle signs with it.
//!
//! In this order: `record` is what must survive a restart, `ground` how the initiator writes it and the keys, `machine` the
//! exchange of one vehicle: `handle`, `poll_timeout`, `poll_log`.

mod ground;
mod machine;
mod record;

pub use ground::Keyring;
pub(crate) use ground::{GroundKeys, memory, records};
pub use machine::{KeyExchange, Surroundings, parties};
pub(crate) use machine::{NOT_REACHED, WANTED};
pub use record::{ExchangeRecord, Pending, guard_identity, identity};
pub(crate) use record::{IDENTITY, MAX_IDENTITY_BYTES, parse_identity};
