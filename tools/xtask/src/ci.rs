//! `cargo xtask ci`: what must hold before anything is merged.

use anyhow::Result;

use crate::bench;
use crate::dependencies;
use crate::fuzz;
use crate::licences;
use crate::metrics::{self, packages};
use crate::steps::{Steps, built, cargo, is_there, root};
use crate::tests;

/// Formatting, lints, documentation, dependencies, module cycles, tests, a minute of fuzzing; the first that fails ends it.
pub(crate) fn run(steps: &mut Steps) -> Result<()> {
    steps.run(&mut cargo(["fmt", "--all", "--check"]))?;
    steps.run(cargo(["fmt", "--all", "--check"]).args(FUZZ))?;
    let clippy = ["clippy", "--workspace", "--all-targets", "--locked"];
    steps.run(cargo(clippy).args(DENY))?;
    steps.run(
        cargo(["clippy", "--bins", "--locked", "--target-dir", "target"])
            .args(FUZZ)
            .args(DENY)
            // Nothing is linked by clippy: spare it the build of libFuzzer.
            .env("CUSTOM_LIBFUZZER_PATH", "/unused/libfuzzer.a"),
    )?;
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
    steps.step("no modules use each other in a cycle", metrics::check)?;
    publish(steps)?;
    // Before anything runs beside it. Of the optimised code: a debug build's ratios say nothing about it.
    bench::check(steps)?;
    tests::build(steps)?;
    // Built with everything else: started by `cargo run` it would be built again, with other features of dependencies.
    steps.run(built("generate")?.args(["files", "--check"]))?;
    let early = fuzz::build_early()?;
    tests::run(steps)?;
    steps.step("end of the early build of the fuzz targets", || {
        early.finish();
        Ok(())
    })?;
    fuzz::run(steps, fuzz::A_MINUTE)
}

/// Packs the crates that are meant to be published, and builds each from its package alone.
fn publish(steps: &mut Steps) -> Result<()> {
    let mut command = cargo(["publish", "--dry-run", "--locked", "--allow-dirty"]);
    let mut found = false;
    for package in packages(&root())? {
        // An empty list of registries is `publish = false`.
        if package["publish"].is_null() {
            let name = package["name"].as_str().unwrap_or_default();
            command.args(["--package", name]);
            found = true;
        }
    }
    if found {
        steps.run(&mut command)
    } else {
        Ok(())
    }
}

const DENY: [&str; 3] = ["--", "-D", "warnings"];

/// The workspace of the fuzz targets.
const FUZZ: [&str; 2] = ["--manifest-path", "tests/fuzz/Cargo.toml"];
