//! MAVLink 2 byte by byte, right or wrong: a codec of its own, so that it shares no mistake with the judged code.
//!
//! [`table`] has the messages, [`frame`] reads and verifies, [`draft`] makes frames, whole or broken on purpose.

pub mod draft;
pub mod frame;
pub mod table;

pub use draft::{Craft, Draft};
pub use frame::{Frame, Key, Signature};

/// The checksum of MAVLink: CRC-16/MCRF4XX (X.25 without the final inversion).
#[must_use]
pub fn crc(bytes: impl IntoIterator<Item = u8>) -> u16 {
    bytes.into_iter().fold(0xFFFF, |crc: u16, byte| {
        let mut low = byte ^ (crc & 0xFF) as u8;
        low ^= low << 4;
        let low = u16::from(low);
        (crc >> 8) ^ (low << 8) ^ (low << 3) ^ (low >> 4)
    })
}

/// Units of a signing timestamp in a second: it counts 10 microseconds.
pub const STAMP_HZ: u64 = 100_000;
/// Seconds from 1970 to 2015, the epoch of signing timestamps.
pub const EPOCH_2015_S: u64 = 1_420_070_400;

/// The signing timestamp of the wall clock.
#[must_use]
pub fn wall_stamp() -> u64 {
    let now = std::time::SystemTime::now()
        .duration_since(std::time::UNIX_EPOCH)
        .unwrap_or_default();
    (now.as_micros() as u64 / 10).saturating_sub(EPOCH_2015_S * STAMP_HZ)
}
