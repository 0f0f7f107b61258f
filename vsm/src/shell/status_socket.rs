//! `vsm status`, `vsm reload` and `vsm check-vehicle`: Unix sockets in the store folder that answer in JSON any user who
//! may enter the folder. One returns the status, one the outcome of a reload, one the settings of the vehicles.

use std::io::{self, Read, Write as _};
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};
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

/// Opens the socket. The store's lock is held, so an existing socket is a leftover.
///
/// # Errors
/// The system's; paths of over 107 bytes too.
pub fn listen(store: &Path, name: &str) -> io::Result<UnixListener> {
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

/// Sends a request to a running bridge.
///
/// # Errors
/// None is running on this store, or it does not answer.
pub fn ask(store: &Path, name: &str, within: Duration) -> io::Result<String> {
    ask_for(store, name, &[], within)
}

/// As [`ask`], with a content.
///
/// # Errors
/// As [`ask`].
pub fn ask_for(store: &Path, name: &str, what: &[u8], within: Duration) -> io::Result<String> {
    let mut stream = UnixStream::connect(path(store, name))?;
    stream.set_read_timeout(Some(within))?;
    stream.write_all(what)?;
    let mut text = String::new();
    stream.read_to_string(&mut text)?;
    Ok(text)
}
