//! Processes of `cargo xtask faults`: each writes to a file, and is killed, by its id, when its value is dropped.

use std::fs::{self, File, OpenOptions};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result, bail};
use rustix::process::{Pid, Signal, kill_process};

/// A process.
#[derive(Debug)]
pub(super) struct Running {
    child: Child,
    log: PathBuf,
    from: u64,
}

impl Running {
    /// Starts a command; what it prints is appended to `log`.
    pub(super) fn start(command: &mut Command, log: &Path) -> Result<Running> {
        let mut file = OpenOptions::new().create(true).append(true).open(log)?;
        writeln!(file, "---- {command:?}")?;
        let from = file.metadata()?.len();
        let error = file.try_clone()?;
        let child = command
            .stdin(Stdio::null())
            .stdout(file)
            .stderr(error)
            .spawn()
            .with_context(|| format!("{command:?}"))?;
        Ok(Running {
            child,
            log: log.to_owned(),
            from,
        })
    }

    pub(super) fn id(&self) -> u32 {
        self.child.id()
    }

    pub(super) fn signal(&self, signal: Signal) {
        let pid = i32::try_from(self.child.id()).ok().and_then(Pid::from_raw);
        if let Some(pid) = pid {
            // It may have ended by itself.
            let _ = kill_process(pid, signal);
        }
    }

    /// Its end, if it has ended.
    pub(super) fn ended(&mut self) -> Option<ExitStatus> {
        self.child.try_wait().ok().flatten()
    }

    /// Waits for its end.
    pub(super) fn wait(&mut self, within: Duration) -> Option<ExitStatus> {
        let end = Instant::now() + within;
        loop {
            let ended = self.ended();
            if ended.is_some() || Instant::now() > end {
                return ended;
            }
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// What it has printed.
    pub(super) fn printed(&self) -> String {
        let bytes = fs::read(&self.log).unwrap_or_default();
        let from = usize::try_from(self.from).unwrap_or(0).min(bytes.len());
        String::from_utf8_lossy(&bytes[from..]).into_owned()
    }

    /// Waits until it has printed this.
    pub(super) fn wait_for(&mut self, word: &str, within: Duration) -> Result<()> {
        let end = Instant::now() + within;
        while !self.printed().contains(word) {
            interrupted()?;
            if let Some(status) = self.ended() {
                bail!("it ended with {status}: {}", self.printed());
            }
            if Instant::now() > end {
                bail!("no {word:?} within {within:?}: {}", self.printed());
            }
            thread::sleep(Duration::from_millis(50));
        }
        Ok(())
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Runs a command to its end, or kills it: whether it ended with 0, and what it printed on standard output.
pub(super) fn finish(
    command: &mut Command,
    log: &Path,
    within: Duration,
) -> Result<(bool, String)> {
    // Several at once write to the same log.
    let number = NUMBER.fetch_add(1, Ordering::Relaxed);
    let output = log.with_extension(format!("out{number}"));
    let mut child = command
        .stdin(Stdio::null())
        .stdout(File::create(&output)?)
        .stderr(OpenOptions::new().create(true).append(true).open(log)?)
        .spawn()
        .with_context(|| format!("{command:?}"))?;
    let end = Instant::now() + within;
    let status = loop {
        if let Err(interrupted) = interrupted() {
            child.kill()?;
            child.wait()?;
            return Err(interrupted);
        }
        if let Some(status) = child.try_wait()? {
            break Some(status);
        }
        if Instant::now() > end {
            child.kill()?;
            child.wait()?;
            break None;
        }
        thread::sleep(Duration::from_millis(10));
    };
    let printed = fs::read_to_string(&output).unwrap_or_default();
    fs::remove_file(&output)?;
    Ok((status.is_some_and(|status| status.success()), printed))
}

/// Ends every wait of this program: its terminal, or whoever started it, is gone.
pub(super) fn interrupt() {
    INTERRUPTED.store(true, Ordering::Relaxed);
}

/// # Errors
/// It was interrupted.
pub(super) fn interrupted() -> Result<()> {
    if INTERRUPTED.load(Ordering::Relaxed) {
        bail!("interrupted");
    }
    Ok(())
}

static INTERRUPTED: AtomicBool = AtomicBool::new(false);
static NUMBER: AtomicU64 = AtomicU64::new(0);
