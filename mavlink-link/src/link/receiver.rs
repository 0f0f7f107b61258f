//! The receiving side of one key, shared by every link that uses it.
//!
//! Promised: no frame is accepted twice, over links, restarts and jumps of the clock, and nothing
//! changes before the signature has been verified. The order is fixed: checksum and MAVLink 2 (by the
//! parser), not our own system, expected, signature, the autopilot's link id, stamp; only then state.

use thiserror::Error;

use crate::Now;
use crate::frame::FrameView;
use crate::signing::clock::{Ceiling, ClockError, Origin, SigningClock, WallState};
use crate::signing::{KeyId, SigningKey, Stamp, verify};
use crate::store::{Disk, Store as _, StoreError};

/// A key, its clock and all the streams heard under it.
///
/// There is one for each key, lent to every link that uses it: a frame heard on one link is a replay on
/// the others.
#[derive(Debug)]
pub struct KeyState {
    key: SigningKey,
    id: KeyId,
    clock: SigningClock,
    streams: Streams,
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

    /// Keeps this key's stamps above one that was used under another key of the same link.
    ///
    /// # Errors
    /// See [`SigningClock::follow`]: nothing may be sent then.
    pub fn follow(
        &mut self,
        stamp: Stamp,
        now: Now,
        store: &mut dyn Disk,
    ) -> Result<(), ClockError> {
        self.clock.follow(stamp, now, store)
    }

    /// See [`SigningClock::watch_wall`].
    pub fn watch_wall(&mut self, now: Now) -> WallState {
        self.clock.watch_wall(now)
    }

    /// See [`SigningClock::accept_wall`].
    pub fn accept_wall(&mut self, now: Now) {
        self.clock.accept_wall(now);
    }

    /// Judges a frame; on success it is accepted once and for all.
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
        if !self.clock.allows(stamp, now) {
            return Err(Refusal::Future);
        }
        let place = self.streams.place(name);
        let last = place
            .and_then(|at| self.streams.last(at))
            .unwrap_or(Stamp::ZERO);
        if stamp <= last.max(self.clock.floor()) {
            return Err(Refusal::Stale);
        }
        let place = place.ok_or(Refusal::TableFull)?;
        self.clock
            .follow(stamp, now, store)
            .map_err(|_| Refusal::Ceiling)?;
        self.streams.set(place, name, stamp);
        Ok(stamp)
    }
}

/// Whose frames a link takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Expected {
    /// Our own system id: a frame with it is our own, come back.
    pub own_system: u8,
    /// The vehicle's system id.
    pub system: u8,
    /// The link id of the vehicle's component 1 on this link, once it is known.
    pub autopilot_link: Option<u8>,
    /// The streams that are taken, where they are listed.
    pub only: AllowedStreams,
}

/// A list of the streams that are taken, at most [`AllowedStreams::MOST`]. Where it is empty, every stream of the
/// expected system is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct AllowedStreams {
    list: [Stream; Self::MOST],
    len: usize,
}

impl AllowedStreams {
    /// The longest list.
    pub const MOST: usize = 8;

    /// The empty list: every stream of the expected system.
    pub const ANY: Self = Self {
        list: [Stream {
            system: 0,
            component: 0,
            link: 0,
        }; Self::MOST],
        len: 0,
    };

    /// The streams of a list; `None` where there are more than [`AllowedStreams::MOST`].
    #[must_use]
    pub fn listed(streams: &[Stream]) -> Option<Self> {
        let mut talkers = Self::ANY;
        talkers
            .list
            .get_mut(..streams.len())?
            .copy_from_slice(streams);
        talkers.len = streams.len();
        Some(talkers)
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
    #[error("our own frame came back")]
    Reflected,
    /// It is not from the vehicle.
    #[error("not from the vehicle's system")]
    UnexpectedSystem,
    /// Verified, but component 1 with another link id than the one it has on this link: a capture of another link.
    #[error("the autopilot does not use this link id here")]
    UnexpectedLink,
    /// Its system, component and link id are not on the list of those that are taken.
    #[error("system, component and link id are not on the list")]
    NotListed,
    /// It carries no signature.
    #[error("not signed")]
    Unsigned,
    /// The signature does not fit the key.
    #[error("wrong signature")]
    BadSignature,
    /// All places for streams are taken.
    #[error("too many streams under one key")]
    TableFull,
    /// The stamp is more than an hour beyond our base.
    #[error("stamp too far ahead")]
    Future,
    /// The stamp is at or below the floor or the last of its stream: a replay, late by reordering, or
    /// a vehicle that has fallen back.
    #[error("stamp not above the last")]
    Stale,
    /// The ceiling could not be raised to the stamp.
    #[error("the signing clock's ceiling could not be stored")]
    Ceiling,
}

/// A sender's stream: the stamps of each rise on their own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Stream {
    /// Sending system, 1 to 255.
    pub system: u8,
    /// Sending component, 1 to 255.
    pub component: u8,
    /// Link id of its signatures.
    pub link: u8,
}

/// The last stamp of each stream. Nothing is ever evicted: a forgotten stream could be replayed.
#[derive(Debug, Default)]
struct Streams {
    entries: [(Stream, Stamp); STREAMS],
    len: usize,
}

impl Streams {
    /// Where the stream is, or where a new one may go.
    ///
    /// The last places are kept for component 1, so that other components can never lock it out.
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

    fn set(&mut self, at: usize, name: Stream, stamp: Stamp) {
        self.entries[at] = (name, stamp);
        self.len = self.len.max(at + 1);
    }
}

/// The autopilot's component id, MAV_COMP_ID_AUTOPILOT1.
pub const AUTOPILOT: u8 = 1;
/// Streams under one key, as many as PX4 itself can hold.
const STREAMS: usize = 16;
/// Of these, for components other than the autopilot.
const OTHER_STREAMS: usize = 12;
