//! The bridge: any STANAG 4586 ground station flies any PX4.
//!
//! - [`config`]: the configuration file.
//! - [`session`]: sans-I/O machines that know time.
//! - [`shell`]: sockets, files, clocks, the log.

#![forbid(unsafe_code)]

pub mod config;
pub mod session;
pub mod shell;
