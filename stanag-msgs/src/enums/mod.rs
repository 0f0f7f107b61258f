//! The values of fields: enumerations and bitmaps, each with its sources.
//!
//! A value that sources do not name is kept (`Unknown`), so nothing is lost in passing through.
//! Values that this project had to fix itself stand in [`crate::disputed`] and are found here too.

mod authority;
mod configuration;
mod data_link;
mod engine;
mod flight;
pub(crate) mod macros;
mod mission;
mod payload;
mod private;
mod subsystem;

pub use crate::disputed::values::*;
pub use authority::*;
pub use configuration::*;
pub use data_link::*;
pub use engine::*;
pub use flight::*;
pub use mission::*;
pub use payload::*;
pub use private::*;
pub use subsystem::*;

use crate::table::Confidence;

/// Whether values exclude one another.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum EnumKind {
    /// One value at a time.
    Enumeration,
    /// Bits, any number at a time.
    Bitmap,
}

/// What the table says of an enumeration or bitmap.
#[derive(Debug)]
pub struct EnumInfo {
    /// Its name in the table.
    pub name: &'static str,
    /// Whether values exclude one another.
    pub kind: EnumKind,
    /// How far the values are to be trusted.
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
