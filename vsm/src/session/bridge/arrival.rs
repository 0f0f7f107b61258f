//! A datagram of the DLI side: who it is from, whether it may speak, and whether it has been answered before.
//!
//! What is dropped is counted under a name of its own. What a listed station asks an answer for is refused with the
//! reason where it cannot be read, or is not for a VSM.

use std::net::SocketAddr;

use mavlink_link::Now;
use stanag_msgs::enums::AckType;
use stanag_msgs::table::{self, Direction};
use stanag_msgs::wrapper::{Frame, Header, WrapperError};
use stanag_msgs::{Id, Message, TimeStamp};

use super::{Bridge, destination_as_source};
use crate::session::desk::Origin;
use crate::session::duplicate::Seen;
use mavlink_link::store::Disk;

impl Bridge {
    /// Takes a datagram of the DLI side.
    pub fn handle_dli(&mut self, now: Now, from: SocketAddr, bytes: &[u8], store: &mut dyn Disk) {
        for frame in self.profile.frames(bytes) {
            match frame {
                Ok(frame) => self.handle_frame(now, from, &frame, store),
                Err(fault) => self.counters.count(drop_name(&fault)),
            }
        }
    }

    fn handle_frame(
        &mut self,
        now: Now,
        from: SocketAddr,
        frame: &Frame<'_>,
        store: &mut dyn Disk,
    ) {
        let header = frame.header;
        let index = match self.admit(from, &header) {
            Ok(index) => index,
            Err(why) => return self.counters.count(why),
        };
        let origin = Origin {
            station: index,
            message_type: header.message_type,
            stamp: stamp_of(frame),
            ack_requested: header.ack_requested && header.message_type != ACKNOWLEDGEMENT,
        };
        let message = match self.profile.decode(header.message_type, frame.data) {
            Ok(message) => message,
            Err(fault) => {
                let known = table::message(header.message_type).is_some();
                self.counters.count(if known {
                    "undecodable"
                } else {
                    "unknown message type"
                });
                let why = fault.to_string();
                return self.refuse(now, &origin, header.destination, why, store);
            }
        };
        if table::message(header.message_type)
            .is_some_and(|info| info.direction == Direction::ToCucs)
        {
            self.counters.count("wrong direction");
            let why = "a VSM sends it, and takes none".to_owned();
            return self.refuse(now, &origin, header.destination, why, store);
        }
        self.received.count(header.message_type.into());
        // From here it is a message of a station that may speak: answers go to where it sends from.
        let station = &mut self.stations[index];
        station.peer = Some(from);
        station.heard = Some(now.mono);
        if let Some(stamp) = origin.stamp {
            let seen = Seen::new(frame, &message, stamp, origin.ack_requested, now.mono);
            if let Some(answer) = self.stations[index].recent.find(&seen) {
                self.counters.count("duplicate");
                return self.answer_again(now, &origin, frame, &message, answer, store);
            }
            let overtaken = self.stations[index].recent.is_overtaken(&seen);
            self.stations[index].recent.remember(seen);
            let (mut desk, aircraft) = self.desk(now, store);
            let noted = desk.note_command(index, &seen);
            if let Some(aircraft) = aircraft
                .iter_mut()
                .find(|aircraft| aircraft.id() == header.destination)
            {
                aircraft.say_not_noted(&mut desk, noted);
            }
            if overtaken {
                self.counters.count("overtaken");
                return self.refuse(now, &origin, header.destination, OVERTAKEN.into(), store);
            }
        }
        self.dispatch(now, origin, header.destination, &message, store);
        self.forget_heartbeats();
    }

    /// The index of the station that a frame is from, where it may speak and speaks to us; else the name of the drop.
    fn admit(&self, from: SocketAddr, header: &Header) -> Result<usize, &'static str> {
        let ours = |id| self.aircraft.iter().any(|aircraft| aircraft.id() == id);
        if header.source == self.vsm || ours(header.source) {
            // What we sent to the group comes back to us.
            return Err("our own");
        }
        let mut stations = self.stations.iter().enumerate();
        let (index, station) = stations
            .find(|(_, station)| station.id() == header.source)
            .ok_or("unauthorised source")?;
        if station
            .config
            .address
            .is_some_and(|address| address != from.ip())
        {
            return Err("unauthorised address");
        }
        if [self.vsm, Id::BROADCAST].contains(&header.destination) || ours(header.destination) {
            Ok(index)
        } else {
            Err("misaddressed")
        }
    }

    /// A duplicate: what answered it before answers it again. A question is answered anew.
    fn answer_again(
        &mut self,
        now: Now,
        origin: &Origin,
        frame: &Frame<'_>,
        message: &Message,
        answer: Option<AckType>,
        store: &mut dyn Disk,
    ) {
        let destination = frame.header.destination;
        let (mut desk, aircraft) = self.desk(now, store);
        if let Message::CucsAuthorisationRequest(request) = message {
            for aircraft in aircraft.iter_mut() {
                if aircraft.id() == destination
                    || destination == Id::BROADCAST
                    || destination == desk.vsm
                {
                    aircraft.answer_authorisation(&mut desk, origin.station, Some(request));
                }
            }
        }
        if let Message::PositiveHandoverAuthorisationRequest(_) = message
            && let Some(aircraft) = aircraft.iter_mut().find(|one| one.id() == destination)
        {
            aircraft.hand_over_again(&mut desk, origin.station);
        }
        if let Some(answer) = answer {
            desk.acknowledge(destination_as_source(destination, desk.vsm), origin, answer);
        }
    }

    /// Refuses a message that cannot be read, or that a CUCS never sends. Where nobody waits for an answer nothing is told.
    fn refuse(
        &mut self,
        now: Now,
        origin: &Origin,
        destination: Id,
        why: String,
        store: &mut dyn Disk,
    ) {
        let (mut desk, aircraft) = self.desk(now, store);
        if !origin.ack_requested {
            return desk.counters.count("refused");
        }
        match aircraft.iter_mut().find(|one| one.id() == destination) {
            Some(one) => one.refuse_foreign(&mut desk, origin, why),
            None => desk.refuse(origin, &why),
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

fn drop_name(fault: &WrapperError) -> &'static str {
    match fault {
        WrapperError::Oversized { .. } => "oversized",
        WrapperError::NoHeader { .. } | WrapperError::Truncated { .. } => "truncated",
        WrapperError::Length { .. } => "bad length",
        WrapperError::Idd { .. } => "unknown IDD version",
        WrapperError::ChecksumStyle { .. } => "unknown checksum style",
        WrapperError::Checksum { .. } => "wrong checksum",
    }
}

/// Its sender has ordered something else since.
const OVERTAKEN: &str = "a later one has been taken, this one was overtaken on its way";
const ACKNOWLEDGEMENT: u16 = 17000;
