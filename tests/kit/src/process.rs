//! Programs under test: they are ended with the test, by their process id, however the test ends.

use std::ffi::OsStr;
use std::fmt::Write as _;
use std::fs;
use std::io::{BufRead as _, BufReader, Read, Write as _};
use std::net::{TcpListener, UdpSocket};
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// A program of the workspace, beside the folder of the test executables.
///
/// Cargo does not build the programs of other packages for a test: build them first
/// (`cargo build --workspace --bins`).
pub fn program(name: &str) -> PathBuf {
    let test = std::env::current_exe().expect("the path of the test executable");
    let path = test
        .ancestors()
        .nth(2)
        .expect("the test executable lies in <profile>/deps")
        .join(format!("{name}{}", std::env::consts::EXE_SUFFIX));
    assert!(
        path.is_file(),
        "{} is not built: run `cargo xtask test`, or `cargo build --workspace --bins` first",
        path.display()
    );
    path
}

/// Runs a program of the workspace to its end in this folder, with the most detailed log; returns whether it
/// succeeded, and everything that it printed.
pub fn run_in(folder: &Path, name: &str, arguments: &[&str]) -> (bool, Vec<u8>) {
    let output = Command::new(program(name))
        .args(arguments)
        .env("RUST_LOG", "trace")
        .current_dir(folder)
        .output()
        .unwrap_or_else(|error| panic!("{name}: {error}"));
    let printed = [output.stdout, output.stderr].concat();
    (output.status.success(), printed)
}

/// A child process that is killed, by its id, when this value is dropped.
#[derive(Debug)]
pub struct KillOnDrop(pub Child);

impl Drop for KillOnDrop {
    fn drop(&mut self) {
        // It may have ended by itself, so an error is ignored: what counts is that no process is left.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A process that is killed when this value is dropped; what it prints is kept.
#[derive(Debug)]
pub struct Running {
    name: String,
    child: KillOnDrop,
    output: Arc<Mutex<String>>,
    readers: Vec<JoinHandle<()>>,
}

impl Running {
    /// Starts a program.
    pub fn start<A: AsRef<OsStr>>(program: &Path, arguments: impl IntoIterator<Item = A>) -> Self {
        Self::spawn(Command::new(program).args(arguments))
    }

    /// Starts a program that [`type_line`](Self::type_line) can type to.
    pub fn start_shell<A: AsRef<OsStr>>(
        program: &Path,
        arguments: impl IntoIterator<Item = A>,
    ) -> Self {
        Self::spawn_with(Command::new(program).args(arguments), Stdio::piped())
    }

    /// Starts a command.
    pub fn spawn(command: &mut Command) -> Self {
        Self::spawn_with(command, Stdio::null())
    }

    fn spawn_with(command: &mut Command, input: Stdio) -> Self {
        let program = Path::new(command.get_program());
        let name = program.file_name().unwrap_or_default();
        let name = name.to_string_lossy().into_owned();
        let mut child = command
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .stdin(input)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| panic!("{name}: {error}"));
        let output = Arc::new(Mutex::new(String::new()));
        // Read to the end, so that the program never blocks on a full pipe.
        let readers = vec![
            collect(child.stdout.take(), &output),
            collect(child.stderr.take(), &output),
        ];
        Self {
            name,
            child: KillOnDrop(child),
            output,
            readers,
        }
    }

    /// Its process id.
    pub fn id(&self) -> u32 {
        self.child.0.id()
    }

    /// Everything that it has printed so far, both streams in order of arrival.
    pub fn output(&self) -> String {
        let output = self.output.lock();
        output.unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Types a line to it.
    pub fn type_line(&mut self, line: &str) {
        let input = self.child.0.stdin.as_mut().expect("started as a shell");
        writeln!(input, "{line}").expect("it reads");
    }

    /// Waits until it has printed `word`; panics where it ends or `limit` passes before.
    pub fn wait_for(&mut self, word: &str, limit: Duration) {
        if let Err(why) = self.try_wait_for(word, limit) {
            panic!("{why}");
        }
    }

    /// Waits until it has printed `word`.
    ///
    /// # Errors
    ///
    /// It ended, or `limit` passed, before that; with everything that it printed.
    pub fn try_wait_for(&mut self, word: &str, limit: Duration) -> Result<(), String> {
        let end = Instant::now() + limit;
        while !self.output().contains(word) {
            if let Some(status) = self.wait(Duration::ZERO) {
                // It may have printed the word just before it ended.
                if self.output().contains(word) {
                    break;
                }
                let (name, output) = (&self.name, self.output());
                return Err(format!(
                    "{name} ended with {status} before it printed `{word}`:\n{output}"
                ));
            }
            if Instant::now() >= end {
                let (name, output) = (&self.name, self.output());
                return Err(format!(
                    "{name} did not print `{word}` within {limit:?}:\n{output}"
                ));
            }
            thread::sleep(POLL);
        }
        Ok(())
    }

    /// Waits for its end; `None` where it still runs after `limit`.
    pub fn wait(&mut self, limit: Duration) -> Option<ExitStatus> {
        let end = Instant::now() + limit;
        loop {
            if let Some(status) = self.child.0.try_wait().expect("its state") {
                for reader in self.readers.drain(..) {
                    let _ = reader.join();
                }
                return Some(status);
            }
            if Instant::now() >= end {
                return None;
            }
            thread::sleep(POLL);
        }
    }

    /// Requests its end (SIGTERM), as an operator would.
    pub fn terminate(&self) {
        self.signal("TERM");
    }

    /// Sends it a signal by name, such as `HUP`.
    pub fn signal(&self, name: &str) {
        let sent = Command::new("kill")
            .args([&format!("-{name}"), &self.id().to_string()])
            .status();
        assert!(
            sent.is_ok_and(|status| status.success()),
            "{} had ended before SIG{name}",
            self.name
        );
    }

    /// Kills it (SIGKILL), as a crash would.
    pub fn kill(&mut self) {
        self.child.0.kill().expect("it runs");
        self.child.0.wait().expect("its end");
    }
}

/// Runs a filter: gives it `input`, returns its standard output; panics where it fails.
pub fn filter<A: AsRef<OsStr>>(
    program: &Path,
    arguments: impl IntoIterator<Item = A>,
    input: String,
) -> String {
    let output = piped(program, arguments, input);
    assert!(
        output.status.success(),
        "{} ended with {}:\n{}",
        program.display(),
        output.status,
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).expect("text")
}

/// The same for a program that may end with any status.
///
/// # Panics
///
/// It cannot be started, or prints what is not text.
pub fn filter_with_status<A: AsRef<OsStr>>(
    program: &Path,
    arguments: impl IntoIterator<Item = A>,
    input: String,
) -> (String, ExitStatus) {
    let output = piped(program, arguments, input);
    let text = String::from_utf8(output.stdout).expect("text");
    (text, output.status)
}

fn piped<A: AsRef<OsStr>>(
    program: &Path,
    arguments: impl IntoIterator<Item = A>,
    input: String,
) -> Output {
    let mut child = Command::new(program)
        .args(arguments)
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap_or_else(|error| panic!("{}: {error}", program.display()));
    let mut stdin = child.stdin.take().expect("a pipe");
    // In its own thread: a filter may write answers before it has read all of its input, and would block on a full
    // pipe.
    let writer = thread::spawn(move || stdin.write_all(input.as_bytes()));
    let output = child.wait_with_output().expect("its output");
    let _ = writer.join();
    output
}

/// A UDP port of the loopback address that nobody uses now, and that the system will not assign later.
pub fn free_udp_port() -> u16 {
    free_port(|port| UdpSocket::bind(("127.0.0.1", port)).is_ok())
}

/// The same for TCP.
pub fn free_tcp_port() -> u16 {
    free_port(|port| TcpListener::bind(("127.0.0.1", port)).is_ok())
}

/// Below the ports that the system assigns (32768 and above): such a port could be given to another test before the
/// program under test has opened it.
fn free_port(is_free: impl Fn(u16) -> bool) -> u16 {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    static BEGIN: OnceLock<u32> = OnceLock::new();
    // 12,000 to 31,999.
    const FIRST: u32 = 12_000;
    const PORTS: u32 = 20_000;
    // Tests are processes of their own, so each starts at another number, and returns no port twice.
    let begin = *BEGIN.get_or_init(|| {
        let now = SystemTime::now().duration_since(UNIX_EPOCH);
        now.map_or(0, |now| now.subsec_micros()) ^ std::process::id().wrapping_mul(7_919)
    });
    for _ in 0..PORTS {
        let number = begin.wrapping_add(NEXT.fetch_add(1, Ordering::Relaxed));
        let port = u16::try_from(FIRST + number % PORTS).unwrap_or(0);
        if is_free(port) {
            return port;
        }
    }
    panic!("no port of {FIRST} to {} is free", FIRST + PORTS);
}

/// Writes a key file as the programs expect it: hexadecimal, readable by its owner alone.
pub fn write_key(path: &Path, key: &[u8; 32]) {
    fs::write(path, hex(key) + "\n").expect("the key file is written");
    fs::set_permissions(path, fs::Permissions::from_mode(0o600)).expect("its mode is set");
}

/// Bytes as lower-case hexadecimal.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

/// Bytes from hexadecimal.
pub fn from_hex(text: &str) -> Vec<u8> {
    let pair = |at: usize| u8::from_str_radix(&text[at..at + 2], 16).expect("hexadecimal");
    (0..text.len() / 2).map(|at| pair(2 * at)).collect()
}

fn collect(stream: Option<impl Read + Send + 'static>, to: &Arc<Mutex<String>>) -> JoinHandle<()> {
    let to = Arc::clone(to);
    thread::spawn(move || {
        let Some(stream) = stream else { return };
        let mut lines = BufReader::new(stream);
        let mut line = Vec::new();
        while lines.read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
            let text = String::from_utf8_lossy(&line);
            to.lock()
                .unwrap_or_else(PoisonError::into_inner)
                .push_str(&text);
            line.clear();
        }
    })
}

/// How often a process is checked while a test waits for it.
const POLL: Duration = Duration::from_millis(10);

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: Duration = Duration::from_secs(20);

    fn shell(script: &str) -> Running {
        Running::start(Path::new("sh"), ["-c", script])
    }

    #[test]
    fn waits_for_a_line_and_terminates_by_id() {
        let mut process = shell("echo ready; exec sleep 60");
        process.wait_for("ready", LIMIT);
        assert!(process.wait(Duration::ZERO).is_none());
        process.terminate();
        assert!(!process.wait(LIMIT).expect("it ends").success());
    }

    #[test]
    fn reports_what_was_printed_where_the_line_does_not_come() {
        let why = shell("echo no room >&2; exit 3").try_wait_for("ready", LIMIT);
        let why = why.expect_err("it ended");
        assert!(why.contains("no room") && why.contains('3'), "{why}");
        let mut silent = shell("exec sleep 60");
        assert!(silent.try_wait_for("ready", Duration::ZERO).is_err());
    }

    #[test]
    fn a_shell_reads_what_is_typed_and_a_filter_what_is_given() {
        let mut shell = Running::start_shell(Path::new("sh"), ["-c", "read a; echo got $a"]);
        shell.type_line("it");
        shell.wait_for("got it", LIMIT);
        assert_eq!(filter(Path::new("cat"), [""; 0], "text".into()), "text");
    }

    #[test]
    fn hexadecimal_round_trips() {
        assert_eq!(hex(&[0x00, 0xa5]), "00a5");
        assert_eq!(from_hex("00a5"), [0x00, 0xa5]);
    }
}
