//! Integers of one to five bytes, floats, and identification numbers.
//!
//! STANAG 4586 uses integers of three and five bytes, which Rust has no types for: [`U24`], [`I24`] and [`U40`].

use crate::bytes::{Fault, Reader, Writer};
use crate::field::{Field, Wire};
use crate::id::Id;

macro_rules! plain_fields {
    ($($Type:ty => $wire:ident),*) => { $(
        impl Field for $Type {
            const WIRE: Wire = Wire::$wire;

            #[inline]
            fn read(reader: &mut Reader<'_>) -> Result<Self, Fault> {
                reader.chunk().map(<$Type>::from_be_bytes)
            }

            #[inline]
            fn write(self, writer: &mut Writer<'_>) -> Result<(), Fault> {
                writer.put(self.to_be_bytes())
            }
        }
    )* };
}

plain_fields!(u8 => U8, u16 => U16, u32 => U32, i8 => I8, i16 => I16, i32 => I32, f32 => F32, f64 => F64);

/// Identification numbers in fields are `Integer 4`; the bits are those of the wrapper's.
impl Field for Id {
    const WIRE: Wire = Wire::I32;
    const IDENTIFICATION: bool = true;

    #[inline]
    fn read(reader: &mut Reader<'_>) -> Result<Self, Fault> {
        u32::read(reader).map(Id)
    }

    #[inline]
    fn write(self, writer: &mut Writer<'_>) -> Result<(), Fault> {
        self.0.write(writer)
    }
}

/// An integer on the wire: its bounds, and conversion from and to `i64`.
pub trait Integer: Field {
    /// The smallest value.
    const LOW: i64;
    /// The largest value.
    const HIGH: i64;

    /// The value.
    fn to_i64(self) -> i64;

    /// The integer of this value, clamped to [`Integer::LOW`] and [`Integer::HIGH`].
    fn clamped(value: i64) -> Self;
}

macro_rules! integers {
    ($($Type:ty),*) => { $(
        impl Integer for $Type {
            const LOW: i64 = <$Type>::MIN as i64;
            const HIGH: i64 = <$Type>::MAX as i64;

            #[inline]
            fn to_i64(self) -> i64 {
                i64::from(self)
            }

            #[inline]
            fn clamped(value: i64) -> Self {
                value.clamp(Self::LOW, Self::HIGH) as $Type
            }
        }
    )* };
}

integers!(u8, u16, u32, i8, i16, i32);

macro_rules! wide_integers {
    ($($(#[$doc:meta])* $Name:ident($Inner:ident), $bytes:literal of $full:literal bytes,
       $low:expr, $high:expr, $wire:ident;)*) => { $(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $Name($Inner);

        impl $Name {
            /// The smallest value.
            pub const MIN: Self = Self($low);
            /// The largest value.
            pub const MAX: Self = Self($high);

            /// The integer of this value, where it fits.
            pub const fn new(value: $Inner) -> Option<Self> {
                let wide = value as i128;
                if wide >= $low && wide <= $high { Some(Self(value)) } else { None }
            }

            /// The value.
            pub const fn get(self) -> $Inner {
                self.0
            }
        }

        impl From<$Name> for $Inner {
            fn from(value: $Name) -> Self {
                value.0
            }
        }

        impl Field for $Name {
            const WIRE: Wire = Wire::$wire;

            #[inline]
            fn read(reader: &mut Reader<'_>) -> Result<Self, Fault> {
                let bytes: [u8; $bytes] = reader.chunk()?;
                let mut full = [0; $full];
                full[..$bytes].copy_from_slice(&bytes);
                // The bytes are in the upper part of the integer, so that shifting down extends the sign.
                Ok(Self($Inner::from_be_bytes(full) >> (8 * ($full - $bytes))))
            }

            #[inline]
            fn write(self, writer: &mut Writer<'_>) -> Result<(), Fault> {
                let mut bytes = [0; $bytes];
                bytes.copy_from_slice(&self.0.to_be_bytes()[$full - $bytes..]);
                writer.put(bytes)
            }
        }

        impl Integer for $Name {
            const LOW: i64 = $low as i64;
            const HIGH: i64 = $high as i64;

            #[inline]
            fn to_i64(self) -> i64 {
                self.0 as i64
            }

            #[inline]
            fn clamped(value: i64) -> Self {
                Self(value.clamp(Self::LOW, Self::HIGH) as $Inner)
            }
        }
    )* };
}

wide_integers! {
    /// `Unsigned 3`: 0 to 2^24 - 1.
    U24(u32), 3 of 4 bytes, 0, 0xFF_FFFF, U24;
    /// `Unsigned 5`: 0 to 2^40 - 1.
    U40(u64), 5 of 8 bytes, 0, 0xFF_FFFF_FFFF, U40;
    /// `Integer 3`: -2^23 to 2^23 - 1.
    I24(i32), 3 of 4 bytes, -0x80_0000, 0x7F_FFFF, I24;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round<T: Field + PartialEq + std::fmt::Debug>(value: T, bytes: &[u8]) {
        let mut out = [0; 8];
        let mut writer = Writer::new(&mut out);
        value.write(&mut writer).unwrap();
        let length = writer.position();
        assert_eq!(&out[..length], bytes);
        assert_eq!(T::read(&mut Reader::new(bytes)).unwrap(), value);
    }

    #[test]
    fn three_and_five_bytes_keep_value_and_sign() {
        round(U24::MAX, &[0xFF; 3]);
        round(U24::new(0x01_0203).unwrap(), &[1, 2, 3]);
        round(I24::MIN, &[0x80, 0, 0]);
        round(I24::new(-1).unwrap(), &[0xFF; 3]);
        round(I24::MAX, &[0x7F, 0xFF, 0xFF]);
        round(U40::MAX, &[0xFF; 5]);
        round(U40::new(0x01_0203_0405).unwrap(), &[1, 2, 3, 4, 5]);
    }

    #[test]
    fn values_that_do_not_fit_are_refused() {
        assert_eq!(U24::new(1 << 24), None);
        assert_eq!(I24::new(1 << 23), None);
        assert_eq!(I24::new(-(1 << 23) - 1), None);
        assert_eq!(U40::new(1 << 40), None);
        assert_eq!(I24::clamped(i64::MAX), I24::MAX);
    }
}
