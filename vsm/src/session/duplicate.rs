//! Duplicates: the same source, destination, type, stamp and bytes; acknowledged again, not carried out again.
//!
//! Each message is known by the digest of its bytes. Those that command are remembered apart from questions and
//! streams, so that neither sticks nor heartbeats push them out, and are written down ([`super::command_log`]): they are
//! known after a restart too.
//!
//! An order can also be overtaken: its first datagram is lost, and what repeats it comes after a later order about the
//! same thing ([`about`]). Carried out then, it would undo the later one.

use std::collections::VecDeque;
use std::time::Duration;

use sha2::{Digest as _, Sha256};
use stanag_msgs::enums::{AckType, AreaPlanMode, MissionPlanMode};
use stanag_msgs::wrapper::Frame;
use stanag_msgs::{Id, Message, TimeStamp};

/// The latest messages of one CUCS and what each was answered.
#[derive(Debug, Default)]
pub(crate) struct Recent {
    commands: VecDeque<Seen>,
    others: VecDeque<Seen>,
}

/// The first bytes of SHA-256 over a whole message, wrapper and checksum too.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Digest(pub(crate) [u8; 16]);

impl Digest {
    fn of(bytes: &[u8]) -> Digest {
        let whole: [u8; 32] = Sha256::digest(bytes).into();
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
    /// When it came, and what it is about; none of what was read back after a restart.
    pub(crate) came: Option<(Duration, Option<u64>)>,
}

impl Seen {
    pub(crate) fn new(
        frame: &Frame<'_>,
        message: &Message,
        stamp: TimeStamp,
        ack_requested: bool,
        now: Duration,
    ) -> Seen {
        let mode = match message {
            Message::VehicleOperatingModeCommand(command) => command
                .select_flight_path_control_mode
                .map_or(0, |mode| mode.raw()),
            _ => 0,
        };
        Seen {
            digest: Digest::of(frame.bytes),
            stamp,
            message_type: frame.header.message_type,
            destination: frame.header.destination,
            ack_requested,
            mode,
            answer: None,
            came: Some((now, about(message))),
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

    /// Whether a later order about the same thing was taken shortly before this one came. One whose stamp is further
    /// back has not been on its way for so long: its sender's clock was set.
    pub(crate) fn is_overtaken(&self, new: &Seen) -> bool {
        let Some((now, Some(about))) = new.came else {
            return false;
        };
        self.commands.iter().rev().any(|seen| {
            let Some((at, Some(known))) = seen.came else {
                return false;
            };
            seen.message_type == new.message_type
                && known == about
                && seen.destination == new.destination
                && seen.answer != Some(AckType::Refused)
                && seen.stamp > new.stamp
                && seen.stamp.0 - new.stamp.0 < LONGEST_WAY_MS
                && now.saturating_sub(at).as_millis() < u128::from(LONGEST_WAY_MS)
        })
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

/// What a message orders about: of two orders about the same thing, which the message type tells beside this, the later
/// one counts. None of those whose order says nothing.
fn about(message: &Message) -> Option<u64> {
    let named = |name: &str| {
        let bytes = name.bytes();
        bytes.fold(0_u64, |sum, byte| {
            sum.wrapping_mul(31).wrapping_add(byte.into())
        })
    };
    let pair = |high: Option<u16>, low: Option<u16>| Some(u64::from(high?) << 16 | u64::from(low?));
    match message {
        Message::VehicleOperatingModeCommand(_)
        | Message::LoiterConfiguration(_)
        | Message::EngineCommand(_) => Some(0),
        Message::MissionTransferCommand(command) => {
            use MissionPlanMode as Mode;
            let changes = [Mode::Clear, Mode::Load, Mode::Cancel];
            let mode = command.mission_plan_mode?;
            changes.contains(&mode).then_some(0)
        }
        Message::AreaTransferCommand(command) => {
            let changes = [AreaPlanMode::Clear, AreaPlanMode::Load];
            changes.contains(&command.area_plan_mode?).then_some(0)
        }
        Message::UaRoute(route) => Some(match mapping::plan::route_name(route) {
            Some(name) => u64::MAX - named(name),
            None => mapping::plan::route_type(route).raw().into(),
        }),
        Message::UaPositionWaypoint(waypoint) => waypoint.waypoint_number.map(u64::from),
        Message::UaLoiterWaypoint(loiter) => loiter.waypoint_number.map(u64::from),
        Message::CurveSegment(curve) => pair(curve.p1_waypoint_no, curve.p4_waypoint_no),
        Message::CurveSegmentPaper(curve) => pair(curve.p1_waypoint_no, curve.p4_waypoint_no),
        Message::AreaVertex(vertex) => pair(vertex.area_id, vertex.vertex_number.map(u16::from)),
        Message::ParameterSetCommand(command) => {
            command.parameter_name.map(|name| named(name.as_str()))
        }
        _ => None,
    }
}

/// A datagram is not longer on its way, ms, repetitions included.
const LONGEST_WAY_MS: u64 = 10_000;

/// Sticks, subsystem status requests, heartbeat, acknowledgement, schedule and request of reports, configuration
/// request; parameter request and ping of ours.
const NO_COMMANDS: [u16; 10] = [
    2010, 15000, 15001, 16002, 17000, 17001, 17002, 40000, 50010, 50014,
];
/// Messages remembered a CUCS, of each of the two kinds: an upload of 500 waypoints, sent twice, is told apart.
pub(super) const DEPTH: usize = 1024;
