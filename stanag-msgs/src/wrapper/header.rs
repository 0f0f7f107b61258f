//! Header and envelope, and writing a message with its wrapper.

use super::checksum::{ChecksumStyle, Sum16Variant};
use crate::error::EncodeError;
use crate::id::Id;

/// The maximum bytes of a datagram: 576 (what every IPv4 host accepts) less the headers of IP and UDP.
pub const MAX_DATAGRAM: usize = 548;
/// Bytes of the header.
pub const HEADER_BYTES: usize = 16;
/// The maximum bytes of message data: a datagram less header and longest checksum.
pub const MAX_DATA: usize = 528;

/// Bit 15 of the Message Properties.
pub(super) const ACK_REQUESTED: u16 = 0x8000;

/// The header, without length and reserved parts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Header {
    /// The sender: the vehicle's id on the downlink, the CUCS's on the uplink.
    pub source: Id,
    /// The receiver, or [`Id::BROADCAST`].
    pub destination: Id,
    /// The Message Type, such as 4000.
    pub message_type: u16,
    /// Whether the sender requests a 17000.
    pub ack_requested: bool,
    /// The version of the interface: 30 for Edition 3 to 32 for Edition 4.
    pub idd: u8,
    /// The checksum of the message.
    pub checksum: ChecksumStyle,
}

impl Header {
    /// The IDD version of Edition 3.
    pub const IDD_ED3: u8 = 30;
    /// The IDD version of Edition 4.
    pub const IDD_ED4: u8 = 32;

    /// The header without the message type.
    pub const fn envelope(&self) -> Envelope {
        Envelope {
            source: self.source,
            destination: self.destination,
            ack_requested: self.ack_requested,
            idd: self.idd,
            checksum: self.checksum,
        }
    }

    /// The Message Properties word.
    pub const fn properties(&self) -> u16 {
        let ack = if self.ack_requested { ACK_REQUESTED } else { 0 };
        ack | (self.idd as u16 & 0x7F) << 8 | (self.checksum.code() as u16) << 6
    }
}

/// What a sender adds to a message: the header without the message type.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Envelope {
    /// The sender.
    pub source: Id,
    /// The receiver, or [`Id::BROADCAST`].
    pub destination: Id,
    /// Whether a 17000 is requested.
    pub ack_requested: bool,
    /// The version of the interface, 30 to 32.
    pub idd: u8,
    /// The checksum of the message.
    pub checksum: ChecksumStyle,
}

impl Envelope {
    /// An envelope of Edition 4 without acknowledgement request and checksum.
    pub const fn new(source: Id, destination: Id) -> Self {
        Self {
            source,
            destination,
            ack_requested: false,
            idd: Header::IDD_ED4,
            checksum: ChecksumStyle::None,
        }
    }

    /// The same envelope, with an acknowledgement requested.
    pub const fn requesting_ack(mut self) -> Self {
        self.ack_requested = true;
        self
    }

    /// The same envelope, with this checksum.
    pub const fn summed(mut self, checksum: ChecksumStyle) -> Self {
        self.checksum = checksum;
        self
    }

    /// The header for a message of this type.
    pub const fn header(&self, message_type: u16) -> Header {
        Header {
            source: self.source,
            destination: self.destination,
            message_type,
            ack_requested: self.ack_requested,
            idd: self.idd,
            checksum: self.checksum,
        }
    }
}

/// Writes wrapper, data and checksum into `out`; returns the number of bytes. `data` writes the message data into the
/// buffer that it is given, and returns its number of bytes.
///
/// # Errors
/// The buffer is too small, the data too long, the version or checksum undefined; or `data` fails.
pub fn encode(
    message_type: u16,
    envelope: &Envelope,
    out: &mut [u8],
    data: impl FnOnce(&mut [u8]) -> Result<usize, EncodeError>,
) -> Result<usize, EncodeError> {
    encode_with(Sum16Variant::Sum, message_type, envelope, out, data)
}

/// [`encode`] with a choice of what checksum style 1 means.
pub(crate) fn encode_with(
    variant: Sum16Variant,
    message_type: u16,
    envelope: &Envelope,
    out: &mut [u8],
    data: impl FnOnce(&mut [u8]) -> Result<usize, EncodeError>,
) -> Result<usize, EncodeError> {
    let idd = envelope.idd;
    if !(Header::IDD_ED3..=Header::IDD_ED4).contains(&idd) {
        return Err(EncodeError::Idd { idd });
    }
    if idd == Header::IDD_ED3 && envelope.checksum == ChecksumStyle::Crc32 {
        return Err(EncodeError::ChecksumStyle { idd });
    }
    let available = out.len();
    let too_small = EncodeError::BufferTooSmall { available };
    let (head, body) = out
        .split_first_chunk_mut::<HEADER_BYTES>()
        .ok_or(too_small)?;
    let length = data(body)?;
    if length > MAX_DATA {
        return Err(EncodeError::TooLong {
            message_type,
            found: length,
            expected: MAX_DATA,
        });
    }
    // Edition 3 calls this word Sequence #, unused: all ones. Edition 4 reserves it: 0.
    let reserved: u16 = if idd == Header::IDD_ED3 { 0xFFFF } else { 0 };
    head[0..2].copy_from_slice(&reserved.to_be_bytes());
    head[2..4].copy_from_slice(&(length as u16).to_be_bytes());
    head[4..8].copy_from_slice(&envelope.source.0.to_be_bytes());
    head[8..12].copy_from_slice(&envelope.destination.0.to_be_bytes());
    head[12..14].copy_from_slice(&message_type.to_be_bytes());
    head[14..16].copy_from_slice(&envelope.header(message_type).properties().to_be_bytes());

    let end = HEADER_BYTES + length;
    let bytes = envelope.checksum.bytes();
    if bytes == 0 {
        return Ok(end);
    }
    let sum = envelope.checksum.of(variant, &out[..end]).to_be_bytes();
    let place = out.get_mut(end..end + bytes).ok_or(too_small)?;
    place.copy_from_slice(&sum[sum.len() - bytes..]);
    Ok(end + bytes)
}
