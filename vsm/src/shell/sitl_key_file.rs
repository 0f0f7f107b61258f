//! PX4's own key file, `mavlink/mavlink-signing-key.bin` in its working folder: 32 bytes of key and the first stamp
//! as u64 little-endian. PX4 reads it when it starts; a file that is shorter switches signing off.

use std::io;
use std::path::Path;

use mavlink_link::signing::{SigningKey, Stamp};
use zeroize::Zeroizing;

use super::disk::{self, NativeFileSystem};

/// Writes the file, mode 0600.
///
/// # Errors
/// The system's; the old file is still there then.
pub fn write(path: &Path, key: &SigningKey, first: Stamp) -> io::Result<()> {
    let mut bytes = Zeroizing::new([0; 40]);
    let (key_part, stamp_part) = bytes.split_at_mut(32);
    key_part.copy_from_slice(key.expose());
    stamp_part.copy_from_slice(&first.get().to_le_bytes());
    disk::replace(&NativeFileSystem, path, &*bytes, true)
}
