//! Why the program stops: what is wrong, where, and the exit status.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use cucs::formats::FormatError;
use cucs::{OperatorError, StationError};
use thiserror::Error;

/// A reason to stop.
#[derive(Debug, Error)]
pub(crate) enum Failure {
    /// A file cannot be used; the text names file, line and field.
    #[error(transparent)]
    File(#[from] FormatError),
    /// The request cannot be met.
    #[error("{0}")]
    Answer(String),
    /// A route cannot be written as messages.
    #[error(transparent)]
    Messages(#[from] StationError),
    /// An upload failed.
    #[error(transparent)]
    Upload(#[from] OperatorError),
    /// The command line contradicts itself.
    #[error("{0}")]
    Usage(String),
}

impl Failure {
    /// A file that cannot be read, written or used.
    pub(crate) fn file(file: impl AsRef<Path>, problem: impl ToString) -> Self {
        FormatError::file(file, problem).into()
    }

    /// A valid file for which the request cannot be met.
    pub(crate) fn answer(file: impl AsRef<Path>, problem: impl ToString) -> Self {
        let file = file.as_ref().display();
        Self::Answer(format!("{file}: {}", problem.to_string()))
    }

    /// Prints it on standard error; returns the exit status.
    pub(crate) fn report(&self) -> ExitCode {
        // Where standard error is closed as well, nothing is left to do.
        let _ = writeln!(std::io::stderr(), "curve-plan: {self}");
        match self {
            Self::Answer(_) => ExitCode::from(1),
            Self::Messages(fault) => ExitCode::from(fault.exit_status()),
            Self::Upload(fault) => ExitCode::from(fault.exit_status()),
            Self::File(fault) => ExitCode::from(fault.exit_status()),
            Self::Usage(_) => ExitCode::from(2),
        }
    }
}
