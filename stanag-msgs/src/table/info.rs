//! What the table says of a message and of a field.

use std::fmt;

use crate::enums::EnumInfo;
use crate::scalar::Field;

/// How far a fact is to be trusted.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Confidence {
    /// An Edition 4 definition whose author claims to have checked it against the text.
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

/// Who sends a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// CUCS to VSM.
    ToVsm,
    /// VSM to CUCS.
    ToCucs,
    /// Either way.
    Both,
}

impl Direction {
    /// As the fact table writes it.
    pub const fn text(self) -> &'static str {
        match self {
            Direction::ToVsm => "CUCS->VSM",
            Direction::ToCucs => "VSM->CUCS",
            Direction::Both => "both",
        }
    }
}

/// Whether a message is sent unasked.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Traffic {
    /// Unasked.
    Push,
    /// As an answer.
    Pull,
    /// Either.
    PushPull,
}

impl Traffic {
    /// As the fact table writes it.
    pub const fn text(self) -> &'static str {
        match self {
            Traffic::Push => "push",
            Traffic::Pull => "pull",
            Traffic::PushPull => "push/pull",
        }
    }
}

/// Where the layout comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Layout {
    /// The order of the fields is known for Edition 4.
    Ed4,
    /// The order of Edition 2.5 with the id fields dropped and the types guessed.
    Ed2Derived,
}

impl Layout {
    /// As the fact table writes it.
    pub const fn text(self) -> &'static str {
        match self {
            Layout::Ed4 => "ed4",
            Layout::Ed2Derived => "ed2-derived",
        }
    }
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
    /// Bytes as many as the field Length of URI says (32301).
    UnsizedBytes,
}

impl Wire {
    /// How many bytes it takes, where that is known.
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

    /// The least and the greatest integer, where it is one.
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

/// A field of a message.
#[derive(Clone, Copy, Debug)]
pub struct FieldInfo {
    /// Its presence bit, which is also its place; the standard numbers fields from 1.
    pub bit: u8,
    /// Its name.
    pub name: &'static str,
    /// Its name in Rust.
    pub rust: &'static str,
    /// Its type on the wire.
    pub wire: Wire,
    /// What one step of the wire value is worth in `unit`, where that is not 1. A binary angle's
    /// step is given by its type.
    pub scale: Option<f64>,
    /// The unit of the scaled value.
    pub unit: Option<&'static str>,
    /// The least and the greatest value in `unit`, where sources narrow the wire type.
    pub range: Option<(f64, f64)>,
    /// The enumeration or bitmap that its values are from.
    pub enumeration: Option<&'static EnumInfo>,
    /// Whether it is an identification number ([`crate::Id`]).
    pub identification: bool,
    /// The standard's own id of the field, `0101.04`; a question mark where that is inferred.
    pub uid: Option<&'static str>,
    /// Its confidence, where it differs from the message's.
    pub confidence: Option<Confidence>,
    /// Whether the width is inferred and not found.
    pub width_inferred: bool,
    /// What else sources say of it.
    pub note: Option<&'static str>,
}

impl FieldInfo {
    pub(crate) const fn new<T: Field>(bit: u8, name: &'static str, rust: &'static str) -> Self {
        Self {
            bit,
            name,
            rust,
            wire: T::WIRE,
            scale: T::SCALE,
            unit: T::UNIT,
            range: None,
            enumeration: T::ENUMERATION,
            identification: T::IDENTIFICATION,
            uid: None,
            confidence: None,
            width_inferred: false,
            note: None,
        }
    }

    pub(crate) const fn uid(mut self, uid: &'static str) -> Self {
        self.uid = Some(uid);
        self
    }

    pub(crate) const fn unit(mut self, unit: &'static str) -> Self {
        self.unit = Some(unit);
        self
    }

    pub(crate) const fn range(mut self, low: f64, high: f64) -> Self {
        self.range = Some((low, high));
        self
    }

    pub(crate) const fn conf(mut self, confidence: Confidence) -> Self {
        self.confidence = Some(confidence);
        self
    }

    pub(crate) const fn width_inferred(mut self) -> Self {
        self.width_inferred = true;
        self
    }

    pub(crate) const fn note(mut self, note: &'static str) -> Self {
        self.note = Some(note);
        self
    }

    /// What one step of the wire value is worth in `unit`: the scale, a binary angle's step, or 1.
    pub fn step(&self) -> f64 {
        match self.wire {
            Wire::Bam16 => crate::scalar::Bam16::STEP,
            Wire::Bam32 => crate::scalar::Bam32::STEP,
            _ => self.scale.unwrap_or(1.0),
        }
    }
}

/// A message.
#[derive(Clone, Copy, Debug)]
pub struct MessageInfo {
    /// Its Message Type.
    pub id: u16,
    /// Its name.
    pub name: &'static str,
    /// The name of its struct.
    pub rust: &'static str,
    /// Bytes of its presence vector.
    pub presence_bytes: u8,
    /// Its fields in order.
    pub fields: &'static [FieldInfo],
    /// Who sends it.
    pub direction: Direction,
    /// Whether it is sent unasked.
    pub traffic: Traffic,
    /// The greatest latency in ms; advisory, sources disagree.
    pub latency_ms: Option<u16>,
    /// How far the layout is to be trusted.
    pub confidence: Confidence,
    /// Where the layout comes from.
    pub layout: Layout,
    /// The sources, by the tags of the fact table.
    pub source: &'static str,
    /// Which independent source confirms it.
    pub corroboration: &'static str,
    /// Its table in the standard.
    pub table: Option<&'static str>,
    /// The message of Edition 2 that it comes from.
    pub ed2_message: Option<&'static str>,
    /// What else sources say of it.
    pub note: Option<&'static str>,
}

impl MessageInfo {
    pub(crate) const fn new(
        id: u16,
        name: &'static str,
        rust: &'static str,
        presence_bytes: u8,
        fields: &'static [FieldInfo],
    ) -> Self {
        Self {
            id,
            name,
            rust,
            presence_bytes,
            fields,
            direction: Direction::Both,
            traffic: Traffic::Push,
            latency_ms: None,
            confidence: Confidence::NotFound,
            layout: Layout::Ed4,
            source: "",
            corroboration: "none",
            table: None,
            ed2_message: None,
            note: None,
        }
    }

    pub(crate) const fn sent(mut self, direction: Direction, traffic: Traffic) -> Self {
        self.direction = direction;
        self.traffic = traffic;
        self
    }

    pub(crate) const fn latency_ms(mut self, latency_ms: u16) -> Self {
        self.latency_ms = Some(latency_ms);
        self
    }

    pub(crate) const fn layout(mut self, layout: Layout, confidence: Confidence) -> Self {
        self.layout = layout;
        self.confidence = confidence;
        self
    }

    pub(crate) const fn source(mut self, source: &'static str) -> Self {
        self.source = source;
        self
    }

    pub(crate) const fn corroboration(mut self, corroboration: &'static str) -> Self {
        self.corroboration = corroboration;
        self
    }

    pub(crate) const fn table(mut self, table: &'static str) -> Self {
        self.table = Some(table);
        self
    }

    pub(crate) const fn ed2_message(mut self, ed2_message: &'static str) -> Self {
        self.ed2_message = Some(ed2_message);
        self
    }

    pub(crate) const fn note(mut self, note: &'static str) -> Self {
        self.note = Some(note);
        self
    }

    /// The field of this name, exactly as the table writes it.
    pub fn field(&self, name: &str) -> Option<&'static FieldInfo> {
        self.fields.iter().find(|field| field.name == name)
    }

    /// Whether every field's length is known.
    pub fn has_known_lengths(&self) -> bool {
        self.fields.iter().all(|field| field.wire.bytes().is_some())
    }

    /// Bytes of message data with every field of known length present.
    pub fn full_bytes(&self) -> usize {
        let fields = self.fields.iter().filter_map(|field| field.wire.bytes());
        usize::from(self.presence_bytes) + fields.sum::<usize>()
    }
}
