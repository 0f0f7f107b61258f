//! Messages that name messages: acknowledgements by instance (#1400, #1401), requests and schedules by type (#1402, #1403),
//! configuration by message and field (#1200, #1300 to #1304).

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use mapping::configuration::Controls;
use stanag_msgs::ed25::record::ed4;
use stanag_msgs::ed25::{self, Record, places};
use stanag_msgs::enums::{AckType, EnumIndexEnable};
use stanag_msgs::messages::{
    ConfigurationComplete, FieldConfigurationEnumeratedResponse, FieldConfigurationFloatResponse,
    FieldConfigurationIntegerResponse, FieldConfigurationRequest,
    FieldConfigurationUnsignedResponse, GenericInformationRequestMessage, MessageAcknowledgement,
    MessageParameterAvailability, ParameterSetCommand, ScheduleMessageUpdateCommand,
    VehicleOperatingModeCommand,
};
use stanag_msgs::table::{self, Direction, FieldInfo, MessageInfo, Wire};
use stanag_msgs::{Id, Message, TimeStamp};

use super::form::{Refusal, Standing, new, to};
use super::steering::MANUAL;

/// The requests of a station, by the numbers of its edition.
#[derive(Debug, Default)]
pub(crate) struct Requests {
    /// The messages that it has configured to be acknowledged (#1401).
    acknowledged: BTreeSet<u16>,
    /// What its latest messages became, so that an answer uses the station's names.
    sent: VecDeque<Sent>,
    /// The message of Edition 2.5 from which one of Edition 4 was last made.
    numbers: BTreeMap<u16, u16>,
    /// The level of interoperability that is being configured.
    configuring: Option<u8>,
}

/// A message that may be acknowledged.
#[derive(Debug)]
struct Sent {
    ed4: u16,
    stamp: TimeStamp,
    number: u16,
    instance: u32,
    seconds: f64,
    /// #1400 was sent: it acknowledges the reception once.
    done: bool,
}

impl Requests {
    /// Whether messages of this type are acknowledged.
    pub(super) fn acknowledges(&self, number: u16) -> bool {
        self.acknowledged.contains(&number)
    }

    /// #1401: one more message is acknowledged.
    pub(super) fn configure(&mut self, record: &Record) -> Result<(), Refusal> {
        let number = record.whole(6);
        let known = ed25::message(number, ed25::Version::Ed25);
        match known.filter(|info| info.direction != Direction::ToCucs) {
            // An acknowledgement is never acknowledged: two peers would answer each other without end.
            Some(info) if info.id != 1400 => {
                self.acknowledged.insert(info.id);
                Ok(())
            }
            _ => Err(Refusal::new(
                "out of range",
                format!("Message Type {number}, expected a message that a CUCS sends"),
            )),
        }
    }

    /// The connection has ended, or configuration was aborted (4.1.8.2).
    pub(super) fn lapse(&mut self) {
        self.acknowledged.clear();
    }

    /// A message of the station became this one of Edition 4.
    pub(super) fn sent(&mut self, ed4: u16, record: &Record, instance: u32) {
        self.numbers.insert(ed4, record.id());
        let Some((seconds, stamp)) = record.number(1).zip(record.stamp()) else {
            return;
        };
        if self.sent.len() >= MAX_SENT {
            self.sent.pop_front();
        }
        self.sent.push_back(Sent {
            ed4,
            stamp,
            number: record.id(),
            instance,
            seconds,
            done: false,
        });
    }

    /// The station's own message, if this one of Edition 4 was made from it: #42, #43 and #48 all become 2016, and the one
    /// that was sent last need not be the one that is answered.
    pub(super) fn made_from(&self, ed4: u16, stamp: TimeStamp) -> Option<u16> {
        let mut sent = self.sent.iter().rev();
        let sent = sent.find(|one| one.ed4 == ed4 && one.stamp == stamp)?;
        Some(sent.number)
    }

    /// #1400 for a 17000. It means that a message was received and is not refused; an #1100 has the reason of a refusal.
    pub(super) fn acknowledge(
        &mut self,
        answer: &MessageAcknowledgement,
        vsm: Id,
    ) -> Option<Record> {
        if answer.acknowledgement_type == Some(AckType::Refused) {
            return None;
        }
        let (of, stamp) = (
            answer.original_message_type?,
            answer.original_message_time_stamp?,
        );
        let mut sent = self.sent.iter_mut().rev();
        let sent = sent.find(|one| one.ed4 == of && one.stamp == stamp && !one.done)?;
        sent.done = true;
        let mut record = new(1400);
        record.set_stamp(answer.time_stamp?);
        record.set(4, vsm.0);
        record.set(5, Id::NULL.0);
        record.set(6, sent.seconds);
        record.set(7, sent.instance);
        record.set(8, u32::from(sent.number));
        Some(record)
    }

    /// Replaces the numbers of Edition 4 messages in a text of the bridge by those of Edition 2.5, where the text names
    /// them: at its beginning, behind a bracket or a colon, or after one of [`NAMES_A_MESSAGE`]. A number with a unit is none;
    /// one below 2000 is one only where its name follows.
    pub(super) fn in_own_numbers(&self, text: &str) -> String {
        let mut out = String::with_capacity(text.len());
        let mut before = "";
        let mut renamed = Vec::new();
        let mut words = text.split(' ').peekable();
        while let Some(word) = words.next() {
            if !out.is_empty() {
                out.push(' ');
            }
            let digits = word.trim_matches(|c: char| !c.is_ascii_digit());
            let next = words.peek().copied().unwrap_or_default();
            let named = |number: u16| {
                let name = table::message(number).and_then(|info| info.name.split(' ').next());
                name.is_some_and(|name| next.strip_prefix('(') == Some(name))
            };
            let led = before.is_empty()
                || before.ends_with(':')
                || word.starts_with('(')
                || NAMES_A_MESSAGE.contains(&before);
            let measures = word.ends_with(digits)
                && UNITS.contains(&next.trim_matches(|c: char| "),.;:".contains(c)));
            let number = digits.parse().ok();
            let number =
                number.filter(|number| led && !measures && (*number >= 2000 || named(*number)));
            match number.and_then(|number| self.own_number(number)) {
                Some(own) => {
                    out.push_str(&word.replacen(digits, &format!("#{own}"), 1));
                    renamed.extend(number.map(|ed4| (ed4, own)));
                }
                None => out.push_str(word),
            }
            before = word;
        }
        // `13000 (Mission Transfer Command)` now has the number of this edition, but still the name of the other one.
        for (ed4, own) in renamed {
            let named = ed25::messages().find(|info| info.id == own);
            if let Some((ed4, named)) = table::message(ed4).zip(named) {
                let was = format!("#{own} ({})", ed4.name);
                out = out.replacen(&was, &format!("#{own} ({})", named.name), 1);
            }
        }
        out
    }

    fn own_number(&self, ed4: u16) -> Option<u16> {
        let last = self.numbers.get(&ed4).copied();
        let mut all = ed25::messages();
        last.or_else(|| {
            all.find(|info| info.ed4_messages.contains(&ed4))
                .map(|info| info.id)
        })
    }

    /// #1200: `None` if Edition 4 has no name for its subject.
    pub(super) fn configuration(&mut self, record: &Record) -> Result<Option<Message>, Refusal> {
        let request = record.whole(6);
        self.configuring = match request {
            1..=4 => Some([2, 3, 4, 4][request as usize - 1]),
            ABORT => {
                self.lapse();
                None
            }
            _ => None,
        };
        let mut moved = record.clone();
        if request == SINGLE {
            let (number, field) = (record.whole(7), record.whole(8));
            let info = ed25::message(number, ed25::Version::Ed25).ok_or_else(|| {
                Refusal::new(
                    "out of range",
                    format!("Requested Message {number} is not known"),
                )
            })?;
            let place = match u8::try_from(field).ok().filter(|field| *field > 0) {
                Some(control @ Controls::FIRST..) if number == PARAMETER_SET => {
                    Some((ParameterSetCommand::ID, control))
                }
                None => info.ed4_messages.first().map(|message| (*message, 0)),
                Some(field) => {
                    let row = info.fields.get(usize::from(field) - 1);
                    let row = row.ok_or_else(|| {
                        let fields = info.fields.len();
                        let why = format!("Requested Field {field}, message {number} has {fields}");
                        Refusal::new("out of range", why)
                    })?;
                    row.ed4
                }
            };
            let Some((message, field)) = place else {
                return Ok(None);
            };
            moved.set(7, u32::from(message));
            moved.set(8, field);
        }
        to(&moved, FieldConfigurationRequest::ID).map(Some)
    }

    /// The answers of a configuration, by the numbers of Edition 2.5; `None` if this is no such answer.
    pub(super) fn answers(&mut self, answer: &Record) -> Option<Vec<Record>> {
        let id = answer.id();
        let (message, field) = match id {
            FieldConfigurationIntegerResponse::ID
            | FieldConfigurationFloatResponse::ID
            | FieldConfigurationUnsignedResponse::ID
            | FieldConfigurationEnumeratedResponse::ID => (answer.whole(7), answer.whole(8)),
            MessageParameterAvailability::ID => (answer.whole(5), answer.whole(6)),
            ConfigurationComplete::ID => {
                let mut records = self.unnamed(answer);
                let mut complete = new(1203);
                complete.take_from(answer);
                records.push(complete);
                return Some(records);
            }
            _ => return None,
        };
        let (message, field) = (u16::try_from(message).ok()?, u8::try_from(field).ok()?);
        if message == ParameterSetCommand::ID && field >= Controls::FIRST {
            return Some(vec![control(answer, field)]);
        }
        let is_manual = (message, field) == MODE && answer.number(8) == Some(f64::from(MANUAL));
        let places = places(message, field);
        let records = places.map(|(info, field)| match id {
            MessageParameterAvailability::ID => {
                let mut record = new(1303);
                record.take_from(answer);
                record.set(7, u32::from(info.id));
                record.set(8, field.map_or(0, |field| field.bit + 1));
                if answer.number(7).is_none() {
                    record.set(9, 0);
                }
                // Whatever the vehicle takes: this edition has no sticks.
                if is_manual {
                    record.set(11, EnumIndexEnable::NotImplemented.raw());
                }
                record
            }
            FieldConfigurationEnumeratedResponse::ID => {
                let mut record = new(1302);
                record.take_from(answer);
                name(record, info, field)
            }
            _ => limits(answer, info, field),
        });
        Some(records.collect())
    }

    /// Messages of Edition 2.5 without a counterpart in Edition 4: #1303 reports that they are not supported, before the
    /// #1203 of their level.
    fn unnamed(&mut self, complete: &Record) -> Vec<Record> {
        let Some(level) = self.configuring.take() else {
            return Vec::new();
        };
        let missing = ed25::messages().filter(|info| {
            info.ed4_messages.is_empty() && info.loi.contains(&level) && !OWN.contains(&info.id)
        });
        missing
            .map(|info| unsupported(complete, info.id.into(), 0))
            .collect()
    }
}

/// #1303: not available.
fn unsupported(of: &Record, message: u32, field: u32) -> Record {
    let mut record = new(1303);
    record.set(1, of.number(1).unwrap_or_default());
    record.set(4, of.number(2).unwrap_or_default());
    record.set(5, Id::NULL.0);
    record.set(7, message);
    record.set(8, field);
    record
}

/// #1303 and #1203 for a field that has no place in Edition 4: it is ignored.
pub(super) fn unavailable(request: &Record, standing: &Standing<'_>) -> Vec<Record> {
    let mut complete = new(1203);
    let mut field = unsupported(request, request.whole(7), request.whole(8));
    for record in [&mut field, &mut complete] {
        record.set_stamp(standing.stamp);
        record.set(4, standing.vsm.0);
        record.set(5, Id::NULL.0);
    }
    vec![field, complete]
}

/// #1304.
pub(super) fn services(standing: &Standing<'_>) -> Record {
    let mut record = new(1304);
    record.set_stamp(standing.stamp);
    record.set_text(4, standing.web_page.unwrap_or_default());
    record
}

/// #1400 for a message that the translator itself carries out.
pub(super) fn acknowledgement(of: &Record, instance: u32, standing: &Standing<'_>) -> Record {
    let mut record = new(1400);
    record.set_stamp(standing.stamp);
    record.set(4, standing.vsm.0);
    record.set(5, Id::NULL.0);
    record.set(6, of.number(1).unwrap_or_default());
    record.set(7, instance);
    record.set(8, u32::from(of.id()));
    record
}

/// #1402. Edition 4 has whole hertz: less than one becomes one, since 0 would cancel.
pub(super) fn schedule(record: &Record) -> Result<Message, Refusal> {
    let mut moved = record.clone();
    moved.set(4, u32::from(report_of(record.whole(4))?));
    let hertz = record.number(5).unwrap_or_default();
    moved.set(
        5,
        if hertz > 0.0 {
            hertz.round().max(1.0)
        } else {
            0.0
        },
    );
    to(&moved, ScheduleMessageUpdateCommand::ID)
}

/// #1403.
pub(super) fn report(record: &Record) -> Result<Message, Refusal> {
    let mut moved = record.clone();
    moved.set(7, u32::from(report_of(record.whole(7))?));
    to(&moved, GenericInformationRequestMessage::ID)
}

/// The message of Edition 4 from which a report of Edition 2.5 is made.
fn report_of(number: u32) -> Result<u16, Refusal> {
    let info = ed25::message(number, ed25::Version::Ed25);
    let sent = info.filter(|info| info.direction != Direction::ToVsm);
    let place = sent.and_then(|info| info.ed4_messages.first().copied());
    place.ok_or_else(|| {
        Refusal::new(
            "not supported",
            format!("message #{number} is not sent by this VSM"),
        )
    })
}

fn name(mut record: Record, info: &MessageInfo, field: Option<&FieldInfo>) -> Record {
    record.set(7, u32::from(info.id));
    record.set(8, field.map_or(0, |field| field.bit + 1));
    record
}

/// #1300 for an integer control, #1301 for a float, #1303 for one that no longer exists. Its number is a field of #2011
/// that the table does not have.
fn control(answer: &Record, field: u8) -> Record {
    let (number, low, high) = match answer.id() {
        FieldConfigurationIntegerResponse::ID => (1300, f64::from(i32::MIN), f64::from(i32::MAX)),
        FieldConfigurationFloatResponse::ID => (1301, f64::from(f32::MIN), f64::from(f32::MAX)),
        _ => {
            let mut record = new(1303);
            record.take_from(answer);
            record.set(7, PARAMETER_SET);
            record.set(8, field);
            return record;
        }
    };
    let mut record = new(number);
    for (of, at) in [(1, 1), (4, 2), (5, 3), (6, 4), (9, 9), (20, 21), (14, 15)] {
        if let Some(value) = answer.number(at) {
            record.set(of, value);
        }
    }
    // Every field is sent, and 0 to 0 would be a range: an unknown bound is the limit of the type, which limits nothing.
    let (most, least) = (answer.number(11), answer.number(12));
    for (field, value) in [
        (10, most.unwrap_or(high)),
        (11, least.unwrap_or(low)),
        (12, most.unwrap_or(high)),
        (13, least.unwrap_or(low)),
        (15, high),
        (16, high),
        (17, low),
        (18, low),
    ] {
        record.set(field, value);
    }
    record.set_text(19, answer.text(20));
    record.set(7, PARAMETER_SET);
    record.set(8, field);
    record
}

/// #1300 or #1301, by the type of the field in Edition 2.5. The bounds of Edition 4 are in steps of its wire format.
fn limits(
    answer: &Record,
    info: &'static MessageInfo,
    field: Option<&'static FieldInfo>,
) -> Record {
    let real = field.is_some_and(|field| matches!(field.wire, Wire::F32 | Wire::F64));
    let mut record = new(if real { 1301 } else { 1300 });
    let there = field.and_then(|field| field.ed4);
    let there =
        there.and_then(|(message, number)| ed4(message)?.fields.get(usize::from(number) - 1));
    let step = there.map_or(1.0, |there| match there.wire {
        Wire::F32 | Wire::F64 => 1.0,
        _ => there.step(),
    });
    for (of, at) in [(1, 1), (4, 2), (5, 3), (6, 4), (9, 9), (20, 21)] {
        if let Some(value) = answer.number(at) {
            record.set(of, value);
        }
    }
    for bound in 10..=18 {
        // The same order in all three messages of Edition 4, after Default Value.
        if let Some(value) = answer.number(bound + 1) {
            record.set(bound, value * step);
        }
    }
    record.set_text(19, answer.text(20));
    name(record, info, field)
}

/// Words before the number of a message.
const NAMES_A_MESSAGE: [&str; 5] = ["message", "a", "the", "its", "then"];
/// Words after a number that is a value.
const UNITS: [&str; 10] = [
    "m",
    "m/s",
    "s",
    "ms",
    "Hz",
    "hPa",
    "bytes",
    "times",
    "%",
    "waypoints",
];
/// #2011, for 50011.
const PARAMETER_SET: u32 = 2011;
/// Select Flight Path Control Mode, its field counted from 1.
const MODE: (u16, u8) = (VehicleOperatingModeCommand::ID, 2);
const SINGLE: u32 = 0;
const ABORT: u32 = 6;
/// Messages that the translator answers itself, so they are supported.
const OWN: &[u16] = &[48, 109, 205, 306, 307, 1202, 1401];
/// Maximum number of messages whose answers are awaited.
const MAX_SENT: usize = 256;
