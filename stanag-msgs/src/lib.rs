#![doc = include_str!("../README.md")]
//!
//! ## How the crate is built
//!
//! From the bottom, each module using only those before it:
//!
//! | module | what it is |
//! |---|---|
//! | [`bytes`], [`field`], [`id`] | taking and putting bytes; what a type must do to be a field; identification numbers |
//! | [`scalar`], [`enums`] | the types of fields |
//! | [`error`] | why message data cannot be read or written |
//! | [`wrapper`] | header and checksum; splitting a datagram |
//! | [`table`], [`messages`] | one row a message, and the structs made of them |
//! | [`ed25`] | the wrapper and the table of Edition 2.5 |
//! | [`packer`] | several messages in one datagram |
//! | [`disputed`], [`profile`] | what sources disagree about, and a peer's reading of it |
//! | `guard` (a feature) | the trailer that authenticates a datagram between two guards |
//! | [`json`], [`pcapng`] | messages as JSON; datagrams as a capture file |
//! | [`klv`] | the metadata of a video, MISB ST 0601 |
//!
//! Everything is a pure function of bytes: no clock, no I/O, and no allocation in the codec of the DLI.

#![forbid(unsafe_code)]

pub mod bytes;
pub mod disputed;
pub mod ed25;
pub mod enums;
pub mod error;
pub mod field;
#[cfg(feature = "guard")]
pub mod guard;
pub mod id;
#[cfg(feature = "json")]
pub mod json;
pub mod klv;
pub mod packer;
#[cfg(feature = "pcapng")]
pub mod pcapng;
pub mod profile;
pub mod scalar;
pub mod table;
pub mod wrapper;

pub use error::{DecodeError, EncodeError};
pub use id::Id;
pub use packer::Packer;
pub use profile::Profile;
pub use scalar::{Bam16, Bam32, I24, OutOfRange, Scaled, Text, TimeStamp, U24, U40};
pub use table::{Message, messages};
pub use wrapper::{ChecksumStyle, Envelope, Frame, Header, MAX_DATAGRAM, WrapperError, frames};
