//! A message of any edition, as its row of the table describes it: the fields by their numbers, as values in units.
//!
//! Numbers are in SI units as the rows name them, whatever the scale on the wire; times are seconds since 1970 in
//! every edition, and identification numbers are their four bytes. So a field is converted from one edition to the
//! other by its row alone ([`Record::to_ed4`], [`Record::take_from`]): the wire types, steps and epochs of both are
//! applied on reading and writing.

use std::f64::consts::{PI, TAU};
use std::fmt;

use crate::error::DecodeError;
use crate::scalar::TimeStamp;
use crate::table::{self, FieldInfo, Message, MessageInfo, Wire, walk};

/// The fields of one message.
#[derive(Debug, Clone)]
pub struct Record {
    info: &'static MessageInfo,
    values: Vec<Option<Value>>,
}

/// One field.
#[derive(Debug, Clone, PartialEq)]
pub enum Value {
    /// A number in the unit of its row.
    Number(f64),
    /// A text without its NUL.
    Text(String),
}

/// Why data of Edition 2.5 is refused.
#[derive(Debug, Clone, PartialEq)]
pub enum Fault {
    /// The table has no such message, or the data has another length.
    Layout(DecodeError),
    /// A float that is not a number.
    NotANumber(&'static FieldInfo),
    /// A value outside the range of the text.
    Range(&'static FieldInfo, f64),
    /// A text without a NUL, or with bytes that are not ASCII.
    Text(&'static FieldInfo),
    /// A value that the corresponding field of Edition 4 cannot hold.
    Unrepresentable(&'static FieldInfo, f64),
}

impl Fault {
    /// The name of the counter of messages dropped for it.
    #[must_use]
    pub fn counter(&self) -> &'static str {
        match self {
            Fault::Layout(DecodeError::UnknownMessage { .. }) => "unknown message type",
            Fault::Layout(_) => "undecodable",
            Fault::NotANumber(_) => "not a number",
            Fault::Range(..) | Fault::Unrepresentable(..) => "out of range",
            Fault::Text(_) => "unterminated text",
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let unit = |field: &FieldInfo| field.unit.map_or(String::new(), |unit| format!(" {unit}"));
        match self {
            Fault::Layout(fault) => fault.fmt(f),
            Fault::NotANumber(field) => write!(f, "{} is not a number", field.name),
            Fault::Range(field, value) => {
                let (low, high) = field.range.unwrap_or_default();
                write!(
                    f,
                    "{} {value}, expected {low} to {high}{}",
                    field.name,
                    unit(field)
                )
            }
            Fault::Text(field) => write!(
                f,
                "{} is no ASCII text that ends within its {} bytes",
                field.name,
                field.wire.bytes().unwrap_or_default()
            ),
            Fault::Unrepresentable(field, value) => {
                write!(
                    f,
                    "{} {value}{} is beyond what is flown",
                    field.name,
                    unit(field)
                )
            }
        }
    }
}

impl Record {
    /// A record in which no field has a value.
    #[must_use]
    pub fn new(info: &'static MessageInfo) -> Record {
        Record {
            info,
            values: vec![None; info.fields.len()],
        }
    }

    /// An empty record of a message of Edition 2.5, by its number.
    #[must_use]
    pub fn ed25(number: u16) -> Option<Record> {
        super::table::message(number.into(), super::wrapper::Version::Ed25).map(Record::new)
    }

    /// Reads message data of Edition 2.5, and checks it by the ranges of the text.
    ///
    /// Every field is on the wire. A field without a value holds zero where its range does not include zero, and is
    /// read as absent.
    ///
    /// # Errors
    /// See [`Fault`].
    pub fn read(info: &'static MessageInfo, data: &[u8]) -> Result<Record, Fault> {
        let mut record = Record::new(info);
        for step in walk(info, data) {
            let (field, bytes) = step.map_err(Fault::Layout)?;
            record.values[usize::from(field.bit)] = checked(field, bytes)?;
        }
        Ok(record)
    }

    /// The fields of a message of Edition 4 that are present.
    #[must_use]
    pub fn of(message: &Message) -> Record {
        let info = message.info();
        let mut record = Record::new(info);
        let mut data = [0; crate::wrapper::MAX_DATA];
        // The bridge composes only messages with fields of known length, so this cannot fail.
        let length = message.encode_data(&mut data).unwrap_or(0);
        for (field, bytes) in walk(info, data.get(..length).unwrap_or_default()).flatten() {
            record.values[usize::from(field.bit)] = Some(value(field, bytes));
        }
        record
    }

    /// Its Message Type.
    #[must_use]
    pub fn id(&self) -> u16 {
        self.info.id
    }

    /// A number, by the number of its field from 1.
    #[must_use]
    pub fn number(&self, field: u8) -> Option<f64> {
        match self.values.get(usize::from(field).checked_sub(1)?)? {
            Some(Value::Number(number)) => Some(*number),
            _ => None,
        }
    }

    /// A value, by the number of its field from 1.
    #[must_use]
    pub fn value(&self, field: u8) -> Option<Value> {
        self.values.get(usize::from(field).checked_sub(1)?)?.clone()
    }

    /// An integer; 0 where the field has no value.
    #[must_use]
    pub fn whole(&self, field: u8) -> u32 {
        self.number(field).map_or(0, |number| number as i64 as u32)
    }

    /// A text; empty where the field has none.
    #[must_use]
    pub fn text(&self, field: u8) -> &str {
        let index = usize::from(field).saturating_sub(1);
        match self.values.get(index) {
            Some(Some(Value::Text(text))) => text,
            _ => "",
        }
    }

    /// Sets a field to a number.
    pub fn set(&mut self, field: u8, number: impl Into<f64>) {
        self.put(field, Some(Value::Number(number.into())));
    }

    /// Sets a field to a text; what does not fit is cut off on writing.
    pub fn set_text(&mut self, field: u8, text: impl Into<String>) {
        self.put(field, Some(Value::Text(text.into())));
    }

    /// Sets its Time Stamp, field 1 of every message, in the first period of Edition 4's counter.
    pub fn set_stamp(&mut self, stamp: TimeStamp) {
        self.set(1, stamp.unix_ms() as f64 / 1e3);
    }

    /// Its Time Stamp; `None` where it has none, or a value that is not a time.
    #[must_use]
    pub fn stamp(&self) -> Option<TimeStamp> {
        stamp_of(self.number(1)?)
    }

    /// Sets its Time Stamp in the period of Edition 4's counter that is nearest to `near_ms`, a Unix time in
    /// milliseconds.
    pub fn set_stamp_near(&mut self, stamp: TimeStamp, near_ms: u64) {
        self.set(1, stamp.unix_ms_near(near_ms) as f64 / 1e3);
    }

    /// Moves the times of a message of Edition 4 ([`Record::of`]) into the period that is nearest to `near_ms`.
    pub fn move_times_near(&mut self, near_ms: u64) {
        for field in self.info.fields.iter().filter(|field| is_time(field)) {
            let number = field.bit + 1;
            if let Some(stamp) = self.number(number).and_then(stamp_of) {
                self.set(number, stamp.unix_ms_near(near_ms) as f64 / 1e3);
            }
        }
    }

    /// Removes the value of a field.
    pub fn clear(&mut self, field: u8) {
        self.put(field, None);
    }

    fn put(&mut self, field: u8, value: Option<Value>) {
        let index = usize::from(field).saturating_sub(1);
        if let Some(place) = self.values.get_mut(index) {
            *place = value;
        }
    }

    /// The same in a message of Edition 4: each field for which the table has a place there.
    ///
    /// Bits of payload stations beyond 16 are written to the field of stations 17 to 32, where the message has one.
    ///
    /// # Errors
    /// A station that the message of Edition 4 cannot name.
    pub fn to_ed4(&self, target: &'static MessageInfo) -> Result<Record, Fault> {
        let mut record = Record::new(target);
        for field in self.info.fields {
            let Some((message, number)) = field.ed4 else {
                continue;
            };
            let Some(value) = self.values[usize::from(field.bit)].clone() else {
                continue;
            };
            if message != target.id {
                continue;
            }
            match value {
                Value::Number(bits) if is_split(field, target, number) => {
                    let bits = bits as i64 as u32;
                    record.set(number, bits & 0xFFFF);
                    match upper_half(target) {
                        Some(upper) => record.set(upper, bits >> 16),
                        None if bits >> 16 == 0 => {}
                        None => return Err(Fault::Unrepresentable(field, bits.into())),
                    }
                }
                value => record.put(number, Some(value)),
            }
        }
        Ok(record)
    }

    /// Takes over the values of a message of Edition 4; fields that it lacks keep theirs.
    pub fn take_from(&mut self, ed4: &Record) {
        for field in self.info.fields {
            let Some((message, number)) = field.ed4 else {
                continue;
            };
            let Some(value) = ed4.values.get(usize::from(number).saturating_sub(1)) else {
                continue;
            };
            if message != ed4.id() {
                continue;
            }
            match value {
                Some(Value::Number(low)) if is_split(field, ed4.info, number) => {
                    let upper = upper_half(ed4.info).map_or(0, |upper| ed4.whole(upper));
                    self.set(field.bit + 1, upper << 16 | *low as i64 as u32);
                }
                Some(value) => self.put(field.bit + 1, Some(value.clone())),
                None => {}
            }
        }
    }

    /// The record as a message of Edition 4.
    ///
    /// # Errors
    /// A value that its field there cannot hold: a commanded value is refused, never clamped.
    pub fn message(&self) -> Result<Message, Fault> {
        let mut presence = 0_u64;
        let mut data = vec![0; usize::from(self.info.presence_bytes)];
        for field in self.info.fields {
            if let Some(value) = &self.values[usize::from(field.bit)] {
                presence |= 1 << field.bit;
                write(field, value, Excess::Refuse, &mut data)?;
            }
        }
        let head = usize::from(self.info.presence_bytes);
        data[..head].copy_from_slice(&presence.to_be_bytes()[8 - head..]);
        Message::decode(self.info.id, &data).map_err(Fault::Layout)
    }

    /// The same as the message of Edition 4 with this number.
    ///
    /// # Errors
    /// There is no such message, or a field of it cannot hold the value.
    pub fn become_ed4(&self, target: u16) -> Result<Message, Fault> {
        let unknown = Fault::Layout(DecodeError::UnknownMessage {
            message_type: target.into(),
        });
        self.to_ed4(ed4(target).ok_or(unknown)?)?.message()
    }

    /// The record as message data of Edition 2.5: every field, those without a value as `neutral`.
    #[must_use]
    pub fn data(&self, info: &'static MessageInfo) -> Vec<u8> {
        let mut data = Vec::with_capacity(info.full_bytes());
        for field in info.fields {
            let value = self.values.get(usize::from(field.bit)).cloned().flatten();
            let value = value.unwrap_or_else(|| neutral(field));
            // A report beyond a range is reported as the end of the range: a report cannot be refused.
            let _ = write(field, &value, Excess::Clamp, &mut data);
        }
        data
    }
}

/// Whether a bitmap of 32 stations is divided into two fields of 16.
fn is_split(field: &FieldInfo, target: &MessageInfo, number: u8) -> bool {
    let names_stations = field
        .enumeration
        .is_some_and(|info| info.name == "station_bitmap");
    let place = target.fields.get(usize::from(number).saturating_sub(1));
    names_stations && place.is_some_and(|place| place.wire == Wire::U16)
}

/// The field of payload stations 17 to 32.
fn upper_half(message: &MessageInfo) -> Option<u8> {
    let mut fields = message.fields.iter();
    let field = fields.find(|field| field.name.contains("17-32"))?;
    Some(field.bit + 1)
}

/// The value of a field that nobody has set: zero, or the nearest value in the range.
fn neutral(field: &FieldInfo) -> Value {
    if let Wire::Char(_) = field.wire {
        return Value::Text(String::new());
    }
    let zero = field
        .range
        .map_or(0.0, |(low, high)| 0.0_f64.clamp(low, high));
    let known = field.enumeration.filter(|info| info.kind == table_kind());
    let lowest = known.and_then(|info| info.values.iter().map(|(value, _, _)| *value).min());
    match lowest {
        Some(lowest) if lowest > 0 => Value::Number(lowest as f64),
        _ => Value::Number(zero),
    }
}

const fn table_kind() -> crate::enums::EnumKind {
    crate::enums::EnumKind::Enumeration
}

/// A field of Edition 2.5, checked.
fn checked(field: &'static FieldInfo, bytes: &[u8]) -> Result<Option<Value>, Fault> {
    if let Wire::Char(_) = field.wire {
        let Some(end) = bytes.iter().position(|&byte| byte == 0) else {
            return Err(Fault::Text(field));
        };
        let text = bytes.get(..end).unwrap_or_default();
        if !text.is_ascii() {
            return Err(Fault::Text(field));
        }
    }
    let value = value(field, bytes);
    let Value::Number(number) = value else {
        return Ok(Some(value));
    };
    if !number.is_finite() {
        return Err(Fault::NotANumber(field));
    }
    if is_time(field) && !is_moment(number) {
        // A time without a meaning in this message is filled with 0.
        return match number {
            0.0 if field.bit > 0 => Ok(None),
            _ => Err(Fault::Range(field, number)),
        };
    }
    let Some((low, high)) = field.range.filter(|_| !field.identification) else {
        return Ok(Some(value));
    };
    // pi as a single float is slightly above pi.
    let slack = if field.unit == Some("rad") { 1e-6 } else { 0.0 };
    if (low - slack..=high + slack).contains(&number) {
        Ok(Some(value))
    } else if number == 0.0 {
        Ok(None)
    } else {
        Err(Fault::Range(field, number))
    }
}

/// Whether a number of seconds since 1970 is a time, and not a duration or milliseconds.
///
/// No time is before 2000, where the counter of Edition 4 begins. That counter rolls over in 2034, and later times
/// are counted modulo its period there; the Double of Edition 2.5 does not roll over.
/// modulo its period there: this edition's own Double does not roll over.
#[must_use]
pub fn is_moment(seconds: f64) -> bool {
    moments().contains(&seconds)
}

/// Four periods of Edition 4's counter: until 2139.
fn moments() -> std::ops::Range<f64> {
    let epoch = TimeStamp(0).unix_ms() as f64 / 1e3;
    epoch..epoch + 4.0 * PERIOD_S
}

/// A time of Edition 2.5, in seconds since 1970, as Edition 4 holds it; `None` for what is not a time.
#[must_use]
pub fn stamp_of(seconds: f64) -> Option<TimeStamp> {
    // Rounded to milliseconds first: what rounds up to 2000 is a time.
    let ms = (seconds * 1e3).round();
    is_moment(ms / 1e3).then(|| TimeStamp::from_unix_ms(ms as u64))
}

/// Seconds after which the five bytes of Edition 4 start again.
const PERIOD_S: f64 = TimeStamp::PERIOD_MS as f64 / 1e3;

/// Whether a field is a time, in Edition 2.5 or in Edition 4.
fn is_time(field: &FieldInfo) -> bool {
    [Some("s since 1970"), Some(TimeStamp::UNIT)].contains(&field.unit)
}

/// A field as it is on the wire of its edition.
fn value(field: &FieldInfo, bytes: &[u8]) -> Value {
    match field.wire {
        Wire::Char(_) => {
            let text = bytes.split(|&byte| byte == 0).next().unwrap_or_default();
            Value::Text(text.iter().map(|&byte| char::from(byte & 0x7F)).collect())
        }
        Wire::F32 => Value::Number(match bytes.try_into() {
            Ok(bytes) => f32::from_be_bytes(bytes).into(),
            Err(_) => 0.0,
        }),
        Wire::F64 => Value::Number(bytes.try_into().map_or(0.0, f64::from_be_bytes)),
        _ => {
            let raw = bytes
                .iter()
                .fold(0_i64, |raw, &byte| raw << 8 | i64::from(byte));
            let signed = match field.wire.integers() {
                Some((_, high)) if raw > high && !field.identification => raw - 2 * (high + 1),
                _ => raw,
            };
            Value::Number(match field.unit {
                Some(TimeStamp::UNIT) => TimeStamp(raw as u64).unix_ms() as f64 / 1e3,
                _ => signed as f64 * field.step(),
            })
        }
    }
}

/// What to do with a value that its field cannot hold.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Excess {
    Refuse,
    Clamp,
}

fn write(
    field: &'static FieldInfo,
    value: &Value,
    excess: Excess,
    out: &mut Vec<u8>,
) -> Result<(), Fault> {
    let width = field.wire.bytes().unwrap_or_default();
    let number = match value {
        Value::Text(text) => {
            let mut bytes: Vec<u8> = text.bytes().take(width.saturating_sub(1)).collect();
            bytes.resize(width, 0);
            out.extend(bytes);
            return Ok(());
        }
        Value::Number(number) => *number,
    };
    let within = |low: f64, high: f64| match excess {
        Excess::Clamp => Ok(number.clamp(low, high)),
        Excess::Refuse if (low..=high).contains(&number) => Ok(number),
        Excess::Refuse => Err(Fault::Unrepresentable(field, number)),
    };
    match field.wire {
        Wire::F32 | Wire::F64 => {
            let number = match field.range {
                // A bearing of 0 to 2 pi in one edition is one of -pi to pi in the other.
                Some((low, high)) if field.unit == Some("rad") && high - low > 6.0 => {
                    turned(number, low, high)
                }
                Some((low, high)) => within(low, high)?,
                None => number,
            };
            if field.wire == Wire::F32 {
                // The float nearest to an end of a range may lie outside the range.
                let single = number as f32;
                let single = match field.range {
                    Some((low, _)) if f64::from(single) < low => single.next_up(),
                    Some((_, high)) if f64::from(single) > high => single.next_down(),
                    _ => single,
                };
                out.extend(single.to_be_bytes());
            } else {
                out.extend(number.to_be_bytes());
            }
        }
        _ => {
            let (low, high) = field.wire.integers().unwrap_or_default();
            let raw = if field.unit == Some(TimeStamp::UNIT) {
                let seconds = within(moments().start, moments().end)?;
                TimeStamp::from_unix_ms((seconds * 1e3).round() as u64).0 as i64
            } else if field.identification {
                number as i64
            } else if matches!(field.wire, Wire::Bam16 | Wire::Bam32) {
                // Half a turn is one step above the largest value, and wraps to the smallest.
                let steps = (turned(number, -PI, PI) / field.step()).round() as i64;
                if steps > high { low } else { steps }
            } else {
                let step = field.step();
                (within(low as f64 * step, high as f64 * step)? / step).round() as i64
            };
            out.extend(&raw.to_be_bytes()[8 - width..]);
        }
    }
    Ok(())
}

/// The angle, moved into the turn that begins at `low`.
fn turned(angle: f64, low: f64, high: f64) -> f64 {
    if (low..=high).contains(&angle) {
        angle
    } else {
        low + (angle - low).rem_euclid(TAU)
    }
}

/// The row of a message of Edition 4.
#[must_use]
pub fn ed4(id: u16) -> Option<&'static MessageInfo> {
    table::message(id)
}
