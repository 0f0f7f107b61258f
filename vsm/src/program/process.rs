//! What the subcommands share: how they fail, the runtime, the log, the signals that end them, and standard output.

use std::io::{self, IsTerminal as _, Write};

use anyhow::Context as _;
use tokio::runtime::{Builder, Runtime};
use tokio::signal::unix::{SignalKind, signal};
use tracing_subscriber::EnvFilter;

use crate::shell::log_pipe::LogPipe;

/// Why the program ends with another status than 0.
pub(crate) enum Failure {
    /// Status 1.
    Failed(anyhow::Error),
    /// Status 2: arguments or configuration.
    Bad(anyhow::Error),
}

pub(crate) fn failed(fault: impl Into<anyhow::Error>) -> Failure {
    Failure::Failed(fault.into())
}

pub(crate) fn bad(fault: impl Into<anyhow::Error>) -> Failure {
    Failure::Bad(fault.into())
}

/// From here on a panic, in whichever thread or task, ends the whole process at once, by SIGABRT: in release builds
/// `panic = "abort"` does, in others this hook.
///
/// A runtime would keep the panic of one task to itself, and a process that lives on without that task sends heartbeats
/// for a bridge that serves nobody.
pub(crate) fn end_on_panic() {
    let report = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |panic| {
        report(panic);
        // Nowhere is left to report it when standard error is gone.
        let _ = writeln!(io::stderr(), "vsm: a panic ends the whole program");
        std::process::abort();
    }));
}

/// One thread, sockets and timers.
pub(crate) fn runtime() -> Result<Runtime, Failure> {
    Builder::new_current_thread()
        .enable_all()
        .build()
        .context("no asynchronous runtime")
        .map_err(failed)
}

/// Done at SIGTERM or SIGINT, which no longer end the process from this call on.
pub(crate) fn stop_signal() -> Result<impl Future<Output = ()>, Failure> {
    // Registered here and not inside the future: a signal that comes before its first poll must count too.
    let mut terminate = signal(SignalKind::terminate()).map_err(failed)?;
    let mut interrupt = signal(SignalKind::interrupt()).map_err(failed)?;
    Ok(async move {
        tokio::select! {
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
    })
}

/// The log of a program that serves, to standard error until this is dropped; RUST_LOG chooses how much, default info.
pub(crate) struct Log(Option<LogPipe>);

pub(crate) fn log() -> Log {
    let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new("info"));
    // A pipe that nobody reads must not stop what is served.
    let Ok(pipe) = LogPipe::new(io::stderr()) else {
        return Log(None);
    };
    let writer = pipe.clone();
    // A second call in one process finds a log already: that is fine.
    let _ = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(move || writer.clone())
        .with_ansi(io::stderr().is_terminal())
        .with_target(false)
        .try_init();
    Log(Some(pipe))
}

impl Drop for Log {
    fn drop(&mut self) {
        if let Some(pipe) = &self.0 {
            pipe.finish();
        }
    }
}

/// Writes a whole report.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    io::stdout().write_all(text.as_bytes()).map_err(failed)
}

/// Writes a line on the way.
pub(crate) fn say(line: &str) {
    // Nobody is left to tell when standard output is gone.
    let _ = writeln!(io::stdout(), "{line}");
}
