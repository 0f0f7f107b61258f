//! A datagram of the DLI.
#![no_main]

use kit::any_input::dli;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| dli::datagram(bytes));
