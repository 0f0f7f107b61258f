//! The whole vehicle: physics, flight stack and services joined, without socket or clock.
//!
//! The parts, each calling only those before it:
//! - [`state`]: the parts of a vehicle, and what all of them need.
//! - [`actions`]: what mission items do with the payload.
//! - [`command`]: one command, from either message.
//! - [`operator`]: operator control, off by default.
//! - [`reports`]: the vehicle's state as messages.
//! - [`plans`]: what uploads change.
//! - [`execute`]: the effect of each command.
//! - [`ground`]: heights of the ground that it requests, off by default.
//! - [`inbox`]: messages in.
//! - [`tick`]: time in; the order of the steps of 4 ms.

pub(crate) mod actions;
pub(crate) mod command;
pub(crate) mod execute;
pub(crate) mod ground;
pub(crate) mod inbox;
pub(crate) mod operator;
pub(crate) mod plans;
pub(crate) mod reports;
pub(crate) mod state;
pub(crate) mod tick;
