//! The whole bridge: a sequence of datagrams of both sides, of time-outs and of restarts.
#![no_main]
#![allow(
    dead_code,
    reason = "the names of the operations are for those that make seeds"
)]

#[path = "../../../vsm/tests/any_input/session.rs"]
mod session;

use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| session::run(bytes));
