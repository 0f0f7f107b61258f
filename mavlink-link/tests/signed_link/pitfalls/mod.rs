//! The falls of other signers that concern this layer, one test each, numbered as in the list of
//! falls. Those of provisioning (14, 23, 27) are in `provisioning/`, those of the key files (18, 28)
//! in `vsm/tests/key_store_survives_failures.rs`; `c_library.rs` shows 7, 12 and 19 beside the C library
//! that falls for them.

mod clocks;
mod replays;
mod secrets;
mod signatures;
mod strangers;
