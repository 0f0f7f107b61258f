//! What passes from the one link to the other, byte for byte, and why the rest is held back.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::exchange::Random;
use mavlink_link::frame::{FrameView, MAX_FRAME, SETUP_SIGNING_ID};
use mavlink_link::link::{Alert, Auth, Event};

use super::phase::Phase;
use super::watch::Watch;
use super::{Agent, Keys, Side};
use crate::session::{Counters, LogLevel, Peer};

/// A frame on its way through, as it came.
#[derive(Debug)]
pub(super) struct Relayed {
    pub(super) side: Side,
    pub(super) to: Peer,
    pub(super) len: usize,
    pub(super) bytes: [u8; MAX_FRAME],
}

impl Agent {
    /// Takes what came from the ground. `random` is for the exchange.
    pub fn handle_radio(
        &mut self,
        now: Now,
        from: Peer,
        bytes: &[u8],
        random: &mut dyn Random,
        keys: &mut dyn Keys,
    ) {
        let closed = self.phase.is_closed(now.mono, self.px4.accepted_at());
        let to = self.px4.peer();
        let Agent {
            radio,
            phase,
            queue,
            held_back,
            to_px4,
            ..
        } = self;
        let auth = phase.ground_auth(keys);
        radio.handle_datagram(now, from, bytes, auth, &mut |delivery| {
            let why = match to {
                _ if !delivery.verified => "unsigned",
                _ if delivery.header.message_id == SETUP_SIGNING_ID => {
                    "SETUP_SIGNING from the ground"
                }
                _ if closed => "PX4 is not heard, signed",
                None => "PX4 has not been heard",
                Some(to) => match enqueue(queue, Side::Px4, to, &delivery.frame) {
                    true => {
                        *to_px4 += 1;
                        return;
                    }
                    false => "too much at once",
                },
            };
            held_back.count(why);
        });
        while let Some(event) = self.radio.poll_event() {
            match event {
                Event::KeyExchange(frame) => self.take_exchange(now, &frame, random, keys),
                Event::Alert(alert) => self.tell_alert("the ground's link", alert),
                Event::PeerChanged { to, .. } => {
                    self.note(LogLevel::Info, format!("the ground is at {to}"));
                }
                Event::Behind | Event::Live => {}
            }
        }
    }

    /// Takes what came from PX4.
    pub fn handle_px4(&mut self, now: Now, from: Peer, bytes: &[u8], keys: &mut dyn Keys) {
        match &self.phase {
            Phase::Keyless | Phase::CannotSign { .. } => {}
            Phase::HandingOver(_) => self.take_while_handing_over(now, from, bytes, keys),
            Phase::Relaying(_) => self.take_and_relay(now, from, bytes, keys),
        }
    }

    fn take_and_relay(&mut self, now: Now, from: Peer, bytes: &[u8], keys: &mut dyn Keys) {
        let Phase::Relaying(relaying) = &mut self.phase else {
            return;
        };
        let bad_before = self.px4.stats().bad_signature;
        let auth = Auth::Signed {
            key: &mut relaying.key,
            store: keys.disk(),
        };
        let mut forwarder = FrameForwarder {
            mono: now.mono,
            own_component: self.settings.own_component,
            ground: self.radio.peer(),
            watch: &mut self.watch,
            queue: &mut self.queue,
            held_back: &mut self.held_back,
            to_ground: &mut self.to_ground,
        };
        self.px4
            .handle_datagram(now, from, bytes, auth, &mut |delivery| {
                if delivery.verified {
                    forwarder.pass(&delivery.frame);
                }
            });
        let mut unsigned = false;
        while let Some(event) = self.px4.poll_event() {
            match event {
                Event::Alert(Alert::VehicleUnsigned) => unsigned = true,
                Event::Alert(alert) => self.tell_alert("PX4's link", alert),
                Event::Live => self.note(LogLevel::Info, "link to PX4 is up, signed and verified"),
                Event::Behind => self.note(
                    LogLevel::Info,
                    "PX4's timestamps went back: it has restarted; sending it a current timestamp",
                ),
                Event::PeerChanged { .. } | Event::KeyExchange(_) => {}
            }
        }
        let fell_back = self.px4.stats().bad_signature > bad_before
            && self.is_under_previous(now, from, bytes, keys);
        if unsigned || fell_back {
            self.key_lost(unsigned, now, keys);
        } else if self.watch.take_restart() {
            self.px4_restarted(keys);
        }
    }

    /// It signs with the current key after a start: the one before has come to its end.
    fn px4_restarted(&mut self, keys: &mut dyn Keys) {
        self.note(LogLevel::Info, "PX4 has restarted and signs");
        if let Phase::Relaying(relaying) = &mut self.phase
            && relaying.previous.is_some()
        {
            match keys.drop_previous() {
                Ok(()) => relaying.previous = None,
                Err(fault) => self.note(
                    LogLevel::Warning,
                    format!("the key before cannot be deleted: {fault}"),
                ),
            }
        }
    }
}

/// What a frame of PX4 goes through on its way to the ground.
pub(super) struct FrameForwarder<'a> {
    pub(super) mono: Duration,
    pub(super) own_component: u8,
    pub(super) ground: Option<Peer>,
    pub(super) watch: &'a mut Watch,
    pub(super) queue: &'a mut VecDeque<Relayed>,
    pub(super) held_back: &'a mut Counters,
    pub(super) to_ground: &'a mut u64,
}

impl FrameForwarder<'_> {
    /// A frame that has verified under the key in force.
    pub(super) fn pass(&mut self, frame: &FrameView<'_>) {
        self.watch.take(self.mono, frame);
        let header = frame.header();
        let why = match self.ground {
            _ if header.message_id == SETUP_SIGNING_ID => "SETUP_SIGNING from PX4",
            _ if header.component_id == self.own_component => "our own frame, reflected",
            None => "the ground has not been heard",
            Some(to) => match enqueue(self.queue, Side::Radio, to, frame) {
                true => {
                    *self.to_ground += 1;
                    return;
                }
                false => "too much at once",
            },
        };
        self.held_back.count(why);
    }
}

/// False where the queue is full.
fn enqueue(queue: &mut VecDeque<Relayed>, side: Side, to: Peer, frame: &FrameView<'_>) -> bool {
    let frame = frame.as_bytes();
    let mut bytes = [0; MAX_FRAME];
    let Some(place) = bytes.get_mut(..frame.len()) else {
        return false;
    };
    if queue.len() >= MAX_RELAYED {
        return false;
    }
    place.copy_from_slice(frame);
    queue.push_back(Relayed {
        side,
        to,
        len: frame.len(),
        bytes,
    });
    true
}

/// Frames of one datagram, many times over: more than this is a flood.
const MAX_RELAYED: usize = 1_024;
