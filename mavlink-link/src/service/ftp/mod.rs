//! Files of the vehicle, by MAVLink FTP (FILE_TRANSFER_PROTOCOL, 110): PX4's logs, parameters' metadata, its SD card.
//!
//! A [`Client`] does one [`Operation`] at a time and ends it by one [`Event::Ended`]. A file is read in order, from its
//! beginning or from where an earlier transfer broke off, and is not reported as done before the vehicle's CRC32 of the
//! whole file agrees with what was delivered.
//!
//! Promised for any peer: at most [`MAX_HELD`] bytes wait out of order and [`MAX_UNREAD`] bytes wait for their reader. An
//! answer that contradicts an earlier one ends the operation with a [`Lie`] that names both.
//!
//! [`payload`]: the bytes; [`path`](FilePath): which paths are allowed; `listing`: the entries of a folder; `operation`:
//! what the caller requests; `client`: runs it; `answers`: handles each answer; `read` and `write`: the two transfers that
//! take more than one answer; `pending`: a request that is repeated.

mod answers;
mod checksum;
mod client;
mod failure;
mod listing;
mod operation;
mod path;
pub mod payload;
mod pending;
mod read;
mod write;

pub use checksum::crc32;
pub use client::Client;
pub use failure::{Failure, Lie};
pub use listing::{Entry, Kind};
pub use operation::{Done, Event, Operation, Resume, StartError};
pub use path::{FilePath, PathError};
pub use pending::Timing;
pub use read::{MAX_HELD, MAX_UNREAD};
pub use write::MAX_WRITE;
