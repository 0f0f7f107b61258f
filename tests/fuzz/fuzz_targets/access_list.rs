//! An access list.
#![no_main]

use kit::any_input::access_list;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| access_list::run(bytes));
