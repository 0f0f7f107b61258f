//! Reading and writing message data: the presence vector, then the present fields in order.
//!
//! Decoding is strict and total: any bytes give a value or a [`DecodeError`], never a panic. Bytes left over and
//! presence bits that no field has are errors, since both mean that sender and receiver use different layouts.
//!
//! There are two ways through the same bytes. [`messages!`] makes of each row a struct whose codec is straight-line
//! code: that is the hot path. [`walk`] goes by the table at run time, for code that treats all messages alike (JSON,
//! selecting fields). Both use [`DataReader`], so that they fail in the same places with the same errors.

use super::info::MessageInfo;
use crate::bytes::{Fault, Reader, Writer};
use crate::error::{DecodeError, EncodeError};
use crate::field::{Field, FieldInfo};

/// The data of one message being read.
#[derive(Clone, Debug)]
pub(super) struct DataReader<'a> {
    message: &'static MessageInfo,
    bytes: usize,
    presence: u64,
    reader: Reader<'a>,
}

impl<'a> DataReader<'a> {
    /// Reads the presence vector, in which only bits of the message's fields may be set.
    ///
    /// Always inlined: where the caller knows the message, its facts become constants and the loop disappears.
    #[inline(always)]
    pub(super) fn new(message: &'static MessageInfo, data: &'a [u8]) -> Result<Self, DecodeError> {
        let message_type = message.id;
        let expected = usize::from(message.presence_bytes);
        let mut reader = Reader::new(data);
        let Ok(vector) = reader.take(expected) else {
            return Err(DecodeError::NoPresence {
                message_type,
                found: data.len(),
                expected,
            });
        };
        let known = (1 << message.fields.len()) - 1;
        // Edition 2.5 has no vector: it sends every field.
        let presence = match expected {
            0 => known,
            _ => vector
                .iter()
                .fold(0, |bits, &byte| bits << 8 | u64::from(byte)),
        };
        // A bit beyond the fields means that the sender uses another layout.
        if presence & !known != 0 {
            return Err(DecodeError::UnknownPresence {
                message_type,
                presence,
                known,
            });
        }
        Ok(Self {
            message,
            bytes: data.len(),
            presence,
            reader,
        })
    }

    /// Reads the field of this presence bit, where it is present.
    #[inline(always)]
    pub(super) fn field<T: Field>(&mut self, bit: u8) -> Result<Option<T>, DecodeError> {
        if self.presence >> bit & 1 == 0 {
            return Ok(None);
        }
        match T::read(&mut self.reader) {
            Ok(value) => Ok(Some(value)),
            Err(fault) => Err(self.error(bit, fault)),
        }
    }

    /// Fails where bytes are left over.
    #[inline]
    pub(super) fn finish(&self) -> Result<(), DecodeError> {
        match self.reader.remaining() {
            0 => Ok(()),
            found => Err(DecodeError::Trailing {
                message_type: self.message.id,
                offset: self.bytes - found,
                found,
            }),
        }
    }

    /// The bytes of the next present field among `fields`; none where all were read.
    fn next(&mut self, fields: &mut std::slice::Iter<'static, FieldInfo>) -> Step<'a> {
        let Some(field) = fields.find(|field| self.presence >> field.bit & 1 == 1) else {
            return self.finish().map(|()| None);
        };
        let bytes = match field.wire.bytes() {
            Some(count) => self.reader.take(count),
            None => Err(Fault::UnknownLength),
        };
        match bytes {
            Ok(bytes) => Ok(Some((field, bytes))),
            Err(fault) => Err(self.error(field.bit, fault)),
        }
    }

    #[cold]
    fn error(&self, bit: u8, fault: Fault) -> DecodeError {
        let message_type = self.message.id;
        let field = &self.message.fields[usize::from(bit)];
        let found = self.reader.remaining();
        let offset = self.bytes - found;
        match fault {
            Fault::Short => DecodeError::Truncated {
                message_type,
                field,
                offset,
                found,
            },
            Fault::UnknownLength => DecodeError::UnknownLength {
                message_type,
                field,
                offset,
            },
        }
    }
}

type Step<'a> = Result<Option<(&'static FieldInfo, &'a [u8])>, DecodeError>;

/// The present fields of message data in order, each with its bytes.
///
/// Fails in the same places and ways as the structs' `decode`; an error is the last item.
pub fn walk<'a>(
    message: &'static MessageInfo,
    data: &'a [u8],
) -> impl Iterator<Item = Result<(&'static FieldInfo, &'a [u8]), DecodeError>> {
    let mut fields = message.fields.iter();
    let mut reader = Some(DataReader::new(message, data));
    std::iter::from_fn(move || {
        let step = match reader.as_mut()? {
            Ok(reader) => reader.next(&mut fields),
            Err(error) => Err(*error),
        };
        if !matches!(step, Ok(Some(_))) {
            reader = None;
        }
        step.transpose()
    })
}

/// The data of one message being written; `N` is the length of its presence vector.
#[derive(Debug)]
pub(super) struct DataWriter<'a, const N: usize> {
    message: &'static MessageInfo,
    presence: u64,
    writer: Writer<'a>,
}

impl<'a, const N: usize> DataWriter<'a, N> {
    /// Reserves the presence vector, which is known only once all fields are written.
    #[inline]
    pub(super) fn new(
        message: &'static MessageInfo,
        out: &'a mut [u8],
    ) -> Result<Self, EncodeError> {
        let available = out.len();
        let mut writer = Writer::new(out);
        match writer.put([0; N]) {
            Ok(()) => Ok(Self {
                message,
                presence: 0,
                writer,
            }),
            Err(_) => Err(EncodeError::BufferTooSmall { available }),
        }
    }

    /// Writes the field of this presence bit, where it is set.
    #[inline(always)]
    pub(super) fn field<T: Field>(&mut self, bit: u8, value: Option<T>) -> Result<(), EncodeError> {
        let Some(value) = value else { return Ok(()) };
        self.presence |= 1 << bit;
        value
            .write(&mut self.writer)
            .map_err(|fault| self.error(bit, fault))
    }

    /// Fills in the presence vector; returns the total length.
    #[inline]
    pub(super) fn finish(mut self) -> usize {
        let bits = self.presence.to_be_bytes();
        self.writer.buffer()[..N].copy_from_slice(&bits[bits.len() - N..]);
        self.writer.position()
    }

    #[cold]
    fn error(&mut self, bit: u8, fault: Fault) -> EncodeError {
        match fault {
            Fault::Short => EncodeError::BufferTooSmall {
                available: self.writer.buffer().len(),
            },
            Fault::UnknownLength => EncodeError::UnknownLength {
                message_type: self.message.id,
                field: &self.message.fields[usize::from(bit)],
            },
        }
    }
}

/// Declares messages: the struct, its codec in straight-line code, and its row in the table.
///
/// ```text
/// Struct = id, "name", presence bytes 3 fact(..) fact(..) ... {
///     field: Type = bit, "name", fact(..), fact(..) ...;
/// }
/// ```
///
/// The facts are the builder methods of `MessageInfo` and `FieldInfo`, their arguments written without a path (`ToVsm`,
/// `Ed4`, `C`). A field's wire type, scale, unit and enumeration come from its Rust type.
macro_rules! messages {
    ($(
        $Name:ident = $id:literal, $title:literal, presence bytes $bytes:literal
        $($fact:ident($($value:expr),*))* {
            $($field:ident: $Type:ty = $bit:literal, $label:literal $(, $note:ident($($text:expr),*))*;)*
        }
    )*) => { $(
        #[doc = concat!($title, " (", stringify!($id), ").\n")]
        #[doc = concat!($("\n- ", stringify!($fact), ": ", stringify!($($value),*),)* "\n")]
        #[derive(Clone, Debug, Default, PartialEq)]
        pub struct $Name { $(
            #[doc = concat!("Field ", stringify!($bit), " (from 0): ", $label, ".\n")]
            #[doc = concat!($("\n- ", stringify!($note), ": ", stringify!($($text),*),)* "\n")]
            pub $field: Option<$Type>,
        )* }

        impl $Name {
            /// The Message Type.
            pub const ID: u16 = $id;
            /// The name.
            pub const NAME: &'static str = $title;
            /// The row in the table.
            pub const INFO: $crate::table::info::MessageInfo = {
                #[allow(unused_imports, reason = "not every row uses every fact")]
                use $crate::{field::Confidence::*, table::info::{Direction::*, Layout::*, Traffic::*}};
                $crate::table::info::MessageInfo::new($id, $title, stringify!($Name), $bytes, &[$(
                    $crate::field::FieldInfo::new::<$Type>($bit, $label, stringify!($field))
                        $(.$note($($text),*))*
                ),*])$(.$fact($($value),*))*
            };

            /// Reads message data: presence vector and fields.
            ///
            /// # Errors
            /// The bytes are not the data of this message.
            pub fn decode(data: &[u8]) -> Result<Self, $crate::DecodeError> {
                let mut reader = $crate::table::codec::DataReader::new(const { &Self::INFO }, data)?;
                let message = Self { $($field: reader.field($bit)?),* };
                reader.finish()?;
                Ok(message)
            }

            /// Writes message data, presence vector and fields; returns how many bytes.
            ///
            /// # Errors
            /// The buffer is too small, or a field is set whose length no source gives.
            pub fn encode_data(&self, out: &mut [u8]) -> Result<usize, $crate::EncodeError> {
                let mut writer =
                    $crate::table::codec::DataWriter::<$bytes>::new(const { &Self::INFO }, out)?;
                $(writer.field($bit, self.$field)?;)*
                Ok(writer.finish())
            }
        }
    )* };
}

pub(super) use messages;
