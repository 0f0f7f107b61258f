//! How many messages are taken in a station's name, by where they come from.
//!
//! The id of a station is no secret. Whoever uses it from elsewhere must neither use up what the station itself may send, nor keep it out
//! where it comes from another port, or for the first time:
//!
//! - Where it is, it has a bucket of its own.
//! - All others share those of [`COMPUTERS`]: a keyed hash of the IP address chooses one. The computer on which the station is has one
//!   more, since a station that restarts mostly comes from there. So whoever sends from one computer, from however many ports, keeps
//!   nobody out on another, unless the two share a part.
//! - Addresses that have answered a question share one more, which comes before that of their computer: whoever invents addresses
//!   receives no questions. Somebody who has answered one, and uses this bucket up, leaves a newcomer what it had before its answer.
//!
//! Beside somebody who sends from the same computer, or invents addresses, a message of a newcomer has the chance of each of theirs: nobody
//! can know which of them is the station's. One in time is enough, where it answers the question that follows.

use std::net::SocketAddr;
use std::time::Duration;

use super::unproven::part_of;
use crate::session::allowance::Allowance;
use crate::session::limits::{COMPUTERS, Rate};

/// The buckets of one station.
#[derive(Debug, Default)]
pub(super) struct Senders {
    own: Allowance,
    answering: Allowance,
    /// The last one is that of the computer on which the station is.
    newcomers: [Allowance; COMPUTERS + 1],
}

/// Where a message in a station's name comes from.
#[derive(Debug)]
pub(super) struct Origin {
    pub(super) address: SocketAddr,
    /// Where the station is.
    pub(super) here: Option<SocketAddr>,
    /// It has answered a question.
    pub(super) answers: bool,
}

impl Senders {
    /// Takes a message out of the bucket of where it came from; false where that is empty.
    pub(super) fn take(
        &mut self,
        now: Duration,
        from: &Origin,
        secret: &[u8; 32],
        rate: Rate,
    ) -> bool {
        if from.here == Some(from.address) {
            return self.own.take(now, rate);
        }
        if from.answers && self.answering.take(now, rate) {
            return true;
        }
        let computer = match from.here {
            Some(here) if here.ip() == from.address.ip() => COMPUTERS,
            _ => computer_of(secret, from.address),
        };
        let bucket = self.newcomers.get_mut(computer);
        bucket.is_some_and(|bucket| bucket.take(now, rate))
    }
}

/// Which part of all computers an address is in.
pub(super) fn computer_of(secret: &[u8; 32], address: SocketAddr) -> usize {
    part_of(secret, address.ip(), None, COMPUTERS)
}

#[cfg(test)]
mod tests {
    use mavlink_link::Now;

    use super::*;
    use crate::session::limits::Limits;
    use crate::session::paths::{Paths, Proof};

    const LIMITS: Limits = Limits {
        lease: Duration::from_secs(60),
        bytes_s: 65_536,
        messages_s: 1_000,
        burst: Duration::from_secs(4),
    };
    const RATE: Rate = Rate::one_in(Duration::from_millis(10), 100);
    const NOW: Now = Now {
        mono: Duration::from_secs(100),
        wall: Duration::from_secs(1_795_219_200),
    };

    fn at(host: u8, port: u16) -> SocketAddr {
        SocketAddr::from(([10, 9, 0, host], port))
    }

    #[test]
    fn a_flood_from_one_computer_uses_up_nothing_of_the_station_nor_of_another_computer() {
        let mut paths = Paths::new(LIMITS, [None].into_iter());
        paths.restore(NOW.mono, 0, (at(1, 1), false), true);
        let mut taken = |host, port| paths.takes(NOW.mono, 0, at(host, port), RATE);
        let flood = (1..20_000).filter(|port| taken(9, *port));
        assert_eq!(flood.count(), 100);
        // Itself, a newcomer on its computer, and one on another.
        for (host, port) in [(1, 1), (1, 2), (8, 1)] {
            let own = (0..1_000).filter(|_| taken(host, port));
            assert_eq!(own.count(), 100, "{host}, port {port}");
        }
    }

    #[test]
    fn who_has_answered_is_kept_out_by_no_flood_from_his_computer_nor_of_somebody_who_has_answered_too()
     {
        for flooded in [1, 9] {
            let mut paths = Paths::new(LIMITS, [None].into_iter());
            paths.restore(NOW.mono, 0, (at(1, 1), false), true);
            // The station at another port, and somebody elsewhere who answers one question and no more.
            for from in [at(1, 2), at(9, 2)] {
                paths.arrived(NOW.mono, 0, from, (300, false), || true);
                let question = paths.ask(NOW, 0, from, false).expect("it is asked");
                assert_eq!(paths.answered(NOW, 0, from, question), Proof::Round);
            }
            let mut taken = |host, port| paths.takes(NOW.mono, 0, at(host, port), RATE);
            let flood = match flooded {
                1 => (3..20_000).filter(|port| taken(1, *port)).count(),
                _ => (0..20_000).filter(|_| taken(9, 2)).count(),
            };
            // Of the station's computer; of those who have answered, and of his own.
            assert_eq!(flood, if flooded == 1 { 100 } else { 200 });
            let own = (0..1_000).filter(|_| taken(1, 2)).count();
            assert_eq!(own, 100, "host {flooded} floods");
        }
    }
}
