//! What received frames prove about the vehicle's key.
//!
//! A vehicle that signs forwards other people's unsigned HEARTBEATs (pitfall 24), so an unsigned heartbeat proves nothing;
//! an unsigned message of another kind proves that the vehicle does not sign, if the address is the vehicle's.

use core::time::Duration;

use super::rollover::{Event, KeyRollover, KeySlot, NewKey, Outcome, State};
use crate::Now;
use crate::address::Sender;
use crate::dialect::{MavAutopilot, MavMessage, MavModeFlag};
use crate::frame::{FrameView, Stamp};
use crate::link::challenge::{Ping, Turns};
use crate::link::receiver::{AUTOPILOT, Expected, Refusal};
use crate::store::Disk;

/// What one frame of the vehicle's autopilot turned out to be.
enum Proof {
    New,
    /// With its stamp; `None` where the stamp was refused as too far ahead.
    Old(Option<Stamp>),
    Stale(KeySlot),
    /// Verified under the new key, and stamped too far ahead.
    Ahead,
    Unsigned,
    Foreign,
}

impl<A: Copy + Eq> KeyRollover<A> {
    /// Takes a datagram, or a read of a serial port.
    pub fn handle_datagram(&mut self, now: Now, from: A, bytes: &[u8], store: &mut dyn Disk) {
        self.handle_and_pass(now, from, bytes, store, &mut |_, _| {});
    }

    /// As [`handle_datagram`](Self::handle_datagram), for a relay: `pass` receives each accepted frame of the vehicle
    /// once, and the key that it verified under. Frames under the new key are passed only once it is committed.
    pub fn handle_and_pass(
        &mut self,
        now: Now,
        from: A,
        bytes: &[u8],
        store: &mut dyn Disk,
        pass: &mut dyn FnMut(KeySlot, &FrameView<'_>),
    ) {
        let is_peer = self.peer() == Some(from);
        // Taken out while its frames are borrowed; it is a few hundred bytes.
        let mut parser = if is_peer {
            core::mem::take(&mut self.parser)
        } else {
            core::mem::take(&mut self.strange)
        };
        let mut frames = parser.feed(bytes);
        while let Some(item) = frames.next() {
            if let Ok(frame) = item
                && frame.is_checked()
            {
                self.take(now, from, &frame, store, pass);
            }
        }
        if is_peer {
            self.parser = parser;
        } else {
            parser.discard_pending();
            self.strange = parser;
        }
        self.decide(now.mono);
    }

    fn take(
        &mut self,
        now: Now,
        from: A,
        frame: &FrameView<'_>,
        store: &mut dyn Disk,
        pass: &mut dyn FnMut(KeySlot, &FrameView<'_>),
    ) {
        let header = frame.header();
        let link = &self.config.link;
        if header.system_id == link.own_system {
            return;
        }
        if header.system_id != link.vehicle_system {
            self.watch_others(header.system_id, frame);
            return;
        }
        if header.component_id != AUTOPILOT {
            // A camera or gimbal beside the autopilot proves nothing about the autopilot's key.
            match self.prove(now, from, frame, store) {
                Proof::New if self.state == State::Committed => pass(KeySlot::New, frame),
                Proof::Old(Some(_)) if self.state != State::Committed => pass(KeySlot::Old, frame),
                _ => {}
            }
            return;
        }
        let message = frame.message().ok();
        match self.prove(now, from, frame, store) {
            Proof::New => {
                self.verified_from(now.mono, from, frame);
                self.seen.verified = Some(now.mono);
                self.read(now.mono, message.as_ref());
                self.commit(now);
                pass(KeySlot::New, frame);
            }
            Proof::Old(stamp) => {
                match stamp {
                    Some(_) => self.verified_from(now.mono, from, frame),
                    // It may be a replay: it does not move a known peer.
                    None => {
                        self.seen.future = self.seen.future.saturating_add(1);
                        if self.peer().is_none() {
                            self.peer.assume(from);
                        }
                        self.seen.first.get_or_insert(now.mono);
                    }
                }
                self.seen.verified = Some(now.mono);
                self.seen.old = Some(now.mono);
                if let (Some(stamp), Some(mark)) = (stamp, self.seen.mark)
                    && stamp >= mark
                {
                    self.seen.old_newer = self.seen.old_newer.saturating_add(1);
                }
                self.read(now.mono, message.as_ref());
                if stamp.is_some() && self.state != State::Committed {
                    pass(KeySlot::Old, frame);
                }
            }
            Proof::Stale(under) => {
                // The vehicle has restarted, or it is a replay: a heartbeat is sent there, and nothing else.
                self.seen.first.get_or_insert(now.mono);
                if let Some(signature) = frame.signature() {
                    let _ = self.peer.note_second(now.mono, from, &signature);
                    if self.rising.counts(from, signature.stamp, now.mono) {
                        self.lifts
                            .note(from, self.peer.get(), signature.stamp, under);
                    }
                }
            }
            // It may be a replay: it is asked for a proof, and nothing else.
            Proof::Ahead => {
                self.seen.first.get_or_insert(now.mono);
            }
            Proof::Unsigned => self.take_unsigned(now.mono, from, message.as_ref()),
            Proof::Foreign => self.seen.foreign += 1,
        }
    }

    fn prove(&mut self, now: Now, from: A, frame: &FrameView<'_>, store: &mut dyn Disk) -> Proof {
        let Some(signature) = frame.signature() else {
            return Proof::Unsigned;
        };
        let (stamp, header, peer) = (signature.stamp, frame.header(), self.peer());
        let expected = Expected {
            own_system: self.config.link.own_system,
            system: self.config.link.vehicle_system,
            autopilot_link: self.config.link.vehicle_link_id,
            only: self.config.link.only,
        };
        if let NewKey::Offered(key) = &mut self.new {
            let judged = key.receive(frame, expected, now, store);
            note_challenge(&mut self.answer, KeySlot::New, judged, from, peer, frame);
            match judged {
                Ok(_) => return Proof::New,
                Err(Refusal::Stale) => return Proof::Stale(KeySlot::New),
                Err(Refusal::Future) => {
                    if key.wants_challenge(header.system_id, now) {
                        self.challenge.note(from, peer, stamp, KeySlot::New);
                    }
                    return Proof::Ahead;
                }
                Err(_) => {}
            }
        }
        let Some(key) = &mut self.old else {
            return Proof::Foreign;
        };
        let judged = key.receive(frame, expected, now, store);
        note_challenge(&mut self.answer, KeySlot::Old, judged, from, peer, frame);
        // Where the key can be sent, the new one sets the vehicle's clock back, which is better than to follow it.
        if judged == Err(Refusal::Future)
            && !self.config.may_send_key
            && key.wants_challenge(header.system_id, now)
        {
            self.challenge.note(from, peer, stamp, KeySlot::Old);
        }
        match judged {
            Ok(stamp) => Proof::Old(Some(stamp)),
            Err(Refusal::Stale) => Proof::Stale(KeySlot::Old),
            // A clock that somebody with the old key has dragged ahead is repaired by the new key.
            Err(Refusal::Future) => Proof::Old(None),
            Err(_) => Proof::Foreign,
        }
    }

    /// Another autopilot would take the key too, since PX4 ignores the target fields of SETUP_SIGNING: before anything is
    /// sent, that ends the rollover.
    fn watch_others(&mut self, system: u8, frame: &FrameView<'_>) {
        // PX4 does not check the target of SETUP_SIGNING: a second autopilot on the link would take the key too.
        if !self.nothing_is_sent() {
            return;
        }
        if let Ok(MavMessage::HEARTBEAT(heartbeat)) = frame.message()
            && heartbeat.autopilot != MavAutopilot::MAV_AUTOPILOT_INVALID
        {
            self.events.push_back(Event::SeveralAutopilots { system });
            self.end(Outcome::SeveralAutopilots);
        }
    }

    /// Without a signature only an address counts that has verified, or that is configured; unless there is no key in
    /// force that could verify, or it was confirmed from outside that the vehicle has lost its key.
    fn take_unsigned(&mut self, mono: Duration, from: A, message: Option<&MavMessage>) {
        let confirmed = self.old.is_none() || self.config.believe_unsigned;
        match self.peer() {
            Some(peer) if peer == from => {}
            None if confirmed => {}
            Some(_) if confirmed && self.nothing_is_sent() => {
                // Two addresses claim to be the vehicle: the key would be sent to one of them.
                let system = self.config.link.vehicle_system;
                self.events.push_back(Event::SeveralAutopilots { system });
                return self.end(Outcome::SeveralAutopilots);
            }
            _ => {
                self.seen.disbelieved += 1;
                return;
            }
        }
        let heartbeat = matches!(message, Some(MavMessage::HEARTBEAT(_)));
        // PX4 forwards anybody's heartbeats even when it signs, but no other unsigned message.
        if !heartbeat {
            self.seen.unsigned = self.seen.unsigned.saturating_add(1);
        }
        let open = self.old.is_none() || self.vehicle_is_open(mono);
        if open && (!heartbeat || self.seen.unsigned > 0) {
            self.peer.assume(from);
            self.seen.first.get_or_insert(mono);
            self.seen.old = Some(mono);
            self.read(mono, message);
        }
    }

    /// An accepted frame came from there.
    fn verified_from(&mut self, mono: Duration, from: A, frame: &FrameView<'_>) {
        let _ = self.peer.prove(mono, from, Sender::Main, frame.signature());
        self.seen.accepted = Some(mono);
        self.seen.first.get_or_insert(mono);
    }

    fn nothing_is_sent(&self) -> bool {
        let waiting = matches!(self.state, State::Staged | State::WaitDisarm);
        waiting && self.tries == 0 && self.outcome.is_none()
    }

    /// What the vehicle reports: armed or not, and whether it refused the key while armed.
    fn read(&mut self, mono: Duration, message: Option<&MavMessage>) {
        match message {
            Some(MavMessage::HEARTBEAT(heartbeat)) => {
                let armed = heartbeat
                    .base_mode
                    .contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED);
                self.seen.disarmed = (!armed).then_some(mono);
            }
            Some(MavMessage::STATUSTEXT(data)) => {
                let text = data.text.to_str().unwrap_or_default();
                // SETUP_SIGNING has no COMMAND_ACK: this STATUSTEXT is PX4's only refusal.
                if text.contains("rejected while armed") && self.state == State::Sent {
                    self.seen.refused_armed = true;
                    self.events.push_back(Event::RefusedWhileArmed);
                }
            }
            _ => {}
        }
    }
}

/// Remembers a challenge of the other end, which is behind or was restarted: whatever its timestamp, it is answered.
fn note_challenge<A: Copy + Eq>(
    answer: &mut Turns<A, (KeySlot, Ping)>,
    under: KeySlot,
    judged: Result<Stamp, Refusal>,
    from: A,
    peer: Option<A>,
    frame: &FrameView<'_>,
) {
    if matches!(judged, Ok(_) | Err(Refusal::Stale | Refusal::Future))
        && let (Some(ping), Some(signature)) = (Ping::of(frame), frame.signature())
        && let Some(ping) = ping.answer(frame.header())
    {
        answer.note(from, peer, signature.stamp, (under, ping));
    }
}
