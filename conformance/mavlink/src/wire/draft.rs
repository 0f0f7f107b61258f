//! Frames that the suite sends: right ones, and each way of breaking one.

use super::crc;
use super::frame::{HEADER, Key, MAGIC, SIGNED, signature_hash};
use super::table::{self, Kind, Message};

/// A message with its fields, not framed yet. Fields that are not set are zero.
#[derive(Clone, Debug)]
pub struct Draft {
    message: &'static Message,
    payload: Vec<u8>,
}

impl Draft {
    /// An empty message.
    ///
    /// # Panics
    /// The table has no message of this name: a mistake in the suite, never in its input.
    #[must_use]
    pub fn new(name: &str) -> Self {
        let message = table::by_name(name).unwrap_or_else(|| panic!("no message {name}"));
        Self {
            message,
            payload: vec![0; message.length],
        }
    }

    fn place(&mut self, name: &str, index: usize, value: &[u8]) {
        let field = self
            .message
            .field(name)
            .unwrap_or_else(|| panic!("{} has no field {name}", self.message.name));
        let start = field.offset + index * field.size;
        self.payload[start..start + field.size].copy_from_slice(&value[..field.size]);
    }

    /// Sets an integer or, for a floating point field, its value.
    #[must_use]
    pub fn set(mut self, name: &str, value: impl Into<f64>) -> Self {
        let value = value.into();
        let kind = self
            .message
            .field(name)
            .map(|field| (field.kind, field.size));
        let bytes = match kind {
            Some((Kind::Float, 4)) => u64::from((value as f32).to_bits()),
            Some((Kind::Float, _)) => value.to_bits(),
            _ if value < 0.0 => value as i64 as u64,
            _ => value as u64,
        };
        self.place(name, 0, &bytes.to_le_bytes());
        self
    }

    /// Sets the bits of a field: 64-bit integers, and parameters of integer type.
    #[must_use]
    pub fn bits(mut self, name: &str, value: u64) -> Self {
        self.place(name, 0, &value.to_le_bytes());
        self
    }

    /// Sets a text, or an array of bytes.
    #[must_use]
    pub fn text(mut self, name: &str, value: impl AsRef<[u8]>) -> Self {
        for (index, byte) in value.as_ref().iter().enumerate() {
            self.place(name, index, &[*byte]);
        }
        self
    }

    /// Addresses it.
    #[must_use]
    pub fn to(self, (system, component): (u8, u8)) -> Self {
        self.set("target_system", system)
            .set("target_component", component)
    }

    /// Its name.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.message.name
    }

    /// A frame of it, unsigned, from this sender.
    #[must_use]
    pub fn craft(&self, system: u8, component: u8) -> Craft {
        let used = self
            .payload
            .iter()
            .rposition(|byte| *byte != 0)
            .map_or(1, |last| last + 1);
        Craft {
            id: self.message.id,
            crc_extra: self.message.crc_extra,
            payload: self.payload[..used].to_vec(),
            whole: self.payload.clone(),
            incompat: 0,
            compat: 0,
            seq: 0,
            system,
            component,
            key: None,
            link: 0,
            stamp: 0,
            crc_flip: 0,
            hash_flip: 0,
            signed_link: None,
        }
    }
}

/// A frame in the making.
#[derive(Clone, Debug)]
pub struct Craft {
    /// Message id.
    pub id: u32,
    /// Last byte under the checksum.
    pub crc_extra: u8,
    /// Payload, truncated.
    pub payload: Vec<u8>,
    whole: Vec<u8>,
    /// Incompatibility flags beside the one of signing.
    pub incompat: u8,
    /// Compatibility flags.
    pub compat: u8,
    /// Sequence number.
    pub seq: u8,
    /// Sending system.
    pub system: u8,
    /// Sending component.
    pub component: u8,
    /// Signs with it.
    pub key: Option<Key>,
    /// Link id.
    pub link: u8,
    /// Timestamp.
    pub stamp: u64,
    /// Bits of the checksum to flip, before the frame is signed.
    pub crc_flip: u16,
    /// Bits of the hash's first byte to flip.
    pub hash_flip: u8,
    /// Link id that is hashed, where it differs from the one that is sent.
    pub signed_link: Option<u8>,
}

impl Craft {
    /// Keeps the zeros at the end of the payload.
    #[must_use]
    pub fn untruncated(mut self) -> Self {
        self.payload.clone_from(&self.whole);
        self
    }

    /// The bytes of the frame.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        let incompat = self.incompat | if self.key.is_some() { SIGNED } else { 0 };
        let id = self.id.to_le_bytes();
        let mut bytes = Vec::with_capacity(HEADER + self.payload.len() + 15);
        bytes.extend([
            MAGIC,
            self.payload.len() as u8,
            incompat,
            self.compat,
            self.seq,
            self.system,
            self.component,
        ]);
        bytes.extend(&id[..3]);
        bytes.extend(&self.payload);
        let sum = crc(bytes[1..].iter().copied().chain([self.crc_extra]));
        bytes.extend((sum ^ self.crc_flip).to_le_bytes());
        if let Some(key) = &self.key {
            let mut hash = signature_hash(
                key,
                &bytes,
                self.signed_link.unwrap_or(self.link),
                self.stamp,
            );
            hash[0] ^= self.hash_flip;
            bytes.push(self.link);
            bytes.extend(&self.stamp.to_le_bytes()[..6]);
            bytes.extend(hash);
        }
        bytes
    }
}
