//! Why message data cannot be read or written: which message, which field, where, and what was expected.
//!
//! An error carries the row of the field in the table, so that its text can name the field although this module is
//! below the table.

use crate::field::FieldInfo;

/// Why bytes are not the data of a message.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum DecodeError {
    /// The table has no such message.
    #[error("unknown message type {message_type}")]
    UnknownMessage {
        /// The Message Type of the wrapper, which has four bytes in Edition 2.5.
        message_type: u32,
    },
    /// The data ends within the presence vector.
    #[error("message {message_type}: {found} bytes, expected a presence vector of {expected}")]
    NoPresence {
        /// The Message Type.
        message_type: u16,
        /// Bytes received.
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
            describe(field), field.wire.bytes().unwrap_or_default())]
    Truncated {
        /// The Message Type.
        message_type: u16,
        /// The field.
        field: &'static FieldInfo,
        /// Where the field starts, in bytes of message data.
        offset: usize,
        /// Bytes left there.
        found: usize,
    },
    /// A field is present whose length no source gives.
    #[error(
        "message {message_type} field {} at offset {offset}: its length is not known",
        describe(field)
    )]
    UnknownLength {
        /// The Message Type.
        message_type: u16,
        /// The field.
        field: &'static FieldInfo,
        /// Where the field starts, in bytes of message data.
        offset: usize,
    },
    /// Bytes are left over after the last present field.
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
    /// Where it is, in bytes of message data.
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

    /// The name of the reason, for a counter.
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
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum EncodeError {
    /// The caller's buffer is too small.
    #[error("the buffer of {available} bytes is too small")]
    BufferTooSmall {
        /// Bytes that the buffer has.
        available: usize,
    },
    /// A field is set whose length no source gives.
    #[error(
        "message {message_type} field {}: its length is not known",
        describe(field)
    )]
    UnknownLength {
        /// The Message Type.
        message_type: u16,
        /// The field.
        field: &'static FieldInfo,
    },
    /// The data is longer than fits a datagram.
    #[error("message {message_type}: {found} bytes of data, expected at most {expected}")]
    TooLong {
        /// The Message Type.
        message_type: u16,
        /// Bytes of data.
        found: usize,
        /// The maximum.
        expected: usize,
    },
    /// The wrapper is not defined for this interface version.
    #[error("IDD version {idd}, expected 30 to 32")]
    Idd {
        /// The version requested.
        idd: u8,
    },
    /// Edition 3 has no CRC-32.
    #[error("IDD version {idd} has no CRC-32 checksum, expected style 0 to 2")]
    ChecksumStyle {
        /// The version requested.
        idd: u8,
    },
}

/// A field's number (counted from 1, as the standard does) and name.
fn describe(field: &FieldInfo) -> String {
    format!("{} ({})", field.bit + 1, field.name)
}
