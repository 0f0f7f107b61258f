//! How many datagrams a second go to addresses that have proved nothing, whoever has claimed them.
//!
//! The credit of an address bounds what one victim is sent, not what the VSM's own socket has to hold: a datagram to a computer
//! that is not on the network stays in the send buffer for the three seconds of ARP, and forged addresses cost nothing. Forty of
//! them, used at 3,000 datagrams a second, filled the buffer, and half of the answers to other stations were lost.
//!
//! A limit alone would let a flood in a station's name keep that station out: its challenge would be the one that is not
//! sent. So most of the rate is split by address and port. By address alone a flood that names the station's own address, with other
//! ports, would have that station's part for itself. Now who floods uses all parts alike; then the station still receives a
//! challenge after some messages, and with its first right answer it no longer needs this rate. A smaller share is split by address
//! alone: whoever floods from one computer, from all of its ports, leaves that of each other computer, and a challenge needs no more.
//!
//! The rest is for whoever comes first: without a flood a station that never acknowledges has it for itself, and needs it for the
//! answers to what it commands ten times a second, or to a plan that it sends in one go.

use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use sha2::{Digest as _, Sha256};

use super::rate::{Kind, Rate};
use crate::session::limits::{UNPROVEN_COMPUTER, UNPROVEN_EACH, UNPROVEN_PARTS, UNPROVEN_REST};

/// The rate of each part of all addresses, of each part of all computers, and the rest.
#[derive(Debug)]
pub(super) struct UnprovenRate {
    parts: [Rate; UNPROVEN_PARTS],
    computers: [Rate; UNPROVEN_PARTS],
    rest: Rate,
    /// Of [`part_of`].
    secret: [u8; 32],
}

impl Default for UnprovenRate {
    fn default() -> Self {
        UnprovenRate {
            parts: std::array::from_fn(|_| Rate::default()),
            computers: std::array::from_fn(|_| Rate::default()),
            rest: Rate::default(),
            secret: [0; 32],
        }
    }
}

impl UnprovenRate {
    pub(super) fn set_secret(&mut self, secret: [u8; 32]) {
        self.secret = secret;
    }

    /// Whether a datagram may be sent to this address now.
    pub(super) fn take(&mut self, now: Duration, to: SocketAddr, kind: Kind) -> bool {
        self.parts(to).is_none_or(|(part, computer)| {
            self.parts[part].take(now, 0, kind, &UNPROVEN_EACH)
                || self.computers[computer].take(now, 0, kind, &UNPROVEN_COMPUTER)
                || self.rest.take(now, 0, kind, &UNPROVEN_REST)
        })
    }

    /// Whether [`UnprovenRate::take`] would allow it.
    pub(super) fn has_room(&self, now: Duration, to: SocketAddr, kind: Kind) -> bool {
        self.parts(to).is_none_or(|(part, computer)| {
            self.parts[part].has_room(now, kind, &UNPROVEN_EACH)
                || self.computers[computer].has_room(now, kind, &UNPROVEN_COMPUTER)
                || self.rest.has_room(now, kind, &UNPROVEN_REST)
        })
    }

    /// The parts of an address and of its computer; `None`: nothing on the way to this computer itself waits for ARP.
    fn parts(&self, to: SocketAddr) -> Option<(usize, usize)> {
        let part = |port| part_of(&self.secret, to.ip(), port, UNPROVEN_PARTS);
        (!to.ip().to_canonical().is_loopback()).then(|| (part(Some(to.port())), part(None)))
    }
}

/// Which of so many parts an address, or with no port its computer, is in. Nobody is to choose addresses that share a part with a certain
/// station's, so it takes the secret to know.
pub(super) fn part_of(secret: &[u8; 32], ip: IpAddr, port: Option<u16>, parts: usize) -> usize {
    let mut hash = Sha256::new_with_prefix(secret);
    match ip.to_canonical() {
        IpAddr::V4(ip) => hash.update(ip.octets()),
        IpAddr::V6(ip) => hash.update(ip.octets()),
    }
    if let Some(port) = port {
        hash.update(port.to_be_bytes());
    }
    usize::from(hash.finalize()[0]) % parts
}
