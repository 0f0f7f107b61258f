//! The connection of a station that is a web client, as the bridge knows it.

use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::signing::KeyId;
use serde::Serialize;

/// An open connection.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WebLink {
    /// By which the shell knows it; none has the number of another.
    pub(crate) number: u64,
    /// The guard key that its client has shown.
    pub(crate) key: KeyId,
    /// Where it comes from.
    pub(crate) from: SocketAddr,
    /// When it was opened.
    pub(crate) opened: Duration,
}

/// How a web client stands, for the status.
#[derive(Debug, Clone, Serialize)]
pub struct WebStatus {
    /// Whether it is connected.
    pub connected: bool,
    /// For how long, s.
    pub connected_s: Option<f64>,
}

impl WebStatus {
    pub(crate) fn of(link: Option<&WebLink>, now: Duration) -> WebStatus {
        WebStatus {
            connected: link.is_some(),
            connected_s: link.map(|link| now.saturating_sub(link.opened).as_secs_f64()),
        }
    }
}
