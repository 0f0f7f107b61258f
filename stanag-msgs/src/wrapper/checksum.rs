//! The checksums of the wrapper.

use crc::{CRC_16_IBM_3740, CRC_32_ISO_HDLC, Crc, Table};

static CRC_16: Crc<u16, Table<1>> = Crc::<u16, Table<1>>::new(&CRC_16_IBM_3740);
static CRC_32: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);

/// The checksum of a message.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum ChecksumStyle {
    /// None (code 0).
    #[default]
    None,
    /// All bytes added, 2 bytes (code 1).
    Sum16,
    /// All bytes added, 4 bytes (code 2).
    Sum32,
    /// CRC-32 of ITU-T V.42, 4 bytes (code 3); not in Edition 3.
    Crc32,
}

/// What style 1 means: sources disagree, see [`crate::disputed`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum Sum16Variant {
    /// All bytes added.
    #[default]
    Sum,
    /// CRC-16-CCITT with initial value 0xFFFF.
    Crc16,
}

impl ChecksumStyle {
    /// The style of bits 7 to 6 of the Message Properties; only the low two bits are used.
    pub const fn from_code(code: u8) -> Self {
        match code & 3 {
            0 => Self::None,
            1 => Self::Sum16,
            2 => Self::Sum32,
            _ => Self::Crc32,
        }
    }

    /// Bits 7 to 6 of the Message Properties.
    pub const fn code(self) -> u8 {
        match self {
            Self::None => 0,
            Self::Sum16 => 1,
            Self::Sum32 => 2,
            Self::Crc32 => 3,
        }
    }

    /// How many bytes the checksum has.
    pub const fn bytes(self) -> usize {
        match self {
            Self::None => 0,
            Self::Sum16 => 2,
            Self::Sum32 | Self::Crc32 => 4,
        }
    }

    /// The checksum of header and data; 0 where there is none.
    pub fn of(self, variant: Sum16Variant, bytes: &[u8]) -> u32 {
        match (self, variant) {
            (Self::None, _) => 0,
            (Self::Sum16, Sum16Variant::Sum) => sum(bytes) & 0xFFFF,
            (Self::Sum16, Sum16Variant::Crc16) => u32::from(CRC_16.checksum(bytes)),
            (Self::Sum32, _) => sum(bytes),
            (Self::Crc32, _) => CRC_32.checksum(bytes),
        }
    }
}

// Not inlined: where only 16 bits of the sum are used, the compiler would choose a narrower and slower loop.
#[inline(never)]
fn sum(bytes: &[u8]) -> u32 {
    bytes
        .iter()
        .fold(0, |sum, &byte| sum.wrapping_add(u32::from(byte)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sums_of_a_known_text() {
        let of = |style: ChecksumStyle| style.of(Sum16Variant::Sum, b"123456789");
        assert_eq!(of(ChecksumStyle::None), 0);
        assert_eq!(of(ChecksumStyle::Sum16), 477);
        assert_eq!(of(ChecksumStyle::Sum32), 477);
        assert_eq!(of(ChecksumStyle::Crc32), 0xCBF4_3926);
        assert_eq!(
            ChecksumStyle::Sum16.of(Sum16Variant::Crc16, b"123456789"),
            0x29B1
        );
    }

    #[test]
    fn two_bytes_wrap_where_four_do_not() {
        let bytes = [0xFF; 300];
        assert_eq!(
            ChecksumStyle::Sum16.of(Sum16Variant::Sum, &bytes),
            300 * 255 - 65_536
        );
        assert_eq!(
            ChecksumStyle::Sum32.of(Sum16Variant::Sum, &bytes),
            300 * 255
        );
    }
}
