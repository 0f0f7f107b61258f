//! PX4's own key file, `mavlink/mavlink-signing-key.bin`: 32 bytes of key and the first stamp as u64 little-endian.
//!
//! Written as the real one does it, by truncation and without synchronising: a power cut leaves it empty, and an empty
//! one is no key.

use std::fs::OpenOptions;
use std::io::{self, Write as _};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;

use mavlink_link::signing::SigningKey;

use super::signing::Signing;

/// Key and stamp as PX4 finds them when it starts; off where the file is missing, short or zero.
///
/// # Errors
/// The file is there and cannot be read.
pub(super) fn read(path: &Path) -> io::Result<Signing> {
    let bytes = match std::fs::read(path) {
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => return Ok(Signing::off()),
        read => read?,
    };
    let (Some(key), Some(stamp)) = (bytes.first_chunk::<32>(), bytes.last_chunk::<8>()) else {
        return Ok(Signing::off());
    };
    if bytes.len() != LEN || (key == &[0; 32] && stamp == &[0; 8]) {
        return Ok(Signing::off());
    }
    let key = SigningKey::new_allowing_zero(*key);
    Ok(Signing::with_key(key, u64::from_le_bytes(*stamp)))
}

/// Writes what is in force.
///
/// # Errors
/// The system's.
pub(super) fn write(path: &Path, signing: &Signing) -> io::Result<()> {
    let mut bytes = [0; LEN];
    if let Some(key) = signing.key() {
        bytes[..32].copy_from_slice(key.expose());
        bytes[32..].copy_from_slice(&signing.stored_stamp().to_le_bytes());
    }
    OpenOptions::new()
        .write(true)
        .create(true)
        .truncate(true)
        .mode(0o600)
        .open(path)?
        .write_all(&bytes)
}

const LEN: usize = 40;
