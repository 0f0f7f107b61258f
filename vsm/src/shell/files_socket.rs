//! `vsm files`: a Unix socket in the store folder, over which any user who may enter the folder can access the files of a
//! vehicle.
//!
//! The client sends one line of JSON, a [`Request`], followed by the content of a file that it writes. It receives lines of
//! JSON, [`Reply`]s; a [`Reply::Data`] is followed by its bytes. [`Reply::Refused`], [`Reply::Listing`] and [`Reply::Done`]
//! are the last. A client that disconnects withdraws its request.

use std::io::{self, BufRead as _, BufReader, Read as _, Write as _};
use std::net::Shutdown;
use std::os::unix::net::UnixStream as BlockingStream;
use std::path::Path;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use super::status_socket;

/// A client's request.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// The vehicle's id; absent: the only one.
    pub vehicle: Option<String>,
    /// A path on the vehicle.
    pub path: String,
    /// What to do there.
    pub action: Action,
}

/// What to do with a path.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// List a folder.
    List,
    /// Read a file, from what the client already has: its length, and its CRC32.
    Read {
        /// Bytes.
        offset: u32,
        /// CRC32.
        crc: u32,
    },
    /// Write a file of this many bytes, which follow.
    Write {
        /// Bytes.
        length: usize,
    },
    /// Remove a file.
    Remove,
    /// Remove an empty folder.
    RemoveFolder,
    /// Create a folder.
    CreateFolder,
}

/// An answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Reply {
    /// The file is open: its size in bytes.
    Opened(u32),
    /// This many bytes of it follow.
    Data(usize),
    /// Bytes confirmed as written, and of how many.
    Written(u32, u32),
    /// What the folder holds.
    Listing(Vec<Entry>),
    /// Done: the size of the file and the CRC32 that both ends have of it.
    Done {
        /// Bytes.
        size: u32,
        /// CRC32.
        crc: u32,
    },
    /// Not done, and why; and whether a transfer of it must start again.
    Refused {
        /// Why.
        why: String,
        /// What was transferred is not a part of the file.
        anew: bool,
    },
}

/// An entry of a folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Entry {
    /// Its name.
    pub name: String,
    /// Size in bytes; `None` for a folder.
    pub size: Option<u32>,
}

/// A client of a running bridge.
#[derive(Debug)]
pub struct Asker(BufReader<BlockingStream>);

impl Asker {
    /// Sends a request, and the content to write.
    ///
    /// # Errors
    /// No bridge is running on this store, or it has hung up.
    pub fn ask(store: &Path, request: &Request, content: &[u8]) -> io::Result<Asker> {
        let mut stream = BlockingStream::connect(status_socket::path(store, status_socket::FILES))?;
        stream.set_read_timeout(Some(ANSWER_WITHIN))?;
        let line = serde_json::to_string(request)? + "\n";
        stream.write_all(line.as_bytes())?;
        // A bridge that refuses closes before it has read the content. Its answer can be read nevertheless.
        if stream.write_all(content).is_ok() && content.is_empty() {
            stream.flush()?;
        }
        Ok(Asker(BufReader::new(stream)))
    }

    /// The next answer, with the bytes that follow it; `None` once the bridge has hung up.
    ///
    /// # Errors
    /// An error of the system, or an invalid answer.
    pub fn receive(&mut self) -> io::Result<Option<(Reply, Vec<u8>)>> {
        let mut line = String::new();
        // A line that the bound cuts off is no JSON.
        if (&mut self.0).take(MAX_LINE_BYTES).read_line(&mut line)? == 0 {
            return Ok(None);
        }
        let reply: Reply = serde_json::from_str(&line)?;
        let mut bytes = Vec::new();
        if let Reply::Data(length) = reply {
            if length > MAX_DATA_BYTES {
                let problem = format!(
                    "the bridge announces {length} bytes in one piece, expected at most {MAX_DATA_BYTES}"
                );
                return Err(io::Error::new(io::ErrorKind::InvalidData, problem));
            }
            bytes.resize(length, 0);
            self.0.read_exact(&mut bytes)?;
        }
        Ok(Some((reply, bytes)))
    }

    /// Disconnects, so that the bridge withdraws the operation.
    pub fn close(self) {
        let _ = self.0.into_inner().shutdown(Shutdown::Both);
    }
}

/// Whoever owns the store answers, perhaps to root, whose memory is not its to fill: more than the listing of a folder.
const MAX_LINE_BYTES: u64 = 16 << 20;
/// Far more than PX4 sends in one message.
const MAX_DATA_BYTES: usize = 1 << 20;

/// The longest silence during an operation: the checksum of a large file.
pub const ANSWER_WITHIN: Duration = Duration::from_secs(300);
