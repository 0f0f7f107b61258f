//! The wrapper of Edition 2.5 (clause 3.3.1): a header of 30 bytes, the data, a checksum of 4.
//!
//! ```text
//!  0 10  IDD Version: ASCII, ended by NUL
//! 10  4  Message Instance ID: differs for each message of a type
//! 14  4  Message Type
//! 18  4  Message Length: bytes of the data
//! 22  4  Stream ID: kept for later; sent as 0, ignored on receipt
//! 26  4  Packet Sequence Number: not used; sent as all ones, ignored on receipt
//! 30  n  data
//!     4  Checksum: sum of all bytes before it, modulo 2^32
//! ```
//!
//! The text contradicts itself about the longest data (3.3.1.5: 524 and 538). The limit here is 514, which a datagram
//! of 548 bytes leaves, and which #1304 fills.

use nom::bytes::complete::take;
use nom::number::complete::be_u32;
use nom::{IResult, Parser};

use crate::error::EncodeError;
use crate::wrapper::{MAX_DATAGRAM, WrapperError};

/// Bytes of the header.
pub const HEADER_BYTES: usize = 30;
/// Bytes of the checksum.
pub const TRAILER_BYTES: usize = 4;
/// The maximum bytes of message data.
pub const MAX_DATA: usize = MAX_DATAGRAM - HEADER_BYTES - TRAILER_BYTES;

/// Bytes of the IDD version, its NUL included.
const VERSION_BYTES: usize = 10;
/// What a sender writes as Packet Sequence Number, which is not used.
const NO_SEQUENCE: u32 = 0xFFFF_FFFF;

/// Whether a datagram is of Edition 2.x: later editions begin with two bytes of zeros or ones.
pub const fn is_ed25(datagram: &[u8]) -> bool {
    matches!(datagram, [b'1'..=b'9', ..])
}

/// The IDD version, by which a sender names the layouts of Edition 2.5 (table B1-3; Amendment 1 renumbers them).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Version {
    /// `2.5`: Edition 2.5.
    Ed25,
    /// `7`: the same, as Amendment 1 numbers it.
    Draft25,
    /// `8`: Edition 2. Inferred, since the text of that version was not available.
    Ed2,
    /// `9`: Edition 2 Amendment 1.
    Amendment1,
}

impl Version {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Ed25, Self::Draft25, Self::Ed2, Self::Amendment1];

    /// The text in the wrapper.
    pub const fn text(self) -> &'static str {
        match self {
            Self::Ed25 => "2.5",
            Self::Draft25 => "7",
            Self::Ed2 => "8",
            Self::Amendment1 => "9",
        }
    }

    /// The version with this text.
    pub fn from_text(text: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|version| version.text() == text)
    }

    /// The version in a wrapper; the bytes after the NUL are undefined and ignored.
    fn from_wire(bytes: &[u8]) -> Option<Self> {
        let text = bytes.split(|&byte| byte == 0).next().unwrap_or_default();
        Self::ALL
            .into_iter()
            .find(|version| version.text().as_bytes() == text)
    }
}

/// The header, without length and unused parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Header {
    /// The version.
    pub version: Version,
    /// Message Instance ID: a #1400 refers to it.
    pub instance: u32,
    /// Message Type, such as 42.
    pub message_type: u32,
}

/// A message of a datagram with a valid wrapper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// The header.
    pub header: Header,
    /// The message data: every field, in order.
    pub data: &'a [u8],
    /// The whole message, from the header to the checksum.
    pub bytes: &'a [u8],
}

/// The messages of a datagram, in order.
///
/// A message with a wrong checksum or an unknown version is an error, and the next one follows. If the start of the next
/// one is unknown, the error is the last item. An empty datagram is an error too.
pub fn frames(datagram: &[u8]) -> Frames<'_> {
    Frames {
        datagram,
        offset: 0,
        ended: false,
    }
}

/// See [`frames`].
#[derive(Clone, Debug)]
pub struct Frames<'a> {
    datagram: &'a [u8],
    offset: usize,
    ended: bool,
}

impl<'a> Iterator for Frames<'a> {
    type Item = Result<Frame<'a>, WrapperError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let extent = self.extent();
        if let Ok((_, bytes)) = &extent {
            self.offset += bytes.len();
        }
        // Without its length the start of the next message is unknown.
        self.ended = extent.is_err() || self.offset == self.datagram.len();
        Some(extent.and_then(|(prefix, bytes)| self.check(&prefix, bytes)))
    }
}

impl<'a> Frames<'a> {
    /// Where the next message starts.
    pub const fn offset(&self) -> usize {
        self.offset
    }

    /// The next message's header and all of its bytes, found by its length alone.
    fn extent(&self) -> Result<(Prefix<'a>, &'a [u8]), WrapperError> {
        let offset = self.offset;
        if self.datagram.len() > MAX_DATAGRAM {
            return Err(WrapperError::Oversized {
                offset: MAX_DATAGRAM,
                value: self.datagram.len(),
                expected: MAX_DATAGRAM,
            });
        }
        let rest = &self.datagram[offset..];
        let Ok((_, prefix)) = prefix(rest) else {
            return Err(WrapperError::NoHeader {
                offset,
                value: rest.len(),
                expected: HEADER_BYTES,
            });
        };
        let length = prefix.length as usize;
        if length == 0 || length > MAX_DATA {
            return Err(WrapperError::Length {
                offset: offset + 18,
                value: length,
                expected: MAX_DATA,
            });
        }
        let expected = HEADER_BYTES + length + TRAILER_BYTES;
        match rest.get(..expected) {
            Some(bytes) => Ok((prefix, bytes)),
            None => Err(WrapperError::Truncated {
                offset,
                value: rest.len(),
                expected,
            }),
        }
    }

    fn check(&self, prefix: &Prefix<'a>, bytes: &'a [u8]) -> Result<Frame<'a>, WrapperError> {
        let start = self.offset - bytes.len();
        let (summed, checksum) = bytes.split_at(bytes.len() - TRAILER_BYTES);
        let value = checksum
            .iter()
            .fold(0, |value, &byte| value << 8 | u32::from(byte));
        let expected = sum(summed);
        if value != expected {
            return Err(WrapperError::Checksum {
                offset: start + summed.len(),
                value,
                expected,
            });
        }
        // Checked after the checksum: a damaged version is a damaged message, not another edition.
        let Some(version) = Version::from_wire(prefix.version) else {
            let mut found = [0; VERSION_BYTES];
            found.copy_from_slice(prefix.version);
            return Err(WrapperError::Version {
                offset: start,
                found,
            });
        };
        Ok(Frame {
            header: Header {
                version,
                instance: prefix.instance,
                message_type: prefix.message_type,
            },
            data: &summed[HEADER_BYTES..],
            bytes,
        })
    }
}

/// A header as received, with its length.
struct Prefix<'a> {
    version: &'a [u8],
    instance: u32,
    message_type: u32,
    length: u32,
}

fn prefix(bytes: &[u8]) -> IResult<&[u8], Prefix<'_>> {
    let (rest, (version, instance, message_type, length, _stream, _sequence)) =
        (take(VERSION_BYTES), be_u32, be_u32, be_u32, be_u32, be_u32).parse(bytes)?;
    let prefix = Prefix {
        version,
        instance,
        message_type,
        length,
    };
    Ok((rest, prefix))
}

/// At most 544 bytes are summed, so the sum never reaches 2^32.
fn sum(bytes: &[u8]) -> u32 {
    bytes.iter().map(|&byte| u32::from(byte)).sum()
}

/// Writes wrapper, data and checksum into `out`; returns the number of bytes.
///
/// # Errors
/// The buffer is too small, or the data is longer than fits a datagram.
pub fn encode(header: &Header, data: &[u8], out: &mut [u8]) -> Result<usize, EncodeError> {
    if data.len() > MAX_DATA {
        return Err(EncodeError::TooLong {
            message_type: header.message_type.try_into().unwrap_or(u16::MAX),
            found: data.len(),
            expected: MAX_DATA,
        });
    }
    let end = HEADER_BYTES + data.len();
    let available = out.len();
    let Some(out) = out.get_mut(..end + TRAILER_BYTES) else {
        return Err(EncodeError::BufferTooSmall { available });
    };
    let text = header.version.text().as_bytes();
    out[..VERSION_BYTES].fill(0);
    out[..text.len()].copy_from_slice(text);
    let words = [
        header.instance,
        header.message_type,
        data.len() as u32,
        0,
        NO_SEQUENCE,
    ];
    for (place, word) in out[VERSION_BYTES..HEADER_BYTES]
        .chunks_exact_mut(4)
        .zip(words)
    {
        place.copy_from_slice(&word.to_be_bytes());
    }
    out[HEADER_BYTES..end].copy_from_slice(data);
    let checksum = sum(&out[..end]);
    out[end..].copy_from_slice(&checksum.to_be_bytes());
    Ok(end + TRAILER_BYTES)
}
