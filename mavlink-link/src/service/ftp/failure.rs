//! Why an operation ended without its result.

use super::payload::{FtpError, Opcode};

/// How a peer contradicted itself, or what it sent that cannot be true.
#[derive(Clone, PartialEq, Eq, Debug, thiserror::Error)]
pub enum Lie {
    /// Data beyond the end of the file.
    #[error(
        "sends {length} bytes at {offset} of a file that it announced with {size} bytes (a log that is still written grows: read it once it is closed)"
    )]
    BeyondEnd {
        /// Where they begin.
        offset: u32,
        /// How many there are.
        length: usize,
        /// FILE_TRANSFER_PROTOCOL: the size that Open was answered with.
        size: u32,
    },
    /// The end of the file before the size that was announced.
    #[error("reports the end of the file at {at} of {size} announced bytes")]
    EarlyEnd {
        /// Where it was asked to read.
        at: u32,
        /// The announced size.
        size: u32,
    },
    /// Other bytes than it was asked for.
    #[error("answers a read of {expected} bytes at {offset} with {length} bytes")]
    Length {
        /// Where it was asked to read.
        offset: u32,
        /// How many bytes it was asked for.
        expected: usize,
        /// How many it sent.
        length: usize,
    },
    /// Two contents of one place.
    #[error("has sent two different contents of the byte range at {0}")]
    TwoContents(u32),
    /// Another number than Open, Write and CalcFileCRC32 are answered with.
    #[error("answers {0} with {1} bytes of data: expected 4")]
    Number(&'static str, u8),
    /// Written another number of bytes.
    #[error("confirms {confirmed} bytes of {sent} written at {offset}: its storage may be full")]
    Written {
        /// Where.
        offset: u32,
        /// How many were sent.
        sent: usize,
        /// How many it confirms.
        confirmed: u32,
    },
    /// An entry of a directory that is none.
    #[error("lists an entry that is none: {0:?}")]
    Entry(String),
    /// A listing that does not end.
    #[error("lists over {0} entries")]
    Endless(usize),
    /// A list answer without an entry, where the end is reported by EOF.
    #[error("answers a listing with no entry at {0}: expected entries or the end")]
    EmptyListing(u32),
    /// A message whose lengths contradict each other.
    #[error("announces {0} bytes of data in one message: expected at most 239")]
    Size(u8),
}

/// Why an operation ended without its result.
#[derive(Clone, PartialEq, Debug, thiserror::Error)]
pub enum Failure {
    /// Nothing for as long as `Timing::silence`.
    #[error(
        "no answer to {request} for {seconds} s: the vehicle or its link is silent, its MAVLink FTP is off, or an agent between does not pass message 110 (relay.messages of its airside.toml, which leaves it out by default)"
    )]
    NoAnswer {
        /// What was requested.
        request: &'static str,
        /// For how long.
        seconds: u64,
    },
    /// NAK.
    #[error("the vehicle refuses {request}: {}", reason(*error, *errno))]
    Refused {
        /// What was requested.
        request: &'static str,
        /// Its reason.
        error: FtpError,
        /// The errno of its operating system, where it sends one.
        errno: Option<u8>,
    },
    /// PX4 has a single session, and another station uses it.
    #[error(
        "the vehicle's only FTP session is in use by another station, still after {seconds} s: try again later"
    )]
    Busy {
        /// How long it was tried.
        seconds: u64,
    },
    /// The file is another than when its transfer began.
    #[error(
        "the file has {is} bytes and had {was} or more: it has changed on the vehicle, or is still written; read it again from its beginning"
    )]
    Changed {
        /// Its size at first.
        was: u32,
        /// Its size now.
        is: u32,
    },
    /// The transferred bytes are not those on the vehicle.
    #[error(
        "checksum {ours:#010x} of what was transferred, {vehicle:#010x} on the vehicle: the file has changed meanwhile, or the transfer was disturbed; transfer it again from its beginning"
    )]
    Checksum {
        /// Of what was transferred.
        ours: u32,
        /// CalcFileCRC32
        vehicle: u32,
    },
    /// The session ended too often.
    #[error(
        "the vehicle has ended the session {0} times: it restarts, or another station resets its sessions"
    )]
    Unstable(u8),
    /// The peer contradicts itself.
    #[error("the vehicle {0}: not believed")]
    Lie(#[from] Lie),
    /// The caller withdrew it.
    #[error("withdrawn")]
    Withdrawn,
}

pub(super) fn name(opcode: Opcode) -> &'static str {
    use Opcode as O;
    match opcode {
        O::MAV_FTP_OPCODE_NONE => "None",
        O::MAV_FTP_OPCODE_TERMINATESESSION => "TerminateSession",
        O::MAV_FTP_OPCODE_RESETSESSION => "ResetSessions",
        O::MAV_FTP_OPCODE_LISTDIRECTORY => "ListDirectory",
        O::MAV_FTP_OPCODE_OPENFILERO => "OpenFileRO",
        O::MAV_FTP_OPCODE_READFILE => "ReadFile",
        O::MAV_FTP_OPCODE_CREATEFILE => "CreateFile",
        O::MAV_FTP_OPCODE_WRITEFILE => "WriteFile",
        O::MAV_FTP_OPCODE_REMOVEFILE => "RemoveFile",
        O::MAV_FTP_OPCODE_CREATEDIRECTORY => "CreateDirectory",
        O::MAV_FTP_OPCODE_REMOVEDIRECTORY => "RemoveDirectory",
        O::MAV_FTP_OPCODE_CALCFILECRC => "CalcFileCRC32",
        O::MAV_FTP_OPCODE_BURSTREADFILE => "BurstReadFile",
        _ => "a request",
    }
}

fn reason(error: FtpError, errno: Option<u8>) -> String {
    use FtpError as E;
    let text = match error {
        E::MAV_FTP_ERR_NONE | E::MAV_FTP_ERR_FAIL => "it failed, without a reason",
        // PX4 v1.18 sends its errno where it has one; the common ones are those of POSIX.
        E::MAV_FTP_ERR_FAILERRNO => {
            return match errno {
                Some(2) => "no such file or folder (errno 2)".to_owned(),
                Some(13) => "permission denied (errno 13)".to_owned(),
                Some(20) => "a part of the path is no folder (errno 20)".to_owned(),
                Some(21) => "it is a folder (errno 21)".to_owned(),
                Some(28) => "its storage is full (errno 28)".to_owned(),
                Some(30) => "it is on a read-only file system (errno 30)".to_owned(),
                Some(39) => "the folder is not empty (errno 39)".to_owned(),
                Some(errno) => format!("its system's error {errno}"),
                None => "its system's error, without a number".to_owned(),
            };
        }
        E::MAV_FTP_ERR_INVALIDDATASIZE => "the size of the data is invalid",
        E::MAV_FTP_ERR_INVALIDSESSION => "no such session",
        E::MAV_FTP_ERR_NOSESSIONSAVAILABLE => "all sessions are in use",
        E::MAV_FTP_ERR_EOF => "the end is reached",
        E::MAV_FTP_ERR_UNKNOWNCOMMAND => "it does not know this request",
        E::MAV_FTP_ERR_FILEEXISTS => "the file or folder exists already",
        E::MAV_FTP_ERR_FILEPROTECTED => "it is protected",
        E::MAV_FTP_ERR_FILENOTFOUND => "no such file or folder",
    };
    text.to_owned()
}
