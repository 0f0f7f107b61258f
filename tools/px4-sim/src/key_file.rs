//! Reading a key file: 32 bytes in hex, a trailing newline is fine, for its owner alone.

use std::io;
use std::path::{Path, PathBuf};

use mavlink_link::signing::{KeyError, SigningKey};
use thiserror::Error;

/// Why a key file is not used.
#[derive(Debug, Error)]
pub enum KeyFileError {
    /// Not there.
    #[error("there is no key file {}: `vsm keygen {}` makes one", path.display(), path.display())]
    Absent {
        /// The file.
        path: PathBuf,
    },
    /// Not readable.
    #[error("key file {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: io::Error,
    },
    /// Others may read or write it.
    #[error("key file {}: mode {mode:04o} lets others in, expected 0600", path.display())]
    Open {
        /// The file.
        path: PathBuf,
        /// Its permission bits.
        mode: u32,
    },
    /// Not a key.
    #[error("key file {}: {source}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        source: KeyError,
    },
}

/// Reads a key file.
///
/// # Errors
/// The file cannot be read, others can read it, or it holds no key.
pub fn read_key_file(path: &Path) -> Result<SigningKey, KeyFileError> {
    let read = |source: io::Error| match source.kind() {
        io::ErrorKind::NotFound => KeyFileError::Absent {
            path: path.to_owned(),
        },
        _ => KeyFileError::Read {
            path: path.to_owned(),
            source,
        },
    };
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        let mode = std::fs::metadata(path).map_err(read)?.permissions().mode() & 0o7777;
        if mode & 0o077 != 0 {
            return Err(KeyFileError::Open {
                path: path.to_owned(),
                mode,
            });
        }
    }
    let text = std::fs::read_to_string(path).map_err(read)?;
    SigningKey::from_hex(text.trim_end()).map_err(|source| KeyFileError::Content {
        path: path.to_owned(),
        source,
    })
}
