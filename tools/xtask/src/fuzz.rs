//! `cargo xtask fuzz`: every target of `tests/fuzz/`, from the seeds of recordings and golden vectors, for a while.
//!
//! The targets are those of cargo-fuzz, built with its flags, so that it can continue from the same corpus; but nothing
//! has to be installed. Input that breaks a target stays in `tests/fuzz/artifacts`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context as _, Result, bail};

use crate::steps::{Steps, cargo, is_there, option, root};

/// Seconds of fuzzing in CI, all targets together; as many run at once as there are cores.
pub(crate) const A_MINUTE: u32 = 60;

/// The value of `--seconds`, or a minute.
pub(crate) fn seconds() -> Result<u32> {
    let Some(given) = option("--seconds") else {
        return Ok(A_MINUTE);
    };
    let text = given.to_string_lossy();
    text.parse()
        .with_context(|| format!("--seconds {text}: expected a whole number"))
}

/// A build of the targets that runs beside something else; ended when it is dropped.
pub(crate) struct EarlyBuild(Option<Child>);

/// Begins to build the targets, on what the tests leave of the processor: they mostly wait, and the build takes minutes.
///
/// It prints nothing, because [`run`] builds again: that takes no time after this, and reports what is wrong.
pub(crate) fn build_early() -> Result<EarlyBuild> {
    let build = build(&host()?);
    let mut gently = Command::new("nice");
    gently
        .args(["-n", "19"])
        .arg(build.get_program())
        .args(build.get_args())
        .args(["--quiet", "--jobs", "1"])
        .env("RUSTFLAGS", FLAGS.join(" "))
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    // Without `nice` nothing is lost but time.
    Ok(EarlyBuild(gently.spawn().ok()))
}

impl EarlyBuild {
    /// Waits for its end, whether it built everything or not.
    pub(crate) fn finish(mut self) {
        if let Some(mut child) = self.0.take() {
            let _ = child.wait();
        }
    }
}

impl Drop for EarlyBuild {
    fn drop(&mut self) {
        if let Some(child) = &mut self.0 {
            let _ = child.kill();
            let _ = child.wait();
        }
    }
}

fn build(host: &str) -> Command {
    let mut build = cargo(["build", "--release", "--locked", "--bins", "--target", host]);
    build
        .arg("--manifest-path")
        .arg(root().join("tests/fuzz/Cargo.toml"))
        .env("RUSTFLAGS", FLAGS.join(" "));
    build
}

/// Builds the targets and runs each for its share of the time.
pub(crate) fn run(steps: &mut Steps, seconds: u32) -> Result<()> {
    let host = host()?;
    if !host.contains("linux") || !is_there(Command::new("c++").arg("--version")) {
        return steps.missing("fuzzing needs Linux and a C++ compiler `c++`");
    }
    let fuzz = root().join("tests/fuzz");
    // What was found stays there, so that the next run continues from it.
    let corpus = option("--corpus").unwrap_or_else(|| fuzz.join("corpus"));
    let corpus = std::path::absolute(&corpus)?;
    // With the whole workspace, as built before: for one package alone the dependencies' features differ.
    let seeds = [
        "test",
        "--locked",
        "--workspace",
        "--test",
        "any_input",
        "seeds",
    ];
    steps.run(cargo(seeds).env("VSM_CORPUS", &corpus))?;
    steps.run(&mut build(&host))?;
    let programs = fuzz.join("target").join(&host).join("release");
    let each = seconds / u32::try_from(TARGETS.len())?;
    let at_once = std::thread::available_parallelism().map_or(1, usize::from);
    for targets in TARGETS.chunks(at_once) {
        let names: Vec<&str> = targets.iter().map(|(name, _)| *name).collect();
        steps.step(&format!("fuzz {}", names.join(", ")), || {
            let start = |(name, longest): &(&str, u32)| {
                let mut command =
                    command(&programs.join(name), &fuzz, &corpus, name, *longest, each)?;
                command.spawn().with_context(|| (*name).to_owned())
            };
            let started: Result<Vec<_>> = targets.iter().map(start).collect();
            for (mut child, name) in started?.into_iter().zip(names) {
                let status = child.wait().context("a fuzz target")?;
                if !status.success() {
                    bail!("{name} ended with {status}: see tests/fuzz/artifacts/{name}");
                }
            }
            Ok(())
        })?;
    }
    Ok(())
}

fn command(
    program: &Path,
    fuzz: &Path,
    corpora: &Path,
    target: &str,
    longest: u32,
    seconds: u32,
) -> Result<Command> {
    let folder = |all: &Path| -> Result<PathBuf> {
        let folder = all.join(target);
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        Ok(folder)
    };
    let (corpus, artifacts) = (folder(corpora)?, folder(&fuzz.join("artifacts"))?);
    let mut command = Command::new(program);
    command
        .current_dir(root())
        .arg(format!("-max_total_time={}", seconds.max(1)))
        .arg(format!("-max_len={longest}"))
        .args([
            "-timeout=10",
            "-rss_limit_mb=2048",
            "-print_final_stats=1",
            "-verbosity=0",
        ])
        .arg(format!("-artifact_prefix={}/", artifacts.display()))
        .arg(corpus);
    Ok(command)
}

/// The compiler's own target: with it named, programs that run while building are not instrumented.
fn host() -> Result<String> {
    let output = Command::new("rustc").arg("-vV").output().context("rustc")?;
    let text = String::from_utf8_lossy(&output.stdout);
    let host = text.lines().find_map(|line| line.strip_prefix("host: "));
    match host {
        Some(host) => Ok(host.to_owned()),
        None => bail!("rustc -vV names no host"),
    }
}

/// The targets, and the longest input of each in bytes.
const TARGETS: [(&str, u32); 15] = [
    ("dli_wrapper", 548),
    ("dli_datagram", 548),
    ("dli_guard", 640),
    ("guard_exchange", 640),
    ("mavlink_frame", 1_024),
    ("ftp", 4_096),
    ("session", 4_096),
    ("config", 4_096),
    ("access_list", 4_096),
    ("web_frame", 4_096),
    ("route_file", 4_096),
    ("key_exchange_message", 249),
    ("key_exchange_initiator", 4_096),
    ("key_exchange_responder", 4_096),
    ("encrypted_link", 1_024),
];

/// Those of `cargo fuzz --sanitizer none`, and warnings as everywhere. The address sanitizer finds errors of `unsafe` code,
/// which the libraries forbid; it would cost a third of the build and half of the inputs.
const FLAGS: [&str; 9] = [
    "-Dwarnings",
    "-Cpasses=sancov-module",
    "-Cllvm-args=-sanitizer-coverage-level=4",
    "-Cllvm-args=-sanitizer-coverage-inline-8bit-counters",
    "-Cllvm-args=-sanitizer-coverage-pc-table",
    "-Cllvm-args=-sanitizer-coverage-trace-compares",
    "-Cllvm-args=-simplifycfg-branch-fold-threshold=0",
    "--cfg=fuzzing",
    "-Cforce-frame-pointers",
];
