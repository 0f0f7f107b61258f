//! The wrapper around every message: a header of 16 bytes, the data, a checksum.
//!
//! ```text
//!  0  2  reserved: 0, or all ones in Edition 3; ignored on receipt
//!  2  2  length of the data, 1 to 528
//!  4  4  source
//!  8  4  destination
//! 12  2  message type
//! 14  2  properties: bit 15 acknowledgement requested, 14 to 8 IDD version, 7 to 6 checksum style,
//!        5 to 0 reserved: sent as 0, ignored on receipt
//! 16  n  data
//!     c  checksum over all of the above: none, 2 or 4 bytes
//! ```
//!
//! The reserved bits are ignored on receipt because the length does not depend on them: a later
//! edition that gives them a meaning stays readable.
//!
//! Parts: `checksum`, `header` (what a sender fills in, and writing), `frames` (splitting a datagram).

mod checksum;
mod frames;
mod header;

pub use checksum::{ChecksumStyle, Sum16Variant};
pub(crate) use frames::frames_with;
pub use frames::{Frame, Frames, WrapperError, frames};
pub(crate) use header::encode_with;
pub use header::{Envelope, HEADER_BYTES, Header, MAX_DATA, MAX_DATAGRAM, encode};
