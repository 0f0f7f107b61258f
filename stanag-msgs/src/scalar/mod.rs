//! The scalars that fields are made of: integers of one to five bytes, binary angles, scaled
//! quantities, times and texts.
//!
//! Every scalar keeps the value that is on the wire, so decoding and encoding lose nothing; methods
//! give its meaning (`radians`, `si`, `unix_ms`). All are big-endian.

mod integer;
mod quantity;
mod text;

pub use crate::field::Field;
pub use integer::{I24, Integer, U24, U40};
pub use quantity::*;
pub use text::{Text, UnsizedBytes, UnsizedText};
