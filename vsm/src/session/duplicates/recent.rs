//! The latest messages of one CUCS, with the answer and the subject of each; commands are kept apart from queries and
//! streams.
//!
//! A command can be overtaken: its first datagram is lost, and its retransmission arrives after a later command about the
//! same subject ([`about`]). If it were carried out then, it would undo the later one.

use std::collections::VecDeque;
use std::time::Duration;

use sha2::{Digest as _, Sha256};
use stanag_msgs::enums::{
    AckType, AltitudeCommandType, AreaPlanMode, FlightPathControlMode, HeadingCommandType,
    MissionPlanMode, RequestedAccess,
};
use stanag_msgs::messages::VehicleOperatingModeCommand;
use stanag_msgs::wrapper::Frame;
use stanag_msgs::{Id, Message, TimeStamp};

use super::stamps::{MAX_LATE, stamps_apart_ms};
use crate::session::context::Origin;

/// The latest messages of one CUCS and their answers.
#[derive(Debug, Default)]
pub(super) struct Recent {
    pub(super) commands: VecDeque<Seen>,
    pub(super) others: VecDeque<Seen>,
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
    /// Its destination.
    pub(crate) destination: Id,
    pub(crate) ack_requested: bool,
    /// Select Flight Path Control Mode of a 2016, Mission Plan Mode of a 13000, Area Plan Mode of a 50017; 0 for all others.
    pub(crate) mode: u8,
    /// Its latest answer.
    pub(crate) answer: Option<AckType>,
    /// A message 1 that only queries: it may be sent once a second for hours and must not use up the stamps of commands.
    pub(super) question: bool,
    /// It was authorised: its stamp is used.
    pub(super) accepted: bool,
    /// When it arrived, and its subject; `None` if it was read back after a restart.
    pub(crate) came: Option<(Duration, Option<About>)>,
}

impl Seen {
    /// `made_of`: the message of Edition 2.5 that became this one.
    pub(crate) fn new(
        frame: &Frame<'_>,
        message: &Message,
        made_of: Option<u16>,
        stamp: TimeStamp,
        ack_requested: bool,
        now: Duration,
    ) -> Seen {
        let mode = match message {
            Message::VehicleOperatingModeCommand(command) => command
                .select_flight_path_control_mode
                .map_or(0, |mode| mode.raw()),
            Message::MissionTransferCommand(command) => {
                command.mission_plan_mode.map_or(0, MissionPlanMode::raw)
            }
            Message::AreaTransferCommand(command) => {
                command.area_plan_mode.map_or(0, AreaPlanMode::raw)
            }
            _ => 0,
        };
        let question = match message {
            Message::CucsAuthorisationRequest(request) => {
                let levels = request.requested_handover_loi;
                let releases =
                    request.requested_handover_access == Some(RequestedAccess::Relinquish);
                // Sent to all, it releases only the named rights.
                let to_all = frame.header.destination == Id::BROADCAST;
                levels.is_none_or(|levels| levels.is_empty()) && (to_all || !releases)
            }
            _ => false,
        };
        Seen {
            digest: Digest::of(frame.bytes),
            stamp,
            message_type: frame.header.message_type,
            destination: frame.header.destination,
            ack_requested,
            mode,
            answer: None,
            question,
            accepted: false,
            came: Some((now, about(message, made_of))),
        }
    }

    /// As the origin of an answer, after a restart.
    pub(crate) fn origin(&self, station: usize) -> Origin {
        Origin {
            station,
            message_type: self.message_type,
            stamp: Some(self.stamp),
            ack_requested: self.ack_requested,
            held: None,
            continues: None,
        }
    }

    /// Whether carrying it out twice would matter: all messages but queries, heartbeats and sticks, each of which replaces
    /// the last.
    pub(crate) fn commands(&self) -> bool {
        !self.question && is_command(self.message_type)
    }

    /// Whether its stamp must not command again. Any listed CUCS may request rights, so only granted requests count.
    pub(super) fn has_used_its_stamp(&self) -> bool {
        let granted = self.answer == Some(AckType::CarriedOut);
        self.accepted && (granted || !REQUESTS.contains(&self.message_type))
    }
}

/// Whether a message of this type may be one that [`Seen::commands`].
pub(crate) fn is_command(message_type: u16) -> bool {
    !NO_COMMANDS.contains(&message_type)
}

impl Recent {
    /// The earlier answer to this message: `Some(None)` if it was received but not answered yet.
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

    /// Whether a later command about the same subject was accepted shortly before this one arrived. If the stamp is further
    /// back, the message was not delayed for so long: its sender's clock was set.
    pub(crate) fn is_overtaken(&self, new: &Seen) -> bool {
        let Some((now, Some(about))) = new.came else {
            return false;
        };
        self.commands.iter().rev().any(|seen| {
            let Some((at, Some(known))) = seen.came else {
                return false;
            };
            seen.message_type == new.message_type
                && about.is_undone_by(known)
                && seen.destination == new.destination
                && seen.accepted
                // A refused command had no effect that an earlier one could undo.
                && seen.answer != Some(AckType::Refused)
                && (1..LONGEST_WAY_MS).contains(&stamps_apart_ms(seen.stamp, new.stamp))
                && now.saturating_sub(at).as_millis() < LONGEST_WAY_MS as u128
        })
    }

    /// Remembers a message; returns the messages that are forgotten for it.
    pub(super) fn remember(&mut self, new: Seen) -> [Option<Seen>; 2] {
        let now = new.came.map(|(now, _)| now).unwrap_or_default();
        let ring = if new.commands() {
            &mut self.commands
        } else {
            &mut self.others
        };
        let mut forgotten = [None; 2];
        // Two, so that a memory that has grown shrinks again.
        for one in &mut forgotten {
            let young = |seen: &&Seen| {
                let came = seen.came.map(|(at, _)| now.saturating_sub(at));
                // Its retransmissions, and those of messages sent just before it, may still arrive.
                seen.commands() && came.is_some_and(|age| age < MAX_LATE)
            };
            let full = ring.len() >= MAX_COMMANDS;
            if ring.len() >= DEPTH && (full || ring.front().filter(young).is_none()) {
                *one = ring.pop_front();
            }
        }
        ring.push_back(new);
        forgotten
    }

    /// The latest command of this type and stamp.
    fn latest_command(&mut self, message_type: u16, stamp: TimeStamp) -> Option<&mut Seen> {
        // Streams are not commands, and a message 1 may be a query.
        let mut commands = (self.commands.iter_mut().rev()).filter(|_| is_command(message_type));
        commands.find(|seen| seen.message_type == message_type && seen.stamp == stamp)
    }

    /// Notes the answer to the latest message of this type and stamp.
    pub(super) fn answered(
        &mut self,
        message_type: u16,
        stamp: TimeStamp,
        answer: AckType,
    ) -> Option<Seen> {
        let is_it = |seen: &&mut Seen| seen.message_type == message_type && seen.stamp == stamp;
        let seen = match self.latest_command(message_type, stamp) {
            Some(seen) => seen,
            None => self.others.iter_mut().rev().find(is_it)?,
        };
        seen.answer = Some(answer);
        Some(*seen)
    }
}

pub(super) fn is_final(answer: Option<AckType>) -> bool {
    answer.is_some_and(|answer| answer != AckType::Received)
}

/// The subject of a command: of two commands with the same message type and subject, the later one applies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum About {
    /// One of the subjects of this message type.
    Thing(u64),
    /// The mode, and so everything that is flown (2016, #42).
    Mode,
    /// Values within the present mode (a 2016 without a mode, #43).
    Values,
    /// A stored setting, such as the altimeter setting (a 2016 that commands nothing else).
    Setting,
    /// The mode preference (#48).
    Preference,
}

impl About {
    /// Whether a later command replaces this one completely. A command without a mode does not replace one with a mode: a
    /// station repeats its values all the time, and a retransmitted hold or landing whose first datagram was lost must still
    /// be accepted.
    fn is_undone_by(self, later: About) -> bool {
        self == later || (self, later) == (About::Values, About::Mode)
    }
}

/// Whether a 2016 commands an altitude, speed, heading, position or waypoint.
pub(crate) fn commands_values(command: &VehicleOperatingModeCommand) -> bool {
    let angles = [
        command.loiter_position_latitude,
        command.loiter_position_longitude,
    ];
    let altitude = command.altitude_command_type != Some(AltitudeCommandType::None)
        && command.commanded_altitude.is_some();
    let moves = |rate: f64| rate != 0.0;
    altitude
        || (command.commanded_vertical_speed).is_some_and(|rate| moves(rate.si()))
        || (command.commanded_speed).is_some_and(|speed| moves(speed.si()))
        || (command.heading_command_type).is_some_and(|kind| kind != HeadingCommandType::None)
        || (command.commanded_waypoint_number).is_some_and(|number| number != 0)
        || (angles.iter().flatten()).any(|angle| moves(angle.degrees()))
}

/// The subject of a message; `None` if the order of such messages does not matter.
fn about(message: &Message, made_of: Option<u16>) -> Option<About> {
    if let Message::VehicleOperatingModeCommand(command) = message {
        let mode = command.select_flight_path_control_mode;
        return Some(match made_of {
            // It names the mode that an earlier #42 has commanded, or commands nothing now and is stored.
            Some(43) => About::Values,
            Some(48) => About::Preference,
            _ if mode.is_some_and(|mode| mode != FlightPathControlMode::NoMode) => About::Mode,
            _ if commands_values(command) => About::Values,
            _ => About::Setting,
        });
    }
    thing(message).map(About::Thing)
}

fn thing(message: &Message) -> Option<u64> {
    let named = |name: &str| {
        let bytes = name.bytes();
        bytes.fold(0_u64, |sum, byte| {
            sum.wrapping_mul(31).wrapping_add(byte.into())
        })
    };
    let pair = |high: Option<u16>, low: Option<u16>| Some(u64::from(high?) << 16 | u64::from(low?));
    match message {
        Message::LoiterConfiguration(_) | Message::EngineCommand(_) => Some(0),
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
        Message::PayloadActionWaypoint(action) => action.waypoint_number.map(u64::from),
        Message::VehicleSpecificWaypoint(specific) => specific.waypoint_number.map(u64::from),
        Message::CurveSegment(curve) => pair(curve.p1_waypoint_no, curve.p4_waypoint_no),
        Message::CurveSegmentPaper(curve) => pair(curve.p1_waypoint_no, curve.p4_waypoint_no),
        Message::AreaVertex(vertex) => pair(vertex.area_id, vertex.vertex_number.map(u16::from)),
        Message::ParameterSetCommand(command) => {
            command.parameter_name.map(|name| named(name.as_str()))
        }
        Message::Contingency(set) => set.contingency_cause.map(|cause| cause.raw().into()),
        _ => None,
    }
}

/// Maximum delay of a datagram, ms, including retransmissions.
const LONGEST_WAY_MS: i64 = 10_000;

/// Sticks, subsystem status requests, heartbeat, acknowledgement, schedule and request of reports, configuration
/// request; parameter request and ping of ours.
const NO_COMMANDS: [u16; 10] = [
    2010, 15000, 15001, 16002, 17000, 17001, 17002, 40000, 50010, 50014,
];
/// Requests for rights, and positive handovers.
const REQUESTS: [u16; 3] = [1, 4, 34_000];
/// Messages remembered per CUCS, for each of the two kinds: an upload of 500 waypoints that is sent twice is recognised.
const DEPTH: usize = 1024;
/// Maximum number of commands remembered while they are recent.
pub(super) const MAX_COMMANDS: usize = 4 * DEPTH;
