//! Datagrams of the DLI socket that arrive faster than they are handled: each station has its own queue and its turn.
//!
//! The system keeps what arrives in one queue, and drops what finds no room: whoever sends fastest would keep everybody else
//! out, and anybody can send. A datagram is read in a small part of the time that it takes to handle, so under load the
//! socket is emptied into these queues first. A station that has proved its address has one of its own; all other senders
//! share one.

use std::net::SocketAddr;

use crate::session::turns::Turns;

/// The queues.
#[derive(Debug, Default)]
pub(super) struct Inbox(Turns<(SocketAddr, Box<[u8]>)>);

impl Inbox {
    /// Lets a datagram wait for its turn. Returns false if too many wait: it is lost. `station`: whose proved address that is.
    pub(super) fn push(&mut self, station: Option<usize>, from: SocketAddr, bytes: &[u8]) -> bool {
        let sender = station.unwrap_or(STRANGERS);
        let has_room = self.0.waiting(sender) < MAX_WAITING;
        if has_room {
            self.0.push(sender, (from, bytes.into()));
        }
        has_room
    }

    /// The next one to handle.
    pub(super) fn pop(&mut self) -> Option<(SocketAddr, Box<[u8]>)> {
        self.0.pop().map(|(_, datagram)| datagram)
    }
}

const STRANGERS: usize = usize::MAX;
/// A burst of an upload; what waits longer than that takes is repeated by its sender.
const MAX_WAITING: usize = 64;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_of_strangers_keeps_no_station_out() {
        let mut inbox = Inbox::default();
        let station = ([127, 0, 0, 1], 40_000).into();
        let flood = (1..=10_000).map(|port| SocketAddr::from(([127, 0, 0, 9], port)));
        let taken = flood.filter(|from| inbox.push(None, *from, b"flood"));
        assert_eq!(taken.count(), MAX_WAITING);
        assert!(inbox.push(Some(3), station, b"command"));
        let order: Vec<_> = std::iter::from_fn(|| inbox.pop()).collect();
        assert_eq!(order.len(), MAX_WAITING + 1);
        assert!(order[..2].iter().any(|(from, _)| *from == station));
    }
}
