//! One link: a socket or a serial line, which several vehicles may share, each with its own system id, key and peer.
//!
//! Each vehicle has a parser and an address of its own, so a link has little to remember. A sequence of whole frames is
//! divided by the system ids in their headers, and each piece goes to the vehicle with that id. Other bytes (of a serial
//! line, or a frame cut in two) go to all vehicles, and each takes its own frames.

use std::time::Duration;

use mavlink_link::frame;
use stanag_msgs::Id;

use crate::config::LinkAddress;
use crate::session::link::frame::Peer;

/// The links of the vehicles, numbered in the order in which the configuration first names them.
#[derive(Debug, Default)]
pub(super) struct Links {
    pub(super) ports: Vec<Port>,
    /// A buffer for frames that other ground stations are sent, each with its vehicle and whether that vehicle signs.
    pub(super) believed: Vec<((Id, bool), Vec<u8>)>,
}

impl Links {
    pub(super) fn index(&self, link: &LinkAddress) -> Option<usize> {
        self.ports.iter().position(|port| port.link == *link)
    }

    /// The index of a link; adds it if it is new.
    pub(super) fn place(&mut self, link: &LinkAddress) -> usize {
        self.index(link).unwrap_or_else(|| {
            self.ports.push(Port::new(link.clone()));
            self.ports.len() - 1
        })
    }
}

/// One link: a socket, or a serial line.
#[derive(Debug)]
pub(super) struct Port {
    pub(super) link: LinkAddress,
    /// The peer that last sent the beginning of a frame: its next bytes may be the rest of it.
    cut: Option<Peer>,
    /// Systems without a vehicle on this link that have been logged.
    pub(super) named: Vec<NamedSystem>,
}

/// A system without a vehicle on this link.
#[derive(Debug)]
pub(super) struct NamedSystem {
    pub(super) system: u8,
    /// When it was last logged.
    pub(super) at: Duration,
    /// The number of its frames at that time.
    pub(super) frames: u32,
}

/// A part of the received bytes; of this system if it consists of whole frames of one.
pub(super) struct Piece {
    pub(super) system: Option<u8>,
    pub(super) length: usize,
}

impl Port {
    fn new(link: LinkAddress) -> Port {
        Port {
            link,
            cut: None,
            named: Vec::new(),
        }
    }

    /// The first piece of `bytes`.
    pub(super) fn next_piece(&mut self, from: Peer, bytes: &[u8]) -> Piece {
        let all = Piece {
            system: None,
            length: bytes.len(),
        };
        if from == Peer::Serial || self.cut.take_if(|peer| *peer == from).is_some() {
            return all;
        }
        let mut length = 0;
        let mut system = None;
        while let Some((of, frame)) = frame::extent(&bytes[length..]) {
            if system.is_some_and(|system| system != of) {
                break;
            }
            system = Some(of);
            length += frame;
        }
        if system.is_none() {
            self.cut = Some(from);
            return all;
        }
        Piece { system, length }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink_link::frame::{Header, MAX_FRAME, encode_raw};

    fn heartbeat(system_id: u8) -> Vec<u8> {
        let header = Header {
            system_id,
            component_id: 1,
            ..Header::default()
        };
        let mut out = [0; MAX_FRAME];
        let length = encode_raw(header, &[2; 9], &mut out).expect("a frame");
        out[..length].to_vec()
    }

    fn pieces(port: &mut Port, from: Peer, mut bytes: &[u8]) -> Vec<(Option<u8>, usize)> {
        let mut found = vec![];
        while !bytes.is_empty() {
            let Piece { system, length } = port.next_piece(from, bytes);
            found.push((system, length));
            bytes = &bytes[length..];
        }
        found
    }

    #[test]
    fn frames_are_told_apart_by_their_system_and_cut_ones_are_for_everybody() {
        let [one, two] = [heartbeat(1), heartbeat(2)];
        let length = one.len();
        let [a, b] = [1, 2].map(|port| Peer::Udp(([127, 0, 0, 1], port).into()));
        let mut port = Port::new(LinkAddress::UdpOut("host:1".to_owned()));
        let row = [&one[..], &one, &two, &one[..5]].concat();
        let split = vec![(Some(1), 2 * length), (Some(2), length), (None, 5)];
        assert_eq!(pieces(&mut port, a, &row), split);
        // The rest of the cut frame, with another behind it: nothing of it may be lost.
        let rest = [&one[5..], &two].concat();
        assert_eq!(pieces(&mut port, b, &two), [(Some(2), length)]);
        assert_eq!(pieces(&mut port, a, &rest), [(None, rest.len())]);
        assert_eq!(pieces(&mut port, a, &two), [(Some(2), length)]);
        assert_eq!(pieces(&mut port, Peer::Serial, &two), [(None, length)]);
    }
}
