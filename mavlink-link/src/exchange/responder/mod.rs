//! The air side: it answers, and says what has become of a key.
//!
//! Promised: it never sends unasked, but for the hint of [`please`](Responder::please); the same bytes are answered
//! with the same bytes; a staged key that the autopilot may have been sent is not replaced; `next` is on disk before
//! step 4; what strangers can make it work and hold is bounded.
//!
//! One thing follows from step 1: a staged key that the autopilot has *not* been sent is withdrawn, on disk, before
//! step 2 goes out. The initiator replaces its own `next` once it has step 2, so without this the old key could still
//! be handed to the autopilot when nobody on the ground has it any more. Step 1 can be withheld and played in later,
//! but its counter must be above that of every exchange completed since.

mod limits;
mod machine;
mod sessions;
mod steps;

pub use self::machine::{
    Inbound, Outbound, Responder, ResponderConfig, ResponderEvent, WindowError,
};
