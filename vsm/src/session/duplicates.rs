//! Duplicates: the same source, destination, type, stamp and bytes; acknowledged again, not carried out again.
//!
//! Each message is known by the digest of its bytes. Those that command are remembered apart from questions and
//! streams, so that neither sticks nor heartbeats push them out, and are logged on disk: they are known after a restart
//! too, and one that the restart cut off is answered.
//!
//! The log has a line before a command is carried out, and another when its answer is final: digest, message type,
//! stamp, destination, 1 where an acknowledgement was requested, mode, and the answer, `-` before it is known. A later
//! line of the same digest takes the place of the earlier. It survives the end of the process, `kill -9` too; after a
//! power cut the last lines may be missing. Where no line can be written the command is carried out all the same, and an
//! alert says so: a vehicle in the air must be commanded with a full disk too.
//!
//! An order can also be overtaken: its first datagram is lost, and what repeats it comes after a later order about the
//! same thing ([`about`]). Carried out then, it would undo the later one.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::time::Duration;

use mavlink_link::store::{Disk, Durability, StoreError};
use sha2::{Digest as _, Sha256};
use stanag_msgs::enums::{AckType, AreaPlanMode, MissionPlanMode};
use stanag_msgs::wrapper::Frame;
use stanag_msgs::{Id, Message, TimeStamp};

use super::context::Origin;

/// What one CUCS has sent lately, in memory and in its log.
#[derive(Debug, Default)]
pub(crate) struct Remembered {
    recent: Recent,
    /// Lines of the log since it was last written whole.
    lines: usize,
}

impl Remembered {
    /// The answer given to this very message before: `Some(None)` where it was received and not answered yet.
    pub(crate) fn find(&self, new: &Seen) -> Option<Option<AckType>> {
        self.recent.find(new)
    }

    /// Whether a later order about the same thing was taken shortly before this one came.
    pub(crate) fn is_overtaken(&self, new: &Seen) -> bool {
        self.recent.is_overtaken(new)
    }

    /// Remembers a message of `station`, before it is carried out.
    ///
    /// # Errors
    /// It is remembered, but its line cannot be written.
    pub(crate) fn remember(
        &mut self,
        station: Id,
        new: Seen,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        self.recent.remember(new);
        self.log(station, &new, disk)
    }

    /// Remembers the answer to the latest message of this type and stamp.
    pub(crate) fn answered(
        &mut self,
        station: Id,
        message_type: u16,
        stamp: TimeStamp,
        answer: AckType,
        disk: &mut dyn Disk,
    ) {
        if let Some(seen) = self.recent.answered(message_type, stamp, answer)
            // "Received" is not logged: after a restart it would mean the same as no answer.
            && is_final(seen.answer)
        {
            // That nothing can be written was raised as an alert when the command came.
            let _ = self.log(station, &seen, disk);
        }
    }

    /// Reads back what a station has commanded before a restart; the commands that were not answered to their end.
    ///
    /// # Errors
    /// The log exists and cannot be read.
    pub(crate) fn restore(
        &mut self,
        station: Id,
        disk: &dyn Disk,
    ) -> Result<Vec<Seen>, StoreError> {
        let Some(bytes) = disk.read(&log_file(station), u64::MAX)? else {
            return Ok(Vec::new());
        };
        self.recent = Recent {
            commands: parse_log(&bytes),
            others: VecDeque::new(),
        };
        let commands = self.recent.commands.iter();
        let open = commands.filter(|seen| !is_final(seen.answer));
        Ok(open.copied().collect())
    }

    /// Forgets a command: it is carried out when it comes again.
    pub(crate) fn forget(&mut self, digest: Digest) {
        self.recent.commands.retain(|seen| seen.digest != digest);
    }

    /// Writes the whole log again, without lines that later ones have replaced.
    ///
    /// # Errors
    /// It stays as it was.
    pub(crate) fn compact(&mut self, station: Id, disk: &mut dyn Disk) -> Result<(), StoreError> {
        let whole: String = self.recent.commands.iter().map(line).collect();
        self.lines = self.recent.commands.len();
        disk.replace(&log_file(station), whole.as_bytes(), Durability::Process)
    }

    fn log(&mut self, station: Id, seen: &Seen, disk: &mut dyn Disk) -> Result<(), StoreError> {
        if !seen.commands() {
            return Ok(());
        }
        self.lines += 1;
        if self.lines > MAX_LINES {
            return self.compact(station, disk);
        }
        let line = line(seen);
        disk.append(&log_file(station), line.as_bytes(), Durability::Process)
    }
}

/// The latest messages of one CUCS and what each was answered.
#[derive(Debug, Default)]
struct Recent {
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

    /// As the origin of an answer, after a restart.
    pub(crate) fn origin(&self, station: usize) -> Origin {
        Origin {
            station,
            message_type: self.message_type,
            stamp: Some(self.stamp),
            ack_requested: self.ack_requested,
        }
    }

    /// Whether a second carrying out would do something: all but questions, heartbeats and the stream of sticks, of
    /// which the next one takes the place of the last.
    pub(crate) fn commands(&self) -> bool {
        !NO_COMMANDS.contains(&self.message_type)
    }
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
                && known == about
                && seen.destination == new.destination
                // A refused order had no effect that an earlier one could undo.
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

    fn ring(&mut self, message_type: u16) -> &mut VecDeque<Seen> {
        if NO_COMMANDS.contains(&message_type) {
            &mut self.others
        } else {
            &mut self.commands
        }
    }
}

fn is_final(answer: Option<AckType>) -> bool {
    answer.is_some_and(|answer| answer != AckType::Received)
}

fn line(seen: &Seen) -> String {
    let mut line = String::with_capacity(80);
    for byte in seen.digest.0 {
        let _ = write!(line, "{byte:02x}");
    }
    let Seen {
        stamp,
        message_type,
        destination,
        ack_requested,
        mode,
        answer,
        ..
    } = *seen;
    let (stamp, destination, ack) = (stamp.0, destination.0, u8::from(ack_requested));
    let _ = write!(
        line,
        " {message_type} {stamp} {destination:08x} {ack} {mode} "
    );
    let _ = match answer {
        Some(answer) => writeln!(line, "{}", answer.raw()),
        None => writeln!(line, "-"),
    };
    line
}

/// The latest commands of a log. A line that cannot be read, as the last may be after a crash, is skipped.
fn parse_log(bytes: &[u8]) -> VecDeque<Seen> {
    let mut known: VecDeque<Seen> = VecDeque::new();
    for line in String::from_utf8_lossy(bytes).lines() {
        let Some(seen) = parse_line(line) else {
            continue;
        };
        match known.iter_mut().rev().find(|one| one.digest == seen.digest) {
            Some(earlier) => *earlier = seen,
            None => known.push_back(seen),
        }
        if known.len() > DEPTH {
            known.pop_front();
        }
    }
    known
}

fn parse_line(line: &str) -> Option<Seen> {
    let mut words = line.split(' ');
    let digest: [u8; 16] = u128::from_str_radix(words.next().filter(|hex| hex.len() == 32)?, 16)
        .ok()?
        .to_be_bytes();
    let seen = Seen {
        digest: Digest(digest),
        message_type: words.next()?.parse().ok()?,
        stamp: TimeStamp(words.next()?.parse().ok()?),
        destination: Id(u32::from_str_radix(words.next()?, 16).ok()?),
        ack_requested: words.next()? == "1",
        mode: words.next()?.parse().ok()?,
        answer: match words.next()? {
            "-" => None,
            number => Some(AckType::from_raw(number.parse().ok()?)),
        },
        came: None,
    };
    words.next().is_none().then_some(seen)
}

fn log_file(station: Id) -> String {
    format!("commands-{:08x}.log", station.0)
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
const DEPTH: usize = 1024;
/// A log of so many lines is compacted.
const MAX_LINES: usize = 4 * DEPTH;

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(number: u8, answer: Option<AckType>) -> Seen {
        Seen {
            digest: Digest([number; 16]),
            stamp: TimeStamp(7_000 + u64::from(number)),
            message_type: 2016,
            destination: Id(0x1b00_0101),
            ack_requested: number % 2 == 1,
            mode: 21,
            answer,
            came: None,
        }
    }

    #[test]
    fn a_log_reads_back_with_the_latest_answers_and_without_a_torn_line() {
        let (one, two) = (seen(1, None), seen(2, None));
        let answered = seen(1, Some(AckType::CarriedOut));
        let mut bytes = [one, two, answered].iter().map(line).collect::<String>();
        bytes.push_str(&line(&seen(3, None))[..50]);
        assert_eq!(parse_log(bytes.as_bytes()), [answered, two]);
    }

    #[test]
    fn no_more_is_kept_than_is_remembered() {
        let bytes: String = (0..DEPTH + 10)
            .map(|n| {
                let mut one = seen(1, None);
                one.digest.0[..8].copy_from_slice(&n.to_be_bytes());
                line(&one)
            })
            .collect();
        let known = parse_log(bytes.as_bytes());
        assert_eq!(known.len(), DEPTH);
        assert_eq!(known[0].digest.0[..8], 10_usize.to_be_bytes());
    }
}
