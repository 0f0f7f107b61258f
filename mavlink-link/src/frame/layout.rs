//! Where the parts of a MAVLink 2 frame stand, and its checksum.

use crc::{CRC_16_MCRF4XX, Crc, Table};
use mavlink::Message as _;

use crate::dialect::MavMessage;

/// The header of a MAVLink 2 frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Header {
    /// Packet sequence of the sender, wraps at 255.
    pub seq: u8,
    /// Sending system, 1 to 255.
    pub system_id: u8,
    /// Sending component, 1 to 255.
    pub component_id: u8,
    /// Message id, 24 bits.
    pub message_id: u32,
    /// Incompatibility flags; only [`INCOMPAT_SIGNED`] is known.
    pub incompat: u8,
    /// Compatibility flags; ignored by receivers.
    pub compat: u8,
}

/// One MAVLink node: a system and a component of it.
#[derive(Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Debug)]
pub struct Node {
    /// System id, 1..=255; 0 addresses every system.
    pub system: u8,
    /// Component id, 1..=255; 0 addresses every component of the system.
    pub component: u8,
}

impl Node {
    /// The node with this system and component id.
    pub const fn new(system: u8, component: u8) -> Self {
        Self { system, component }
    }

    /// Whether a message with these target fields is meant for this node alone.
    ///
    /// Component 0 is every component of the system; system 0 is everybody and therefore
    /// never an answer to us.
    pub const fn is_target(self, system: u8, component: u8) -> bool {
        self.system == system && (component == 0 || self.component == component)
    }
}

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
        // The dialect returns 0 for an unknown id, but 0 is also the CRC_EXTRA of COMPONENT_INFORMATION (395).
        0 => MavMessage::default_message_from_id(message_id).map(|_| 0),
        extra => Some(extra),
    }
}

/// Start byte of MAVLink 2.
pub const STX: u8 = 0xfd;
/// Start byte of MAVLink 1.
pub const STX_V1: u8 = 0xfe;
/// Bytes of the header, the start byte included.
pub const HEADER_LEN: usize = 10;
/// Bytes of the checksum.
pub const CRC_LEN: usize = 2;
/// Bytes of the signature trailer.
pub const SIGNATURE_LEN: usize = 13;
/// Bytes of the signature itself, the last of the trailer.
pub const TAG_LEN: usize = 6;
/// The longest payload.
pub const MAX_PAYLOAD: usize = 255;
/// The longest frame, signed.
pub const MAX_FRAME: usize = HEADER_LEN + MAX_PAYLOAD + CRC_LEN + SIGNATURE_LEN;
/// Incompatibility flag of a signed frame.
pub const INCOMPAT_SIGNED: u8 = 0x01;
/// SETUP_SIGNING, which gives a vehicle its key.
pub const SETUP_SIGNING_ID: u32 = 256;
/// KEY_EXCHANGE, private, not in the dialect.
pub const KEY_EXCHANGE_ID: u32 = 229;
/// CRC_EXTRA of KEY_EXCHANGE.
pub const KEY_EXCHANGE_CRC_EXTRA: u8 = 140;

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
    fn an_extra_of_zero_differs_from_an_unknown_message() {
        assert_eq!(crc_extra(0), Some(50));
        assert_eq!(crc_extra(395), Some(0));
        assert_eq!(crc_extra(KEY_EXCHANGE_ID), Some(140));
        assert_eq!(crc_extra(0x00ff_fff0), None);
    }
}
