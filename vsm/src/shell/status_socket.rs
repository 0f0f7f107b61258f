//! `vsm status`, `vsm reload` and `vsm check-vehicle`: Unix sockets in the store folder that answer in JSON any user who
//! may enter the folder. One returns the status, one the outcome of a reload, one the settings of the vehicles.

use std::io::{self, Read, Write as _};
use std::os::fd::OwnedFd;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::{SocketAddr, UnixStream};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use serde::{Deserialize, Serialize};
use socket2::{Domain, SockAddr, Socket, Type};
use tokio::io::AsyncWriteExt;
use tokio::net::UnixListener;

/// Returns the status.
pub const STATUS: &str = "status.sock";
/// Reloads the configuration.
pub const RELOAD: &str = "reload.sock";

/// Accesses the files of the vehicles.
pub const FILES: &str = "files.sock";

/// Reads the settings of the vehicles, and returns them.
pub const SETTINGS: &str = "settings.sock";

/// Orders to zeroize.
pub const ZEROIZE: &str = "zeroize.sock";

/// The first byte of an order to zeroize that is valid in flight too; any other byte for one that is not.
pub const IN_FLIGHT: u8 = b'f';

/// The answer to an order to zeroize, once it is stored and the reachable agents have answered.
#[derive(Debug, Serialize, Deserialize)]
pub struct Ordered {
    /// Why it is refused.
    pub refused: Option<String>,
    /// The outcome for what is not on this computer: agents, and PX4's key.
    #[serde(default)]
    pub beyond: Vec<String>,
}

/// Where a socket of a store folder is.
#[must_use]
pub fn path(store: &Path, name: &str) -> PathBuf {
    store.join(name)
}

/// Whether the socket can be made: its path is short enough, and no folder has its name.
///
/// # Errors
/// It cannot.
pub fn check(store: &Path, name: &str) -> io::Result<()> {
    let path = path(store, name);
    if std::fs::symlink_metadata(&path).is_ok_and(|about| about.is_dir()) {
        let problem = format!(
            "{} is a folder, expected a socket or nothing: remove it",
            path.display()
        );
        return Err(io::Error::new(io::ErrorKind::IsADirectory, problem));
    }
    SocketAddr::from_pathname(path).map(drop)
}

/// Opens the socket. The store's lock is held, so an existing socket is a leftover.
///
/// # Errors
/// The system's; paths of over 107 bytes too.
pub fn listen(store: &Path, name: &str) -> io::Result<UnixListener> {
    check(store, name)?;
    let path = path(store, name);
    match std::fs::remove_file(&path) {
        Err(cause) if cause.kind() != io::ErrorKind::NotFound => return Err(cause),
        _ => {}
    }
    let listener = UnixListener::bind(&path)?;
    // The folder has mode 0700, so nobody else gets in between bind and this.
    std::fs::set_permissions(&path, std::fs::Permissions::from_mode(0o600))?;
    Ok(listener)
}

/// Answers a client, which must read the answer `within` this time: a client that does not read delays nothing else for
/// longer.
pub async fn answer(mut stream: tokio::net::UnixStream, status: &impl Serialize, within: Duration) {
    let text = serde_json::to_string(status).unwrap_or_default();
    let _ = tokio::time::timeout(within, stream.write_all(text.as_bytes())).await;
}

/// Sends a request to a running bridge, and waits for the whole answer `within` this time.
///
/// # Errors
/// None is running on this store, or it does not answer in this time, or with more than [`MAX_ANSWER_BYTES`].
pub fn ask(store: &Path, name: &str, within: Duration) -> io::Result<String> {
    ask_for(store, name, &[], within)
}

/// As [`ask`], with a content.
///
/// # Errors
/// As [`ask`].
pub fn ask_for(store: &Path, name: &str, what: &[u8], within: Duration) -> io::Result<String> {
    let end = Instant::now() + within;
    let socket = Socket::new(Domain::UNIX, Type::STREAM, None)?;
    // Connecting waits too, where a listener accepts nobody.
    socket.set_write_timeout(Some(within))?;
    socket
        .connect(&SockAddr::unix(path(store, name))?)
        .map_err(|cause| in_time(cause, within))?;
    let mut stream = UnixStream::from(OwnedFd::from(socket));
    stream
        .write_all(what)
        .map_err(|cause| in_time(cause, within))?;
    let mut text = Vec::new();
    let mut piece = vec![0; 65_536];
    // Whoever owns the store answers here, and may answer to a command of root's: one deadline for the whole answer, since a byte
    // now and then would extend one for each byte, and a bound, since root's memory is not its to fill.
    loop {
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() {
            return Err(in_time(io::ErrorKind::WouldBlock.into(), within));
        }
        stream.set_read_timeout(Some(left))?;
        let count = match stream.read(&mut piece) {
            Ok(0) => break,
            Ok(count) => count,
            Err(cause) if cause.kind() == io::ErrorKind::Interrupted => continue,
            Err(cause) => return Err(in_time(cause, within)),
        };
        text.extend_from_slice(piece.get(..count).unwrap_or_default());
        if text.len() > MAX_ANSWER_BYTES {
            let problem = format!("it answers with more than {MAX_ANSWER_BYTES} bytes");
            return Err(io::Error::new(io::ErrorKind::InvalidData, problem));
        }
    }
    String::from_utf8(text).map_err(|cause| io::Error::new(io::ErrorKind::InvalidData, cause))
}

/// The system reports a time limit as "temporarily unavailable".
fn in_time(cause: io::Error, within: Duration) -> io::Error {
    if cause.kind() != io::ErrorKind::WouldBlock {
        return cause;
    }
    let problem = format!("no whole answer within {} s", within.as_secs_f64());
    io::Error::new(io::ErrorKind::TimedOut, problem)
}

/// Several times the status of the most vehicles that one bridge has.
pub const MAX_ANSWER_BYTES: usize = 64 << 20;

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixListener;
    use std::thread;

    use super::*;

    /// Asks a listener that serves one client with `serve`.
    fn answered(
        within: Duration,
        serve: impl FnOnce(UnixStream) + Send + 'static,
    ) -> io::Result<String> {
        let folder = tempfile::tempdir().unwrap();
        let listener = UnixListener::bind(path(folder.path(), STATUS)).unwrap();
        let server = thread::spawn(move || serve(listener.accept().unwrap().0));
        let answer = ask(folder.path(), STATUS, within);
        server.join().unwrap();
        answer
    }

    #[test]
    fn an_answer_that_is_complete_in_time_is_returned() {
        let answer = answered(Duration::from_secs(60), |mut client| {
            client.write_all("{\"a\": ".as_bytes()).unwrap();
            client.write_all("1}".as_bytes()).unwrap();
        });
        assert_eq!(answer.unwrap(), "{\"a\": 1}");
    }

    #[test]
    fn a_byte_now_and_then_does_not_extend_the_deadline() {
        let began = Instant::now();
        let answer = answered(Duration::from_millis(200), |mut client| {
            // Each comes in time; all of them take 20 s.
            for _ in 0..400 {
                if client.write_all(b" ").is_err() {
                    return;
                }
                thread::sleep(Duration::from_millis(50));
            }
        });
        assert_eq!(answer.unwrap_err().kind(), io::ErrorKind::TimedOut);
        assert!(began.elapsed() < Duration::from_secs(15));
    }

    #[test]
    fn an_endless_answer_ends_at_the_bound() {
        let answer = answered(Duration::from_secs(60), |mut client| {
            while client.write_all(&[b' '; 65_536]).is_ok() {}
        });
        let refused = answer.unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::InvalidData);
        assert!(refused.to_string().contains("more than"), "{refused}");
    }

    #[test]
    fn a_listener_that_accepts_nobody_keeps_nobody_waiting() {
        let folder = tempfile::tempdir().unwrap();
        let place = path(folder.path(), STATUS);
        let listener = Socket::new(Domain::UNIX, Type::STREAM, None).unwrap();
        listener.bind(&SockAddr::unix(&place).unwrap()).unwrap();
        listener.listen(0).unwrap();
        // Its queue is full with the first.
        let _first = UnixStream::connect(&place).unwrap();
        let refused = ask(folder.path(), STATUS, Duration::from_millis(200)).unwrap_err();
        assert_eq!(refused.kind(), io::ErrorKind::TimedOut);
    }
}
