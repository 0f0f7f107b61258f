//! `cargo xtask test`: everything that tests need, then all tests.

use std::process::Command;

use anyhow::Result;

use crate::peers;
use crate::steps::{Steps, cargo, is_there};

/// Installs the peers, builds the programs that tests start, and runs all tests.
pub(crate) fn run(steps: &mut Steps) -> Result<()> {
    peers::install(steps)?;
    if !is_there(Command::new("tshark").arg("--version")) {
        steps.leave_out("tshark is not installed: the Wireshark dissector is not tested");
    }
    // The tests start the programs of the workspace as processes: cargo builds them for no test.
    steps.run(&mut cargo(["build", "--workspace", "--bins", "--locked"]))?;
    if is_there(&mut cargo(["nextest", "--version"])) {
        steps.run(&mut cargo(["nextest", "run", "--workspace", "--locked"]))?;
    } else {
        steps.leave_out(
            "cargo-nextest is not installed: `cargo test` runs the tests, without time limits",
        );
        steps.run(&mut cargo([
            "test",
            "--workspace",
            "--locked",
            "--all-targets",
        ]))?;
    }
    steps.run(&mut cargo(["test", "--workspace", "--locked", "--doc"]))
}
