//! `cargo xtask ci`: what must hold before anything is merged.

use std::fs;
use std::path::{Path, PathBuf};

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
    deny(steps)?;
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

/// Licences, sources, bans and advisories of all dependencies, as far as cargo-deny and its database are there.
fn deny(steps: &mut Steps) -> Result<()> {
    if !is_there(&mut cargo(["deny", "--version"])) {
        steps.leave_out(
            "cargo-deny is not installed: licences and sources are checked here, \
             advisories, bans and yanked versions are NOT",
        );
        return steps.step("licences and sources of all dependencies", licences::check);
    }
    let deny = ["--locked", "deny", "check", "bans", "licenses", "sources"];
    steps.run(&mut cargo(deny))?;
    let fetched = steps.step("the newest advisories", || {
        let fetch = ["deny", "fetch", "db"];
        Ok(is_there(cargo(fetch).current_dir(root())))
    })?;
    let (check, remark) = advisories(fetched, has_copy());
    if let Some(remark) = remark {
        steps.leave_out(remark);
    }
    if let Some(arguments) = check {
        let check = ["--locked", "deny", "check"];
        steps.run(cargo(check).args(arguments))?;
    }
    Ok(())
}

/// The arguments by which advisories can be checked, and what that leaves out: without a network a copy of the database serves.
fn advisories(
    fetched: bool,
    copy: bool,
) -> (Option<&'static [&'static str]>, Option<&'static str>) {
    match (fetched, copy) {
        (true, _) => (Some(&["advisories"]), None),
        (false, true) => (
            Some(&["--disable-fetch", "advisories"]),
            Some(
                "the advisory database cannot be fetched: advisories newer than its copy here are NOT checked",
            ),
        ),
        (false, false) => (
            None,
            Some(
                "the advisory database cannot be fetched, and no copy is here: advisories and yanked versions are NOT checked",
            ),
        ),
    }
}

/// Whether cargo-deny has fetched its database before: deny.toml leaves it where it is by default.
fn has_copy() -> bool {
    let home = std::env::home_dir().map(|home| home.join(".cargo"));
    let cargo = std::env::var_os("CARGO_HOME").map(PathBuf::from).or(home);
    cargo.is_some_and(|cargo| is_copy_in(&cargo.join("advisory-dbs")))
}

/// A lock file is there too, also where nothing could be fetched.
fn is_copy_in(databases: &Path) -> bool {
    let entries = fs::read_dir(databases).into_iter().flatten().flatten();
    entries
        .map(|entry| entry.path().join("crates"))
        .any(|advisories| advisories.is_dir())
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

#[cfg(test)]
mod what_is_checked {
    use super::*;

    #[test]
    fn advisories_are_checked_by_what_is_there_and_the_rest_is_reported() {
        assert_eq!(advisories(true, false), (Some(&["advisories"][..]), None));
        let (check, remark) = advisories(false, true);
        assert_eq!(check, Some(&["--disable-fetch", "advisories"][..]));
        assert!(remark.is_some_and(|remark| remark.contains("newer")));
        let (check, remark) = advisories(false, false);
        assert_eq!(check, None);
        assert!(remark.is_some_and(|remark| remark.contains("NOT checked")));
    }

    #[test]
    fn what_cargo_deny_leaves_without_a_network_is_no_copy() {
        let folder = std::env::temp_dir().join(format!("vsm-advisories-{}", std::process::id()));
        assert!(!is_copy_in(&folder));
        fs::create_dir_all(&folder).expect("a folder");
        fs::write(folder.join("db.lock"), "").expect("a file");
        assert!(!is_copy_in(&folder));
        let copy = folder.join("advisory-db-3157b0e258782691/crates");
        fs::create_dir_all(copy).expect("a folder");
        assert!(is_copy_in(&folder));
        fs::remove_dir_all(&folder).expect("it is there");
    }
}
