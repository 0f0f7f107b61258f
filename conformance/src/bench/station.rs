//! A CUCS of the suite: one id on one socket, and what an operator would do with it.
//!
//! Requests are repeated, the same bytes, up to three times, because UDP may lose them; a rule about a single
//! datagram uses [`Station::send`]. A method that returns [`Judged`] fails as the rule that is about it would; where
//! it is only a precondition, the scene calls `precondition` on the result.

use std::collections::BTreeSet;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use stanag_msgs::Id;

use super::context::Bench;
use super::net::{Datagram, Net, Socket};

use crate::verdict::{Judged, Stop};
use crate::wire::dialect::writing::{self, Writer};
use crate::wire::dialect::{self, Role};
use crate::wire::{Direction, Draft, HEADER, Seen, WRAPPER_25};

/// LOI bits of messages 1 and 2, as the suite reads them.
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

/// Altitude that #41 commands for a loiter, in metres above the place where the vehicle was first seen: where the
/// suite flies.
const LOITER_UP_M: f64 = 50.0;

/// A CUCS of the suite.
#[derive(Debug)]
pub struct Station {
    bench: Arc<Bench>,
    /// Its id.
    pub id: Id,
    /// The vehicle that it addresses.
    pub vehicle: Id,
    socket: Socket,
    /// In Edition 2.5: the message types for which it has requested acknowledgements (#1401).
    acknowledged: Mutex<BTreeSet<u16>>,
    /// In Edition 2.5: whether a mode preference set by it may still override what it commands next.
    preferred: AtomicBool,
}

/// What was sent, so that what came after it can be found.
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
        let configured: Mutex<BTreeSet<i64>> = Mutex::default();
        let vsm = bench.vsm.get().copied();
        let acknowledge = move |seen: &Seen| {
            if net.dialect().is_some() {
                let mut types = configured.lock().unwrap_or_else(PoisonError::into_inner);
                return answer_25(&net, id, vsm, seen, &mut types);
            }
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
            acknowledged: Mutex::default(),
            preferred: AtomicBool::new(false),
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
        if self.bench.net.dialect().is_some() {
            let made = writing::encode(draft, &self.writer(), || self.bench.net.instance());
            let bytes = made.bytes();
            self.bench.net.note_missing(made.missing);
            return bytes;
        }
        draft.encode(
            self.id,
            self.vehicle,
            profile.idd(),
            profile.subject.checksum,
        )
    }

    fn writer(&self) -> Writer {
        Writer {
            role: Role::Cucs,
            source: self.id,
            destination: self.vehicle,
            vsm: self.bench.vsm.get().copied().unwrap_or(Id::BROADCAST),
            loiter: self
                .bench
                .home
                .get()
                .map(|home| (home.altitude + LOITER_UP_M, home.altitude_type)),
        }
    }

    /// The whole message around these data, in the judged edition.
    #[must_use]
    pub fn wrapper_bytes(&self) -> usize {
        match self.bench.net.dialect() {
            Some(_) => WRAPPER_25,
            None => HEADER,
        }
    }

    /// The data of a message, in the judged edition.
    #[must_use]
    pub fn data_length(&self, draft: &Draft) -> u16 {
        match self.bench.net.dialect() {
            Some(_) => self.encode(draft).len().saturating_sub(WRAPPER_25) as u16,
            None => draft.data().len() as u16,
        }
    }

    /// Sends what Edition 2.5 needs before a message: #1401 for its type, and #48 without a preference before a mode.
    fn prepare(&self, draft: &Draft) {
        let net = &self.bench.net;
        let elsewhere = draft.source.or(draft.destination).is_some();
        if net.dialect().is_none() || draft.data.is_some() || elsewhere {
            return;
        }
        let writer = self.writer();
        let types = writing::types_of(draft, Role::Cucs);
        if draft.ack {
            let mut known = self
                .acknowledged
                .lock()
                .unwrap_or_else(PoisonError::into_inner);
            let new: Vec<u16> = types
                .iter()
                .copied()
                .filter(|kind| known.insert(*kind))
                .collect();
            if !new.is_empty() {
                let bytes = writing::acknowledge(&new, &writer, || net.stamp(), || net.instance());
                self.send_bytes(&bytes);
            }
        }
        let prefers = types.contains(&dialect::PREFERENCE);
        if draft.message_type == 2016 && !prefers && self.preferred.swap(false, Ordering::SeqCst) {
            self.prefer([0; 3]);
        }
        if prefers {
            self.preferred.store(true, Ordering::SeqCst);
        }
    }

    /// Edition 2.5: sends #48, which sets what overrides altitude, speed, and course and heading.
    pub fn prefer(&self, parts: [i64; 3]) -> usize {
        let net = &self.bench.net;
        self.preferred.store(parts != [0; 3], Ordering::SeqCst);
        self.send_bytes(&writing::preference(
            parts,
            &self.writer(),
            net.stamp(),
            net.instance(),
        ))
    }

    /// Edition 2.5: sends #1202.
    pub fn send_resources(&self) -> usize {
        let net = &self.bench.net;
        self.send_bytes(&writing::resources(
            &self.writer(),
            net.stamp(),
            net.instance(),
        ))
    }

    /// Edition 2.5: of the messages that a draft becomes, sends only the one of this type.
    pub fn send_only(&self, draft: Draft, number: u16) -> usize {
        let draft = self.stamped(draft);
        let made = writing::encode(&draft, &self.writer(), || self.bench.net.instance());
        let types = writing::types_of(&draft, Role::Cucs);
        let all = types.iter().zip(&made.messages);
        let chosen: Vec<u8> = all
            .filter(|(kind, _)| **kind == number)
            .flat_map(|(_, bytes)| bytes.clone())
            .collect();
        self.send_bytes(&chosen)
    }

    /// Whether this message of Edition 2.5 itself arrives at this station after `mark` within `time`.
    pub fn wait_original(
        &self,
        mark: usize,
        time: Duration,
        mut wanted: impl FnMut(&Seen) -> bool,
    ) -> bool {
        let deadline = self.bench.net.now() + time;
        self.bench.net.wait_datagram(mark, deadline, |datagram| {
            let mut originals = datagram.originals.iter();
            originals.any(|seen| {
                seen.direction == Direction::Received
                    && seen.socket == self.socket.number
                    && seen.piece.destination == self.id
                    && wanted(seen)
            })
        })
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
        self.prepare(&draft);
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
        if self.bench.net.dialect().is_some() && draft.message_type == 2016 {
            // It becomes up to three messages, each with its own stamp, so three stamps are taken.
            self.bench.net.stamp();
            self.bench.net.stamp();
        }
        let stamp = self.bench.net.stamp();
        draft.raw("Time Stamp", stamp)
    }

    fn send_as(&self, draft: &Draft, bytes: Vec<u8>) -> Sent {
        let stamp = draft.stamp().unwrap_or_default();
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

    /// Whether a message came to this station: to its socket, for its id or the broadcast id.
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
        // While a release is carried out, or the disk is busy, the first answer may show the state before it.
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

    /// Sets the loiter radius. A vehicle that does not loiter is not moved by it, so the suite uses it to see whose
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

/// Whether a 17000 is about this message.
#[must_use]
pub fn about(seen: &Seen, kind: u16, stamp: i64) -> bool {
    seen.kind() == 17000
        && seen.raw("Original Message Type") == Some(kind.into())
        && seen.raw("Original Message Time Stamp") == Some(stamp)
}

/// What a CUCS of Edition 2.5 answers by itself: #1400 to what the VSM wants acknowledged, and #1202 when it is
/// requested.
fn answer_25(
    net: &Net,
    id: Id,
    vsm: Option<Id>,
    seen: &Seen,
    types: &mut BTreeSet<i64>,
) -> Option<Vec<u8>> {
    if seen.piece.destination != id || seen.kind() == dialect::ACKNOWLEDGEMENT {
        return None;
    }
    let named = |field: &str| seen.raw(field).unwrap_or_default();
    let writer = Writer {
        role: Role::Cucs,
        source: id,
        destination: seen.piece.source,
        vsm: vsm.unwrap_or(Id::BROADCAST),
        loiter: None,
    };
    let mut answer = Vec::new();
    if seen.kind() == dialect::ACKNOWLEDGE {
        types.insert(named("Message Type"));
    } else if types.contains(&seen.kind().into()) {
        answer = writing::acknowledgement(seen, &writer, net.stamp(), net.instance());
    }
    if seen.kind() == dialect::REQUEST && named("Message Type") == i64::from(dialect::RESOURCES) {
        answer.extend(writing::resources(&writer, net.stamp(), net.instance()));
    }
    (!answer.is_empty()).then_some(answer)
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
