//! Enumerations and bitmaps of Edition 2.5, as the table's rows name them. Where `enums` of Edition 4 has the same
//! name, the values there are those of Edition 4's sources.

mod configuration;
mod data_link;
mod flight_command;
mod general;
mod mission;
mod payload;
mod private;
mod subsystems;
mod system_id;

pub(super) use configuration::*;
pub(super) use data_link::*;
pub(super) use flight_command::*;
pub(super) use general::*;
pub(super) use mission::*;
pub(super) use payload::*;
pub(super) use private::*;
pub(super) use subsystems::*;
pub(super) use system_id::*;

/// Declares enumerations and bitmaps: `NAME = "table name", kind, "description" { value Name "text"; .. "range" "text"; }`.
macro_rules! values {
    ($(
        $NAME:ident = $table:literal, $kind:ident, $description:literal {
            $($value:literal $Value:ident $text:literal;)*
            $(.. $range:literal $meaning:literal;)*
        }
    )*) => { $(
        pub(in crate::ed25) static $NAME: $crate::field::EnumInfo = $crate::field::EnumInfo {
            name: $table,
            kind: $crate::field::EnumKind::$kind,
            confidence: $crate::field::Confidence::A,
            source: "Edition 2.5",
            description: $description,
            values: &[$(($value, stringify!($Value), $text)),*],
            ranges: &[$(($range, $meaning)),*],
        };
    )* };
}

use values;
