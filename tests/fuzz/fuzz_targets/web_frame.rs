//! A frame of a web client.
#![no_main]

use kit::any_input::web_frame;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| web_frame::run(bytes));
