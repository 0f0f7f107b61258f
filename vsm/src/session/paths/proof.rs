//! The proof that a station is at an address: a challenge that only its receiver can answer.

use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use mavlink_link::Now;
use sha2::{Digest as _, Sha256};
use stanag_msgs::TimeStamp;

use super::rate::Kind;
use super::{FIRST_PAUSE, Path, Paths, Station};
use crate::session::dates::wall_ms;
use crate::session::limits::Limits;

/// The result of a 17000 for a heartbeat of ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Proof {
    /// No proof, or an expired one.
    None,
    /// One of several: challenge again.
    Round,
    /// The last. `moved`: the station is there from now on.
    Proven { moved: bool },
}

impl Paths {
    pub(crate) fn set_secret(&mut self, secret: [u8; 32]) {
        self.secret = secret;
        self.unproven.set_secret(secret);
    }

    /// The stamp of the heartbeat that challenges this address, if a challenge is due and there is credit for it. `again`:
    /// an answer has just come, so the next challenge follows at once. `now.wall` is the time of stamps
    /// ([`Outbox::time`](crate::session::outbox::Outbox::time)), here and in [`Paths::answered`].
    pub(crate) fn ask(
        &mut self,
        now: Now,
        index: usize,
        address: SocketAddr,
        again: bool,
    ) -> Option<TimeStamp> {
        let station = self.stations.get_mut(index)?;
        let contested = !station.candidates.is_empty();
        let answer = station.next_answer();
        let round = match station.find(address) {
            Some(path) => {
                // A proven address is challenged again only if there is another one.
                let idle = path.trusted && !contested;
                if !again && (idle || path.ask_at > now.mono) {
                    return None;
                }
                if path.proven.is_none() && !path.trusted {
                    // With its first right answer an address has shown that it exists.
                    let exists = again || path.rounds > 0;
                    if !exists && !self.unproven.has_room(now.mono, address, Kind::Answer) {
                        path.ask_at = now.mono + FIRST_PAUSE / 4;
                        return None;
                    }
                    let left = path.credit.checked_sub(path.question_bytes())?;
                    // A challenge may take the place of the answer for a moment. A CUCS that never acknowledges would
                    // receive nothing else. An answer that has to wait for the shared rate takes no place: neither would
                    // be sent, and the timer would be due again at once.
                    let kind = Kind::Acknowledgement;
                    if !again
                        && answer.is_some_and(|bytes| (left + 1..=path.credit).contains(&bytes))
                        && self.unproven.has_room(now.mono, address, kind)
                    {
                        return None;
                    }
                    if !exists {
                        self.unproven.take(now.mono, address, Kind::Answer);
                    }
                    path.credit = left;
                }
                path.ask_at = now.mono + path.pause;
                if path.rounds == 0 && !again {
                    path.pause = (path.pause * 2).min(LONGEST_PAUSE);
                }
                path.rounds
            }
            // The table is full: challenge it without remembering it. This cannot amplify, since its message was longer
            // than a challenge.
            None if self.unproven.take(now.mono, address, Kind::Answer) => 0,
            None => return None,
        };
        let slot = slot(now.wall).wrapping_sub(1) % SLOTS;
        Some(TimeStamp(
            slot << BITS | self.cookie(index, address, round, slot),
        ))
    }

    /// A 17000 for a heartbeat of ours names this stamp.
    pub(crate) fn answered(
        &mut self,
        now: Now,
        index: usize,
        from: SocketAddr,
        stamp: TimeStamp,
    ) -> Proof {
        let Some(round) = self
            .stations
            .get_mut(index)
            .map(|one| one.find(from).map_or(0, |path| path.rounds))
        else {
            return Proof::None;
        };
        let made = stamp.0 >> BITS;
        let recent = (1..=MAX_AGE).contains(&(slot(now.wall).wrapping_sub(made) % SLOTS));
        let is_of = |round| recent && stamp.0 & MASK == self.cookie(index, from, round, made);
        let right = is_of(round);
        // An answer to an earlier round is a duplicate by the network, not a guess.
        if !right && (0..ROUNDS).any(is_of) {
            return Proof::None;
        }
        let lease = self.limits.lease;
        let station = &mut self.stations[index];
        if right && station.find(from).is_none() {
            // It has received the challenge, so it may displace a candidate that has not shown this.
            station.make_room(1);
            station.candidate(now.mono, from);
        }
        let Some(path) = station.find(from) else {
            return Proof::None;
        };
        if !right {
            path.wrong += 1;
            if path.wrong > MAX_WRONG {
                (path.rounds, path.wrong) = (0, 0);
                path.ask_at = now.mono + path.pause;
            }
            return Proof::None;
        }
        path.rounds += 1;
        path.pause = FIRST_PAUSE;
        if path.rounds < ROUNDS {
            return Proof::Round;
        }
        path.proven = Some(now.mono);
        path.credit = 0;
        (path.rounds, path.wrong) = (0, 0);
        path.ask_at = now.mono + lease / 2;
        station.answers = true;
        let place = station
            .candidates
            .iter()
            .position(|path| path.address == from);
        if let Some(place) = place {
            station.adopt(place);
        }
        Proof::Proven {
            moved: place.is_some(),
        }
    }

    /// The address that a timer has to challenge again, and whether in Edition 2.5.
    pub(crate) fn due_to_ask(&self, now: Duration, index: usize) -> Option<(SocketAddr, bool)> {
        let station = self.stations.get(index)?;
        let at = station.asks_at(&self.limits, now)?;
        let current = station.current.as_ref().filter(|_| at <= now)?;
        Some((current.address, current.ed25))
    }

    /// An unpredictable value, known only to its receiver.
    fn cookie(&self, index: usize, address: SocketAddr, round: u8, slot: u64) -> u64 {
        let mut hash = Sha256::new_with_prefix(self.secret);
        hash.update(index.to_be_bytes());
        match address.ip() {
            IpAddr::V4(ip) => hash.update(ip.to_ipv6_mapped().octets()),
            IpAddr::V6(ip) => hash.update(ip.octets()),
        }
        hash.update(address.port().to_be_bytes());
        hash.update([round]);
        hash.update(slot.to_be_bytes());
        let whole: [u8; 32] = hash.finalize().into();
        u64::from(u16::from_be_bytes([whole[0], whole[1]])) & MASK
    }
}

impl Station {
    /// When a timer challenges the address: one that has answered before, until its lease ends; any other one only as long
    /// as its answer may have been lost, from the rest of its credit.
    pub(super) fn asks_at(&self, limits: &Limits, now: Duration) -> Option<Duration> {
        let current = self.current.as_ref()?;
        let asks = if current.trusted {
            self.movable().next().is_some()
        } else {
            let may_answer = current.may_be_asked() && current.credit >= current.question_bytes();
            current.proven.is_some() || may_answer
        };
        (asks && !current.has_lapsed(now, limits.lease)).then_some(current.ask_at)
    }
}

impl Path {
    pub(super) fn question_bytes(&self) -> usize {
        question_bytes(self.ed25)
    }

    /// Whether it may still answer: it has answered a round, or was not challenged twice in vain yet.
    pub(super) fn is_asked(&self) -> bool {
        self.rounds > 0 || self.pause <= 2 * FIRST_PAUSE
    }

    /// Whether a timer challenges it. It does so often enough that only five losses in a row leave a station that sends
    /// nothing more without an answer. This uses the rest of its credit: after the second challenge answers go first.
    fn may_be_asked(&self) -> bool {
        self.rounds > 0 || self.pause <= 16 * FIRST_PAUSE
    }
}

/// The size of a challenge, by the edition of its address.
pub(crate) fn question_bytes(ed25: bool) -> usize {
    if ed25 {
        QUESTION_ED25_BYTES
    } else {
        QUESTION_BYTES
    }
}

/// The part of a stamp above its unpredictable bits. It rolls over with the stamps, so the age of one is counted modulo [`SLOTS`].
fn slot(wall: Duration) -> u64 {
    TimeStamp::from_unix_ms(wall_ms(wall)).0 >> BITS
}

/// Unpredictable bits of a stamp: they put it up to 4.1 s into the past, an error that any clock may have.
const BITS: u32 = 11;
const MASK: u64 = (1 << BITS) - 1;
const SLOTS: u64 = TimeStamp::PERIOD_MS >> BITS;
/// Maximum age of an answer, in slots of 2 s.
const MAX_AGE: u64 = 4;
/// Number of answers in a row that prove an address, each a round trip.
const ROUNDS: u8 = 3;
/// Wrong answers before the rounds start again.
const MAX_WRONG: u8 = 8;
/// A heartbeat with its wrapper, with or without checksum.
const QUESTION_BYTES: usize = 26;
/// The same for Edition 2.5: #1401, and #1403, which #1401 makes the station acknowledge.
const QUESTION_ED25_BYTES: usize = 128;
/// Time between challenges of a CUCS that never answers.
const LONGEST_PAUSE: Duration = Duration::from_secs(64);
