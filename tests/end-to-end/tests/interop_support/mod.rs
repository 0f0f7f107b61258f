//! What the tests against other people's programs share: where things are, and processes that end with
//! the test, however it ends.

#![allow(dead_code, reason = "each test file uses its part")]
#![allow(
    clippy::print_stderr,
    reason = "a seed and a story are told to who reads the test"
)]

pub(crate) mod bridge;
pub(crate) mod line;
pub(crate) mod relay;
pub(crate) mod signing;

use std::ffi::OsStr;
use std::fmt::Write as _;
use std::fs;
use std::io::{BufRead as _, BufReader, Read, Write as _};
use std::net::UdpSocket;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Mutex};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// The folder `tests/`, with the peers and the data.
pub(crate) fn here() -> &'static Path {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    package.parent().expect("tests/")
}

/// A program of the workspace, beside the directory of the test executables.
///
/// Cargo builds the programs of other packages for no test, so whoever runs this one has to.
pub(crate) fn program(name: &str) -> PathBuf {
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

/// The Python of the tests' environment, with the pinned peers.
pub(crate) fn peers_python() -> PathBuf {
    let path = here().join("interop/.venv/bin/python");
    assert!(
        path.exists(),
        "{} is not there: `cargo xtask test` makes it, with pinned peers in it",
        path.display()
    );
    path
}

/// A Python 3.11 or newer that needs no packages: that of the environment, or the system's.
pub(crate) fn plain_python() -> PathBuf {
    let path = here().join("interop/.venv/bin/python");
    if path.exists() {
        path
    } else {
        PathBuf::from("python3")
    }
}

/// A number nobody has chosen; print it, so that a failure can be had again.
pub(crate) fn seed_from_clock() -> u64 {
    let seed = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .map_or(1, |d| u64::from(d.subsec_nanos()) ^ d.as_secs() << 20);
    eprintln!("seed {seed}");
    seed
}

/// A UDP port of the loopback address that nobody uses now.
pub(crate) fn free_udp_port() -> u16 {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a loopback socket");
    socket.local_addr().expect("its address").port()
}

/// A TCP port of the loopback address that nobody uses now.
pub(crate) fn free_tcp_port() -> u16 {
    let socket = std::net::TcpListener::bind("127.0.0.1:0").expect("a loopback socket");
    socket.local_addr().expect("its address").port()
}

/// Writes a key file as programs want it: hex, for its owner alone.
pub(crate) fn write_key(path: &Path, key: &[u8; 32]) {
    let mut hex = key.iter().fold(String::new(), |mut hex, byte| {
        let _ = write!(hex, "{byte:02x}");
        hex
    });
    hex.push('\n');
    fs::write(path, hex).expect("the key file is written");
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt as _;
        fs::set_permissions(path, fs::Permissions::from_mode(0o600)).expect("its mode is set");
    }
}

/// A process that is ended, by its id, when this value goes; what it prints is kept.
pub(crate) struct Running {
    name: String,
    child: Child,
    output: Arc<Mutex<String>>,
    readers: Vec<JoinHandle<()>>,
}

impl Running {
    /// Starts a program.
    pub(crate) fn start<A: AsRef<OsStr>>(
        program: &Path,
        arguments: impl IntoIterator<Item = A>,
    ) -> Self {
        Self::start_with(program, arguments, Stdio::null())
    }

    /// Starts a program that lines can be typed to.
    pub(crate) fn start_shell<A: AsRef<OsStr>>(
        program: &Path,
        arguments: impl IntoIterator<Item = A>,
    ) -> Self {
        Self::start_with(program, arguments, Stdio::piped())
    }

    fn start_with<A: AsRef<OsStr>>(
        program: &Path,
        arguments: impl IntoIterator<Item = A>,
        input: Stdio,
    ) -> Self {
        let name = program
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let mut child = Command::new(program)
            .args(arguments)
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .stdin(input)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap_or_else(|error| panic!("{}: {error}", program.display()));
        let output = Arc::new(Mutex::new(String::new()));
        let readers = vec![
            collect(child.stdout.take(), &output),
            collect(child.stderr.take(), &output),
        ];
        Self {
            name,
            child,
            output,
            readers,
        }
    }

    /// Its process id.
    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// All that it has printed so far, both streams in order of arrival.
    pub(crate) fn output(&self) -> String {
        self.output
            .lock()
            .unwrap_or_else(|e| e.into_inner())
            .clone()
    }

    /// Types a line.
    pub(crate) fn type_line(&mut self, line: &str) {
        let input = self.child.stdin.as_mut().expect("a shell");
        writeln!(input, "{line}").expect("it reads");
    }

    /// Waits until it prints a line with `word` in it.
    pub(crate) fn wait_for(&mut self, word: &str, limit: Duration) {
        let end = Instant::now() + limit;
        while !self.output().contains(word) {
            if let Some(status) = self.child.try_wait().expect("its state") {
                panic!(
                    "{} ended with {status} before it said `{word}`:\n{}",
                    self.name,
                    self.output()
                );
            }
            assert!(
                Instant::now() < end,
                "{} did not say `{word}` within {limit:?}:\n{}",
                self.name,
                self.output()
            );
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// Waits for its end; `None` where it goes on after `limit`.
    pub(crate) fn wait(&mut self, limit: Duration) -> Option<ExitStatus> {
        let end = Instant::now() + limit;
        loop {
            if let Some(status) = self.child.try_wait().expect("its state") {
                for reader in self.readers.drain(..) {
                    let _ = reader.join();
                }
                return Some(status);
            }
            if Instant::now() >= end {
                return None;
            }
            thread::sleep(Duration::from_millis(20));
        }
    }

    /// Asks it to end (SIGTERM), as an operator would.
    pub(crate) fn terminate(&self) {
        let sent = Command::new("kill")
            .args(["-TERM", &self.id().to_string()])
            .status();
        assert!(
            sent.is_ok_and(|s| s.success()),
            "{} was not there to be ended",
            self.name
        );
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // It may have ended by itself; what counts is that nothing stays behind.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Runs a filter: gives it `input`, returns its standard output; its failure is the test's.
pub(crate) fn filter<A: AsRef<OsStr>>(
    program: &Path,
    arguments: impl IntoIterator<Item = A>,
    input: String,
) -> String {
    let mut child = Command::new(program)
        .args(arguments)
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap_or_else(|error| panic!("{}: {error}", program.display()));
    let mut stdin = child.stdin.take().expect("a pipe");
    // Its own thread: a filter answers before it has read everything.
    let writer = thread::spawn(move || stdin.write_all(input.as_bytes()));
    let output = child.wait_with_output().expect("its output");
    let _ = writer.join();
    assert!(
        output.status.success(),
        "{} ended with {}:\n{}",
        program.display(),
        output.status,
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).expect("text")
}

fn collect(stream: Option<impl Read + Send + 'static>, to: &Arc<Mutex<String>>) -> JoinHandle<()> {
    let to = Arc::clone(to);
    thread::spawn(move || {
        let Some(stream) = stream else { return };
        let mut lines = BufReader::new(stream);
        let mut line = Vec::new();
        while lines.read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
            let text = String::from_utf8_lossy(&line);
            to.lock().unwrap_or_else(|e| e.into_inner()).push_str(&text);
            line.clear();
        }
    })
}
