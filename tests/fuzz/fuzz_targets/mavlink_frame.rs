//! Bytes of a MAVLink link, whole and in pieces.
#![no_main]

#[path = "../../../vsm/tests/any_input/frame.rs"]
mod frame;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| frame::run(bytes));
