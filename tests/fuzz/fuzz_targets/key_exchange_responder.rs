//! The responder of a key exchange under any sequence of messages and timeouts.
#![no_main]

use kit::any_input::key_exchange;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| key_exchange::responder(bytes));
