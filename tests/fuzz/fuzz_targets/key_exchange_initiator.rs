//! The initiator of a key exchange under any sequence of messages and time-outs.
#![no_main]

mod exchange;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| exchange::run(true, input));
