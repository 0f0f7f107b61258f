//! What becomes of a file operation that an operator of this computer asks for.

use mavlink_link::service::ftp::{Done, Failure, StartError};

/// Why a file operation is not done.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FileRefusal {
    /// No such vehicle.
    #[error("no vehicle {0}: expected one of {1}")]
    NoVehicle(String, String),
    /// Several are configured.
    #[error("several vehicles are configured ({0}): name one with --vehicle")]
    WhichVehicle(String),
    /// Nothing is received from it.
    #[error("no data from the vehicle: its files cannot be reached")]
    Silent,
    /// It is armed, or may be.
    #[error(
        "the vehicle {0}: files are written and removed on the ground only, while it is disarmed"
    )]
    InFlight(&'static str),
    /// Its checksum would keep PX4 from receiving for too long.
    #[error(
        "the file has {0} bytes, and the vehicle {1}: over {MAX_IN_FLIGHT} bytes are read while it is disarmed, since PX4 \
         receives no command while it computes their checksum"
    )]
    TooLargeInFlight(u32, &'static str),
    /// A signing key, or what it can be read by.
    #[error(
        "{0} is, or leads to, PX4's signing key: no path with \"mavlink\" or \"~\" in it, and none below dev or proc, is opened; keys are \
         changed by \"vsm key\", and leave the vehicle by no other way"
    )]
    KeyFile(String),
    /// Another operation is under way, or the file is too large.
    #[error(transparent)]
    NotStarted(#[from] StartError),
    /// It was begun, and has failed.
    #[error(transparent)]
    Failed(#[from] Failure),
}

/// What becomes of a file operation.
#[derive(Debug, Clone, PartialEq)]
pub enum FileEvent {
    /// A file is open: its size in bytes.
    Opened(u32),
    /// The next bytes of the file that is read.
    Data(Vec<u8>),
    /// Bytes confirmed as written, and of how many.
    Written(u32, u32),
    /// The end.
    Ended(Result<Done, FileRefusal>),
}

/// The operation that is under way.
#[derive(Debug, Default)]
pub(super) struct FileAccess {
    pub(super) writes: bool,
    /// Bytes of the file that is read, once it is open.
    pub(super) reads: u32,
    /// Why it was withdrawn.
    pub(super) stopped: Option<FileRefusal>,
}

/// PX4 computes the checksum of so much in well under a second, also from a slow card.
pub(super) const MAX_IN_FLIGHT: u32 = 256 * 1024;
