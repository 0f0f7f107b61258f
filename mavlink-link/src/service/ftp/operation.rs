//! An operation: what is requested, how far it is, and how it ends.

use std::time::Duration;

use super::failure::Failure;
use super::listing::Entry;
use super::path::FilePath;
use super::payload::{Opcode, Payload};
use super::pending::Pending;
use super::read::Reading;
use super::write::{MAX_WRITE, Writing};

/// What an interrupted transfer had of a file.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Resume {
    /// Bytes that it had, from the beginning.
    pub offset: u32,
    /// Their `crc32`: the CRC32 of the whole file shows at the end whether they belong to it.
    pub crc: u32,
}

/// What to do.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Operation {
    /// List a folder.
    List(FilePath),
    /// Read a file, and compare its checksum.
    Read {
        /// Which.
        path: FilePath,
        /// From where an earlier transfer broke off; `None`: from the beginning.
        resume: Option<Resume>,
    },
    /// Write a file over whatever is there, and compare its checksum.
    Write {
        /// Which.
        path: FilePath,
        /// At most [`MAX_WRITE`] bytes.
        content: Vec<u8>,
    },
    /// Remove a file.
    Remove(FilePath),
    /// Remove an empty folder.
    RemoveDirectory(FilePath),
    /// Create a folder.
    CreateDirectory(FilePath),
}

/// How an operation ended well.
#[derive(Clone, PartialEq, Eq, Debug)]
pub enum Done {
    /// What a folder holds, in the vehicle's order.
    Listing(Vec<Entry>),
    /// The whole file was delivered; the vehicle's CRC32 is that of what was delivered.
    Read {
        /// Bytes.
        size: u32,
        /// Its CRC32.
        crc: u32,
    },
    /// The vehicle's CRC32 is that of what was sent.
    Written {
        /// Bytes.
        size: u32,
        /// Its CRC32.
        crc: u32,
    },
    /// Removed.
    Removed,
    /// Created.
    Created,
}

/// What a `Client` reports; every operation ends in exactly one [`Event::Ended`].
#[derive(Clone, PartialEq, Debug)]
pub enum Event {
    /// A file is open.
    Opened {
        /// Its size in bytes.
        size: u32,
    },
    /// The next bytes of the file that is read.
    Data(Vec<u8>),
    /// Bytes of the file that is written.
    Written {
        /// Confirmed.
        bytes: u32,
        /// Of so many.
        of: u32,
    },
    /// The end of the operation.
    Ended(Result<Done, Failure>),
}

/// Why an operation did not start.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum StartError {
    /// One is in progress, or its end is unread.
    #[error("a file operation is under way already: wait until it ends")]
    Busy,
    /// The content is too large.
    #[error("a file of {0} bytes: expected at most {max}", max = MAX_WRITE)]
    TooLarge(usize),
}

#[derive(Debug)]
pub(super) struct Active {
    pub(super) job: Job,
    pub(super) phase: Phase,
    pub(super) session: u8,
    /// Since when nothing was answered.
    pub(super) since: Duration,
    /// The last request.
    pub(super) asked_at: Duration,
    /// Since when another station has the session.
    pub(super) busy_since: Option<Duration>,
    pub(super) lost_sessions: u8,
}

#[derive(Debug)]
pub(super) enum Job {
    List {
        path: FilePath,
        entries: Vec<Entry>,
        at: u32,
    },
    Read {
        path: FilePath,
        resume: Option<Resume>,
        reading: Option<Reading>,
    },
    Write {
        path: FilePath,
        writing: Writing,
    },
    Once {
        path: FilePath,
        opcode: Opcode,
    },
}

#[expect(
    clippy::large_enum_variant,
    reason = "one value, moved at once: nothing is allocated for a packet"
)]
#[derive(Debug)]
pub(super) enum Phase {
    /// One request is unanswered.
    Asking(Pending),
    /// Another station has the session.
    Waiting { until: Duration },
    /// Pieces of the file are in flight.
    Transferring,
}

#[expect(
    clippy::large_enum_variant,
    reason = "one value, moved at once: nothing is allocated for a packet"
)]
pub(super) enum Next {
    Ask(Payload),
    Transfer,
    End(Result<Done, Failure>),
}

impl Job {
    pub(super) fn path(&self) -> &FilePath {
        match self {
            Self::List { path, .. }
            | Self::Read { path, .. }
            | Self::Write { path, .. }
            | Self::Once { path, .. } => path,
        }
    }

    /// Grows with each byte that had not been transferred before.
    pub(super) fn progress(&self) -> u64 {
        match self {
            Self::Read { reading, .. } => reading.as_ref().map_or(0, Reading::progress),
            Self::Write { writing, .. } => writing.confirmed as u64,
            Self::List { .. } | Self::Once { .. } => 0,
        }
    }

    pub(super) fn opening(&self) -> Opcode {
        match self {
            Self::List { .. } => Opcode::MAV_FTP_OPCODE_LISTDIRECTORY,
            Self::Read { .. } => Opcode::MAV_FTP_OPCODE_OPENFILERO,
            Self::Write { .. } => Opcode::MAV_FTP_OPCODE_CREATEFILE,
            Self::Once { opcode, .. } => *opcode,
        }
    }
}
