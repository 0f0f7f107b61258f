//! Bytes of a MAVLink link, whole and in pieces.
#![no_main]

use kit::any_input::frame;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| frame::run(bytes));
