//! Answers of a vehicle to a ground station that transfers files.
#![no_main]

use kit::any_input::ftp;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| ftp::run(bytes));
