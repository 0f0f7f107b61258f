//! Texts of fixed length, and fields whose length no source gives.

use std::fmt;

use crate::bytes::{Fault, Reader, Writer};
use crate::field::{Field, Wire};

/// `Character N`: 7-bit characters in `N` bytes, the last always NUL, the rest padded with NUL.
///
/// Characters that are not 7-bit become `?`, when reading and when writing. What a sender puts
/// after the first NUL, or into the last byte, is dropped.
#[derive(Clone, Copy, PartialEq, Eq, Hash)]
pub struct Text<const N: usize>([u8; N]);

impl<const N: usize> Text<N> {
    /// The text, cut at `N - 1` characters or at its first NUL.
    pub fn new(text: &str) -> Self {
        let mut bytes = [0; N];
        for (byte, character) in bytes[..N - 1].iter_mut().zip(text.chars()) {
            match character {
                '\0' => break,
                character if character.is_ascii() => *byte = character as u8,
                _ => *byte = b'?',
            }
        }
        Self(bytes)
    }

    /// The text of these bytes, whatever they are.
    fn from_bytes(mut bytes: [u8; N]) -> Self {
        let end = bytes[..N - 1]
            .iter()
            .position(|&byte| byte == 0)
            .unwrap_or(N - 1);
        bytes[end..].fill(0);
        for byte in &mut bytes[..end] {
            if !byte.is_ascii() {
                *byte = b'?';
            }
        }
        Self(bytes)
    }

    /// The characters before the first NUL.
    pub fn as_str(&self) -> &str {
        let end = self.0.iter().position(|&byte| byte == 0).unwrap_or(N);
        // All bytes are 7-bit by construction, so the default is never used.
        std::str::from_utf8(&self.0[..end]).unwrap_or_default()
    }
}

impl<const N: usize> From<&str> for Text<N> {
    fn from(text: &str) -> Self {
        Self::new(text)
    }
}

impl<const N: usize> Default for Text<N> {
    fn default() -> Self {
        Self([0; N])
    }
}

impl<const N: usize> fmt::Display for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.as_str())
    }
}

impl<const N: usize> fmt::Debug for Text<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(self.as_str(), f)
    }
}

impl<const N: usize> Field for Text<N> {
    const WIRE: Wire = Wire::Char(N as u16);

    #[inline]
    fn read(reader: &mut Reader<'_>) -> Result<Self, Fault> {
        reader.chunk().map(Self::from_bytes)
    }

    #[inline]
    fn write(self, writer: &mut Writer<'_>) -> Result<(), Fault> {
        writer.put(self.0)
    }
}

macro_rules! unsized_fields {
    ($($(#[$doc:meta])* $Name:ident => $wire:ident;)*) => { $(
        $(#[$doc])*
        ///
        /// The presence vector shows whether it is there, but not how long it is: a message that
        /// carries it can be neither decoded nor encoded, and both are errors.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
        pub struct $Name;

        impl Field for $Name {
            const WIRE: Wire = Wire::$wire;

            fn read(_: &mut Reader<'_>) -> Result<Self, Fault> {
                Err(Fault::UnknownLength)
            }

            fn write(self, _: &mut Writer<'_>) -> Result<(), Fault> {
                Err(Fault::UnknownLength)
            }
        }
    )* };
}

unsized_fields! {
    /// A text of unknown length.
    UnsizedText => UnsizedText;
    /// Bytes whose length another field is believed to give (32301).
    UnsizedBytes => UnsizedBytes;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_is_cut_and_kept_seven_bit() {
        assert_eq!(Text::<6>::new("ABCDEFG").as_str(), "ABCDE");
        assert_eq!(Text::<6>::new("Zürich").as_str(), "Z?ric");
        assert_eq!(Text::<6>::new("A\0B").as_str(), "A");
        assert_eq!(Text::<6>::new("").as_str(), "");
        assert_eq!(format!("{:?}", Text::<6>::new("AB")), "\"AB\"");
    }

    #[test]
    fn any_bytes_from_the_wire_become_a_text() {
        let read = |bytes: &[u8; 4]| Text::<4>::read(&mut Reader::new(bytes)).unwrap();
        assert_eq!(read(b"ABCD"), Text::new("ABC"));
        assert_eq!(read(b"A\xE9C\0"), Text::new("A?C"));
        assert_eq!(read(b"A\0\xFFD"), Text::new("A"));
    }
}
