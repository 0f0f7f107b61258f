//! Passes frames from one link to the other, byte for byte, and counts why others are held back.
//!
//! Frames wait in one growing buffer, each as a slice of it ([`Bytes`]). The buffer is reused once they are sent, so a
//! relay that keeps up allocates nothing per frame.

use std::collections::VecDeque;
use std::time::Duration;

use bytes::{Bytes, BytesMut};
use mavlink_link::frame::{FrameView, MAX_FRAME, SETUP_SIGNING_ID};
use mavlink_link::link::Delivery;

use super::contingency::Alone;
use super::output::{Side, Transmit};
use super::watch::Watch;
use crate::relay_policy::{Denied, Px4Now, RelayPolicy};
use crate::session::{ByType, Counters, Peer};

/// A frame on its way through, unaltered.
#[derive(Debug)]
struct Relayed {
    side: Side,
    to: Peer,
    /// The same frame went to another address, where the other end may be as well.
    again: bool,
    bytes: Bytes,
}

/// The frames on their way through, and the counters.
#[derive(Debug)]
pub(super) struct Relay {
    queue: VecDeque<Relayed>,
    buffer: BytesMut,
    pub(super) held_back: Counters,
    /// Those that the policy keeps from PX4: messages and commands by number.
    pub(super) denied_messages: ByType,
    pub(super) denied_commands: ByType,
    policy: RelayPolicy,
    pub(super) to_px4: u64,
    pub(super) to_ground: u64,
}

impl Relay {
    pub(super) fn new(policy: RelayPolicy) -> Relay {
        Relay {
            queue: VecDeque::new(),
            buffer: BytesMut::with_capacity(BUFFER_BYTES),
            held_back: Counters::default(),
            denied_messages: ByType::default(),
            denied_commands: ByType::default(),
            policy,
            to_px4: 0,
            to_ground: 0,
        }
    }
}

/// How much the relay had taken at one moment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mark {
    queued: usize,
    to_ground: u64,
}

impl Relay {
    /// Takes a frame of the ground. `closed`: PX4 does not sign, and would carry out anybody's command.
    pub(super) fn pass_to_px4(
        &mut self,
        delivery: &Delivery<'_>,
        px4: Option<Peer>,
        closed: bool,
        now: Px4Now,
    ) {
        let why = match px4 {
            _ if !delivery.verified => "unsigned",
            // Even if validly signed: PX4 accepts a key on any link and checks no target, so only the agent sends one.
            _ if delivery.header.message_id == SETUP_SIGNING_ID => "SETUP_SIGNING from the ground",
            _ if closed => "PX4 is not heard, signed",
            None => "PX4 has not been heard",
            Some(to) => match self.policy.check(&delivery.frame, now) {
                Err(denied) => {
                    match denied {
                        Denied::Message(id) => self.denied_messages.count(id),
                        Denied::Command(command) | Denied::InFlight(command) => {
                            self.denied_commands.count(command.into());
                        }
                        Denied::ForcedDisarm
                        | Denied::Parameter(_)
                        | Denied::Elsewhere
                        | Denied::KeyFile
                        | Denied::Zeroizing => {}
                    }
                    denied.name()
                }
                Ok(()) if self.enqueue(Side::Px4, to, delivery.frame.as_bytes()) => {
                    self.to_px4 += 1;
                    return;
                }
                Ok(()) => "too much at once",
            },
        };
        self.held_back.count(why);
    }

    /// Returns false if the queue is full.
    fn enqueue(&mut self, side: Side, to: Peer, frame: &[u8]) -> bool {
        if self.queue.len() >= MAX_RELAYED {
            return false;
        }
        self.buffer.extend_from_slice(frame);
        let bytes = self.buffer.split().freeze();
        self.queue.push_back(Relayed {
            side,
            to,
            again: false,
            bytes,
        });
        true
    }

    /// The present position, for [`Relay::undo`].
    pub(super) fn mark(&self) -> Mark {
        Mark {
            queued: self.queue.len(),
            to_ground: self.to_ground,
        }
    }

    /// Drops the frames of PX4 that were taken since.
    pub(super) fn undo(&mut self, since: Mark) {
        // Only frames to the ground are queued between mark and undo, so `to_px4` needs no correction.
        self.queue.truncate(since.queued);
        self.to_ground = since.to_ground;
    }

    /// Writes the next frame into `out`. `others`: where the other end that it is for may be as well.
    pub(super) fn poll_transmit<I: Iterator<Item = Peer>>(
        &mut self,
        out: &mut [u8; MAX_FRAME],
        others: impl FnOnce(Side, Peer) -> I,
    ) -> Option<Transmit> {
        let relayed = self.queue.pop_front()?;
        let Relayed {
            side,
            to,
            again,
            bytes,
        } = relayed;
        if !again {
            for other in others(side, to) {
                self.queue.push_front(Relayed {
                    side,
                    to: other,
                    again: true,
                    bytes: bytes.clone(),
                });
            }
        }
        let len = bytes.len();
        out.get_mut(..len)?.copy_from_slice(&bytes);
        Some(Transmit::new(side, to, len))
    }
}

/// The parts that a frame of PX4 passes on its way to the ground.
pub(super) struct FrameForwarder<'a> {
    pub(super) mono: Duration,
    pub(super) own_component: u8,
    pub(super) ground: Option<Peer>,
    pub(super) watch: &'a mut Watch,
    pub(super) alone: &'a mut Alone,
    pub(super) relay: &'a mut Relay,
}

impl FrameForwarder<'_> {
    /// Takes a frame that has verified under the key in force.
    pub(super) fn pass(&mut self, frame: &FrameView<'_>) {
        self.watch.take(self.mono, frame);
        self.alone.take(self.mono, frame);
        let header = frame.header();
        let why = match self.ground {
            // It would carry a key over the radio in the clear. PX4 v1.18 never forwards one (mavlink_main.cpp); the agent
            // does not rely on that.
            _ if header.message_id == SETUP_SIGNING_ID => "SETUP_SIGNING from PX4",
            // Towards the ground the agent has the vehicle's system id: this frame would pass for one of the agent's.
            _ if header.component_id == self.own_component => "our own frame, reflected",
            None => "the ground has not been heard",
            Some(to) => match self.relay.enqueue(Side::Radio, to, frame.as_bytes()) {
                true => {
                    self.relay.to_ground += 1;
                    return;
                }
                false => "too much at once",
            },
        };
        self.relay.held_back.count(why);
    }
}

/// Many times the frames of one datagram: more than this is a flood.
const MAX_RELAYED: usize = 1_024;
const BUFFER_BYTES: usize = 64 * 1024;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_relay_that_keeps_up_reuses_its_buffer() {
        let mut relay = Relay::new(RelayPolicy::default());
        let first = relay.buffer.as_ptr() as usize;
        for round in 0..2_000_u32 {
            let frame = [round as u8; 200];
            for _ in 0..3 {
                assert!(relay.enqueue(Side::Px4, Peer::Serial, &frame));
            }
            for queued in &relay.queue {
                assert!((first..first + BUFFER_BYTES).contains(&(queued.bytes.as_ptr() as usize)));
            }
            let mut out = [0; MAX_FRAME];
            while let Some(sent) = relay.poll_transmit(&mut out, |_, _| std::iter::empty()) {
                assert_eq!(out[..sent.len], frame);
            }
        }
    }
}
