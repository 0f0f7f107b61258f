//! Splitting a datagram into messages.

use nom::number::complete::{be_u16, be_u32};
use nom::{IResult, Parser};

use super::checksum::{ChecksumStyle, Sum16Variant};
use super::header::{ACK_REQUESTED, HEADER_BYTES, Header, MAX_DATA, MAX_DATAGRAM};
use crate::id::Id;

/// A message of a datagram with a valid wrapper.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Frame<'a> {
    /// The header.
    pub header: Header,
    /// The message data: presence vector and fields.
    pub data: &'a [u8],
    /// The whole message, from the header to the checksum.
    pub bytes: &'a [u8],
}

/// Why a part of a datagram is not a message. `offset` counts from the start of the datagram.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WrapperError {
    /// The datagram is longer than allowed.
    #[error("offset {offset}: a datagram of {value} bytes, expected at most {expected}")]
    Oversized {
        /// Where the excess bytes start.
        offset: usize,
        /// Bytes of the datagram.
        value: usize,
        /// The maximum.
        expected: usize,
    },
    /// There is no room for a header.
    #[error("offset {offset}: {value} bytes, expected a header of {expected}")]
    NoHeader {
        /// Where the header should start.
        offset: usize,
        /// Bytes available.
        value: usize,
        /// Bytes of a header.
        expected: usize,
    },
    /// The Message Length is impossible.
    #[error("offset {offset}: message length {value}, expected 1 to {expected}")]
    Length {
        /// Where the length is.
        offset: usize,
        /// The length.
        value: usize,
        /// The maximum.
        expected: usize,
    },
    /// The datagram ends within data or checksum.
    #[error("offset {offset}: {value} bytes, expected a message of {expected}")]
    Truncated {
        /// Where the message starts.
        offset: usize,
        /// Bytes available.
        value: usize,
        /// Bytes by header and checksum style.
        expected: usize,
    },
    /// The wrapper is not defined for this interface version.
    #[error(
        "offset {offset}: IDD version {value}, expected {} to {expected}",
        Header::IDD_ED3
    )]
    Idd {
        /// Where the version is.
        offset: usize,
        /// The version.
        value: u8,
        /// The maximum known.
        expected: u8,
    },
    /// A version of Edition 2.x whose layouts are not known.
    #[error("offset {offset}: IDD version {:?}, expected 2.5, 7, 8 or 9", found.escape_ascii().to_string().trim_end_matches("\\x00"))]
    Version {
        /// Where the version is.
        offset: usize,
        /// The version, padded with NUL.
        found: [u8; 10],
    },
    /// A checksum style that the edition does not have.
    #[error(
        "offset {offset}: checksum style {value} in IDD version {}, expected 0 to {expected}",
        Header::IDD_ED3
    )]
    ChecksumStyle {
        /// Where the style is.
        offset: usize,
        /// The style.
        value: u8,
        /// The maximum of the edition.
        expected: u8,
    },
    /// The checksum is wrong.
    #[error("offset {offset}: checksum {value:#x}, expected {expected:#x}")]
    Checksum {
        /// Where the checksum is.
        offset: usize,
        /// The checksum received.
        value: u32,
        /// The checksum of what was received.
        expected: u32,
    },
}

impl WrapperError {
    /// Where it is, in bytes of the datagram.
    pub const fn offset(&self) -> usize {
        match *self {
            Self::Oversized { offset, .. }
            | Self::NoHeader { offset, .. }
            | Self::Length { offset, .. }
            | Self::Truncated { offset, .. }
            | Self::Idd { offset, .. }
            | Self::Version { offset, .. }
            | Self::ChecksumStyle { offset, .. }
            | Self::Checksum { offset, .. } => offset,
        }
    }

    /// The name of the reason, for a counter.
    pub const fn reason(&self) -> &'static str {
        match self {
            Self::Oversized { .. } => "oversized",
            Self::NoHeader { .. } | Self::Truncated { .. } => "truncated",
            Self::Length { .. } => "length",
            Self::Idd { .. } | Self::Version { .. } => "idd",
            Self::ChecksumStyle { .. } => "checksum_style",
            Self::Checksum { .. } => "checksum",
        }
    }
}

/// The messages of a datagram, in order.
///
/// A message with a wrong checksum or IDD version is an error, and the next one follows. If the
/// start of the next one is unknown, the error is the last item. An empty datagram is an error too.
pub fn frames(datagram: &[u8]) -> Frames<'_> {
    frames_with(Sum16Variant::Sum, datagram)
}

/// [`frames`] with a choice of what checksum style 1 means.
pub(crate) fn frames_with(variant: Sum16Variant, datagram: &[u8]) -> Frames<'_> {
    Frames {
        variant,
        datagram,
        offset: 0,
        ended: false,
    }
}

/// See [`frames`].
#[derive(Clone, Debug)]
pub struct Frames<'a> {
    variant: Sum16Variant,
    datagram: &'a [u8],
    offset: usize,
    ended: bool,
}

impl Frames<'_> {
    /// The source of the next message, by its header: the caller chooses that peer's reading of checksum style 1.
    #[must_use]
    pub fn next_source(&self) -> Option<Id> {
        let header = self.datagram.get(self.offset..)?;
        let source = header.get(4..8)?.first_chunk()?;
        Some(Id(u32::from_be_bytes(*source)))
    }

    /// What checksum style 1 means from the next message on.
    pub(crate) fn read_style_1(&mut self, variant: Sum16Variant) {
        self.variant = variant;
    }
}

impl<'a> Iterator for Frames<'a> {
    type Item = Result<Frame<'a>, WrapperError>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.ended {
            return None;
        }
        let outcome = self.extent().and_then(|(prefix, bytes)| {
            self.offset += bytes.len();
            self.check(prefix, bytes)
        });
        // After these errors the start of the next message is unknown: the length itself is in doubt, or the style
        // that gives the checksum's length.
        self.ended = match outcome {
            Err(
                WrapperError::Oversized { .. }
                | WrapperError::NoHeader { .. }
                | WrapperError::Length { .. }
                | WrapperError::Truncated { .. }
                | WrapperError::ChecksumStyle { .. },
            ) => true,
            _ => self.offset == self.datagram.len(),
        };
        Some(outcome)
    }
}

impl<'a> Frames<'a> {
    /// Where the next message starts.
    pub const fn offset(&self) -> usize {
        self.offset
    }

    /// The next message's header and all of its bytes, found by length and checksum style alone.
    fn extent(&self) -> Result<(Prefix, &'a [u8]), WrapperError> {
        let offset = self.offset;
        if self.datagram.len() > MAX_DATAGRAM {
            let value = self.datagram.len();
            return Err(WrapperError::Oversized {
                offset: MAX_DATAGRAM,
                value,
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
        let length = usize::from(prefix.length);
        if length == 0 || length > MAX_DATA {
            let offset = offset + 2;
            return Err(WrapperError::Length {
                offset,
                value: length,
                expected: MAX_DATA,
            });
        }
        let expected = HEADER_BYTES + length + prefix.header.checksum.bytes();
        match rest.get(..expected) {
            Some(bytes) => Ok((prefix, bytes)),
            None => Err(WrapperError::Truncated {
                offset,
                value: rest.len(),
                expected,
            }),
        }
    }

    fn check(&self, prefix: Prefix, bytes: &'a [u8]) -> Result<Frame<'a>, WrapperError> {
        let Header { idd, checksum, .. } = prefix.header;
        let start = self.offset - bytes.len();
        if !(Header::IDD_ED3..=Header::IDD_ED4).contains(&idd) {
            return Err(WrapperError::Idd {
                offset: start + 14,
                value: idd,
                expected: Header::IDD_ED4,
            });
        }
        // Edition 3 defines styles 0 to 2 only.
        if idd == Header::IDD_ED3 && checksum == ChecksumStyle::Crc32 {
            let (value, expected) = (checksum.code(), ChecksumStyle::Sum32.code());
            return Err(WrapperError::ChecksumStyle {
                offset: start + 15,
                value,
                expected,
            });
        }
        let (summed, sum) = bytes.split_at(bytes.len() - checksum.bytes());
        let value = sum
            .iter()
            .fold(0, |value, &byte| value << 8 | u32::from(byte));
        let expected = checksum.of(self.variant, summed);
        if value != expected {
            return Err(WrapperError::Checksum {
                offset: start + summed.len(),
                value,
                expected,
            });
        }
        Ok(Frame {
            header: prefix.header,
            data: &summed[HEADER_BYTES..],
            bytes,
        })
    }
}

/// A header as received, with its length.
struct Prefix {
    length: u16,
    header: Header,
}

fn prefix(bytes: &[u8]) -> IResult<&[u8], Prefix> {
    let (rest, (_reserved, length, source, destination, message_type, properties)) =
        (be_u16, be_u16, be_u32, be_u32, be_u16, be_u16).parse(bytes)?;
    let header = Header {
        source: Id(source),
        destination: Id(destination),
        message_type,
        ack_requested: properties & ACK_REQUESTED != 0,
        idd: (properties >> 8 & 0x7F) as u8,
        checksum: ChecksumStyle::from_code((properties >> 6) as u8),
    };
    Ok((rest, Prefix { length, header }))
}
