//! The air side: it answers, and reports the state of a key.
//!
//! Promised: it sends only answers, except the hint of [`please`](Responder::please); it answers the same bytes with the
//! same bytes; it does not replace a staged key that may have been sent to the autopilot; `next` is on disk before step 4;
//! the work and memory that an attacker can cause are bounded.
//!
//! Step 1 has one effect: a staged key that has *not* been sent to the autopilot is withdrawn, on disk, before
//! step 2 is sent. The initiator replaces its own `next` once it has step 2, so without this the old key could still
//! be installed in the autopilot when the ground no longer has it. Step 1 can be withheld and replayed later,
//! but its counter must be above that of every exchange completed since.
//!
//! Order of the parts: `limits` (rate limits), `cookies` (proof of an address under load), `sessions` (open sessions),
//! `taken` (orders to zeroize), `machine` (the state), `steps` (what each step does), `orders` (how an order is answered).

mod cookies;
mod limits;
mod machine;
mod orders;
mod sessions;
mod steps;
mod taken;

pub use self::machine::{Outbound, Responder, ResponderConfig, ResponderEvent, WindowError};
