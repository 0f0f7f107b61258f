//! From JSON to bytes.

use serde_json::{Map, Value, json};

use super::number::{f32_of, f64_of, integer_of};
use crate::ed25;
use crate::error::EncodeError;
use crate::field::{EnumInfo, EnumKind, FieldInfo, Wire};
use crate::id::Id;
use crate::table::{self, MessageInfo};
use crate::wrapper::{self, ChecksumStyle, Envelope, Header, MAX_DATAGRAM};

const IDD: (i64, i64) = (Header::IDD_ED3 as i64, Header::IDD_ED4 as i64);
/// The keys of a message of Edition 3 or 4, as a decoded one has them.
const KEYS: &[&str] = &[
    "id",
    "name",
    "source",
    "destination",
    "ack",
    "idd",
    "checksum",
    "fields",
];
/// The keys of a message of Edition 2.5.
const KEYS_ED25: &[&str] = &["id", "name", "idd", "instance", "fields"];

/// The message of a JSON object, in hexadecimal.
///
/// `id`, `source`, `destination` and `fields` are required; by default `ack` is false, `idd` 32 and
/// `checksum` 0. `source` and `destination` may also be texts as `1b:00:00:01`. `name` is
/// ignored; another key is an error, so that a misspelt `ack` does not become a message without one. With a text as `idd` it is
/// a message of Edition 2.5, which needs `id` and `fields` only, and may have `instance`.
///
/// # Errors
/// The line is not JSON, or not a message of the table with fields and values that it allows.
pub fn encode_line(json: &str, raw: bool) -> Result<String, JsonError> {
    let value: Value = serde_json::from_str(json).map_err(|error| JsonError::Json {
        // Columns count from 1; the text is a single line.
        offset: error.column().saturating_sub(1),
        cause: error.to_string(),
    })?;
    let datagram = encode(&value, raw)?;
    Ok(datagram.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// The message of a JSON object in bytes; see [`encode_line`].
///
/// # Errors
/// It is not a message of the table with fields and values that it allows.
pub fn encode(value: &Value, raw: bool) -> Result<Vec<u8>, JsonError> {
    let object = value
        .as_object()
        .ok_or_else(|| JsonError::value("the message", value, "an object"))?;
    let mut out = [0; MAX_DATAGRAM];
    let length = match object.get("idd").and_then(Value::as_str) {
        Some(idd) => encode_ed25(object, idd, raw, &mut out)?,
        None => encode_later(object, raw, &mut out)?,
    };
    Ok(out[..length].to_vec())
}

/// A message of Edition 3 or 4; returns how many bytes.
fn encode_later(
    object: &Map<String, Value>,
    raw: bool,
    out: &mut [u8],
) -> Result<usize, JsonError> {
    known(object, KEYS)?;
    let id = integer(object, "id", (0, 0xFFFF))? as u16;
    let message = table::message(id).ok_or(JsonError::UnknownMessage { id })?;
    let envelope = Envelope {
        source: station(object, "source")?,
        destination: station(object, "destination")?,
        ack_requested: match object.get("ack") {
            None => false,
            Some(ack) => ack
                .as_bool()
                .ok_or_else(|| JsonError::value("ack", ack, "true or false"))?,
        },
        idd: integer_or(object, "idd", IDD, Header::IDD_ED4.into())? as u8,
        checksum: ChecksumStyle::from_code(integer_or(object, "checksum", (0, 3), 0)? as u8),
    };
    let data = data(message, fields(object)?, raw)?;
    Ok(wrapper::encode(id, &envelope, out, |out| {
        let expected = out.len().min(wrapper::MAX_DATA);
        let too_long = EncodeError::TooLong {
            message_type: id,
            found: data.len(),
            expected,
        };
        out.get_mut(..data.len())
            .ok_or(too_long)?
            .copy_from_slice(&data);
        Ok(data.len())
    })?)
}

/// A message of Edition 2.5; returns how many bytes.
fn encode_ed25(
    object: &Map<String, Value>,
    idd: &str,
    raw: bool,
    out: &mut [u8],
) -> Result<usize, JsonError> {
    let version = ed25::Version::from_text(idd).ok_or_else(|| {
        JsonError::value(
            "idd",
            &object["idd"],
            "30 to 32, or \"2.5\", \"7\", \"8\" or \"9\"",
        )
    })?;
    known(object, KEYS_ED25)?;
    let id = integer(object, "id", (0, 0xFFFF))? as u16;
    let header = ed25::Header {
        version,
        instance: integer_or(object, "instance", (0, u32::MAX.into()), 0)? as u32,
        message_type: id.into(),
    };
    let message =
        ed25::message(header.message_type, version).ok_or(JsonError::UnknownMessage { id })?;
    let fields = fields(object)?;
    let missing = message
        .fields
        .iter()
        .find(|field| !fields.contains_key(field.name));
    // Raw data are what the wire has; a person who omits a field does not mean zero.
    if let (Some(field), false) = (missing, raw) {
        return Err(JsonError::Missing { key: field.name });
    }
    Ok(ed25::encode(&header, &data(message, fields, raw)?, out)?)
}

/// Why a line is not a message.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum JsonError {
    /// The line is not JSON.
    #[error("not JSON: {cause}")]
    Json {
        /// The character of the line where that was found.
        offset: usize,
        /// What is wrong.
        cause: String,
    },
    /// A required key is missing.
    #[error("{key} is missing")]
    Missing {
        /// The key.
        key: &'static str,
    },
    /// A message has no such key.
    #[error("unknown key {key:?}, expected only {}", known.join(", "))]
    UnknownKey {
        /// The key.
        key: String,
        /// The keys that a message of this edition has.
        known: &'static [&'static str],
    },
    /// A value is of the wrong kind.
    #[error("{place}: {found}, expected {expected}")]
    Value {
        /// The key or field.
        place: String,
        /// The value.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// A value is outside its range.
    #[error("{place}: {found}, expected {low} to {high}{}{}", if unit.is_empty() { "" } else { " " }, unit)]
    Range {
        /// The key or field.
        place: String,
        /// The value.
        found: String,
        /// The minimum.
        low: f64,
        /// The maximum.
        high: f64,
        /// The unit of both; may be empty.
        unit: &'static str,
    },
    /// The table has no such message.
    #[error("id: unknown message type {id}")]
    UnknownMessage {
        /// The Message Type.
        id: u16,
    },
    /// The message has no such field.
    #[error("message {id} has no field {name:?}")]
    UnknownField {
        /// The Message Type.
        id: u16,
        /// The name.
        name: String,
    },
    /// The message cannot be written.
    #[error(transparent)]
    Encode(#[from] EncodeError),
}

impl JsonError {
    /// The error as an object, with the character of the line where it was found: 0 unless the line
    /// is not JSON.
    pub fn to_value(&self) -> Value {
        let offset = if let Self::Json { offset, .. } = self {
            *offset
        } else {
            0
        };
        json!({ "error": self.to_string(), "offset": offset })
    }

    fn value(place: &str, found: &Value, expected: impl ToString) -> Self {
        let (place, found) = (place.to_owned(), found.to_string());
        Self::Value {
            place,
            found,
            expected: expected.to_string(),
        }
    }

    fn range(place: &str, found: &Value, (low, high): (f64, f64), unit: &'static str) -> Self {
        Self::Range {
            place: place.to_owned(),
            found: found.to_string(),
            low,
            high,
            unit,
        }
    }
}

/// Checks that a message has no other keys than these.
fn known(object: &Map<String, Value>, keys: &'static [&'static str]) -> Result<(), JsonError> {
    match object.keys().find(|key| !keys.contains(&key.as_str())) {
        None => Ok(()),
        Some(key) => Err(JsonError::UnknownKey {
            key: key.clone(),
            known: keys,
        }),
    }
}

/// The object of the key `fields`.
fn fields(object: &Map<String, Value>) -> Result<&Map<String, Value>, JsonError> {
    let fields = required(object, "fields")?;
    fields
        .as_object()
        .ok_or_else(|| JsonError::value("fields", fields, "an object"))
}

fn required<'a>(object: &'a Map<String, Value>, key: &'static str) -> Result<&'a Value, JsonError> {
    object.get(key).ok_or(JsonError::Missing { key })
}

fn integer(
    object: &Map<String, Value>,
    key: &'static str,
    bounds: (i64, i64),
) -> Result<i64, JsonError> {
    let value = required(object, key)?;
    let number = integer_of(value).ok_or_else(|| JsonError::value(key, value, "an integer"))?;
    if (bounds.0..=bounds.1).contains(&number) {
        Ok(number)
    } else {
        Err(JsonError::range(
            key,
            value,
            (bounds.0 as f64, bounds.1 as f64),
            "",
        ))
    }
}

/// The integer of an optional key.
fn integer_or(
    object: &Map<String, Value>,
    key: &'static str,
    bounds: (i64, i64),
    default: i64,
) -> Result<i64, JsonError> {
    if object.contains_key(key) {
        integer(object, key, bounds)
    } else {
        Ok(default)
    }
}

fn station(object: &Map<String, Value>, key: &'static str) -> Result<Id, JsonError> {
    match required(object, key)?.as_str() {
        None => Ok(Id(integer(object, key, (0, u32::MAX.into()))? as u32)),
        Some(text) => text
            .parse()
            .map_err(|error| JsonError::value(key, &object[key], error)),
    }
}

/// Presence vector and fields; without a vector every field is written, one left out as zeros.
fn data(
    message: &MessageInfo,
    values: &Map<String, Value>,
    raw: bool,
) -> Result<Vec<u8>, JsonError> {
    if let Some(name) = values.keys().find(|name| message.field(name).is_none()) {
        return Err(JsonError::UnknownField {
            id: message.id,
            name: name.clone(),
        });
    }
    let mut presence = 0u64;
    let mut bytes = vec![0; message.presence_bytes.into()];
    for field in message.fields {
        let Some(value) = values.get(field.name) else {
            if message.presence_bytes == 0 {
                bytes.resize(bytes.len() + field.wire.bytes().unwrap_or_default(), 0);
            }
            continue;
        };
        presence |= 1 << field.bit;
        match field.wire {
            Wire::F32 => bytes.extend(float(field, value, raw, f32_of)?.to_be_bytes()),
            Wire::F64 => bytes.extend(float(field, value, raw, f64_of)?.to_be_bytes()),
            Wire::Char(length) => bytes.extend(text(field, value, length.into(), raw)?),
            Wire::UnsizedText | Wire::UnsizedBytes => {
                let message_type = message.id;
                return Err(EncodeError::UnknownLength {
                    message_type,
                    field,
                }
                .into());
            }
            _ => {
                let number = number(field, value, raw)?;
                let width = field.wire.bytes().unwrap_or_default();
                bytes.extend(&number.to_be_bytes()[8 - width..]);
            }
        }
    }
    let start = 8 - usize::from(message.presence_bytes);
    bytes[..message.presence_bytes.into()].copy_from_slice(&presence.to_be_bytes()[start..]);
    Ok(bytes)
}

/// The integer on the wire.
fn number(field: &FieldInfo, value: &Value, raw: bool) -> Result<i64, JsonError> {
    let bounds = field.wire.integers().unwrap_or_default();
    let (low, high) = (bounds.0 as f64, bounds.1 as f64);
    let unit = field.unit.unwrap_or_default();
    let step = field.step();
    let number = match field.enumeration {
        Some(info) if !raw => member(info, value).ok_or_else(|| {
            JsonError::value(
                field.name,
                value,
                format!("an integer or {}", members(info)),
            )
        })?,
        None if !raw && step != 1.0 => {
            let number = value
                .as_f64()
                .ok_or_else(|| JsonError::value(field.name, value, "a number"))?;
            check(field, value, number)?;
            let steps = (number / step).round();
            if !(low..=high).contains(&steps) {
                return Err(JsonError::range(
                    field.name,
                    value,
                    (low * step, high * step),
                    unit,
                ));
            }
            steps as i64
        }
        _ if field.identification && value.is_string() => {
            let id = value.as_str().and_then(|text| text.parse::<Id>().ok());
            let id = id.ok_or_else(|| {
                JsonError::value(
                    field.name,
                    value,
                    "an id such as 1b:00:00:01, or an integer",
                )
            })?;
            i64::from(id.0.cast_signed())
        }
        _ => integer_of(value).ok_or_else(|| JsonError::value(field.name, value, "an integer"))?,
    };
    if !(bounds.0..=bounds.1).contains(&number) {
        return Err(JsonError::range(field.name, value, (low, high), unit));
    }
    if !raw && step == 1.0 {
        check(field, value, number as f64)?;
    }
    Ok(number)
}

/// Checks against the range that sources give.
fn check(field: &FieldInfo, value: &Value, number: f64) -> Result<(), JsonError> {
    match field.range {
        Some((low, high)) if !(low..=high).contains(&number) => Err(JsonError::range(
            field.name,
            value,
            (low, high),
            field.unit.unwrap_or_default(),
        )),
        _ => Ok(()),
    }
}

/// The value of an integer, of a text, or of a list of either where it is a bitmap.
fn member(info: &EnumInfo, value: &Value) -> Option<i64> {
    match value {
        Value::String(text) => info.value(text),
        Value::Array(bits) if info.kind == EnumKind::Bitmap => bits
            .iter()
            .try_fold(0, |all, bit| Some(all | member(info, bit)?)),
        _ => integer_of(value),
    }
}

fn members(info: &EnumInfo) -> String {
    let texts = info.values.iter().map(|(_, _, text)| format!("{text:?}"));
    let list = texts.collect::<Vec<_>>().join(", ");
    if info.kind == EnumKind::Bitmap {
        format!("a list of {list}")
    } else {
        list
    }
}

fn float<T: Copy + Into<f64>>(
    field: &FieldInfo,
    value: &Value,
    raw: bool,
    read: impl Fn(&Value) -> Option<T>,
) -> Result<T, JsonError> {
    let number = read(value).ok_or_else(|| {
        JsonError::value(
            field.name,
            value,
            format!("a number that fits {}", field.wire),
        )
    })?;
    if !raw {
        check(field, value, number.into())?;
    }
    Ok(number)
}

/// The bytes of a text: too long a text is cut when raw, and an error otherwise.
fn text(field: &FieldInfo, value: &Value, length: usize, raw: bool) -> Result<Vec<u8>, JsonError> {
    let max = length - 1;
    let fitting = || {
        JsonError::value(
            field.name,
            value,
            format!("a text of at most {max} characters"),
        )
    };
    let text = value.as_str().ok_or_else(fitting)?;
    if !raw && text.chars().count() > max {
        return Err(fitting());
    }
    let mut bytes: Vec<u8> = text
        .chars()
        .take(max)
        .map(|character| match u8::try_from(character) {
            Ok(byte) if raw || byte.is_ascii() => byte,
            _ => b'?',
        })
        .collect();
    bytes.resize(length, 0);
    Ok(bytes)
}
