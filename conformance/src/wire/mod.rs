//! Messages as the suite reads and makes them: byte by byte, so that it can judge wrong bytes and send some.
//!
//! [`split`] takes a datagram apart and trusts nothing but lengths; [`Seen`] is a message of it with its fields, by
//! their names in the table; [`Draft`] makes a message, right or wrong on purpose. `stanag_msgs` has the table; its
//! strict codec is not used here, because what it refuses is what has to be judged.

pub mod dialect;
mod ed25;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use serde_json::{Map, Value, json};
use stanag_msgs::table::{self, FieldInfo, MessageInfo, Wire};
use stanag_msgs::{DecodeError, Id};

use ed25::number;
pub use ed25::{WRAPPER as WRAPPER_25, Wrapped};

/// Bytes of the header.
pub const HEADER: usize = 16;

/// A message as it is in a datagram; only that its bytes are there was checked.
#[derive(Clone, Debug, PartialEq)]
pub struct Piece {
    /// The first word.
    pub reserved: u16,
    /// Message Length as it is in the header.
    pub length: u16,
    /// Who sent it.
    pub source: Id,
    /// The destination.
    pub destination: Id,
    /// Message type.
    pub message_type: u16,
    /// The properties word.
    pub properties: u16,
    /// Presence vector and fields.
    pub data: Vec<u8>,
    /// Header, data and checksum.
    pub bytes: Vec<u8>,
    /// The wrapper, where it is that of Edition 2.5. Source and destination are fields then, and there are no properties.
    pub wrapped: Option<Wrapped>,
}

impl Piece {
    /// An empty message of this type.
    #[must_use]
    pub fn empty(message_type: u16) -> Self {
        Self {
            reserved: 0,
            length: 0,
            source: Id::NULL,
            destination: Id::NULL,
            message_type,
            properties: 0,
            data: Vec::new(),
            bytes: Vec::new(),
            wrapped: None,
        }
    }

    /// Source and destination of a message of Edition 2.5 that goes both ways: its fields do not show who sent it.
    #[must_use]
    pub fn sent_by_cucs(mut self, by_cucs: bool) -> Self {
        let info = self.wrapped.as_ref().and_then(ed25::info);
        if by_cucs && info.is_some_and(|info| info.direction == table::Direction::Both) {
            std::mem::swap(&mut self.source, &mut self.destination);
        }
        self
    }

    /// Whether an acknowledgement is requested.
    #[must_use]
    pub fn ack(&self) -> bool {
        self.properties & 0x8000 != 0
    }

    /// The version of the interface.
    #[must_use]
    pub fn idd(&self) -> u8 {
        (self.properties >> 8 & 0x7F) as u8
    }

    /// The checksum's code, 0 to 3.
    #[must_use]
    pub fn style(&self) -> u8 {
        (self.properties >> 6 & 3) as u8
    }

    /// The checksum that the message carries, and the correct one.
    #[must_use]
    pub fn checksums(&self) -> (u64, u64) {
        if self.wrapped.is_some() {
            let (summed, sum) = self.bytes.split_at(self.bytes.len() - 4);
            return (number(sum), number(&checksum(2, summed)));
        }
        let (summed, sum) = self
            .bytes
            .split_at(self.bytes.len() - trailer(self.style()));
        (number(sum), number(&checksum(self.style(), summed)))
    }
}

/// Bytes of a checksum of this code.
#[must_use]
pub fn trailer(style: u8) -> usize {
    [0, 2, 4, 4][usize::from(style & 3)]
}

/// The checksum of this code over these bytes, as it goes on the wire.
#[must_use]
pub fn checksum(style: u8, bytes: &[u8]) -> Vec<u8> {
    let sum = bytes
        .iter()
        .fold(0_u32, |sum, &byte| sum.wrapping_add(byte.into()));
    match style & 3 {
        0 => Vec::new(),
        1 => (sum as u16).to_be_bytes().to_vec(),
        2 => sum.to_be_bytes().to_vec(),
        _ => crc32(bytes).to_be_bytes().to_vec(),
    }
}

/// CRC-32 as in ITU-T V.42, bit by bit: independent of the library that the VSM of this project uses.
fn crc32(bytes: &[u8]) -> u32 {
    !bytes.iter().fold(!0_u32, |crc, &byte| {
        (0..8).fold(crc ^ u32::from(byte), |crc, _| {
            crc >> 1 ^ if crc & 1 == 1 { 0xEDB8_8320 } else { 0 }
        })
    })
}

/// The messages of a datagram, and why the rest of it is not one.
#[must_use]
pub fn split(datagram: &[u8]) -> (Vec<Piece>, Option<String>) {
    if stanag_msgs::ed25::is_ed25(datagram) {
        let (parts, fault) = ed25::split(datagram);
        return (parts.into_iter().map(piece_25).collect(), fault);
    }
    let mut pieces = Vec::new();
    let mut rest = datagram;
    while !rest.is_empty() {
        let offset = datagram.len() - rest.len();
        if rest.len() < HEADER {
            let fault = format!(
                "{} bytes at offset {offset}, expected a header of {HEADER} bytes",
                rest.len()
            );
            return (pieces, Some(fault));
        }
        let word = |at: usize| number(&rest[at..at + 2]) as u16;
        let id = |at: usize| Id(number(&rest[at..at + 4]) as u32);
        let (length, properties) = (word(2), word(14));
        let style = (properties >> 6 & 3) as u8;
        let end = HEADER + usize::from(length) + trailer(style);
        if rest.len() < end {
            let fault = format!(
                "message at offset {offset} says {length} bytes of data and checksum style {style}, \
                 which is {end} bytes with its header; the datagram has {} left",
                rest.len()
            );
            return (pieces, Some(fault));
        }
        pieces.push(Piece {
            reserved: word(0),
            length,
            source: id(4),
            destination: id(8),
            message_type: word(12),
            properties,
            data: rest[HEADER..HEADER + usize::from(length)].to_vec(),
            bytes: rest[..end].to_vec(),
            wrapped: None,
        });
        rest = &rest[end..];
    }
    (pieces, None)
}

fn piece_25((wrapped, data, bytes): ed25::Part) -> Piece {
    let (source, destination) = ed25::ends(ed25::info(&wrapped), &data);
    Piece {
        reserved: 0,
        length: u16::try_from(data.len()).unwrap_or(u16::MAX),
        source,
        destination,
        message_type: u16::try_from(wrapped.message_type).unwrap_or(u16::MAX),
        properties: 0,
        data,
        bytes,
        wrapped: Some(wrapped),
    }
}

/// Who sent a datagram, seen from the suite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// The suite; in a recording, the CUCS.
    Sent,
    /// The subject; in a recording, the VSM.
    Received,
}

/// A message of a datagram with its fields.
#[derive(Clone, Debug)]
pub struct Seen {
    /// Time since the run began.
    pub at: Duration,
    /// Milliseconds since 2000 by the clock of the suite, when it was sent or received.
    pub wall_ms: u64,
    /// Sent or received.
    pub direction: Direction,
    /// Which of the suite's sockets.
    pub socket: usize,
    /// Header and data.
    pub piece: Piece,
    /// The row of the table, where it has one.
    pub info: Option<&'static MessageInfo>,
    /// The fields, or why the data are not those of the message.
    pub fields: Result<BTreeMap<&'static str, Vec<u8>>, DecodeError>,
    /// What was on the wire, where this is its counterpart in Edition 4.
    pub original: Option<Arc<Seen>>,
}

impl Seen {
    /// A message with its fields.
    #[must_use]
    pub fn new(
        at: Duration,
        wall_ms: u64,
        direction: Direction,
        socket: usize,
        piece: Piece,
    ) -> Self {
        let info = match &piece.wrapped {
            Some(wrapped) => ed25::info(wrapped),
            None => table::message(piece.message_type),
        };
        let fields = match info {
            Some(info) => table::walk(info, &piece.data)
                .map(|step| step.map(|(field, bytes)| (field.name, bytes.to_vec())))
                .collect(),
            None => Err(DecodeError::UnknownMessage {
                message_type: piece.message_type.into(),
            }),
        };
        Self {
            at,
            wall_ms,
            direction,
            socket,
            piece,
            info,
            fields,
            original: None,
        }
    }

    /// Message type.
    #[must_use]
    pub fn kind(&self) -> u16 {
        self.piece.message_type
    }

    /// The row of a field. A field that Edition 2.5 lacks is noted, since a rule may find it absent for that reason
    /// alone.
    fn field(&self, name: &str) -> Option<&'static FieldInfo> {
        let info = field_of(self.info?, name);
        if self.original.is_some() && !dialect::places::has_field(self.kind(), name) {
            dialect::looked_at(self.kind(), name);
        }
        Some(info)
    }

    /// Whether this field is present.
    #[must_use]
    pub fn has(&self, field: &str) -> bool {
        self.raw(field).is_some() || self.text(field).is_some()
    }

    /// The integer of a field as on the wire.
    #[must_use]
    pub fn raw(&self, field: &str) -> Option<i64> {
        let info = self.field(field)?;
        let bytes = self.fields.as_ref().ok()?.get(field)?;
        let (low, high) = info.wire.integers()?;
        let value = bytes
            .iter()
            .fold(0_i64, |value, &byte| value << 8 | i64::from(byte));
        Some(if low < 0 && value > high {
            value - 2 * (high + 1)
        } else {
            value
        })
    }

    /// The value of a field in the unit of the table.
    #[must_use]
    pub fn value(&self, field: &str) -> Option<f64> {
        let info = self.field(field)?;
        let bytes = self.fields.as_ref().ok()?.get(field)?;
        match info.wire {
            Wire::F32 => Some(f32::from_be_bytes(bytes[..].try_into().ok()?).into()),
            Wire::F64 => Some(f64::from_be_bytes(bytes[..].try_into().ok()?)),
            _ => Some(self.raw(field)? as f64 * info.step()),
        }
    }

    /// A text, up to its NUL.
    #[must_use]
    pub fn text(&self, field: &str) -> Option<String> {
        let info = self.field(field)?;
        let bytes = self.fields.as_ref().ok()?.get(field)?;
        matches!(info.wire, Wire::Char(_)).then(|| {
            let text = bytes.iter().take_while(|&&byte| byte != 0);
            text.map(|&byte| char::from(byte)).collect()
        })
    }

    /// The time stamp, ms since 2000.
    #[must_use]
    pub fn stamp(&self) -> Option<i64> {
        self.raw("Time Stamp")
    }

    /// Whether the checksum of what was on the wire is right.
    #[must_use]
    pub fn sound(&self) -> bool {
        let (value, expected) = self.original.as_deref().unwrap_or(self).piece.checksums();
        value == expected
    }

    /// For evidence: everything about it, enumerations by name.
    #[must_use]
    pub fn evidence(&self) -> Value {
        if let Some(original) = &self.original {
            return original.evidence();
        }
        let fields: Map<String, Value> = self
            .info
            .and_then(|info| stanag_msgs::json::fields(info, &self.piece.data, false).ok())
            .unwrap_or_default();
        let mut value = json!({
            "time": (self.at.as_secs_f64() * 1e6).round() / 1e6,
            "direction": match self.direction { Direction::Sent => "sent", Direction::Received => "received" },
            "source": self.piece.source.to_string(),
            "destination": self.piece.destination.to_string(),
            "id": self.piece.message_type,
            "name": self.info.map_or("unknown message", |info| info.name),
            "fields": fields,
            "hex": hex(&self.piece.bytes),
        });
        if let Err(error) = &self.fields {
            value["error"] = error.to_string().into();
        }
        value
    }
}

/// Bytes in hexadecimal.
#[must_use]
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn field_of(info: &'static MessageInfo, name: &str) -> &'static FieldInfo {
    info.field(name).unwrap_or_else(|| {
        panic!(
            "message {} has no field {name:?}: the rule is wrong",
            info.id
        )
    })
}

/// A message being made. Fields are set by name, in SI units or raw; the header can be made wrong on purpose.
#[derive(Clone, Debug)]
pub struct Draft {
    /// Message type.
    pub message_type: u16,
    /// Fields by their bit.
    fields: BTreeMap<u8, Vec<u8>>,
    /// Values before they were rounded to the step of Edition 4: Edition 2.5 has floats.
    exact: BTreeMap<u8, f64>,
    /// Whether an acknowledgement is requested.
    pub ack: bool,
    /// Source, in place of the station's id.
    pub source: Option<Id>,
    /// Destination, in place of the vehicle.
    pub destination: Option<Id>,
    /// Version of the interface, in place of the profile's.
    pub idd: Option<u8>,
    /// Checksum style, in place of the profile's.
    pub style: Option<u8>,
    /// The first word, in place of the edition's.
    pub reserved: Option<u16>,
    /// Message Length, in place of the right one.
    pub length: Option<u16>,
    /// Data, in place of vector and fields.
    pub data: Option<Vec<u8>>,
    /// Property bits that are set besides.
    pub property_bits: u16,
}

impl Draft {
    /// A message of this type without any field.
    #[must_use]
    pub fn new(message_type: u16) -> Self {
        Self {
            message_type,
            fields: BTreeMap::new(),
            exact: BTreeMap::new(),
            ack: false,
            source: None,
            destination: None,
            idd: None,
            style: None,
            reserved: None,
            length: None,
            data: None,
            property_bits: 0,
        }
    }

    fn info(&self) -> &'static MessageInfo {
        table::message(self.message_type).unwrap_or_else(|| {
            panic!(
                "the table has no message {}: the rule is wrong",
                self.message_type
            )
        })
    }

    /// Sets a field to a value in the unit of the table.
    #[must_use]
    pub fn set(self, field: &str, value: impl Into<f64>) -> Self {
        let value = value.into();
        let info = field_of(self.info(), field);
        let mut draft = match info.wire {
            Wire::F32 => self.bytes(info, (value as f32).to_be_bytes().to_vec()),
            Wire::F64 => self.bytes(info, value.to_be_bytes().to_vec()),
            _ => self.raw(field, (value / info.step()).round() as i64),
        };
        draft.exact.insert(info.bit, value);
        draft
    }

    /// Sets a field to an integer as on the wire.
    #[must_use]
    pub fn raw(self, field: &str, value: i64) -> Self {
        let info = field_of(self.info(), field);
        let width = info.wire.bytes().unwrap_or_default().min(8);
        self.bytes(info, value.to_be_bytes()[8 - width..].to_vec())
    }

    /// What a field was set to, where that was a number in its unit.
    fn exact(&self, field: &FieldInfo) -> Option<f64> {
        self.exact.get(&field.bit).copied()
    }

    /// The bytes of a field.
    fn field_bytes(&self, field: &FieldInfo) -> Option<&[u8]> {
        self.fields.get(&field.bit).map(Vec::as_slice)
    }

    /// The draft as a message of Edition 4.
    #[must_use]
    pub fn seen(&self) -> Seen {
        let piece = Piece {
            data: self.data(),
            ..Piece::empty(self.message_type)
        };
        Seen::new(Duration::ZERO, 0, Direction::Sent, 0, piece)
    }

    /// Sets an id.
    #[must_use]
    pub fn id(self, field: &str, id: Id) -> Self {
        self.raw(field, i64::from(id.0))
    }

    /// Sets a text, filled up with NUL.
    #[must_use]
    pub fn text(self, field: &str, text: &[u8]) -> Self {
        let info = field_of(self.info(), field);
        let mut bytes = text.to_vec();
        bytes.resize(info.wire.bytes().unwrap_or_default(), 0);
        self.bytes(info, bytes)
    }

    fn bytes(mut self, info: &FieldInfo, bytes: Vec<u8>) -> Self {
        self.exact.remove(&info.bit);
        self.fields.insert(info.bit, bytes);
        self
    }

    /// Leaves a field out.
    #[must_use]
    pub fn without(mut self, field: &str) -> Self {
        self.exact.remove(&field_of(self.info(), field).bit);
        self.fields.remove(&field_of(self.info(), field).bit);
        self
    }

    /// Whether a field is set.
    #[must_use]
    pub fn has(&self, field: &str) -> bool {
        self.fields.contains_key(&field_of(self.info(), field).bit)
    }

    /// The time stamp in milliseconds since 2000, where it has one.
    #[must_use]
    pub fn stamp(&self) -> Option<i64> {
        let known = self.data.is_none() && self.info().field("Time Stamp").is_some();
        known.then(|| self.seen().stamp())?
    }

    /// Requests an acknowledgement.
    #[must_use]
    pub fn acked(mut self) -> Self {
        self.ack = true;
        self
    }

    /// Sends to this id in place of the vehicle.
    #[must_use]
    pub fn to(mut self, destination: Id) -> Self {
        self.destination = Some(destination);
        self
    }

    /// Sends from this id in place of the station's.
    #[must_use]
    pub fn from(mut self, source: Id) -> Self {
        self.source = Some(source);
        self
    }

    /// The data: vector and fields.
    #[must_use]
    pub fn data(&self) -> Vec<u8> {
        if let Some(data) = &self.data {
            return data.clone();
        }
        let presence = self.fields.keys().fold(0_u64, |bits, &bit| bits | 1 << bit);
        let width = usize::from(self.info().presence_bytes);
        let mut data = presence.to_be_bytes()[8 - width..].to_vec();
        data.extend(self.fields.values().flatten());
        data
    }

    /// The whole message; `source`, `destination`, `idd` and `style` count where the draft sets none.
    #[must_use]
    pub fn encode(&self, source: Id, destination: Id, idd: u8, style: u8) -> Vec<u8> {
        let data = self.data();
        let idd = self.idd.unwrap_or(idd);
        let style = self.style.unwrap_or(style);
        let reserved = self.reserved.unwrap_or(if idd == 30 { 0xFFFF } else { 0 });
        let length = self.length.unwrap_or(data.len() as u16);
        let ack = if self.ack { 0x8000 } else { 0 };
        let properties =
            ack | u16::from(idd & 0x7F) << 8 | u16::from(style) << 6 | self.property_bits;
        let mut out = Vec::with_capacity(HEADER + data.len() + 4);
        out.extend(reserved.to_be_bytes());
        out.extend(length.to_be_bytes());
        out.extend(self.source.unwrap_or(source).0.to_be_bytes());
        out.extend(self.destination.unwrap_or(destination).0.to_be_bytes());
        out.extend(self.message_type.to_be_bytes());
        out.extend(properties.to_be_bytes());
        out.extend(data);
        let sum = checksum(style, &out);
        out.extend(sum);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(bytes: &[u8]) -> Seen {
        let (mut pieces, fault) = split(bytes);
        assert_eq!(fault, None);
        Seen::new(Duration::ZERO, 0, Direction::Sent, 0, pieces.remove(0))
    }

    #[test]
    fn what_is_set_is_seen() {
        let draft = Draft::new(13002)
            .raw("Time Stamp", 5)
            .set("Waypoint to Altitude", -500.0)
            .set("Waypoint to Latitude or Relative Y", -0.5);
        let message = seen(&draft.encode(Id(1), Id(2), 32, 2));
        assert_eq!(message.raw("Waypoint to Altitude"), Some(-25_000));
        assert!((message.value("Waypoint to Latitude or Relative Y").unwrap() + 0.5).abs() < 1e-9);
        assert!(!message.has("Waypoint Number"));
        let (found, expected) = message.piece.checksums();
        assert_eq!(found, expected);
    }

    #[test]
    fn the_strict_codec_reads_the_same_bytes() {
        for style in 0..4 {
            let draft = Draft::new(3001).raw("Select Flight Path Control Mode", 12);
            let bytes = draft
                .acked()
                .encode(Id(0x1b00_0101), Id::BROADCAST, 32, style);
            let frame = stanag_msgs::frames(&bytes).next().unwrap().unwrap();
            assert_eq!(frame.header.message_type, 3001);
            assert!(frame.header.ack_requested);
        }
    }

    #[test]
    fn a_length_beyond_the_datagram_is_named() {
        let mut draft = Draft::new(3001).raw("Select Flight Path Control Mode", 12);
        draft.length = Some(60);
        let (pieces, fault) = split(&draft.encode(Id(1), Id(2), 32, 0));
        assert!(pieces.is_empty());
        assert!(fault.unwrap().contains("says 60 bytes"));
    }
}
