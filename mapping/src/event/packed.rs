//! Metadata files as PX4 carries them: JSON, packed as XZ.

use std::io::Read as _;

use lzma_rust2::XzReader;

/// Why a file cannot be unpacked.
#[derive(Debug, thiserror::Error)]
pub enum UnpackError {
    /// Damaged, or another form.
    #[error("not an XZ file of which everything can be read: {0}")]
    Damaged(std::io::Error),
    /// It would fill the memory.
    #[error("over {MAX_UNPACKED} bytes once unpacked")]
    TooLarge,
}

/// The contents of a file: unpacked where it is XZ, else as they are.
///
/// # Errors
/// It is damaged, or unpacks to more than [`MAX_UNPACKED`] bytes.
pub fn unpack(bytes: &[u8]) -> Result<Vec<u8>, UnpackError> {
    if !bytes.starts_with(MAGIC) {
        return if bytes.len() > MAX_UNPACKED {
            Err(UnpackError::TooLarge)
        } else {
            Ok(bytes.to_vec())
        };
    }
    let mut unpacked = Vec::new();
    // The window grows with what is unpacked, whatever size the file claims for it (64 MiB in PX4's).
    let limit = MAX_UNPACKED as u64 + 1;
    XzReader::new(bytes, false)
        .take(limit)
        .read_to_end(&mut unpacked)
        .map_err(UnpackError::Damaged)?;
    if unpacked.len() > MAX_UNPACKED {
        return Err(UnpackError::TooLarge);
    }
    Ok(unpacked)
}

/// PX4's events have 176 kB, its parameters 1.2 MB.
pub const MAX_UNPACKED: usize = 4 * 1024 * 1024;
const MAGIC: &[u8] = &[0xfd, b'7', b'z', b'X', b'Z', 0];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_packed_is_returned_and_what_is_damaged_is_refused() {
        assert_eq!(unpack(b"{}").expect("as it is"), b"{}");
        let mut bytes = MAGIC.to_vec();
        bytes.extend([0xff; 60]);
        assert!(matches!(unpack(&bytes), Err(UnpackError::Damaged(_))));
        assert!(matches!(
            unpack(&vec![b' '; MAX_UNPACKED + 1]),
            Err(UnpackError::TooLarge)
        ));
    }
}
