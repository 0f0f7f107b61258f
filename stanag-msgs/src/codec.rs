//! Reading and writing message data: the presence vector, then the present fields in order.
//!
//! Decoding is strict and total: any bytes give a value or a [`DecodeError`], never a panic.
//! Bytes left over and presence bits that no field has are errors, since both mean that sender
//! and receiver do not speak of the same layout.

use crate::scalar::Field;
use crate::table;

/// What a field alone can say is wrong; the message adds where.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fault {
    /// The bytes, or the space for them, end before the field does.
    Short,
    /// No source gives the field's length.
    UnknownLength,
}

/// Why bytes are not the data of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// The table has no such message.
    #[error("unknown message type {message_type}")]
    UnknownMessage {
        /// The Message Type of the wrapper.
        message_type: u16,
    },
    /// The data ends within the presence vector.
    #[error("message {message_type}: {found} bytes, expected a presence vector of {expected}")]
    NoPresence {
        /// The Message Type.
        message_type: u16,
        /// Bytes there are.
        found: usize,
        /// Bytes of the presence vector.
        expected: usize,
    },
    /// Presence bits are set that no field has.
    #[error("message {message_type}: presence vector {presence:#x} has bits beyond {known:#x}")]
    UnknownPresence {
        /// The Message Type.
        message_type: u16,
        /// The presence vector received.
        presence: u64,
        /// The bits that fields have.
        known: u64,
    },
    /// The data ends within a field.
    #[error("message {message_type} field {} at offset {offset}: {found} bytes, expected {}",
            describe(*message_type, *bit), bytes(*message_type, *bit))]
    Truncated {
        /// The Message Type.
        message_type: u16,
        /// The field's presence bit.
        bit: u8,
        /// Where the field starts, in bytes of message data.
        offset: usize,
        /// Bytes that are left there.
        found: usize,
    },
    /// A field is present whose length no source gives.
    #[error("message {message_type} field {} at offset {offset}: its length is not known",
            describe(*message_type, *bit))]
    UnknownLength {
        /// The Message Type.
        message_type: u16,
        /// The field's presence bit.
        bit: u8,
        /// Where the field starts, in bytes of message data.
        offset: usize,
    },
    /// Bytes are left over behind the last present field.
    #[error("message {message_type}: {found} bytes left over at offset {offset}, expected none")]
    Trailing {
        /// The Message Type.
        message_type: u16,
        /// Where the fields end, in bytes of message data.
        offset: usize,
        /// How many bytes are left over.
        found: usize,
    },
}

impl DecodeError {
    /// Where in the message data.
    pub const fn offset(&self) -> usize {
        match *self {
            Self::UnknownMessage { .. }
            | Self::NoPresence { .. }
            | Self::UnknownPresence { .. } => 0,
            Self::Truncated { offset, .. }
            | Self::UnknownLength { offset, .. }
            | Self::Trailing { offset, .. } => offset,
        }
    }

    /// A word for a counter of such errors.
    pub const fn reason(&self) -> &'static str {
        match self {
            Self::UnknownMessage { .. } => "unknown_message",
            Self::NoPresence { .. } | Self::Truncated { .. } => "short_data",
            Self::UnknownPresence { .. } => "unknown_field",
            Self::UnknownLength { .. } => "unknown_length",
            Self::Trailing { .. } => "left_over",
        }
    }
}

/// Why a message cannot be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EncodeError {
    /// The caller's buffer is too small.
    #[error("the buffer of {available} bytes is too small")]
    BufferTooSmall {
        /// Bytes that the buffer has.
        available: usize,
    },
    /// A field is set whose length no source gives.
    #[error("message {message_type} field {}: its length is not known", describe(*message_type, *bit))]
    UnknownLength {
        /// The Message Type.
        message_type: u16,
        /// The field's presence bit.
        bit: u8,
    },
    /// The data is longer than a datagram takes.
    #[error("message {message_type}: {found} bytes of data, expected at most {expected}")]
    TooLong {
        /// The Message Type.
        message_type: u16,
        /// Bytes of data.
        found: usize,
        /// The most there may be.
        expected: usize,
    },
    /// The interface version is none that this wrapper is for.
    #[error("IDD version {idd}, expected 30 to 32")]
    Idd {
        /// The version asked for.
        idd: u8,
    },
    /// Edition 3 has no CRC-32.
    #[error("IDD version {idd} has no CRC-32 checksum, expected style 0 to 2")]
    ChecksumStyle {
        /// The version asked for.
        idd: u8,
    },
}

/// Bytes not read yet.
#[derive(Debug)]
pub struct Reader<'a> {
    rest: &'a [u8],
}

impl<'a> Reader<'a> {
    /// A reader at the start of `bytes`.
    #[inline]
    pub fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    /// Takes the next `N` bytes.
    #[inline]
    pub fn chunk<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        let (chunk, rest) = self.rest.split_first_chunk().ok_or(Fault::Short)?;
        self.rest = rest;
        Ok(*chunk)
    }
}

/// The data of one message being read; what the table's macro is built on.
#[derive(Debug)]
pub(crate) struct DataReader<'a> {
    message_type: u16,
    bytes: usize,
    presence: u64,
    reader: Reader<'a>,
}

impl<'a> DataReader<'a> {
    /// Reads the presence vector of `N` bytes, of which only the bits of `known` may be set.
    #[inline]
    pub(crate) fn new<const N: usize>(
        message_type: u16,
        known: u64,
        data: &'a [u8],
    ) -> Result<Self, DecodeError> {
        let mut reader = Reader::new(data);
        let Ok(vector) = reader.chunk::<N>() else {
            return Err(DecodeError::NoPresence {
                message_type,
                found: data.len(),
                expected: N,
            });
        };
        let presence = vector
            .iter()
            .fold(0, |bits, &byte| bits << 8 | u64::from(byte));
        if presence & !known != 0 {
            return Err(DecodeError::UnknownPresence {
                message_type,
                presence,
                known,
            });
        }
        Ok(Self {
            message_type,
            bytes: data.len(),
            presence,
            reader,
        })
    }

    /// Reads the field of this presence bit, where it is present.
    #[inline(always)]
    pub(crate) fn field<T: Field>(&mut self, bit: u8) -> Result<Option<T>, DecodeError> {
        if self.presence >> bit & 1 == 0 {
            return Ok(None);
        }
        match T::read(&mut self.reader) {
            Ok(value) => Ok(Some(value)),
            Err(fault) => Err(self.error(bit, fault)),
        }
    }

    /// Makes sure that nothing is left.
    #[inline]
    pub(crate) fn finish(self) -> Result<(), DecodeError> {
        match self.reader.rest.len() {
            0 => Ok(()),
            found => Err(DecodeError::Trailing {
                message_type: self.message_type,
                offset: self.bytes - found,
                found,
            }),
        }
    }

    #[cold]
    fn error(&self, bit: u8, fault: Fault) -> DecodeError {
        let (message_type, found) = (self.message_type, self.reader.rest.len());
        let offset = self.bytes - found;
        match fault {
            Fault::Short => DecodeError::Truncated {
                message_type,
                bit,
                offset,
                found,
            },
            Fault::UnknownLength => DecodeError::UnknownLength {
                message_type,
                bit,
                offset,
            },
        }
    }
}

/// A buffer being filled.
#[derive(Debug)]
pub struct Writer<'a> {
    out: &'a mut [u8],
    at: usize,
}

impl<'a> Writer<'a> {
    /// A writer at the start of `out`.
    #[inline]
    pub fn new(out: &'a mut [u8]) -> Self {
        Self { out, at: 0 }
    }

    /// Appends `N` bytes.
    #[inline]
    pub fn put<const N: usize>(&mut self, bytes: [u8; N]) -> Result<(), Fault> {
        let end = self.at + N;
        self.out
            .get_mut(self.at..end)
            .ok_or(Fault::Short)?
            .copy_from_slice(&bytes);
        self.at = end;
        Ok(())
    }

    /// How many bytes are written.
    #[inline]
    pub fn position(&self) -> usize {
        self.at
    }
}

/// The data of one message being written; what the table's macro is built on.
#[derive(Debug)]
pub(crate) struct DataWriter<'a, const N: usize> {
    message_type: u16,
    presence: u64,
    writer: Writer<'a>,
}

impl<'a, const N: usize> DataWriter<'a, N> {
    /// Leaves room for a presence vector of `N` bytes.
    #[inline]
    pub(crate) fn new(message_type: u16, out: &'a mut [u8]) -> Result<Self, EncodeError> {
        let mut writer = Writer::new(out);
        match writer.put([0; N]) {
            Ok(()) => Ok(Self {
                message_type,
                presence: 0,
                writer,
            }),
            Err(_) => Err(EncodeError::BufferTooSmall {
                available: writer.out.len(),
            }),
        }
    }

    /// Writes the field of this presence bit, where it is set.
    #[inline(always)]
    pub(crate) fn field<T: Field>(&mut self, bit: u8, value: Option<T>) -> Result<(), EncodeError> {
        let Some(value) = value else { return Ok(()) };
        self.presence |= 1 << bit;
        value
            .write(&mut self.writer)
            .map_err(|fault| self.error(bit, fault))
    }

    /// Writes the presence vector, and says how many bytes there are in all.
    #[inline]
    pub(crate) fn finish(self) -> usize {
        let bits = self.presence.to_be_bytes();
        self.writer.out[..N].copy_from_slice(&bits[bits.len() - N..]);
        self.writer.at
    }

    #[cold]
    fn error(&self, bit: u8, fault: Fault) -> EncodeError {
        match fault {
            Fault::Short => EncodeError::BufferTooSmall {
                available: self.writer.out.len(),
            },
            Fault::UnknownLength => EncodeError::UnknownLength {
                message_type: self.message_type,
                bit,
            },
        }
    }
}

/// A field's number (counted from 1, as the standard does) and name.
fn describe(message_type: u16, bit: u8) -> String {
    let name = table::message(message_type)
        .and_then(|message| message.fields.get(usize::from(bit)))
        .map_or("", |field| field.name);
    format!("{} ({name})", bit + 1)
}

fn bytes(message_type: u16, bit: u8) -> usize {
    table::message(message_type)
        .and_then(|message| message.fields.get(usize::from(bit)))
        .and_then(|field| field.wire.bytes())
        .unwrap_or_default()
}
