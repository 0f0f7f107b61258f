//! How much of an attack a test makes: a little in each test run, and with `cargo xtask attacks` at least as much as a hostile review
//! of the whole program once made.
//!
//! `VSM_ATTACKS=FILE` asks for all of it. Each test appends a row of what it made to that file, once nothing has come of it.

use std::env::var_os;
use std::fs::OpenOptions;
use std::io::Write as _;

/// What the review counted; `tools/xtask/src/attacks.rs` holds the sums against its figures.
pub const FRAMES: &str = "forged or replayed frames";
/// Frames that another key has signed.
pub const SIGNATURES: &str = "bad signatures";
/// Datagrams in somebody's name, at a bridge that flies meanwhile.
pub const DATAGRAMS: &str = "flood datagrams";
/// Messages that chance has made.
pub const MESSAGES: &str = "random messages";

/// `few`, or `all` where all is asked for.
#[must_use]
pub fn times(few: u64, all: u64) -> u64 {
    match var_os(FILE) {
        Some(_) => all,
        None => few,
    }
}

/// A row of the table: `made` of what the review counted as `kind`, by which test, and what was held.
pub fn report(kind: &str, made: u64, held: &str) {
    let Some(file) = var_os(FILE) else {
        return;
    };
    let thread = std::thread::current();
    let test = thread.name().unwrap_or("a test");
    let opened = OpenOptions::new().create(true).append(true).open(file);
    let mut file = opened.expect("the file of VSM_ATTACKS");
    // One write, so that rows of tests that run side by side stay whole.
    let row = format!("{kind}\t{made}\t{test}\t{held}\n");
    file.write_all(row.as_bytes()).expect("there is room");
}

const FILE: &str = "VSM_ATTACKS";
