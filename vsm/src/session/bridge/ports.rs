//! Links of vehicles: several vehicles may share one, each with its own system id, key and peer.
//!
//! Each vehicle has a parser, a key and an address of its own, so a link has little to remember: what arrives is given to
//! the vehicle whose system id it carries. Only the headers are read for that. What is no row of whole frames (a serial
//! line, a frame that is cut in two) and frames of a system that no vehicle of the link has (a radio's RADIO_STATUS)
//! are given to all of them, and each takes what is its own.

use mavlink_link::Now;
use mavlink_link::frame;
use mavlink_link::store::Disk;

use super::{Bridge, Tap};
use crate::config::LinkAddress;
use crate::session::aircraft::Aircraft;
use crate::session::link::frame::Peer;
use crate::session::log::LogLevel;

/// One link: a socket, or a serial line.
#[derive(Debug)]
pub(super) struct Port {
    pub(super) link: LinkAddress,
    /// Who sent the beginning of a frame last: what this peer sends next may be the rest of it.
    cut: Option<Peer>,
    /// Systems that no vehicle of the link has, and that have been logged.
    named: Vec<u8>,
}

/// A part of what arrived: so many bytes, of this system where they are whole frames of one.
struct Piece {
    system: Option<u8>,
    length: usize,
}

impl Port {
    pub(super) fn new(link: LinkAddress) -> Port {
        Port {
            link,
            cut: None,
            named: Vec::new(),
        }
    }

    /// The first piece of `bytes`.
    fn next_piece(&mut self, from: Peer, bytes: &[u8]) -> Piece {
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

impl Bridge {
    /// Takes a datagram, or serial bytes, of the link with this index: links are numbered in the order in which the
    /// configuration first names them. `tap` is shown every frame that is believed, with the index of its vehicle.
    pub fn handle_vehicle(
        &mut self,
        now: Now,
        port: usize,
        from: Peer,
        bytes: &[u8],
        disk: &mut dyn Disk,
        tap: Tap<'_>,
    ) {
        let here = |one: &&Aircraft| one.port == port;
        let shared = self.aircraft.iter().filter(here).count() > 1;
        let mut rest = bytes;
        loop {
            let (mut system, mut length) = (None, rest.len());
            if shared && let Some(port) = self.ports.get_mut(port) {
                Piece { system, length } = port.next_piece(from, rest);
            }
            let piece;
            (piece, rest) = rest.split_at(length);
            // A system that nobody here has: each counts its frames, and names it.
            let mut known = self.aircraft.iter().filter(here).map(Aircraft::system);
            system = system.filter(|system| known.any(|known| known == *system));
            let (mut dli, aircraft) = self.effects(now, disk);
            for (index, one) in aircraft.iter_mut().enumerate() {
                if one.port == port && system.is_none_or(|system| system == one.system()) {
                    one.handle_datagram(&mut dli, from, piece, &mut |frame| tap(index, frame));
                }
            }
            if rest.is_empty() {
                return;
            }
        }
    }

    /// Systems that send on a vehicle's link and are no vehicle of it, with how many frames of each.
    pub(super) fn others_on_link<'a>(
        &'a self,
        of: &'a Aircraft,
    ) -> impl Iterator<Item = (u8, u32)> + 'a {
        let ours = |system| {
            let mut here = self.aircraft.iter().filter(|one| one.port == of.port);
            here.any(|one| one.system() == system)
        };
        let others = of.link.other_systems();
        others.filter(move |(system, _)| !ours(*system))
    }

    /// Logs each system that sends on a link and is configured nowhere there, once.
    pub(super) fn name_others(&mut self, now: Now, disk: &mut dyn Disk) {
        for index in 0..self.aircraft.len() {
            let one = &self.aircraft[index];
            let port = one.port;
            let named = &self.ports[port].named;
            // Anybody can send with any system id: the log has room for some of them.
            if named.len() >= MAX_NAMED {
                continue;
            }
            let new = |(system, _): &(u8, u32)| !named.contains(system);
            let found = self.others_on_link(one).find(new);
            let Some((system, _)) = found else {
                continue;
            };
            let configured = self.aircraft.iter().filter(|other| other.port == port);
            let configured: Vec<_> = configured.map(|one| one.system().to_string()).collect();
            let text = format!(
                "MAVLink system {system} sends on {}, where the configuration has system {}: its frames are ignored",
                self.ports[port].link,
                configured.join(" and ")
            );
            self.ports[port].named.push(system);
            let vsm = self.vsm;
            self.effects(now, disk).0.note(LogLevel::Info, vsm, text);
        }
    }
}

const MAX_NAMED: usize = 8;

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
