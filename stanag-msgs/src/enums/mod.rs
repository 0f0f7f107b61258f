//! The values of fields: enumerations and bitmaps, each with its sources.
//!
//! A value that sources do not name is kept (`Unknown`), so that it is sent on unchanged. Values that this project
//! had to choose itself are in `disputed`.

mod autonomy;
mod disputed;
mod flight;
mod macros;
mod payload;
mod system;
mod words;

pub use crate::field::{EnumInfo, EnumKind};
pub use autonomy::*;
pub use disputed::*;
pub use flight::*;
pub use payload::*;
pub use system::*;
