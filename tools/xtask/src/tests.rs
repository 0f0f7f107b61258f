//! `cargo xtask test`: everything that tests need, then all tests.

use std::process::Command;

use anyhow::Result;

use crate::peers;
use crate::steps::{Steps, cargo, is_there};

/// Builds the programs that tests start as processes, and the tests.
///
/// Both in one command, so that they share one build of every dependency: of programs alone, cargo would build the
/// dependencies once more, without the features that only tests need.
pub(crate) fn build(steps: &mut Steps) -> Result<()> {
    steps.run(&mut cargo([
        "build",
        "--workspace",
        "--bins",
        "--tests",
        "--locked",
    ]))
}

/// Installs the peers and runs all tests, which must be built.
pub(crate) fn run(steps: &mut Steps) -> Result<()> {
    peers::install(steps)?;
    for what in cannot_be_tried(is_there) {
        steps.missing(what)?;
    }
    let all_cases = std::env::args().any(|argument| argument == "--all-cases");
    let tests = |arguments: &[&str]| {
        let mut command = cargo(arguments.iter().copied());
        if all_cases {
            command.env("VSM_ALL_CASES", "1");
        }
        command
    };
    if is_there(&mut cargo(["nextest", "--version"])) {
        steps.run(&mut tests(&["nextest", "run", "--workspace", "--locked"]))?;
    } else {
        steps.leave_out(
            "cargo-nextest is not installed: `cargo test` runs the tests, without time limits",
        );
        let all = ["test", "--workspace", "--locked", "--all-targets"];
        steps.run(&mut tests(&all))?;
    }
    steps.run(&mut cargo(["test", "--workspace", "--locked", "--doc"]))
}

/// What tests skip here because a program is missing.
fn cannot_be_tried(there: impl Fn(&mut Command) -> bool) -> Vec<String> {
    let programs = [
        ("tshark", "the Wireshark dissector is not tested"),
        ("dpkg-deb", "the package is not unpacked and run"),
        ("systemd-analyze", "the units are not verified"),
        ("chromium", "the operator's page is not opened in a browser"),
    ];
    let missing = programs
        .into_iter()
        .filter(|(name, _)| !there(Command::new(name).arg("--version")))
        .map(|(name, so)| format!("{name} is not installed: {so}"));
    let disk = "mount -t tmpfs tmpfs /mnt && command -v nsenter";
    let small = !there(Command::new("unshare").args(["-rm", "sh", "-c", disk]));
    let no_disk = "no mount namespace is available (unshare -rm): `vsm run` is not tested on a full and on a read-only disk";
    missing.chain(small.then(|| no_disk.to_owned())).collect()
}

#[cfg(test)]
mod what_is_missing {
    use super::*;

    #[test]
    fn whatever_is_missing_is_named_with_what_is_not_tested() {
        assert!(cannot_be_tried(|_| true).is_empty());
        let only = |name: &str| {
            let all = cannot_be_tried(|command| command.get_program() != name);
            let [what] = &all[..] else { panic!("{all:?}") };
            what.clone()
        };
        assert!(only("tshark").contains("dissector"));
        assert!(only("dpkg-deb").contains("package"));
        assert!(only("systemd-analyze").contains("units"));
        assert!(only("chromium").contains("browser"));
        assert!(only("unshare").contains("read-only disk"));
    }
}
