//! Frames to the vehicle: heartbeats under either key, which find out which one it uses, and SETUP_SIGNING.

use core::time::Duration;

use zeroize::Zeroizing;

use super::rollover::{ASK_FAST_FOR, KeyRollover, KeySlot, NewKey, State};
use crate::Now;
use crate::dialect::MavMessage;
use crate::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, SETUP_SIGNING_ID, encode, encode_raw};
use crate::link::challenge::{ANSWER_EVERY, CHALLENGE_EVERY};
use crate::link::receiver::{AUTOPILOT, KeyState};
use crate::signing::clock::{ClockError, Origin, first_stamp};
use crate::signing::{Stamp, sign};
use crate::store::Disk;

/// A frame that is ready in the caller's buffer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transmit<A> {
    /// Where it must go.
    pub to: A,
    /// Its bytes in the buffer.
    pub len: usize,
    /// It holds a key: never record or log it, and wipe the buffer once it is sent.
    pub secret: bool,
}

impl<A> Transmit<A> {
    fn open(to: A, len: usize) -> Self {
        Self {
            to,
            len,
            secret: false,
        }
    }
}

impl<A: Copy + Eq> KeyRollover<A> {
    /// The next frame that is due, if any. Call it until it returns `None`, after each call of
    /// [`handle_datagram`](Self::handle_datagram) and [`handle_timeout`](Self::handle_timeout).
    pub fn poll_transmit(
        &mut self,
        now: Now,
        store: &mut dyn Disk,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<Transmit<A>> {
        // The key, which is secret, waits while two addresses claim to be the vehicle.
        let is_clear = self.peer.contender(now.mono).is_none();
        if let (true, Some(to)) = (self.setup_due && !self.held && is_clear, self.peer()) {
            // If the disk fails there is no timestamp: the next call tries again.
            let len = self.setup_signing(now, store, out).ok()?;
            self.setup_due = false;
            self.entered = now.mono;
            self.tries += 1;
            // Evidence from before this attempt says nothing about it.
            (self.seen.old_newer, self.seen.unsigned, self.seen.future) = (0, 0, 0);
            (self.seen.mark, self.seen.refused_armed) = (None, false);
            // Heartbeats under both keys follow at once.
            (self.heartbeat_at, self.new_next) = (now.mono, false);
            return Some(Transmit {
                to,
                len,
                secret: true,
            });
        }
        if let Some((to, (under, answer))) = self.answer.take(ANSWER_EVERY, now.mono) {
            let len = self.message(under, &answer.message(), now, store, out);
            return Some(Transmit::open(to, len.ok()?));
        }
        if let Some((to, under)) = self.challenge.take(CHALLENGE_EVERY, now.mono) {
            let key = self.key_mut(under)?;
            let challenge = key.challenge(now, store).ok()?.message();
            let len = self.message(under, &challenge, now, store, out);
            return Some(Transmit::open(to, len.ok()?));
        }
        let (under, to) = self.next_heartbeat(now.mono)?;
        let beat = MavMessage::HEARTBEAT(self.config.link.heartbeat());
        let len = self.message(under, &beat, now, store, out).ok()?;
        Some(Transmit::open(to, len))
    }

    /// Under which key a heartbeat is due, and where to. A stale frame gets a heartbeat at the address it came from, which
    /// lifts a vehicle that has restarted. It does not prove the address, so nothing else is sent there.
    fn next_heartbeat(&mut self, mono: Duration) -> Option<(KeySlot, A)> {
        if let Some((to, under)) = self.lifts.take(mono) {
            return Some((under, to));
        }
        let to = self.peer()?;
        if mono < self.heartbeat_at {
            return None;
        }
        let every = match self.state {
            State::Sent => ASKING,
            State::Unknown if mono.saturating_sub(self.entered) < ASK_FAST_FOR => ASKING,
            State::Unknown => ASKING_SLOWLY,
            _ => BEAT,
        };
        self.heartbeat_at = mono.saturating_add(every);
        let under = match self.state {
            State::Committed => KeySlot::New,
            // Before the first SETUP_SIGNING the vehicle cannot have the new key.
            State::Staged | State::WaitDisarm | State::NotTaken if self.tries == 0 => KeySlot::Old,
            _ => {
                // PX4 drops a frame under the wrong key without an answer, so both keys are tried in turn.
                self.new_next = !self.new_next;
                if self.new_next {
                    KeySlot::Old
                } else {
                    KeySlot::New
                }
            }
        };
        Some((under, to))
    }

    fn message(
        &mut self,
        // A staged key has no clock yet and has been sent to nobody.
        under: KeySlot,
        message: &MavMessage,
        now: Now,
        store: &mut dyn Disk,
        out: &mut [u8; MAX_FRAME],
    ) -> Result<usize, ClockError> {
        let under = match (under, &self.new) {
            (KeySlot::New, NewKey::Staged(_)) => KeySlot::Old,
            (other, _) => other,
        };
        let signed = under == KeySlot::New || self.old.is_some();
        let len = encode(message, self.header(0, signed), out);
        if !signed {
            return Ok(len);
        }
        let stamp = self.take_stamp(under, now, store)?;
        // From this timestamp on, a frame under the old key that is newer proves that the vehicle still uses it.
        if under == KeySlot::Old && (self.tries > 0 || self.state == State::Unknown) {
            self.seen.mark.get_or_insert(stamp);
        }
        Ok(self.sign(under, stamp, out, len))
    }

    /// SETUP_SIGNING (256): initial_timestamp, target_system, target_component, secret_key.
    fn setup_signing(
        &mut self,
        now: Now,
        store: &mut dyn Disk,
        out: &mut [u8; MAX_FRAME],
    ) -> Result<usize, ClockError> {
        let initial = self.offer(now, store)?;
        let NewKey::Offered(new) = &self.new else {
            return Err(ClockError::Ceiling);
        };
        // PX4 does not check the target fields; ArduPilot does.
        let mut payload = Zeroizing::new([0; 42]);
        payload[..8].copy_from_slice(&initial.get().to_le_bytes());
        payload[8] = self.config.link.vehicle_system;
        payload[9] = AUTOPILOT;
        payload[10..].copy_from_slice(new.key().expose());
        let signed = self.old.is_some();
        let header = self.header(SETUP_SIGNING_ID, signed);
        // Not `encode`: a SETUP_SIGNING_DATA would be another copy of the key, which is not wiped. The dialect knows the
        // message and 42 bytes fit, so this cannot fail.
        let len = encode_raw(header, &*payload, out).map_err(|_| ClockError::Ceiling)?;
        if !signed {
            return Ok(len);
        }
        let stamp = self.take_stamp(KeySlot::Old, now, store)?;
        Ok(self.sign(KeySlot::Old, stamp, out, len))
    }

    /// Starts the new key's clock, and returns its first timestamp: above every one seen or sent, and stored
    /// before anything is sent.
    fn offer(&mut self, now: Now, store: &mut dyn Disk) -> Result<Stamp, ClockError> {
        let seen = self
            .old
            .as_ref()
            .map_or(Stamp::ZERO, |old| old.clock().reading(now));
        if let NewKey::Staged(key) = &self.new {
            let key = key.duplicate();
            let (wall, _) = first_stamp(Stamp::from_unix(now.wall), self.config.not_before);
            // The wall clock alone is trusted only where there is no clock of an older key.
            let base = if self.old.is_some() { seen } else { wall };
            let initial = base.next().ok_or(ClockError::Exhausted)?;
            let origin = Origin::Provisioned { initial };
            let started = KeyState::start(key, origin, self.config.not_before, now, store)
                .map_err(|_| ClockError::Ceiling)?;
            let mut started = Box::new(started);
            // From here on the store knows the key, so a process that starts again knows that it may have been sent. A
            // clock that has just started writes nothing until it passes its start value, so it is moved one beyond.
            let beyond = started.clock().ceiling().next();
            match started.follow(beyond.ok_or(ClockError::Exhausted)?, now, store) {
                // On its way to a slow disk: started again it would take its own ceiling for that of an earlier run.
                Ok(()) | Err(ClockError::Raising) => self.new = NewKey::Offered(started),
                Err(fault) => return Err(fault),
            }
            // Only a durable ceiling may be sent: after a crash the clock must start above it.
            return match &self.new {
                NewKey::Offered(new) if new.clock().ceiling() >= initial => Ok(initial),
                _ => Err(ClockError::Raising),
            };
        }
        let NewKey::Offered(new) = &mut self.new else {
            return Err(ClockError::Ceiling);
        };
        // Above both clocks: SETUP_SIGNING sets PX4's clock, and from a lower value its frames would be stale here.
        let initial = seen.max(new.clock().reading(now));
        let initial = initial.next().ok_or(ClockError::Exhausted)?;
        new.follow(initial, now, store)?;
        Ok(initial)
    }

    /// A timestamp for one key that the other will never use: the vehicle keeps one table of streams for both.
    fn take_stamp(
        &mut self,
        under: KeySlot,
        now: Now,
        store: &mut dyn Disk,
    ) -> Result<Stamp, ClockError> {
        let new = match &mut self.new {
            NewKey::Offered(new) => Some(&mut **new),
            NewKey::Staged(_) => None,
        };
        let (mine, other) = match under {
            KeySlot::Old => (self.old.as_mut(), new),
            KeySlot::New => (new, self.old.as_mut()),
        };
        let mine = mine.ok_or(ClockError::Ceiling)?;
        let stamp = mine.take_stamp(now, store)?;
        // PX4 keeps its stream table over a change of key, so stamps must rise across both keys.
        if let Some(other) = other {
            other.follow(stamp, now, store)?;
        }
        Ok(stamp)
    }

    fn sign(&self, under: KeySlot, stamp: Stamp, out: &mut [u8; MAX_FRAME], len: usize) -> usize {
        let state = match (under, &self.new) {
            (KeySlot::New, NewKey::Offered(new)) => Some(&**new),
            _ => self.old.as_ref(),
        };
        // Neither error can occur: the frame was marked as signed when encoded, and is far shorter than the longest frame.
        state.map_or(len, |state| {
            sign(state.key(), self.config.link.link_id, stamp, out, len).unwrap_or(len)
        })
    }

    fn header(&mut self, message_id: u32, signed: bool) -> Header {
        let seq = self.seq;
        self.seq = seq.wrapping_add(1);
        Header {
            seq,
            system_id: self.config.link.own_system,
            component_id: self.config.link.own_component,
            message_id,
            incompat: if signed { INCOMPAT_SIGNED } else { 0 },
            compat: 0,
        }
    }
}

const BEAT: Duration = Duration::from_secs(1);
/// Heartbeats under both keys in turn, 5 Hz.
const ASKING: Duration = Duration::from_millis(200);
const ASKING_SLOWLY: Duration = Duration::from_secs(5);
