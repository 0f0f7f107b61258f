//! Recordings of a link in QGroundControl's format that can be passed on safely.
//!
//! Promised: a record holds no key and nothing that a signed vehicle accepts (pitfall 20: PX4 accepts an old signed
//! frame after its restart). SETUP_SIGNING is blanked; of a signed frame the flag is cleared, the trailer removed and the
//! checksum computed again.

use core::time::Duration;

use crate::frame::{
    CRC_LEN, FrameError, FrameView, HEADER_LEN, INCOMPAT_SIGNED, MAX_FRAME, MAX_PAYLOAD,
    SETUP_SIGNING_ID, checksum, crc_extra,
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
        // Blanked and not dropped: the record still shows that a key was sent.
        record[HEADER_LEN..len].fill(0);
    } else if !frame.is_signed() {
        record[len..original.len()].copy_from_slice(&original[len..]);
        return STAMP_LEN + original.len();
    }
    // A frame with the flag and without a trailer would be malformed, and a reader would take 13 bytes of the next record.
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

/// The record that the bytes of a recording begin with: its length, the time since 1970, and the frame. Strict: as [`record`]
/// writes it.
///
/// The frame is `None` where it was signed and its message is not known here: nothing proves its bytes now.
///
/// # Errors
/// [`FrameError::Truncated`] where the bytes end within the record, else why there is no frame.
pub fn first(bytes: &[u8]) -> Result<(usize, Duration, Option<FrameView<'_>>), FrameError> {
    let (Some(stamp), Some(frame)) = (bytes.first_chunk(), bytes.get(STAMP_LEN..)) else {
        return Err(FrameError::Truncated);
    };
    let wall = Duration::from_micros(u64::from_be_bytes(*stamp));
    // Nothing of a recording is signed: a frame ends with its checksum.
    let length = |payload: u8| STAMP_LEN + HEADER_LEN + usize::from(payload) + CRC_LEN;
    match FrameView::parse(frame) {
        Ok(view) => Ok((STAMP_LEN + view.as_bytes().len(), wall, Some(view))),
        Err(FrameError::UnknownId { .. }) => {
            Ok((length(frame.get(1).copied().unwrap_or(0)), wall, None))
        }
        Err(cause) => Err(cause),
    }
}

const STAMP_LEN: usize = 8;
const _: () = assert!(MAX_RECORD > STAMP_LEN + HEADER_LEN + MAX_PAYLOAD + CRC_LEN);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dialect::{HEARTBEAT_DATA, MavMessage};
    use crate::frame::{Header, encode};

    #[test]
    fn what_was_recorded_is_read_and_a_cut_is_no_damage() {
        let mut frame = [0; MAX_FRAME];
        let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        let length = encode(&message, Header::default(), &mut frame);
        let view = FrameView::parse(&frame[..length]).unwrap();
        let mut out = [0; MAX_RECORD];
        let wall = Duration::from_micros(1_700_000_000_123_456);
        let length = record(wall, &view, &mut out);
        assert_eq!(first(&out).unwrap(), (length, wall, Some(view)));
        for cut in 0..length {
            assert_eq!(first(&out[..cut]), Err(FrameError::Truncated), "{cut}");
        }
        out[STAMP_LEN + HEADER_LEN] ^= 1;
        let fault = first(&out).unwrap_err();
        assert!(matches!(fault, FrameError::BadCrc { .. }), "{fault}");
        assert_eq!(first(&[7; 40]), Err(FrameError::NoFrame));
    }
}
