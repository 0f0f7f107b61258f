//! Datagrams of the DLI socket that arrive faster than they are handled: each station has its own queue and its turn.
//!
//! The system keeps what arrives in one queue, and drops what finds no room: whoever sends fastest would keep everybody else
//! out, and anybody can send. A datagram is read in a small part of the time that it takes to handle, so under load the
//! socket is emptied into these queues first. A station that has proved its address, or controls a vehicle, has one of its own. All other
//! senders have one turn together, and in it each part of all computers has a queue and its turn: a station that comes from another port,
//! or for the first time, does not wait behind somebody who sends from one computer.

use std::net::SocketAddr;

use crate::session::DliSender;
use crate::session::turns::Turns;

type Arrived = (SocketAddr, Box<[u8]>);

/// The queues.
#[derive(Debug, Default)]
pub(super) struct Inbox {
    /// `None`: the next one of `others`.
    turns: Turns<Option<Arrived>>,
    others: Turns<Arrived>,
}

impl Inbox {
    /// Lets a datagram wait for its turn. Returns false if too many of its sender wait: it is lost.
    pub(super) fn push(&mut self, sender: DliSender, from: SocketAddr, bytes: &[u8]) -> bool {
        let waiting = match sender {
            DliSender::Station(index) => self.turns.waiting(index),
            DliSender::Other(computer) => self.others.waiting(computer),
        };
        if waiting >= MAX_WAITING {
            return false;
        }
        let arrived: Arrived = (from, bytes.into());
        match sender {
            DliSender::Station(index) => self.turns.push(index, Some(arrived)),
            DliSender::Other(computer) => {
                self.others.push(computer, arrived);
                self.turns.push(OTHERS, None);
            }
        }
        true
    }

    /// The next one to handle.
    pub(super) fn pop(&mut self) -> Option<Arrived> {
        let (_, of_station) = self.turns.pop()?;
        of_station.or_else(|| self.others.pop().map(|(_, arrived)| arrived))
    }
}

const OTHERS: usize = usize::MAX;
/// A burst of an upload; what waits longer than that takes is repeated by its sender.
const MAX_WAITING: usize = 64;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_from_one_computer_keeps_no_station_out_that_is_known_or_comes_from_another() {
        let mut inbox = Inbox::default();
        let station = ([127, 0, 0, 1], 40_000).into();
        let newcomer = ([127, 0, 0, 2], 40_000).into();
        let flood = (1..=10_000).map(|port| SocketAddr::from(([127, 0, 0, 9], port)));
        let taken = flood.filter(|from| inbox.push(DliSender::Other(6), *from, b"flood"));
        assert_eq!(taken.count(), MAX_WAITING);
        assert!(inbox.push(DliSender::Station(3), station, b"command"));
        assert!(inbox.push(DliSender::Other(0), newcomer, b"request"));
        let order: Vec<_> = std::iter::from_fn(|| inbox.pop()).collect();
        assert_eq!(order.len(), MAX_WAITING + 2);
        assert!(order[..2].iter().any(|(from, _)| *from == station));
        assert!(order[..4].iter().any(|(from, _)| *from == newcomer));
    }

    #[test]
    fn all_who_are_not_known_have_the_turn_of_one_station_together() {
        let mut inbox = Inbox::default();
        let at = |port| SocketAddr::from(([127, 0, 0, 1], port));
        for port in 0..32 {
            assert!(inbox.push(DliSender::Other(usize::from(port % 8)), at(port), b"flood"));
            assert!(inbox.push(DliSender::Station(3), at(40_000), b"command"));
        }
        let first: Vec<_> = std::iter::from_fn(|| inbox.pop()).take(16).collect();
        let of_station = first.iter().filter(|(from, _)| *from == at(40_000));
        assert_eq!(of_station.count(), 8);
    }
}
