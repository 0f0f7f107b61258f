//! `cargo xtask ci`: what must hold before anything is merged.

use std::process::Command;

use anyhow::Result;

use crate::dependencies;
use crate::fuzz;
use crate::licences;
use crate::steps::{Steps, built, cargo, is_there};
use crate::tests;

/// Formatting, lints, documentation, dependencies, tests, a minute of fuzzing; the first that fails ends it.
pub(crate) fn run(steps: &mut Steps) -> Result<()> {
    steps.run(&mut cargo(["fmt", "--all", "--check"]))?;
    steps.run(cargo(["fmt", "--all", "--check"]).args(FUZZ))?;
    steps.run(&mut denying_warnings(&[
        "clippy",
        "--workspace",
        "--all-targets",
    ]))?;
    let doc = ["doc", "--workspace", "--no-deps", "--locked"];
    steps.run(cargo(doc).env("RUSTDOCFLAGS", "-D warnings"))?;
    if is_there(&mut cargo(["deny", "--version"])) {
        steps.run(&mut cargo(["--locked", "deny", "check"]))?;
    } else {
        steps.leave_out(
            "cargo-deny is not installed: licences and sources are checked here, \
             advisories, bans and yanked versions are NOT",
        );
        steps.step("licences and sources of all dependencies", licences::check)?;
    }
    steps.step("every declared dependency is used", dependencies::check)?;
    tests::build(steps)?;
    // Built with everything else: started by `cargo run` it would be built again, with other features of dependencies.
    steps.run(built("generate")?.args(["files", "--check"]))?;
    tests::run(steps)?;
    fuzz::run(steps, fuzz::A_MINUTE)
}

fn denying_warnings(what: &[&str]) -> Command {
    let mut command = cargo(what.iter().copied());
    command.args(["--locked", "--", "-D", "warnings"]);
    command
}

/// The workspace of the fuzz targets.
const FUZZ: [&str; 2] = ["--manifest-path", "tests/fuzz/Cargo.toml"];
