//! The entry of tests and CI: `cargo xtask test` and `cargo xtask ci`.
//!
//! The local check is the CI check. What cannot be run on a machine is left out aloud, never silently.

#![expect(clippy::print_stderr, reason = "a program for people to read")]

mod bench;
mod ci;
mod deb;
mod dependencies;
mod fuzz;
mod r#gen;
mod licences;
mod man;
mod metrics;
mod peers;
mod steps;
mod tests;

use std::process::ExitCode;

use crate::steps::Steps;

fn main() -> ExitCode {
    let task = std::env::args().nth(1).unwrap_or_default();
    let mut steps = Steps::new();
    let result = match task.as_str() {
        "test" => tests::run(&mut steps),
        "ci" => ci::run(&mut steps),
        "gen" => generate(&mut steps),
        "bench" => bench::run(&mut steps),
        "fuzz" => fuzz::seconds().and_then(|seconds| fuzz::run(&mut steps, seconds)),
        "deb" => deb::build(&mut steps).map(|package| eprintln!("{}", package.display())),
        "metrics" => metrics::run(),
        "man" => man::run().map(|tree| eprintln!("{}", tree.display())),
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

/// Writes what is made from the message table; with `--check` only says what is stale.
fn generate(steps: &mut Steps) -> anyhow::Result<()> {
    let check = std::env::args().any(|argument| argument == "--check");
    steps.step("generated files", || r#gen::run(&steps::root(), check))
}

const USAGE: &str = "\
usage: cargo xtask TASK

  test    install the Python peers, build every program, run all tests
  ci      formatting, lints, documentation, generated files, licences and advisories, then `test`
  gen     write the dissector, the support table and the reference; --check: only say what is stale
  bench   run every bench, the C library and pymavlink beside, and print the figures as Markdown
  fuzz    build every fuzz target and run all of them for a minute together; --seconds N: for so long
  deb     build target/deb/vsm_VERSION_ARCHITECTURE.deb; --bins DIR: of programs that are built; --out DIR
  man     write manual pages and completions of bash, zsh and fish to target/man; --out DIR: elsewhere
  metrics print sizes, cycles of modules, test binaries and words to replace; --root DIR, --edges, --check
  peers   only install the Python peers into tests/interop/.venv";
