//! Running commands one after another, with their times, and keeping what was left out.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};

/// What has been done so far.
pub(crate) struct Steps {
    done: Vec<(String, Duration)>,
    left_out: Vec<String>,
}

impl Steps {
    pub(crate) fn new() -> Self {
        Self {
            done: Vec::new(),
            left_out: Vec::new(),
        }
    }

    /// Runs a command in the workspace's root; anything but status 0 is an error.
    pub(crate) fn run(&mut self, command: &mut Command) -> Result<()> {
        self.run_here(command.current_dir(root()))
    }

    /// Runs a command in its own folder; anything but status 0 is an error.
    pub(crate) fn run_here(&mut self, command: &mut Command) -> Result<()> {
        let line = line(command);
        eprintln!("\nxtask: {line}");
        let begun = Instant::now();
        let status = command
            .status()
            .with_context(|| format!("`{line}` cannot be started"))?;
        self.done.push((line.clone(), begun.elapsed()));
        if !status.success() {
            bail!("`{line}` ended with {status}");
        }
        Ok(())
    }

    /// Does something that is no command.
    pub(crate) fn step<T>(&mut self, what: &str, work: impl FnOnce() -> Result<T>) -> Result<T> {
        eprintln!("\nxtask: {what}");
        let begun = Instant::now();
        let result = work();
        self.done.push((what.to_owned(), begun.elapsed()));
        result
    }

    /// Reports that something cannot be checked here: an error in CI, which must not pass because a tool is missing.
    pub(crate) fn missing(&mut self, what: impl Into<String>) -> Result<()> {
        let what = what.into();
        if std::env::var_os("CI").is_some() {
            bail!("{what}; with `CI` set nothing may be left out");
        }
        self.leave_out(what);
        Ok(())
    }

    /// Reports, now and again at the end, that something was not done.
    pub(crate) fn leave_out(&mut self, what: impl Into<String>) {
        let what = what.into();
        eprintln!("\nxtask: LEFT OUT: {what}");
        self.left_out.push(what);
    }

    pub(crate) fn summary(&self) {
        eprintln!();
        for (line, time) in &self.done {
            eprintln!("xtask: {:7.1} s  {line}", time.as_secs_f64());
        }
        for what in &self.left_out {
            eprintln!("xtask: LEFT OUT: {what}");
        }
    }
}

/// The cargo that runs this.
pub(crate) fn cargo<'a>(arguments: impl IntoIterator<Item = &'a str>) -> Command {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(arguments);
    command
}

/// The program `generate`, as cargo builds it first.
pub(crate) fn generate() -> Command {
    cargo([
        "run",
        "--quiet",
        "--locked",
        "--package",
        "xtask",
        "--bin",
        "generate",
        "--",
    ])
}

/// A program of the workspace that was built beside this one.
pub(crate) fn built(name: &str) -> Result<Command> {
    let own = std::env::current_exe().context("the path of xtask")?;
    Ok(Command::new(own.with_file_name(name)))
}

/// Whether a command is there: it starts and ends with 0.
pub(crate) fn is_there(command: &mut Command) -> bool {
    command
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|status| status.success())
}

/// What follows `name` on the command line.
pub(crate) fn option(name: &str) -> Option<PathBuf> {
    let mut arguments = std::env::args().skip_while(|argument| argument != name);
    arguments.nth(1).map(PathBuf::from)
}

/// The root of the workspace.
pub(crate) fn root() -> PathBuf {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    own.ancestors().nth(2).unwrap_or(own).to_owned()
}

fn line(command: &Command) -> String {
    let program = Path::new(command.get_program());
    let name = program.file_stem().unwrap_or_default().to_string_lossy();
    let arguments = command.get_args().map(|a| a.to_string_lossy());
    core::iter::once(name)
        .chain(arguments)
        .collect::<Vec<_>>()
        .join(" ")
}

/// Cargo's profile of the program that flies.
pub(crate) const FLIGHT: &str = "flight";
