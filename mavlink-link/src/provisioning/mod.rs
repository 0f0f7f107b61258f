//! Giving a vehicle a new signing key, without any state from which the link cannot recover by itself.
//!
//! PX4 sends no acknowledgement of SETUP_SIGNING, only a STATUSTEXT, and it may refuse the key. So two keys are kept until
//! a frame of the vehicle *verifies* under one of them: only that is proof (pitfall 14: signing is switched on before the
//! peer has accepted the key, and the link is lost). Promised:
//!
//! - nothing is deleted on silence: a vehicle that sends nothing may have accepted the key (pitfall 27);
//! - the new key is given up only after frames of the vehicle, made after the last SETUP_SIGNING had become a replay, have
//!   verified under the old key alone for half a minute;
//! - every SETUP_SIGNING is signed with the key in use, sent while the vehicle reports that it is disarmed (PX4 refuses it
//!   while armed), and carries a first timestamp above every timestamp seen;
//! - timestamps rise over both keys, since the vehicle keeps one table of streams for both.
//!
//! ```text
//! STAGED -> WAIT_DISARM -> SENT -+-> COMMITTED              a frame verifies under the new key
//!               ^                +-> NOT_TAKEN              two newer frames under the old one
//!               |                |     +-> ROLLED_BACK      after three; given up after 30 s more
//!               +----------------+-----+
//!                                +-> UNKNOWN                silence: both keys kept, both tried
//! ```
//!
//! A process that ends before the outcome starts again in UNKNOWN, with the keys that are on disk: the caller stores the
//! new key before [`KeyRollover::start`], and makes it the current one on [`Event::Commit`].
//!
//! Order of the parts: `rollover` is the machine, `evidence` draws conclusions from received frames, `send` writes
//! heartbeats and SETUP_SIGNING.

mod evidence;
mod rollover;
mod send;

pub use self::rollover::{
    Event, KeyRollover, KeyRolloverConfig, KeySlot, Outcome, StartError, State,
};
pub use self::send::Transmit;
