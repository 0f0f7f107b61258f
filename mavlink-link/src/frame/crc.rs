//! The frame checksum: CRC-16/MCRF4XX over everything after the start byte, and CRC_EXTRA.

use crc::{CRC_16_MCRF4XX, Crc, Table};
use mavlink::Message as _;

use super::{KEY_EXCHANGE_CRC_EXTRA, KEY_EXCHANGE_ID};
use crate::dialect::MavMessage;

/// The checksum of a frame: `covered` is the header without the start byte, and the payload.
#[must_use]
pub fn checksum(covered: &[u8], crc_extra: u8) -> u16 {
    let mut digest = MCRF4XX.digest();
    digest.update(covered);
    digest.update(&[crc_extra]);
    digest.finalize()
}

/// CRC_EXTRA of a message, the byte that ties the checksum to the layout both ends know.
///
/// `None` where neither the dialect nor this crate knows the message: such a frame cannot be checked.
#[must_use]
pub fn crc_extra(message_id: u32) -> Option<u8> {
    if message_id == KEY_EXCHANGE_ID {
        return Some(KEY_EXCHANGE_CRC_EXTRA);
    }
    match MavMessage::extra_crc(message_id) {
        // The dialect answers 0 for an unknown id, but 0 is also COMPONENT_INFORMATION's own byte.
        0 => MavMessage::default_message_from_id(message_id).map(|_| 0),
        extra => Some(extra),
    }
}

const MCRF4XX: Crc<u16, Table<16>> = Crc::<u16, Table<16>>::new(&CRC_16_MCRF4XX);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_crc_16_mcrf4xx() {
        // The catalogue's check value is for "123456789", taken here as eight bytes and one extra.
        assert_eq!(checksum(b"12345678", b'9'), 0x6f91);
    }

    #[test]
    fn an_extra_of_zero_is_told_apart_from_an_unknown_message() {
        assert_eq!(crc_extra(0), Some(50));
        assert_eq!(crc_extra(395), Some(0));
        assert_eq!(crc_extra(KEY_EXCHANGE_ID), Some(140));
        assert_eq!(crc_extra(0x00ff_fff0), None);
    }
}
