//! Key files: 32 random octets in hex, mode 0600, refused when others can read them.

use std::fs::{self, OpenOptions};
use std::io::{self, Read, Write};
use std::os::unix::fs::{OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use mavlink_link::signing::SigningKey;
use zeroize::Zeroizing;

/// A key file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum KeyFileError {
    /// It is not there or cannot be opened or written.
    #[error("key file {path}: {cause}", path = path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: io::Error,
    },
    /// Others than its owner can read it.
    #[error("key file {path} can be read by others (mode {mode:03o}), expected 0600: chmod 600 it", path = path.display())]
    Permissions {
        /// The file.
        path: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// It does not hold a key.
    #[error("key file {path}: {cause}, expected 64 hex digits (32 random octets, as `vsm keygen` writes them)", path = path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong, without any of the content.
        cause: String,
    },
}

/// Reads a key.
///
/// # Errors
/// The file is missing, readable by others, or holds something else.
pub fn read(path: &Path) -> Result<SigningKey, KeyFileError> {
    let io = |cause| KeyFileError::Io {
        path: path.to_owned(),
        cause,
    };
    let file = fs::File::open(path).map_err(io)?;
    let mode = file.metadata().map_err(io)?.permissions().mode() & 0o777;
    if mode & 0o077 != 0 {
        return Err(KeyFileError::Permissions {
            path: path.to_owned(),
            mode,
        });
    }
    // Room for all that is read: a string that grows leaves copies of the key behind.
    let mut text = Zeroizing::new(String::with_capacity(MOST_OCTETS as usize));
    file.take(MOST_OCTETS)
        .read_to_string(&mut text)
        .map_err(io)?;
    SigningKey::from_hex(text.trim_end()).map_err(|cause| KeyFileError::Content {
        path: path.to_owned(),
        cause: cause.to_string(),
    })
}

/// Writes a fresh random key to a file that must not exist yet.
///
/// # Errors
/// The file exists or cannot be written, or the system has no random octets.
pub fn generate(path: &Path) -> Result<(), KeyFileError> {
    let io = |cause| KeyFileError::Io {
        path: path.to_owned(),
        cause,
    };
    let mut key = Zeroizing::new([0_u8; 32]);
    getrandom::fill(&mut *key).map_err(|cause| io(io::Error::other(cause.to_string())))?;
    let mut hex = Zeroizing::new(String::with_capacity(65));
    for octet in key.iter() {
        for nibble in [octet >> 4, octet & 0x0f] {
            hex.push(char::from_digit(nibble.into(), 16).unwrap_or('0'));
        }
    }
    hex.push('\n');
    let mut file = OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(0o600)
        .open(path)
        .map_err(io)?;
    file.write_all(hex.as_bytes())
        .and_then(|()| file.sync_all())
        .map_err(io)
}

const MOST_OCTETS: u64 = 256;
