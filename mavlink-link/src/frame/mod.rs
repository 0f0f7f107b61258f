//! MAVLink 2 frames: a checked view over bytes, a stream parser and an encoder.
//!
//! Promised: no input panics, no call allocates, and a [`FrameView`] that comes out of [`Parser`] or
//! [`FrameView::parse`] has a correct checksum, or reports by [`FrameView::is_checked`] that its CRC_EXTRA
//! is unknown. MAVLink 1 is recognised only to be refused, since it cannot be signed. Signatures are read here and
//! verified in [`crate::signing`].
//!
//! Order of the parts: `layout` (fields, constants, checksum), `stamp` (the signature's timestamp), `view` (one frame),
//! `parser` (frames in a stream), `encode`.

mod encode;
mod layout;
mod parser;
mod stamp;
mod view;

pub use self::encode::{EncodeError, encode, encode_raw};
pub use self::layout::{
    CRC_LEN, HEADER_LEN, Header, INCOMPAT_SIGNED, KEY_EXCHANGE_CRC_EXTRA, KEY_EXCHANGE_ID,
    MAX_FRAME, MAX_PAYLOAD, Node, SETUP_SIGNING_ID, SIGNATURE_LEN, STX, STX_V1, TAG_LEN, checksum,
    crc_extra,
};
pub use self::parser::{FrameCounts, Frames, Parser};
pub use self::stamp::Stamp;
pub use self::view::{FrameError, FrameView, Signature, Undecoded, extent};
