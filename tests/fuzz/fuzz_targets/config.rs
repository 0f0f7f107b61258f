//! A configuration file.
#![no_main]

use kit::any_input::config;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| config::run(bytes));
