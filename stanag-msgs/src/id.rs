//! Identification numbers of stations: CUCS, VSM, vehicle and data link.

use std::fmt;
use std::str::FromStr;

/// A station's number: four bytes, the owning nation's first, written `1b:00:00:01`.
///
/// In Edition 4 the numbers of sender and receiver are in the wrapper; a few messages carry
/// further ones as `Integer 4` fields, which hold the same 32 bits.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Id(pub u32);

impl Id {
    /// Everyone (`ff:ff:ff:ff`).
    pub const BROADCAST: Id = Id(0xFFFF_FFFF);
    /// No station (`ff:00:00:00`), such as the VSM ID of a vehicle directly on the network.
    pub const NULL: Id = Id(0xFF00_0000);

    /// The owning nation or organisation, the first byte.
    pub const fn owner(self) -> u8 {
        self.0.to_be_bytes()[0]
    }
}

impl fmt::Display for Id {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [a, b, c, d] = self.0.to_be_bytes();
        write!(f, "{a:02x}:{b:02x}:{c:02x}:{d:02x}")
    }
}

impl FromStr for Id {
    type Err = ParseIdError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let mut bytes = [0; 4];
        let mut parts = text.split(':');
        for (index, byte) in bytes.iter_mut().enumerate() {
            let part = parts.next().ok_or(ParseIdError::Bytes { found: index })?;
            // from_str_radix alone would accept "+1" and "001".
            let hex = (1..=2).contains(&part.len()) && part.bytes().all(|b| b.is_ascii_hexdigit());
            *byte = match u8::from_str_radix(part, 16) {
                Ok(value) if hex => value,
                _ => return Err(ParseIdError::Byte { index }),
            };
        }
        match parts.count() {
            0 => Ok(Id(u32::from_be_bytes(bytes))),
            more => Err(ParseIdError::Bytes { found: 4 + more }),
        }
    }
}

/// Why a text is not an [`Id`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParseIdError {
    /// Not four bytes.
    #[error("{found} bytes, expected 4 as in 1b:00:00:01")]
    Bytes {
        /// How many were found.
        found: usize,
    },
    /// One of them is not a hexadecimal byte.
    #[error("byte {index} (counted from 0) is not hexadecimal, expected 00 to ff")]
    Byte {
        /// Which one, counted from 0.
        index: usize,
    },
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_and_number_are_the_same_id() {
        let id: Id = "1b:00:01:a0".parse().unwrap();
        assert_eq!(id, Id(0x1b00_01a0));
        assert_eq!(id.to_string(), "1b:00:01:a0");
        assert_eq!(id.owner(), 27);
        assert_eq!("1B:0:1:A0".parse(), Ok(id));
        assert_eq!(Id::BROADCAST.to_string(), "ff:ff:ff:ff");
        assert_eq!(Id::NULL.to_string(), "ff:00:00:00");
    }

    #[test]
    fn other_texts_are_refused() {
        assert_eq!(
            "1b:00:00".parse::<Id>(),
            Err(ParseIdError::Bytes { found: 3 })
        );
        assert_eq!(
            "1b:00:00:00:00".parse::<Id>(),
            Err(ParseIdError::Bytes { found: 5 })
        );
        for (text, index) in [
            ("", 0),
            ("1b:+1:00:00", 1),
            ("1b:00:100:00", 2),
            ("1b:00:00:gg", 3),
        ] {
            assert_eq!(
                text.parse::<Id>(),
                Err(ParseIdError::Byte { index }),
                "{text}"
            );
        }
    }
}
