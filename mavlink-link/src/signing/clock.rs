//! The signing clock: timestamps that never repeat, over restarts, power cuts and jumps of the wall clock.
//!
//! Promised: every timestamp sent or accepted under a key is at most the ceiling that has been stored for
//! it, and a later start begins above that ceiling. The wall clock is read once; afterwards the base
//! runs on monotonic time, so that a wrong wall clock (GPS spoofing, pitfall 11) does not move it. Once a frame of a peer
//! has been accepted, no step of the wall clock moves the base, however small. Before that, a wall clock that was wrong at
//! the start may still be set: that is equivalent to a later start.
//!
//! The clock follows peers whose timestamps run ahead, but never further than an hour beyond the base (pitfall 12). The
//! limit is measured from the base and not from the clock: otherwise a peer could push it further with every frame. Two
//! ends that are further apart, because one of them started with a wrong wall clock, meet at the higher of the two clocks,
//! by a challenge that the other end has answered ([`SigningClock::meet`]).
//!
//! The clock is advanced by time, not by one for each packet: after 60 s of silence a peer would refuse everything
//! (pitfall 1).

use core::fmt::Write as _;
use core::time::Duration;

use thiserror::Error;

use super::key::KeyId;
use crate::Now;
use crate::frame::Stamp;
use crate::store::{Changes, Disk, Durability, Progress, Record, Store as _, StoreError};

/// How the files of ceilings begin.
pub const CEILING: &str = "clock-";

/// The stored ceiling of a key: a power cut does not reach it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ceiling(pub Stamp);

impl Ceiling {
    /// Stores the ceiling of a key. A higher stored ceiling stays: no caller can lower it.
    ///
    /// # Errors
    /// It could not be read or made durable. The old ceiling stays in force.
    pub fn raise(disk: &mut dyn Disk, key: &KeyId, to: Stamp) -> Result<(), StoreError> {
        let stored = disk.load::<Ceiling>(key)?;
        let to = stored.map_or(to, |Ceiling(stored)| stored.max(to));
        if stored == Some(Ceiling(to)) && !disk.queues() {
            return Ok(());
        }
        // On a disk that queues, the stored ceiling may only be on its way. Writing it again gives the caller a change to
        // wait for.
        disk.save(key, &Ceiling(to))
    }
}

impl Record for Ceiling {
    type Key = KeyId;
    const DURABILITY: Durability = Durability::Power;

    fn name(key: &KeyId) -> String {
        // One allocation: the signing path builds this name for each raised ceiling.
        let mut name = String::with_capacity(CEILING.len() + 16);
        let _ = write!(name, "{CEILING}{key}");
        name
    }

    fn encode(&self) -> Vec<u8> {
        format!("{}\n", self.0.get()).into_bytes()
    }

    // A ceiling that cannot be read is not a missing one: starting below it would repeat stamps.
    fn decode(bytes: &[u8]) -> Result<Self, String> {
        let text = String::from_utf8_lossy(bytes);
        match text.trim().parse::<u64>() {
            Ok(units) if units <= Stamp::MAX.get() => Ok(Ceiling(Stamp::new(units))),
            _ => Err(format!("it holds {text:?}, expected a number below 2^48")),
        }
    }
}

/// Where a key came from, which decides the first floor.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// Read from a key file; what was signed with it before is not known.
    KeyFile,
    /// We have just sent this key to the vehicle, with this initial timestamp: nothing older can exist.
    Provisioned {
        /// SETUP_SIGNING.initial_timestamp.
        initial: Stamp,
    },
}

/// How the computer's wall clock compares with the ceiling.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WallState {
    /// At or up to 366 days beyond the ceiling: used.
    Fits,
    /// Behind the ceiling or the build date: not used, harmless.
    Behind,
    /// More than 366 days beyond the ceiling: not used until a person accepts it.
    FarAhead,
}

/// The signing clock of one key.
#[derive(Debug)]
pub struct SigningClock {
    key: KeyId,
    /// The stored ceiling; no stamp beyond it is sent or accepted.
    ceiling: u64,
    /// A higher ceiling that a queueing disk has not written yet: the change, and the ceiling.
    raising: Option<(Changes, u64)>,
    floor: Stamp,
    base: u64,
    base_at: Duration,
    /// How far the clock runs ahead of its base, because a peer does.
    lead: u64,
    /// Whether the wall clock may still move the base: it was wrong at the start, and no frame has been accepted since
    /// then.
    unset: bool,
    /// The least stamp that may be sent next: above the ceiling at start, all sent, all accepted.
    least: u64,
    wall_reference: Now,
    wall: WallState,
    retry_at: Duration,
}

impl SigningClock {
    /// Starts the clock of a key from its stored ceiling.
    ///
    /// `not_before` is a date that cannot be in the future, such as that of the build.
    #[must_use]
    pub fn start(
        key: KeyId,
        origin: Origin,
        stored: Option<Stamp>,
        not_before: Stamp,
        now: Now,
    ) -> Self {
        let wall_stamp = Stamp::from_unix(now.wall);
        let (start, wall) = match stored {
            Some(ceiling) => match judge_wall(ceiling.get(), wall_stamp) {
                WallState::Fits => (wall_stamp.get(), WallState::Fits),
                // One above the ceiling: the run before may have sent or accepted every timestamp up to it.
                other => (ceiling.get() + 1, other),
            },
            None => {
                let (first, wall) = first_stamp(wall_stamp, not_before);
                (first.get(), wall)
            }
        };
        let (start, floor) = match (origin, stored) {
            (Origin::Provisioned { initial }, None) => {
                let before = Stamp::new(initial.get().saturating_sub(1));
                // This key continues the clock of the key before it, so the wall clock is trusted as far as that clock
                // would trust it.
                let believed = match judge_wall(initial.get(), wall_stamp) {
                    WallState::Fits => wall_stamp.get(),
                    WallState::Behind | WallState::FarAhead => initial.get(),
                };
                (believed, before)
            }
            (_, Some(ceiling)) => (start, ceiling),
            // Older recordings signed with this key may exist, so nothing before the start is accepted.
            (Origin::KeyFile, None) => (start, Stamp::new(start)),
        };
        let ceiling = stored.map_or(start, Stamp::get);
        Self {
            key,
            ceiling,
            raising: None,
            floor,
            base: start,
            base_at: now.mono,
            lead: 0,
            unset: wall != WallState::Fits,
            least: ceiling + 1,
            // The floor is the ceiling of the run before, not its last timestamp: frames that an earlier run accepted up to
            // there must not be accepted twice.
            wall_reference: now,
            wall,
            retry_at: Duration::ZERO,
        }
    }

    /// The floor: frames stamped at or below it are never accepted.
    #[must_use]
    pub fn floor(&self) -> Stamp {
        self.floor
    }

    /// The ceiling as last made durable.
    #[must_use]
    pub fn ceiling(&self) -> Stamp {
        Stamp::new(self.ceiling)
    }

    /// The base: start value and monotonic time since.
    #[must_use]
    pub fn base(&self, now: Now) -> Stamp {
        Stamp::new(self.base).plus(now.mono.saturating_sub(self.base_at))
    }

    /// The clock: the stamp that would be sent next.
    #[must_use]
    pub fn reading(&self, now: Now) -> Stamp {
        let running = self.base(now).get().saturating_add(self.lead);
        Stamp::new(self.least.max(running))
    }

    /// How the wall clock was judged last.
    #[must_use]
    pub fn wall_state(&self) -> WallState {
        self.wall
    }

    /// Takes the stamp for one frame; no two calls give the same, over restarts too.
    ///
    /// # Errors
    /// The ceiling cannot be raised, or the last stamp has been used. Nothing may be sent then.
    pub fn take(&mut self, now: Now, store: &mut dyn Disk) -> Result<Stamp, ClockError> {
        // Wrapping to 0 would repeat every timestamp of the key's life, so the key ends here.
        if self.least > Stamp::MAX.get() {
            return Err(ClockError::Exhausted);
        }
        let stamp = self.reading(now);
        self.raise_ceiling(stamp, now, store)?;
        self.least = stamp.get() + 1;
        Ok(stamp)
    }

    /// Whether the next timestamp waits for a slow disk: frames that are due are then sent a moment later. Raises the
    /// ceiling where needed, and takes no timestamp.
    pub fn waits(&mut self, now: Now, store: &mut dyn Disk) -> bool {
        self.raise_ceiling(self.reading(now), now, store) == Err(ClockError::Raising)
    }

    /// Whether a stamp lies within an hour beyond the base.
    #[must_use]
    pub fn allows(&self, stamp: Stamp, now: Now) -> bool {
        stamp <= self.base(now).plus(LEAD)
    }

    /// Follows a verified peer's timestamp, which [`allows`](Self::allows) has admitted.
    ///
    /// # Errors
    /// The ceiling cannot be raised to it: the frame must not be accepted.
    pub fn follow(
        &mut self,
        stamp: Stamp,
        now: Now,
        store: &mut dyn Disk,
    ) -> Result<(), ClockError> {
        self.raise_ceiling(stamp, now, store)?;
        self.unset = false;
        // From here on the clock runs with the peer's. Otherwise it would stand still until the base has caught up, and a
        // frame delayed meanwhile would lie above our newest heartbeats and pass for one made after them. A vehicle that
        // counts its packets from our timestamps is always slightly ahead: to follow that would add up, so small leads are
        // ignored.
        let running = self.base(now).get().saturating_add(self.lead);
        if stamp.get() > running.saturating_add(CLOSE) {
            self.lead = stamp.get().saturating_sub(self.base(now).get());
        }
        // One above, not at it: a vehicle that then restarts with old timestamps is lifted by our next frame to that
        // frame's timestamp, and its answer must lie above what has been accepted.
        self.least = self.least.max(stamp.get() + 1);
        Ok(())
    }

    /// Continues at a timestamp of our own that was used under another key of the same link. The base moves with it: a
    /// vehicle that we lift to that timestamp must not be too far ahead for us.
    ///
    /// # Errors
    /// The ceiling cannot be raised to it: nothing may be sent then.
    pub fn carry(
        &mut self,
        stamp: Stamp,
        now: Now,
        store: &mut dyn Disk,
    ) -> Result<(), ClockError> {
        self.raise_ceiling(stamp, now, store)?;
        self.run_from(stamp, now);
        self.least = self.least.max(stamp.get() + 1);
        Ok(())
    }

    /// Moves the base up to a timestamp of our own, and writes nothing: none is used by it.
    pub fn run_from(&mut self, stamp: Stamp, now: Now) {
        if stamp > self.base(now) {
            (self.base, self.base_at, self.lead) = (stamp.get(), now.mono, 0);
        }
    }

    /// Whether this clock may meet a peer's at that timestamp: the last years of the 48 bits are kept, so that nobody who
    /// has the key can end the life of every clock by one frame.
    #[must_use]
    pub fn may_meet(&self, stamp: Stamp) -> bool {
        !is_in_reserve(stamp)
    }

    /// Moves to a peer's clock, which the peer has proved to run ahead of this one now. The effect is that of a restart
    /// from a ceiling at that timestamp: nothing at or below it is accepted any more, so recordings made while the clocks
    /// were apart are useless.
    ///
    /// # Errors
    /// The ceiling cannot be raised to it: nothing has changed then.
    pub fn meet(&mut self, stamp: Stamp, now: Now, store: &mut dyn Disk) -> Result<(), ClockError> {
        if !self.may_meet(stamp) {
            return Err(ClockError::Exhausted);
        }
        self.raise_ceiling(stamp, now, store)?;
        (self.base, self.base_at, self.lead) = (stamp.get(), now.mono, 0);
        self.floor = self.floor.max(stamp);
        self.least = self.least.max(stamp.get() + 1);
        self.unset = false;
        Ok(())
    }

    /// Judges the wall clock as at start, where it has been set since.
    ///
    /// Only a step of more than a second counts. It moves the base only of a clock that started without a usable wall clock
    /// and has accepted no frame yet, and only forward.
    pub fn watch_wall(&mut self, now: Now) -> WallState {
        let reference = self.wall_reference;
        let expected = reference
            .wall
            .saturating_add(now.mono.saturating_sub(reference.mono));
        if now.wall.abs_diff(expected) > WALL_STEP {
            self.wall_reference = now;
            self.wall = judge_wall(self.ceiling, Stamp::from_unix(now.wall));
            // A peer follows a clock by at most an hour and would lose one that jumps, so the clock may jump only before it
            // has a peer.
            if self.wall == WallState::Fits && self.unset {
                self.unset = false;
                self.rebase(now);
            }
        }
        self.wall
    }

    /// A person has confirmed the wall clock: it is used from here on, however far ahead.
    pub fn accept_wall(&mut self, now: Now) {
        self.wall_reference = now;
        self.wall = WallState::Fits;
        self.rebase(now);
    }

    fn rebase(&mut self, now: Now) {
        // Never back: a wall clock that was set back must not bring stamps that were used before.
        self.base = self.base(now).max(Stamp::from_unix(now.wall)).get();
        self.base_at = now.mono;
    }

    /// Writes ahead: no timestamp beyond the stored ceiling exists, sent or accepted. Writing every timestamp would cost
    /// a disk write a frame; writing once a minute would repeat a minute of them after a power cut.
    fn raise_ceiling(
        &mut self,
        stamp: Stamp,
        now: Now,
        store: &mut dyn Disk,
    ) -> Result<(), ClockError> {
        let raising = self
            .raising
            .map(|(change, ceiling)| (store.progress(change), ceiling));
        if let Some((Progress::Durable, ceiling)) = raising {
            self.ceiling = ceiling;
            self.raising = None;
        }
        // On a disk that queues, the next ceiling is written early: by the time it is needed, it is durable and no frame
        // waits.
        let reserve = if store.queues() {
            EARLY
        } else {
            Duration::ZERO
        };
        let enough = stamp.plus(reserve).get() <= self.ceiling;
        // A failing disk is not tried again for every frame.
        if !enough && self.raising.is_none() && now.mono >= self.retry_at {
            let ceiling = stamp.plus(WRITE_AHEAD);
            let after = store.queued();
            // The change is identified by the queue's numbers before and after: the queue is shared with other records.
            match Ceiling::raise(store, &self.key, ceiling) {
                Err(_) => self.retry_at = now.mono.saturating_add(STORE_RETRY),
                Ok(()) => {
                    let until = store.queued();
                    let change = Changes { after, until };
                    match store.progress(change) {
                        Progress::Durable => self.ceiling = ceiling.get(),
                        // Sending and accepting continue meanwhile, up to the old ceiling.
                        _ => self.raising = Some((change, ceiling.get())),
                    }
                }
            }
        }
        if stamp.get() <= self.ceiling {
            return Ok(());
        }
        // `Raising` means "try again soon", so frames are kept. `Ceiling` is a failing disk: an alert follows, frames are
        // dropped.
        match self.raising {
            Some((change, _)) if store.progress(change) == Progress::Waiting => {
                Err(ClockError::Raising)
            }
            _ => Err(ClockError::Ceiling),
        }
    }
}

/// Why no timestamp is available.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Error)]
pub enum ClockError {
    /// The ceiling could not be stored: neither sending nor accepting goes beyond the old one.
    #[error("the signing clock's ceiling could not be stored")]
    Ceiling,
    /// The ceiling is on its way to the disk: neither sending nor accepting goes beyond the old one until it is there.
    #[error("the signing clock's ceiling is not stored yet")]
    Raising,
    /// The 48 bits are used up.
    #[error("the signing clock has reached its last timestamp: replace the key")]
    Exhausted,
}

/// Where a clock begins that has no ceiling to compare the wall clock with: at the wall clock, if that can be right.
///
/// The build date is the only lower bound, for a computer that boots without a clock. The upper one are the last years of the
/// 48 bits: a clock that begins there would end the life of its key, since no peer may meet it.
pub(crate) fn first_stamp(wall: Stamp, not_before: Stamp) -> (Stamp, WallState) {
    if wall < not_before {
        (not_before, WallState::Behind)
    } else if is_in_reserve(wall) {
        (not_before, WallState::FarAhead)
    } else {
        (wall, WallState::Fits)
    }
}

fn is_in_reserve(stamp: Stamp) -> bool {
    stamp.get().saturating_add(RESERVE) > Stamp::MAX.get()
}

fn judge_wall(ceiling: u64, wall: Stamp) -> WallState {
    let ceiling = Stamp::new(ceiling);
    if wall < ceiling {
        WallState::Behind
    } else if wall > ceiling.plus(WALL_AHEAD) {
        WallState::FarAhead
    } else {
        WallState::Fits
    }
}

/// How far beyond the base a peer is followed.
const LEAD: Duration = Duration::from_secs(3600);
/// How far a peer's timestamp must be ahead of the clock, in units of 10 us, to show that the peer's clock is: a second.
const CLOSE: u64 = 100_000;
/// Timestamps that neither a first start nor a meeting of clocks can use up: ten years, in units of 10 us.
const RESERVE: u64 = 3_653 * 86_400 * 100_000;
/// How far the ceiling is written ahead.
// One synchronised write for 10 s of timestamps; one for each frame would stall the link.
const WRITE_AHEAD: Duration = Duration::from_secs(10);
/// How much room below the ceiling starts the next write on a disk that queues: the write has this long before a frame
/// waits.
const EARLY: Duration = Duration::from_secs(4);
/// How far beyond the ceiling the wall clock is trusted.
const WALL_AHEAD: Duration = Duration::from_secs(366 * 86_400);
/// The least change against monotonic time that counts as setting the wall clock.
const WALL_STEP: Duration = Duration::from_secs(1);
/// The pause after a failed store.
const STORE_RETRY: Duration = Duration::from_secs(1);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::MemoryDisk;

    #[test]
    fn a_first_start_in_the_last_years_of_the_48_bits_begins_at_the_build_and_meets_its_peer() {
        let built = Stamp::from_unix(Duration::from_secs(1_767_225_600));
        let today = built.plus(300 * Duration::from_secs(86_400));
        // 2096; 2106, which the 48 bits do not reach; never.
        for wall_s in [3_976_214_400, 4_291_747_200, u64::MAX] {
            let mut disk = MemoryDisk::default();
            let now = Now {
                mono: Duration::from_secs(5),
                wall: Duration::from_secs(wall_s),
            };
            let key = KeyId::from_bytes([7; 8]);
            let mut clock = SigningClock::start(key, Origin::KeyFile, None, built, now);
            assert_eq!(clock.wall_state(), WallState::FarAhead, "{wall_s}");
            assert!(clock.take(now, &mut disk).unwrap() < today, "{wall_s}");
            clock.meet(today, now, &mut disk).unwrap();
            let stamp = clock.take(now, &mut disk).unwrap();
            assert!(today < stamp && stamp < today.plus(LEAD), "{wall_s}");
        }
    }

    #[test]
    fn a_ceiling_is_never_lowered() {
        let mut disk = MemoryDisk::default();
        let key = KeyId::from_bytes([7; 8]);
        for (written, held) in [(100, 100), (50, 100), (101, 101)] {
            Ceiling::raise(&mut disk, &key, Stamp::new(written)).unwrap();
            let stored = disk.load::<Ceiling>(&key).unwrap();
            assert_eq!(stored, Some(Ceiling(Stamp::new(held))));
        }
        disk.records.insert(Ceiling::name(&key), b"half".to_vec());
        Ceiling::raise(&mut disk, &key, Stamp::new(200)).unwrap_err();
    }
}
