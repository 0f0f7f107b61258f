//! How many datagrams a second go to addresses that have proved nothing, whoever has claimed them.
//!
//! The credit of an address bounds what one victim is sent, not what the VSM's own socket has to hold: a datagram to a computer
//! that is not on the network stays in the send buffer for the three seconds of ARP, and forged addresses cost nothing. Forty of
//! them, used at 3,000 datagrams a second, filled the buffer, and half of the answers to other stations were lost.
//!
//! A limit alone would let a flood in a station's name keep that station out: its challenge would be the one that is not
//! sent. So most of the rate is split by address and port. By address alone a flood that names the station's own address, with other
//! ports, would have that station's part for itself. Now who floods uses all parts alike; then the station still receives a
//! challenge after some messages, and with its first right answer it no longer needs this rate.
//!
//! The rest is for whoever comes first: without a flood a station that never acknowledges has it for itself, and needs it for the
//! answers to what it commands ten times a second, or to a plan that it sends in one go.

use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use sha2::{Digest as _, Sha256};

use super::rate::{Kind, Rate};
use crate::session::limits::{UNPROVEN_EACH, UNPROVEN_PARTS, UNPROVEN_REST};

/// The rate of each part, and the rest.
#[derive(Debug)]
pub(super) struct UnprovenRate {
    parts: [Rate; UNPROVEN_PARTS],
    rest: Rate,
    /// Nobody is to choose addresses that share a part with a certain station's.
    secret: [u8; 32],
}

impl Default for UnprovenRate {
    fn default() -> Self {
        UnprovenRate {
            parts: std::array::from_fn(|_| Rate::default()),
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
        self.part(to).is_none_or(|part| {
            self.parts[part].take(now, 0, kind, &UNPROVEN_EACH)
                || self.rest.take(now, 0, kind, &UNPROVEN_REST)
        })
    }

    /// Whether [`UnprovenRate::take`] would allow it.
    pub(super) fn has_room(&self, now: Duration, to: SocketAddr, kind: Kind) -> bool {
        self.part(to).is_none_or(|part| {
            self.parts[part].has_room(now, kind, &UNPROVEN_EACH)
                || self.rest.has_room(now, kind, &UNPROVEN_REST)
        })
    }

    /// `None`: nothing on the way to this computer itself waits for ARP.
    fn part(&self, to: SocketAddr) -> Option<usize> {
        let ip = to.ip().to_canonical();
        if ip.is_loopback() {
            return None;
        }
        let mut hash = Sha256::new_with_prefix(self.secret);
        match ip {
            IpAddr::V4(ip) => hash.update(ip.octets()),
            IpAddr::V6(ip) => hash.update(ip.octets()),
        }
        hash.update(to.port().to_be_bytes());
        Some(usize::from(hash.finalize()[0]) % UNPROVEN_PARTS)
    }
}
