//! A datagram of the DLI side: its sender, whether it is accepted, and whether it was answered before.
//!
//! Each reason for dropping a datagram has its own counter. Messages of a station beyond its rates (`limits`)
//! are dropped unread and unanswered: answers would be a flood too. If a listed station requests an answer to
//! a message that cannot be decoded or is not for a VSM, it is refused with the reason. Repeated, such messages are a finding,
//! whether an answer is requested or not.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use mapping::support::why_no_layout;
use mavlink_link::Now;
use mavlink_link::store::Disk;
use stanag_msgs::enums::{AckType, LoiBitmap};
use stanag_msgs::messages::{MessageAcknowledgement, SubsystemStatusAlert, UaStickCommand};
use stanag_msgs::table::{self, Direction};
use stanag_msgs::wrapper::{Frame, Header, WrapperError};
use stanag_msgs::{Id, MAX_DATAGRAM, Message, TimeStamp, ed25};

use super::guards::{DATAGRAM_OF_WEB, Opened, UNAUTHORISED_ADDRESS};
use super::reach::Arriving;
use super::{Bridge, PAUSED, destination_as_source};
use crate::config::Edition;
use crate::session::aircraft::Aircraft;
use crate::session::authority::rules::Silence;
use crate::session::authority::{self, Input};
use crate::session::context::{Continues, Origin};
use crate::session::dates::wall_ms;
use crate::session::duplicates::{Seen, Verdict, is_command, stamps_apart_ms};
use crate::session::editions::{DEMAND, MadeOf};
use crate::session::findings::dli::Fault;
use crate::session::limits::{COMMANDS, QUESTIONS};
use crate::session::log::LogLevel;
use crate::session::trace::DliTrace;

impl Bridge {
    /// Takes a datagram of the DLI side.
    pub fn handle_dli(&mut self, now: Now, from: SocketAddr, bytes: &[u8], disk: &mut dyn Disk) {
        self.note_time(now.mono);
        let before = self.records.trace.then(|| DliTrace::begin(&self.counters));
        let opened = self.open_guarded(now, from, bytes, disk);
        self.take_traced(now, from, (opened, bytes), before, disk);
    }

    /// Takes a message of a web client, like a datagram that its guard has sealed.
    pub(super) fn take_verified(
        &mut self,
        now: Now,
        from: SocketAddr,
        (bytes, index): (&[u8], usize),
        disk: &mut dyn Disk,
    ) {
        self.note_time(now.mono);
        let before = self.records.trace.then(|| DliTrace::begin(&self.counters));
        let opened = Opened::Verified(bytes, index);
        self.take_traced(now, from, (opened, bytes), before, disk);
    }

    fn take_traced(
        &mut self,
        now: Now,
        from: SocketAddr,
        (opened, bytes): (Opened<'_>, &[u8]),
        before: Option<DliTrace>,
        disk: &mut dyn Disk,
    ) {
        let bytes = match opened {
            Opened::Plain(inside) | Opened::Verified(inside, _) if ed25::is_ed25(inside) => {
                self.handled.guarded = opened.station();
                self.handle_ed25(now, from, inside, disk);
                inside
            }
            Opened::Plain(inside) | Opened::Verified(inside, _) => {
                self.handled.guarded = opened.station();
                self.handle_later(now, from, inside, disk);
                inside
            }
            Opened::Dropped => bytes,
        };
        self.handled.guarded = None;
        self.show_holders(now, disk);
        if let Some(before) = before {
            let source = self.setup.readings.frames(bytes).next_source();
            let readings = source.map_or(&self.setup.readings, |source| self.readings_of(source));
            let line = before.end(&self.counters, readings, from, bytes);
            let vsm = self.vsm;
            self.effects(now, disk).0.note(LogLevel::Debug, vsm, line);
        }
    }

    /// Takes a datagram of Edition 3 or 4.
    fn handle_later(&mut self, now: Now, from: SocketAddr, bytes: &[u8], disk: &mut dyn Disk) {
        let mut frames = self.setup.readings.frames(bytes);
        loop {
            // The definition of a checksum may be disputed: it is computed as each station does.
            if let Some(source) = frames.next_source() {
                self.readings_of(source).apply_to(&mut frames);
            }
            match frames.next() {
                Some(Ok(frame)) => self.handle_frame(now, from, &frame, disk),
                Some(Err(fault)) => {
                    self.counters.count(drop_name(&fault));
                    self.checks
                        .evidence
                        .note_broken(now.mono, from, bytes, &fault);
                }
                None => break,
            }
        }
    }

    fn handle_frame(&mut self, now: Now, from: SocketAddr, frame: &Frame<'_>, disk: &mut dyn Disk) {
        let mut frame = *frame;
        frame.header.destination = self.logical.meant_by(frame.header.destination);
        let frame = &frame;
        // Before the message is decoded: of a stranger's datagram only the wrapper is read.
        let edition = Edition::of_idd(frame.header.idd);
        let commands = is_command(frame.header.message_type);
        let Some(index) = self.accept(now.mono, from, &frame.header, edition, commands) else {
            return;
        };
        let station = &mut self.stations[index];
        if station.profile.is_unknown() {
            // The first challenge also uses the station's edition.
            station.profile.note(&frame.header);
        }
        self.handled.asker = Some(index);
        let arriving = Arriving {
            bytes: frame.bytes,
            ed25: false,
            acknowledges: frame.header.message_type == ACKNOWLEDGEMENT,
            answer: self.answer_in(frame),
        };
        if self.is_there(now, from, index, &arriving, disk) {
            self.stations[index].spoken = Some((false, now.mono));
            self.take_frame(now, index, frame, None, disk);
        }
        self.handled.asker = None;
    }

    /// The index of a frame's station, if the frame may be handled.
    pub(super) fn accept(
        &mut self,
        mono: Duration,
        from: SocketAddr,
        header: &Header,
        edition: Edition,
        commands: bool,
    ) -> Option<usize> {
        let rate = if commands { COMMANDS } else { QUESTIONS };
        let barred = match self.admit(from, header, edition) {
            Ok(index) if !self.paths.takes(mono, index, from, rate) => {
                self.counters.count("over the station's rate");
                return None;
            }
            Ok(index) if self.may_speak(mono, index, edition == Edition::Ed25) => {
                self.checks.evidence.note_good(header.source, from);
                return Some(index);
            }
            Ok(_) => Barred::ChangedEdition,
            Err(why) => why,
        };
        self.note_barred(mono, from, header, edition, &barred);
        None
    }

    /// A frame is dropped after its header was read.
    fn note_barred(
        &mut self,
        mono: Duration,
        from: SocketAddr,
        header: &Header,
        edition: Edition,
        why: &Barred,
    ) {
        self.counters.count(why.name());
        if let Some(fault) = why.fault(header, edition) {
            self.checks.evidence.note(mono, from, fault);
        }
    }

    /// Takes a message from its station's address; returns true if it is new and was dispatched. `made_of`: the message of
    /// Edition 2.5 that it was converted from.
    pub(super) fn take_frame(
        &mut self,
        now: Now,
        index: usize,
        frame: &Frame<'_>,
        made_of: Option<MadeOf>,
        disk: &mut dyn Disk,
    ) -> bool {
        // A delayed message, or one converted from another edition, keeps its original addressing.
        let mut frame = *frame;
        frame.header.destination = self.logical.meant_by(frame.header.destination);
        let frame = &frame;
        let header = frame.header;
        let mut origin = Origin {
            station: index,
            message_type: header.message_type,
            stamp: stamp_of(frame),
            // An acknowledgement is never acknowledged: two peers would answer each other without end.
            ack_requested: header.ack_requested && header.message_type != ACKNOWLEDGEMENT,
            held: None,
            continues: None,
        };
        let Some(message) = self.decode(now, &origin, frame, disk) else {
            return false;
        };
        origin.continues = made_of.and_then(|made| match made.number {
            DEMAND => Some(Continues::Demand(values_of(&message))),
            _ => made.takes_demand.then_some(Continues::ModeOfDemand),
        });
        let partial = table::is_partial(message.info(), frame.data);
        self.stations[index].profile.note_message(&message, partial);
        if table::message(header.message_type)
            .is_some_and(|info| info.direction == Direction::ToCucs)
        {
            self.counters.count("wrong direction");
            let why = "message is VSM to CUCS only".to_owned();
            self.refuse_undecodable(now, &origin, header.destination, why, disk);
            return false;
        }
        if made_of.is_none() {
            self.checks
                .evidence
                .note_decoded(header.source, header.message_type.into());
        }
        self.records.received.count(header.message_type.into());
        if let Message::MessageAcknowledgement(answer) = &message {
            // It shows only that the station's computer is present, which `reach` has noted, and not its operator, except
            // for the acknowledgement of an alert. Alerts do not request one, so no computer sends it automatically.
            self.acknowledge_alert(now, index, answer, disk);
            return false;
        }
        self.note_received(index, now.mono);
        // An order to erase this computer's keys is carried out by whoever receives it.
        if self.outbox.is_paused() && !matches!(message, Message::ZeroizeCommand(_)) {
            // Before it is judged: where this node continues, the repetition is new to it.
            self.counters.count(PAUSED);
            return false;
        }
        let commands = authority::commands(&message);
        let Some(stamp) = origin.stamp else {
            if commands {
                self.counters.count("no time stamp");
                let why = NO_STAMP.to_owned();
                self.refuse_command(now, &origin, header.destination, why, disk);
                return false;
            }
            self.dispatch(now, origin, header.destination, &message, disk);
            return true;
        };
        let ahead_ms = stamps_apart_ms(stamp, TimeStamp::from_unix_ms(wall_ms(now.wall)));
        self.stations[index].clock.note(now.mono, ahead_ms);
        let ack_requested = origin.ack_requested;
        let number = made_of.map(|made| made.number);
        let seen = Seen::new(frame, &message, number, stamp, ack_requested, now.mono);
        // A release needs no stamp. If it has one, a replay of a release from a time without rights is excluded.
        let releases = matches!(&message, Message::CucsAuthorisationRequest(request) if authority::releases(request));
        let verdict = self.remembered[index].judge(&seen, commands || releases, now.mono);
        self.stations[index].delay = self.remembered[index].delay(stamp, now.mono);
        match verdict {
            Verdict::New => {}
            Verdict::Again(answer) => {
                self.counters.count("duplicate");
                self.answer_again(now, &origin, frame, &message, answer, disk);
                return false;
            }
            Verdict::Refused(counter, why) => {
                self.counters.count(counter);
                self.refuse_command(now, &origin, header.destination, why, disk);
                return false;
            }
        }
        self.dispatch(now, origin, header.destination, &message, disk);
        self.forget_heartbeats(now.mono);
        true
    }

    /// The message of a frame, as its station writes it; one that is none is refused.
    fn decode(
        &mut self,
        now: Now,
        origin: &Origin,
        frame: &Frame<'_>,
        disk: &mut dyn Disk,
    ) -> Option<Message> {
        let header = &frame.header;
        let profile = &mut self.stations[origin.station].profile;
        profile.note(header);
        let fault = match profile.readings.decode(header.message_type, frame.data) {
            Ok(message) => return Some(message),
            Err(fault) => fault,
        };
        self.counters
            .count(match table::message(header.message_type) {
                Some(_) => "undecodable",
                None => "unknown message type",
            });
        let why = why_no_layout(header.message_type).unwrap_or_else(|| fault.to_string());
        self.refuse_undecodable(now, origin, header.destination, why, disk);
        None
    }

    fn refuse_undecodable(
        &mut self,
        now: Now,
        origin: &Origin,
        destination: Id,
        why: String,
        disk: &mut dyn Disk,
    ) {
        let message_type = origin.message_type.into();
        self.note_undecodable(now.mono, origin.station, message_type, &why);
        self.refuse(now, origin, destination, why, disk);
    }

    /// A message of a station is dropped for what it is, and not for what it commands.
    pub(super) fn note_undecodable(
        &mut self,
        mono: Duration,
        index: usize,
        message_type: u32,
        why: &str,
    ) {
        let station = &self.stations[index];
        if let Some(from) = station.peer {
            let fault = Fault::Undecodable(station.id(), message_type, why.to_owned());
            self.checks.evidence.note(mono, from, fault);
        }
    }

    /// A station acknowledges an alert, if that is active.
    fn acknowledge_alert(
        &mut self,
        now: Now,
        index: usize,
        answer: &MessageAcknowledgement,
        disk: &mut dyn Disk,
    ) {
        if answer.original_message_type != Some(SubsystemStatusAlert::ID) {
            return;
        }
        let cucs = self.stations[index].id();
        let (mut dli, aircraft) = self.effects(now, disk);
        let stamp = answer.original_message_time_stamp;
        let Some(id) = stamp.and_then(|stamp| dli.outbox.alert_of(stamp)) else {
            return dli.counters.count("acknowledges an unknown alert");
        };
        let text = |text: &str| format!("CUCS {cucs} has acknowledged the alert: {text}");
        for one in aircraft.iter_mut() {
            let (about, seen) = (one.id(), one.alerts.acknowledge(id, cucs, now.wall));
            if let Some(seen) = seen.map(text) {
                return dli.note(LogLevel::Info, about, seen);
            }
        }
        let seen = dli.alerts.acknowledge(id, cucs, now.wall).map(text);
        if let Some(seen) = seen {
            dli.note(LogLevel::Info, dli.vsm, seen);
        }
    }

    /// Something of this station was accepted: its silence is over.
    pub(super) fn note_received(&mut self, index: usize, now: Duration) {
        let station = &mut self.stations[index];
        // The effects of its silence end at once, not at the next stage.
        let was_silent = station.silence(now, &self.setup.settings.authority) != Silence::None;
        if station.received.replace(now).is_none() || was_silent {
            self.aircraft.ask_all();
        }
    }

    /// The index of a frame's station, if it is accepted and addressed to us.
    fn admit(&self, from: SocketAddr, header: &Header, edition: Edition) -> Result<usize, Barred> {
        let ours = |id| self.aircraft.has(id);
        let to_us =
            [self.vsm, Id::BROADCAST].contains(&header.destination) || ours(header.destination);
        if header.source == self.vsm || ours(header.source) || self.logical.has(header.source) {
            // What we sent to the group comes back to us.
            return Err(Barred::OurOwn);
        }
        let index = self.listed(header.source).ok_or(Barred::Source { to_us })?;
        let station = &self.stations[index];
        if station.config.guard.is_some() && self.handled.guarded.is_none() {
            return Err(match station.config.web {
                true => Barred::OfWeb,
                false => Barred::Unguarded,
            });
        }
        if self.handled.guarded.is_some_and(|guarded| guarded != index) {
            return Err(Barred::OtherSender);
        }
        // The port is not compared: a CUCS that returns on another port keeps its rights.
        if let Some(expected) = station.config.address.filter(|one| *one != from.ip()) {
            return Err(Barred::Address(expected));
        }
        if let Some(only) = station.config.edition.filter(|only| *only != edition) {
            return Err(Barred::Edition(only));
        }
        if to_us {
            Ok(index)
        } else {
            let known = station.received.is_some();
            Err(Barred::Misaddressed { known })
        }
    }

    /// A duplicate: the earlier answer is sent again. A query is answered with current data.
    fn answer_again(
        &mut self,
        now: Now,
        origin: &Origin,
        frame: &Frame<'_>,
        message: &Message,
        answer: Option<AckType>,
        disk: &mut dyn Disk,
    ) {
        let destination = frame.header.destination;
        let (mut dli, aircraft) = self.effects(now, disk);
        let to_all = destination == Id::BROADCAST || destination == dli.vsm;
        for one in aircraft.meant_mut(destination, to_all) {
            let station = origin.station;
            let input = match message {
                Message::CucsAuthorisationRequest(request) if to_all || one.id() == destination => {
                    Input::Again {
                        station,
                        request: Some(request),
                    }
                }
                Message::PositiveHandoverAuthorisationRequest(_) if one.id() == destination => {
                    Input::HandOverAgain { station }
                }
                _ => continue,
            };
            one.ask_authority(&mut dli, input);
        }
        if let Some(answer) = answer {
            let source = destination_as_source(destination, dli.vsm);
            dli.acknowledge_again(source, origin, answer);
        }
    }

    /// Refuses a command of a listed station with the reason, even if no 17000 was requested: its operator must know that
    /// the vehicle does not follow. For sticks, which are a stream, only if it was requested, or if the station flies by
    /// sticks and all of them are refused.
    pub(super) fn refuse_command(
        &mut self,
        now: Now,
        origin: &Origin,
        destination: Id,
        why: String,
        disk: &mut dyn Disk,
    ) {
        if origin.message_type == UaStickCommand::ID {
            let cucs = self.stations[origin.station].id();
            let flies = |one: &Aircraft| {
                let rights = one.authority.rights();
                one.id() == destination && rights.holds(cucs, LoiBitmap::LOI4)
            };
            let in_vain = origin.stamp.is_some()
                && self.remembered[origin.station].refuses_sticks(now.mono)
                && self.aircraft.iter().any(flies);
            if !in_vain {
                return self.refuse(now, origin, destination, why, disk);
            }
        }
        let (mut dli, aircraft) = self.effects(now, disk);
        match aircraft.find_mut(destination) {
            Some(one) => one.effects(&mut dli).refuse_unprivileged(origin, &why),
            None => dli.refuse(origin, &why),
        }
    }

    /// Refuses a message that cannot be decoded, or that a CUCS never sends. Without a requested answer nothing is sent.
    fn refuse(
        &mut self,
        now: Now,
        origin: &Origin,
        destination: Id,
        why: String,
        disk: &mut dyn Disk,
    ) {
        let (mut dli, aircraft) = self.effects(now, disk);
        if !origin.ack_requested {
            return dli.counters.count("refused");
        }
        match aircraft.find_mut(destination) {
            Some(one) => one.effects(&mut dli).refuse_unprivileged(origin, &why),
            None => dli.refuse(origin, &why),
        }
    }
}

/// Why a frame is dropped after its header was read.
enum Barred {
    /// What we sent to the group came back.
    OurOwn,
    /// Not a listed station.
    Source { to_us: bool },
    /// The station has a guard, but the datagram has no trailer.
    Unguarded,
    /// The station is a web client, but it arrived as a datagram.
    OfWeb,
    /// The datagram was sealed by another station's guard.
    OtherSender,
    /// The station is listed with another address, given here.
    Address(IpAddr),
    /// The station is listed with this edition, but it arrived in another.
    Edition(Edition),
    /// The station has recently used another edition.
    ChangedEdition,
    /// For no destination here; whether its station is known to send to us as well.
    Misaddressed { known: bool },
}

impl Barred {
    /// The counter.
    fn name(&self) -> &'static str {
        match self {
            Barred::OurOwn => "our own",
            Barred::Source { .. } => "unauthorised source",
            Barred::Unguarded => UNGUARDED,
            Barred::OfWeb => DATAGRAM_OF_WEB,
            Barred::OtherSender => "guard: the source is not the sender",
            Barred::Address(_) => UNAUTHORISED_ADDRESS,
            Barred::Edition(_) => "another edition than configured",
            Barred::ChangedEdition => "another edition",
            Barred::Misaddressed { .. } => "misaddressed",
        }
    }

    /// The finding, if any. A group is shared with other VSMs and their stations, whose messages are no fault.
    fn fault(&self, header: &Header, edition: Edition) -> Option<Fault> {
        match *self {
            Barred::Source { to_us: true } => {
                Some(Fault::NotListed(header.source, edition, header.checksum))
            }
            Barred::Unguarded => Some(Fault::Guard(header.source, UNGUARDED)),
            Barred::OfWeb => Some(Fault::WebDatagram(header.source, DATAGRAM_OF_WEB)),
            Barred::Address(expected) => Some(Fault::Address(header.source, expected)),
            Barred::Edition(only) => Some(Fault::OtherEdition(header.source, edition, only)),
            Barred::ChangedEdition => Some(Fault::ChangedEdition(header.source, edition)),
            Barred::Misaddressed { known: false } => {
                Some(Fault::Misaddressed(header.source, header.destination))
            }
            _ => None,
        }
    }
}

/// The Time Stamp of a message, also of one that cannot be decoded: field 1 of every message.
fn stamp_of(frame: &Frame<'_>) -> Option<TimeStamp> {
    let info = table::message(frame.header.message_type)?;
    let (presence, rest) = frame
        .data
        .split_at_checked(usize::from(info.presence_bytes))?;
    if presence.last()? & 1 == 0 {
        return None;
    }
    let first = info.fields.first()?;
    if first.wire == table::Wire::F64 {
        // 50001 carries milliseconds as a float: 17000 names them as it names all others.
        let ms = f64::from_be_bytes(rest.first_chunk().copied()?);
        let fits = (0.0..TimeStamp::PERIOD_MS as f64).contains(&ms.round());
        return fits.then(|| TimeStamp(ms.round() as u64));
    }
    if first.wire.bytes()? != 5 {
        return None;
    }
    let stamp = rest
        .get(..5)?
        .iter()
        .fold(0, |stamp, byte| stamp << 8 | u64::from(*byte));
    Some(TimeStamp(stamp))
}

/// A hash of a demand's values, without its stamp. Valid within one process only.
fn values_of(message: &Message) -> u64 {
    let mut message = message.clone();
    if let Message::VehicleOperatingModeCommand(command) = &mut message {
        command.time_stamp = None;
    }
    let mut data = [0; MAX_DATAGRAM];
    let length = message.encode_data(&mut data).unwrap_or_default();
    let mut hash = DefaultHasher::new();
    data[..length].hash(&mut hash);
    hash.finish()
}

pub(super) fn drop_name(fault: &WrapperError) -> &'static str {
    match fault {
        WrapperError::Oversized { .. } => "oversized",
        WrapperError::NoHeader { .. } | WrapperError::Truncated { .. } => "truncated",
        WrapperError::Length { .. } => "bad length",
        WrapperError::Idd { .. } | WrapperError::Version { .. } => "unknown IDD version",
        WrapperError::ChecksumStyle { .. } => "unknown checksum style",
        WrapperError::Checksum { .. } => "wrong checksum",
    }
}

const NO_STAMP: &str = "a command needs its Time Stamp (field 1): without one a recording of it could not be distinguished from it";
const UNGUARDED: &str = "guard: no trailer";
const ACKNOWLEDGEMENT: u16 = 17000;
