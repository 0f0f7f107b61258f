//! `vsm airside pair`: a Unix socket in the agent's store folder. Any user who may enter the folder may open the window.
//!
//! The client sends one line, the code or an empty line for a new one. The agent answers in lines: first the code, then the
//! events of the window until it is closed. A client that disconnects closes it. `vsm guard pair` and `vsm guard rotate`
//! send requests to a running bridge in the same way.

use std::io::{self, BufRead as _, BufReader, Write as _};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream as BlockingStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use mavlink_link::exchange::PairingCode;
use tokio::io::{AsyncBufReadExt as _, AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{UnixListener, UnixStream};
use zeroize::Zeroizing;

use super::key_file::system_random;

fn path(store: &Path) -> PathBuf {
    store.join("pair.sock")
}

/// Opens the socket. The store's lock is held, so an existing socket is a leftover.
///
/// # Errors
/// The system's; paths of over 107 bytes too.
pub fn listen(store: &Path) -> io::Result<UnixListener> {
    let path = path(store);
    match std::fs::remove_file(&path) {
        Err(cause) if cause.kind() != io::ErrorKind::NotFound => return Err(cause),
        _ => {}
    }
    let listener = UnixListener::bind(&path)?;
    // The folder has mode 0700, so nobody else gets in between bind and this.
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600))?;
    Ok(listener)
}

/// The connection of a person who opens the window.
#[derive(Debug)]
pub struct Asker(UnixStream);

impl Asker {
    /// Reads the request: the code, typed or made here. `None` for an invalid code, which is reported to the client.
    pub async fn greet(stream: UnixStream) -> Option<(Asker, PairingCode)> {
        let (mut asker, line) = Asker::listen_to(stream).await?;
        match Asker::code(line.trim()) {
            Ok(code) => Some((asker, code)),
            Err(fault) => {
                asker.send_line(&format!("refused: {fault}")).await;
                None
            }
        }
    }

    /// Reads the one line of a request.
    pub(super) async fn listen_to(stream: UnixStream) -> Option<(Asker, Zeroizing<String>)> {
        // Bounded: a client that never sends a line end cannot make the agent's memory grow.
        let mut stream = tokio::io::BufReader::new(stream.take(LINE));
        let mut line = Zeroizing::new(String::with_capacity(LINE as usize));
        stream.read_line(&mut line).await.ok()?;
        Some((Asker(stream.into_inner().into_inner()), line))
    }

    /// The code as it was typed, or a new one.
    pub(super) fn code(typed: &str) -> Result<PairingCode, String> {
        if typed.is_empty() {
            PairingCode::generate(&mut system_random).map_err(|fault| fault.to_string())
        } else {
            PairingCode::parse(typed).map_err(|fault| fault.to_string())
        }
    }

    /// Sends a line. A disconnected client is no error: [`Asker::gone`] shows it. A client that does not read loses the
    /// line, since the agent's links wait meanwhile.
    pub async fn send_line(&mut self, line: &str) {
        let line = Zeroizing::new(format!("{line}\n"));
        let _ = tokio::time::timeout(TELL_WITHIN, self.0.write_all(line.as_bytes())).await;
    }

    /// Completes when the client has disconnected.
    pub async fn gone(&mut self) {
        let mut byte = [0];
        while self.0.read(&mut byte).await.is_ok_and(|count| count > 0) {}
    }
}

/// Sends a request to a running agent or bridge, and shows its output line by line until it ends.
///
/// # Errors
/// None is running on this store.
pub fn ask(store: &Path, request: &str, mut show: impl FnMut(&str)) -> io::Result<()> {
    let mut stream = BlockingStream::connect(path(store))?;
    let line = Zeroizing::new(format!("{request}\n"));
    stream.write_all(line.as_bytes())?;
    let mut answer = BufReader::new(stream);
    loop {
        let mut line = Zeroizing::new(String::new());
        // Whoever owns the store answers, perhaps to root, whose memory is not its to fill.
        if io::Read::take(&mut answer, MAX_SHOWN).read_line(&mut line)? == 0 {
            return Ok(());
        }
        if !line.ends_with('\n') && line.len() as u64 >= MAX_SHOWN {
            let problem = format!("a line of its answer has more than {MAX_SHOWN} bytes");
            return Err(io::Error::new(io::ErrorKind::InvalidData, problem));
        }
        show(line.trim_end_matches(['\r', '\n']));
    }
}

/// Longer than a code with its hyphens.
const LINE: u64 = 256;
/// Longer than any line that is shown.
const MAX_SHOWN: u64 = 65_536;
/// Time limit for each line: a client that does not read blocks the agent for at most this long. (A socket buffers thousands
/// of lines.)
const TELL_WITHIN: Duration = Duration::from_millis(100);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_shown_one_by_one_and_an_endless_one_ends_at_the_bound() {
        let folder = tempfile::tempdir().unwrap();
        let listener = std::os::unix::net::UnixListener::bind(path(folder.path())).unwrap();
        let server = std::thread::spawn(move || {
            let (mut client, _) = listener.accept().unwrap();
            std::io::Write::write_all(&mut client, b"one\ntwo\n").unwrap();
            while std::io::Write::write_all(&mut client, &[b'x'; 4_096]).is_ok() {}
        });
        let mut shown = Vec::new();
        let refused = ask(folder.path(), "pair", |line| shown.push(line.to_owned()));
        server.join().unwrap();
        assert_eq!(shown, ["one", "two"]);
        let refused = refused.unwrap_err().to_string();
        assert!(refused.contains("more than 65536 bytes"), "{refused}");
    }

    #[tokio::test(start_paused = true)]
    async fn an_asker_that_does_not_read_holds_nobody_up_for_long() {
        let (ours, _theirs) = UnixStream::pair().unwrap();
        let mut asker = Asker(ours);
        let line = "x".repeat(4_096);
        // Far more than a socket takes; were a line to wait, the test would not end.
        for _ in 0..1_000 {
            asker.send_line(&line).await;
        }
    }
}
