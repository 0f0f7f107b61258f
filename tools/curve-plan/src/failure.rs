//! Why the program stops: what is wrong, where, and the exit status.

use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use cucs::formats::FormatError;
use cucs::{OperatorError, StationError};
use curve_paths::DensifyError;
use curve_paths::fit::FitError;
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

    /// A track that is not fitted: the command line is wrong where its tolerance is none.
    pub(crate) fn fit(file: impl AsRef<Path>, fault: FitError) -> Self {
        match fault {
            FitError::Tolerance { .. } => Self::Usage(format!("--{fault}")),
            _ => Self::answer(file, fault),
        }
    }

    /// A route that is not densified at this tolerance, likewise. A search for one that needs fewer items may reach another
    /// that is none: then the answer is no.
    pub(crate) fn densify(file: impl AsRef<Path>, requested_m: f64, fault: DensifyError) -> Self {
        match fault {
            DensifyError::Tolerance { tolerance_m, .. }
                if tolerance_m.total_cmp(&requested_m).is_eq() =>
            {
                Self::Usage(format!("--{fault}"))
            }
            _ => Self::answer(file, fault),
        }
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
