//! The ground side: it begins, and follows a key until the vehicle signs with it.
//!
//! ```text
//! idle -> asking (step 1 out) -> confirming (step 3 out) -> following (step 4 in) -> idle
//!            |                        |                          until the key is in use,
//!            +----- given up ---------+--> a pause, then anew    rolled back, or cannot be
//! ```
//!
//! Promised: `next` is on disk before step 3 leaves; a `next` on disk is replaced only once the responder can no longer
//! hand the old one to the autopilot; nothing that is not proven by the peer's keys changes anything.

mod attempt;
mod machine;
mod steps;

pub use self::machine::{Initiator, InitiatorConfig, InitiatorEvent, Trust};
