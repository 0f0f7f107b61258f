//! Bytes at both ends of an encrypted link.
#![no_main]

use kit::any_input::encrypted_link;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| encrypted_link::run(bytes));
