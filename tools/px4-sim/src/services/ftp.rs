//! MAVLink FTP, the vehicle's end, as in PX4 v1.18: one session, the last short answer kept for a repeated request,
//! bursts of 35 000 bytes and of what the buffer of its socket holds, a session that is closed 10 s after the last
//! request.
//! Its pitfalls are here too: an error 17 (exists) colours later refusals; what it remembers of the path of an open file
//! It has PX4's pitfalls too: an error 17 (exists) changes later refusals; the path of an open file is forgotten 2 s
//! after the last request, and a later write is refused as protected; a repeat of number 65535 is a new request; a
//! session is closed during a burst where no request arrives. Paths are those of a flight board, where only the card
//! can be written to.

use std::time::Duration;

use mavlink::dialects::development::{FILE_TRANSFER_PROTOCOL_DATA, MavMessage};
use mavlink_link::service::ftp::crc32;
use mavlink_link::service::ftp::payload::{FtpError, MAX_DATA, Opcode, Payload, PayloadError};
use mavlink_link::service::{Bounded, Node};

use super::files::{Errno, Files, LOGS, ROOT};

/// The file server.
#[derive(Debug)]
pub struct Server {
    us: Node,
    files: Files,
    session: Option<Session>,
    last_reply: Option<(Node, Payload)>,
    /// `_our_errno` of PX4, which nothing resets.
    errno: u8,
    /// Whether PX4's working buffers still exist, and with them the path of the open file.
    path_kept: bool,
    accessed_at: Duration,
    pass_at: Duration,
    out: Bounded<MavMessage>,
}

#[derive(Debug)]
struct Session {
    path: String,
    size: u32,
    stream: Option<Stream>,
}

#[derive(Debug)]
struct Stream {
    to: Node,
    seq: u16,
    offset: u32,
    sent: u32,
}

struct Refusal {
    error: FtpError,
    errno: Option<Errno>,
}

const PROTECTED: Refusal = refuse(FtpError::MAV_FTP_ERR_FILEPROTECTED);
const SYSTEM: Refusal = refuse(FtpError::MAV_FTP_ERR_FAILERRNO);
const NO_SESSION: Refusal = refuse(FtpError::MAV_FTP_ERR_INVALIDSESSION);

const fn refuse(error: FtpError) -> Refusal {
    Refusal { error, errno: None }
}

impl From<Errno> for Refusal {
    fn from(errno: Errno) -> Self {
        Refusal {
            errno: Some(errno),
            ..SYSTEM
        }
    }
}

impl Server {
    /// A server of these files.
    #[must_use]
    pub fn new(us: Node, files: Files) -> Self {
        Self {
            us,
            files,
            session: None,
            last_reply: None,
            errno: 0,
            path_kept: false,
            accessed_at: Duration::ZERO,
            pass_at: Duration::ZERO,
            out: Bounded::new(MAX_OUT),
        }
    }

    /// The present files of the card.
    #[must_use]
    pub fn files(&self) -> &Files {
        &self.files
    }

    /// The files, to change them from outside, as a logger does.
    pub fn files_mut(&mut self) -> &mut Files {
        &mut self.files
    }

    /// Handles a message of `from`; returns whether it was for this service.
    pub fn handle_message(&mut self, now: Duration, from: Node, message: &MavMessage) -> bool {
        let MavMessage::FILE_TRANSFER_PROTOCOL(data) = message else {
            return false;
        };
        if !self.us.is_target(data.target_system, data.target_component) {
            return false;
        }
        self.accessed_at = now;
        let decoded = Payload::decode(&data.payload);
        let kept = std::mem::replace(&mut self.path_kept, true);
        let (request, outcome) = match decoded {
            Err(PayloadError::Size(_)) => {
                let request = header_only(data);
                (request, Err(refuse(FtpError::MAV_FTP_ERR_INVALIDDATASIZE)))
            }
            Ok(request) => {
                // Without wrapping, as in PX4's C++ code: a repeat of number 65535 is not recognised.
                if let Some((to, reply)) = &self.last_reply
                    && u32::from(request.seq) + 1 == u32::from(reply.seq)
                    && *to == from
                {
                    self.out.push(reply.message(from));
                    return true;
                }
                let outcome = self.work(now, from, &request, kept);
                (request, outcome)
            }
        };
        self.last_reply = None;
        let seq = request.seq.wrapping_add(1);
        let reply = match outcome {
            // A burst is answered by its packets.
            Ok(None) => return true,
            Ok(Some(data)) => Payload {
                seq,
                opcode: Opcode::MAV_FTP_OPCODE_ACK as u8,
                requested: request.opcode,
                ..request.with_data(&data)
            },
            Err(refusal) => {
                self.errno = refusal.errno.map_or(self.errno, |errno| errno as u8);
                let mut error = refusal.error;
                if self.errno == Errno::Exists as u8 {
                    error = FtpError::MAV_FTP_ERR_FILEEXISTS;
                } else if self.errno == Errno::NoEntry as u8
                    && error == FtpError::MAV_FTP_ERR_FAILERRNO
                {
                    error = FtpError::MAV_FTP_ERR_FILENOTFOUND;
                }
                let with_errno = error == FtpError::MAV_FTP_ERR_FAILERRNO;
                let data = [error as u8, self.errno];
                Payload {
                    seq,
                    opcode: Opcode::MAV_FTP_OPCODE_NAK as u8,
                    requested: request.opcode,
                    ..request.with_data(if with_errno { &data } else { &data[..1] })
                }
            }
        };
        self.reply(from, reply);
        true
    }

    /// Sends part of a burst, and closes an unused session.
    pub fn handle_timeout(&mut self, now: Duration) {
        if now < self.pass_at {
            return;
        }
        self.pass_at = now + PASS;
        let idle = now.saturating_sub(self.accessed_at);
        if idle > PATH_KEPT {
            self.path_kept = false;
        }
        if idle > SESSION_KEPT && self.session.is_some() {
            self.session = None;
            self.last_reply = None;
        }
        let mut room = SOCKET_ROOM;
        while self.stream_packet(&mut room) {}
    }

    /// When [`Server::handle_timeout`] is next needed.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Duration> {
        let session = self.session.as_ref()?;
        if session.stream.is_some() {
            return Some(self.pass_at);
        }
        Some(self.pass_at.max(self.accessed_at + SESSION_KEPT + PASS))
    }

    /// The next message to send.
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.out.pop()
    }

    fn reply(&mut self, to: Node, reply: Payload) {
        let no_sessions = FtpError::MAV_FTP_ERR_NOSESSIONSAVAILABLE as u8;
        if reply.size <= 4 && reply.data().first() != Some(&no_sessions) {
            self.last_reply = Some((to, reply.clone()));
        }
        self.out.push(reply.message(to));
    }

    fn work(
        &mut self,
        now: Duration,
        from: Node,
        request: &Payload,
        path_kept: bool,
    ) -> Result<Option<Vec<u8>>, Refusal> {
        use Opcode as O;
        let unknown = || refuse(FtpError::MAV_FTP_ERR_UNKNOWNCOMMAND);
        let done = Ok(Some(Vec::new()));
        match request.opcode().ok_or_else(unknown)? {
            O::MAV_FTP_OPCODE_NONE => Ok(Some(request.data().to_vec())),
            O::MAV_FTP_OPCODE_TERMINATESESSION => {
                self.open_session(request)?;
                self.session = None;
                done
            }
            O::MAV_FTP_OPCODE_RESETSESSION => {
                self.session = None;
                done
            }
            O::MAV_FTP_OPCODE_LISTDIRECTORY => self.list(request).map(Some),
            O::MAV_FTP_OPCODE_OPENFILERO => self.open(request, None).map(Some),
            O::MAV_FTP_OPCODE_CREATEFILE => self.open(request, Some(true)).map(Some),
            O::MAV_FTP_OPCODE_OPENFILEWO => self.open(request, Some(false)).map(Some),
            O::MAV_FTP_OPCODE_READFILE => self.read(request).map(Some),
            O::MAV_FTP_OPCODE_BURSTREADFILE => {
                let stream = Stream {
                    to: from,
                    seq: request.seq.wrapping_add(1),
                    offset: request.offset,
                    sent: 0,
                };
                self.open_session(request)?.stream = Some(stream);
                self.pass_at = self.pass_at.max(now);
                Ok(None)
            }
            O::MAV_FTP_OPCODE_WRITEFILE => {
                let path = self.open_session(request)?.path.clone();
                if !path_kept || !is_writable(&path) {
                    return Err(PROTECTED);
                }
                if !self.files.write(&path, request.offset, request.data()) {
                    return Err(SYSTEM);
                }
                Ok(Some(u32::from(request.size).to_le_bytes().to_vec()))
            }
            O::MAV_FTP_OPCODE_REMOVEFILE => {
                self.files.remove_file(&writable(request)?)?;
                done
            }
            O::MAV_FTP_OPCODE_REMOVEDIRECTORY => {
                self.files.remove_folder(&writable(request)?)?;
                done
            }
            O::MAV_FTP_OPCODE_CREATEDIRECTORY => {
                self.files.make_folder(&writable(request)?)?;
                done
            }
            O::MAV_FTP_OPCODE_TRUNCATEFILE => {
                self.files.truncate(&writable(request)?, request.offset)?;
                done
            }
            O::MAV_FTP_OPCODE_RENAME => {
                let mut names = request.data().split(|byte| *byte == 0);
                let mut name = || names.next().filter(|name| !name.is_empty());
                let (Some(from), Some(to)) = (name(), name()) else {
                    return Err(SYSTEM);
                };
                let (from, to) = (resolve(from)?, resolve(to)?);
                if !is_writable(&to) {
                    return Err(PROTECTED);
                }
                self.files.rename(&from, &to)?;
                done
            }
            O::MAV_FTP_OPCODE_CALCFILECRC => {
                let path = resolve(text(request))?;
                // errno keeps its value here.
                let content = self.files.get(&path).ok_or(SYSTEM)?;
                Ok(Some(crc32(0, content).to_le_bytes().to_vec()))
            }
            _ => Err(unknown()),
        }
    }

    fn open_session(&mut self, request: &Payload) -> Result<&mut Session, Refusal> {
        let session = self.session.as_mut().filter(|_| request.session == 0);
        session.ok_or(NO_SESSION)
    }

    /// `truncate` is `Some` where the file is opened for writing, and true where its contents are dropped.
    fn open(&mut self, request: &Payload, truncate: Option<bool>) -> Result<Vec<u8>, Refusal> {
        if self.session.is_some() {
            return Err(refuse(FtpError::MAV_FTP_ERR_NOSESSIONSAVAILABLE));
        }
        let path = resolve(text(request))?;
        // PX4 reads the size before it truncates.
        let size = self.files.get(&path).map_or(0, <[u8]>::len) as u32;
        match truncate {
            None if self.files.is_folder(&path) => return Err(Errno::IsFolder.into()),
            None if self.files.get(&path).is_none() => return Err(Errno::NoEntry.into()),
            None => {}
            // Files outside the card are in the firmware's image.
            Some(_) if !is_writable(&path) => return Err(Errno::ReadOnly.into()),
            Some(truncate) => self.files.create(&path, truncate)?,
        }
        self.session = Some(Session {
            path,
            size,
            stream: None,
        });
        Ok(size.to_le_bytes().to_vec())
    }

    fn read(&mut self, request: &Payload) -> Result<Vec<u8>, Refusal> {
        let session = self.open_session(request)?;
        if request.offset >= session.size {
            return Err(refuse(FtpError::MAV_FTP_ERR_EOF));
        }
        let path = session.path.clone();
        Ok(self
            .slice(&path, request.offset, request.size.into())
            .to_vec())
    }

    fn slice(&self, path: &str, offset: u32, length: usize) -> &[u8] {
        let content = self.files.get(path).unwrap_or_default();
        let rest = content.get(offset as usize..).unwrap_or_default();
        rest.get(..length).unwrap_or(rest)
    }

    fn list(&mut self, request: &Payload) -> Result<Vec<u8>, Refusal> {
        let folder = resolve(text(request))?;
        let Some(entries) = self.files.list(&folder) else {
            self.errno = Errno::NoEntry as u8;
            return Err(refuse(FtpError::MAV_FTP_ERR_FILENOTFOUND));
        };
        let texts = entries.into_iter().map(|(name, size)| match size {
            Some(size) => format!("F{name}\t{size}\0"),
            None => format!("D{name}\0"),
        });
        // `.` and `..` are skipped, but counted.
        let skipped = ["S\0".to_owned(), "S\0".to_owned()];
        let mut data = Vec::new();
        for text in skipped
            .into_iter()
            .chain(texts)
            .skip(request.offset as usize)
        {
            if data.len() + text.len() > MAX_DATA {
                break;
            }
            data.extend_from_slice(text.as_bytes());
        }
        self.errno = 0;
        if data.is_empty() {
            return Err(refuse(FtpError::MAV_FTP_ERR_EOF));
        }
        Ok(data)
    }

    /// Sends one packet of a burst; returns whether there is room for another.
    fn stream_packet(&mut self, room: &mut u32) -> bool {
        let Some(session) = &mut self.session else {
            return false;
        };
        let (path, size) = (session.path.clone(), session.size);
        let Some(mut stream) = session.stream.take() else {
            return false;
        };
        let packet = Payload {
            requested: Opcode::MAV_FTP_OPCODE_BURSTREADFILE as u8,
            offset: stream.offset,
            ..Payload::request(stream.seq, Opcode::MAV_FTP_OPCODE_ACK)
        };
        stream.seq = stream.seq.wrapping_add(1);
        let to = stream.to;
        if stream.offset >= size {
            let end = [FtpError::MAV_FTP_ERR_EOF as u8];
            let opcode = Opcode::MAV_FTP_OPCODE_NAK as u8;
            self.reply(
                to,
                Payload {
                    opcode,
                    ..packet.with_data(&end)
                },
            );
            return false;
        }
        let mut packet = packet.with_data(self.slice(&path, stream.offset, MAX_DATA));
        let length = u32::from(packet.size);
        stream.offset += length;
        stream.sent += length;
        let more = *room >= 2 * PACKET;
        *room = room.saturating_sub(PACKET);
        packet.burst_complete = !more && stream.sent > BURST;
        if !packet.burst_complete
            && let Some(session) = &mut self.session
        {
            session.stream = Some(stream);
        }
        self.reply(to, packet);
        more
    }
}

/// The data as a path, up to the first zero byte, as PX4 reads it.
fn text(request: &Payload) -> &[u8] {
    let data = request.data();
    data.split(|byte| *byte == 0).next().unwrap_or_default()
}

/// The path on the card; refused where one of its parts is `..`.
fn resolve(path: &[u8]) -> Result<String, Refusal> {
    let path = String::from_utf8_lossy(path);
    if path.split('/').any(|part| part == "..") {
        return Err(PROTECTED);
    }
    Ok(match path.strip_prefix("@MAV_LOG") {
        Some(rest) if rest.is_empty() || rest.starts_with('/') => format!("{LOGS}{rest}"),
        _ if path.starts_with('/') => path.into_owned(),
        _ => format!("/{path}"),
    })
}

fn writable(request: &Payload) -> Result<String, Refusal> {
    let path = resolve(text(request))?;
    if is_writable(&path) {
        Ok(path)
    } else {
        Err(PROTECTED)
    }
}

fn is_writable(path: &str) -> bool {
    path.strip_prefix(ROOT)
        .is_some_and(|rest| rest.starts_with('/'))
}

/// The answer to a request with an invalid size: the header only.
fn header_only(data: &FILE_TRANSFER_PROTOCOL_DATA) -> Payload {
    let mut bytes = data.payload;
    bytes[4] = 0;
    Payload::decode(&bytes).unwrap_or_else(|_| Payload::request(0, Opcode::MAV_FTP_OPCODE_NONE))
}

/// How often the receiver's loop runs its services.
const PASS: Duration = Duration::from_millis(10);
/// Room in a POSIX socket, bytes, whatever is on its way.
const SOCKET_ROOM: u32 = 15_000;
/// A message of its largest size with a frame and a signature.
const PACKET: u32 = 279;
/// Bytes after which PX4 ends a burst (mavlink_ftp.cpp).
const BURST: u32 = 35_000;
/// PX4 frees its working buffers this long after the last request.
const PATH_KEPT: Duration = Duration::from_secs(2);
/// PX4 closes a session this long after the last request.
const SESSION_KEPT: Duration = Duration::from_secs(10);
/// Messages that wait at most; a test may never poll them.
const MAX_OUT: usize = 256;
