//! Brings two ends together whose clocks are more than an hour apart. That happens if one of them was ever started with a wrong wall
//! clock, because the clock of a key never goes back.
//!
//! Promised:
//! - While both ends run, they agree on the later of the two clocks within a few round trips, without an operator.
//! - An end moves its clock forward only if a holder of the key has answered a challenge that this end made within the last
//!   [`ANSWER_WITHIN`]. A recording cannot do that, because it is older than the challenge; the answer to a recorded challenge matches
//!   no challenge that is still open.
//! - Datagrams sealed before that answer are refused from then on, whether they were recorded or withheld: the clock moves as after a
//!   restart from a ceiling there ([`SigningClock::meet`](mavlink_link::clock::SigningClock::meet)), which is stored first.
//! - Challenges are answered whatever their stamps, because the stamps of the end that is behind are always too old.
//! - Each replayed recording is answered at most once, with 52 bytes, and cannot use up the answer to the real sender, whose stamps are
//!   above all recorded ones ([`Turn`](super::turn::Turn)).
//!
//! The last ten years of stamps are never accepted, so that a holder of the key cannot end the life of a clock with one datagram.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::signing::Stamp;
use mavlink_link::store::Disk;
use stanag_msgs::Id;
use stanag_msgs::guard::{CLOCK_BYTES, ClockDatagram, ClockStep, Direction, MAX_GUARDED};

use super::{GuardEnd, GuardRefusal, Keyed, LIFT_EVERY, stamp_of};

impl GuardEnd {
    /// Writes a challenge to the sender of a datagram that is too far ahead; returns its length.
    pub(super) fn challenge(
        &mut self,
        place: usize,
        ahead: Stamp,
        now: Now,
        out: &mut [u8; MAX_GUARDED],
        disk: &mut dyn Disk,
    ) -> Option<usize> {
        let sender = (self.own, self.sends);
        let keyed = self.keys.get_mut(place)?;
        // One challenge at a time, until it is answered or expires.
        let may = keyed.clock.may_meet(ahead);
        if !may || !keyed.asked.challenges.take(ahead, now.mono, ANSWER_WITHIN) {
            return None;
        }
        let Ok(trailer) = keyed.trailer(sender, now, disk) else {
            keyed.asked.challenges.repeat(now.mono + LIFT_EVERY);
            return None;
        };
        let challenge = keyed.key.challenge(trailer, self.peer);
        keyed.asked.waiting = Some((challenge, now.mono));
        Some(write(&challenge, out))
    }

    /// Handles a challenge or an answer. A challenge is answered if an answer is due: returns its length. An answer to this end's
    /// challenge moves its clock forward.
    ///
    /// # Errors
    /// Why it is refused; no clock has moved then.
    pub fn take_clock(
        &mut self,
        now: Now,
        received: &ClockDatagram,
        out: &mut [u8; MAX_GUARDED],
        disk: &mut dyn Disk,
    ) -> Result<Option<usize>, GuardRefusal> {
        let answer = self.judge_clock(now, received, disk);
        if let Err(why) = answer {
            self.refused.count(why.name());
        }
        Ok(answer?.map(|answer| write(&answer, out)))
    }

    /// How far the clock has moved forward to that of the other end, once after each time.
    pub fn take_met(&mut self) -> Option<String> {
        let ahead = self.met.take()?.as_secs_f64();
        Some(format!(
            "the clock of the guard key moved {ahead:.0} s ahead, to that of {}: one of the two computers started with a \
             wrong clock",
            self.peer
        ))
    }

    fn judge_clock(
        &mut self,
        now: Now,
        received: &ClockDatagram,
        disk: &mut dyn Disk,
    ) -> Result<Option<ClockDatagram>, GuardRefusal> {
        let trailer = &received.trailer;
        self.judge_way(trailer)?;
        let (own, peer, sender) = (self.own, self.peer, (self.own, self.sends));
        let grace = self.grace;
        let named = self.keys.iter_mut();
        let mut named = named
            .filter(|one| one.key.id() == trailer.key_id && !one.is_over(now.mono, grace))
            .peekable();
        if named.peek().is_none() {
            return Err(GuardRefusal::Key);
        }
        match received.step {
            ClockStep::Challenge => {
                let asked = named.find(|one| one.key.verifies_challenge(received, own));
                let keyed = asked.ok_or(GuardRefusal::Forged)?;
                Ok(keyed.answer(received, sender, peer, now, disk))
            }
            // Its HMAC is over the challenge: a forged one and one to another challenge look alike.
            ClockStep::Answer => {
                let answered = named.find(|one| one.waits_for(received, own, now.mono));
                let keyed = answered.ok_or(GuardRefusal::Unasked)?;
                if let Some(ahead) = keyed.meet(received, now, disk)? {
                    self.met = Some(ahead);
                }
                Ok(None)
            }
        }
    }
}

impl Keyed {
    fn answer(
        &mut self,
        challenge: &ClockDatagram,
        sender: (Id, Direction),
        peer: Id,
        now: Now,
        disk: &mut dyn Disk,
    ) -> Option<ClockDatagram> {
        // In whatever order they arrive in from the other end, the newest is the one that it waits for.
        let asked = stamp_of(challenge.trailer.stamp_us)?;
        if !self.asked.answers.take(asked, now.mono, LIFT_EVERY) {
            return None;
        }
        let trailer = self.trailer(sender, now, disk).ok()?;
        Some(self.key.answer(challenge, trailer, peer))
    }

    fn waits_for(&self, received: &ClockDatagram, own: Id, now: Duration) -> bool {
        self.asked.waiting.as_ref().is_some_and(|(challenge, at)| {
            now.saturating_sub(*at) <= ANSWER_WITHIN
                && self.key.verifies_answer(received, own, challenge)
        })
    }

    /// Moves the clock forward to that of the other end, which has proved that it is there now. Returns how far.
    fn meet(
        &mut self,
        answer: &ClockDatagram,
        now: Now,
        disk: &mut dyn Disk,
    ) -> Result<Option<Duration>, GuardRefusal> {
        let stamp = stamp_of(answer.trailer.stamp_us).ok_or(GuardRefusal::Ahead)?;
        if !self.clock.may_meet(stamp) {
            return Err(GuardRefusal::Ahead);
        }
        // Otherwise the two have met already.
        let mut ahead = None;
        if !self.clock.allows(stamp, now) {
            let before = self.clock.reading(now);
            if self.clock.meet(stamp, now, disk).is_err() {
                // The disk may have the ceiling in a moment.
                self.asked.challenges.repeat(now.mono + LIFT_EVERY);
                return Err(GuardRefusal::Disk);
            }
            // What is held back from here on is late.
            self.window.take(now.mono, stamp);
            ahead = Some(stamp.since(before));
        }
        self.asked.waiting = None;
        Ok(ahead)
    }
}

fn write(datagram: &ClockDatagram, out: &mut [u8; MAX_GUARDED]) -> usize {
    out[..CLOCK_BYTES].copy_from_slice(&datagram.to_bytes());
    CLOCK_BYTES
}

/// How old an answer may be, and the shortest time between two challenges. A slow radio takes a second or two each way.
pub(super) const ANSWER_WITHIN: Duration = Duration::from_secs(4);
