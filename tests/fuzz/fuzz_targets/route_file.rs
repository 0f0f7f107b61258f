//! The file of a route.
#![no_main]

use kit::any_input::route_file;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| route_file::run(bytes));
