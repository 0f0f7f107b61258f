//! What the message table records about one field, and what a Rust type must do to be one.
//!
//! A row of the table names a field's Rust type only. Its wire type, scale, unit and enumeration follow from that type
//! through [`Field`], so that the codec, the JSON form, the dissector and the documents cannot disagree about them.
//! [`FieldInfo`] is the same at run time, with the facts that sources add: unique id, range, note, confidence.

use std::f64::consts::PI;
use std::fmt;

use crate::bytes::{Fault, Reader, Writer};

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

    /// Reads the field from the front of `reader`.
    ///
    /// # Errors
    /// A [`Fault`] if the bytes end within the field, or its length is not known.
    fn read(reader: &mut Reader<'_>) -> Result<Self, Fault>;

    /// Appends the field to `writer`.
    ///
    /// # Errors
    /// A [`Fault`] if the buffer is too small, or the field's length is not known.
    fn write(self, writer: &mut Writer<'_>) -> Result<(), Fault>;
}

/// The type of a field on the wire.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Wire {
    /// `Unsigned 1`.
    U8,
    /// `Unsigned 2`.
    U16,
    /// `Unsigned 3`.
    U24,
    /// `Unsigned 4`.
    U32,
    /// `Unsigned 5`.
    U40,
    /// `Integer 1`, two's complement.
    I8,
    /// `Integer 2`.
    I16,
    /// `Integer 3`.
    I24,
    /// `Integer 4`.
    I32,
    /// `Integer 2` in binary angular measure.
    Bam16,
    /// `Integer 4` in binary angular measure.
    Bam32,
    /// IEEE 754 in four bytes.
    F32,
    /// IEEE 754 in eight bytes.
    F64,
    /// `Character n`, the terminating NUL counted.
    Char(u16),
    /// A text whose length no source gives.
    UnsizedText,
    /// As many bytes as the field Length of URI gives (32301).
    UnsizedBytes,
}

impl Wire {
    /// How many bytes it has, where that is known.
    pub const fn bytes(self) -> Option<usize> {
        match self {
            Wire::U8 | Wire::I8 => Some(1),
            Wire::U16 | Wire::I16 | Wire::Bam16 => Some(2),
            Wire::U24 | Wire::I24 => Some(3),
            Wire::U32 | Wire::I32 | Wire::Bam32 | Wire::F32 => Some(4),
            Wire::U40 => Some(5),
            Wire::F64 => Some(8),
            Wire::Char(bytes) => Some(bytes as usize),
            Wire::UnsizedText | Wire::UnsizedBytes => None,
        }
    }

    /// What one step is worth in radians for a binary angle, and 1 for everything else.
    pub const fn step(self) -> f64 {
        match self {
            Wire::Bam16 => PI / (1u64 << 15) as f64,
            Wire::Bam32 => PI / (1u64 << 31) as f64,
            _ => 1.0,
        }
    }

    /// The smallest and the largest integer, where it is one.
    pub const fn integers(self) -> Option<(i64, i64)> {
        let (bits, signed) = match self {
            Wire::U8 => (8, false),
            Wire::U16 => (16, false),
            Wire::U24 => (24, false),
            Wire::U32 => (32, false),
            Wire::U40 => (40, false),
            Wire::I8 => (8, true),
            Wire::I16 | Wire::Bam16 => (16, true),
            Wire::I24 => (24, true),
            Wire::I32 | Wire::Bam32 => (32, true),
            _ => return None,
        };
        if signed {
            Some((-(1 << (bits - 1)), (1 << (bits - 1)) - 1))
        } else {
            Some((0, (1 << bits) - 1))
        }
    }
}

/// As the fact table writes it: `u40`, `bam32`, `char80`.
impl fmt::Display for Wire {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Wire::U8 => "u8",
            Wire::U16 => "u16",
            Wire::U24 => "u24",
            Wire::U32 => "u32",
            Wire::U40 => "u40",
            Wire::I8 => "i8",
            Wire::I16 => "i16",
            Wire::I24 => "i24",
            Wire::I32 => "i32",
            Wire::Bam16 => "bam16",
            Wire::Bam32 => "bam32",
            Wire::F32 => "f32",
            Wire::F64 => "f64",
            Wire::Char(bytes) => return write!(f, "char{bytes}"),
            Wire::UnsizedText => "char?",
            Wire::UnsizedBytes => "bytes[Length of URI]",
        })
    }
}

/// How far a fact can be trusted, most trusted first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Confidence {
    /// The text of the edition itself (Edition 2.5), or an Edition 4 definition whose author claims to have checked it
    /// against the text.
    A,
    /// One secondary source for Edition 4, or the text of Edition 3.
    B,
    /// Inferred from Edition 2.5.
    C,
    /// Not found in any source.
    NotFound,
}

impl Confidence {
    /// The letter of the fact table: `A`, `B`, `C` or `?`.
    pub const fn letter(self) -> &'static str {
        match self {
            Confidence::A => "A",
            Confidence::B => "B",
            Confidence::C => "C",
            Confidence::NotFound => "?",
        }
    }
}

/// Whether values exclude one another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EnumKind {
    /// One value at a time.
    Enumeration,
    /// Bits, any number at a time.
    Bitmap,
}

/// What the table records about an enumeration or bitmap.
#[derive(Debug, PartialEq)]
pub struct EnumInfo {
    /// Its name in the table.
    pub name: &'static str,
    /// Whether values exclude one another.
    pub kind: EnumKind,
    /// How far the values can be trusted.
    pub confidence: Confidence,
    /// The sources, by the tags of the fact table.
    pub source: &'static str,
    /// What it is; may be empty.
    pub description: &'static str,
    /// Value, name in Rust, and text of each.
    pub values: &'static [(i64, &'static str, &'static str)],
    /// Ranges of values, and what they are for.
    pub ranges: &'static [(&'static str, &'static str)],
}

impl EnumInfo {
    /// The text of a value.
    pub fn text(&self, value: i64) -> Option<&'static str> {
        self.values
            .iter()
            .find(|&&(raw, _, _)| raw == value)
            .map(|&(_, _, text)| text)
    }

    /// The value of a text, or of a name in Rust.
    pub fn value(&self, text: &str) -> Option<i64> {
        let found = self
            .values
            .iter()
            .find(|&&(_, name, long)| long == text || name == text);
        found.map(|&(raw, _, _)| raw)
    }
}

/// Declares the facts that a row may add, each a builder method: `name(arguments) => what it sets;`.
macro_rules! facts {
    ($($fact:ident($($value:ident: $Type:ty),*) => $($field:ident = $set:expr),*;)*) => { $(
        pub(crate) const fn $fact(mut self $(, $value: $Type)*) -> Self {
            $(self.$field = $set;)*
            self
        }
    )* };
}

pub(crate) use facts;

/// A field of a message.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldInfo {
    /// Its presence bit, which is also its index in the message; the standard numbers fields from 1.
    pub bit: u8,
    /// Its name.
    pub name: &'static str,
    /// Its name in Rust.
    pub rust: &'static str,
    /// Its type on the wire.
    pub wire: Wire,
    /// What one step of the wire value is worth in `unit`, where that is not 1. A binary angle's
    /// step is given by its wire type.
    pub scale: Option<f64>,
    /// The unit of the scaled value.
    pub unit: Option<&'static str>,
    /// The smallest and the largest value in `unit`, where sources narrow the wire type.
    pub range: Option<(f64, f64)>,
    /// The enumeration or bitmap that its values come from.
    pub enumeration: Option<&'static EnumInfo>,
    /// Whether it is an identification number ([`crate::Id`]).
    pub identification: bool,
    /// The standard's own id of the field, `0101.04`; a question mark where that is inferred.
    pub uid: Option<&'static str>,
    /// Its confidence, where it differs from the message's.
    pub confidence: Option<Confidence>,
    /// Whether the width is inferred and not found.
    pub width_inferred: bool,
    /// The field of Edition 4 that holds the same, in a row of Edition 2.5: message and number, from 1.
    pub ed4: Option<(u16, u8)>,
    /// What else sources give.
    pub note: Option<&'static str>,
}

impl FieldInfo {
    /// A field of this Rust type, which gives wire type, scale, unit and enumeration.
    pub(crate) const fn new<T: Field>(bit: u8, name: &'static str, rust: &'static str) -> Self {
        Self {
            scale: T::SCALE,
            unit: T::UNIT,
            enumeration: T::ENUMERATION,
            identification: T::IDENTIFICATION,
            ..Self::of(T::WIRE, bit, name, rust)
        }
    }

    /// A field of this wire type, of which nothing else is known.
    pub(crate) const fn of(wire: Wire, bit: u8, name: &'static str, rust: &'static str) -> Self {
        Self {
            bit,
            name,
            rust,
            wire,
            scale: None,
            unit: None,
            range: None,
            enumeration: None,
            identification: false,
            uid: None,
            confidence: None,
            width_inferred: false,
            ed4: None,
            note: None,
        }
    }

    facts! {
        uid(uid: &'static str) => uid = Some(uid);
        unit(unit: &'static str) => unit = Some(unit);
        scale(scale: f64) => scale = Some(scale);
        values(info: &'static EnumInfo) => enumeration = Some(info);
        identification() => identification = true;
        ed4(message: u16, number: u8) => ed4 = Some((message, number));
        range(low: f64, high: f64) => range = Some((low, high));
        conf(confidence: Confidence) => confidence = Some(confidence);
        width_inferred() => width_inferred = true;
        note(note: &'static str) => note = Some(note);
    }

    /// What one step of the wire value is worth in `unit`: the scale, a binary angle's step, or 1.
    pub fn step(&self) -> f64 {
        self.scale.unwrap_or(self.wire.step())
    }
}
