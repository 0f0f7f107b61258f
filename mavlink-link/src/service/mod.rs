//! The MAVLink services of a PX4, as a ground station uses them.
//!
//! Every service is a state machine without socket, clock or randomness: messages and the
//! monotonic time are inputs (`handle_message`, `handle_timeout`), messages and events are outputs
//! (`poll_transmit`, `poll_event`), and `poll_timeout` is when `handle_timeout` is next needed. Nothing is sent
//! that the caller or the vehicle did not request.
//!
//! Promised for any input:
//! - no call panics, and no queue or table grows past a fixed bound;
//! - a client accepts messages only of the node it was made for, and only answers addressed to it;
//! - a message that is not `fresh` (its signature may be a replay, see [`Age`](crate::link::Age)) changes nothing;
//! - every operation that was started ends in exactly one final event within a bound that
//!   follows from its `Timing`, as long as `handle_timeout` is called at the time of `poll_timeout`.
//!
//! [`command`] sends commands, [`interval`] requests message rates on top of it, [`mission`] transfers plans, [`param`]
//! reads and sets parameters, [`ftp`] transfers files, [`text`] assembles status texts, [`event`] receives events without
//! loss, [`timesync`] compares the vehicle's clock with ours.

mod bounded;
pub mod command;
pub mod event;
pub mod ftp;
pub mod interval;
pub mod mission;
pub mod param;
pub mod text;
pub mod timesync;

pub use crate::frame::Node;
pub use bounded::Bounded;
