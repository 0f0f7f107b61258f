//! Errors of a configuration file, with line, key and expectation.

use std::io::{ErrorKind, Read as _};
use std::path::{Path, PathBuf};

use super::named_file;

/// A configuration that is refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error(
        "cannot read the configuration {path}: {cause}; {advice}",
        path = path.display()
    )]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
        /// What to do.
        advice: &'static str,
    },
    /// A file of another kind.
    #[error("{path} is {kind}, expected {expected}: {command}", path = path.display())]
    OtherKind {
        /// The file.
        path: PathBuf,
        /// What it is.
        kind: &'static str,
        /// What it should be.
        expected: &'static str,
        /// The command that takes it.
        command: &'static str,
    },
    /// Not TOML.
    #[error("{0}")]
    Syntax(Box<str>),
    /// An unknown or missing key, or a value that is not of its kind.
    #[error("line {line}: {key} {fault}")]
    Key {
        /// Its line, from 1.
        line: usize,
        /// The key, with its tables.
        key: String,
        /// What is wrong, what was expected, an example.
        fault: String,
    },
    /// A value that does not fit the others, or is out of its range.
    #[error("line {line}: {key} is {found}, expected {expected}")]
    Value {
        /// Line of the key, from 1, or of its table.
        line: usize,
        /// The key.
        key: String,
        /// The value as found.
        found: String,
        /// What would be accepted.
        expected: String,
    },
    /// Any of these, in a named file.
    #[error("{path}: {cause}", path = path.display())]
    InFile {
        /// The file.
        path: PathBuf,
        /// What is wrong in it.
        cause: Box<ConfigError>,
    },
}

impl ConfigError {
    /// Reads the text of a configuration; `new`: how to come to one where there is none.
    pub(super) fn read(path: &Path, new: &'static str) -> Result<String, ConfigError> {
        let read = || {
            let mut bytes = Vec::new();
            named_file::open_file(path)?
                .take(MAX_BYTES + 1)
                .read_to_end(&mut bytes)?;
            if bytes.len() as u64 > MAX_BYTES {
                let cause = format!("over {} kB", MAX_BYTES / 1_000);
                return Err(std::io::Error::new(ErrorKind::FileTooLarge, cause));
            }
            String::from_utf8(bytes).map_err(|cause| {
                let at = cause.utf8_error().valid_up_to();
                let cause = format!("byte {at} is no text in UTF-8");
                std::io::Error::new(ErrorKind::InvalidData, cause)
            })
        };
        read().map_err(|cause| {
            let advice = match cause.kind() {
                ErrorKind::NotFound => new,
                ErrorKind::IsADirectory => {
                    "it is a folder, expected a file, such as vsm.toml in it"
                }
                ErrorKind::PermissionDenied => {
                    "run as a user that may read it, or let its group read it"
                }
                ErrorKind::InvalidData | ErrorKind::FileTooLarge => {
                    "expected a configuration in TOML: is it the right file?"
                }
                _ => "expected a configuration in TOML",
            };
            let path = path.to_owned();
            ConfigError::Unreadable {
                path,
                cause,
                advice,
            }
        })
    }

    pub(super) fn in_file(self, path: &Path) -> ConfigError {
        ConfigError::InFile {
            path: path.to_owned(),
            cause: Box::new(self),
        }
    }
}

/// More is no configuration: one of a hundred vehicles has 30 kB.
const MAX_BYTES: u64 = 1_000_000;

/// A fault at a byte of the text, before the line is known.
pub(super) struct Fault {
    pub(super) at: usize,
    pub(super) key: String,
    pub(super) found: String,
    pub(super) expected: String,
}

/// The fault of a key, in the table that begins at a byte of the text.
pub(super) fn fault(
    at: usize,
    key: &str,
    found: impl std::fmt::Display,
    expected: &str,
) -> Result<(), Fault> {
    Err(Fault {
        at,
        key: key.to_owned(),
        found: found.to_string(),
        expected: expected.to_owned(),
    })
}
