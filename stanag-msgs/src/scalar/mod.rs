//! The scalars that fields are made of: integers of one to five bytes, binary angles, scaled
//! quantities, times and texts.
//!
//! Every scalar keeps the value that is on the wire, so decoding and encoding lose nothing; what
//! it means is asked by a method (`radians`, `si`, `unix_ms`). All are big-endian.

mod bam;
mod scaled;
mod text;
mod time;
mod unsized_fields;
mod wide;

pub use bam::{Bam16, Bam32};
pub use scaled::*;
pub use text::Text;
pub use time::TimeStamp;
pub use unsized_fields::{UnsizedBytes, UnsizedText};
pub use wide::{I24, Integer, U24, U40};

use crate::codec::{Fault, Reader, Writer};
use crate::enums::EnumInfo;
use crate::id::Id;
use crate::table::Wire;

/// A type that a field may have: how it is read, written and described.
pub trait Field: Copy {
    /// The type on the wire.
    const WIRE: Wire;
    /// What one step of the wire value is worth in [`Field::UNIT`].
    const SCALE: Option<f64> = None;
    /// The unit, where the type fixes it.
    const UNIT: Option<&'static str> = None;
    /// The enumeration or bitmap, where the type is one.
    const ENUMERATION: Option<&'static EnumInfo> = None;
    /// Whether it is an identification number, written `1b:00:00:01`.
    const IDENTIFICATION: bool = false;

    /// Takes the field from the front of `reader`.
    fn read(reader: &mut Reader<'_>) -> Result<Self, Fault>;

    /// Appends the field to `writer`.
    fn write(self, writer: &mut Writer<'_>) -> Result<(), Fault>;
}

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
