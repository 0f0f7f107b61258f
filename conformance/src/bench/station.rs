//! A CUCS of the suite: one id on one socket, and what an operator would do with it.
//!
//! Requests are repeated, the same bytes, up to three times, because UDP may lose them; a rule about a single datagram
//! uses [`Station::send`]. A method that returns [`Judged`] fails in the sense of a rule whose point it is; where it is
//! only a precondition, the scene says so with `precondition`.

use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::Id;

use super::context::Bench;
use super::net::{Datagram, Socket};

use crate::verdict::{Judged, Stop};
use crate::wire::{Direction, Draft, Seen};

/// LOI bits of messages 1 and 2 in the suite's own reading.
pub mod loi {
    /// Monitoring.
    pub const LOI2: i64 = 1;
    /// Payload control.
    pub const LOI3: i64 = 2;
    /// Flight control.
    pub const LOI4: i64 = 4;
    /// Launch and recovery.
    pub const LOI5: i64 = 8;
}

/// Requested access of message 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Give up.
    Release = 0,
    /// Request.
    Request = 1,
    /// Take from another.
    Override = 2,
}

/// A CUCS of the suite.
#[derive(Debug)]
pub struct Station {
    bench: Arc<Bench>,
    /// Its id.
    pub id: Id,
    /// The vehicle that it addresses.
    pub vehicle: Id,
    socket: Socket,
}

/// What was sent, to find what came after it.
#[derive(Clone, Debug)]
pub struct Sent {
    /// Number of datagrams before it.
    pub mark: usize,
    /// Time of the run.
    pub at: Duration,
    /// Its time stamp.
    pub stamp: i64,
    /// Its bytes.
    pub bytes: Vec<u8>,
    /// Its type.
    pub kind: u16,
}

impl Station {
    /// A station with this id on a fresh port.
    ///
    /// # Errors
    /// The system has no socket for it.
    pub fn new(bench: &Arc<Bench>, id: Id, vehicle: Id) -> Judged<Self> {
        let (net, idd, style) = (
            bench.net.clone(),
            bench.profile.idd(),
            bench.profile.subject.checksum,
        );
        let acknowledge = move |seen: &Seen| {
            let asked = seen.piece.ack() && seen.piece.destination == id && seen.kind() != 17000;
            asked.then(|| {
                let draft = Draft::new(17000)
                    .raw("Time Stamp", net.stamp())
                    .raw(
                        "Original Message Time Stamp",
                        seen.stamp().unwrap_or_default(),
                    )
                    .raw("Original Message Type", seen.kind().into())
                    .raw("Acknowledgement Type", 1);
                draft.encode(id, seen.piece.source, idd, style)
            })
        };
        let socket = Socket::open(&bench.net, bench.address, acknowledge).map_err(|error| {
            Stop::inconclusive(format!("no socket to {}: {error}", bench.address))
        })?;
        Ok(Self {
            bench: bench.clone(),
            id,
            vehicle,
            socket,
        })
    }

    /// Its socket's number in the recording.
    #[must_use]
    pub fn socket(&self) -> usize {
        self.socket.number
    }

    /// The bench that it stands on.
    #[must_use]
    pub fn bench(&self) -> &Arc<Bench> {
        &self.bench
    }

    /// Bytes of a message of this station to its vehicle.
    #[must_use]
    pub fn encode(&self, draft: &Draft) -> Vec<u8> {
        let profile = &self.bench.profile;
        draft.encode(
            self.id,
            self.vehicle,
            profile.idd(),
            profile.subject.checksum,
        )
    }

    /// Sends bytes as they are.
    pub fn send_bytes(&self, bytes: &[u8]) -> usize {
        let mark = self.bench.net.mark();
        self.socket.send(bytes);
        mark
    }

    /// Sends bytes without recording them: floods.
    pub fn flood(&self, bytes: &[u8]) {
        self.socket.send_unrecorded(bytes);
    }

    /// Sends a message once, with a fresh time stamp unless it has one.
    pub fn send(&self, draft: Draft) -> Sent {
        let draft = self.stamped(draft);
        let bytes = self.encode(&draft);
        self.send_as(&draft, bytes)
    }

    /// Sends several messages in one datagram; returns the mark before it.
    pub fn send_together(&self, drafts: Vec<Draft>) -> usize {
        let bytes: Vec<u8> = drafts
            .into_iter()
            .flat_map(|draft| self.encode(&self.stamped(draft)))
            .collect();
        self.send_bytes(&bytes)
    }

    /// The draft with a time stamp.
    #[must_use]
    pub fn stamped(&self, draft: Draft) -> Draft {
        let known = stanag_msgs::table::message(draft.message_type)
            .is_some_and(|info| info.field("Time Stamp").is_some());
        if !known || draft.data.is_some() || draft.has("Time Stamp") || draft.message_type == 50001
        {
            return draft;
        }
        let stamp = self.bench.net.stamp();
        draft.raw("Time Stamp", stamp)
    }

    fn send_as(&self, draft: &Draft, bytes: Vec<u8>) -> Sent {
        let stamp = match &draft.data {
            None => Seen::new(
                Duration::ZERO,
                0,
                Direction::Sent,
                0,
                crate::wire::split(&bytes)
                    .0
                    .into_iter()
                    .next()
                    .unwrap_or_else(|| empty_piece(draft)),
            )
            .stamp()
            .unwrap_or_default(),
            Some(_) => 0,
        };
        let at = self.bench.net.now();
        let mark = self.send_bytes(&bytes);
        Sent {
            mark,
            at,
            stamp,
            bytes,
            kind: draft.message_type,
        }
    }

    /// Whether a message came to this station: to its socket, for its id or for everybody.
    fn mine(&self, datagram: &Datagram, seen: &Seen) -> bool {
        datagram.direction == Direction::Received
            && seen.socket == self.socket.number
            && (seen.piece.destination == self.id || seen.piece.destination == Id::BROADCAST)
    }

    /// The first message to this station after `mark` that `wanted` accepts, within `time`.
    pub fn wait(
        &self,
        mark: usize,
        time: Duration,
        mut wanted: impl FnMut(&Seen) -> bool,
    ) -> Option<Arc<Seen>> {
        let deadline = self.bench.net.now() + time;
        self.bench.net.wait(mark, deadline, |datagram, seen| {
            self.mine(datagram, seen) && wanted(seen)
        })
    }

    /// All messages to this station since `mark` that `wanted` accepts.
    pub fn received(&self, mark: usize, mut wanted: impl FnMut(&Seen) -> bool) -> Vec<Arc<Seen>> {
        let recording = self.bench.net.recording();
        recording.datagrams[mark.min(recording.datagrams.len())..]
            .iter()
            .flat_map(|datagram| datagram.messages.iter().map(move |seen| (datagram, seen)))
            .filter(|(datagram, seen)| self.mine(datagram, seen) && wanted(seen))
            .map(|(_, seen)| seen.clone())
            .collect()
    }

    /// All that comes within `time` from now that `wanted` accepts.
    ///
    /// # Errors
    /// The operator stopped the run.
    pub fn collect(
        &self,
        time: Duration,
        wanted: impl FnMut(&Seen) -> bool,
    ) -> Judged<Vec<Arc<Seen>>> {
        let mark = self.bench.net.mark();
        self.pause(time)?;
        Ok(self.received(mark, wanted))
    }

    /// Waits.
    ///
    /// # Errors
    /// The operator stopped the run.
    pub fn pause(&self, time: Duration) -> Judged {
        self.bench.net.pause(time);
        if self.bench.net.interrupted() {
            Err(Stop::Interrupted)
        } else {
            Ok(())
        }
    }

    /// Sends a message up to three times, the same bytes, until an answer comes.
    ///
    /// # Errors
    /// A fail where none comes: `expected` names the answer.
    pub fn ask(
        &self,
        draft: Draft,
        time: Duration,
        expected: &str,
        mut wanted: impl FnMut(&Seen) -> bool,
    ) -> Judged<Arc<Seen>> {
        let sent = self.send(draft);
        for attempt in 0..3 {
            if attempt > 0 {
                self.send_bytes(&sent.bytes);
            }
            if let Some(seen) = self.wait(sent.mark, time, &mut wanted) {
                return Ok(seen);
            }
            if self.bench.net.interrupted() {
                return Err(Stop::Interrupted);
            }
        }
        Err(Stop::fail(format!(
            "expected {expected} within {:.1} s of message {} by {}; nothing came, also not to two repetitions",
            time.as_secs_f64(),
            sent.kind,
            self.id
        )))
    }

    /// A discovery: every answer within the answer time.
    ///
    /// # Errors
    /// The operator stopped the run.
    pub fn discover(&self) -> Judged<Vec<Arc<Seen>>> {
        let answer = self.bench.timers.answer;
        let sent = self.send(discovery());
        for attempt in 0..3 {
            if attempt > 0 {
                self.send_bytes(&sent.bytes);
            }
            if self
                .wait(sent.mark, answer, |seen| seen.kind() == 2)
                .is_some()
            {
                // Other vehicles answer at about the same time.
                self.pause(Duration::from_millis(300).min(answer))?;
                return Ok(self.received(sent.mark, |seen| seen.kind() == 2));
            }
            if self.bench.net.interrupted() {
                return Err(Stop::Interrupted);
            }
        }
        Ok(Vec::new())
    }

    /// Message 1 to the vehicle; the answer to it.
    ///
    /// # Errors
    /// A fail where no message 2 comes.
    pub fn request(&self, levels: i64, access: Access) -> Judged<Arc<Seen>> {
        self.request_station(levels, access, 0)
    }

    /// Message 1 for a payload station; the answer to it.
    ///
    /// # Errors
    /// A fail where no message 2 comes.
    pub fn request_station(&self, levels: i64, access: Access, station: i64) -> Judged<Arc<Seen>> {
        let mark = self.bench.net.mark();
        let mine = |seen: &Seen| {
            seen.kind() == 2
                && seen.piece.source == self.vehicle
                && seen.piece.destination == self.id
        };
        let first = self.ask(
            authorisation(levels, access).raw("Controlled Station 1-16", station),
            self.bench.timers.answer,
            "an authorisation response (2)",
            mine,
        )?;
        let settle = self
            .bench
            .settle_ms
            .load(std::sync::atomic::Ordering::SeqCst);
        if settle == 0 {
            return Ok(first);
        }
        self.pause(Duration::from_millis(settle.into()))?;
        Ok(self.received(mark, mine).pop().unwrap_or(first))
    }

    /// Requests levels and expects that they are granted.
    ///
    /// # Errors
    /// A fail where they are not granted.
    pub fn take(&self, levels: i64) -> Judged<Arc<Seen>> {
        let answer = self.request(levels, Access::Request)?;
        let granted = answer.raw("LOI Granted").unwrap_or_default();
        if granted & levels == levels {
            return Ok(answer);
        }
        // A release that is being carried out, or a busy disk, may be answered by the state before.
        let late = self.wait(
            self.bench.net.mark(),
            self.bench.timers.answer / 2,
            |seen| {
                seen.kind() == 2 && seen.raw("LOI Granted").unwrap_or_default() & levels == levels
            },
        );
        late.ok_or_else(|| {
            Stop::fail(format!(
                "expected message 2 with LOI Granted 0x{levels:02x} for {}; got 0x{granted:02x} (authorised 0x{:02x})",
                self.id,
                answer.raw("LOI Authorized").unwrap_or_default()
            ))
        })
    }

    /// Releases everything.
    ///
    /// # Errors
    /// A fail where no message 2 comes.
    pub fn release(&self) -> Judged<Arc<Seen>> {
        self.request(0x0F, Access::Release)
    }

    /// A message requested once by 17002.
    ///
    /// # Errors
    /// A fail where it does not come.
    pub fn query(&self, kind: u16) -> Judged<Arc<Seen>> {
        let time = if kind == 3000 {
            self.bench.timers.config.min(5 * self.bench.timers.answer)
        } else {
            self.bench.timers.answer
        };
        self.ask(
            information_request(kind),
            time,
            &format!("message {kind}"),
            |seen| seen.kind() == kind && seen.piece.source == self.vehicle,
        )
    }

    /// Sets the loiter radius: a setting without effect on a vehicle that does not loiter, by which the suite sees whose
    /// commands are obeyed.
    pub fn set_radius(&self, radius_m: f64) -> Sent {
        self.send(Draft::new(2017).set("Loiter Radius", radius_m))
    }

    /// The loiter radius that the subject reports.
    ///
    /// # Errors
    /// A fail where 3004 does not come.
    pub fn radius(&self) -> Judged<Option<f64>> {
        Ok(self.query(3004)?.value("Loiter Radius"))
    }

    /// Whether the subject reports this radius within the answer time.
    ///
    /// # Errors
    /// A fail where 3004 does not come.
    pub fn radius_becomes(&self, radius_m: f64) -> Judged<bool> {
        let deadline = self.bench.net.now() + self.bench.timers.answer;
        loop {
            if self
                .radius()?
                .is_some_and(|found| (found - radius_m).abs() < 0.8)
            {
                return Ok(true);
            }
            if self.bench.net.now() >= deadline {
                return Ok(false);
            }
            self.pause(Duration::from_millis(50))?;
        }
    }

    /// Whether this station's 2017 changes the radius.
    ///
    /// # Errors
    /// A fail where 3004 does not come.
    pub fn commands_work(&self) -> Judged<bool> {
        let radius = self.bench.fresh_radius();
        for _ in 0..2 {
            self.set_radius(radius);
            if self.radius_becomes(radius)? {
                return Ok(true);
            }
        }
        Ok(false)
    }
}

fn empty_piece(draft: &Draft) -> crate::wire::Piece {
    crate::wire::Piece {
        reserved: 0,
        length: 0,
        source: Id::NULL,
        destination: Id::NULL,
        message_type: draft.message_type,
        properties: 0,
        data: Vec::new(),
        bytes: Vec::new(),
        wrapped: None,
    }
}

/// A discovery: message 1 to everybody, without a level, with access 0.
#[must_use]
pub fn discovery() -> Draft {
    Draft::new(1)
        .to(Id::BROADCAST)
        .id("VSM ID", Id::BROADCAST)
        .raw("Requested/Handover LOI", 0)
        .raw("Requested/Handover Access", 0)
        .raw("Controlled Station 1-16", 0)
}

/// Message 1 for these levels.
#[must_use]
pub fn authorisation(levels: i64, access: Access) -> Draft {
    Draft::new(1)
        .id("VSM ID", Id::BROADCAST)
        .raw("Requested/Handover LOI", levels)
        .raw("Requested/Handover Access", access as i64)
        .raw("Controlled Station 1-16", 0)
}

/// 17002 for this message.
#[must_use]
pub fn information_request(kind: u16) -> Draft {
    Draft::new(17002).raw("Message Type", kind.into())
}

/// 17001 for this message; frequency 0 cancels.
#[must_use]
pub fn schedule(kind: u16, hertz: u16) -> Draft {
    Draft::new(17001)
        .raw("Requested Message Type", kind.into())
        .raw("Frequency", hertz.into())
}
