//! What can be wrong with a configuration file, with line, key and expectation.

use std::path::{Path, PathBuf};

/// A configuration that is refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error(
        "cannot read the configuration {path}: {cause}; `vsm init` writes one to begin with",
        path = path.display()
    )]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        cause: std::io::Error,
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
    pub(super) fn in_file(self, path: &Path) -> ConfigError {
        ConfigError::InFile {
            path: path.to_owned(),
            cause: Box::new(self),
        }
    }
}

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
