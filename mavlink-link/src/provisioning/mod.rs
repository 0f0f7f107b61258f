//! Giving a vehicle a new signing key, without a state from which the link cannot come back by itself.
//!
//! PX4 answers SETUP_SIGNING with nothing that can be relied on, and takes the key or not. So two keys
//! are held until a frame of the vehicle *verifies* under one of them: only that is proof. Promised:
//!
//! - nothing is thrown away on silence: a vehicle that is not heard may have taken the key;
//! - the new key is given up only where frames of the vehicle, made after the last SETUP_SIGNING had
//!   become a replay, have verified under the old key alone for half a minute;
//! - every SETUP_SIGNING is signed with the key in force, while the vehicle says that it is disarmed,
//!   and with a first stamp above every stamp seen;
//! - stamps rise over both keys, for the vehicle keeps one table of streams for them.
//!
//! ```text
//! STAGED -> WAIT_DISARM -> SENT -+-> COMMITTED              a frame verifies under the new key
//!               ^                +-> NOT_TAKEN              two newer frames under the old one
//!               |                |     +-> ROLLED_BACK      after three; given up after 30 s more
//!               +----------------+-----+
//!                                +-> UNKNOWN                silence: both keys kept, both tried
//! ```
//!
//! A process that dies on the way starts again in UNKNOWN, with the keys that are on disk: the caller
//! stores the new key before [`KeyRollover::start`], and makes it the current one on [`Event::Commit`].

mod evidence;
mod rollover;
mod send;

pub use self::rollover::{
    Event, KeyRollover, KeyRolloverConfig, KeySlot, Outcome, StartError, State,
};
pub use self::send::Transmit;
