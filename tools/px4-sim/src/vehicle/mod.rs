//! The whole vehicle: physics, flight stack and services joined, without socket or clock.
//!
//! The parts, each calling only those before it:
//! - [`state`]: what a vehicle is made of, and what every part needs of it.
//! - [`actions`]: what mission items make the payload do.
//! - [`command`]: one command, whichever message brought it.
//! - [`operator`]: operator control, off by default.
//! - [`reports`]: the vehicle's state as messages.
//! - [`plans`]: what uploads change.
//! - [`execute`]: what each command does.
//! - [`ground`]: heights of the ground that it asks for, off by default.
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
