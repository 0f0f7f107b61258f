//! `cargo xtask ci`: what must hold before anything is merged.

use anyhow::Result;

use crate::dependencies;
use crate::fuzz;
use crate::r#gen;
use crate::licences;
use crate::steps::{Steps, cargo, is_there, root};
use crate::tests;

/// Formatting, lints, documentation, dependencies, tests, a minute of fuzzing; the first that fails ends it.
pub(crate) fn run(steps: &mut Steps) -> Result<()> {
    steps.run(&mut cargo(["fmt", "--all", "--check"]))?;
    let clippy = [
        "clippy",
        "--workspace",
        "--all-targets",
        "--locked",
        "--",
        "-D",
        "warnings",
    ];
    steps.run(&mut cargo(clippy))?;
    let doc = ["doc", "--workspace", "--no-deps", "--locked"];
    steps.run(cargo(doc).env("RUSTDOCFLAGS", "-D warnings"))?;
    steps.step("generated files are current", || r#gen::run(&root(), true))?;
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
    tests::run(steps)?;
    fuzz::run(steps, fuzz::A_MINUTE)
}
