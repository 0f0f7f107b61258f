//! Recordings of a link in QGroundControl's format that can be passed on safely.
//!
//! Promised: a record holds no key and nothing that a signed vehicle accepts (pitfall 20: PX4 accepts an old signed
//! frame after its restart). SETUP_SIGNING is blanked; of a signed frame the flag is cleared, the trailer removed and the
//! checksum computed again.

use core::time::Duration;

use crate::frame::{
    CRC_LEN, FrameView, HEADER_LEN, INCOMPAT_SIGNED, MAX_FRAME, MAX_PAYLOAD, SETUP_SIGNING_ID,
    checksum, crc_extra,
};

/// Bytes of the longest record.
pub const MAX_RECORD: usize = STAMP_LEN + MAX_FRAME;

/// Writes one record: microseconds since 1970 as u64 big-endian, then the frame, and returns its length.
///
/// `wall` is the time since 1970 at which the frame was seen.
pub fn record(wall: Duration, frame: &FrameView<'_>, out: &mut [u8; MAX_RECORD]) -> usize {
    let micros = u64::try_from(wall.as_micros()).unwrap_or(u64::MAX);
    // The format puts microseconds since 1970 before each frame, big-endian, unlike MAVLink itself.
    out[..STAMP_LEN].copy_from_slice(&micros.to_be_bytes());

    let original = frame.as_bytes();
    let len = HEADER_LEN + frame.payload().len();
    let record = &mut out[STAMP_LEN..];
    record[..len].copy_from_slice(&original[..len]);
    if frame.header().message_id == SETUP_SIGNING_ID {
        record[HEADER_LEN..len].fill(0);
    } else if !frame.is_signed() {
        record[len..original.len()].copy_from_slice(&original[len..]);
        return STAMP_LEN + original.len();
    }
    record[2] &= !INCOMPAT_SIGNED;
    let crc = checksum(&record[1..len], extra_of(frame));
    record[len..len + CRC_LEN].copy_from_slice(&crc.to_le_bytes());
    STAMP_LEN + len + CRC_LEN
}

/// CRC_EXTRA of a frame. For an unknown message it is recovered by trial: the checksum was right, so one value fits.
fn extra_of(frame: &FrameView<'_>) -> u8 {
    let covered = &frame.as_bytes()[1..HEADER_LEN + frame.payload().len()];
    crc_extra(frame.header().message_id)
        // Not in the dialect: its CRC_EXTRA follows from the checksum that it was received with.
        .or_else(|| (0..=u8::MAX).find(|&extra| checksum(covered, extra) == frame.crc()))
        .unwrap_or(0)
}

const STAMP_LEN: usize = 8;
const _: () = assert!(MAX_RECORD > STAMP_LEN + HEADER_LEN + MAX_PAYLOAD + CRC_LEN);
