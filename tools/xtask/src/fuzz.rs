//! `cargo xtask fuzz`: every target of `tests/fuzz/`, from the seeds of recordings and golden vectors and from what was found before,
//! for a while; with `--keep` what covers most of what was found is written into the repository: nothing may fuzz
//! into the same corpus meanwhile, or the merge ends at an input that has been replaced.
//!
//! The targets are those of cargo-fuzz, built with its flags, so that it can continue from the same corpus; but nothing
//! has to be installed. Input that breaks a target stays in `tests/fuzz/artifacts`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context as _, Result, bail};

use crate::corpora;
use crate::steps::{Steps, cargo, is_there, option, root};

/// Seconds of fuzzing in CI, all targets together; as many run at once as there are cores.
pub(crate) const A_MINUTE: u32 = 60;

/// `cargo xtask fuzz`.
pub(crate) fn task(steps: &mut Steps) -> Result<()> {
    if std::env::args().any(|argument| argument == "--keep") {
        keep(steps)
    } else {
        run(steps, seconds()?)
    }
}

/// The value of `--seconds`, or a minute.
fn seconds() -> Result<u32> {
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
    let corpus = corpus()?;
    let Some(programs) = prepare(steps, &corpus)? else {
        return Ok(());
    };
    let each = seconds / u32::try_from(TARGETS.len())?;
    let at_once = std::thread::available_parallelism().map_or(1, usize::from);
    for targets in TARGETS.chunks(at_once) {
        let names: Vec<&str> = targets.iter().map(|(name, _)| *name).collect();
        steps.step(&format!("fuzz {}", names.join(", ")), || {
            let start = |(name, longest): &(&str, u32)| {
                let mut command = command(&programs, name, *longest)?;
                command
                    .arg(format!("-max_total_time={}", each.max(1)))
                    .args(["-print_final_stats=1", "-verbosity=0"])
                    .arg(folder(&corpus, name)?);
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

/// Builds the targets, and writes what covers most of what each has found before into the repository.
fn keep(steps: &mut Steps) -> Result<()> {
    let corpus = corpus()?;
    // The first folder of each merge: what its seeds cover need not be kept. Those of an earlier merge may be made no longer.
    let merged = root().join("tests/fuzz/target/merged");
    if merged.exists() {
        fs::remove_dir_all(&merged).with_context(|| merged.display().to_string())?;
    }
    let Some(programs) = prepare(steps, &merged)? else {
        return Ok(());
    };
    for (name, longest) in TARGETS {
        let kept = steps.step(&format!("keep what covers most of {name}"), || {
            let control = merged.join(format!("{name}.control"));
            let mut command = command(&programs, name, longest)?;
            command
                .arg("-set_cover_merge=1")
                .arg(format!("-merge_control_file={}", control.display()))
                .arg(folder(&merged, name)?)
                .arg(folder(&corpus, name)?);
            let status = command.status().with_context(|| name.to_owned())?;
            if !status.success() {
                bail!("{name} ended with {status}");
            }
            let control = fs::read_to_string(&control).context("what the merge has noted")?;
            corpora::keep(name, &control, usize::try_from(longest)?)
        })?;
        let file = root().join(format!("tests/fuzz/corpora/{name}.hex"));
        fs::write(&file, kept.text).with_context(|| file.display().to_string())?;
        eprintln!("{}", kept.summary);
    }
    Ok(())
}

/// Where what was found stays, so that the next run continues from it.
fn corpus() -> Result<PathBuf> {
    let given = option("--corpus").unwrap_or_else(|| root().join("tests/fuzz/corpus"));
    Ok(std::path::absolute(&given)?)
}

/// Writes the seeds and what was kept into `corpus` and builds the targets: the folder of their programs, if that can be.
fn prepare(steps: &mut Steps, corpus: &Path) -> Result<Option<PathBuf>> {
    let host = host()?;
    if !host.contains("linux") || !is_there(Command::new("c++").arg("--version")) {
        steps.missing("fuzzing needs Linux and a C++ compiler `c++`")?;
        return Ok(None);
    }
    // With the whole workspace, as built before: for one package alone the dependencies' features differ.
    let seeds = [
        "test",
        "--locked",
        "--workspace",
        "--test",
        "any_input",
        "seeds",
    ];
    steps.run(cargo(seeds).env("VSM_CORPUS", corpus))?;
    steps.run(&mut build(&host))?;
    let target = root().join("tests/fuzz/target");
    Ok(Some(target.join(host).join("release")))
}

/// The program of a target, with what holds however it is run.
fn command(programs: &Path, target: &str, longest: u32) -> Result<Command> {
    let artifacts = folder(&root().join("tests/fuzz/artifacts"), target)?;
    let mut command = Command::new(programs.join(target));
    command
        .current_dir(root())
        .arg(format!("-max_len={longest}"))
        .args(["-timeout=10", "-rss_limit_mb=2048"])
        .arg(format!("-artifact_prefix={}/", artifacts.display()));
    Ok(command)
}

/// That of a target, which is made if need be.
fn folder(all: &Path, target: &str) -> Result<PathBuf> {
    let folder = all.join(target);
    fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    Ok(folder)
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
pub(crate) const TARGETS: [(&str, u32); 15] = [
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
