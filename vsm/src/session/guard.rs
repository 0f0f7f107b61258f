//! One end of a guarded path between a CUCS and a VSM: seals datagrams, and decides which received datagrams are accepted.
//!
//! Both ends are the same machine: the bridge has one for each CUCS with a guard key, `vsm guard` one for its VSM. The trailer
//! itself is [`stanag_msgs::guard`]'s.
//!
//! Promised:
//! - No datagram is accepted, and no state changes, before its trailer has verified.
//! - No datagram is accepted twice, not even after a restart, a crash or a step of a clock. Stamps are those of the signing
//!   clock of MAVLink ([`SigningClock`]): none is sent or accepted beyond a ceiling that is on disk, and a start begins
//!   above it.
//! - Reordered datagrams are accepted, up to [`WINDOW`] datagrams and [`MAX_DELAY`] late: the DLI cannot recover them in
//!   another way.
//! - The clocks of both computers may differ by an hour. How late a datagram is, is measured against the newest of the same
//!   sender, carried on by the monotonic clock, and not against this computer's wall clock: a station whose clock is wrong by
//!   a minute would command nothing.
//!
//! If one end's stamps are too old for the other (after a restart, or when a computer slept), the other raises them: it
//! answers a verified datagram that is too old with an empty datagram, and the next stamp will be above that of the answer.
//! The answer is no longer than the datagram it answers, and is sent at most five times a second under each key.
//!
//! `clock` lets two ends agree on a clock if theirs are more than an hour apart; `group` is the one-way path to a multicast
//! group.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::{Ceiling, ClockError, Origin, SigningClock};
use mavlink_link::signing::{KeyId, SigningKey, Stamp};
use mavlink_link::store::{Disk, Store as _, StoreError};
use stanag_msgs::Id;
use stanag_msgs::guard::{
    ConnectionKey, Direction, GuardKey, Guarded, MAX_GUARDED, Offer, Trailer,
};

use super::counters::Counters;
use super::web::Hello;

mod clock;
mod group;
mod turn;

pub use self::group::GroupReceiver;
pub(crate) use self::group::GroupSender;
use self::turn::{Asked, Turn};

/// A key for an end, and until when (monotonic) it is accepted; `None` for the one in force.
pub type GuardKeyUntil = (SigningKey, Option<Duration>);

/// The machine.
#[derive(Debug)]
pub struct GuardEnd {
    own: Id,
    peer: Id,
    sends: Direction,
    /// The one in force first.
    keys: Vec<Keyed>,
    /// The key under which the other end last sent: it certainly has that one.
    in_use: usize,
    /// The key and stamp of the last datagram that verified but was not accepted: its sender can be sent an answer under that
    /// key.
    unbelieved: Option<(usize, Stamp)>,
    /// A datagram that first verified from another address than its sender's.
    elsewhere: VecDeque<Elsewhere>,
    verified: u64,
    /// When a frame of a web client last verified.
    framed: Option<Duration>,
    /// How far the clock has moved forward to that of the other end, until it is reported.
    met: Option<Duration>,
    /// A key that was in force when the other end used it.
    used: Option<KeyId>,
    /// No key ends before this (monotonic), unless the other end uses the one in force: see [`GuardEnd::give_grace`].
    grace: Duration,
    refused: Counters,
}

/// One key and the state of its stamps.
#[derive(Debug)]
struct Keyed {
    key: GuardKey,
    id: KeyId,
    until: Option<Duration>,
    clock: SigningClock,
    window: Window,
    /// What a lift may answer.
    lifts: Turn,
    asked: Asked,
}

/// A datagram that arrived from another address than its sender's: for a moment it is accepted once more from the sender's
/// own address. Otherwise an attacker who sends copies faster than the originals could silence the sender.
#[derive(Debug)]
struct Elsewhere {
    trailer: Trailer,
    /// Under which it has verified.
    key: KeyId,
    at: Duration,
    sender: SocketAddr,
}

/// Why a datagram is not accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GuardRefusal {
    /// It has the opposite direction: it was sent back to its sender.
    Direction,
    /// It is of another sender.
    Sender,
    /// No key here has its key id.
    Key,
    /// The trailer is not the sender's, or the datagram was changed.
    Forged,
    /// It has been accepted before.
    Replayed,
    /// Older than all that are remembered, or from before the start of this end.
    Old,
    /// It was delayed in transit.
    Late,
    /// It is stamped over an hour ahead of this end's clock, which nobody has proved to be so late.
    Ahead,
    /// It answers no challenge of this end, or none of late.
    Unasked,
    /// The disk does not have the ceiling of its stamp yet.
    Disk,
}

impl GuardRefusal {
    /// Its counter.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            GuardRefusal::Direction => "guard: sent back",
            GuardRefusal::Sender => "guard: another sender",
            GuardRefusal::Key => "guard: unknown key",
            GuardRefusal::Forged => "guard: wrong trailer",
            GuardRefusal::Replayed => "guard: replayed",
            GuardRefusal::Old => "guard: too old",
            GuardRefusal::Late => "guard: held back on its way",
            GuardRefusal::Ahead => "guard: over an hour ahead",
            GuardRefusal::Unasked => "guard: answers no challenge",
            GuardRefusal::Disk => "guard: waits for the disk",
        }
    }

    /// Whether the other end must learn this end's stamps before any of its datagrams is accepted.
    #[must_use]
    pub const fn wants_lift(self) -> bool {
        matches!(self, GuardRefusal::Old | GuardRefusal::Late)
    }

    /// Whether the sender is to be sent something, if it is its turn: see [`GuardEnd::reply`].
    #[must_use]
    pub const fn wants_reply(self) -> bool {
        self.wants_lift() || matches!(self, GuardRefusal::Ahead)
    }
}

/// The state of an end, for the status.
#[derive(Debug, Clone, serde::Serialize)]
pub struct GuardStatus {
    /// The id of the key in force; `None` if there is none, so that nothing is accepted.
    pub key_id: Option<String>,
    /// The id of the key before, while it is still accepted.
    pub previous_key_id: Option<String>,
    /// Whether the other end still sends under that.
    pub uses_previous: bool,
    /// Number of accepted datagrams.
    pub verified: u64,
    /// Since the last of them, s.
    pub verified_s: Option<f64>,
    /// Datagrams with a trailer in this sender's name that were not, by the reason.
    pub refused: Counters,
}

impl GuardEnd {
    /// An end that accepts `peer` under these keys, the one in force first, and sends as `own`.
    ///
    /// # Errors
    /// The clock of a key cannot be read.
    pub fn new(
        (own, peer): (Id, Id),
        sends: Direction,
        keys: Vec<GuardKeyUntil>,
        not_before: Duration,
        now: Now,
        disk: &mut dyn Disk,
    ) -> Result<GuardEnd, StoreError> {
        let mut end = GuardEnd {
            own,
            peer,
            sends,
            keys: Vec::new(),
            in_use: 0,
            unbelieved: None,
            elsewhere: VecDeque::new(),
            verified: 0,
            framed: None,
            met: None,
            used: None,
            grace: Duration::ZERO,
            refused: Counters::default(),
        };
        end.set_keys(keys, not_before, now, disk)?;
        Ok(end)
    }

    /// Continues with these keys; keeps the state of those that stay.
    ///
    /// # Errors
    /// The clock of a key cannot be read; nothing has changed then.
    pub fn set_keys(
        &mut self,
        keys: Vec<GuardKeyUntil>,
        not_before: Duration,
        now: Now,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        let mut new = Vec::new();
        for (key, until) in &keys {
            let id = key.id();
            let known = self.keys.iter().any(|one| one.id == id);
            if !known {
                let stored = disk.load(&id)?.map(|Ceiling(stamp)| stamp);
                let not_before = Stamp::from_unix(not_before);
                new.push(Keyed {
                    key: GuardKey::new(key.expose()),
                    id,
                    until: *until,
                    clock: SigningClock::start(id, Origin::KeyFile, stored, not_before, now),
                    window: Window::default(),
                    lifts: Turn::default(),
                    asked: Asked::default(),
                });
            }
        }
        let in_use = self.keys.get(self.in_use).map(|one| one.id);
        let mut known = std::mem::take(&mut self.keys);
        known.append(&mut new);
        for (key, until) in keys {
            if let Some(place) = known.iter().position(|one| one.id == key.id()) {
                let mut keyed = known.swap_remove(place);
                // No later reading of the wall clock shortens what the monotonic clock counts.
                keyed.until = until.map(|until| until.max(keyed.until.unwrap_or_default()));
                self.keys.push(keyed);
            }
        }
        let stays = |id| self.keys.iter().position(|one| Some(one.id) == id);
        self.in_use = match self.sends {
            Direction::ToCucs => stays(in_use).unwrap_or(0),
            Direction::ToVsm | Direction::ToGroup => 0,
        };
        self.keep(now, disk);
        Ok(())
    }

    /// Keeps the ceilings ahead of the clocks, so that nothing that is sent or received waits for a disk; once a second.
    pub fn keep(&mut self, now: Now, disk: &mut dyn Disk) {
        self.drop_expired(now.mono);
        for keyed in &mut self.keys {
            keyed.clock.watch_wall(now);
            keyed.clock.waits(now, disk);
        }
    }

    /// Lets no key end before this, until the other end uses the one in force: the time at which the one before ends may have
    /// been read from a wrong clock, and the other end may have no other key yet.
    pub(crate) fn give_grace(&mut self, until: Duration) {
        self.grace = until;
    }

    /// The key in force, once the other end has used it in this run.
    pub(crate) fn used(&self) -> Option<KeyId> {
        self.used.filter(|key| self.in_force() == Some(*key))
    }

    fn note_use(&mut self, place: usize, key: KeyId) {
        if place == 0 {
            (self.used, self.grace) = (Some(key), Duration::ZERO);
        }
    }

    fn drop_expired(&mut self, now: Duration) {
        let grace = self.grace;
        if self.keys.iter().any(|one| one.is_over(now, grace)) {
            let in_use = self.keys.get(self.in_use).map(|one| one.id);
            self.keys.retain(|one| !one.is_over(now, grace));
            let stays = |id| self.keys.iter().position(|one| Some(one.id) == id);
            self.in_use = stays(in_use).unwrap_or(0);
        }
    }

    /// The content of an accepted datagram; empty if it only raises the stamps.
    ///
    /// # Errors
    /// It is not: why.
    pub fn open<'a>(
        &mut self,
        now: Now,
        guarded: &Guarded<'a>,
        disk: &mut dyn Disk,
    ) -> Result<&'a [u8], GuardRefusal> {
        let opened = self.judge(now, guarded, disk);
        self.count(opened).map(|(inside, _)| inside)
    }

    /// As [`open`](Self::open), of a datagram that has come from this address, with the key that it has verified under. `sender`: where
    /// its sender is, if that is known; what a copy from elsewhere has used up is taken once more from there.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn open_from<'a>(
        &mut self,
        now: Now,
        guarded: &Guarded<'a>,
        (from, sender): (SocketAddr, Option<SocketAddr>),
        disk: &mut dyn Disk,
    ) -> Result<(&'a [u8], KeyId), GuardRefusal> {
        let trailer = guarded.trailer;
        self.elsewhere.retain(|one| one.at + ELSEWHERE > now.mono);
        let mut opened = self.judge(now, guarded, disk);
        let copied = |one: &Elsewhere| one.trailer == trailer && one.sender == from;
        // It has verified, as its copy did.
        if opened == Err(GuardRefusal::Replayed)
            && let Some(place) = self.elsewhere.iter().position(copied)
        {
            // Report its own key, whatever has verified since: its permissions are those of that key.
            let known = self.elsewhere.remove(place);
            opened = known
                .map(|one| (guarded.datagram, one.key))
                .ok_or(GuardRefusal::Replayed);
        } else if let Ok((_, key)) = opened
            && let Some(sender) = sender.filter(|sender| *sender != from)
        {
            if self.elsewhere.len() == WINDOW {
                self.elsewhere.pop_front();
            }
            let at = now.mono;
            self.elsewhere.push_back(Elsewhere {
                trailer,
                key,
                at,
                sender,
            });
        }
        self.count(opened)
    }

    fn count<T>(&mut self, opened: Result<T, GuardRefusal>) -> Result<T, GuardRefusal> {
        match opened {
            Ok(_) => self.verified += 1,
            Err(why) => self.refused.count(why.name()),
        }
        opened
    }

    fn judge<'a>(
        &mut self,
        now: Now,
        guarded: &Guarded<'a>,
        disk: &mut dyn Disk,
    ) -> Result<(&'a [u8], KeyId), GuardRefusal> {
        let trailer = &guarded.trailer;
        self.judge_way(trailer)?;
        let (own, grace) = (self.own, self.grace);
        let mut named = self.keys.iter_mut().enumerate();
        let mut named = named
            .by_ref()
            .filter(|(_, one)| one.key.id() == trailer.key_id && !one.is_over(now.mono, grace))
            .peekable();
        if named.peek().is_none() {
            return Err(GuardRefusal::Key);
        }
        let verified = named.find(|(_, one)| one.key.verifies(guarded, own));
        let Some((place, keyed)) = verified else {
            return Err(GuardRefusal::Forged);
        };
        self.unbelieved = None;
        let stamp = stamp_of(trailer.stamp_us).ok_or(GuardRefusal::Ahead)?;
        // Do not update the key in use: a replay under the previous key would cause everything to be sealed under that.
        self.unbelieved = Some((place, stamp));
        if !keyed.clock.allows(stamp, now) {
            return Err(GuardRefusal::Ahead);
        }
        if stamp <= keyed.clock.floor() {
            return Err(GuardRefusal::Old);
        }
        keyed.window.judge(now.mono, stamp)?;
        let followed = keyed.clock.follow(stamp, now, disk);
        followed.map_err(|_| GuardRefusal::Disk)?;
        keyed.window.take(now.mono, stamp);
        let key = keyed.id;
        self.unbelieved = None;
        self.note_use(place, key);
        // A VSM answers under the key that its CUCS uses. A CUCS sends under the key in force: if it followed too, datagrams
        // in transit during a key rotation would make both ends switch back and forth.
        if self.sends == Direction::ToCucs {
            self.in_use = place;
        }
        Ok((guarded.datagram, key))
    }

    fn judge_way(&self, trailer: &Trailer) -> Result<(), GuardRefusal> {
        if Some(trailer.direction) != self.sends.back() {
            return Err(GuardRefusal::Direction);
        }
        if trailer.sender != self.peer {
            return Err(GuardRefusal::Sender);
        }
        Ok(())
    }

    /// Seals an empty datagram under a key that the other end may have, to find out by its answer; returns the length.
    ///
    /// # Errors
    /// As [`seal`](Self::seal).
    pub fn probe(
        &mut self,
        key: KeyId,
        now: Now,
        out: &mut [u8; MAX_GUARDED],
        disk: &mut dyn Disk,
    ) -> Result<usize, SealError> {
        let place = self.keys.iter().position(|one| one.id == key);
        self.seal_under(place.ok_or(SealError::NoKey)?, now, &[], out, disk)
    }

    /// Seals an offer of a group key under the key that the other end has shown to have; the length.
    ///
    /// # Errors
    /// As [`seal`](Self::seal).
    pub(crate) fn seal_offer(
        &mut self,
        now: Now,
        offer: &Offer,
        out: &mut [u8; MAX_GUARDED],
        disk: &mut dyn Disk,
    ) -> Result<usize, SealError> {
        self.drop_expired(now.mono);
        let place = self.in_use;
        let keyed = self.keys.get_mut(place).ok_or(SealError::NoKey)?;
        // A stamp is used once, also after restarts, so no nonce is used twice.
        let stamp = micros(keyed.clock.take(now, disk)?);
        let inside = keyed.key.wrap(stamp, offer).ok_or(SealError::NoKey)?;
        self.seal_under(place, now, &inside, out, disk)
    }

    /// The group key in what has verified under this key.
    #[must_use]
    pub fn unwrap_offer(&self, key: KeyId, inside: &[u8]) -> Option<Offer> {
        let keyed = self.keys.iter().find(|one| one.id == key)?;
        keyed.key.unwrap(inside)
    }

    /// Seals a datagram under the key that the other end has shown to have; returns the length.
    ///
    /// # Errors
    /// There is no key, or no stamp for it: nothing may be sent.
    pub fn seal(
        &mut self,
        now: Now,
        datagram: &[u8],
        out: &mut [u8; MAX_GUARDED],
        disk: &mut dyn Disk,
    ) -> Result<usize, SealError> {
        self.drop_expired(now.mono);
        self.seal_under(self.in_use, now, datagram, out, disk)
    }

    fn seal_under(
        &mut self,
        place: usize,
        now: Now,
        datagram: &[u8],
        out: &mut [u8; MAX_GUARDED],
        disk: &mut dyn Disk,
    ) -> Result<usize, SealError> {
        let sender = (self.own, self.sends);
        let keyed = self.keys.get_mut(place).ok_or(SealError::NoKey)?;
        let trailer = keyed.trailer(sender, now, disk)?;
        let sealed = keyed.key.seal(&trailer, self.peer, datagram, out);
        Ok(sealed?)
    }

    /// Answers the last refusal, if an answer is due: what was too old with an empty datagram, which raises the sender's stamps,
    /// what was too far ahead with a challenge. Neither is longer than what it answers. Returns its length.
    pub fn reply(
        &mut self,
        now: Now,
        out: &mut [u8; MAX_GUARDED],
        disk: &mut dyn Disk,
    ) -> Option<usize> {
        let (place, stamp) = self.unbelieved.take()?;
        let keyed = self.keys.get_mut(place)?;
        // Each stamp is answered once, and the sender's current stamp is above all recorded ones: replays get one answer
        // each and cannot use up the answer to the sender. Five a second, by the time of either end.
        if !keyed.clock.allows(stamp, now) {
            return self.challenge(place, stamp, now, out, disk);
        }
        if !keyed.lifts.take(stamp, now.mono, LIFT_EVERY) {
            return None;
        }
        self.seal_under(place, now, &[], out, disk).ok()
    }

    /// The keys of the connection that a web client opens, and the key of the station that it has.
    pub(crate) fn open_connection(
        &mut self,
        now: Duration,
        hello: &Hello<'_>,
    ) -> Option<(KeyId, ConnectionKey)> {
        self.drop_expired(now);
        let mut keys = self.keys.iter().enumerate();
        let (place, id, key) =
            keys.find_map(|(place, one)| Some((place, one.id, hello.verify(&one.key)?)))?;
        self.in_use = place;
        self.note_use(place, id);
        Some((id, key))
    }

    /// A frame of a web client has verified under this key; returns false if the key is no longer accepted.
    pub(crate) fn takes_frame(&mut self, now: Duration, key: KeyId) -> bool {
        let accepted = self.accepts(now, key);
        if accepted {
            self.verified += 1;
            self.framed = Some(now);
        }
        accepted
    }

    /// Whether what is sealed under this key is accepted.
    pub(crate) fn accepts(&self, now: Duration, key: KeyId) -> bool {
        let mut keys = self.keys.iter();
        keys.any(|one| one.id == key && !one.is_over(now, self.grace))
    }

    /// The accepted keys.
    pub(crate) fn key_ids(&self) -> impl Iterator<Item = KeyId> + '_ {
        self.keys.iter().map(|one| one.id)
    }

    /// Whether the other end may have this key, so that datagrams under it are accepted.
    #[must_use]
    pub fn has(&self, key: KeyId) -> bool {
        self.key_ids().any(|known| known == key)
    }

    /// The key in force: the other end is to have it.
    #[must_use]
    pub fn in_force(&self) -> Option<KeyId> {
        self.keys.first().map(|one| one.id)
    }

    /// Its status.
    #[must_use]
    pub fn status(&self, now: Duration) -> GuardStatus {
        let newest = self.keys.iter().filter_map(|one| one.window.newest);
        let verified_at = newest.map(|(_, at)| at).chain(self.framed).max();
        GuardStatus {
            key_id: self.keys.first().map(|one| one.id.to_string()),
            previous_key_id: self.keys.get(1).map(|one| one.id.to_string()),
            uses_previous: self.in_use > 0,
            verified: self.verified,
            verified_s: verified_at.map(|at| now.saturating_sub(at).as_secs_f64()),
            refused: self.refused.clone(),
        }
    }
}

impl Keyed {
    fn is_over(&self, now: Duration, grace: Duration) -> bool {
        self.until.is_some_and(|until| until.max(grace) <= now)
    }

    /// The trailer of the next datagram; its stamp is taken.
    fn trailer(
        &mut self,
        (sender, direction): (Id, Direction),
        now: Now,
        disk: &mut dyn Disk,
    ) -> Result<Trailer, ClockError> {
        let stamp = self.clock.take(now, disk)?;
        Ok(Trailer {
            direction,
            sender,
            key_id: self.key.id(),
            stamp_us: micros(stamp),
        })
    }
}

/// Why nothing can be sealed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SealError {
    /// There is no key.
    #[error("no guard key")]
    NoKey,
    /// The clock has no stamp.
    #[error(transparent)]
    Clock(#[from] ClockError),
    /// It does not fit.
    #[error(transparent)]
    TooLong(#[from] stanag_msgs::guard::TooLong),
}

/// The recently accepted stamps of one key and direction.
#[derive(Debug, Default)]
struct Window {
    /// In their order, [`WINDOW`] at most.
    seen: VecDeque<Stamp>,
    /// The newest, and when it arrived.
    newest: Option<(Stamp, Duration)>,
}

impl Window {
    fn judge(&self, now: Duration, stamp: Stamp) -> Result<(), GuardRefusal> {
        if self.seen.binary_search(&stamp).is_ok() {
            return Err(GuardRefusal::Replayed);
        }
        let full = self.seen.len() == WINDOW;
        if full && self.seen.front().is_some_and(|lowest| stamp < *lowest) {
            return Err(GuardRefusal::Old);
        }
        if let Some((newest, at)) = self.newest
            && stamp.plus(MAX_DELAY) < newest.plus(now.saturating_sub(at))
        {
            return Err(GuardRefusal::Late);
        }
        Ok(())
    }

    fn take(&mut self, now: Duration, stamp: Stamp) {
        if self.seen.len() == WINDOW {
            self.seen.pop_front();
        }
        let place = self.seen.partition_point(|one| *one < stamp);
        self.seen.insert(place, stamp);
        if self.newest.is_none_or(|(newest, _)| newest < stamp) {
            self.newest = Some((stamp, now));
        }
    }
}

/// The signing clock counts in 10 us: that is the step of the stamps here.
fn micros(stamp: Stamp) -> u64 {
    u64::try_from(stamp.to_unix().as_micros()).unwrap_or(u64::MAX)
}

/// `None` for a time that the clock does not know: before 2015, after 2104.
fn stamp_of(stamp_us: u64) -> Option<Stamp> {
    let stamp = Stamp::from_unix(Duration::from_micros(stamp_us));
    (stamp > Stamp::ZERO && stamp < Stamp::MAX).then_some(stamp)
}

/// Datagrams of one sender whose order does not matter.
const WINDOW: usize = 1_024;
/// Maximum delay of a datagram, relative to the newest of its sender.
const MAX_DELAY: Duration = Duration::from_secs(30);
/// How long after its copy a datagram may come from where its sender is: no longer than what a candidate address holds back.
const ELSEWHERE: Duration = Duration::from_secs(5);
const LIFT_EVERY: Duration = Duration::from_millis(200);

#[cfg(test)]
mod tests;
