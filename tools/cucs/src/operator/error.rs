//! Why a subcommand was not carried out, and the exit status for it.

use std::path::PathBuf;

use stanag_msgs::Id;

use crate::fence::FenceFileError;
use crate::formats::FormatError;
use crate::station::outcome::{Refused, StationError};

/// Why something was not done.
#[derive(Debug, thiserror::Error)]
pub enum OperatorError {
    /// The station reports the reason.
    #[error(transparent)]
    Station(#[from] StationError),
    /// The file of a route or a fence, or what would be lost of it.
    #[error(transparent)]
    File(#[from] FormatError),
    /// A file that another command takes.
    #[error("{} is {kind}: {command}", path.display())]
    OtherKind {
        /// The file.
        path: PathBuf,
        /// What it is.
        kind: &'static str,
        /// What takes it.
        command: &'static str,
    },
    /// A fence file.
    #[error(transparent)]
    FenceFile(#[from] FenceFileError),
    /// More than one vehicle, and none was named.
    #[error(
        "several vehicles are there: {0}; choose one with --vehicle ID, in a script or a shell with `vehicle ID`"
    )]
    Ambiguous(String),
    /// The vehicle that was named does not answer.
    #[error("vehicle {requested} does not answer; discovered: {found}")]
    NoSuchVehicle {
        /// The vehicle named.
        requested: Id,
        /// Those that are there.
        found: String,
    },
    /// What needs status needs LOI 2.
    #[error("vehicle {0}: this CUCS holds no LOI and receives no status; run `cucs take` first")]
    NoRights(Id),
    /// No handover request came that could be answered.
    #[error(
        "vehicle {vehicle}: no handover request of {from} received within {within_s} s; it requests with `cucs --id ID ask`; to \
         offer without a request: `cucs successor ID`"
    )]
    NobodyAsks {
        /// The vehicle.
        vehicle: Id,
        /// Who was to request.
        from: String,
        /// How long was waited, s.
        within_s: f64,
    },
    /// No offer came that could be accepted.
    #[error(
        "vehicle {0}: no offer received within {1} s; the holder offers with `cucs successor ID`; to request what it holds: \
         `cucs ask`"
    )]
    NothingOffered(Id, f64),
    /// What is waited for comes of a route alone.
    #[error("vehicle {vehicle} flies no route: {why}")]
    NoRoute {
        /// The vehicle.
        vehicle: Id,
        /// Why, and what to do.
        why: String,
    },
    /// Edition 2.5 has no field for what is waited for.
    #[error(
        "{0} is not shown in Edition 2.5, whose #104 has no UA State; `wait below M` and `wait above M` wait for an altitude"
    )]
    NotShown(String),
    /// The VSM offers no such control.
    #[error(
        "no control {0}: `cucs controls` lists those that the VSM offers (its vehicle.controls)"
    )]
    NoControl(String),
    /// The download is incomplete.
    #[error("the plan refers to waypoints that were not received: {0}")]
    Incomplete(String),
    /// A file cannot be written.
    #[error("{} cannot be written: {source}; name a file in a folder that can be written, on a disk with free space", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A number of seconds out of range.
    #[error("{0} s is out of range: expected 0 to 1000000 s")]
    Seconds(f64),
    /// The output is closed.
    #[error("output: {0}")]
    Output(#[from] std::io::Error),
}

impl OperatorError {
    /// 2 where the request was wrong, 1 where it was refused or not answered, 141 where the reader of its output has gone.
    #[must_use]
    pub fn exit_status(&self) -> u8 {
        match self {
            Self::File(fault) => fault.exit_status(),
            Self::FenceFile(_)
            | Self::OtherKind { .. }
            | Self::Ambiguous(_)
            | Self::NotShown(_)
            | Self::Seconds(_) => 2,
            Self::Station(fault) => fault.exit_status(),
            Self::Output(fault) if fault.kind() == std::io::ErrorKind::BrokenPipe => READER_GONE,
            _ => 1,
        }
    }

    /// The texts of the 16000s that it gives as reasons.
    pub(super) fn reasons(&self) -> &[String] {
        match self {
            Self::Station(
                StationError::Refused(Refused { reasons, .. })
                | StationError::NotGranted { reasons, .. },
            ) => reasons,
            _ => &[],
        }
    }
}

/// Nobody reads the output any more, such as `head` that has seen enough: what a shell reports for programs that SIGPIPE ends.
pub(crate) const READER_GONE: u8 = 141;

impl From<Refused> for OperatorError {
    fn from(refused: Refused) -> Self {
        OperatorError::Station(refused.into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_reader_that_is_gone_is_no_refusal() {
        let status = |kind: std::io::ErrorKind| OperatorError::Output(kind.into()).exit_status();
        assert_eq!(status(std::io::ErrorKind::BrokenPipe), READER_GONE);
        assert_eq!(status(std::io::ErrorKind::StorageFull), 1);
    }
}
