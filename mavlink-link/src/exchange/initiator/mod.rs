//! The ground side: it starts the exchange, and follows a key until the vehicle signs with it.
//!
//! ```text
//! idle -> asking (step 1 out) -> confirming (step 3 out) -> following (step 4 in) -> idle
//!            |                        |                          until the key is in use,
//!            +----- given up ---------+--> a pause, then again   rolled back, or cannot be
//! ```
//!
//! Promised: `next` is on disk before step 3 is sent; a `next` on disk is replaced only once the responder can no longer
//! install the old one; nothing changes without proof by the peer's keys.
//!
//! Order of the parts: `attempt` (one attempt and its timing), `ordering` (an order to zeroize and its timing), `machine`
//! (the state), `steps` (what each step does), `orders` (how an order is sent and its report read).

mod attempt;
mod machine;
mod ordering;
mod orders;
mod steps;

pub use self::machine::{Initiator, InitiatorConfig, InitiatorEvent, KeyInForce, Trust};
