//! The table against the facts, the codec against vectors and against malformed data, the wrapper, the JSON form.

mod allocations;
mod ed25;
mod every_input;
#[cfg(feature = "guard")]
mod guard;
mod json;
mod malformed;
mod round_trip;
mod table;
mod vectors;
mod wrapper;
