//! Parameters: reading, setting and listing, and PX4's answers.
//!
//! PX4 sends an integer's four bytes in the place of the float (byte union); a [`Value`] is
//! distinguished by PARAM_VALUE.param_type. PX4 stores any value, in range or not: the caller
//! checks the range before it sets one.

mod client;
mod value;

pub use client::{Client, Entry, Event, Refusal, StartError, Timing};
pub use mavlink::dialects::development::MavParamError;
pub use value::{HASH_CHECK, NO_INDEX, Name, NameError, Value, named_value};
