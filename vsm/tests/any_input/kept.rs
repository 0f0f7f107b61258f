//! What fuzzing has found before (`tests/fuzz/corpora`), at its target: a test for each, so that they run side by side.

use std::panic::catch_unwind;

use kit::any_input::{TARGETS, corpora, kept};
use kit::every;

macro_rules! targets {
    ($($target:ident)*) => {
        const TESTED: [&str; TARGETS.len()] = [$(stringify!($target)),*];

        $(
            #[test]
            fn $target() {
                holds_on_what_was_kept(stringify!($target));
            }
        )*
    };
}

targets! {
    access_list
    config
    dli_datagram
    dli_guard
    dli_wrapper
    encrypted_link
    ftp
    guard_exchange
    key_exchange_initiator
    key_exchange_message
    key_exchange_responder
    mavlink_frame
    route_file
    session
    web_frame
}

fn holds_on_what_was_kept(target: &str) {
    let mut targets = TARGETS.into_iter();
    let (_, run) = targets
        .find(|(name, _)| *name == target)
        .expect("a target of that name");
    let inputs = kept(target);
    assert!(!inputs.is_empty(), "nothing was kept of {target}");
    // A whole bridge for each input: all of them would take a debug build too long.
    let nth = if target == "session" { every(2) } else { 1 };
    for (line, bytes) in inputs.into_iter().step_by(nth) {
        // The target's own panic has been printed by then.
        let held = catch_unwind(|| run(&bytes));
        assert!(held.is_ok(), "line {line} of {target}.hex");
    }
}

#[test]
fn each_target_has_its_file_and_each_file_its_target() {
    assert_eq!(TARGETS.map(|(name, _)| name), TESTED);
    let entries = std::fs::read_dir(corpora()).expect("the corpora");
    let mut files: Vec<String> = entries
        .map(|entry| entry.expect("a file").file_name())
        .map(|name| name.into_string().expect("an ASCII name"))
        .collect();
    files.sort();
    assert_eq!(files, TESTED.map(|name| format!("{name}.hex")));
}
