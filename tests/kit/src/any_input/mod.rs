//! What has to hold for any bytes at all. Each target takes bytes and panics where a promise is broken.
//!
//! `vsm/tests/any_input` runs them on mutated seeds and on what fuzzing has found before in every test run; `tests/fuzz` runs
//! them with coverage as a guide.

pub mod access_list;
pub mod config;
pub mod dli;
pub mod encrypted_link;
pub mod frame;
pub mod ftp;
pub mod guard;
pub mod key_exchange;
pub mod route_file;
pub mod session;
pub mod web_frame;

use std::path::PathBuf;

use crate::process::from_hex;

/// A target of `tests/fuzz`: its name, and what it does with bytes.
pub type Target = (&'static str, fn(&[u8]));

/// All of them.
pub const TARGETS: [Target; 15] = [
    ("access_list", access_list::run),
    ("config", config::run),
    ("dli_datagram", dli::datagram),
    ("dli_guard", guard::trailer),
    ("dli_wrapper", dli::wrapper),
    ("encrypted_link", encrypted_link::run),
    ("ftp", ftp::run),
    ("guard_exchange", guard::exchange),
    ("key_exchange_initiator", key_exchange::initiator),
    ("key_exchange_message", key_exchange::message),
    ("key_exchange_responder", key_exchange::responder),
    ("mavlink_frame", frame::run),
    ("route_file", route_file::run),
    ("session", session::run),
    ("web_frame", web_frame::run),
];

/// Where the inputs are that fuzzing has found: a file for each target, with an input in each line.
pub fn corpora() -> PathBuf {
    crate::workspace().join("tests/fuzz/corpora")
}

/// What fuzzing has found of a target and `cargo xtask fuzz --keep` has kept: the number of the line, and the input.
///
/// Nothing where there is no file: a target that is new has to be fuzzed first.
pub fn kept(target: &str) -> Vec<(usize, Vec<u8>)> {
    let file = corpora().join(format!("{target}.hex"));
    let text = std::fs::read_to_string(file).unwrap_or_default();
    let lines = (1..).zip(text.lines());
    lines
        .filter(|(_, line)| !line.starts_with('#'))
        .map(|(number, line)| (number, from_hex(line)))
        .collect()
}
