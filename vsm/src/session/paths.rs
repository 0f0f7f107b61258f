//! Where each CUCS is, and what may be sent there before it has proved that it is there.
//!
//! Anyone can write any source address into a datagram. Without proof the VSM would be a reflector (23 bytes of 40000
//! are answered by 21 kB), and one datagram in the controller's name would take its status, and its aircraft, elsewhere.
//! The rules are those of RFC 9000, section 8, without its tokens, which the DLI does not have:
//!
//! - **Proof.** A heartbeat (16002) of the VSM that requests an acknowledgement, with a stamp that nobody can know who has
//!   not received it: 11 bits of a keyed hash of station, address and time. Its 17000 names the stamp. [`ROUNDS`] of
//!   them in a row prove an address; of wrong ones [`MAX_WRONG`] are forgiven, so that who guesses is right once in 10^8
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

use std::collections::VecDeque;
use std::net::{IpAddr, SocketAddr};
use std::time::Duration;

use mavlink_link::Now;
use sha2::{Digest as _, Sha256};
use stanag_msgs::messages::{MessageAcknowledgement, VsmAuthorisationResponse};
use stanag_msgs::{TimeStamp, ed25};

use super::outbox::{Datagram, Destination};
use crate::config::Dli;

/// The paths of all stations, by their index.
#[derive(Debug, Default)]
pub(crate) struct Paths {
    /// Without it a stamp could be predicted.
    secret: [u8; 32],
    limits: Limits,
    stations: Vec<Station>,
}

/// What the configuration allows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Limits {
    /// How long status goes to an address from which nothing comes.
    pub(crate) lease: Duration,
    /// Bytes a second to one station.
    pub(crate) bytes_s: u32,
    /// Messages a second to one station.
    pub(crate) messages_s: u32,
}

impl Limits {
    /// What a configuration sets.
    pub(crate) fn of(dli: &Dli) -> Limits {
        Limits {
            lease: Duration::from_secs_f64(dli.lease_s),
            bytes_s: dli.max_bytes_s,
            messages_s: dli.max_messages_s,
        }
    }
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            lease: Duration::from_secs(60),
            bytes_s: 65_536,
            messages_s: 1_000,
        }
    }
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
    held: Vec<Box<[u8]>>,
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

/// What a 17000 of a heartbeat of ours is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Proof {
    /// None, or none any more.
    None,
    /// One of several: ask again.
    Round,
    /// The last. `moved`: the station is there from now on.
    Proven { moved: bool },
}

/// What is sent, and how much it matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// 17000 and 2: what a command or a request was sent for. Others' alerts leave credit for it.
    Acknowledgement,
    /// Another answer, or an alert: waits where it has no credit.
    Answer,
    /// A report of this type: the next one replaces it.
    Report(u16),
}

impl Kind {
    /// Of a datagram that is no report.
    pub(crate) fn of_answer(datagram: &Datagram) -> Kind {
        match datagram.message_type() {
            MessageAcknowledgement::ID | VsmAuthorisationResponse::ID => Kind::Acknowledgement,
            _ => Kind::Answer,
        }
    }
}

/// What becomes of a datagram.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Verdict {
    Send,
    Wait,
    Drop(&'static str),
}

impl Paths {
    pub(crate) fn new(limits: Limits, trusted: impl Iterator<Item = Option<IpAddr>>) -> Paths {
        Paths {
            secret: [0; 32],
            limits,
            stations: trusted.map(Station::new).collect(),
        }
    }

    /// What the configuration allows has changed.
    pub(crate) fn set_limits(&mut self, limits: Limits) {
        self.limits = limits;
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

    pub(crate) fn set_secret(&mut self, secret: [u8; 32]) {
        self.secret = secret;
    }

    /// Where the station is sent to.
    pub(crate) fn peer(&self, index: usize) -> Option<SocketAddr> {
        Some(self.stations.get(index)?.current.as_ref()?.address)
    }

    /// Whether the station has proved to be there, or the operator vouches for it.
    pub(crate) fn is_proven(&self, index: usize) -> bool {
        let current = self
            .stations
            .get(index)
            .and_then(|one| one.current.as_ref());
        current.is_some_and(|path| path.trusted || path.proven.is_some())
    }

    /// The edition in which a station is sent to.
    pub(crate) fn set_edition(&mut self, index: usize, ed25: bool) {
        if let Some(station) = self.stations.get_mut(index) {
            station.ed25 = ed25;
        }
    }

    /// How many bytes a datagram has once it leaves, as far as that is known before.
    pub(crate) fn bytes_of(&self, index: usize, datagram: &Datagram) -> usize {
        let station = self.stations.get(index);
        station.map_or(datagram.bytes().len(), |one| one.bytes_of(datagram))
    }

    /// How many bytes a question was charged as.
    pub(crate) fn question_bytes(&self, index: usize) -> usize {
        let station = self.stations.get(index);
        question_bytes(station.is_some_and(|one| one.ed25))
    }

    /// What was charged as so many bytes has become so many: false where the address may not be sent them.
    pub(crate) fn settle(
        &mut self,
        index: usize,
        to: Destination,
        charged: usize,
        bytes: usize,
    ) -> bool {
        let limits = self.limits;
        let Some(station) = self.stations.get_mut(index) else {
            return true;
        };
        let (path, rate) = match to {
            Destination::Unicast(address) => {
                let all = station.current.iter_mut().chain(&mut station.candidates);
                let path = all.into_iter().find(|path| path.address == address);
                (path, &mut station.unicast)
            }
            Destination::Multicast => (station.current.as_mut(), &mut station.group),
        };
        rate.settle(charged, bytes, &limits);
        let Some(path) = path.filter(|path| !path.trusted && path.proven.is_none()) else {
            return true;
        };
        let credit = match to {
            Destination::Unicast(_) => &mut path.credit,
            Destination::Multicast => &mut path.group_credit,
        };
        let available = *credit + charged;
        // What may not go has cost nothing.
        *credit = available.checked_sub(bytes).unwrap_or(available);
        station.missed |= available < bytes;
        available >= bytes
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
    pub(crate) fn hold(&mut self, index: usize, from: SocketAddr, bytes: &[u8]) -> bool {
        let station = self.stations.get_mut(index);
        let paths = station.map(|one| one.candidates.iter_mut());
        let Some(path) = paths.and_then(|mut all| all.find(|path| path.address == from)) else {
            return false;
        };
        let room = path.held.len() < MAX_HELD;
        if room {
            path.held.push(bytes.into());
        }
        room
    }

    /// What was held back from where the station is now.
    pub(crate) fn take_held(&mut self, index: usize) -> Vec<Box<[u8]>> {
        let current = self
            .stations
            .get_mut(index)
            .and_then(|one| one.current.as_mut());
        current
            .map(|path| std::mem::take(&mut path.held))
            .unwrap_or_default()
    }

    /// The stamp of the heartbeat that asks this address for a proof, where it is time to ask and there is credit for it.
    /// `again`: an answer has just come, so the next is asked for at once.
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
        let question = station.question_bytes();
        let round = match station.find(address) {
            Some(path) => {
                // An address that is believed is asked only where there is another.
                let idle = path.trusted && !contested;
                if !again && (idle || path.ask_at > now.mono) {
                    return None;
                }
                if path.proven.is_none() && !path.trusted {
                    let left = path.credit.checked_sub(question)?;
                    // One question may take the place of the answer for a moment. A CUCS that never acknowledges would get
                    // nothing else.
                    if !again
                        && answer.is_some_and(|bytes| (left + 1..=path.credit).contains(&bytes))
                    {
                        return None;
                    }
                    path.credit = left;
                }
                path.ask_at = now.mono + path.pause;
                if path.rounds == 0 && !again {
                    path.pause = (path.pause * 2).min(LONGEST_PAUSE);
                }
                path.rounds
            }
            // The table is full of others: it is asked without being remembered. What came was longer than what goes.
            None => 0,
        };
        let slot = slot(now.wall).saturating_sub(1);
        Some(TimeStamp(
            slot << BITS | self.cookie(index, address, round, slot),
        ))
    }

    /// A 17000 of a heartbeat of ours names this stamp.
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
        let (made, today) = (stamp.0 >> BITS, slot(now.wall));
        let recent = (1..=MAX_AGE).any(|age| made + age == today);
        let is_of = |round| recent && stamp.0 & MASK == self.cookie(index, from, round, made);
        let right = is_of(round);
        // A network that duplicates does not guess.
        if !right && (0..ROUNDS).any(is_of) {
            return Proof::None;
        }
        let lease = self.limits.lease;
        let station = &mut self.stations[index];
        if right && station.find(from).is_none() {
            // It has received what was sent there: it may take the place of one of which that is not known.
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

    /// Whether the station has missed something since this was last asked.
    pub(crate) fn take_missed(&mut self, index: usize) -> bool {
        let station = self.stations.get_mut(index);
        station.is_some_and(|station| std::mem::take(&mut station.missed))
    }

    /// What becomes of a datagram of `bytes` to a station.
    pub(crate) fn admit(
        &mut self,
        now: Duration,
        index: usize,
        bytes: usize,
        kind: Kind,
    ) -> Verdict {
        let limits = self.limits;
        // A station that is not kept here is none of the configuration: tests of one machine.
        let Some(station) = self.stations.get_mut(index) else {
            return Verdict::Send;
        };
        let verdict = station.admit(now, bytes, kind, &limits);
        if !matches!(kind, Kind::Report(_)) && matches!(verdict, Verdict::Drop(_)) {
            station.missed = true;
        }
        verdict
    }

    /// Whether a copy to the group is within the rate of its station, and within three times what has come from it where
    /// that has not proved itself: whoever writes its id makes the VSM send to all who listen.
    pub(crate) fn admit_to_group(
        &mut self,
        now: Duration,
        index: usize,
        bytes: usize,
        kind: Kind,
    ) -> bool {
        let limits = self.limits;
        let station = self.stations.get_mut(index);
        station.is_none_or(|station| station.admit_to_group(now, bytes, kind, &limits))
    }

    /// Lets an answer wait for its credit.
    pub(crate) fn wait(&mut self, now: Duration, index: usize, datagram: Datagram) {
        if let Some(station) = self.stations.get_mut(index) {
            if station.waiting.len() == MAX_WAITING {
                station.waiting.pop_front();
                station.missed = true;
            }
            // An acknowledgement overtakes alerts here, as it does where it has credit at once.
            let is_first = |one: &Datagram| Kind::of_answer(one) == Kind::Acknowledgement;
            let ahead = if is_first(&datagram) {
                let mut waiting = station.waiting.iter();
                waiting.position(|(_, other)| !is_first(other))
            } else {
                None
            };
            let place = ahead.unwrap_or(station.waiting.len());
            station
                .waiting
                .insert(place, (now + LONGEST_WAIT, datagram));
        }
    }

    /// What waits for the station was written as it does not read any more.
    pub(crate) fn drop_waiting(&mut self, index: usize) {
        if let Some(station) = self.stations.get_mut(index) {
            station.missed |= !station.waiting.is_empty();
            station.waiting.clear();
        }
    }

    /// The next answer that has waited and may go now.
    pub(crate) fn next_waiting(&mut self, now: Duration, index: usize) -> Option<Datagram> {
        let limits = self.limits;
        let station = self.stations.get_mut(index)?;
        loop {
            let (until, datagram) = station.waiting.pop_front()?;
            if until < now {
                station.missed = true;
                continue;
            }
            let rest = std::mem::take(&mut station.waiting);
            let kind = Kind::of_answer(&datagram);
            let verdict = station.admit(now, station.bytes_of(&datagram), kind, &limits);
            station.waiting = rest;
            match verdict {
                Verdict::Send => return Some(datagram),
                Verdict::Wait => {
                    station.waiting.push_front((until, datagram));
                    return None;
                }
                Verdict::Drop(_) => station.missed = true,
            }
        }
    }

    /// The address that a timer must ask for its proof again.
    pub(crate) fn due_to_ask(&self, now: Duration, index: usize) -> Option<SocketAddr> {
        let station = self.stations.get(index)?;
        let at = station.asks_at(&self.limits, now)?;
        (at <= now).then(|| station.current.as_ref().map(|path| path.address))?
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

    /// What nobody can know who has not received it.
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

    /// The bytes of the acknowledgement that waits first.
    fn next_answer(&self) -> Option<usize> {
        let (_, datagram) = self.waiting.front()?;
        (Kind::of_answer(datagram) == Kind::Acknowledgement).then(|| self.bytes_of(datagram))
    }

    fn bytes_of(&self, datagram: &Datagram) -> usize {
        let bytes = datagram.bytes();
        if self.ed25 && !ed25::is_ed25(bytes) {
            // No message has grown by more; `settle` knows.
            bytes.len() * 9 / 5
        } else {
            bytes.len()
        }
    }

    fn acknowledgement_bytes(&self) -> usize {
        if self.ed25 {
            ACKNOWLEDGEMENT_BYTES * 9 / 5
        } else {
            ACKNOWLEDGEMENT_BYTES
        }
    }

    fn question_bytes(&self) -> usize {
        question_bytes(self.ed25)
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

    /// When a timer asks: who has answered before, until the lease is over; else only as long as an answer may have been
    /// lost, of what is left of the credit.
    fn asks_at(&self, limits: &Limits, now: Duration) -> Option<Duration> {
        let current = self.current.as_ref()?;
        let asks = if current.trusted {
            self.movable().next().is_some()
        } else {
            let may_answer = current.may_be_asked() && current.credit >= self.question_bytes();
            current.proven.is_some() || may_answer
        };
        (asks && !current.has_lapsed(now, limits.lease)).then_some(current.ask_at)
    }

    fn admit_to_group(&mut self, now: Duration, bytes: usize, kind: Kind, limits: &Limits) -> bool {
        let current = self.current.as_mut();
        let Some(path) = current.filter(|path| !path.trusted && path.proven.is_none()) else {
            return self.group.take(now, bytes, kind, limits);
        };
        if let Kind::Report(_) = kind {
            // Status and alerts of who listens: a station that proves nothing, as one that only sends, needs them, too.
            let slow = Limits {
                bytes_s: limits.bytes_s.min(UNPROVEN_GROUP_BYTES_S),
                ..*limits
            };
            return self.group.take(now, bytes, kind, &slow);
        }
        let may = path.group_credit >= bytes && self.group.take(now, bytes, kind, limits);
        if may {
            path.group_credit -= bytes;
        }
        may
    }

    fn admit(&mut self, now: Duration, bytes: usize, kind: Kind, limits: &Limits) -> Verdict {
        let (question, acknowledgement) = (self.question_bytes(), self.acknowledgement_bytes());
        let Some(current) = &mut self.current else {
            return Verdict::Drop("no address");
        };
        if current.has_lapsed(now, limits.lease) {
            return Verdict::Drop("lease over");
        }
        let behind_others = !matches!(kind, Kind::Report(_)) && !self.waiting.is_empty();
        if current.trusted || current.proven.is_some() {
            return if !behind_others && self.unicast.take(now, bytes, kind, limits) {
                Verdict::Send
            } else if let Kind::Report(_) = kind {
                Verdict::Drop("over the rate")
            } else {
                Verdict::Wait
            };
        }
        if let Kind::Report(report) = kind {
            // One after the other: the short ones would leave no credit for the position.
            let turn = TURNS[self.turn % TURNS.len()];
            let other = !TURNS.contains(&report);
            if report != turn && !(turn == OTHER && other) || !self.waiting.is_empty() {
                return Verdict::Drop("unproven address");
            }
        }
        // What is sent leaves enough to ask again: who sends nothing more, and lost the question, would never be served. Of
        // who does not answer questions the commands are acknowledged first, in whatever handovers and alerts of others.
        let overdue = kind == Kind::Acknowledgement && current.ask_at <= now;
        let asked = current.is_asked() && !overdue;
        let kept = match kind {
            _ if asked => 2 * question,
            Kind::Acknowledgement => 0,
            _ => 2 * acknowledgement,
        };
        let behind_others = behind_others && (asked || kind != Kind::Acknowledgement);
        if behind_others || current.credit < bytes + kept {
            return match kind {
                Kind::Report(_) => Verdict::Drop("unproven address"),
                _ => Verdict::Wait,
            };
        }
        current.credit -= bytes;
        if let Kind::Report(_) = kind {
            self.turn = (self.turn + 1) % TURNS.len();
        }
        Verdict::Send
    }
}

impl Path {
    /// Whether it may still answer: it has answered a round, or was not asked twice in vain yet.
    fn is_asked(&self) -> bool {
        self.rounds > 0 || self.pause <= 2 * FIRST_PAUSE
    }

    /// Whether a timer asks it: so often that five losses in a row are needed for a station that sends nothing more to be
    /// left without an answer. Of what is left of its credit: after the second question answers go first.
    fn may_be_asked(&self) -> bool {
        self.rounds > 0 || self.pause <= 16 * FIRST_PAUSE
    }

    fn has_lapsed(&self, now: Duration, lease: Duration) -> bool {
        now.saturating_sub(self.seen) > lease
    }

    fn credit_for(&mut self, now: Duration, bytes: usize) {
        self.seen = now;
        if self.trusted || self.proven.is_some() {
            return;
        }
        self.credit = (self.credit + 3 * bytes).min(MAX_CREDIT);
        self.group_credit = (self.group_credit + 3 * bytes).min(MAX_CREDIT);
    }
}

/// A rate with a burst: the time at which everything sent so far would have been paid for.
#[derive(Debug, Default)]
struct Rate {
    bytes: Duration,
    messages: Duration,
}

impl Rate {
    /// Whether it may be sent now. Reports leave the last of the burst to answers.
    fn take(&mut self, now: Duration, bytes: usize, kind: Kind, limits: &Limits) -> bool {
        let burst = match kind {
            Kind::Report(_) => BURST / 2,
            _ => BURST,
        };
        let paid = |at: Duration| at.saturating_sub(now) <= burst;
        if !paid(self.bytes) || !paid(self.messages) {
            return false;
        }
        let nanos = |count: u64, a_second: u32| {
            Duration::from_nanos(count * 1_000_000_000 / u64::from(a_second.max(1)))
        };
        self.bytes = self.bytes.max(now) + nanos(bytes as u64, limits.bytes_s);
        self.messages = self.messages.max(now) + nanos(1, limits.messages_s);
        true
    }

    /// What was taken as so many bytes has become so many.
    fn settle(&mut self, taken: usize, bytes: usize, limits: &Limits) {
        let a_second = u64::from(limits.bytes_s.max(1));
        let nanos = |bytes: usize| Duration::from_nanos(bytes as u64 * 1_000_000_000 / a_second);
        self.bytes = (self.bytes + nanos(bytes)).saturating_sub(nanos(taken));
    }
}

/// The bytes of a question, by the edition of its station.
pub(crate) fn question_bytes(ed25: bool) -> usize {
    if ed25 {
        QUESTION_ED25_BYTES
    } else {
        QUESTION_BYTES
    }
}

/// The part of a stamp that lies above what is unpredictable, ms since 2000.
fn slot(wall: Duration) -> u64 {
    let ms = u64::try_from(wall.as_millis()).unwrap_or(u64::MAX);
    TimeStamp::from_unix_ms(ms).0 >> BITS
}

/// Unpredictable bits of a stamp: it lies up to 4.1 s back, which a clock may be wrong by.
const BITS: u32 = 11;
const MASK: u64 = (1 << BITS) - 1;
/// An answer may take this many times 2 s.
const MAX_AGE: u64 = 4;
/// Answers in a row that prove an address, each a round trip.
const ROUNDS: u8 = 3;
/// Wrong answers before the rounds start again.
const MAX_WRONG: u8 = 8;
/// 17000 with its wrapper: a command is acknowledged as received, and as carried out.
const ACKNOWLEDGEMENT_BYTES: usize = 34;
/// A heartbeat with its wrapper, summed or not.
const QUESTION_BYTES: usize = 26;
/// The same of Edition 2.5: #1401, and #1403, which that makes subject to an acknowledgement.
const QUESTION_ED25_BYTES: usize = 128;
const FIRST_PAUSE: Duration = Duration::from_millis(500);
/// A CUCS that never answers is asked as seldom as this.
const LONGEST_PAUSE: Duration = Duration::from_secs(64);
/// Of a station that never proves anything the old address must have been silent for this long before it moves.
const QUIET: Duration = Duration::from_secs(3);
/// Addresses beside the current one, and messages held back of each.
const MAX_CANDIDATES: usize = 8;
const MAX_HELD: usize = 16;
/// How long a candidate is remembered: what is held back is no older than this when it is taken.
const FORGET_AFTER: Duration = Duration::from_secs(5);
/// Answers that wait for credit, and for how long.
const MAX_WAITING: usize = 256;
const LONGEST_WAIT: Duration = Duration::from_secs(2);
const FLUSH_EVERY: Duration = Duration::from_millis(20);
/// What a CUCS without proof can save up, bytes.
const MAX_CREDIT: usize = 32_768;
/// Status and alerts in the group for a station that has proved nothing: some vehicles at their usual rates, and no flood.
const UNPROVEN_GROUP_BYTES_S: u32 = 8_192;
/// What may be sent at once, in seconds of the rate.
const BURST: Duration = Duration::from_secs(4);
/// Reports to an address without proof, in this order: position and state most often. `OTHER`: what 17001 has scheduled.
const TURNS: [u16; 6] = [4000, 3001, 4000, 3002, 4001, OTHER];
const OTHER: u16 = 0;
