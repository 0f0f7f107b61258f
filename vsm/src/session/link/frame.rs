//! Frames for the wire, and where they come from and go to.

use std::net::{IpAddr, SocketAddr};

use mavlink_link::frame::{FrameView, MAX_FRAME};

/// Where a frame came from or goes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Peer {
    /// A UDP address.
    Udp(SocketAddr),
    /// A connection of TCP: its far end.
    Tcp(SocketAddr),
    /// The other end of a serial line.
    Serial,
}

impl Peer {
    /// The computer that it is on.
    pub(crate) fn host(self) -> u64 {
        match self {
            Peer::Udp(address) | Peer::Tcp(address) => computer_of(address.ip()),
            Peer::Serial => 0,
        }
    }
}

/// The number of the computer that has an address; of IPv6 that of the network, since a computer may have every address in it.
pub(crate) fn computer_of(ip: IpAddr) -> u64 {
    match ip.to_canonical() {
        IpAddr::V4(ip) => ip.to_bits().into(),
        IpAddr::V6(ip) => (ip.to_bits() >> 64) as u64,
    }
}

impl std::fmt::Display for Peer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Peer::Udp(address) | Peer::Tcp(address) => address.fmt(f),
            Peer::Serial => f.write_str("serial"),
        }
    }
}

/// One frame for the wire.
#[derive(Debug, Clone)]
pub struct OutFrame {
    /// Where it goes.
    pub to: Peer,
    len: usize,
    bytes: [u8; MAX_FRAME],
}

impl OutFrame {
    pub(in crate::session) fn new(to: Peer, len: usize, bytes: [u8; MAX_FRAME]) -> OutFrame {
        OutFrame { to, len, bytes }
    }

    /// Its bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }

    /// Whether it only keeps the link: a heartbeat, or a PING about clocks and whether we are received.
    pub(in crate::session) fn keeps_link(&self) -> bool {
        let view = FrameView::parse(self.bytes());
        view.is_ok_and(|view| [HEARTBEAT, PING].contains(&view.header().message_id))
    }
}

pub(super) const HEARTBEAT: u32 = 0;
const PING: u32 = 4;
