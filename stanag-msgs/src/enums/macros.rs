//! The macros that make a Rust type of an enumeration or a bitmap of the fact table.

/// Declares enumerations: `Type(wire) = "table name", confidence, source "..", description ".." {
/// Variant = value "text"; .. "range" "text"; }`.
macro_rules! enumerations {
    ($(
        $Name:ident($Raw:ident) = $table:literal, $confidence:ident, source $source:literal
        $(, description $description:literal)? {
            $($Variant:ident = $value:literal $text:literal;)*
            $(.. $range:literal $meaning:literal;)*
        }
    )*) => { $(
        #[doc = concat!("`", $table, "`", $(": ", $description,)? ".\n\nSource: ", $source, ".")]
        #[derive(Clone, Copy, Debug)]
        pub enum $Name {
            $(#[doc = concat!(stringify!($value), ": ", $text, ".")] $Variant,)*
            /// Any other value; it equals the variant with the same value, where there is one.
            Unknown($Raw),
        }

        impl $Name {
            /// The row in the table.
            pub const INFO: $crate::field::EnumInfo = $crate::field::EnumInfo {
                name: $table,
                kind: $crate::field::EnumKind::Enumeration,
                confidence: $crate::field::Confidence::$confidence,
                source: $source,
                description: concat!($($description)?),
                values: &[$(($value, stringify!($Variant), $text)),*],
                ranges: &[$(($range, $meaning)),*],
            };

            /// The meaning of a value on the wire.
            #[inline]
            pub const fn from_raw(raw: $Raw) -> Self {
                match raw {
                    $($value => Self::$Variant,)*
                    other => Self::Unknown(other),
                }
            }

            /// The value on the wire.
            #[inline]
            pub const fn raw(self) -> $Raw {
                match self {
                    $(Self::$Variant => $value,)*
                    Self::Unknown(raw) => raw,
                }
            }
        }

        $crate::enums::macros::value_impls!($Name($Raw));

        impl std::fmt::Display for $Name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                match Self::INFO.text(i64::from(self.raw())) {
                    Some(text) => f.write_str(text),
                    None => write!(f, "{}", self.raw()),
                }
            }
        }
    )* };
}

/// Declares bitmaps, in the same way: `BIT = value "text";`.
macro_rules! bitmaps {
    ($(
        $Name:ident($Raw:ident) = $table:literal, $confidence:ident, source $source:literal
        $(, description $description:literal)? {
            $($BIT:ident = $value:literal $text:literal;)*
            $(.. $range:literal $meaning:literal;)*
        }
    )*) => { $(
        #[doc = concat!("`", $table, "`", $(": ", $description,)? ".\n\nSource: ", $source, ".")]
        #[derive(Clone, Copy, Default)]
        pub struct $Name($Raw);

        impl $Name {
            $(#[doc = concat!(stringify!($value), ": ", $text, ".")] pub const $BIT: Self = Self($value);)*

            /// The row in the table.
            pub const INFO: $crate::field::EnumInfo = $crate::field::EnumInfo {
                name: $table,
                kind: $crate::field::EnumKind::Bitmap,
                confidence: $crate::field::Confidence::$confidence,
                source: $source,
                description: concat!($($description)?),
                values: &[$(($value, stringify!($BIT), $text)),*],
                ranges: &[$(($range, $meaning)),*],
            };

            /// The bits of this value on the wire.
            #[inline]
            pub const fn from_raw(raw: $Raw) -> Self {
                Self(raw)
            }

            /// The bits as on the wire.
            #[inline]
            pub const fn raw(self) -> $Raw {
                self.0
            }

            /// Whether no bit is set.
            pub const fn is_empty(self) -> bool {
                self.0 == 0
            }

            /// Whether all bits of `other` are set.
            pub const fn contains(self, other: Self) -> bool {
                self.0 & other.0 == other.0
            }

            /// Whether any bit of `other` is set.
            pub const fn intersects(self, other: Self) -> bool {
                self.0 & other.0 != 0
            }

            /// The bits of both.
            pub const fn union(self, other: Self) -> Self {
                Self(self.0 | other.0)
            }

            /// The bits of this without those of `other`.
            pub const fn without(self, other: Self) -> Self {
                Self(self.0 & !other.0)
            }
        }

        $crate::enums::macros::value_impls!($Name($Raw));

        impl std::ops::BitOr for $Name {
            type Output = Self;

            fn bitor(self, other: Self) -> Self {
                self.union(other)
            }
        }

        impl std::ops::BitAnd for $Name {
            type Output = Self;

            fn bitand(self, other: Self) -> Self {
                Self(self.0 & other.0)
            }
        }

        impl std::fmt::Debug for $Name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, "{}({:#x})", stringify!($Name), self.0)
            }
        }
    )* };
}

/// What enumerations and bitmaps share: both are equal, hashed and coded as their value on the wire. Not derived, because
/// `Unknown(1)` must equal the variant of value 1.
macro_rules! value_impls {
    ($Name:ident($Raw:ident)) => {
        impl PartialEq for $Name {
            fn eq(&self, other: &Self) -> bool {
                self.raw() == other.raw()
            }
        }

        impl Eq for $Name {}

        impl std::hash::Hash for $Name {
            fn hash<H: std::hash::Hasher>(&self, state: &mut H) {
                self.raw().hash(state);
            }
        }

        impl $crate::field::Field for $Name {
            const WIRE: $crate::field::Wire = <$Raw as $crate::field::Field>::WIRE;
            const ENUMERATION: Option<&'static $crate::field::EnumInfo> = Some(&Self::INFO);

            #[inline]
            fn read(reader: &mut $crate::bytes::Reader<'_>) -> Result<Self, $crate::bytes::Fault> {
                <$Raw as $crate::field::Field>::read(reader).map(Self::from_raw)
            }

            #[inline]
            fn write(
                self,
                writer: &mut $crate::bytes::Writer<'_>,
            ) -> Result<(), $crate::bytes::Fault> {
                $crate::field::Field::write(self.raw(), writer)
            }
        }
    };
}

pub(super) use {bitmaps, enumerations, value_impls};
