//! Why the program stops: what is wrong, where, and the exit status.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use cucs::{OperatorError, RouteFileError, StationError};
use thiserror::Error;

/// A reason to stop.
#[derive(Debug, Error)]
pub(crate) enum Failure {
    /// A file is not what it should be.
    #[error("{file}{}{}: {problem}", at_line(*line), in_field(field))]
    Input {
        /// The file.
        file: String,
        /// The line in it, from 1, where there is one to name.
        line: Option<u64>,
        /// The field, column or element.
        field: String,
        /// What stood there and what was expected.
        problem: String,
    },
    /// What was asked for cannot be had.
    #[error("{0}")]
    Answer(String),
    /// A route file is none; the text names file, line and field.
    #[error(transparent)]
    Route(#[from] RouteFileError),
    /// A route cannot be put into messages.
    #[error(transparent)]
    Messages(#[from] StationError),
    /// An upload was not done.
    #[error(transparent)]
    Upload(#[from] OperatorError),
    /// The command line contradicts itself.
    #[error("{0}")]
    Usage(String),
}

fn at_line(line: Option<u64>) -> String {
    line.map_or_else(String::new, |l| format!(":{l}"))
}

fn in_field(field: &str) -> String {
    if field.is_empty() {
        String::new()
    } else {
        format!(": {field}")
    }
}

impl Failure {
    /// A file that cannot be read or written.
    pub(crate) fn file(file: impl AsRef<Path>, problem: impl ToString) -> Self {
        Self::at(file, None, "", problem)
    }

    /// What cannot be done with a file that is as it should be.
    pub(crate) fn answer(file: impl AsRef<Path>, problem: impl ToString) -> Self {
        let file = file.as_ref().display();
        Self::Answer(format!("{file}: {}", problem.to_string()))
    }

    /// A place in a file.
    pub(crate) fn at(
        file: impl AsRef<Path>,
        line: Option<u64>,
        field: impl Into<String>,
        problem: impl ToString,
    ) -> Self {
        Self::Input {
            file: file.as_ref().display().to_string(),
            line,
            field: field.into(),
            problem: problem.to_string(),
        }
    }

    /// Prints it on standard error; the exit status.
    pub(crate) fn report(&self) -> ExitCode {
        // Nothing is left to do when standard error is closed as well.
        let _ = writeln!(std::io::stderr(), "curve-plan: {self}");
        match self {
            Self::Answer(_) => ExitCode::from(1),
            Self::Messages(fault) => ExitCode::from(fault.exit_status()),
            Self::Upload(fault) => ExitCode::from(fault.exit_status()),
            Self::Input { .. } | Self::Route(_) | Self::Usage(_) => ExitCode::from(2),
        }
    }
}
