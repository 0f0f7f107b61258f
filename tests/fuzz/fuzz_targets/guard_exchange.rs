//! What two guards send each other beside datagrams of the DLI.
#![no_main]

use kit::any_input::guard;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| guard::exchange(bytes));
