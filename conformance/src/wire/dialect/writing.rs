//! Drafts of the rules as messages of Edition 2.5.

use std::collections::BTreeMap;

use stanag_msgs::Id;
use stanag_msgs::ed25;
use stanag_msgs::table::{Direction, FieldInfo, MessageInfo, Wire};

use super::places::{self, NAMING, row, rows_of};
use super::{
    ACKNOWLEDGE, ACKNOWLEDGEMENT, EPOCH_2000_S, LOITER, LOITER_REPORT, MODE_COMMAND,
    PAYLOAD_COMMAND, PREFERENCE, PREFERENCE_REPORT, RESOURCES, Role, STEERING, marker,
};
use crate::wire::{Draft, Seen, checksum, ed25 as wrapper};

/// Who writes: what the wrapper of a later edition would carry.
#[derive(Clone, Copy, Debug)]
pub struct Writer {
    /// Which side.
    pub role: Role,
    /// Source, where the draft has none.
    pub source: Id,
    /// Destination, where the draft has none.
    pub destination: Id,
    /// The VSM, for the messages that name it.
    pub vsm: Id,
    /// Altitude in metres and its type at which a loiter may be flown: #41 always has one, and it must not be 0.
    pub loiter: Option<(f64, i64)>,
}

/// What a draft became.
#[derive(Clone, Debug, Default)]
pub struct Made {
    /// Its messages, in the order in which they are sent.
    pub messages: Vec<Vec<u8>>,
    /// What of it Edition 2.5 has no message or field for.
    pub missing: Vec<String>,
}

impl Made {
    /// All of it in one datagram.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        self.messages.concat()
    }
}

/// Fields that may be dropped: Edition 2.5 expresses their meaning by other fields.
const NEEDLESS: &[(u16, &str)] = &[(13_000, "Route ID"), (14_000, "Mission Plan Mode")];

/// The draft in Edition 2.5. `instance` returns a new Message Instance ID for each message.
#[must_use]
pub fn encode(draft: &Draft, writer: &Writer, mut instance: impl FnMut() -> u32) -> Made {
    let mut made = Made::default();
    let kind = draft.message_type;
    if let Some(data) = &draft.data {
        // Data that are wrong on purpose are sent unchanged, under the type that the table has for them, or their
        // own.
        let number = rows_of(kind).first().map_or(kind, |info| info.id);
        made.messages
            .push(wrap(draft, number.into(), data, instance()));
        return made;
    }
    let seen = draft.seen();
    let mut records: Vec<Record> = Vec::new();
    let mut placed: Vec<&'static str> = vec!["Time Stamp"];
    for info in chosen(draft, &seen, writer.role) {
        let mut record = Record::new(info);
        for field in info.fields {
            let Some(source) = field
                .ed4
                .filter(|(message, _)| *message == kind)
                .and_then(|(_, number)| seen.info?.fields.get(usize::from(number) - 1))
            else {
                continue;
            };
            if draft.has(source.name) {
                placed.push(source.name);
                if !record.carry(field, draft, source, &seen) {
                    made.missing.push(format!(
                        "a value of {} of {kind} in #{}",
                        source.name, info.id
                    ));
                }
            }
        }
        records.push(record);
    }
    if records.is_empty() {
        made.missing.push(format!("message {kind}"));
        return made;
    }
    if let Some(naming) = NAMING.iter().find(|naming| naming.ed4 == kind) {
        made.missing.extend(name(&seen, naming, &mut records[0]));
    }
    if let Some(preference) = preference_of(draft, &seen) {
        placed.push("Loiter Radius");
        for (number, part) in (4..).zip(preference) {
            records[0].integer(number, part);
        }
    }
    if kind == 2016 {
        steer(draft, &seen, &mut records);
    }
    if records[0].info.id == PAYLOAD_COMMAND && !draft.has("Image Output") {
        // #201 cannot leave this out, and 0 would switch the picture off: the EO sensor is chosen.
        records[0].integer(9, 1);
    }
    if kind == LOITER && records[0].info.id == LOITER_CONFIGURATION {
        match writer.loiter {
            Some((metres, altitude_type)) => {
                records[0].real(9, metres);
                records[0].integer(10, altitude_type);
            }
            None => made
                .missing
                .push("#41 without an altitude; no position is known".into()),
        }
    }
    if kind == 13_003 && seen.raw("Loiter Duration Units").unwrap_or_default() == 0 {
        // #803 has seconds only, so the unit needs no place.
        placed.push("Loiter Duration Units");
    }
    for info in seen.info.map_or(&[][..], |info| info.fields) {
        let left = draft.has(info.name) && !placed.contains(&info.name);
        if left && !NEEDLESS.contains(&(kind, info.name)) {
            made.missing.push(format!("field {} of {kind}", info.name));
        }
    }
    let stamp = seen.raw("Time Stamp");
    let last = records.len() - 1;
    for (index, mut record) in records.into_iter().enumerate() {
        let source = draft.source.unwrap_or(writer.source);
        let destination = draft.destination.unwrap_or(writer.destination);
        record.address(writer, source, destination);
        if let Some(stamp) = stamp {
            // Several messages from one draft: each has its own stamp, the last one that of the draft.
            record.stamp(stamp - (last - index) as i64);
        }
        let bytes = wrap(draft, record.info.id.into(), &record.data(), instance());
        made.messages.push(bytes);
    }
    made
}

/// #1401: messages of these types are to be acknowledged.
#[must_use]
pub fn acknowledge(
    types: &[u16],
    writer: &Writer,
    mut stamp: impl FnMut() -> i64,
    mut instance: impl FnMut() -> u32,
) -> Vec<u8> {
    let mut all = Vec::new();
    for &number in types {
        all.extend(plain(
            ACKNOWLEDGE,
            &[(6, number.into())],
            writer,
            stamp(),
            instance(),
        ));
    }
    all
}

/// #48: what overrides altitude, speed, course and heading; 0 leaves the configuration in charge.
#[must_use]
pub fn preference(parts: [i64; 3], writer: &Writer, stamp: i64, instance: u32) -> Vec<u8> {
    let [altitude, speed, course] = parts;
    let fields = [(4, altitude), (5, speed), (6, course)];
    plain(PREFERENCE, &fields, writer, stamp, instance)
}

/// #1400 about a message as it was received.
#[must_use]
pub fn acknowledgement(of: &Seen, writer: &Writer, stamp: i64, instance: u32) -> Vec<u8> {
    let Some(info) = row(ACKNOWLEDGEMENT) else {
        return Vec::new();
    };
    let mut record = Record::new(info);
    record.real(6, of.value("Time Stamp").unwrap_or_default());
    let wrapped = of.piece.wrapped.as_ref();
    record.integer(7, wrapped.map_or(0, |wrapped| wrapped.instance.into()));
    record.integer(8, of.kind().into());
    record.address(writer, writer.source, writer.destination);
    record.stamp(stamp);
    wrap(
        &Draft::new(17_000),
        info.id.into(),
        &record.data(),
        instance,
    )
}

/// #1202 of a CUCS without displays.
#[must_use]
pub fn resources(writer: &Writer, stamp: i64, instance: u32) -> Vec<u8> {
    plain(RESOURCES, &[], writer, stamp, instance)
}

/// The types under which a draft is sent.
#[must_use]
pub fn types_of(draft: &Draft, role: Role) -> Vec<u16> {
    let rows = chosen(draft, &draft.seen(), role);
    rows.iter().map(|info| info.id).collect()
}

fn plain(number: u16, fields: &[(u8, i64)], writer: &Writer, stamp: i64, instance: u32) -> Vec<u8> {
    let Some(info) = row(number) else {
        return Vec::new();
    };
    let mut record = Record::new(info);
    for &(field, value) in fields {
        record.integer(field, value);
    }
    record.address(writer, writer.source, writer.destination);
    record.stamp(stamp);
    wrap(&Draft::new(17_000), number.into(), &record.data(), instance)
}

/// The message types of Edition 2.5 that a draft becomes.
fn chosen(draft: &Draft, seen: &Seen, role: Role) -> Vec<&'static MessageInfo> {
    let kind = draft.message_type;
    if preference_of(draft, seen).is_some() {
        let number = if kind == LOITER {
            PREFERENCE
        } else {
            PREFERENCE_REPORT
        };
        return row(number).into_iter().collect();
    }
    if kind == LOITER_REPORT {
        return Vec::new();
    }
    if kind == 2016 {
        return mode_messages(draft, seen);
    }
    let rows = rows_of(kind);
    let own = match role {
        Role::Cucs => Direction::ToVsm,
        Role::Vehicle => Direction::ToCucs,
    };
    // A message of the other direction is sent too, where a rule is about that.
    let fitting =
        |info: &&&'static MessageInfo| info.direction == own || info.direction == Direction::Both;
    let first = rows.iter().find(fitting).or(rows.first());
    first.into_iter().copied().collect()
}

/// #48, #42 and #43, as far as a 2016 needs them. In waypoint and loiter mode #48 has only what overrides the route.
/// There, and in steering, a demand acts at once, so #43 follows the mode; a launch or a landing starts with the
/// values sent before it.
fn mode_messages(draft: &Draft, seen: &Seen) -> Vec<&'static MessageInfo> {
    let steers = STEERING_FIELDS.iter().any(|name| draft.has(name));
    let mode = seen.raw(MODE);
    let names_only = !STEERING_FIELDS
        .iter()
        .any(|name| *name != WAYPOINT && draft.has(name));
    let numbers: &[u16] = match (steers, mode) {
        // The first waypoint is named before the flight is started.
        (true, Some(11)) if names_only => &[STEERING, MODE_COMMAND],
        (false, _) => &[MODE_COMMAND],
        (true, None) => &[PREFERENCE, STEERING],
        (true, Some(11 | 12)) => &[PREFERENCE, MODE_COMMAND, STEERING],
        (true, Some(15)) => &[MODE_COMMAND, STEERING],
        (true, Some(_)) => &[STEERING, MODE_COMMAND],
    };
    numbers.iter().filter_map(|&number| row(number)).collect()
}

/// Which groups of #43 rule over the configuration, and the types that make its values count.
fn steer(draft: &Draft, seen: &Seen, records: &mut [Record]) {
    let has = |names: &[&str]| names.iter().any(|name| draft.has(name));
    let raw = |name: &str| seen.raw(name).unwrap_or_default();
    for record in records {
        if record.info.id == PREFERENCE {
            let groups = [
                has(&["Commanded Altitude", "Commanded Vertical Speed"]),
                has(&["Commanded Speed"]),
                raw("Heading Command Type") != 0 || has(&["Loiter Position Latitude"]),
            ];
            for (number, ruled) in (4..).zip(groups) {
                record.integer(number, if ruled { 2 } else { 0 });
            }
        }
        if record.info.id == STEERING && !draft.has("Altitude Command Type") {
            let (height, climb) = (
                draft.has("Commanded Altitude"),
                draft.has("Commanded Vertical Speed"),
            );
            record.integer(4, i64::from(height) + 2 * i64::from(climb));
        }
    }
}

/// The preference that a 2017 or 3004 with nothing but a radius stands for.
fn preference_of(draft: &Draft, seen: &Seen) -> Option<[i64; 3]> {
    if ![LOITER, LOITER_REPORT].contains(&draft.message_type) || draft.data.is_some() {
        return None;
    }
    let other = seen.info?.fields.iter().any(|field| {
        !["Time Stamp", "Loiter Radius"].contains(&field.name) && draft.has(field.name)
    });
    if other && draft.message_type == LOITER {
        return None;
    }
    marker::preference(seen.value("Loiter Radius")?)
}

/// Writes which message and field a message names, by the numbers of Edition 2.5; returns what has no such number.
fn name(seen: &Seen, naming: &places::Naming, record: &mut Record) -> Option<String> {
    let field = |number: u8| {
        let index = usize::from(number).checked_sub(1)?;
        seen.raw(seen.info?.fields.get(index)?.name)
    };
    let kind = field(naming.ed4_fields.0).filter(|kind| *kind != 0)?;
    let missing = format!("message {kind}, which {} names", naming.ed4);
    let kind = u16::try_from(kind).ok()?;
    let (message, of) = naming.ed25_fields;
    if of == 0 {
        let number = match naming.ed25 {
            ACKNOWLEDGEMENT => rows_of(kind).first().map(|info| info.id),
            _ => places::report_of(kind),
        };
        // A schedule or request for what does not exist keeps its number, which does not exist here either.
        record.integer(message, number.unwrap_or(kind).into());
        return (number.is_none() && stanag_msgs::table::message(kind).is_some())
            .then_some(missing);
    }
    let number = u8::try_from(field(naming.ed4_fields.1).unwrap_or_default()).ok()?;
    match places::field_of(kind, number) {
        Some((there, place)) => {
            record.integer(message, there.into());
            record.integer(of, place.into());
            None
        }
        None => Some(missing),
    }
}

/// Wrapper, data and checksum; version and length are wrong where the draft requests it.
fn wrap(draft: &Draft, number: u32, data: &[u8], instance: u32) -> Vec<u8> {
    let mut out = Vec::with_capacity(wrapper::WRAPPER + data.len());
    let version = match draft.idd {
        Some(idd) => idd.to_string(),
        None => ed25::Version::Ed25.text().to_owned(),
    };
    out.extend(version.as_bytes().iter().take(9));
    out.resize(10, 0);
    let length = draft.length.map_or(data.len() as u32, u32::from);
    for word in [instance, number, length, 0, u32::MAX] {
        out.extend(word.to_be_bytes());
    }
    out.extend(data);
    let sum = checksum(2, &out);
    out.extend(sum);
    out
}

/// Loiter Configuration of Edition 2.5.
const LOITER_CONFIGURATION: u16 = 41;
const WAYPOINT: &str = "Commanded Waypoint Number";
const MODE: &str = "Select Flight Path Control Mode";
/// Fields of 2016 that #43 carries.
const STEERING_FIELDS: &[&str] = &[
    "Altitude Command Type",
    "Commanded Altitude",
    "Commanded Vertical Speed",
    "Heading Command Type",
    "Commanded Heading",
    "Commanded Course",
    "Commanded Turn Rate",
    "Commanded Roll Rate",
    "Commanded Roll",
    "Commanded Speed",
    "Speed Type",
    WAYPOINT,
    "Altimeter Setting",
    "Altitude Type",
    "Loiter Position Latitude",
    "Loiter Position Longitude",
];

/// A message of Edition 2.5 in the making: every field is there, 0 where nothing is set.
struct Record {
    info: &'static MessageInfo,
    fields: BTreeMap<u8, Vec<u8>>,
}

impl Record {
    fn new(info: &'static MessageInfo) -> Self {
        let fields = info
            .fields
            .iter()
            .map(|field| (field.bit + 1, vec![0; field.wire.bytes().unwrap_or(0)]))
            .collect();
        Self { info, fields }
    }

    fn data(&self) -> Vec<u8> {
        self.fields.values().flatten().copied().collect()
    }

    fn integer(&mut self, number: u8, value: i64) {
        if let Some(bytes) = self.fields.get_mut(&number) {
            let width = bytes.len().min(8);
            *bytes = value.to_be_bytes()[8 - width..].to_vec();
        }
    }

    fn real(&mut self, number: u8, value: f64) {
        if let Some(bytes) = self.fields.get_mut(&number) {
            *bytes = match bytes.len() {
                4 => (value as f32).to_be_bytes().to_vec(),
                _ => value.to_be_bytes().to_vec(),
            };
        }
    }

    /// Writes milliseconds since 2000 into field 1.
    fn stamp(&mut self, ms: i64) {
        self.real(1, ms as f64 / 1000.0 + EPOCH_2000_S);
    }

    /// Writes vehicle and CUCS; also the VSM where a field names it and the draft did not set it.
    fn address(&mut self, writer: &Writer, source: Id, destination: Id) {
        let towards = match (self.info.direction, writer.role) {
            (Direction::ToVsm, _) | (Direction::Both, Role::Cucs) => (destination, source),
            (Direction::ToCucs, _) | (Direction::Both, Role::Vehicle) => (source, destination),
        };
        let named = |name: &str| self.info.fields.iter().find(|field| field.name == name);
        let places = [
            (named("Vehicle ID"), towards.0),
            (named("CUCS ID"), towards.1),
            (named("CUCS ID (Controlling)"), towards.1),
            (named("VSM ID"), writer.vsm),
        ];
        for (field, id) in places {
            if let Some(field) = field
                && self.fields[&(field.bit + 1)].iter().all(|&byte| byte == 0)
            {
                self.integer(field.bit + 1, id.0.into());
            }
        }
    }

    /// Copies a field of the draft; false where its value does not fit.
    fn carry(&mut self, field: &FieldInfo, draft: &Draft, source: &FieldInfo, seen: &Seen) -> bool {
        let number = field.bit + 1;
        match field.wire {
            Wire::Char(length) => {
                // Copied as bytes, so that a text without a NUL stays one.
                let mut bytes = draft.field_bytes(source).unwrap_or_default().to_vec();
                bytes.resize(length.into(), 0);
                self.fields.insert(number, bytes);
                true
            }
            Wire::F32 | Wire::F64 => {
                let exact = draft.exact(source).or(seen.value(source.name));
                let Some(value) = exact else { return false };
                self.real(
                    number,
                    if source.wire == Wire::U40 {
                        value / 1000.0 + EPOCH_2000_S
                    } else {
                        value
                    },
                );
                true
            }
            wire => {
                let value = draft.exact(source).or(seen.value(source.name));
                let (Some(value), Some((low, high))) = (value, wire.integers()) else {
                    return false;
                };
                let raw = (value / field.step()).round();
                // An id is a bit pattern in either edition.
                let bits = wire == Wire::I32 && source.wire.bytes() == Some(4);
                let fits = (low as f64..=high as f64).contains(&raw);
                self.integer(number, raw as i64);
                fits || bits
            }
        }
    }
}
