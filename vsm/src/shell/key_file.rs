//! Keys as files, and what keeps them out of other files: core dumps and other processes of the same user.
//!
//! A key file holds 32 random bytes in hex, mode 0600, and is refused when others can read it. A pass phrase is refused:
//! hashed once, it could be found with a dictionary.

use std::fs::{self, DirBuilder};
use std::io::{self, Read};
use std::os::unix::fs::{DirBuilderExt as _, PermissionsExt};
use std::path::{Path, PathBuf};

use mavlink_link::exchange::NoRandom;
use mavlink_link::signing::{SigningKey, Stamp};
use rustix::process::{DumpableBehavior, Resource, Rlimit, set_dumpable_behavior, setrlimit};
use zeroize::Zeroizing;

use super::disk::{self, FileSystem as _, InTheWay, NativeFileSystem};
use super::ownership::{self, OwnershipError};
use crate::config::open_at_once;

/// A key file that cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum KeyFileError {
    /// It is not there.
    #[error("there is no key file {path}: where the other end has this key, restore the file from a copy; `vsm keygen {path}` makes another \
         key, which the other end must be given too", path = path.display())]
    Absent {
        /// The file.
        path: PathBuf,
    },
    /// It is there already.
    #[error("key file {path} is there already, and a key is never overwritten: name another file, or move this one away", path = path.display())]
    Present {
        /// The file.
        path: PathBuf,
    },
    /// It cannot be opened or written.
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
    /// The file, or its folder, belongs to somebody else.
    #[error("key file: {0}")]
    Ownership(#[from] OwnershipError),
    /// It, or a file beside it, can never be replaced.
    #[error("key file: {0}")]
    InTheWay(#[from] InTheWay),
    /// It does not hold a key.
    #[error("key file {path}: {cause}: a key is 64 hex digits (32 random bytes), as `vsm keygen` writes them", path = path.display())]
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
    read_checked(path, ownership::check_file)
}

/// As [`read`], for a command that replaces the key, perhaps as root for the user that the key belongs to.
///
/// # Errors
/// As [`read`].
pub(super) fn read_to_replace(path: &Path) -> Result<SigningKey, KeyFileError> {
    read_checked(path, ownership::check_file_to_replace)
}

/// As [`read`], for a key that root gives a service at its start: whoever looks at it need not own it.
///
/// # Errors
/// As [`read`].
pub(super) fn read_waiting(path: &Path) -> Result<SigningKey, KeyFileError> {
    read_checked(path, ownership::check_kind)
}

fn read_checked(
    path: &Path,
    check: fn(&fs::File, &Path) -> Result<(), OwnershipError>,
) -> Result<SigningKey, KeyFileError> {
    let io = |cause| io_fault(path, cause);
    // A pipe is opened too, and refused by the check.
    let file = open_at_once(path).map_err(|cause| match cause.kind() {
        io::ErrorKind::NotFound => KeyFileError::Absent {
            path: path.to_owned(),
        },
        _ => io(ownership::explain(path, cause)),
    })?;
    check(&file, path)?;
    let mode = file.metadata().map_err(io)?.permissions().mode() & 0o777;
    if mode & 0o077 != 0 {
        return Err(KeyFileError::Permissions {
            path: path.to_owned(),
            mode,
        });
    }
    // Allocated in full: a growing buffer leaves copies of the key behind.
    let mut text = Zeroizing::new(Vec::with_capacity(MAX_BYTES as usize + 1));
    file.take(MAX_BYTES).read_to_end(&mut text).map_err(io)?;
    parse(path, &text)
}

fn io_fault(path: &Path, cause: io::Error) -> KeyFileError {
    KeyFileError::Io {
        path: path.to_owned(),
        cause,
    }
}

/// Reads the content of a key file.
pub(super) fn parse(path: &Path, content: &[u8]) -> Result<SigningKey, KeyFileError> {
    let content_fault = |cause: String| KeyFileError::Content {
        path: path.to_owned(),
        cause,
    };
    let text = std::str::from_utf8(content)
        .map_err(|_| content_fault("not a text".to_owned()))?
        .trim_end();
    if looks_like_a_phrase(text) {
        return Err(content_fault(
            "this looks like a pass phrase, not a key: one recorded frame is enough for a dictionary attack on it"
                .to_owned(),
        ));
    }
    SigningKey::from_hex(text).map_err(|cause| content_fault(cause.to_string()))
}

/// Three letters that are no hexadecimal digits: somebody has written words.
fn looks_like_a_phrase(text: &str) -> bool {
    // A mistyped key has one or two such letters, and gets the error that names the position.
    let odd = |c: &char| c.is_alphabetic() && !c.is_ascii_hexdigit() || *c == ' ';
    text.chars().filter(odd).count() >= 3
}

/// A new key from the system's random source.
///
/// # Errors
/// The system has no random bytes.
pub fn random() -> io::Result<SigningKey> {
    let mut bytes = Zeroizing::new([0_u8; 32]);
    getrandom::fill(&mut *bytes).map_err(|cause| io::Error::other(cause.to_string()))?;
    SigningKey::new(*bytes).map_err(|cause| io::Error::other(cause.to_string()))
}

/// The system's random source.
///
/// # Errors
/// There is none.
pub fn system_random(out: &mut [u8]) -> Result<(), NoRandom> {
    getrandom::fill(out).map_err(|_| NoRandom)
}

/// A key as stored in its file.
pub(super) fn hex(key: &SigningKey) -> Zeroizing<String> {
    let mut hex = Zeroizing::new(String::with_capacity(65));
    for byte in key.expose() {
        for nibble in [byte >> 4, byte & 0x0f] {
            hex.push(char::from_digit(nibble.into(), 16).unwrap_or('0'));
        }
    }
    hex.push('\n');
    hex
}

/// Writes a fresh random key to a file that must not exist yet.
///
/// # Errors
/// The file exists or cannot be written, or the system has no random bytes.
pub fn generate(path: &Path) -> Result<(), KeyFileError> {
    let io = |cause| io_fault(path, cause);
    let hex = hex(&random().map_err(io)?);
    disk::create(path, hex.as_bytes()).map_err(|cause| match cause.kind() {
        io::ErrorKind::AlreadyExists => KeyFileError::Present {
            path: path.to_owned(),
        },
        _ => io(cause),
    })
}

/// Writes PX4's own key file, `mavlink/mavlink-signing-key.bin` in its working folder, mode 0600: 32 bytes of key and the
/// first stamp as u64 little-endian. PX4 reads it when it starts; a file that is shorter switches signing off.
///
/// # Errors
/// The system's; the old file is still there then.
pub fn write_px4(path: &Path, key: &SigningKey, first: Stamp) -> io::Result<()> {
    let mut bytes = Zeroizing::new([0; 40]);
    let (key_part, stamp_part) = bytes.split_at_mut(32);
    key_part.copy_from_slice(key.expose());
    stamp_part.copy_from_slice(&first.get().to_le_bytes());
    disk::replace(&NativeFileSystem, path, &*bytes, true)
}

/// Makes the folder of PX4's key file where it is missing, mode 0700: a new card has none. That above it must be there, or a name that
/// is mistyped, or a card that is not mounted, would take the key.
///
/// # Errors
/// The folder above it is missing, or the system's.
pub fn make_px4_folder(path: &Path) -> io::Result<()> {
    let folder = disk::folder_of(path);
    if folder.is_dir() {
        return Ok(());
    }
    let above = disk::folder_of(folder);
    let made = DirBuilder::new().mode(0o700).create(folder);
    made.and_then(|()| NativeFileSystem.sync(above))
        .map_err(|cause| {
            let (shown, above) = (folder.display(), above.display());
            let text = match cause.kind() {
                io::ErrorKind::NotFound => format!(
                    "there is no folder {above} to make {shown} in: expected PX4's SD card, mounted, or its working folder"
                ),
                io::ErrorKind::AlreadyExists => {
                    format!("{shown} is a file, expected a folder")
                }
                _ => format!("the folder {shown} cannot be made: {cause}"),
            };
            io::Error::new(cause.kind(), text)
        })
}

/// Switches core files off for this process, permanently. Every command that reads keys calls it first.
pub fn no_core_files() {
    // A hard limit of 0 as well: nothing in this process can raise it again without privileges.
    let none = Rlimit {
        current: Some(0),
        maximum: Some(0),
    };
    // If the system refuses one of the two, the other still helps; keys are wiped from memory in any case.
    if let Err(cause) = setrlimit(Resource::Core, none) {
        tracing::warn!("core files cannot be switched off: {cause}");
    }
    if let Err(cause) = set_dumpable_behavior(DumpableBehavior::NotDumpable) {
        tracing::debug!("the process stays open to debuggers: {cause}");
    }
}

/// A key file is 65 bytes; more than this is never read.
pub(super) const MAX_BYTES: u64 = 256;
