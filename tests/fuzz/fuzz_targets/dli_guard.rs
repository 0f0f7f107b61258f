//! A datagram with the trailer of a guard.
#![no_main]

use kit::any_input::guard;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| guard::trailer(bytes));
