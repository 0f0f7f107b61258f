//! What the connections and the bridge give each other.

use std::net::SocketAddr;

use stanag_msgs::Id;
use tokio::sync::oneshot;

use super::clients::ClientEnds;
use crate::session::web::{WebEnd, WebRefusal};

/// What a connection has for the bridge.
#[derive(Debug)]
pub enum Report {
    /// A client says who it is. It waits for the answer.
    Hello {
        /// By which the connection is known from here on.
        number: u64,
        /// Where it comes from.
        from: SocketAddr,
        /// The random bytes that it was sent.
        of_vsm: [u8; 32],
        /// Its frame.
        frame: String,
        /// Where the answer goes.
        answer: oneshot::Sender<Result<Admitted, WebRefusal>>,
    },
    /// A message of a client, as a datagram.
    Datagram {
        /// The connection.
        number: u64,
        /// Where it comes from.
        from: SocketAddr,
        /// The datagram.
        bytes: Vec<u8>,
    },
    /// A connection has ended.
    Closed {
        /// The connection.
        number: u64,
        /// For which it was refused.
        why: Option<WebRefusal>,
    },
    /// A connection was refused before anybody was known to be at its other end.
    Refused {
        /// Where it came from.
        from: SocketAddr,
        /// Why.
        why: WebRefusal,
    },
}

/// A client whose key has verified.
#[derive(Debug)]
pub struct Admitted {
    /// This end of it.
    pub end: WebEnd,
    /// Its first frame.
    pub welcome: String,
    /// In whose name it sends.
    pub cucs: Id,
    /// What the bridge gives it.
    pub ends: ClientEnds,
}
