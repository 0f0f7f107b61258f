//! Why a subcommand was not carried out, and the exit status for it.

use std::path::PathBuf;

use stanag_msgs::Id;

use crate::fence::FenceFileError;
use crate::formats::FormatError;
use crate::station::outcome::{Refused, StationError};

/// Why a subcommand was not carried out.
#[derive(Debug, thiserror::Error)]
pub enum OperatorError {
    /// An error of the station, with its reason.
    #[error(transparent)]
    Station(#[from] StationError),
    /// The file of a route or fence is wrong, or something in it would be lost.
    #[error(transparent)]
    File(#[from] FormatError),
    /// A file for another command.
    #[error("{} is {kind}: {command}", path.display())]
    OtherKind {
        /// The file.
        path: PathBuf,
        /// What the file is.
        kind: &'static str,
        /// The command that reads it.
        command: &'static str,
    },
    /// A fence file.
    #[error(transparent)]
    FenceFile(#[from] FenceFileError),
    /// There are several vehicles, and none was named.
    #[error(
        "several vehicles are there: {0}; choose one with --vehicle ID, in a script or a shell with `vehicle ID`"
    )]
    Ambiguous(String),
    /// The named vehicle does not answer.
    #[error("vehicle {requested} does not answer; discovered: {found}")]
    NoSuchVehicle {
        /// The named vehicle.
        requested: Id,
        /// The discovered vehicles.
        found: String,
    },
    /// The subcommand needs status, and so LOI 2.
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
        /// The expected requester.
        from: String,
        /// How long the station waited, s.
        within_s: f64,
    },
    /// No offer came that could be accepted.
    #[error(
        "vehicle {0}: no offer received within {1} s; the holder offers with `cucs successor ID`; to request what it holds: \
         `cucs ask`"
    )]
    NothingOffered(Id, f64),
    /// The condition can occur on a route only.
    #[error("vehicle {vehicle} flies no route: {why}")]
    NoRoute {
        /// The vehicle.
        vehicle: Id,
        /// Why, and what to do.
        why: String,
    },
    /// Edition 2.5 has no field for the condition.
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
    /// 2 where the request was wrong, 1 where it was refused or not answered, 141 where the reader of the output has
    /// closed it.
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

    /// The texts of the 16000s that it quotes as reasons.
    pub(super) fn reasons(&self) -> &[String] {
        match self {
            Self::Station(
                StationError::Refused(Refused { reasons, .. })
                | StationError::NotGranted { reasons, .. }
                | StationError::NotReleased { reasons, .. },
            ) => reasons,
            _ => &[],
        }
    }
}

/// The reader of the output has closed it, such as `head` after its last line: the status that a shell reports for a
/// program that SIGPIPE ends.
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
