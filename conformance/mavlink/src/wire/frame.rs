//! Frames as they were received: split from a datagram, checked, verified, and their fields by name.

use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};

use super::crc;
use super::table::{self, Field, Kind};

/// Start of a MAVLink 2 frame.
pub const MAGIC: u8 = 0xFD;
/// Start of a MAVLink 1 frame.
pub const MAGIC_V1: u8 = 0xFE;
/// Incompatibility flag of a signed frame.
pub const SIGNED: u8 = 0x01;
/// Header of MAVLink 2.
pub const HEADER: usize = 10;

/// A signing key. Its `Debug` shows nothing.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Key(pub [u8; 32]);

impl std::fmt::Debug for Key {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Key(..)")
    }
}

/// The trailer of a signed frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signature {
    /// Link id.
    pub link: u8,
    /// Timestamp, in units of 10 us since 2015.
    pub stamp: u64,
    /// The first six bytes of the hash.
    pub hash: [u8; 6],
}

/// A frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// 1 or 2.
    pub version: u8,
    /// Incompatibility flags.
    pub incompat: u8,
    /// Compatibility flags.
    pub compat: u8,
    /// Sequence number.
    pub seq: u8,
    /// Sending system.
    pub system: u8,
    /// Sending component.
    pub component: u8,
    /// Message id.
    pub id: u32,
    /// Payload, truncated as it came.
    pub payload: Vec<u8>,
    /// Whether the checksum holds; `None` for a message that the suite does not know.
    pub crc_holds: Option<bool>,
    /// The trailer.
    pub signature: Option<Signature>,
    /// All bytes.
    pub bytes: Vec<u8>,
}

/// Splits a datagram into frames; also returns the number of bytes that belong to none.
#[must_use]
pub fn split(mut bytes: &[u8]) -> (Vec<Frame>, usize) {
    let (mut frames, mut skipped) = (Vec::new(), 0);
    while !bytes.is_empty() {
        match Frame::read(bytes) {
            Some(frame) => {
                bytes = &bytes[frame.bytes.len()..];
                frames.push(frame);
            }
            None => {
                bytes = &bytes[1..];
                skipped += 1;
            }
        }
    }
    (frames, skipped)
}

/// The first six bytes of SHA-256 over key, frame and the first seven bytes of the trailer.
#[must_use]
pub fn signature_hash(key: &Key, unsigned: &[u8], link: u8, stamp: u64) -> [u8; 6] {
    let digest = Sha256::new()
        .chain_update(key.0)
        .chain_update(unsigned)
        .chain_update([link])
        .chain_update(&stamp.to_le_bytes()[..6])
        .finalize();
    std::array::from_fn(|index| digest[index])
}

impl Frame {
    fn read(bytes: &[u8]) -> Option<Self> {
        match *bytes.first()? {
            MAGIC => Self::read_v2(bytes),
            MAGIC_V1 => Self::read_v1(bytes),
            _ => None,
        }
    }

    fn read_v2(bytes: &[u8]) -> Option<Self> {
        let header: &[u8; HEADER] = bytes.first_chunk()?;
        let [
            _,
            length,
            incompat,
            compat,
            seq,
            system,
            component,
            id0,
            id1,
            id2,
        ] = *header;
        let unsigned = HEADER + usize::from(length) + 2;
        let signed = incompat & SIGNED != 0;
        let all = bytes.get(..unsigned + if signed { 13 } else { 0 })?;
        let id = u32::from_le_bytes([id0, id1, id2, 0]);
        let signature = signed.then(|| {
            // Link id, 6 bytes of timestamp, 6 bytes of hash.
            let trailer = &all[unsigned..];
            let mut stamp = [0; 8];
            stamp[..6].copy_from_slice(&trailer[1..7]);
            let mut hash = [0; 6];
            hash.copy_from_slice(&trailer[7..]);
            Signature {
                link: trailer[0],
                stamp: u64::from_le_bytes(stamp),
                hash,
            }
        });
        let crc_holds = table::by_id(id).map(|message| {
            // The checksum covers everything but the magic byte, then CRC_EXTRA, by which sender and receiver agree
            // on the message's definition.
            let expected = crc(all[1..unsigned - 2]
                .iter()
                .copied()
                .chain([message.crc_extra]));
            all[unsigned - 2..unsigned] == expected.to_le_bytes()
        });
        Some(Self {
            version: 2,
            incompat,
            compat,
            seq,
            system,
            component,
            id,
            payload: all[HEADER..unsigned - 2].to_vec(),
            crc_holds,
            signature,
            bytes: all.to_vec(),
        })
    }

    fn read_v1(bytes: &[u8]) -> Option<Self> {
        let header: &[u8; 6] = bytes.first_chunk()?;
        let [_, length, seq, system, component, id] = *header;
        let end = 8 + usize::from(length);
        let all = bytes.get(..end)?;
        let message = table::by_id(id.into())?;
        let expected = crc(all[1..end - 2].iter().copied().chain([message.crc_extra]));
        Some(Self {
            version: 1,
            incompat: 0,
            compat: 0,
            seq,
            system,
            component,
            id: id.into(),
            payload: all[6..end - 2].to_vec(),
            crc_holds: Some(all[end - 2..] == expected.to_le_bytes()),
            signature: None,
            bytes: all.to_vec(),
        })
    }

    /// Whether the signature is this key's; `None` where there is none.
    #[must_use]
    pub fn verifies(&self, key: &Key) -> Option<bool> {
        let signature = self.signature?;
        let unsigned = &self.bytes[..self.bytes.len() - 13];
        Some(signature_hash(key, unsigned, signature.link, signature.stamp) == signature.hash)
    }

    /// The message's name, or its number.
    #[must_use]
    pub fn name(&self) -> String {
        table::by_id(self.id).map_or_else(
            || format!("message {}", self.id),
            |message| message.name.to_owned(),
        )
    }

    /// Whether it is this message.
    #[must_use]
    pub fn is(&self, name: &str) -> bool {
        table::by_id(self.id).is_some_and(|message| message.name == name)
    }

    fn element(&self, field: &Field, index: usize) -> [u8; 8] {
        // Bytes that were truncated are zero.
        let start = field.offset + index * field.size;
        std::array::from_fn(|byte| {
            if byte < field.size {
                self.payload.get(start + byte).copied().unwrap_or_default()
            } else {
                0
            }
        })
    }

    fn of(&self, field: &Field, index: usize) -> Value {
        let raw = self.element(field, index);
        let bits = u64::from_le_bytes(raw);
        match (field.kind, field.size) {
            (Kind::Float, 4) => json!(f32::from_bits(bits as u32)),
            (Kind::Float, _) => json!(f64::from_bits(bits)),
            (Kind::Signed, size) => {
                let shift = 64 - 8 * size;
                json!((bits << shift) as i64 >> shift)
            }
            _ => json!(bits),
        }
    }

    /// An integer field; 0 where the message has no field of this name.
    #[must_use]
    pub fn int(&self, name: &str) -> i64 {
        let field = table::by_id(self.id).and_then(|message| message.field(name));
        field.map_or(0, |field| {
            let value = self.of(field, 0);
            value
                .as_i64()
                .or(value.as_u64().map(|value| value as i64))
                .unwrap_or_default()
        })
    }

    /// A floating point field.
    #[must_use]
    pub fn float(&self, name: &str) -> f32 {
        let field = table::by_id(self.id).and_then(|message| message.field(name));
        field.map_or(f32::NAN, |field| {
            f32::from_bits(u64::from_le_bytes(self.element(field, 0)) as u32)
        })
    }

    /// A text field, to its first zero.
    #[must_use]
    pub fn text(&self, name: &str) -> String {
        let field = table::by_id(self.id).and_then(|message| message.field(name));
        field.map_or_else(String::new, |field| {
            let bytes: Vec<u8> = (0..field.count)
                .map(|index| self.element(field, index)[0])
                .take_while(|byte| *byte != 0)
                .collect();
            String::from_utf8_lossy(&bytes).into_owned()
        })
    }

    /// The target system and component, where the message has them; 0 is all.
    #[must_use]
    pub fn target(&self) -> Option<(u8, u8)> {
        let message = table::by_id(self.id)?;
        message.field("target_system")?;
        Some((
            self.int("target_system") as u8,
            self.int("target_component") as u8,
        ))
    }

    /// Its fields, for a report. The key of SETUP_SIGNING is left out.
    #[must_use]
    pub fn fields(&self) -> Value {
        let mut fields = Map::new();
        for field in table::by_id(self.id).map_or(&[][..], |message| &message.fields) {
            let value = if field.name == "secret_key" {
                json!("not shown")
            } else if field.kind == Kind::Text {
                json!(self.text(field.name))
            } else if field.count == 1 {
                self.of(field, 0)
            } else {
                (0..field.count)
                    .map(|index| self.of(field, index))
                    .collect()
            };
            fields.insert(field.name.to_owned(), value);
        }
        if let Some(signature) = self.signature {
            fields.insert(
                "signed".into(),
                json!({ "link": signature.link, "stamp": signature.stamp }),
            );
        }
        Value::Object(fields)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// pymavlink 2.4.50: HEARTBEAT of system 1, component 1, key 01 to 20 (hex), link 0, timestamp 0x0123_4567_89AB.
    #[test]
    fn a_frame_of_pymavlink_verifies() {
        let frame = include_str!("../../vector.txt").trim();
        let bytes: Vec<u8> = (0..frame.len() / 2)
            .map(|at| u8::from_str_radix(&frame[2 * at..2 * at + 2], 16).expect("hexadecimal"))
            .collect();
        let key = Key(std::array::from_fn(|index| index as u8 + 1));
        let (frames, skipped) = split(&bytes);
        assert_eq!((frames.len(), skipped), (1, 0));
        assert_eq!(frames[0].crc_holds, Some(true));
        assert_eq!(frames[0].verifies(&key), Some(true));
        assert_eq!(frames[0].verifies(&Key([0; 32])), Some(false));
        assert_eq!(
            frames[0].signature.map(|signature| signature.stamp),
            Some(0x0123_4567_89AB)
        );
        assert_eq!(frames[0].int("custom_mode"), 0x0404_0000);
    }

    #[test]
    fn garbage_around_a_frame_is_counted() {
        let frame = crate::wire::Draft::new("HEARTBEAT").craft(1, 1).bytes();
        let bytes = [&[0xFD, 3][..], &frame, &[7]].concat();
        let (frames, skipped) = split(&bytes);
        // 0xFD 3 begins something that reads as a frame; whether its checksum holds is for the judge.
        assert!(frames.len() + skipped > 0);
    }
}
