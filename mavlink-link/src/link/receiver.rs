//! The receiving side of one key, shared by every link that uses it.
//!
//! Promised: no frame is accepted twice, over links, restarts and jumps of the clock, and nothing
//! changes before the signature has been verified. The order of the checks is fixed: checksum and MAVLink 2 (by the
//! parser), not our own system id, expected system and stream, signature, the autopilot's link id, timestamp; only then
//! state.
//!
//! Stricter than MAVLink's guide, which lets a new stream in when it is no older than 60 s: after a restart that would
//! accept the last minute again (pitfall 19). Here the first frame of a stream is accepted
//! only with a timestamp above the floor, the highest that was stored for the key (its ceiling, see
//! [`signing::clock`](crate::signing::clock)). There is no window for
//! reordered frames either, since it would accept replays within it (pitfall 4); the protocols above retry.

use core::time::Duration;

use thiserror::Error;

use super::challenge::{Challenges, Ping, REFUSED_FOR};
use crate::Now;
use crate::frame::FrameView;
use crate::signing::clock::{Ceiling, ClockError, Origin, SigningClock, WallState};
use crate::signing::{KeyId, SigningKey, Stamp, verify};
use crate::store::{Disk, Store as _, StoreError};

/// A key, its clock and all the streams received under it.
///
/// There is one for each key, lent to every link that uses it: a frame received on one link is a replay on
/// the others (pitfall 5).
#[derive(Debug)]
pub struct KeyState {
    key: SigningKey,
    id: KeyId,
    clock: SigningClock,
    streams: Streams,
    challenges: Challenges,
    /// How far the clock moved when it met a peer's, until somebody reports it.
    met: Option<Duration>,
}

impl KeyState {
    /// Starts the key's clock from what the store holds.
    ///
    /// `not_before` is a date that cannot be in the future, such as that of the build.
    ///
    /// # Errors
    /// The store cannot be read.
    pub fn start(
        key: SigningKey,
        origin: Origin,
        not_before: Stamp,
        now: Now,
        store: &mut dyn Disk,
    ) -> Result<Self, StoreError> {
        let id = key.id();
        let stored = store.load(&id)?.map(|Ceiling(stamp)| stamp);
        let clock = SigningClock::start(id, origin, stored, not_before, now);
        Ok(Self {
            key,
            id,
            clock,
            streams: Streams::default(),
            challenges: Challenges::default(),
            met: None,
        })
    }

    /// The public name of the key.
    #[must_use]
    pub fn id(&self) -> KeyId {
        self.id
    }

    /// The key itself.
    #[must_use]
    pub fn key(&self) -> &SigningKey {
        &self.key
    }

    /// The key's signing clock.
    #[must_use]
    pub fn clock(&self) -> &SigningClock {
        &self.clock
    }

    /// Takes the stamp for one frame of ours.
    ///
    /// # Errors
    /// See [`SigningClock::take`].
    pub fn take_stamp(&mut self, now: Now, store: &mut dyn Disk) -> Result<Stamp, ClockError> {
        self.clock.take(now, store)
    }

    /// See [`SigningClock::waits`].
    pub(crate) fn waits(&mut self, now: Now, store: &mut dyn Disk) -> bool {
        self.clock.waits(now, store)
    }

    /// Raises this key's clock above a timestamp of ours that was used under another key of the same link.
    ///
    /// # Errors
    /// See [`SigningClock::carry`]: nothing may be sent then.
    pub fn follow(
        &mut self,
        stamp: Stamp,
        now: Now,
        store: &mut dyn Disk,
    ) -> Result<(), ClockError> {
        self.clock.carry(stamp, now, store)
    }

    /// See [`SigningClock::run_from`].
    pub fn run_from(&mut self, stamp: Stamp, now: Now) {
        self.clock.run_from(stamp, now);
    }

    /// Whether a sender whose frame was refused as [`Refusal::Future`] is to be asked whether it is there: nothing of its
    /// system has been accepted lately. Beside honest frames one far ahead is a recording, or of a thief with the key.
    #[must_use]
    pub fn wants_challenge(&self, system: u8, now: Now) -> bool {
        !self.streams.accepted_lately(system, now.mono)
    }

    /// A challenge for a sender whose frames are stamped too far ahead; see [`Self::wants_challenge`].
    ///
    /// # Errors
    /// See [`SigningClock::take`]: no timestamp is left to make it of.
    pub(crate) fn challenge(&mut self, now: Now, store: &mut dyn Disk) -> Result<Ping, ClockError> {
        let unique = self.clock.take(now, store)?;
        Ok(self.challenges.make(&self.key, unique, now.mono))
    }

    /// The challenge that this frame, which has verified, is the answer to: its number, and when it was made.
    pub(crate) fn answered(
        &self,
        frame: &FrameView<'_>,
        own_system: u8,
        now: Now,
    ) -> Option<(u64, Duration)> {
        self.challenges.answered(frame, own_system, now.mono)
    }

    /// How far the clock has moved to meet a peer's, once after each time.
    pub fn take_met(&mut self) -> Option<Duration> {
        self.met.take()
    }

    /// See [`SigningClock::watch_wall`].
    pub fn watch_wall(&mut self, now: Now) -> WallState {
        self.clock.watch_wall(now)
    }

    /// See [`SigningClock::accept_wall`].
    pub fn accept_wall(&mut self, now: Now) {
        self.clock.accept_wall(now);
    }

    /// Checks a frame; on success it is accepted and every replay of it will be refused.
    ///
    /// # Errors
    /// The first of the checks that the frame fails; nothing has changed then.
    pub fn receive(
        &mut self,
        frame: &FrameView<'_>,
        expected: Expected,
        now: Now,
        store: &mut dyn Disk,
    ) -> Result<Stamp, Refusal> {
        let header = frame.header();
        if header.system_id == expected.own_system {
            return Err(Refusal::Reflected);
        }
        let only = &expected.only;
        if header.system_id != expected.system && !only.has_system(header.system_id) {
            return Err(Refusal::UnexpectedSystem);
        }
        let Some(signature) = frame.signature() else {
            return Err(Refusal::Unsigned);
        };
        let name = Stream {
            system: header.system_id,
            component: header.component_id,
            link: signature.link_id,
        };
        if !only.allow(name) {
            return Err(Refusal::NotListed);
        }
        verify(&self.key, frame).map_err(|_| Refusal::BadSignature)?;
        if let Some(link) = expected.autopilot_link
            && name.component == AUTOPILOT
            && name.link != link
        {
            return Err(Refusal::UnexpectedLink);
        }

        let stamp = signature.stamp;
        let place = self.streams.place(name);
        if !self.clock.allows(stamp, now) {
            let proven = self.answered(frame, expected.own_system, now);
            if proven.is_none() || !self.clock.may_meet(stamp) {
                return Err(Refusal::Future);
            }
            let place = place.ok_or(Refusal::TableFull)?;
            let before = self.clock.reading(now);
            self.clock
                .meet(stamp, now, store)
                .map_err(|_| Refusal::Ceiling)?;
            self.challenges.end();
            self.met = Some(stamp.since(before));
            self.streams.set(place, name, stamp, now.mono);
            return Ok(stamp);
        }
        let last = place
            .and_then(|at| self.streams.last(at))
            .unwrap_or(Stamp::ZERO);
        if stamp <= last.max(self.clock.floor()) {
            return Err(Refusal::Stale);
        }
        let place = place.ok_or(Refusal::TableFull)?;
        // The ceiling is on disk before the frame counts: otherwise a restart could accept the frame again.
        self.clock
            .follow(stamp, now, store)
            .map_err(|fault| match fault {
                ClockError::Raising => Refusal::Raising,
                _ => Refusal::Ceiling,
            })?;
        self.streams.set(place, name, stamp, now.mono);
        Ok(stamp)
    }
}

/// Which frames a link accepts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Expected {
    /// Our own system id. One key signs both directions, so a reflected frame of ours verifies (pitfall 22).
    pub own_system: u8,
    /// The vehicle's system id.
    pub system: u8,
    /// The link id of the vehicle's component 1 on this link, once it is known.
    pub autopilot_link: Option<u8>,
    /// The streams that are accepted, where they are listed.
    pub only: AllowedStreams,
}

/// A list of the streams that are accepted, at most [`AllowedStreams::MAX`]. Where it is empty, every stream of the
/// expected system is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AllowedStreams {
    list: [Stream; Self::MAX],
    len: usize,
}

impl AllowedStreams {
    /// The longest list.
    pub const MAX: usize = 8;

    /// The empty list: every stream of the expected system.
    pub const ANY: Self = Self {
        list: [Stream {
            system: 0,
            component: 0,
            link: 0,
        }; Self::MAX],
        len: 0,
    };

    /// The streams of a list; `None` where there are more than [`AllowedStreams::MAX`].
    #[must_use]
    pub fn listed(streams: &[Stream]) -> Option<Self> {
        let mut allowed = Self::ANY;
        allowed
            .list
            .get_mut(..streams.len())?
            .copy_from_slice(streams);
        allowed.len = streams.len();
        Some(allowed)
    }

    /// The streams listed.
    pub fn iter(&self) -> impl Iterator<Item = Stream> + '_ {
        self.list[..self.len].iter().copied()
    }

    fn has_system(&self, system: u8) -> bool {
        self.iter().any(|stream| stream.system == system)
    }

    fn allow(&self, stream: Stream) -> bool {
        self.len == 0 || self.iter().any(|listed| listed == stream)
    }
}

/// Why a frame is not accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum Refusal {
    /// It carries our own system id.
    #[error("our own system id")]
    Reflected,
    /// It is not from the vehicle.
    #[error("not from the vehicle's system")]
    UnexpectedSystem,
    /// Verified, but component 1 with another link id than the one it has on this link: a capture of another link.
    #[error("the autopilot does not use this link id here")]
    UnexpectedLink,
    /// Its system, component and link id are not on the list of accepted streams.
    #[error("system, component and link id are not on the list")]
    NotListed,
    /// It carries no signature.
    #[error("not signed")]
    Unsigned,
    /// It was not signed with the key.
    #[error("wrong signature")]
    BadSignature,
    /// There is no place for another stream.
    #[error("too many streams under one key")]
    TableFull,
    /// The stamp is more than an hour ahead of our clock's base, and the frame answers no challenge of ours.
    #[error("timestamp too far ahead")]
    Future,
    /// The timestamp is at or below the floor or the last of its stream: a replay, a reordered frame, or
    /// a vehicle that has restarted.
    #[error("stale timestamp")]
    Stale,
    /// The ceiling could not be raised to the stamp.
    #[error("the signing clock's ceiling could not be stored")]
    Ceiling,
    /// The ceiling is being raised to the stamp by a slow disk.
    #[error("the signing clock's ceiling is not stored yet")]
    Raising,
}

/// A sender's stream: the timestamps of each rise on their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Stream {
    /// Sending system, 1 to 255.
    pub system: u8,
    /// Sending component, 1 to 255.
    pub component: u8,
    /// Link id of its signatures.
    pub link: u8,
}

/// The last timestamp of each stream, and when it came. Nothing is ever evicted: a stream that was dropped could be replayed.
#[derive(Debug, Default)]
struct Streams {
    entries: [(Stream, Stamp); STREAMS],
    at: [Duration; STREAMS],
    len: usize,
}

impl Streams {
    /// Whether a frame of that system was accepted a moment ago.
    fn accepted_lately(&self, system: u8, mono: Duration) -> bool {
        let streams = self.entries[..self.len].iter().zip(&self.at);
        streams
            .filter(|((name, _), _)| name.system == system)
            .any(|(_, at)| mono.saturating_sub(*at) < REFUSED_FOR)
    }

    /// Where the stream is, or where a new one may go.
    ///
    /// The last places are reserved for component 1, so that other components can never lock it out (pitfall 7: the
    /// table is full and an honest peer is refused).
    fn place(&self, name: Stream) -> Option<usize> {
        let known = self.entries[..self.len]
            .iter()
            .position(|(entry, _)| *entry == name);
        known.or_else(|| {
            let others = self.entries[..self.len]
                .iter()
                .filter(|(e, _)| e.component != AUTOPILOT);
            let free = self.len < STREAMS;
            (free && (name.component == AUTOPILOT || others.count() < OTHER_STREAMS))
                .then_some(self.len)
        })
    }

    fn last(&self, at: usize) -> Option<Stamp> {
        self.entries[..self.len].get(at).map(|(_, stamp)| *stamp)
    }

    fn set(&mut self, at: usize, name: Stream, stamp: Stamp, mono: Duration) {
        self.entries[at] = (name, stamp);
        self.at[at] = mono;
        self.len = self.len.max(at + 1);
    }
}

/// The autopilot's component id, MAV_COMP_ID_AUTOPILOT1.
pub const AUTOPILOT: u8 = 1;
/// Streams under one key, as many as PX4 itself can hold.
const STREAMS: usize = 16;
/// Of these, for components other than the autopilot.
// The rest stays for the autopilot: other components under the key cannot shut it out.
const OTHER_STREAMS: usize = 12;
