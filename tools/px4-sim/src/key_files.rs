//! The two kinds of key file.
//!
//! `--key-file` is this project's own: 32 bytes in hex, readable by its owner alone. `--signing-file` is PX4's
//! `mavlink/mavlink-signing-key.bin`: 32 bytes of key, and the first timestamp as a little-endian u64.

use std::fs::OpenOptions;
use std::io::{self, Write as _};
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::{Path, PathBuf};

use mavlink_link::signing::SigningKey;
use thiserror::Error;

use crate::link::signing::Signing;

/// Why a key file cannot be used.
#[derive(Debug, Error)]
#[error("key file {}: {reason}", path.display())]
pub struct KeyFileError {
    /// The file.
    pub path: PathBuf,
    /// What is wrong with it, and what to do.
    pub reason: String,
}

/// Reads a key file: 32 bytes in hex, a trailing newline is allowed.
///
/// # Errors
/// The file cannot be read, others may read or write it, or it does not hold a key.
pub fn read_key_file(path: &Path) -> Result<SigningKey, KeyFileError> {
    let fault = |reason: String| KeyFileError {
        path: path.to_owned(),
        reason,
    };
    let unreadable = |cause: io::Error| match cause.kind() {
        io::ErrorKind::NotFound => {
            let create = format!("create one with `vsm keygen {}`", path.display());
            fault(format!("no such file; {create}"))
        }
        _ => fault(cause.to_string()),
    };
    let metadata = std::fs::metadata(path).map_err(unreadable)?;
    let mode = metadata.permissions().mode() & 0o7777;
    if mode & 0o077 != 0 {
        return Err(fault(format!(
            "mode {mode:04o} lets other users in; expected 0600"
        )));
    }
    let text = std::fs::read_to_string(path).map_err(|cause| match cause.kind() {
        io::ErrorKind::InvalidData => {
            fault("not text, expected 32 bytes in hex; PX4's own file is for --signing-file".into())
        }
        _ => unreadable(cause),
    })?;
    SigningKey::from_hex(text.trim_end()).map_err(|cause| fault(cause.to_string()))
}

/// Key and timestamp as PX4 reads them at its start; signing is off where the file is missing, short or zero.
///
/// # Errors
/// The file exists and cannot be read, or is none that PX4 writes, not even in part: it would be overwritten with the
/// first key. Or it cannot be written, because its folder does not exist.
pub(crate) fn read_px4_key(path: &Path) -> io::Result<Signing> {
    let bytes = match std::fs::read(path) {
        Err(cause) if cause.kind() == io::ErrorKind::NotFound => {
            let folder = path.parent().filter(|it| !it.as_os_str().is_empty());
            return match folder {
                Some(folder) if !folder.is_dir() => Err(io::Error::new(
                    cause.kind(),
                    format!("no folder {}: a key would be lost", folder.display()),
                )),
                _ => Ok(Signing::off()),
            };
        }
        read => read?,
    };
    if let Some(found) = foreign(&bytes) {
        let expected = format!("{found}, expected the {PX4_LEN} bytes that PX4 writes, or no file");
        return Err(io::Error::new(io::ErrorKind::InvalidData, expected));
    }
    let (Some(key), Some(stamp)) = (bytes.first_chunk::<32>(), bytes.last_chunk::<8>()) else {
        return Ok(Signing::off());
    };
    if bytes.len() != PX4_LEN || (key == &[0; 32] && stamp == &[0; 8]) {
        return Ok(Signing::off());
    }
    let key = SigningKey::new_allowing_zero(*key);
    Ok(Signing::with_key(key, u64::from_le_bytes(*stamp)))
}

/// What a file is that PX4 has not written, also not before a power cut.
fn foreign(bytes: &[u8]) -> Option<String> {
    let text = bytes.trim_ascii();
    // A key with its stamp is no text: the upper bytes of a stamp are zero.
    if !text.is_empty()
        && text
            .iter()
            .all(|byte| byte.is_ascii_graphic() || byte.is_ascii_whitespace())
    {
        let hex = text.iter().all(u8::is_ascii_hexdigit);
        let kind = if hex {
            "hex digits, as --key-file has them"
        } else {
            "text"
        };
        return Some(kind.to_owned());
    }
    (bytes.len() > PX4_LEN).then(|| format!("{} bytes", bytes.len()))
}

/// Writes the key as the real PX4 does: truncated in place and not synchronised, so that a power cut leaves an empty
/// file without a key. The bridge must be able to recover from that; a careful write here would hide it.
///
/// # Errors
/// The file cannot be written.
pub(crate) fn write_px4_key(path: &Path, signing: &Signing) -> io::Result<()> {
    let mut bytes = [0; PX4_LEN];
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

/// Bytes of PX4's key file: 32 of key, 8 of timestamp.
const PX4_LEN: usize = 40;
