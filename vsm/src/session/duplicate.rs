//! Duplicates: the same source, destination, type, stamp and octets; acknowledged again, not carried out again.
//!
//! Each message is known by the digest of its octets. Those that command are remembered apart from questions and
//! streams, so that neither sticks nor heartbeats push them out, and are written down ([`super::journal`]): they are
//! known after a restart too.

use std::collections::VecDeque;

use sha2::{Digest as _, Sha256};
use stanag_msgs::enums::AckType;
use stanag_msgs::wrapper::Frame;
use stanag_msgs::{Id, Message, TimeStamp};

/// The latest messages of one CUCS and what each was answered.
#[derive(Debug, Default)]
pub(crate) struct Recent {
    commands: VecDeque<Seen>,
    others: VecDeque<Seen>,
}

/// The first octets of SHA-256 over a whole message, wrapper and checksum too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Digest(pub(crate) [u8; 16]);

impl Digest {
    fn of(octets: &[u8]) -> Digest {
        let whole: [u8; 32] = Sha256::digest(octets).into();
        let mut first = [0; 16];
        first.copy_from_slice(&whole[..16]);
        Digest(first)
    }
}

/// One message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Seen {
    pub(crate) digest: Digest,
    pub(crate) stamp: TimeStamp,
    pub(crate) message_type: u16,
    /// Whom it was for.
    pub(crate) destination: Id,
    pub(crate) ack_requested: bool,
    /// Select Flight Path Control Mode of a 2016, 0 of all others.
    pub(crate) mode: u8,
    /// What it was answered last.
    pub(crate) answer: Option<AckType>,
}

impl Seen {
    pub(crate) fn new(
        frame: &Frame<'_>,
        message: &Message,
        stamp: TimeStamp,
        ack_requested: bool,
    ) -> Seen {
        let mode = match message {
            Message::VehicleOperatingModeCommand(command) => command
                .select_flight_path_control_mode
                .map_or(0, |mode| mode.raw()),
            _ => 0,
        };
        Seen {
            digest: Digest::of(frame.octets),
            stamp,
            message_type: frame.header.message_type,
            destination: frame.header.destination,
            ack_requested,
            mode,
            answer: None,
        }
    }

    /// Whether a second carrying out would do something: all but questions, heartbeats and the stream of sticks, of
    /// which the next one takes the place of the last.
    pub(crate) fn commands(&self) -> bool {
        !NO_COMMANDS.contains(&self.message_type)
    }
}

impl Recent {
    /// What was read back after a restart.
    pub(super) fn restored(commands: VecDeque<Seen>) -> Recent {
        Recent {
            commands,
            others: VecDeque::new(),
        }
    }

    /// The answer given to this very message before: `Some(None)` where it was seen and not answered yet.
    pub(crate) fn find(&self, new: &Seen) -> Option<Option<AckType>> {
        let ring = if new.commands() {
            &self.commands
        } else {
            &self.others
        };
        ring.iter()
            .rev()
            .find(|seen| seen.stamp == new.stamp && seen.digest == new.digest)
            .map(|seen| seen.answer)
    }

    /// Remembers a message. One without a stamp cannot be told from a new one, and is not remembered.
    pub(crate) fn remember(&mut self, new: Seen) {
        let ring = self.ring(new.message_type);
        if ring.len() == DEPTH {
            ring.pop_front();
        }
        ring.push_back(new);
    }

    /// Notes the answer to the latest message of this type and stamp.
    pub(crate) fn answered(
        &mut self,
        message_type: u16,
        stamp: TimeStamp,
        answer: AckType,
    ) -> Option<Seen> {
        let mut latest = self.ring(message_type).iter_mut().rev();
        let seen = latest.find(|seen| seen.message_type == message_type && seen.stamp == stamp)?;
        seen.answer = Some(answer);
        Some(*seen)
    }

    /// Those that command, the oldest first.
    pub(super) fn commands(&self) -> impl Iterator<Item = &Seen> {
        self.commands.iter()
    }

    /// Forgets one: it is carried out when it comes again.
    pub(super) fn forget(&mut self, digest: Digest) {
        self.commands.retain(|seen| seen.digest != digest);
    }

    fn ring(&mut self, message_type: u16) -> &mut VecDeque<Seen> {
        if NO_COMMANDS.contains(&message_type) {
            &mut self.others
        } else {
            &mut self.commands
        }
    }
}

/// Sticks, subsystem status requests, heartbeat, acknowledgement, schedule and request of reports, configuration
/// request; parameter request and ping of ours.
const NO_COMMANDS: [u16; 10] = [
    2010, 15000, 15001, 16002, 17000, 17001, 17002, 40000, 50010, 50014,
];
/// Messages remembered a CUCS, of each of the two kinds: an upload of 500 waypoints, sent twice, is told apart.
pub(super) const DEPTH: usize = 1024;
