//! An operator at a station, by text commands: the subcommands of `cucs`, and the lines of its scripts.
//!
//! - [`verb`]: what can be requested; [`script`]: several of them in a file;
//! - [`error`]: why one was not carried out, and its exit status; [`file_kind`]: a file for another command;
//! - [`console`]: the operator: station, vehicle, output;
//! - [`configuration`]: the answers of the configuration phase as a table;
//! - [`until`]: the condition of a held command;
//! - [`rights`], [`plans`], [`services`], `controls`, [`held`], [`contingency`], [`payload`]: groups of subcommands;
//! - [`run`]: carries out any of them.

mod argument;
pub(crate) mod configuration;
pub(crate) mod console;
pub(crate) mod contingency;
mod controls;
pub(crate) mod error;
pub(crate) mod file_kind;
pub(crate) mod held;
pub(crate) mod payload;
pub(crate) mod plans;
pub(crate) mod rights;
pub(crate) mod run;
pub(crate) mod script;
pub(crate) mod services;
pub(crate) mod termination;
pub(crate) mod until;
pub(crate) mod verb;
