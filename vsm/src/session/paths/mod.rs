//! Where each CUCS is, and what may be sent there before it has proved that it is there. This file is the table of addresses:
//! where a station is sent to, where it claims to be too, and when it moves; `proof` asks an address whether the station is
//! there; `credit` says how much may be sent, by a `rate` where it has.
//!
//! Anyone can write any source address into a datagram. Without proof the VSM would be a reflector (23 bytes of 40000
//! are answered by 21 kB), and one datagram in the controller's name would take its status, and its aircraft, elsewhere.
//! The rules are those of RFC 9000, section 8, without its tokens, which the DLI does not have:
//!
//! - **Proof.** A heartbeat (16002) of the VSM that requests an acknowledgement, with a stamp that nobody can know who has
//!   not received it: 11 bits of a keyed hash of station, address and time. Its 17000 names the stamp. `ROUNDS` of
//!   them in a row prove an address; of wrong ones `MAX_WRONG` are forgiven, so that who guesses is right once in 10^8
//!   times. A CUCS needs nothing but the acknowledgements that the standard asks of it.
//! - **Three times.** An address that has not proved itself is sent at most three times the bytes that came from it,
//!   answers before status. What there is no credit for waits a little for the proof, then it is dropped. What counts is
//!   what leaves: a station of Edition 2.5 is sent longer messages than those that the machines write ([`Paths::settle`]).
//! - **One address.** A CUCS is sent to, and obeyed, at one address. From another one it must prove itself first; what it
//!   sends meanwhile is held back, and taken once it has. A CUCS that never answers moves when its old address has been quiet.
//! - **Lease.** An address from which nothing comes is sent nothing after a while. It is asked in time: a CUCS that only
//!   listens, and acknowledges, keeps its status.
//! - **Rate.** A proven address has a rate too, in bytes and messages a second.
//! - **Group.** The group is that of the configuration, never one that a datagram names. It has a rate for each station, a
//!   lower one while that has proved nothing, and answers to it are at most three times what came from it, there too.
//!
//! The `address` of a `[[cucs]]` counts as proof: the operator vouches for it.

mod credit;
mod proof;
mod rate;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use mavlink_link::signing::KeyId;

pub(crate) use self::credit::Verdict;
pub(crate) use self::proof::{Proof, question_bytes};
use self::rate::Rate;
pub(crate) use self::rate::{Kind, Limits};
use super::outbox::Datagram;

/// A message that was held back, and the guard key that has sealed it.
type Held = (Box<[u8]>, Option<KeyId>);

/// The paths of all stations, by their index.
#[derive(Debug, Default)]
pub(crate) struct Paths {
    /// Without it a stamp could be predicted.
    secret: [u8; 32],
    limits: Limits,
    stations: Vec<Station>,
}

/// One station.
#[derive(Debug)]
struct Station {
    /// From the configuration: every port of it is believed.
    trusted: Option<IpAddr>,
    /// Where it is sent to.
    current: Option<Path>,
    /// Where it claims to be too.
    candidates: Vec<Path>,
    /// It has proved an address: it can, so in control it must.
    answers: bool,
    /// It is sent messages of Edition 2.5.
    ed25: bool,
    /// Something that it should have was dropped since it was last there for certain.
    missed: bool,
    unicast: Rate,
    group: Rate,
    /// Answers without credit, and until when they wait.
    waiting: VecDeque<(Duration, Datagram)>,
    /// The report that is next in turn for an address without proof.
    turn: usize,
}

/// One address of a station.
#[derive(Debug)]
struct Path {
    address: SocketAddr,
    trusted: bool,
    /// Bytes that may still be sent without proof.
    credit: usize,
    /// The same of answers to the group.
    group_credit: usize,
    /// When it last proved itself.
    proven: Option<Duration>,
    /// Answers in a row, to the challenge that runs.
    rounds: u8,
    wrong: u8,
    /// When something came from it first, and last.
    first: Duration,
    seen: Duration,
    /// When it is next asked, at the earliest.
    ask_at: Duration,
    /// Until then, once it has not answered.
    pause: Duration,
    /// What came from it and waits for the proof.
    held: Vec<Held>,
}

/// What an arriving message is to its station.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Arrival {
    /// From where the station is.
    Current,
    /// The station had no address, or none that counts: it is here now.
    Moved,
    /// From elsewhere: not to be taken before the address is proven.
    Unproven,
}

impl Paths {
    pub(crate) fn new(limits: Limits, trusted: impl Iterator<Item = Option<IpAddr>>) -> Paths {
        Paths {
            secret: [0; 32],
            limits,
            stations: trusted.map(Station::new).collect(),
        }
    }

    /// The address that the configuration vouches for, of a station or of the one after the last.
    pub(crate) fn set_trusted(&mut self, now: Duration, index: usize, trusted: Option<IpAddr>) {
        match self.stations.get_mut(index) {
            // From any other address it must prove itself again.
            Some(station) if station.trusted != trusted => {
                // Where nobody vouches any more it stays where it is and is asked. Without an address the first datagram
                // in its name would take it elsewhere, a controller too.
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

    /// Where the station is sent to.
    pub(crate) fn peer(&self, index: usize) -> Option<SocketAddr> {
        Some(self.stations.get(index)?.current.as_ref()?.address)
    }

    /// Whether nothing has come of late from where the station is.
    pub(crate) fn is_quiet(&self, now: Duration, index: usize) -> bool {
        let station = self.stations.get(index);
        let current = station.and_then(|one| one.current.as_ref());
        current.is_none_or(|path| path.seen + QUIET <= now)
    }

    /// Whether the station has proved to be there, or the operator vouches for it.
    pub(crate) fn is_proven(&self, index: usize) -> bool {
        let current = self
            .stations
            .get(index)
            .and_then(|one| one.current.as_ref());
        current.is_some_and(|path| path.trusted || path.proven.is_some())
    }

    /// From where a station has sent for a while, and still does, without a proof; and where it is sent to, if elsewhere.
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

    /// Whether the last that came in a station's name was of Edition 2.5: where that came from is asked in it.
    pub(crate) fn asks_in_ed25(&self, index: usize) -> bool {
        self.stations.get(index).is_some_and(|one| one.ed25)
    }

    /// The edition in which a station is sent to.
    pub(crate) fn set_edition(&mut self, index: usize, ed25: bool) {
        if let Some(station) = self.stations.get_mut(index) {
            station.ed25 = ed25;
        }
    }

    /// A restart: the station was there before, and had proved it. One that had not starts again with its next message.
    pub(crate) fn restore(&mut self, now: Duration, index: usize, peer: SocketAddr, proven: bool) {
        let lease = self.limits.lease;
        let Some(station) = self.stations.get_mut(index) else {
            return;
        };
        let mut path = station.path(now, peer);
        if station.current.is_some() || !(proven || path.trusted) {
            return;
        }
        path.proven = proven.then_some(now);
        path.ask_at = now + lease / 2;
        station.answers = proven;
        station.current = Some(path);
    }

    /// A station is at the other end of a connection: a challenge was answered there, so that it is proven as long as that lasts.
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

    /// Its connection has ended: it is nowhere.
    pub(crate) fn disconnect(&mut self, index: usize) {
        if let Some(station) = self.stations.get_mut(index) {
            station.current = None;
            station.forget_rest();
        }
    }

    /// A message of `bytes` has come from an address. `controls`: the station holds LOI 3, 4 or 5.
    pub(crate) fn arrived(
        &mut self,
        now: Duration,
        index: usize,
        from: SocketAddr,
        bytes: usize,
        controls: impl FnOnce() -> bool,
    ) -> Arrival {
        let lease = self.limits.lease;
        let Some(station) = self.stations.get_mut(index) else {
            return Arrival::Current;
        };
        if let Some(current) = station.current.as_mut().filter(|path| path.address == from) {
            if current.has_lapsed(now, lease) {
                // Who has the address today may be another.
                current.proven = None;
                current.ask_at = now;
                current.pause = FIRST_PAUSE;
            }
            current.credit_for(now, bytes);
            return Arrival::Current;
        }
        let place = station.candidate(now, from);
        if let Some(place) = place {
            station.candidates[place].credit_for(now, bytes);
        }
        let controls = controls();
        let vouched = station.trusted == Some(from.ip());
        let free = match &station.current {
            None => true,
            Some(current) if current.has_lapsed(now, lease) => true,
            Some(current) => !current.trusted && current.proven.is_none() && !controls,
        };
        // A CUCS that can prove its address is held to it while it commands an aircraft.
        let must_prove = controls && station.answers && !vouched;
        match place {
            Some(place) if free && !must_prove => {
                station.adopt(place);
                Arrival::Moved
            }
            _ => {
                if vouched && let Some(current) = &mut station.current {
                    // Two ports of a believed address: the old one is asked whether it is still there.
                    current.ask_at = current.ask_at.min(now + FIRST_PAUSE);
                }
                Arrival::Unproven
            }
        }
    }

    /// A station whose edition has no heartbeat listens for as long as it likes, where the operator vouches for its address.
    pub(crate) fn keep(&mut self, now: Duration, index: usize) {
        let station = self.stations.get_mut(index);
        let current = station.and_then(|one| one.current.as_mut());
        if let Some(current) = current.filter(|path| path.trusted) {
            current.seen = now;
        }
    }

    /// Keeps a message back until its address is proven; false where there is no room.
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

    /// Forgets what came from elsewhere than where the station is: whoever has sent it is judged by another key from now on.
    pub(crate) fn forget_candidates(&mut self, index: usize) {
        if let Some(station) = self.stations.get_mut(index) {
            station.candidates.clear();
        }
    }

    /// What was held back from where the station is now.
    pub(crate) fn take_held(&mut self, index: usize) -> Vec<Held> {
        let current = self
            .stations
            .get_mut(index)
            .and_then(|one| one.current.as_mut());
        current
            .map(|path| std::mem::take(&mut path.held))
            .unwrap_or_default()
    }

    /// A proof that was not given again in time no longer counts, and a station that never proves anything moves once its
    /// old address is quiet. True where it has moved.
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
        let newest = station.movable().max_by_key(|(_, path)| path.seen);
        let Some(place) = newest.map(|(place, _)| place) else {
            return false;
        };
        station.adopt(place);
        true
    }

    /// When a station needs [`Paths::handle_timeout`], [`Paths::due_to_ask`] or [`Paths::next_waiting`] next.
    pub(crate) fn poll_timeout(&self, now: Duration) -> Option<Duration> {
        let each = self.stations.iter().flat_map(|station| {
            let proven = (station.current.as_ref())
                .is_some_and(|path| path.trusted || path.proven.is_some());
            let waits = proven && !station.waiting.is_empty();
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
            current: None,
            candidates: Vec::new(),
            answers: false,
            ed25: false,
            missed: false,
            unicast: Rate::default(),
            group: Rate::default(),
            waiting: VecDeque::new(),
            turn: 0,
        }
    }

    fn path(&self, now: Duration, address: SocketAddr) -> Path {
        Path {
            address,
            trusted: self.trusted == Some(address.ip()),
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

    /// The place of a candidate, where there is one or room for it.
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

    /// Of a full table the candidate goes that has answered `rounds` at most, and was seen longest ago: who has answered
    /// once has received something, and is not driven out by invented addresses.
    fn make_room(&mut self, rounds: u8) {
        if self.candidates.len() < MAX_CANDIDATES {
            return;
        }
        let unproven = self
            .candidates
            .iter()
            .enumerate()
            .filter(|(_, path)| path.rounds <= rounds);
        let oldest = unproven.min_by_key(|(_, path)| (path.rounds, path.seen));
        if let Some(place) = oldest.map(|(place, _)| place) {
            self.candidates.swap_remove(place);
        }
    }

    /// The station is where this candidate is. The old address becomes one: it may be the right one after all.
    fn adopt(&mut self, place: usize) {
        let new = self.candidates.swap_remove(place);
        if let Some(mut old) = self.current.replace(new) {
            (old.proven, old.rounds) = (None, 0);
            // It is asked with the next message from there. The time of a proven address is half a lease away, and until
            // then a station that returns, or a second program with its id, would be held back unasked.
            (old.ask_at, old.pause) = (Duration::ZERO, FIRST_PAUSE);
            self.candidates.push(old);
            // What went to the old address may have reached nobody.
            self.missed = true;
        }
        // What waits was meant for there: here it could be more than three times what came from here.
        self.waiting.clear();
    }

    /// What was of another place, or on its way there.
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
        // One that answers, and sends nothing of itself, is asked first whether it is still there.
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

/// Of a station that never proves anything the old address must have been silent for this long before it moves.
const QUIET: Duration = Duration::from_secs(3);
/// Who has not proved an address for so long is missing something that others send.
const UNPROVEN_FOR: Duration = Duration::from_secs(5);
/// Between two questions to an address, at first.
const FIRST_PAUSE: Duration = Duration::from_millis(500);
/// Addresses beside the current one, and messages held back of each.
const MAX_CANDIDATES: usize = 8;
const MAX_HELD: usize = 16;
/// How long a candidate is remembered: what is held back is no older than this when it is taken.
const FORGET_AFTER: Duration = Duration::from_secs(5);
const FLUSH_EVERY: Duration = Duration::from_millis(20);
