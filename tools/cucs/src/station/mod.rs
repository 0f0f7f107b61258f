//! A session on a UDP socket, and the operations of an operator.
//!
//! - [`outcome`]: how an operation ends;
//! - [`report`]: the state of a vehicle as a line and as JSON;
//! - [`endpoint`]: the station itself: the socket, and waiting for something with a time limit;
//! - [`rights`], [`command`], [`held`], [`plan`], [`payload`]: its operations, by the messages that they send.

pub(crate) mod command;
pub(crate) mod endpoint;
pub(crate) mod held;
pub(crate) mod outcome;
pub(crate) mod payload;
pub(crate) mod plan;
pub(crate) mod report;
pub(crate) mod rights;
