//! The client: one operation at a time, one session at a time, as PX4 has one.
//!
//! What PX4 v1.18 does, and what follows from it here:
//! - it answers a repeated request from memory where the number is that of the last one: a repeat keeps its number, and a
//!   first request of [`Opcode::MAV_FTP_OPCODE_NONE`] overwrites what an earlier station of this address has left there;
//! - it does not recognise a repeat of number 65535, so that number is never used;
//! - it closes a session 10 s after the last request, in the middle of a burst too: a request is sent before that;
//! - its error 8 (exists) sticks once a request has met it: an Open for reading that is refused by it is refused
//!   because the session is in use;
//! - it computes the CRC32 in the thread that receives, and answers nothing meanwhile.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink::dialects::development::MavMessage;

use super::checksum::crc32;
use super::failure::{Failure, Lie, name};
use super::listing::{self, Entry};
use super::path::FilePath;
use super::payload::{FtpError, Opcode, Payload, PayloadError};
use super::pending::{Pending, Timing};
use super::read::{MAX_UNREAD, Reading, Want};
use super::write::{MAX_WRITE, Writing};
use crate::frame::Node;
use crate::service::bounded::Bounded;

/// What a transfer that broke off had of a file.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Resume {
    /// Bytes that it had, from the beginning.
    pub offset: u32,
    /// Their [`crc32`]: that of the whole file shows at the end whether they belong to it.
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

/// What a [`Client`] reports; every operation ends in exactly one [`Event::Ended`].
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

/// Why an operation was not begun.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum StartError {
    /// One is under way, or its end is unread.
    #[error("a file operation is under way already: wait until it ends")]
    Busy,
    /// The content is too large.
    #[error("a file of {0} bytes: expected at most {max}", max = MAX_WRITE)]
    TooLarge(usize),
}

/// The files of one node.
#[derive(Debug)]
pub struct Client {
    us: Node,
    vehicle: Node,
    timing: Timing,
    /// Bytes a second that are requested at most; `None`: bursts.
    rate: Option<u32>,
    seq: u16,
    /// What the vehicle keeps of the last request is of this client.
    synchronised: bool,
    /// A session of ours may be open still.
    left_open: bool,
    active: Option<Active>,
    out: Bounded<MavMessage>,
    events: VecDeque<Event>,
    unread: Vec<u8>,
}

#[derive(Debug)]
struct Active {
    job: Job,
    phase: Phase,
    session: u8,
    /// Since when nothing was answered.
    since: Duration,
    /// The last request.
    asked_at: Duration,
    /// Since when another station has the session.
    busy_since: Option<Duration>,
    lost_sessions: u8,
}

#[derive(Debug)]
enum Job {
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
enum Phase {
    /// One request is to be answered.
    Asking(Pending),
    /// Another station has the session.
    Waiting { until: Duration },
    /// Pieces of the file.
    Transferring,
}

#[expect(
    clippy::large_enum_variant,
    reason = "one value, moved at once: nothing is allocated for a packet"
)]
enum Next {
    Ask(Payload),
    Transfer,
    End(Result<Done, Failure>),
}

impl Job {
    fn path(&self) -> &FilePath {
        match self {
            Self::List { path, .. }
            | Self::Read { path, .. }
            | Self::Write { path, .. }
            | Self::Once { path, .. } => path,
        }
    }

    /// Grows with each byte that had not been transferred before.
    fn progress(&self) -> u64 {
        match self {
            Self::Read { reading, .. } => reading.as_ref().map_or(0, Reading::progress),
            Self::Write { writing, .. } => writing.confirmed as u64,
            Self::List { .. } | Self::Once { .. } => 0,
        }
    }

    fn opening(&self) -> Opcode {
        match self {
            Self::List { .. } => Opcode::MAV_FTP_OPCODE_LISTDIRECTORY,
            Self::Read { .. } => Opcode::MAV_FTP_OPCODE_OPENFILERO,
            Self::Write { .. } => Opcode::MAV_FTP_OPCODE_CREATEFILE,
            Self::Once { opcode, .. } => *opcode,
        }
    }
}

impl Client {
    /// A client named `us` on the link, for the files of `vehicle`.
    #[must_use]
    pub const fn new(us: Node, vehicle: Node, timing: Timing) -> Self {
        Self {
            us,
            vehicle,
            timing,
            rate: None,
            seq: 0,
            synchronised: false,
            left_open: false,
            active: None,
            out: Bounded::new(MAX_OUT),
            events: VecDeque::new(),
            unread: Vec::new(),
        }
    }

    /// Limits what is requested to so many bytes a second, or lifts the limit; from the next request on.
    pub const fn limit(&mut self, bytes_per_s: Option<u32>) {
        self.rate = bytes_per_s;
    }

    /// Begins an operation.
    ///
    /// # Errors
    /// One is under way or its end is unread, or a file is too large to be written.
    pub fn start(&mut self, now: Duration, operation: Operation) -> Result<(), StartError> {
        if self.active.is_some() || !self.events.is_empty() || !self.unread.is_empty() {
            return Err(StartError::Busy);
        }
        let once = |path, opcode| Job::Once { path, opcode };
        let job = match operation {
            Operation::List(path) => Job::List {
                path,
                entries: Vec::new(),
                at: 0,
            },
            Operation::Read { path, resume } => Job::Read {
                path,
                resume,
                reading: None,
            },
            Operation::Write { content, .. } if content.len() > MAX_WRITE => {
                return Err(StartError::TooLarge(content.len()));
            }
            Operation::Write { path, content } => Job::Write {
                path,
                writing: Writing::new(content),
            },
            Operation::Remove(path) => once(path, Opcode::MAV_FTP_OPCODE_REMOVEFILE),
            Operation::RemoveDirectory(path) => once(path, Opcode::MAV_FTP_OPCODE_REMOVEDIRECTORY),
            Operation::CreateDirectory(path) => once(path, Opcode::MAV_FTP_OPCODE_CREATEDIRECTORY),
        };
        // Beyond what a late burst of an earlier file may be numbered with.
        self.seq = self.seq.wrapping_add(BETWEEN_OPERATIONS);
        let first = if self.synchronised {
            self.opening(&job)
        } else {
            self.request(Opcode::MAV_FTP_OPCODE_NONE)
        };
        let mut active = Active {
            job,
            phase: Phase::Transferring,
            session: 0,
            since: now,
            asked_at: now,
            busy_since: None,
            lost_sessions: 0,
        };
        self.ask(now, &mut active, first);
        self.active = Some(active);
        Ok(())
    }

    /// Ends the operation that is under way, with [`Failure::Withdrawn`].
    pub fn withdraw(&mut self) {
        if let Some(active) = self.active.take() {
            self.end(active, Err(Failure::Withdrawn));
        }
    }

    /// Whether an operation is under way.
    #[must_use]
    pub const fn is_active(&self) -> bool {
        self.active.is_some()
    }

    /// Takes a message of `from`; `fresh` is false when it may be a replay. Returns whether it was for this client.
    pub fn handle_message(
        &mut self,
        now: Duration,
        from: Node,
        message: &MavMessage,
        fresh: bool,
    ) -> bool {
        let MavMessage::FILE_TRANSFER_PROTOCOL(data) = message else {
            return false;
        };
        let for_us = self.us == Node::new(data.target_system, data.target_component);
        if !fresh || from != self.vehicle || !for_us {
            return false;
        }
        let Some(mut active) = self.active.take() else {
            return false;
        };
        let next = match Payload::decode(&data.payload) {
            Ok(payload) => self.handle_answer(now, &mut active, &payload),
            Err(PayloadError::Size(size)) => Some(Next::End(Err(Lie::Size(size).into()))),
        };
        self.follow(now, active, next);
        true
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Duration) {
        let Some(mut active) = self.active.take() else {
            return;
        };
        let mut next = None;
        let silence = self.silence(&active);
        match &mut active.phase {
            Phase::Waiting { until } if *until <= now => {
                active.since = now;
                next = Some(Next::Ask(self.opening(&active.job)));
            }
            Phase::Waiting { .. } => {}
            Phase::Asking(_) | Phase::Transferring
                if now.saturating_sub(active.since) >= silence =>
            {
                let request = self.under_way(&active);
                next = Some(if request == "TerminateSession" {
                    self.closed(&active)
                } else {
                    Next::End(Err(Failure::NoAnswer {
                        request,
                        seconds: silence.as_secs(),
                    }))
                });
            }
            Phase::Asking(pending) if pending.deadline <= now => {
                pending.repeat(now, &self.timing);
                active.asked_at = now;
                self.out.push(pending.payload.message(self.vehicle));
            }
            Phase::Asking(_) | Phase::Transferring => {}
        }
        self.follow(now, active, next);
    }

    /// When [`Client::handle_timeout`] is next needed.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Duration> {
        let active = self.active.as_ref()?;
        let silent = active.since + self.silence(active);
        match &active.phase {
            Phase::Waiting { until } => Some(*until),
            Phase::Asking(pending) => Some(pending.deadline.min(silent)),
            Phase::Transferring => {
                let transfer = match &active.job {
                    Job::Read { reading, .. } => (reading.as_ref())
                        .and_then(|reading| reading.poll_timeout(self.rate, self.unread.len())),
                    Job::Write { writing, .. } => writing.poll_timeout(),
                    Job::List { .. } | Job::Once { .. } => None,
                };
                let keep_alive = active.asked_at + self.timing.keep_alive;
                transfer.into_iter().chain([silent, keep_alive]).min()
            }
        }
    }

    /// The next message for the vehicle.
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.out.pop()
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        // What was read comes before the end of the operation, and after the opening.
        if !self.unread.is_empty() && !matches!(self.events.front(), Some(Event::Opened { .. })) {
            return Some(Event::Data(std::mem::take(&mut self.unread)));
        }
        self.events.pop_front()
    }

    fn handle_answer(
        &mut self,
        now: Duration,
        active: &mut Active,
        payload: &Payload,
    ) -> Option<Next> {
        let accepted = match payload.opcode() {
            Some(Opcode::MAV_FTP_OPCODE_ACK) => true,
            Some(Opcode::MAV_FTP_OPCODE_NAK) => false,
            // A request of another station, or one of the vehicle's own.
            _ => return None,
        };
        match &mut active.phase {
            Phase::Asking(pending) => {
                if payload.seq != pending.payload.seq.wrapping_add(1) {
                    return None;
                }
                if payload.requested != pending.payload.opcode {
                    // The answer to an earlier request of this number, from the vehicle's memory.
                    let mut again = pending.payload.clone();
                    again.seq = self.number();
                    return Some(Next::Ask(again));
                }
                active.since = now;
                let repeated = pending.repeats > 0;
                if accepted {
                    self.accepted(active, payload)
                } else {
                    self.refused(now, active, payload, repeated)
                }
            }
            Phase::Transferring => self.transferred(now, active, payload, accepted),
            Phase::Waiting { .. } => None,
        }
    }

    /// What follows from the ACK of the request that is asked.
    fn accepted(&mut self, active: &mut Active, payload: &Payload) -> Option<Next> {
        use Opcode as O;
        let Phase::Asking(pending) = &active.phase else {
            return None;
        };
        let opcode = pending.payload.opcode()?;
        if opcode == O::MAV_FTP_OPCODE_TERMINATESESSION {
            return Some(self.closed(active));
        }
        Some(match (opcode, &mut active.job) {
            (O::MAV_FTP_OPCODE_NONE | O::MAV_FTP_OPCODE_RESETSESSION, job) => {
                self.synchronised = true;
                self.left_open &= opcode == O::MAV_FTP_OPCODE_NONE;
                Next::Ask(self.opening(job))
            }
            (O::MAV_FTP_OPCODE_LISTDIRECTORY, Job::List { path, entries, at }) => {
                match listing::append(entries, payload.data()) {
                    Err(lie) => Next::End(Err(lie.into())),
                    Ok(0) => Next::End(Err(Lie::EmptyListing(*at).into())),
                    Ok(_) if entries.len() > MAX_ENTRIES || *at as usize > MAX_ENTRIES => {
                        Next::End(Err(Lie::Endless(MAX_ENTRIES).into()))
                    }
                    Ok(count) => {
                        *at += count;
                        let (at, path) = (*at, path.clone());
                        let request = self.request(opcode).with_data(path.as_str().as_bytes());
                        Next::Ask(Payload {
                            offset: at,
                            ..request
                        })
                    }
                }
            }
            (
                O::MAV_FTP_OPCODE_OPENFILERO,
                Job::Read {
                    resume, reading, ..
                },
            ) => {
                self.left_open = true;
                active.session = payload.session;
                let Some(size) = payload.number() else {
                    let lie = Lie::Number("OpenFileRO", payload.size);
                    return Some(Next::End(Err(lie.into())));
                };
                let before = reading
                    .as_ref()
                    .map(|one| one.size)
                    .filter(|was| *was != size);
                let beyond = resume.map(|one| one.offset).filter(|had| *had > size);
                if let Some(was) = before.or(beyond) {
                    return Some(Next::End(Err(Failure::Changed { was, is: size })));
                }
                match reading {
                    Some(reading) => reading.begin_again(),
                    None => {
                        let (from, crc) = resume.map_or((0, 0), |one| (one.offset, one.crc));
                        *reading = Some(Reading::new(size, from, crc));
                        self.events.push_back(Event::Opened { size });
                    }
                }
                Next::Transfer
            }
            (O::MAV_FTP_OPCODE_CREATEFILE, Job::Write { writing, .. }) => {
                self.left_open = true;
                active.session = payload.session;
                writing.begin_again();
                Next::Transfer
            }
            (O::MAV_FTP_OPCODE_CALCFILECRC, job) => {
                let Some(vehicle) = payload.number() else {
                    let lie = Lie::Number("CalcFileCRC32", payload.size);
                    return Some(Next::End(Err(lie.into())));
                };
                let (size, ours, read) = match job {
                    Job::Read {
                        reading: Some(reading),
                        ..
                    } => (reading.size, reading.crc, true),
                    Job::Write { writing, .. } => {
                        let content = &writing.content;
                        (content.len() as u32, crc32(0, content), false)
                    }
                    _ => return None,
                };
                Next::End(match (ours == vehicle, read) {
                    (false, _) => Err(Failure::Checksum { ours, vehicle }),
                    (true, true) => Ok(Done::Read { size, crc: ours }),
                    (true, false) => Ok(Done::Written { size, crc: ours }),
                })
            }
            (O::MAV_FTP_OPCODE_CREATEDIRECTORY, _) => Next::End(Ok(Done::Created)),
            (_, Job::Once { .. }) => Next::End(Ok(Done::Removed)),
            _ => return None,
        })
    }

    /// What follows from the NAK of the request that is asked.
    fn refused(
        &mut self,
        now: Duration,
        active: &mut Active,
        payload: &Payload,
        repeated: bool,
    ) -> Option<Next> {
        use FtpError as E;
        use Opcode as O;
        let Phase::Asking(pending) = &active.phase else {
            return None;
        };
        let opcode = pending.payload.opcode()?;
        let (error, errno) = payload.error();
        let opens = matches!(
            opcode,
            O::MAV_FTP_OPCODE_OPENFILERO | O::MAV_FTP_OPCODE_CREATEFILE
        );
        let in_use = error == E::MAV_FTP_ERR_NOSESSIONSAVAILABLE
            || opens && error == E::MAV_FTP_ERR_FILEEXISTS;
        Some(match (opcode, error) {
            // ArduPilot refuses it: an answer is an answer.
            (O::MAV_FTP_OPCODE_NONE, _) => {
                self.synchronised = true;
                Next::Ask(self.opening(&active.job))
            }
            (O::MAV_FTP_OPCODE_TERMINATESESSION, _) => self.closed(active),
            (O::MAV_FTP_OPCODE_LISTDIRECTORY, E::MAV_FTP_ERR_EOF) => {
                let Job::List { entries, .. } = &mut active.job else {
                    return None;
                };
                Next::End(Ok(Done::Listing(std::mem::take(entries))))
            }
            // Only a session that may be ours is reset: another station's transfer would break off.
            _ if opens && in_use && self.left_open => {
                Next::Ask(self.request(O::MAV_FTP_OPCODE_RESETSESSION))
            }
            _ if opens && in_use => {
                let since = *active.busy_since.get_or_insert(now);
                let waited = now.saturating_sub(since);
                if waited >= self.timing.busy_total {
                    let seconds = waited.as_secs();
                    return Some(Next::End(Err(Failure::Busy { seconds })));
                }
                let until = now + self.timing.busy;
                active.phase = Phase::Waiting { until };
                return None;
            }
            // The answer to the first of the requests was lost, and another request came between.
            (
                O::MAV_FTP_OPCODE_REMOVEFILE | O::MAV_FTP_OPCODE_REMOVEDIRECTORY,
                E::MAV_FTP_ERR_FILENOTFOUND,
            ) if repeated => Next::End(Ok(Done::Removed)),
            (O::MAV_FTP_OPCODE_CREATEDIRECTORY, E::MAV_FTP_ERR_FILEEXISTS) if repeated => {
                Next::End(Ok(Done::Created))
            }
            _ => {
                let request = name(opcode);
                Next::End(Err(Failure::Refused {
                    request,
                    error,
                    errno,
                }))
            }
        })
    }

    /// An answer while pieces are on their way.
    fn transferred(
        &mut self,
        now: Duration,
        active: &mut Active,
        payload: &Payload,
        accepted: bool,
    ) -> Option<Next> {
        use Opcode as O;
        const READ: u8 = O::MAV_FTP_OPCODE_READFILE as u8;
        const BURST: u8 = O::MAV_FTP_OPCODE_BURSTREADFILE as u8;
        const WRITE: u8 = O::MAV_FTP_OPCODE_WRITEFILE as u8;
        let (error, errno) = payload.error();
        let before = active.job.progress();
        let outcome = match (&mut active.job, payload.requested) {
            (
                Job::Read {
                    reading: Some(reading),
                    ..
                },
                READ,
            ) => {
                let piece = reading.answered(payload)?;
                let (offset, expected) = (piece.payload.offset, usize::from(piece.payload.size));
                let length = payload.data().len();
                if !accepted && error == FtpError::MAV_FTP_ERR_EOF {
                    Err(Lie::EarlyEnd {
                        at: offset,
                        size: reading.size,
                    }
                    .into())
                } else if !accepted {
                    Err(refusal(O::MAV_FTP_OPCODE_READFILE, error, errno))
                } else if length == 0 || length > expected || payload.offset != offset {
                    Err(Lie::Length {
                        offset,
                        expected,
                        length,
                    }
                    .into())
                } else {
                    reading
                        .take(offset, payload.data(), &mut self.unread)
                        .map_err(Failure::Lie)
                }
            }
            (
                Job::Read {
                    reading: Some(reading),
                    ..
                },
                BURST,
            ) if accepted => {
                if !reading.burst_packet(now, &self.timing, payload) {
                    return None;
                }
                self.seen(payload.seq);
                let taken = reading.take(payload.offset, payload.data(), &mut self.unread);
                taken.map_err(Failure::Lie)
            }
            (
                Job::Read {
                    reading: Some(reading),
                    ..
                },
                BURST,
            ) => {
                if !reading.is_burst_answer(payload.seq) {
                    return None;
                }
                self.seen(payload.seq);
                if error == FtpError::MAV_FTP_ERR_EOF {
                    reading.burst_at_end(payload);
                    Ok(())
                } else {
                    Err(refusal(O::MAV_FTP_OPCODE_BURSTREADFILE, error, errno))
                }
            }
            (Job::Write { writing, .. }, WRITE) if accepted => match writing.confirm(payload) {
                Ok(false) => return None,
                Ok(true) => {
                    let (bytes, of) = (writing.confirmed as u32, writing.content.len() as u32);
                    let written = Event::Written { bytes, of };
                    match self.events.back_mut() {
                        Some(last @ Event::Written { .. }) => *last = written,
                        _ => self.events.push_back(written),
                    }
                    Ok(())
                }
                Err(lie) => Err(lie.into()),
            },
            (Job::Write { writing, .. }, WRITE) => {
                if !writing.is_waiting_for(payload) {
                    return None;
                }
                // PX4 forgets the path of the open file 2 s after the last request, and takes it for protected then.
                let forgotten =
                    error == FtpError::MAV_FTP_ERR_FILEPROTECTED && writing.confirmed > 0;
                let error = if forgotten {
                    FtpError::MAV_FTP_ERR_INVALIDSESSION
                } else {
                    error
                };
                Err(refusal(O::MAV_FTP_OPCODE_WRITEFILE, error, errno))
            }
            // A keep-alive's.
            _ => return None,
        };
        // Only what is new counts: one that repeats itself for ever is as silent as one that sends nothing.
        if active.job.progress() > before {
            active.since = now;
        }
        match outcome {
            Ok(()) => None,
            Err(Failure::Refused {
                error: FtpError::MAV_FTP_ERR_INVALIDSESSION,
                ..
            }) => {
                active.lost_sessions += 1;
                if active.lost_sessions > MAX_LOST_SESSIONS {
                    return Some(Next::End(Err(Failure::Unstable(active.lost_sessions))));
                }
                // The vehicle has restarted, or another station has reset its sessions; one that PX4 merely took for
                // protected is still open, and ours.
                Some(Next::Ask(self.opening(&active.job)))
            }
            Err(failure) => Some(Next::End(Err(failure))),
        }
    }

    /// The session is closed, or as good as closed: what is left is the checksum.
    fn closed(&mut self, active: &Active) -> Next {
        let Phase::Asking(pending) = &active.phase else {
            return Next::Transfer;
        };
        // One that did not answer closes the session by itself after 10 s.
        self.left_open = pending.repeats > 0;
        let path = active.job.path().as_str().as_bytes();
        Next::Ask(
            self.request(Opcode::MAV_FTP_OPCODE_CALCFILECRC)
                .with_data(path),
        )
    }

    fn follow(&mut self, now: Duration, mut active: Active, next: Option<Next>) {
        match next {
            Some(Next::Ask(payload)) => self.ask(now, &mut active, payload),
            Some(Next::Transfer) => active.phase = Phase::Transferring,
            Some(Next::End(result)) => return self.end(active, result),
            None => {}
        }
        self.transfer(now, &mut active);
        self.active = Some(active);
    }

    /// Sends the pieces that are due, as far as there is room.
    fn transfer(&mut self, now: Duration, active: &mut Active) {
        while matches!(active.phase, Phase::Transferring) && self.out.len() < MAX_OUT {
            let (timing, rate, unread) = (self.timing, self.rate, self.unread.len());
            let (session, seq) = (active.session, &mut self.seq);
            let want = match &mut active.job {
                Job::Read {
                    reading: Some(reading),
                    ..
                } => reading.want(now, &timing, rate, unread, session, || advance(seq)),
                Job::Write { writing, .. } => writing.want(now, &timing, session, || advance(seq)),
                Job::Read { .. } | Job::List { .. } | Job::Once { .. } => return,
            };
            match want {
                Want::Send(payload) => {
                    active.asked_at = now;
                    self.out.push(payload.message(self.vehicle));
                }
                Want::Complete => {
                    let session = active.session;
                    let close = self.request(Opcode::MAV_FTP_OPCODE_TERMINATESESSION);
                    self.ask(now, active, Payload { session, ..close });
                }
                Want::Nothing => {
                    // A slow reader is no silence of the vehicle.
                    if unread > MAX_UNREAD / 2 {
                        active.since = now;
                    }
                    if now.saturating_sub(active.asked_at) >= self.timing.keep_alive {
                        active.asked_at = now;
                        let keep = self.request(Opcode::MAV_FTP_OPCODE_NONE);
                        self.out.push(keep.message(self.vehicle));
                    }
                    return;
                }
            }
        }
    }

    fn end(&mut self, active: Active, result: Result<Done, Failure>) {
        let open = self.left_open && result.is_err();
        if open {
            // Not waited for: the session is reset before the next file where this is lost.
            let close = self.request(Opcode::MAV_FTP_OPCODE_TERMINATESESSION);
            let session = active.session;
            self.out
                .push(Payload { session, ..close }.message(self.vehicle));
        }
        if matches!(self.events.back(), Some(Event::Written { .. })) {
            self.events.pop_back();
        }
        self.events.push_back(Event::Ended(result));
    }

    fn ask(&mut self, now: Duration, active: &mut Active, payload: Payload) {
        self.out.push(payload.message(self.vehicle));
        active.asked_at = now;
        active.phase = Phase::Asking(Pending::new(now, &self.timing, payload));
    }

    fn opening(&mut self, job: &Job) -> Payload {
        let request = self
            .request(job.opening())
            .with_data(job.path().as_str().as_bytes());
        let offset = match job {
            Job::List { at, .. } => *at,
            _ => 0,
        };
        Payload { offset, ..request }
    }

    fn request(&mut self, opcode: Opcode) -> Payload {
        Payload::request(self.number(), opcode)
    }

    fn number(&mut self) -> u16 {
        advance(&mut self.seq)
    }

    /// The vehicle has numbered a packet of a burst: requests continue after it.
    fn seen(&mut self, seq: u16) {
        if seq.wrapping_sub(self.seq) < 1 << 15 {
            self.seq = seq;
        }
    }

    fn under_way(&self, active: &Active) -> &'static str {
        match (&active.phase, &active.job) {
            (Phase::Asking(pending), _) => pending.payload.opcode().map_or("a request", name),
            (_, Job::Write { .. }) => "WriteFile",
            _ => "ReadFile",
        }
    }

    fn silence(&self, active: &Active) -> Duration {
        match self.under_way(active) {
            "CalcFileCRC32" => self.timing.checksum,
            // The session closes by itself: not worth the wait.
            "TerminateSession" => self.timing.answer * 4,
            _ => self.timing.silence,
        }
    }
}

/// The next number. PX4 does not recognise a repeat of 65535: its answer would be numbered 65536.
fn advance(seq: &mut u16) -> u16 {
    *seq = seq.wrapping_add(1);
    if *seq == u16::MAX {
        *seq = 0;
    }
    *seq
}

fn refusal(opcode: Opcode, error: FtpError, errno: Option<u8>) -> Failure {
    let request = name(opcode);
    Failure::Refused {
        request,
        error,
        errno,
    }
}

/// Requests on their way: a window of pieces, and one more.
const MAX_OUT: usize = 32;
/// Entries of one folder: far more than a card has logs.
const MAX_ENTRIES: usize = 10_000;
/// How often a session may end in one operation.
const MAX_LOST_SESSIONS: u8 = 8;
/// Numbers left out between two operations.
const BETWEEN_OPERATIONS: u16 = 512;
