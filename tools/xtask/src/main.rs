//! The entry of tests and CI: `cargo xtask test` and `cargo xtask ci`.
//!
//! The local check is the CI check. What cannot be run on a machine is reported, and is an error where `CI` is set.

#![expect(clippy::print_stderr, reason = "a program for people to read")]

mod attacks;
mod bench;
mod ci;
mod conform;
mod corpora;
mod deb;
mod dependencies;
mod faults;
mod fuzz;
mod kill;
mod licences;
mod metrics;
mod peers;
mod portable;
mod sbom;
mod sizing;
mod steps;
mod tests;

use std::process::ExitCode;

use crate::steps::Steps;

fn main() -> ExitCode {
    let task = std::env::args().nth(1).unwrap_or_default();
    let mut steps = Steps::new();
    let result = match task.as_str() {
        "test" => tests::build(&mut steps).and_then(|()| tests::run(&mut steps)),
        "ci" => ci::run(&mut steps),
        "gen" => generate(&mut steps),
        "bench" => bench::run(&mut steps),
        "fuzz" => fuzz::task(&mut steps),
        "conform" => conform::run(&mut steps),
        "kill" => kill::run(&mut steps),
        "attacks" => attacks::run(&mut steps),
        "faults" => faults::run(&mut steps),
        "sizing" => sizing::run(),
        "deb" => deb::build(&mut steps).map(|package| eprintln!("{}", package.display())),
        "portable" => portable::build(&mut steps).map(|folder| eprintln!("{}", folder.display())),
        "sbom" => sbom::write().map(|list| eprintln!("{}", list.display())),
        "metrics" => metrics::run(),
        "unused" => dependencies::check(),
        "man" => manual(&mut steps),
        "peers" => peers::install(&mut steps).map(drop),
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    };
    steps.summary();
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("xtask: FAILED: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// Writes the generated files, or with `--check` only reports which are stale.
fn generate(steps: &mut Steps) -> anyhow::Result<()> {
    let check = std::env::args().any(|argument| argument == "--check");
    let check = check.then_some("--check");
    steps.run(steps::generate().arg("files").args(check))
}

/// Writes manual pages and completions.
fn manual(steps: &mut Steps) -> anyhow::Result<()> {
    let out = steps::option("--out").unwrap_or_else(|| steps::root().join("target/man"));
    steps.run(steps::generate().arg("man").arg(&out))?;
    eprintln!("{}", out.display());
    Ok(())
}

const USAGE: &str = "\
usage: cargo xtask TASK

  test    install the Python peers, build every program, run all tests; --all-cases: with every counted case, not the share
          that CI takes
  ci      check formatting, lints, documentation, generated files, dependencies and licences, then `test` and `fuzz`
  gen     write the dissector, the support table and the reference; --check: only list what is stale
  bench   run every bench beside the C library, mavlink-router (MAVLINK_ROUTERD, or mavlink-routerd of the search path), MAVSDK and
          pymavlink; print figures, goals and verdicts as Markdown; --table: only the benches of the goals; --docs: those, and
          write docs/reference/performance.md and its picture
  fuzz    build and run every fuzz target, for a minute in all; --seconds N: for N seconds in all; --corpus DIR: from and to there;
          --keep: do not fuzz, write what covers most of what was found to tests/fuzz/corpora
  kill    kill -9 the bridge and the agent at random moments of flights, and check what must not be lost; --times N,
          --side-by-side N, --seed N
  attacks run the tests that attack with at least the counts of a hostile review: forged and replayed frames, bad signatures, floods,
          random messages; print the table
  faults  three nodes and etcd in network namespaces: kill, cut off and slow them at random under flying vehicles, and check the
          wire; --times N, --seed N, --vehicles N, --side-by-side N, --bins DIR: with the programs of DIR; --docs: write
          docs/reference/fleet-faults.md; --plant: replay a frame, which has to be found. Needs root, ip and etcd
  sizing  calculate and simulate what a fleet on many nodes needs, and what breaks first; --vehicles N, --nodes N, --of-vsm N: vehicles
          of each VSM, --seed N; --docs: write docs/reference/fleet-sizing.md
  conform judge our own bridge by the conformance suite; further arguments are dli-check's, such as --rule AUTH-002;
          conform mavlink judges the simulated PX4 by mavlink-check, further arguments are that program's
  deb     build target/deb/vsm_VERSION_ARCHITECTURE.deb; --bins DIR: pack the programs of DIR; --out DIR;
          --architecture NAME: what those programs are for, where it is not this machine
  portable  build static programs into target/portable/ARCHITECTURE; --architecture x86_64|aarch64
  sbom    write target/vsm.cdx.json, the CycloneDX list of what the flight binary is made of; --out FILE: elsewhere
  man     write manual pages and completions of bash, zsh and fish to target/man; --out DIR: elsewhere
  metrics print code sizes, module cycles, test binaries and words to replace; --root DIR, --edges, --check
  unused  list the dependencies that are declared and not used
  peers   install the Python peers into tests/interop/.venv";
