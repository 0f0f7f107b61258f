//! Why a file is not read or written: the file, the line, the field, what stood there and what was expected.

use std::path::Path;

use crate::fence::FenceFileError;
use crate::route::read::RouteFileError;

/// A file that is not what it should be.
#[derive(Debug, thiserror::Error)]
pub enum FormatError {
    /// A place in a file.
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
    /// A route file is none; the text names file, line and field.
    #[error(transparent)]
    Route(#[from] RouteFileError),
    /// A fence file is none; the text names it.
    #[error(transparent)]
    Fence(#[from] FenceFileError),
    /// An option does not fit the file.
    #[error("{0}")]
    Option(String),
    /// A route that no message can carry.
    #[error("{0}")]
    Answer(String),
    /// Not all of a file was taken, and nothing may be lost.
    #[error("{0}; --strict: nothing was written or sent")]
    Lost(String),
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

impl FormatError {
    /// A file that cannot be read or written.
    pub fn file(file: impl AsRef<Path>, problem: impl ToString) -> Self {
        Self::at(file, None, "", problem)
    }

    /// A place in a file.
    pub fn at(
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

    /// 2 where the file or an option is wrong, 1 where the answer is no.
    #[must_use]
    pub const fn exit_status(&self) -> u8 {
        match self {
            Self::Input { .. } | Self::Route(_) | Self::Fence(_) | Self::Option(_) => 2,
            Self::Answer(_) | Self::Lost(_) => 1,
        }
    }
}
