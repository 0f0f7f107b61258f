//! The 251 bytes of FILE_TRANSFER_PROTOCOL.payload: a header of 12 and up to 239 of data.

use mavlink::dialects::development::{FILE_TRANSFER_PROTOCOL_DATA, MavMessage};
use num_traits::FromPrimitive as _;

pub use mavlink::dialects::development::{MavFtpErr as FtpError, MavFtpOpcode as Opcode};

use crate::frame::Node;

/// Bytes of FILE_TRANSFER_PROTOCOL.payload.
pub const LENGTH: usize = 251;
/// Largest data of one message, bytes.
pub const MAX_DATA: usize = LENGTH - HEADER;
const HEADER: usize = 12;

/// A request or an answer.
#[derive(Clone, PartialEq, Eq, Debug)]
pub struct Payload {
    /// Number of the request; an answer has the next one, and each packet of a burst one more.
    pub seq: u16,
    /// The session that Open or Create has answered with.
    pub session: u8,
    /// MAV_FTP_OPCODE, raw: an answer is 128 (ACK) or 129 (NAK).
    pub opcode: u8,
    /// Of data; a ReadFile has the size requested here, and no data.
    pub size: u8,
    /// Of an answer: the opcode of its request.
    pub requested: u8,
    /// The last packet of a burst. PX4 leaves it uninitialised in some packets: a hint, no proof.
    pub burst_complete: bool,
    /// Of the file in bytes, or of the directory in entries.
    pub offset: u32,
    /// Room for the data; what is beyond `size` is none.
    pub bytes: [u8; MAX_DATA],
}

/// A payload that does not fit its own lengths.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum PayloadError {
    /// The data would reach beyond the message.
    #[error("a payload announces {0} bytes of data: expected at most {MAX_DATA}")]
    Size(u8),
}

impl Payload {
    /// A request without data.
    #[must_use]
    pub fn request(seq: u16, opcode: Opcode) -> Self {
        Self {
            seq,
            session: 0,
            opcode: opcode as u8,
            size: 0,
            requested: 0,
            burst_complete: false,
            offset: 0,
            bytes: [0; MAX_DATA],
        }
    }

    /// The same with data: at most [`MAX_DATA`] bytes, the rest is cut off.
    #[must_use]
    pub fn with_data(mut self, data: &[u8]) -> Self {
        let length = data.len().min(MAX_DATA);
        self.bytes = [0; MAX_DATA];
        self.bytes[..length].copy_from_slice(&data[..length]);
        // At most 239.
        self.size = length as u8;
        self
    }

    /// From FILE_TRANSFER_PROTOCOL.payload.
    ///
    /// # Errors
    /// The data would reach beyond the message.
    pub fn decode(bytes: &[u8; LENGTH]) -> Result<Self, PayloadError> {
        let [
            s0,
            s1,
            session,
            opcode,
            size,
            requested,
            burst,
            _,
            o0,
            o1,
            o2,
            o3,
            rest @ ..,
        ] = bytes;
        if usize::from(*size) > MAX_DATA {
            return Err(PayloadError::Size(*size));
        }
        Ok(Self {
            seq: u16::from_le_bytes([*s0, *s1]),
            session: *session,
            opcode: *opcode,
            size: *size,
            requested: *requested,
            burst_complete: *burst != 0,
            offset: u32::from_le_bytes([*o0, *o1, *o2, *o3]),
            bytes: *rest,
        })
    }

    /// As FILE_TRANSFER_PROTOCOL.payload.
    #[must_use]
    pub fn encode(&self) -> [u8; LENGTH] {
        let mut bytes = [0; LENGTH];
        bytes[..2].copy_from_slice(&self.seq.to_le_bytes());
        bytes[2] = self.session;
        bytes[3] = self.opcode;
        bytes[4] = self.size;
        bytes[5] = self.requested;
        bytes[6] = u8::from(self.burst_complete);
        bytes[8..HEADER].copy_from_slice(&self.offset.to_le_bytes());
        bytes[HEADER..].copy_from_slice(&self.bytes);
        bytes
    }

    /// As a message to `to`.
    #[must_use]
    pub fn message(&self, to: Node) -> MavMessage {
        MavMessage::FILE_TRANSFER_PROTOCOL(FILE_TRANSFER_PROTOCOL_DATA {
            target_network: 0,
            target_system: to.system,
            target_component: to.component,
            payload: self.encode(),
        })
    }

    /// Its data.
    #[must_use]
    pub fn data(&self) -> &[u8] {
        self.bytes.get(..usize::from(self.size)).unwrap_or_default()
    }

    /// The four bytes that answer Open, Write and CalcFileCRC32.
    #[must_use]
    pub fn number(&self) -> Option<u32> {
        Some(u32::from_le_bytes(self.data().try_into().ok()?))
    }

    /// The opcode, where it is one.
    #[must_use]
    pub fn opcode(&self) -> Option<Opcode> {
        Opcode::from_u8(self.opcode)
    }

    /// Of a NAK: the error as the dialect names it (an unknown one is FAIL), and the vehicle's errno where it sends one.
    #[must_use]
    pub fn error(&self) -> (FtpError, Option<u8>) {
        let code = self.data().first().copied().unwrap_or_default();
        let error = FtpError::from_u8(code).unwrap_or(FtpError::MAV_FTP_ERR_FAIL);
        let errno = (error == FtpError::MAV_FTP_ERR_FAILERRNO)
            .then(|| self.data().get(1).copied())
            .flatten();
        (error, errno)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn the_header_stands_where_px4_has_it() {
        let payload = Payload {
            session: 3,
            offset: 0x0403_0201,
            ..Payload::request(0x0a09, Opcode::MAV_FTP_OPCODE_WRITEFILE).with_data(b"xyz")
        };
        let bytes = payload.encode();
        assert_eq!(
            bytes[..15],
            [9, 10, 3, 7, 3, 0, 0, 0, 1, 2, 3, 4, b'x', b'y', b'z']
        );
    }

    #[test]
    fn more_data_than_a_message_holds_is_refused() {
        let mut bytes = [0; LENGTH];
        bytes[4] = 239;
        assert_eq!(Payload::decode(&bytes).unwrap().data().len(), 239);
        bytes[4] = 240;
        assert_eq!(Payload::decode(&bytes), Err(PayloadError::Size(240)));
    }

    proptest! {
        #[test]
        fn what_is_encoded_is_decoded(
            seq: u16, session: u8, opcode: u8, requested: u8, burst_complete: bool, offset: u32,
            data in prop::collection::vec(any::<u8>(), 0..=MAX_DATA),
        ) {
            let payload = Payload {
                session, opcode, requested, burst_complete, offset,
                ..Payload::request(seq, Opcode::MAV_FTP_OPCODE_NONE).with_data(&data)
            };
            prop_assert_eq!(Payload::decode(&payload.encode()), Ok(payload));
        }
    }
}
