//! The MAVLink services of a PX4, as a ground station uses them.
//!
//! Every service is a state machine without socket, clock or randomness: messages and the
//! monotonic time go in (`handle_message`, `handle_timeout`), messages and events come out
//! (`poll_transmit`, `poll_event`), and `poll_timeout` says when to come back. Nothing is sent
//! that was not asked for by the caller or by the other side.
//!
//! Promised for any input:
//! - no call panics, and no queue or table grows past a fixed bound;
//! - a client listens only to the node it was made for, and only to answers addressed to it;
//! - a client takes a message that the caller calls not `fresh` (its signing stamp may be a
//!   replay) for no confirmation of anything: such a message changes nothing;
//! - every operation that was started ends in exactly one final event within a bound that
//!   follows from its `Timing`, as long as `handle_timeout` is called when `poll_timeout` asks.

mod bounded;
pub mod command;
pub mod interval;
pub mod mission;
pub mod param;
pub mod text;

pub use crate::frame::Node;
pub use bounded::Bounded;
