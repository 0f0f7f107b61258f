//! How many datagrams a second go to addresses that have proved nothing, whoever has claimed them.
//!
//! The credit of an address bounds what one victim is sent, not what the VSM's own socket has to hold: a datagram to a computer
//! that is not on the network stays in the send buffer for the three seconds of ARP, and forged addresses cost nothing. Forty of
//! them, used at 3,000 datagrams a second, filled the buffer, and half of the answers to other stations were lost.
//!
//! A limit alone would let a flood in a station's name keep that station out: its challenge would be the one that is not
//! sent. So the rate is split by address. Who floods has to use as many addresses as there are parts to reach all of them; then the
//! station still receives a challenge after some messages, and with its first right answer it no longer needs this rate.

use std::net::IpAddr;
use std::time::Duration;

use sha2::{Digest as _, Sha256};

use super::rate::{Kind, Limits, Rate};

/// The rate of each part.
#[derive(Debug)]
pub(super) struct UnprovenRate {
    parts: [Rate; PARTS],
    /// Nobody is to choose addresses that share a part with a certain station's.
    secret: [u8; 32],
}

impl Default for UnprovenRate {
    fn default() -> Self {
        UnprovenRate {
            parts: std::array::from_fn(|_| Rate::default()),
            secret: [0; 32],
        }
    }
}

impl UnprovenRate {
    pub(super) fn set_secret(&mut self, secret: [u8; 32]) {
        self.secret = secret;
    }

    /// Whether a datagram may be sent to this address now.
    pub(super) fn take(&mut self, now: Duration, to: IpAddr, kind: Kind) -> bool {
        let to = to.to_canonical();
        // Nothing on the way to this computer itself waits for ARP.
        if to.is_loopback() {
            return true;
        }
        let mut hash = Sha256::new_with_prefix(self.secret);
        match to {
            IpAddr::V4(ip) => hash.update(ip.octets()),
            IpAddr::V6(ip) => hash.update(ip.octets()),
        }
        let part = usize::from(hash.finalize()[0]) % PARTS;
        self.parts[part].take(now, 0, kind, &EACH)
    }
}

/// With [`EACH`]: with every part in use a burst of 256 datagrams, then 64 a second. What is sent within three seconds takes some
/// 340 kB of the 416 kB that Linux gives a socket where `net.core.wmem_max` was not raised: it counts 768 bytes for a small datagram.
const PARTS: usize = 16;
/// Enough for a station that never acknowledges, which its credit limits to less.
const EACH: Limits = Limits {
    lease: Duration::ZERO,
    bytes_s: u32::MAX,
    messages_s: 4,
};
