//! A configuration file.
#![no_main]

#[path = "../../../vsm/tests/any_input/config.rs"]
mod config;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| config::run(bytes));
