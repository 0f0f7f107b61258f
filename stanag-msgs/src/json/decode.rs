//! From bytes to JSON.

use serde_json::{Map, Value, json};

use super::number::{f32_value, f64_value};

use crate::ed25;
use crate::error::DecodeError;
use crate::field::{EnumInfo, EnumKind, FieldInfo, Wire};
use crate::table::{self, MessageInfo};
use crate::wrapper::{Frame, Frames, HEADER_BYTES, WrapperError, frames};

/// The messages of a datagram in hexadecimal, one object each; for a bad one, an object with `error`
/// and `offset`. The offset counts bytes of the datagram, or characters of the line where that is not
/// hexadecimal. A blank line has no messages.
pub fn decode_line(hex: &str, raw: bool) -> Vec<Value> {
    let line = hex.trim();
    if line.is_empty() {
        return Vec::new();
    }
    match bytes(line) {
        Ok(datagram) => decode(&datagram, raw),
        Err((text, offset)) => vec![error(text, offset)],
    }
}

/// The messages of a datagram of any edition, one object each; for a bad one, an object with `error` and `offset`, which
/// counts bytes.
pub fn decode(datagram: &[u8], raw: bool) -> Vec<Value> {
    if ed25::is_ed25(datagram) {
        return objects(
            ed25::frames(datagram),
            ed25::Frames::offset,
            ed25::HEADER_BYTES,
            |message| (message.header.message_type, frame_ed25(message, raw)),
        );
    }
    objects(frames(datagram), Frames::offset, HEADER_BYTES, |message| {
        (message.header.message_type.into(), frame(message, raw))
    })
}

/// An object for each message of a datagram, and for each part that is not one. `object` also returns the Message
/// Type, which an error's object names.
fn objects<F, I: Iterator<Item = Result<F, WrapperError>>>(
    mut messages: I,
    offset: impl Fn(&I) -> usize,
    header_bytes: usize,
    object: impl Fn(&F) -> (u32, Result<Value, DecodeError>),
) -> Vec<Value> {
    let mut values = Vec::new();
    loop {
        let start = offset(&messages);
        values.push(match messages.next() {
            None => return values,
            Some(Err(fault)) => error(fault, fault.offset()),
            Some(Ok(message)) => {
                let (message_type, value) = object(&message);
                value.unwrap_or_else(|fault| {
                    let mut value = error(fault, start + header_bytes + fault.offset());
                    value["id"] = message_type.into();
                    value
                })
            }
        });
    }
}

/// A message and its wrapper as an object.
///
/// # Errors
/// The data is not that of the header's message.
pub fn frame(frame: &Frame<'_>, raw: bool) -> Result<Value, DecodeError> {
    let header = &frame.header;
    let message = table::message(header.message_type).ok_or(DecodeError::UnknownMessage {
        message_type: header.message_type.into(),
    })?;
    Ok(json!({
        "id": header.message_type,
        "name": message.name,
        "source": header.source.0,
        "destination": header.destination.0,
        "ack": header.ack_requested,
        "idd": header.idd,
        "checksum": header.checksum.code(),
        "fields": fields(message, frame.data, raw)?,
    }))
}

/// A message of Edition 2.5 and its wrapper as an object.
///
/// # Errors
/// The data is not that of the header's message.
pub fn frame_ed25(frame: &ed25::Frame<'_>, raw: bool) -> Result<Value, DecodeError> {
    let header = &frame.header;
    let message_type = header.message_type;
    let message = ed25::message(message_type, header.version)
        .ok_or(DecodeError::UnknownMessage { message_type })?;
    Ok(json!({
        "id": message_type,
        "name": message.name,
        "idd": header.version.text(),
        "instance": header.instance,
        "fields": fields(message, frame.data, raw)?,
    }))
}

/// The fields of message data, by name.
///
/// # Errors
/// The data is not that of this message.
pub fn fields(
    message: &'static MessageInfo,
    data: &[u8],
    raw: bool,
) -> Result<Map<String, Value>, DecodeError> {
    table::walk(message, data)
        .map(|outcome| {
            let (field, bytes) = outcome?;
            Ok((field.name.to_owned(), value(field, bytes, raw)))
        })
        .collect()
}

fn value(field: &FieldInfo, bytes: &[u8], raw: bool) -> Value {
    match field.wire {
        Wire::F32 => bytes
            .try_into()
            .map_or(Value::Null, |bytes| f32_value(f32::from_be_bytes(bytes))),
        Wire::F64 => bytes
            .try_into()
            .map_or(Value::Null, |bytes| f64_value(f64::from_be_bytes(bytes))),
        Wire::Char(_) => {
            let text = bytes.iter().take_while(|&&byte| byte != 0);
            Value::from(text.map(|&byte| character(byte, raw)).collect::<String>())
        }
        _ => {
            let number = integer(bytes, field.wire);
            match field.enumeration {
                _ if raw => Value::from(number),
                Some(info) if info.kind == EnumKind::Bitmap => bits(info, number),
                Some(info) => info
                    .text(number)
                    .map_or_else(|| Value::from(number), Value::from),
                None if field.step() == 1.0 => Value::from(number),
                None => Value::from(number as f64 * field.step()),
            }
        }
    }
}

fn character(byte: u8, raw: bool) -> char {
    if raw || byte.is_ascii() {
        char::from(byte)
    } else {
        '?'
    }
}

fn integer(bytes: &[u8], wire: Wire) -> i64 {
    let number = bytes
        .iter()
        .fold(0, |number: i64, &byte| number << 8 | i64::from(byte));
    match wire.integers() {
        Some((_, high)) if number > high => number - 2 * (high + 1),
        _ => number,
    }
}

/// The texts of the bits that are set, and the bits that have none.
fn bits(info: &EnumInfo, number: i64) -> Value {
    let set = (0..32).map(|bit| 1 << bit).filter(|bit| number & bit != 0);
    set.map(|bit| info.text(bit).map_or_else(|| Value::from(bit), Value::from))
        .collect()
}

fn error(text: impl ToString, offset: usize) -> Value {
    json!({ "error": text.to_string(), "offset": offset })
}

/// The bytes of a text in hexadecimal, or what is wrong with it and at which character.
fn bytes(line: &str) -> Result<Vec<u8>, (String, usize)> {
    let digit = |(offset, character): (usize, char)| match character.to_digit(16) {
        Some(digit) => Ok(digit as u8),
        None => Err((
            format!("{character:?}, expected a hexadecimal digit"),
            offset,
        )),
    };
    let digits = line
        .chars()
        .enumerate()
        .map(digit)
        .collect::<Result<Vec<_>, _>>()?;
    let (pairs, odd) = digits.as_chunks::<2>();
    match odd {
        [] => Ok(pairs.iter().map(|[high, low]| high << 4 | low).collect()),
        _ => Err((
            format!(
                "{} hexadecimal digits, expected an even number",
                digits.len()
            ),
            digits.len(),
        )),
    }
}
