//! The border to VSMs of Edition 2.5: the session works in Edition 4, and what it sends and receives is translated
//! here.
//!
//! Fields are translated by the places that the table names (`stanag_msgs::ed25`), the same that the VSM uses the
//! other way. Code translates what the editions express by different messages: [`commands`] for what is sent, this
//! file for what is received.
//!
//! Edition 2.5 acknowledges that a message was received and nothing more (#1400), and only for types that #1401 names. So:
//!
//! - Each message that awaits an answer is sent behind a #1401 for its type, in one datagram, and repeated with it:
//!   the request may have lapsed, or the VSM may have restarted;
//! - A message that only stores or requests is done once it was received. A mode is carried out once #106 shows it, a
//!   request for control is answered by #21, a handover by #700, a transfer by #900, configuration by #1203, a
//!   parameter by the private #2012; a payload command is carried out once #302 shows it;
//! - A refusal is an alert. One that names the message and this CUCS counts as the answer to the latest message of
//!   that type; with a VSM that words its alerts differently the command waits until its time is up.

mod commands;
mod configuration;
mod payload;
mod places;
mod waiting;

use std::collections::{BTreeMap, VecDeque};

use stanag_msgs::ed25::record::stamp_of;
use stanag_msgs::ed25::{self, Record, Version};
use stanag_msgs::enums::{AckType, HandoverStatus};
use stanag_msgs::messages::{CucsAuthorisationRequest, FieldConfigurationRequest};
use stanag_msgs::table::Direction;
use stanag_msgs::{Id, MAX_DATAGRAM, Message, TimeStamp};

use self::commands::Steering;
pub use self::places::NoCounterpart;
use self::waiting::Waiting;

/// A message as the session handles it, whatever the edition of its datagram.
#[derive(Debug)]
pub(crate) struct Received {
    /// The vehicle, or the VSM.
    pub(crate) source: Id,
    /// This CUCS, or another.
    pub(crate) destination: Id,
    pub(crate) message: Message,
}

/// The state of the exchange with the VSMs.
#[derive(Debug)]
pub(crate) struct Border {
    id: Id,
    /// State of each vehicle that later commands depend on.
    steering: BTreeMap<Id, Steering>,
    waiting: Waiting,
    /// Type and instance of sent messages, which a group may return.
    own: VecDeque<(u32, u32)>,
    out: VecDeque<Vec<u8>>,
    last_stamp: TimeStamp,
    /// The approximate time, ms since 1970: it selects the period of a stamp's counter.
    about_ms: u64,
}

impl Border {
    pub(crate) fn new(id: Id) -> Border {
        Border {
            id,
            steering: BTreeMap::new(),
            waiting: Waiting::default(),
            own: VecDeque::new(),
            out: VecDeque::new(),
            last_stamp: TimeStamp(0),
            about_ms: 0,
        }
    }

    /// Sets the approximate time of what is sent from now on, ms since 1970.
    pub(crate) fn keep_time(&mut self, about_ms: u64) {
        self.about_ms = about_ms;
    }

    /// Whether a message can be expressed in Edition 2.5.
    ///
    /// # Errors
    /// The message, or a field of it, cannot be expressed.
    pub(crate) fn check(&self, destination: Id, message: &Message) -> Result<(), NoCounterpart> {
        let steering = self.steering.get(&destination).cloned();
        commands::records(self.id, &mut steering.unwrap_or_default(), message).map(drop)
    }

    /// The datagram for a message, stamped; empty where Edition 2.5 does not need it.
    ///
    /// # Errors
    /// See [`Border::check`].
    pub(crate) fn datagram(
        &mut self,
        destination: Id,
        message: &Message,
        stamp: TimeStamp,
        acknowledged: bool,
    ) -> Result<Vec<u8>, NoCounterpart> {
        let steering = self.steering.entry(destination).or_default();
        let mut records = commands::records(self.id, steering, message)?;
        let Some(last) = records.last() else {
            return Ok(Vec::new());
        };
        let number = last.id();
        if acknowledged {
            self.waiting.sent(destination, message, stamp);
            // Before a connection only configuration may be acknowledged (4.1.8.2); #1 is answered by #21.
            if number != AUTHORISATION
                && let Some(mut request) = Record::ed25(ACKNOWLEDGE)
            {
                request.set(4, Id::BROADCAST.0);
                request.set(5, Id::NULL.0);
                request.set(6, u32::from(number));
                records.insert(0, request);
            }
        }
        let count = records.len() as u64;
        let mut datagram = Vec::new();
        for (record, later) in records.iter_mut().zip((0..count).rev()) {
            // Each has its own stamp, so that none looks like a repetition; the last one has that of the message.
            let earlier = stamp.0.wrapping_sub(later) % TimeStamp::PERIOD_MS;
            record.move_times_near(self.about_ms);
            record.set_stamp(TimeStamp(earlier));
            datagram.extend(self.whole(record, destination));
        }
        self.last_stamp = stamp;
        Ok(datagram)
    }

    /// A message with its wrapper.
    fn whole(&mut self, record: &Record, vehicle: Id) -> Vec<u8> {
        let mut record = record.clone();
        record.set(2, vehicle.0);
        record.set(3, self.id.0);
        if let Some(stamp) = record.stamp() {
            record.set_stamp_near(stamp, self.about_ms);
        }
        let number = u32::from(record.id());
        let Some(info) = ed25::message(number, VERSION) else {
            return Vec::new();
        };
        let header = ed25::Header {
            version: VERSION,
            // Stamps rise strictly, so their low bits identify each message of a mission.
            instance: record.stamp().map_or(0, |stamp| stamp.0 as u32),
            message_type: number,
        };
        self.own.truncate(MAX_OWN - 1);
        self.own.push_front((number, header.instance));
        let mut out = [0; MAX_DATAGRAM];
        let length = ed25::encode(&header, &record.data(info), &mut out).unwrap_or(0);
        out.get(..length).unwrap_or_default().to_vec()
    }

    /// The next answer that this border sends by itself.
    pub(crate) fn poll_transmit(&mut self) -> Option<Vec<u8>> {
        self.out.pop_front()
    }

    /// The messages of Edition 4 for a message of a VSM.
    ///
    /// # Errors
    /// The reason for which it is dropped.
    pub(crate) fn received(
        &mut self,
        frame: &ed25::Frame<'_>,
    ) -> Result<Vec<Received>, &'static str> {
        let parties = ed25::parties(frame).ok_or("truncated")?;
        let Some(info) = parties.info else {
            return Err("unknown message type");
        };
        let place = (frame.header.message_type, frame.header.instance);
        if self.own.contains(&place) {
            return Err("own");
        }
        if info.direction == Direction::ToVsm {
            return Err("for a VSM");
        }
        // #700 names the parties of a handover in the fields that name the receiver in other messages.
        let destination = match info.id {
            HANDOVER_STATUS => self.id,
            _ => parties.cucs,
        };
        let record = Record::read(info, frame.data).map_err(|_| "undecodable")?;
        let mut messages = Vec::new();
        match info.id {
            _ if destination != self.id => return Err("misaddressed"),
            REQUEST => {
                self.acknowledge(&record, frame.header.instance, parties.vehicle);
                return Ok(Vec::new());
            }
            ACKNOWLEDGE => return Ok(Vec::new()),
            ACKNOWLEDGEMENT => {
                let of = record.number(6).and_then(stamp_of);
                let of = of.and_then(|stamp| self.waiting.received(stamp, record.whole(8)));
                messages.extend(of);
            }
            1300..=1303 => messages.extend(configuration::answer(&record)),
            _ => {
                for target in info.ed4_messages {
                    // A value that Edition 4 cannot hold drops its message, but not the others.
                    messages.extend(record.become_ed4(*target));
                }
            }
        }
        for message in &messages {
            self.steering
                .entry(parties.vehicle)
                .or_default()
                .note(message);
        }
        let answers = self.answers(info.id, &record, parties.vehicle);
        messages.extend(answers);
        let received = messages.into_iter().map(|message| Received {
            source: parties.vehicle,
            destination,
            message,
        });
        Ok(received.collect())
    }

    /// The acknowledgement that a report means for a message that awaits its result.
    fn answers(&mut self, number: u16, record: &Record, vehicle: Id) -> Option<Message> {
        let waiting = &mut self.waiting;
        match number {
            21 => waiting.end(vehicle, AckType::CarriedOut, |one| {
                one.ed4 == CucsAuthorisationRequest::ID
            }),
            106 => {
                let mode = record.whole(4) as u8;
                waiting.end(vehicle, AckType::CarriedOut, |one| {
                    one.received && one.mode == Some(mode)
                })
            }
            302 => {
                let station = record.whole(4);
                let state = self.steering.get(&vehicle)?.payloads.state(station)?;
                waiting.end(vehicle, AckType::CarriedOut, |one| {
                    let shows = one.shows.as_ref().filter(|shows| shows.station == station);
                    one.received && shows.is_some_and(|shows| shows.is_met(state))
                })
            }
            // #1203 ends the answers to #1200.
            CONFIGURED => waiting.end(vehicle, AckType::CarriedOut, |one| {
                one.ed4 == FieldConfigurationRequest::ID
            }),
            PARAMETER_REPORT => {
                let (name, index, count) = (record.text(4), record.whole(7), record.whole(8));
                waiting.end(vehicle, AckType::CarriedOut, |one| {
                    let wanted = one.parameter.as_deref().filter(|_| one.received);
                    wanted.is_some_and(|wanted| {
                        wanted == name || wanted.is_empty() && index + 1 == count
                    })
                })
            }
            HANDOVER_STATUS => {
                let kind = match HandoverStatus::from_raw(record.whole(5) as u8) {
                    HandoverStatus::Successful => AckType::CarriedOut,
                    HandoverStatus::Failed => AckType::Refused,
                    _ => return None,
                };
                waiting.end(vehicle, kind, |one| one.hands_over)
            }
            1100 => {
                let (number, why) = refused(record.text(9), self.id)?;
                let ed4 = commands::ed4_of(number)?;
                // A refusal as superseded is for the command before the latest, which has replaced it.
                let earlier = usize::from(why.contains("superseded"));
                waiting.end_earlier(vehicle, AckType::Refused, earlier, |one| one.ed4 == ed4)
            }
            _ => None,
        }
    }

    /// #1400 for a message of a VSM: by it the VSM knows that it sends to the right address.
    fn acknowledge(&mut self, of: &Record, instance: u32, vehicle: Id) {
        let Some(mut answer) = Record::ed25(ACKNOWLEDGEMENT) else {
            return;
        };
        // A stamp between two messages of this session.
        self.last_stamp = TimeStamp(self.last_stamp.0.max(of.stamp().map_or(0, |stamp| stamp.0)));
        answer.set_stamp(self.last_stamp);
        answer.set(4, of.whole(4));
        answer.set(5, Id::NULL.0);
        answer.set(6, of.number(1).unwrap_or_default());
        answer.set(7, instance);
        answer.set(8, u32::from(of.id()));
        let bytes = self.whole(&answer, vehicle);
        if self.out.len() < MAX_OWN {
            self.out.push_back(bytes);
        }
    }
}

/// The message of this CUCS that an alert refuses, and the reason: `#42 (Vehicle Operating Mode Command) refused`,
/// with or without the name.
/// without.
fn refused(text: &str, own: Id) -> Option<(u16, &str)> {
    let (number, rest) = text.strip_prefix('#')?.split_once(' ')?;
    let (before, why) = rest.split_once("refused")?;
    // A name may contain brackets.
    let before = before.strip_suffix(&format!("of {own} ")).unwrap_or(before);
    let is_name = before.is_empty() || (before.starts_with('(') && before.ends_with(") "));
    Some((number.parse().ok()?, why)).filter(|_| is_name)
}

/// The stamps of two messages are this far apart, so that all messages that one becomes have stamps of their own.
pub(crate) const STAMPS_EACH: u64 = 8;
const VERSION: Version = Version::Ed25;
// Message Types of Edition 2.5.
const AUTHORISATION: u16 = 1;
const HANDOVER_STATUS: u16 = 700;
const PARAMETER_REPORT: u16 = 2012;
const CONFIGURED: u16 = 1203;
const ACKNOWLEDGEMENT: u16 = 1400;
const ACKNOWLEDGE: u16 = 1401;
const REQUEST: u16 = 1403;
/// Sent messages that are recognised when a group returns them.
const MAX_OWN: usize = 256;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_alert_refuses_a_message_of_this_cucs_by_number_with_its_name_or_without() {
        let own = Id(0x1b00_00b0);
        for (text, expected) in [
            ("#42 refused: no", Some((42, ": no"))),
            (
                "#42 (Vehicle Operating Mode Command) refused: no",
                Some((42, ": no")),
            ),
            (
                "#42 (Vehicle Operating Mode Command) of 1b:00:00:b0 refused",
                Some((42, "")),
            ),
            (
                "#600 (IFF Ident (Squawk) Command) of 1b:00:00:b0 refused",
                Some((600, "")),
            ),
            (
                "#42 (Vehicle Operating Mode Command) of 1b:00:00:a0 refused",
                None,
            ),
            ("#42 of 1b:00:00:a0 refused", None),
            ("#42: the launch is not refused", None),
            ("Arming denied", None),
        ] {
            assert_eq!(refused(text, own), expected, "{text}");
        }
    }
}
