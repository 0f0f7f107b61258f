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

use super::failure::{Failure, Lie, name};
use super::operation::{Active, Done, Event, Job, Next, Operation, Phase, StartError};
use super::payload::{Opcode, Payload, PayloadError};
use super::pending::{Pending, Timing};
use super::read::{MAX_UNREAD, Want};
use super::write::{MAX_WRITE, Writing};
use crate::frame::Node;
use crate::service::bounded::Bounded;

/// The files of one node.
#[derive(Debug)]
pub struct Client {
    us: Node,
    vehicle: Node,
    pub(super) timing: Timing,
    /// Bytes a second that are requested at most; `None`: bursts.
    rate: Option<u32>,
    seq: u16,
    /// PX4's stored last reply answers a request of this client.
    pub(super) synchronised: bool,
    /// A session of ours may be open still.
    pub(super) left_open: bool,
    active: Option<Active>,
    out: Bounded<MavMessage>,
    pub(super) events: VecDeque<Event>,
    pub(super) unread: Vec<u8>,
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

    /// Limits the bytes requested per second, or lifts the limit; applies from the next request.
    pub const fn limit(&mut self, bytes_per_s: Option<u32>) {
        self.rate = bytes_per_s;
    }

    /// Begins an operation.
    ///
    /// # Errors
    /// One is under way or its end is unread, or a file is too large to be written.
    pub fn start(&mut self, now: Duration, operation: Operation) -> Result<(), StartError> {
        // Unread data of the last operation would be taken for that of the next.
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
        // Beyond the numbers that a late burst of an earlier file may carry.
        self.seq = self.seq.wrapping_add(BETWEEN_OPERATIONS);
        // The vehicle may still hold a reply to an earlier client of our address: it would answer our first request with
        // that.
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
        // The target fields are compared exactly: PX4 answers the station that asked, so a broadcast is no answer.
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
                // The session closes by itself after 10 s, so its silence does not fail the operation.
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
                    // A slow reader is not silence of the vehicle: nothing is requested while it is behind.
                    if unread > MAX_UNREAD / 2 {
                        active.since = now;
                    }
                    // PX4 closes a session 10 s after the last request, and a burst or a slow reader sends none.
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
            // Not awaited: where this is lost, the session is reset before the next file.
            let close = self.request(Opcode::MAV_FTP_OPCODE_TERMINATESESSION);
            let session = active.session;
            self.out
                .push(Payload { session, ..close }.message(self.vehicle));
        }
        // The end supersedes unread progress.
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

    pub(super) fn opening(&mut self, job: &Job) -> Payload {
        let request = self
            .request(job.opening())
            .with_data(job.path().as_str().as_bytes());
        let offset = match job {
            Job::List { at, .. } => *at,
            _ => 0,
        };
        Payload { offset, ..request }
    }

    pub(super) fn request(&mut self, opcode: Opcode) -> Payload {
        Payload::request(self.number(), opcode)
    }

    pub(super) fn number(&mut self) -> u16 {
        advance(&mut self.seq)
    }

    /// The vehicle has numbered a packet of a burst: requests continue after it.
    pub(super) fn seen(&mut self, seq: u16) {
        // Only forward, in the arithmetic of a wrapping counter: a late packet has a lower number.
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
            // The session closes by itself: a long wait gains nothing.
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

/// Requests on their way: a window of pieces, and one more.
const MAX_OUT: usize = 32;
/// Numbers left out between two operations.
const BETWEEN_OPERATIONS: u16 = 512;
