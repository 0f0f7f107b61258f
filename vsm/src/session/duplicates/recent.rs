//! The latest messages of one CUCS, those that command apart from questions and streams: what each was answered, and
//! what it orders about.
//!
//! An order can be overtaken: its first datagram is lost, and what repeats it comes after a later order about the same
//! thing ([`about`]). Carried out then, it would undo the later one.

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

/// The latest messages of one CUCS and what each was answered.
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
    /// Whom it was for.
    pub(crate) destination: Id,
    pub(crate) ack_requested: bool,
    /// Select Flight Path Control Mode of a 2016, 0 of all others.
    pub(crate) mode: u8,
    /// What it was answered last.
    pub(crate) answer: Option<AckType>,
    /// A message 1 that asks, and neither requests nor releases: it may be asked once a second for hours, and must not
    /// use up the stamps of commands.
    pub(super) question: bool,
    /// It was authorised: its stamp is used.
    pub(super) accepted: bool,
    /// When it came, and what it is about; none of what was read back after a restart.
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
            _ => 0,
        };
        let question = match message {
            Message::CucsAuthorisationRequest(request) => {
                let levels = request.requested_handover_loi;
                let releases =
                    request.requested_handover_access == Some(RequestedAccess::Relinquish);
                // To everybody it releases only what it names.
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

    /// Whether a second carrying out would do something: all but questions, heartbeats and the stream of sticks, of
    /// which the next one takes the place of the last.
    pub(crate) fn commands(&self) -> bool {
        !self.question && is_command(self.message_type)
    }

    /// Whether its stamp must not command again. Anybody listed may request rights: only what was granted counts.
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
                && about.is_undone_by(known)
                && seen.destination == new.destination
                && seen.accepted
                // A refused order had no effect that an earlier one could undo.
                && seen.answer != Some(AckType::Refused)
                && (1..LONGEST_WAY_MS).contains(&stamps_apart_ms(seen.stamp, new.stamp))
                && now.saturating_sub(at).as_millis() < LONGEST_WAY_MS as u128
        })
    }

    /// Remembers a message; those that are forgotten for it.
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
                // Its retransmissions, and those of what was sent just before it, may still be on their way.
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
        // Streams are no commands; of message 1 there are questions, too.
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

/// What a message orders about: of two orders about the same thing, which the message type names beside this, the later
/// one counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum About {
    /// This one of the things that messages of the type order about.
    Thing(u64),
    /// The mode, and with it whatever is flown (2016, #42).
    Mode,
    /// Values within the mode that the vehicle has (2016 that names none, #43).
    Values,
    /// A setting that is kept, such as the altimeter's (2016 that commands nothing else).
    Setting,
    /// Which values rule (#48).
    Preference,
}

impl About {
    /// Whether a later order leaves nothing of this one to do. What names no mode ends none: a station repeats its values all
    /// the time, and a hold or a landing that was lost on its way must still be taken when it is repeated.
    fn is_undone_by(self, later: About) -> bool {
        self == later || (self, later) == (About::Values, About::Mode)
    }
}

/// Whether a 2016 commands an altitude, speed, heading, place or waypoint.
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

/// What a message orders about; none of those whose order means nothing.
fn about(message: &Message, made_of: Option<u16>) -> Option<About> {
    if let Message::VehicleOperatingModeCommand(command) = message {
        let mode = command.select_flight_path_control_mode;
        return Some(match made_of {
            // It names the mode that a #42 before it has commanded, or commands nothing now and is kept.
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

/// A datagram is not longer on its way, ms, repetitions included.
const LONGEST_WAY_MS: i64 = 10_000;

/// Sticks, subsystem status requests, heartbeat, acknowledgement, schedule and request of reports, configuration
/// request; parameter request and ping of ours.
const NO_COMMANDS: [u16; 10] = [
    2010, 15000, 15001, 16002, 17000, 17001, 17002, 40000, 50010, 50014,
];
/// Requests for rights, and positive handovers.
const REQUESTS: [u16; 3] = [1, 4, 34_000];
/// Messages remembered a CUCS, of each of the two kinds: an upload of 500 waypoints, sent twice, is recognised.
const DEPTH: usize = 1024;
/// Commands remembered while they are young.
pub(super) const MAX_COMMANDS: usize = 4 * DEPTH;
