//! A checked view over the bytes of one frame.

use mavlink::error::ParserError;
use mavlink::{MavlinkVersion, Message as _};
use thiserror::Error;

use super::layout::{
    CRC_LEN, HEADER_LEN, Header, INCOMPAT_SIGNED, SIGNATURE_LEN, STX, STX_V1, TAG_LEN, checksum,
    crc_extra,
};
use super::stamp::Stamp;
use crate::dialect::MavMessage;

/// The signature trailer of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Signature {
    /// Link id: with system and component it names the sender's stream.
    pub link_id: u8,
    /// The sender's signing clock, in 10 us since 2015-01-01 UTC.
    pub stamp: Stamp,
    /// The first 6 bytes of the keyed hash.
    pub tag: [u8; 6],
}

/// One whole frame, borrowed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameView<'a> {
    bytes: &'a [u8],
    checked: bool,
}

impl<'a> FrameView<'a> {
    /// Reads the frame that starts at the first byte of `bytes`; what follows it is ignored.
    ///
    /// # Errors
    /// Why there is no usable frame at that place.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, FrameError> {
        match examine(bytes) {
            Verdict::Frame(len) => Ok(Self::from_parts(&bytes[..len], true)),
            Verdict::Unchecked(len) => Ok(Self::from_parts(&bytes[..len], false)),
            Verdict::Refused(_, error) => Err(error),
            Verdict::Incomplete => Err(FrameError::Truncated),
            Verdict::Garbage => Err(FrameError::NoFrame),
        }
    }

    /// `bytes` is exactly one frame that [`examine`] has measured.
    pub(super) fn from_parts(bytes: &'a [u8], checked: bool) -> Self {
        debug_assert!(bytes.len() >= HEADER_LEN + CRC_LEN);
        Self { bytes, checked }
    }

    /// The header's fields.
    #[must_use]
    pub fn header(&self) -> Header {
        let b = self.bytes;
        Header {
            incompat: b[2],
            compat: b[3],
            seq: b[4],
            system_id: b[5],
            component_id: b[6],
            message_id: u32::from_le_bytes([b[7], b[8], b[9], 0]),
        }
    }

    /// The payload as on the wire, trailing zeros trimmed by the sender.
    #[must_use]
    pub fn payload(&self) -> &'a [u8] {
        &self.bytes[HEADER_LEN..self.crc_at()]
    }

    /// The checksum as on the wire.
    #[must_use]
    pub fn crc(&self) -> u16 {
        let at = self.crc_at();
        u16::from_le_bytes([self.bytes[at], self.bytes[at + 1]])
    }

    /// False where CRC_EXTRA is unknown: then only a verified signature proves the bytes.
    #[must_use]
    pub fn is_checked(&self) -> bool {
        self.checked
    }

    /// Whether there is a signature trailer; it may be wrong.
    #[must_use]
    pub fn is_signed(&self) -> bool {
        self.bytes[2] & INCOMPAT_SIGNED != 0
    }

    /// The signature trailer, if there is one.
    #[must_use]
    pub fn signature(&self) -> Option<Signature> {
        if !self.is_signed() {
            return None;
        }
        let t = &self.bytes[self.bytes.len() - SIGNATURE_LEN..];
        Some(Signature {
            link_id: t[0],
            stamp: Stamp::from_le_bytes([t[1], t[2], t[3], t[4], t[5], t[6]]),
            tag: [t[7], t[8], t[9], t[10], t[11], t[12]],
        })
    }

    /// What the signature covers after the key: header, payload, checksum, link id and stamp.
    #[must_use]
    pub(crate) fn signed_bytes(&self) -> Option<&'a [u8]> {
        self.is_signed()
            .then(|| &self.bytes[..self.bytes.len() - TAG_LEN])
    }

    /// The whole frame, from the start byte to the last of its checksum or trailer.
    #[must_use]
    pub fn as_bytes(&self) -> &'a [u8] {
        self.bytes
    }

    /// The message, decoded by the dialect.
    ///
    /// # Errors
    /// The dialect does not know the id, or one of its enums does not know a value; the payload can
    /// still be used raw.
    pub fn message(&self) -> Result<MavMessage, Undecoded> {
        let id = self.header().message_id;
        MavMessage::parse(MavlinkVersion::V2, id, self.payload()).map_err(Undecoded::from)
    }

    fn crc_at(&self) -> usize {
        HEADER_LEN + usize::from(self.bytes[1])
    }
}

/// System id and length of the frame that begins at the first byte and is there as a whole, by its header alone: nothing
/// of it is checked. For whoever passes frames on to those that check them.
#[must_use]
pub fn extent(bytes: &[u8]) -> Option<(u8, usize)> {
    let payload = usize::from(*bytes.get(1)?);
    let (system, length) = match *bytes.first()? {
        STX => {
            let signed = *bytes.get(2)? & INCOMPAT_SIGNED != 0;
            let trailer = if signed { SIGNATURE_LEN } else { 0 };
            (5, HEADER_LEN + payload + CRC_LEN + trailer)
        }
        STX_V1 => (3, HEADER_V1_LEN + payload + CRC_LEN),
        _ => return None,
    };
    (length <= bytes.len()).then_some((*bytes.get(system)?, length))
}

/// Bytes of the header of a MAVLink 1 frame, the start byte included.
const HEADER_V1_LEN: usize = 6;

/// Why bytes are not a frame that can be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum FrameError {
    /// The checksum does not match the bytes: noise, or another layout of the message.
    #[error("message {message_id}: checksum {found:#06x}, expected {expected:#06x}")]
    BadCrc {
        /// The message id as read.
        message_id: u32,
        /// The checksum of the bytes as they are.
        expected: u16,
        /// The checksum in the frame.
        found: u16,
    },
    /// An unknown incompatibility flag: by the protocol the frame must not be processed.
    #[error("incompatibility flags {flags:#04x}, expected 0x00 or 0x01")]
    UnknownIncompat {
        /// All incompatibility flags of the frame.
        flags: u8,
    },
    /// A MAVLink 1 frame with a correct checksum: it cannot be signed and is refused.
    #[error("MAVLink 1 frame of message {message_id}, expected MAVLink 2")]
    Mavlink1 {
        /// Its message id, 0 to 255.
        message_id: u8,
    },
    /// An unsigned frame whose CRC_EXTRA is unknown: nothing proves its bytes.
    #[error("unsigned message {message_id} is not in the dialect and cannot be checked")]
    UnknownId {
        /// The message id as read.
        message_id: u32,
    },
    /// The bytes end inside the frame.
    #[error("the bytes end inside a frame")]
    Truncated,
    /// The bytes do not start with a frame.
    #[error("no frame starts here")]
    NoFrame,
}

/// Why a correct frame cannot be decoded by the dialect; its payload can be used raw.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Undecoded {
    /// The dialect has no such message.
    #[error("message {0} is not in the dialect")]
    UnknownId(u32),
    /// An enum of the dialect has no such value: the sender is newer.
    #[error("{enum_type} has no value {value}")]
    UnknownValue {
        /// The dialect's name of the enum.
        enum_type: &'static str,
        /// The value on the wire.
        value: u64,
    },
    /// The payload does not have the size the dialect expects.
    #[error("the payload's size is not that of the dialect's message")]
    Size,
}

impl From<ParserError> for Undecoded {
    fn from(error: ParserError) -> Self {
        match error {
            ParserError::UnknownMessage { id } => Self::UnknownId(id),
            ParserError::InvalidEnum { enum_type, value } => {
                Self::UnknownValue { enum_type, value }
            }
            ParserError::InvalidPayloadSize { .. } | ParserError::BytesError(_) => Self::Size,
        }
    }
}

/// What begins at the first byte of a slice.
pub(super) enum Verdict {
    /// A frame of this length with a correct checksum.
    Frame(usize),
    /// A signed frame of this length whose CRC_EXTRA is unknown.
    Unchecked(usize),
    /// A frame that is refused, and how many bytes to skip.
    Refused(usize, FrameError),
    /// Possibly a frame whose end is missing.
    Incomplete,
    /// Nothing; the next byte may start a frame.
    Garbage,
}

/// Examines the candidate at the first byte.
///
/// Only for a frame that could be used in the end is the missing rest worth waiting for. Otherwise a start byte in
/// noise would delay the good frames behind it.
pub(super) fn examine(bytes: &[u8]) -> Verdict {
    match bytes.first() {
        None => Verdict::Incomplete,
        Some(&STX) => examine_v2(bytes),
        Some(&STX_V1) => examine_v1(bytes),
        Some(_) => Verdict::Garbage,
    }
}

fn examine_v2(bytes: &[u8]) -> Verdict {
    if bytes.len() < HEADER_LEN {
        return Verdict::Incomplete;
    }
    let flags = bytes[2];
    let signed = flags & INCOMPAT_SIGNED != 0;
    // A signed frame's trailer counts as part of its extent, so a candidate in noise with this flag claims 13 bytes more.
    let message_id = u32::from_le_bytes([bytes[7], bytes[8], bytes[9], 0]);
    let crc_at = HEADER_LEN + usize::from(bytes[1]);
    let len = crc_at + CRC_LEN + if signed { SIGNATURE_LEN } else { 0 };
    let whole = bytes.len() >= len;
    let known_flags = flags & !INCOMPAT_SIGNED == 0;

    // Without CRC_EXTRA the checksum proves nothing. A signature still can, so a signed frame is passed on unchecked; the
    // receiver verifies it before use. Unsigned, it is indistinguishable from noise.
    let Some(extra) = crc_extra(message_id) else {
        return match (known_flags, signed, whole) {
            (true, true, true) => Verdict::Unchecked(len),
            (true, true, false) => Verdict::Incomplete,
            // One byte only: the real frame may begin inside this candidate.
            (true, false, true) => Verdict::Refused(1, FrameError::UnknownId { message_id }),
            _ => Verdict::Garbage,
        };
    };
    // A frame with unknown flags is refused in any case, so its end is not worth waiting for.
    if !whole {
        return if known_flags {
            Verdict::Incomplete
        } else {
            Verdict::Garbage
        };
    }
    let expected = checksum(&bytes[1..crc_at], extra);
    let found = u16::from_le_bytes([bytes[crc_at], bytes[crc_at + 1]]);
    match (known_flags, expected == found) {
        (true, true) => Verdict::Frame(len),
        (true, false) => Verdict::Refused(
            1,
            FrameError::BadCrc {
                message_id,
                expected,
                found,
            },
        ),
        // The checksum shows where the frame ends, so nothing inside it is searched for another.
        (false, true) => Verdict::Refused(len, FrameError::UnknownIncompat { flags }),
        (false, false) => Verdict::Garbage,
    }
}

fn examine_v1(bytes: &[u8]) -> Verdict {
    let Some(&payload_len) = bytes.get(1) else {
        // Garbage and not incomplete, for the reason given below.
        return Verdict::Garbage;
    };
    let crc_at = HEADER_V1_LEN + usize::from(payload_len);
    let len = crc_at + CRC_LEN;
    // Never waited for: MAVLink 1 is refused anyway, and a 0xfe in noise would hold back good frames.
    if bytes.len() < len {
        return Verdict::Garbage;
    }
    let message_id = bytes[5];
    let found = u16::from_le_bytes([bytes[crc_at], bytes[crc_at + 1]]);
    match crc_extra(u32::from(message_id)) {
        Some(extra) if checksum(&bytes[1..crc_at], extra) == found => {
            Verdict::Refused(len, FrameError::Mavlink1 { message_id })
        }
        _ => Verdict::Garbage,
    }
}
