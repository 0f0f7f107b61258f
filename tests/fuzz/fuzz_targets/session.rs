//! The whole bridge: a sequence of datagrams of both sides, of time-outs and of restarts.
#![no_main]

use kit::any_input::session;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| session::run(bytes));
