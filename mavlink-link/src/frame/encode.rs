//! Encoding into the caller's buffer, trailing zeros of the payload trimmed.

use mavlink::{MavlinkVersion, Message as _};
use thiserror::Error;

use super::layout::{
    CRC_LEN, HEADER_LEN, Header, MAX_FRAME, MAX_PAYLOAD, STX, checksum, crc_extra,
};
use crate::dialect::MavMessage;

/// Writes `msg` as an unsigned frame and returns its length.
///
/// `header.message_id` is taken from `msg`. Where `header.incompat` has
/// [`INCOMPAT_SIGNED`](super::INCOMPAT_SIGNED), the frame is ready for [`crate::signing::sign`], which
/// appends the trailer that the flag promises.
pub fn encode(msg: &MavMessage, header: Header, out: &mut [u8; MAX_FRAME]) -> usize {
    let message_id = msg.message_id();
    let payload = &mut out[HEADER_LEN..HEADER_LEN + MAX_PAYLOAD];
    let len = msg.ser(MavlinkVersion::V2, payload);
    close(
        Header {
            message_id,
            ..header
        },
        len,
        MavMessage::extra_crc(message_id),
        out,
    )
}

/// Writes a payload given as bytes, for a message whose CRC_EXTRA is known ([`crc_extra`]).
///
/// # Errors
/// The payload is longer than 255 bytes, or the message is unknown.
pub fn encode_raw(
    header: Header,
    payload: &[u8],
    out: &mut [u8; MAX_FRAME],
) -> Result<usize, EncodeError> {
    if payload.len() > MAX_PAYLOAD {
        return Err(EncodeError::TooLong { len: payload.len() });
    }
    let extra = crc_extra(header.message_id).ok_or(EncodeError::UnknownId {
        message_id: header.message_id,
    })?;
    // MAVLink 2 trims trailing zeros but keeps at least one byte, also of an all-zero payload.
    let zeros = payload.iter().rev().take_while(|&&byte| byte == 0).count();
    let len = payload
        .len()
        .saturating_sub(zeros)
        .max(payload.len().min(1));
    out[HEADER_LEN..HEADER_LEN + len].copy_from_slice(&payload[..len]);
    Ok(close(header, len, extra, out))
}

/// Why bytes cannot be framed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum EncodeError {
    /// More bytes than a frame holds.
    #[error("a payload of {len} bytes, expected at most 255")]
    TooLong {
        /// Bytes given.
        len: usize,
    },
    /// Without CRC_EXTRA no receiver would accept the frame.
    #[error("message {message_id} has no known CRC_EXTRA")]
    UnknownId {
        /// The message id given.
        message_id: u32,
    },
}

/// Puts header and checksum around a payload of `len` bytes that already stands in `out`.
fn close(header: Header, len: usize, extra: u8, out: &mut [u8; MAX_FRAME]) -> usize {
    let id = header.message_id.to_le_bytes();
    out[0] = STX;
    out[1] = u8::try_from(len).unwrap_or(u8::MAX);
    out[2] = header.incompat;
    out[3] = header.compat;
    out[4] = header.seq;
    out[5] = header.system_id;
    out[6] = header.component_id;
    out[7..HEADER_LEN].copy_from_slice(&id[..3]);
    let crc_at = HEADER_LEN + len;
    let crc = checksum(&out[1..crc_at], extra);
    out[crc_at..crc_at + CRC_LEN].copy_from_slice(&crc.to_le_bytes());
    crc_at + CRC_LEN
}
