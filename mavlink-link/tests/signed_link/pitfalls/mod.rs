//! The pitfalls of other signing implementations that concern this layer, one test each, numbered as in
//! `docs/reference/promises.md`. Those of provisioning (14, 23, 27) are in `rollover/`, those of the key files (18, 28)
//! in `vsm/tests/keys/key_store.rs`; `c_library.rs` shows 7, 12 and 19 beside the C library
//! that has them.

mod clocks;
mod replays;
mod secrets;
mod signatures;
mod strangers;
