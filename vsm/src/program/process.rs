//! Shared by the subcommands: failures, the configuration, the runtime, the log, the signals that end them, and standard output.

use std::borrow::Cow;
use std::ffi::OsString;
use std::io::{self, IsTerminal as _, Read as _, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

use anyhow::{Context as _, anyhow, bail};
use tokio::runtime::{Builder, Runtime};
use tokio::signal::unix::{SignalKind, signal};
use tracing_subscriber::filter::LevelFilter;
use tracing_subscriber::fmt::time::{FormatTime as _, SystemTime};
use tracing_subscriber::{EnvFilter, fmt};

use crate::config::airside::AirsideConfig;
use crate::config::{Config, ForwardLink, LinkAddress, Stored, open_file};
use crate::shell::key_file::no_core_files;
use crate::shell::log_pipe::LogPipe;
use crate::shell::ownership::{act_as, other_owner};
use crate::shell::server::Gathering;

/// Why the program ends with another status than 0.
pub(crate) enum Failure {
    /// Status 1.
    Failed(anyhow::Error),
    /// Status 2: arguments or configuration.
    Bad(anyhow::Error),
    /// Status 3: what it would serve is erased.
    Zeroized(anyhow::Error),
}

pub(crate) fn failed(fault: impl Into<anyhow::Error>) -> Failure {
    Failure::Failed(fault.into())
}

pub(crate) fn bad(fault: impl Into<anyhow::Error>) -> Failure {
    Failure::Bad(fault.into())
}

/// Reads the configuration of a bridge for a command that uses its store or its keys. Where the store is another user's, as
/// that of a service is, and root runs the command, this process acts as that user from here on.
pub(crate) fn load(path: &Path) -> Result<Config, Failure> {
    let config = Config::load(path).map_err(bad)?;
    let shared = config.forwards().filter_map(|one| match &one.link {
        ForwardLink::Shared(link) => Some(link),
        ForwardLink::TcpIn(_) | ForwardLink::TcpOut(_) => None,
    });
    let devices = config.vehicles().map(|one| &one.link).chain(shared);
    let devices: Vec<&Path> = devices.filter_map(LinkAddress::device).collect();
    act_for(&config.store.dir, &devices)?;
    Ok(config)
}

/// Reads of a configuration what has to do with its store, for a command that shows it: a fault of another part of the file is
/// named, and is none of this command.
pub(crate) fn load_stored(path: &Path) -> Result<Stored, Failure> {
    let stored = Stored::load(path).map_err(bad)?;
    act_for(&stored.dir, &[])?;
    warn_of_fault(&stored);
    Ok(stored)
}

/// Names on standard error what is wrong elsewhere in the file.
pub(crate) fn warn_of_fault(stored: &Stored) {
    if let Some(fault) = &stored.fault {
        report_line(&format!(
            "vsm: WARNING: {fault}; what it has of the store is used all the same"
        ));
    }
}

/// The store that a configuration names, also where another part of the file is wrong: a running bridge is found by it.
pub(crate) fn named_store(path: &Path) -> Option<PathBuf> {
    let mut text = String::new();
    open_file(path).ok()?.read_to_string(&mut text).ok()?;
    let table: toml::Table = toml::from_str(&text).ok()?;
    let dir = table.get("store")?.get("dir")?.as_str()?;
    Some(path.parent().unwrap_or(Path::new("")).join(dir))
}

/// The same of an agent.
pub(crate) fn load_airside(path: &Path) -> Result<AirsideConfig, Failure> {
    let config = AirsideConfig::load(path).map_err(bad)?;
    let links = [&config.radio.get_ref().link, &config.px4.get_ref().link];
    let devices: Vec<&Path> = links.into_iter().filter_map(LinkAddress::device).collect();
    act_for(&config.store.dir, &devices)?;
    Ok(config)
}

/// Has root act as the owner of a folder, where that is another user: see `shell::ownership`. Not once another thread runs.
pub(crate) fn act_for(folder: &Path, devices: &[&Path]) -> Result<(), Failure> {
    let Some(owner) = other_owner(folder).map_err(failed)? else {
        return Ok(());
    };
    let (folder, user) = (folder.display(), owner.user);
    act_as(owner, devices).map_err(|cause| {
        failed(anyhow!(
            "{folder} belongs to user {user}, and this process may not act as that user ({cause}): run this as that user"
        ))
    })?;
    // The change of the user has switched core files on again.
    no_core_files();
    report_line(&format!(
        "vsm: acting as user {user}, to whom {folder} belongs"
    ));
    Ok(())
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
        // If standard error is closed, there is nowhere to report it.
        let _ = writeln!(io::stderr(), "vsm: a panic ends the whole program");
        std::process::abort();
    }));
}

/// One thread, sockets and timers.
pub(crate) fn runtime() -> Result<Runtime, Failure> {
    // The machine runs on one thread; the tasks around it only move bytes.
    build(&mut Builder::new_current_thread())
}

/// The same, for a bridge: frames of vehicles may gather before the thread reads them.
pub(crate) fn gathering_runtime(gathering: Arc<Gathering>) -> Result<Runtime, Failure> {
    build(Builder::new_current_thread().on_thread_park(move || gathering.gather()))
}

fn build(builder: &mut Builder) -> Result<Runtime, Failure> {
    (builder.enable_all().build())
        .context("no asynchronous runtime")
        .map_err(failed)
}

/// Done at SIGTERM or SIGINT, which no longer end the process from this call on.
pub(crate) fn stop_signal() -> Result<impl Future<Output = ()>, Failure> {
    // Registered here and not inside the future: a signal that arrives before the first poll must count too.
    let mut terminate = signal(SignalKind::terminate()).map_err(failed)?;
    let mut interrupt = signal(SignalKind::interrupt()).map_err(failed)?;
    Ok(async move {
        tokio::select! {
            _ = terminate.recv() => {}
            _ = interrupt.recv() => {}
        }
    })
}

/// How lines of the log are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum LogFormat {
    /// For people
    Text,
    /// One JSON object a line: timestamp, level, message
    Json,
}

/// The log of a program that serves, to standard error until this is dropped; RUST_LOG chooses how much, default info.
pub(crate) struct Log(Option<LogPipe>);

/// Begins the log. From here on the last error of the program is a line of the log too.
pub(crate) fn log(format: LogFormat) -> Result<Log, Failure> {
    let filter = filter(std::env::var_os("RUST_LOG")).map_err(bad)?;
    // A log pipe that nobody reads must not block the server.
    let Ok(pipe) = LogPipe::new(io::stderr()) else {
        return Ok(Log(None));
    };
    let writer = pipe.clone();
    // As https://no-color.org defines it: set and not empty.
    let plain = std::env::var_os("NO_COLOR").is_some_and(|value| !value.is_empty());
    let lines = tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(move || writer.clone())
        .with_ansi(io::stderr().is_terminal() && !plain)
        .with_target(false);
    // A second call in one process finds an existing log: that is fine.
    let _ = match format {
        LogFormat::Text => lines.try_init(),
        LogFormat::Json => lines.json().flatten_event(true).try_init(),
    };
    AS_JSON.store(format == LogFormat::Json, Ordering::Relaxed);
    Ok(Log(Some(pipe)))
}

/// Whether what goes to standard error beside the log is to be JSON too.
static AS_JSON: AtomicBool = AtomicBool::new(false);

/// Writes a line that no filter of the log may leave out: that the program serves, or why it ends.
pub(crate) fn announce(level: &str, line: &str) {
    let line = if AS_JSON.load(Ordering::Relaxed) {
        let mut timestamp = String::new();
        let _ = SystemTime.format_time(&mut fmt::format::Writer::new(&mut timestamp));
        serde_json::json!({"timestamp": timestamp, "level": level, "message": line}).to_string()
    } else {
        format!("vsm: {line}")
    };
    let line = for_reader(&line, io::stderr().is_terminal()).into_owned() + "\n";
    // Nobody is left to report to when standard error is gone.
    let _ = io::stderr().write_all(line.as_bytes());
}

/// RUST_LOG as it was meant.
fn filter(value: Option<OsString>) -> anyhow::Result<EnvFilter> {
    let Some(value) = value.filter(|value| !value.is_empty()) else {
        return Ok(EnvFilter::new("info"));
    };
    let expected = "expected off, error, warn, info, debug or trace, or TARGET=LEVEL with a module as target, separated by \
                    commas, such as \"info,vsm::shell=debug\"";
    let Some(text) = value.to_str() else {
        bail!("RUST_LOG is not text: {expected}");
    };
    for part in text.split(',').map(str::trim) {
        // `EnvFilter` takes a word that is no level as a target to log completely: "debgu" would silence everything else.
        let word = part.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
        if word && part.parse::<LevelFilter>().is_err() && !TARGETS.contains(&part) {
            bail!("RUST_LOG = \"{text}\": \"{part}\" is no level: {expected}");
        }
    }
    EnvFilter::builder()
        .parse(text)
        .map_err(|cause| anyhow!("RUST_LOG = \"{text}\": {cause}: {expected}"))
}

/// Crates that log, and may be named without a level.
const TARGETS: &[&str] = &["vsm", "mavlink_link", "tokio", "hyper", "hyper_util", "mio"];

impl Drop for Log {
    fn drop(&mut self) {
        if let Some(pipe) = &self.0 {
            pipe.finish();
        }
    }
}

/// Writes a whole report.
pub(crate) fn print(text: &str) -> Result<(), Failure> {
    let shown = for_reader(text, io::stdout().is_terminal());
    io::stdout().write_all(shown.as_bytes()).map_err(failed)
}

/// What a terminal may be sent: no text of a file, station or vehicle commands it.
fn for_reader(text: &str, terminal: bool) -> Cow<'_, str> {
    if terminal {
        escaped(text, &['\n', '\t'])
    } else {
        Cow::Borrowed(text)
    }
}

/// A text with its control characters escaped, other than these.
pub(crate) fn escaped<'a>(text: &'a str, allowed: &[char]) -> Cow<'a, str> {
    let acts = |one: char| one.is_control() && !allowed.contains(&one);
    if !text.contains(acts) {
        return Cow::Borrowed(text);
    }
    let mut shown = String::with_capacity(text.len());
    for one in text.chars() {
        if acts(one) {
            shown.extend(one.escape_default());
        } else {
            shown.push(one);
        }
    }
    Cow::Owned(shown)
}

/// Writes a line on the way.
pub(crate) fn print_line(line: &str) {
    // Nobody is left to report to when standard output is gone.
    let line = for_reader(line, io::stdout().is_terminal());
    let _ = writeln!(io::stdout(), "{line}");
}

/// Until it is dropped a command waits.
#[derive(Debug)]
pub(crate) struct Waiting {
    _ended: mpsc::Sender<()>,
}

/// Reports on standard error what a command waits for, and for how long at most, where that lasts: a person must not take a
/// wait for a hang. A thread does it, since some waits block.
pub(crate) fn waiting(what: &str, within: Duration) -> Waiting {
    let (_ended, end) = mpsc::channel();
    let line = format!("vsm: waiting for {what}; {} s at most", within.as_secs());
    std::thread::spawn(move || {
        if end.recv_timeout(NOTICE_AFTER) == Err(RecvTimeoutError::Timeout) {
            report_line(&line);
        }
    });
    Waiting { _ended }
}

/// Writes a line on the way to standard error: what a command waits for is no result.
pub(crate) fn report_line(line: &str) {
    let line = for_reader(line, io::stderr().is_terminal());
    // Nobody is left to report to when standard error is gone.
    let _ = writeln!(io::stderr(), "{line}");
}

/// A wait that is shorter needs no line.
const NOTICE_AFTER: Duration = Duration::from_millis(500);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_filter_that_is_misspelt_is_an_error_that_names_it() {
        for (given, named) in [
            ("debgu", "\"debgu\" is no level"),
            ("info,wran", "\"wran\" is no level"),
            (
                "vsm=debgu",
                "RUST_LOG = \"vsm=debgu\": error parsing level filter",
            ),
            ("info, 6", "\"6\" is no level"),
        ] {
            let fault = filter(Some(given.into())).expect_err(given).to_string();
            assert!(fault.contains(named), "{fault}");
            assert!(fault.contains("expected off, error, warn"), "{fault}");
        }
    }

    #[test]
    fn no_text_commands_a_terminal() {
        let text = "fault\u{1b}[2J\r\u{9b}1m\tend\n";
        let shown = for_reader(text, true);
        assert_eq!(shown, "fault\\u{1b}[2J\\r\\u{9b}1m\tend\n");
        assert_eq!(for_reader(text, false), text);
        assert_eq!(escaped("a\nb", &[]), "a\\nb");
    }

    #[test]
    fn a_filter_is_a_level_or_names_targets_and_none_is_info() {
        for (given, read) in [
            (None, "info"),
            (Some(""), "info"),
            (Some("DEBUG"), "debug"),
            (Some("off"), "off"),
            (Some("warn,vsm::shell=debug"), "vsm::shell=debug,warn"),
            (Some("vsm"), "vsm=trace"),
        ] {
            let filter =
                filter(given.map(OsString::from)).unwrap_or_else(|fault| panic!("{fault}"));
            assert_eq!(filter.to_string(), read);
        }
    }
}
