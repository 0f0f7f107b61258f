//! The checksum of a file.

use crc::{CRC_32_JAMCRC, Crc};

/// CRC-32 as PX4's `crc32part` has it: no inversion at the beginning, none at the end.
static CRC32: Crc<u32> = Crc::<u32>::new(&crc::Algorithm {
    init: 0,
    ..CRC_32_JAMCRC
});

/// The CRC32 of a file's contents, as CalcFileCRC32 gives it; `before` is that of what precedes the bytes, 0 at the start.
#[must_use]
pub fn crc32(before: u32, bytes: &[u8]) -> u32 {
    // The reflected algorithm keeps its register bit-reversed.
    let mut digest = CRC32.digest_with_initial(before.reverse_bits());
    digest.update(bytes);
    digest.finalize()
}

#[cfg(test)]
mod tests {
    use super::crc32;

    #[test]
    fn the_checksum_is_that_of_px4_and_continues() {
        // The register without inversions, by the definition bit by bit.
        let slow = |bytes: &[u8]| {
            bytes.iter().fold(0_u32, |mut crc, byte| {
                crc ^= u32::from(*byte);
                for _ in 0..8 {
                    crc = (crc >> 1) ^ (0xedb8_8320 * (crc & 1));
                }
                crc
            })
        };
        let text = b"123456789";
        assert_eq!(crc32(0, text), slow(text));
        assert_eq!(crc32(crc32(0, &text[..4]), &text[4..]), slow(text));
        assert_eq!(crc32(0, b""), 0);
    }
}
