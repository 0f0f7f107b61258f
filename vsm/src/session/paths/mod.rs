//! The address of each CUCS, and what may be sent there before it has proved that it receives there. This file is the table
//! of addresses: where a station is sent to, where else it claims to be, and when it moves. `proof` challenges an address;
//! `credit` decides how much may be sent, by a `rate` for proven addresses and one that all unproven ones share (`unproven`); `senders`
//! how much is taken, from whom.
//!
//! Anyone can write any source address into a datagram. Without proof the VSM would be a reflector (23 bytes of 40000 are
//! answered by 21 kB), and one datagram in the controller's name would send its status, and its aircraft, elsewhere. The
//! rules are those of RFC 9000, section 8, without its tokens, which the DLI does not have:
//!
//! - **Proof.** A heartbeat (16002) of the VSM requests an acknowledgement, with a stamp that only its receiver can know:
//!   11 bits of a keyed hash of station, address and time. Its 17000 names the stamp. `ROUNDS` correct answers in a row
//!   prove an address; `MAX_WRONG` wrong ones are forgiven, so that a guess succeeds once in 10^8 attempts. A CUCS needs
//!   nothing but the acknowledgements that the standard requires.
//! - **Three times.** An unproven address is sent at most three times the bytes that came from it, answers before status. A
//!   message without credit waits a short time for the proof and is then dropped. The bytes that are actually sent count: a
//!   station of Edition 2.5 is sent longer messages than those that the machines compose ([`Paths::settle`]).
//! - **One address.** A CUCS is sent to, and obeyed, at one address. Another address must first be proven; messages from it
//!   are held back until then. A CUCS that never answers moves when its old address has been quiet.
//! - **Lease.** An address from which nothing comes is sent nothing after a while. It is challenged before that: a CUCS
//!   that only listens and acknowledges keeps its status.
//! - **Rate.** A proven address is limited too, in bytes and messages a second.
//! - **Group.** The group is the configured one, never one that a datagram names. It has a rate for each station, a lower
//!   one while that station is unproven, and answers to the group are at most three times the bytes that came from it.
//!
//! The `address` of a `[[cucs]]` counts as proof: the operator vouches for it.

mod credit;
mod proof;
mod rate;
mod senders;
#[cfg(test)]
mod tests;
mod unproven;

use std::cmp::Reverse;
use std::collections::VecDeque;
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use mavlink_link::signing::KeyId;

pub(crate) use self::credit::Verdict;
pub(crate) use self::proof::{Proof, question_bytes};
pub(crate) use self::rate::Kind;
use self::rate::Rate;
use self::senders::{Origin, Senders, computer_of};
use self::unproven::UnprovenRate;
use super::limits::Limits;
use super::outbox::Datagram;

/// A message that was held back, and the guard key that has sealed it.
type Held = (Box<[u8]>, Option<KeyId>);

/// The paths of all stations, by their index.
#[derive(Debug)]
pub(crate) struct Paths {
    /// The key of the challenges: without it a stamp could be predicted.
    secret: [u8; 32],
    limits: Limits,
    unproven: UnprovenRate,
    stations: Vec<Station>,
}

/// One station.
#[derive(Debug, Default)]
struct Station {
    /// The configured address: every port of it is trusted.
    trusted: Option<IpAddr>,
    /// The address that it is sent to.
    current: Option<Path>,
    /// Other addresses that it claims.
    candidates: Vec<Path>,
    /// It has once proved an address: it is able to, so it must while it is in control.
    answers: bool,
    /// A message for it was dropped since its address was last certain.
    missed: bool,
    senders: Senders,
    unicast: Rate,
    group: Rate,
    /// Answers that wait for credit, and until when.
    waiting: VecDeque<(Duration, Datagram)>,
    /// The next report in turn for an unproven address.
    turn: usize,
}

/// One address of a station.
#[derive(Debug)]
struct Path {
    address: SocketAddr,
    trusted: bool,
    /// What came from it last was of Edition 2.5: it is challenged, and charged, in that edition. What comes from elsewhere in the
    /// station's name has no part in this.
    ed25: bool,
    /// Bytes that may still be sent without proof.
    credit: usize,
    /// The same for answers to the group.
    group_credit: usize,
    /// When the station last proved this address.
    proven: Option<Duration>,
    /// Correct answers in a row to the present challenge.
    rounds: u8,
    wrong: u8,
    /// When the first and the last message came from it.
    first: Duration,
    seen: Duration,
    /// The earliest time of the next challenge.
    ask_at: Duration,
    /// The time to the next challenge if it does not answer.
    pause: Duration,
    /// Messages from it that wait for the proof.
    held: Vec<Held>,
}

/// What an arriving message means for its station.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arrival {
    /// From the station's address.
    Current,
    /// The station had no address, or none that counts: it is here now.
    Moved,
    /// From another address: it must not be processed before that is proven.
    Unproven,
}

impl Paths {
    pub(crate) fn new(limits: Limits, trusted: impl Iterator<Item = Option<IpAddr>>) -> Paths {
        Paths {
            secret: [0; 32],
            limits,
            unproven: UnprovenRate::default(),
            stations: trusted.map(Station::new).collect(),
        }
    }

    /// Sets the configured address of a station, or adds a station after the last one.
    pub(crate) fn set_trusted(&mut self, now: Duration, index: usize, trusted: Option<IpAddr>) {
        match self.stations.get_mut(index) {
            // From any other address it must prove itself again.
            Some(station) if station.trusted != trusted => {
                // If no address is configured any more, the station keeps its address and is challenged there. Without an
                // address, the first datagram in its name would move it elsewhere, even a controller.
                let kept = station.current.take().filter(|_| trusted.is_none());
                *station = Station::new(trusted);
                station.current = kept.map(|path| Path {
                    trusted: false,
                    proven: Some(now),
                    ask_at: now,
                    pause: FIRST_PAUSE,
                    ..path
                });
            }
            Some(_) => {}
            None => self.stations.push(Station::new(trusted)),
        }
    }

    /// Takes a message in a station's name out of the bucket of where it came from; false where that is empty.
    pub(crate) fn takes(
        &mut self,
        now: Duration,
        index: usize,
        from: SocketAddr,
        rate: super::limits::Rate,
    ) -> bool {
        let Some(station) = self.stations.get_mut(index) else {
            return true;
        };
        let origin = Origin {
            address: from,
            here: station.current.as_ref().map(|path| path.address),
            answers: station.find(from).is_some_and(|path| path.rounds > 0),
        };
        station.senders.take(now, &origin, &self.secret, rate)
    }

    /// Which part of all computers an address is in.
    pub(crate) fn computer(&self, address: SocketAddr) -> usize {
        computer_of(&self.secret, address)
    }

    /// The address that the station is sent to.
    pub(crate) fn peer(&self, index: usize) -> Option<SocketAddr> {
        Some(self.stations.get(index)?.current.as_ref()?.address)
    }

    /// Whether nothing has recently come from the station's address.
    pub(crate) fn is_quiet(&self, now: Duration, index: usize) -> bool {
        let station = self.stations.get(index);
        let current = station.and_then(|one| one.current.as_ref());
        current.is_none_or(|path| path.seen + QUIET <= now)
    }

    /// Whether the station has proved its address, or the operator vouches for it.
    pub(crate) fn is_proven(&self, index: usize) -> bool {
        let current = self
            .stations
            .get(index)
            .and_then(|one| one.current.as_ref());
        current.is_some_and(|path| path.trusted || path.proven.is_some())
    }

    /// An address from which a station has been sending for a while without a proof; and the one that it is sent to, if
    /// different.
    pub(crate) fn unproven(
        &self,
        now: Duration,
        index: usize,
    ) -> Option<(SocketAddr, Option<SocketAddr>)> {
        let station = self.stations.get(index)?;
        let current = station.current.as_ref();
        let stays = |path: &&Path| {
            !path.trusted
                && path.proven.is_none()
                && path.first + UNPROVEN_FOR <= now
                && path.seen + QUIET > now
        };
        let elsewhere = station.candidates.iter().find(stays);
        let of_candidate = |path: &Path| (path.address, current.map(|path| path.address));
        let of_current = |path: &Path| (path.address, None);
        elsewhere
            .map(of_candidate)
            .or_else(|| current.filter(stays).map(of_current))
    }

    /// After a restart: the station's address from before, if it was proven, and whether it speaks Edition 2.5 there. One that was
    /// not proven starts again with its next message.
    pub(crate) fn restore(
        &mut self,
        now: Duration,
        index: usize,
        (peer, ed25): (SocketAddr, bool),
        proven: bool,
    ) {
        let lease = self.limits.lease;
        let Some(station) = self.stations.get_mut(index) else {
            return;
        };
        let mut path = station.path(now, peer);
        if station.current.is_some() || !(proven || path.trusted) {
            return;
        }
        path.ed25 = ed25;
        path.proven = proven.then_some(now);
        path.ask_at = now + lease / 2;
        station.answers = proven;
        station.current = Some(path);
    }

    /// A station is at the other end of a connection. It has answered a challenge there, so it is proven as long as the
    /// connection lasts.
    pub(crate) fn connect(&mut self, now: Duration, index: usize, peer: SocketAddr) {
        if let Some(station) = self.stations.get_mut(index) {
            let path = station.path(now, peer);
            station.current = Some(Path {
                trusted: true,
                proven: Some(now),
                ..path
            });
            station.forget_rest();
        }
    }

    /// Its connection has ended: it has no address.
    pub(crate) fn disconnect(&mut self, index: usize) {
        if let Some(station) = self.stations.get_mut(index) {
            station.current = None;
            station.forget_rest();
        }
    }

    /// A message of `bytes` has come from an address, of Edition 2.5 or a later one. `controls`: the station holds LOI 3, 4 or 5.
    pub(crate) fn arrived(
        &mut self,
        now: Duration,
        index: usize,
        from: SocketAddr,
        (bytes, ed25): (usize, bool),
        controls: impl FnOnce() -> bool,
    ) -> Arrival {
        let lease = self.limits.lease;
        let Some(station) = self.stations.get_mut(index) else {
            return Arrival::Current;
        };
        if let Some(current) = station.current.as_mut().filter(|path| path.address == from) {
            if current.has_lapsed(now, lease) {
                // Somebody else may have this address by now.
                current.proven = None;
                current.ask_at = now;
                current.pause = FIRST_PAUSE;
            }
            current.ed25 = ed25;
            current.credit_for(now, bytes);
            return Arrival::Current;
        }
        let place = station.candidate(now, from);
        if let Some(place) = place {
            station.candidates[place].ed25 = ed25;
            station.candidates[place].credit_for(now, bytes);
        }
        let controls = controls();
        let vouched = station.trusted == Some(from.ip());
        let free = match &station.current {
            None => true,
            Some(current) if current.has_lapsed(now, lease) => true,
            Some(current) => !current.trusted && current.proven.is_none() && !controls,
        };
        // A CUCS that is able to prove its address must do so while it commands an aircraft.
        let must_prove = controls && station.answers && !vouched;
        match place {
            Some(place) if free && !must_prove => {
                station.adopt(place);
                Arrival::Moved
            }
            _ => {
                if vouched && let Some(current) = &mut station.current {
                    // Two ports of a trusted address: challenge the old one, whether the station is still there.
                    current.ask_at = current.ask_at.min(now + FIRST_PAUSE);
                }
                Arrival::Unproven
            }
        }
    }

    /// A station whose edition has no heartbeat keeps listening, if the operator vouches for its address.
    pub(crate) fn keep(&mut self, now: Duration, index: usize) {
        let station = self.stations.get_mut(index);
        let current = station.and_then(|one| one.current.as_mut());
        if let Some(current) = current.filter(|path| path.trusted) {
            current.seen = now;
        }
    }

    /// Holds a message back until its address is proven; returns false if there is no room.
    pub(crate) fn hold(
        &mut self,
        index: usize,
        from: SocketAddr,
        bytes: &[u8],
        key: Option<KeyId>,
    ) -> bool {
        let station = self.stations.get_mut(index);
        let paths = station.map(|one| one.candidates.iter_mut());
        let Some(path) = paths.and_then(|mut all| all.find(|path| path.address == from)) else {
            return false;
        };
        let room = path.held.len() < MAX_HELD;
        if room {
            path.held.push((bytes.into(), key));
        }
        room
    }

    /// Drops all messages that are held back until an address is proven.
    pub(crate) fn drop_held(&mut self) {
        for path in self.each_path() {
            path.held.clear();
        }
    }

    /// Nothing could be asked for so long, until now: no proof and no lease ends by that, and no station has had that time for one.
    pub(crate) fn extend_proofs(&mut self, now: Duration, by: Duration) {
        // Not of the candidates, for which messages are held back.
        for path in self
            .stations
            .iter_mut()
            .filter_map(|one| one.current.as_mut())
        {
            path.seen = (path.seen + by).min(now);
        }
        for path in self.each_path() {
            path.proven = path.proven.map(|at| at + by);
            path.first = (path.first + by).min(now.max(path.first));
        }
    }

    fn each_path(&mut self) -> impl Iterator<Item = &mut Path> {
        (self.stations.iter_mut()).flat_map(|one| one.current.iter_mut().chain(&mut one.candidates))
    }

    /// Forgets messages from other addresses: from now on their sender is judged by another key.
    pub(crate) fn forget_candidates(&mut self, index: usize) {
        if let Some(station) = self.stations.get_mut(index) {
            station.candidates.clear();
        }
    }

    /// Messages that were held back from the station's present address.
    pub(crate) fn take_held(&mut self, index: usize) -> Vec<Held> {
        let current = self
            .stations
            .get_mut(index)
            .and_then(|one| one.current.as_mut());
        current
            .map(|path| std::mem::take(&mut path.held))
            .unwrap_or_default()
    }

    /// Expires proofs that were not renewed in time, and moves a station that never proves anything once its old address is
    /// quiet. Returns true if it has moved.
    pub(crate) fn handle_timeout(&mut self, now: Duration, index: usize) -> bool {
        let lease = self.limits.lease;
        let Some(station) = self.stations.get_mut(index) else {
            return false;
        };
        if let Some(current) = &mut station.current {
            current.proven = current
                .proven
                .filter(|at| *at + 2 * lease > now || current.trusted);
        }
        station
            .candidates
            .retain(|path| path.seen + FORGET_AFTER > now);
        if station.moves_at().is_none_or(|at| at > now) {
            return false;
        }
        // A station that restarts mostly does so on its computer: what comes from others in its name moves it only if nothing else does.
        let here = station.current.as_ref().map(|path| path.address.ip());
        let rank = |path: &Path| (Some(path.address.ip()) == here, path.seen);
        let newest = station.movable().max_by_key(|(_, path)| rank(path));
        let Some(place) = newest.map(|(place, _)| place) else {
            return false;
        };
        station.adopt(place);
        true
    }

    /// When a station needs [`Paths::handle_timeout`], [`Paths::due_to_ask`] or [`Paths::next_waiting`] next.
    pub(crate) fn poll_timeout(&self, now: Duration) -> Option<Duration> {
        let each = self.stations.iter().flat_map(|station| {
            // Credit alone does not send an answer to an unproven address: it may wait for the rate that all of them share.
            let next = (station.waiting.front()).map(|(_, datagram)| station.bytes_of(datagram));
            let may_send = |path: &Path, bytes: usize| {
                path.trusted || path.proven.is_some() || path.credit >= bytes
            };
            let waits = (station.current.as_ref().zip(next))
                .is_some_and(|(path, bytes)| may_send(path, bytes));
            let flush = waits.then(|| now + FLUSH_EVERY);
            [
                station.asks_at(&self.limits, now),
                station.moves_at(),
                flush,
            ]
        });
        each.flatten().min()
    }
}

impl Station {
    fn new(trusted: Option<IpAddr>) -> Station {
        Station {
            trusted,
            ..Station::default()
        }
    }

    fn path(&self, now: Duration, address: SocketAddr) -> Path {
        Path {
            address,
            trusted: self.trusted == Some(address.ip()),
            ed25: false,
            credit: 0,
            group_credit: 0,
            proven: None,
            rounds: 0,
            wrong: 0,
            first: now,
            seen: now,
            ask_at: now,
            pause: FIRST_PAUSE,
            held: Vec::new(),
        }
    }

    fn find(&mut self, address: SocketAddr) -> Option<&mut Path> {
        let all = self.current.iter_mut().chain(&mut self.candidates);
        all.into_iter().find(|path| path.address == address)
    }

    /// The index of a candidate, if it exists or there is room for it.
    fn candidate(&mut self, now: Duration, address: SocketAddr) -> Option<usize> {
        let known = self
            .candidates
            .iter()
            .position(|path| path.address == address);
        if known.is_some() {
            return known;
        }
        self.make_room(0);
        if self.candidates.len() == MAX_CANDIDATES {
            return None;
        }
        let path = self.path(now, address);
        self.candidates.push(path);
        Some(self.candidates.len() - 1)
    }

    /// Makes room in a full table: removes a candidate that has answered at most `rounds`. A station that has answered once has
    /// received something, and invented addresses must not displace it. Of the others one goes of the computer that has most of
    /// them: all ports of one computer displace no address of another. Of those, the one that was seen longest ago.
    fn make_room(&mut self, rounds: u8) {
        if self.candidates.len() < MAX_CANDIDATES {
            return;
        }
        let ports = |path: &Path| {
            let is_of_it = |one: &&Path| one.address.ip() == path.address.ip();
            self.candidates.iter().filter(is_of_it).count()
        };
        let unproven = self
            .candidates
            .iter()
            .enumerate()
            .filter(|(_, path)| path.rounds <= rounds);
        let oldest =
            unproven.min_by_key(|(_, path)| (path.rounds, Reverse(ports(path)), path.seen));
        if let Some(place) = oldest.map(|(place, _)| place) {
            self.candidates.swap_remove(place);
        }
    }

    /// The station moves to this candidate. The old address becomes a candidate: it may be the right one after all.
    fn adopt(&mut self, place: usize) {
        let new = self.candidates.swap_remove(place);
        if let Some(mut old) = self.current.replace(new) {
            // It keeps the rounds that it has answered: else whoever uses its name faster than it can answer would have it begin again
            // each time.
            old.proven = None;
            // It is challenged with the next message from there. The next challenge of a proven address is half a lease
            // away; until then a station that returns, or a second program with its id, would be held back without a
            // challenge.
            (old.ask_at, old.pause) = (Duration::ZERO, FIRST_PAUSE);
            self.candidates.push(old);
            // Messages to the old address may have reached nobody.
            self.missed = true;
        }
        // Waiting messages were for the old address: here they could be more than three times the bytes that came from
        // here.
        self.waiting.clear();
    }

    /// Forgets everything about other addresses, and waiting messages for them.
    fn forget_rest(&mut self) {
        self.candidates.clear();
        self.waiting.clear();
    }

    /// The candidates that may be adopted without proof once the old address is quiet.
    fn movable(&self) -> impl Iterator<Item = (usize, &Path)> {
        let seen = self.current.as_ref().map(|path| path.seen);
        let each = self.candidates.iter().enumerate();
        each.filter(move |(_, path)| {
            (path.trusted || !self.answers) && seen.is_some_and(|seen| path.seen > seen)
        })
    }

    fn moves_at(&self) -> Option<Duration> {
        let quiet = self.current.as_ref()?.seen + QUIET;
        let first = self.movable().map(|(_, path)| path.first).min()?;
        // A station that answers challenges but sends nothing by itself is first challenged again.
        Some(if self.answers {
            quiet.max(first + QUIET)
        } else {
            quiet
        })
    }
}

impl Path {
    fn has_lapsed(&self, now: Duration, lease: Duration) -> bool {
        now.saturating_sub(self.seen) > lease
    }
}

/// The old address of a station that never proves anything must have been silent for this long before the station moves.
const QUIET: Duration = Duration::from_secs(3);
/// A station that has not proved an address for this long is missing messages that others receive.
const UNPROVEN_FOR: Duration = Duration::from_secs(5);
/// Time between the first two challenges of an address.
const FIRST_PAUSE: Duration = Duration::from_millis(500);
/// Maximum number of other addresses, and of messages held back for each.
const MAX_CANDIDATES: usize = 8;
const MAX_HELD: usize = 16;
/// How long a candidate is remembered; so no message that was held back is older than this.
const FORGET_AFTER: Duration = Duration::from_secs(5);
const FLUSH_EVERY: Duration = Duration::from_millis(20);
