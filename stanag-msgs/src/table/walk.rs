//! Walking over message data by the table alone, without the structs.

use super::{FieldInfo, MessageInfo};
use crate::codec::DecodeError;

/// The present fields of message data in order, each with its bytes.
///
/// Fails in the same places and ways as the structs' `decode`; an error is the last item.
pub fn walk<'a>(message: &'static MessageInfo, data: &'a [u8]) -> Walk<'a> {
    Walk {
        message,
        data,
        offset: 0,
        presence: 0,
        bit: None,
    }
}

/// See [`walk`].
#[derive(Clone, Debug)]
pub struct Walk<'a> {
    message: &'static MessageInfo,
    data: &'a [u8],
    offset: usize,
    presence: u64,
    /// The next presence bit; none before the presence vector is read.
    bit: Option<usize>,
}

impl<'a> Iterator for Walk<'a> {
    type Item = Result<(&'static FieldInfo, &'a [u8]), DecodeError>;

    fn next(&mut self) -> Option<Self::Item> {
        let outcome = self.step();
        if let Err(_) | Ok(None) = outcome {
            // Nothing follows: neither fields nor bytes.
            (self.bit, self.offset) = (Some(self.message.fields.len()), self.data.len());
        }
        outcome.transpose()
    }
}

impl<'a> Walk<'a> {
    fn step(&mut self) -> Result<Option<(&'static FieldInfo, &'a [u8])>, DecodeError> {
        let message_type = self.message.id;
        let from = match self.bit {
            Some(bit) => bit,
            None => self.read_presence()?,
        };
        let mut fields = self.message.fields[from..].iter();
        let offset = self.offset;
        let rest = &self.data[offset..];
        let found = rest.len();
        let Some(field) = fields.find(|field| self.presence >> field.bit & 1 == 1) else {
            return match found {
                0 => Ok(None),
                found => Err(DecodeError::Trailing {
                    message_type,
                    offset,
                    found,
                }),
            };
        };
        let bit = field.bit;
        let Some(bytes) = field.wire.bytes() else {
            return Err(DecodeError::UnknownLength {
                message_type,
                bit,
                offset,
            });
        };
        let Some(bytes) = rest.get(..bytes) else {
            return Err(DecodeError::Truncated {
                message_type,
                bit,
                offset,
                found,
            });
        };
        self.bit = Some(usize::from(bit) + 1);
        self.offset += bytes.len();
        Ok(Some((field, bytes)))
    }

    fn read_presence(&mut self) -> Result<usize, DecodeError> {
        let message_type = self.message.id;
        let expected = usize::from(self.message.presence_bytes);
        let found = self.data.len();
        let Some(vector) = self.data.get(..expected) else {
            return Err(DecodeError::NoPresence {
                message_type,
                found,
                expected,
            });
        };
        let presence = vector
            .iter()
            .fold(0, |bits, &byte| bits << 8 | u64::from(byte));
        let known = (1 << self.message.fields.len()) - 1;
        if presence & !known != 0 {
            return Err(DecodeError::UnknownPresence {
                message_type,
                presence,
                known,
            });
        }
        (self.presence, self.offset) = (presence, expected);
        Ok(0)
    }
}
