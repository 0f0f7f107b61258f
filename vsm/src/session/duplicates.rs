//! Duplicates: the same source, destination, type, stamp and bytes; acknowledged again, not carried out again.
//!
//! Each message is known by the digest of its bytes. Those that command are remembered apart from questions and
//! streams, so that neither sticks nor heartbeats push them out, and are logged on disk: they are known after a restart
//! too, and one that the restart cut off is answered.
//!
//! What was authorised and the memory has no room for any more leaves its stamp behind ([`UsedStamps`]): no command is
//! carried out twice, however many others came between. What was not authorised leaves nothing. What moves the aircraft, changes what it will fly or says who may (`commands` of
//! the caller) needs a stamp, and comes in time by its station's own clock ([`StationClock`]). Sticks are too many to
//! be logged one by one: of them each must be newer than the last ([`StickStamps`]), and the log has a bound on their
//! stamps that is ahead of them.
//!
//! The log has a line before a command is carried out, and another when its answer is final: digest, message type,
//! stamp, destination, 1 where an acknowledgement was requested, mode, and the answer, `-` before it is known;
//! `unauthorised` behind that where it was refused for want of a right, or as late. A later line of the same digest takes the place of the earlier. `used` and `sticks` lines have the first and the last of
//! stamps that were used; they are written with the rest, in one step, when the log is written whole. It survives the
//! end of the process, `kill -9` too; after a power cut the last lines may be missing. Where no line can be written the
//! command is carried out all the same, and an alert says so: a vehicle in the air must be commanded with a full disk
//! too.
//!
//! An order can also be overtaken: its first datagram is lost, and what repeats it comes after a later order about the
//! same thing ([`about`]). Carried out then, it would undo the later one.

use std::collections::{HashMap, VecDeque};
use std::fmt::Write as _;
use std::time::Duration;

use mavlink_link::store::{Disk, Durability, StoreError};
use sha2::{Digest as _, Sha256};
use stanag_msgs::enums::{AckType, AreaPlanMode, MissionPlanMode, RequestedAccess};
use stanag_msgs::wrapper::Frame;
use stanag_msgs::{Id, Message, TimeStamp};

use super::context::Origin;
use super::stamps::{Late, MAX_AHEAD, MAX_LATE, SETTLE, StationClock, UsedStamps, stamps_apart_ms};
use super::stick_stamps::{Stick, StickStamps};

/// What one CUCS has sent lately, in memory and in its log.
#[derive(Debug, Default)]
pub(crate) struct Remembered {
    recent: Recent,
    /// Stamps of commands that `recent` had no room for.
    used: UsedStamps,
    /// Stamps of sticks, as the log has them.
    sticks: UsedStamps,
    stick_stamps: StickStamps,
    /// The log has this as the last of the sticks.
    sticks_logged: u64,
    clock: StationClock,
    /// Lines of the log since it was last written whole.
    lines: usize,
    /// The name of the log, and a line of it that is being written: kept, so that a line of sticks allocates nothing.
    log_name: String,
    line: String,
}

/// What becomes of a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// It is carried out.
    New,
    /// It was received before; the answer, where it has one.
    Again(Option<AckType>),
    /// It is refused: the name of the counter, and the reason.
    Refused(&'static str, String),
}

impl Remembered {
    /// Judges a message, and remembers it. `timed`: it must be in time.
    ///
    /// That it was received uses up nothing: what is not authorised must not, else a CUCS without a right, or who sends in
    /// its name, would lock it out of moments to come. What is authorised is [accepted](Remembered::accept) before it is
    /// carried out.
    pub(crate) fn judge(&mut self, new: &Seen, timed: bool, now: Duration) -> Verdict {
        if let Some(answer) = self.recent.find(new) {
            return Verdict::Again(answer);
        }
        let sticks = new.message_type == STICKS;
        if new.commands() && self.used.contains(new.stamp) {
            // It is not remembered: replays must not push out what is.
            return Verdict::Refused("used time stamp", USED.into());
        }
        if sticks {
            let why = match self.stick_stamps.judge(new.stamp, new.digest.0, now) {
                Stick::New => None,
                Stick::Repeated => Some(REPEATED),
                Stick::Flown => Some(FLOWN),
                Stick::Older => {
                    self.clock.note(new.stamp, now);
                    Some(OLDER)
                }
            };
            if let Some(why) = why {
                return Verdict::Refused("used time stamp", why.into());
            }
        }
        // Noted first: it may be the message that shows for long enough that the clock was set.
        self.clock.note(new.stamp, now);
        // One that is ahead stays used until the clock has passed it, however many there are.
        if timed
            && self.clock.is_ahead(new.stamp, now)
            && let Some(reading) = self.clock.reading(now)
            && self.ahead(sticks, reading) >= MAX_AHEAD
        {
            return Verdict::Refused("too far ahead", TOO_MANY_AHEAD.into());
        }
        // An overtaken order is remembered too, so that its repetitions are refused as duplicates; a late one likewise.
        let overtaken = self.recent.is_overtaken(new);
        let reading = self.clock.reading(now);
        for seen in self.recent.remember(*new).into_iter().flatten() {
            if seen.has_used_its_stamp() {
                self.used.insert(seen.stamp);
                self.used.bound(reading.unwrap_or(seen.stamp));
            }
        }
        match self.clock.late(new.stamp, now).filter(|_| timed) {
            Some(late) => {
                if sticks {
                    self.stick_stamps.refused(now);
                }
                Verdict::Refused("late", late_text(late))
            }
            None if overtaken => Verdict::Refused("overtaken", OVERTAKEN.into()),
            None => Verdict::New,
        }
    }

    /// How much was used of what is later than the station's clock shows.
    fn ahead(&self, sticks: bool, reading: TimeStamp) -> usize {
        if sticks {
            self.stick_stamps.ahead(reading)
        } else {
            self.used.ahead(reading)
        }
    }

    /// Whether all sticks of the station have been refused for so long that it must know.
    pub(crate) fn refuses_sticks(&self, now: Duration) -> bool {
        self.stick_stamps.are_refused(now)
    }

    /// The message that was judged last is to be carried out: it is on disk before that. `authorised`: its stamp is used
    /// from here on. `None` where it is not logged; else whether that could be written. It counts all the same.
    pub(crate) fn accept(
        &mut self,
        station: Id,
        message_type: u16,
        stamp: TimeStamp,
        authorised: bool,
        now: Duration,
        disk: &mut dyn Disk,
    ) -> Option<Result<(), StoreError>> {
        if message_type == STICKS {
            let latest = self.recent.others.back()?;
            let digest = (latest.message_type == STICKS && latest.stamp == stamp)
                .then_some(latest.digest)?;
            let reading = self.clock.reading(now).unwrap_or(stamp);
            self.stick_stamps.take(stamp, digest.0, reading);
            return Some(self.log_sticks(station, stamp, reading, disk));
        }
        let latest = self.recent.commands.back_mut()?;
        if latest.accepted || (latest.message_type, latest.stamp) != (message_type, stamp) {
            return None;
        }
        latest.accepted = authorised;
        let seen = *latest;
        Some(self.log(station, &seen, disk))
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
        now: Duration,
        disk: &dyn Disk,
    ) -> Result<Vec<Seen>, StoreError> {
        let Some(bytes) = disk.read(&log_file(station), u64::MAX)? else {
            return Ok(Vec::new());
        };
        self.read_log(&bytes);
        let commands = &self.recent.commands;
        // Of what was not authorised nothing is learnt.
        if let Some(latest) = commands.iter().rev().find(|seen| seen.has_used_its_stamp()) {
            self.clock.restore(latest.stamp, now);
            self.used.bound(latest.stamp);
            self.sticks.bound(latest.stamp);
        }
        self.stick_stamps.restore(self.sticks.clone());
        let open = commands.iter().filter(|seen| !is_final(seen.answer));
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
        let mut whole = String::new();
        for (name, used) in [(USED_LINE, &self.used), (STICKS_LINE, &self.sticks)] {
            for (first, last) in used.spans() {
                write_span(&mut whole, name, first, last);
            }
        }
        if let Some(last) = self.sticks_logged.checked_sub(STICKS_AHEAD_MS) {
            // Ahead of the sticks that were received, as its line in the log is.
            write_span(&mut whole, STICKS_LINE, last, self.sticks_logged);
        }
        for seen in &self.recent.commands {
            write_line(&mut whole, seen);
        }
        self.lines = whole.lines().count();
        disk.replace(&log_file(station), whole.as_bytes(), Durability::Process)
    }

    fn log(&mut self, station: Id, seen: &Seen, disk: &mut dyn Disk) -> Result<(), StoreError> {
        if !seen.commands() {
            return Ok(());
        }
        self.line.clear();
        write_line(&mut self.line, seen);
        self.append(station, disk)
    }

    /// Notes the stamp of a stick. They come 50 times a second: the log has a stamp up to which they count as used after a
    /// restart, and gets the next one when they reach it.
    fn log_sticks(
        &mut self,
        station: Id,
        stamp: TimeStamp,
        reading: TimeStamp,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        self.sticks.insert(stamp);
        self.sticks.bound(reading);
        let logged = self.sticks_logged.checked_sub(stamp.0);
        if logged.is_some_and(|ahead_ms| ahead_ms <= STICKS_AHEAD_MS) {
            return Ok(());
        }
        self.sticks_logged = stamp.0 + STICKS_AHEAD_MS;
        self.line.clear();
        write_span(&mut self.line, STICKS_LINE, stamp.0, self.sticks_logged);
        self.append(station, disk)
    }

    /// Appends `self.line`.
    fn append(&mut self, station: Id, disk: &mut dyn Disk) -> Result<(), StoreError> {
        self.lines += 1;
        if self.lines > MAX_LINES {
            return self.compact(station, disk);
        }
        if self.log_name.is_empty() {
            self.log_name = log_file(station);
        }
        disk.append(&self.log_name, self.line.as_bytes(), Durability::Process)
    }

    /// The latest commands of a log, and the stamps of those before. A line that cannot be read, as the last may be after
    /// a crash, is skipped.
    fn read_log(&mut self, bytes: &[u8]) {
        let known = &mut self.recent.commands;
        known.clear();
        // Where a digest is, counted from the first that was ever read.
        let mut places: HashMap<[u8; 16], usize> = HashMap::new();
        let mut forgotten = 0;
        for line in String::from_utf8_lossy(bytes).lines() {
            if let Some((name, first, last)) = parse_span(line) {
                let used = if name == STICKS_LINE {
                    &mut self.sticks
                } else {
                    &mut self.used
                };
                used.insert_span(first, last);
                continue;
            }
            let Some(seen) = parse_line(line) else {
                continue;
            };
            let place = places.entry(seen.digest.0).or_insert(usize::MAX);
            match place
                .checked_sub(forgotten)
                .and_then(|at| known.get_mut(at))
            {
                Some(earlier) => *earlier = seen,
                None => {
                    *place = forgotten + known.len();
                    known.push_back(seen);
                }
            }
            // As many as there can be: some may still be on their way, as `remember` has it.
            if known.len() > MAX_COMMANDS
                && let Some(oldest) = known.pop_front()
            {
                if oldest.has_used_its_stamp() {
                    self.used.insert(oldest.stamp);
                }
                forgotten += 1;
            }
        }
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
    /// A message 1 that asks, and neither requests nor releases: it may be asked once a second for hours, and must not
    /// use up the stamps of commands.
    question: bool,
    /// It was authorised: its stamp is used.
    accepted: bool,
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
        !self.question && is_command(self.message_type)
    }

    /// Whether its stamp must not command again. Anybody listed may request rights: only what was granted counts.
    fn has_used_its_stamp(&self) -> bool {
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
                && known == about
                && seen.destination == new.destination
                && seen.accepted
                // A refused order had no effect that an earlier one could undo.
                && seen.answer != Some(AckType::Refused)
                && (1..LONGEST_WAY_MS).contains(&stamps_apart_ms(seen.stamp, new.stamp))
                && now.saturating_sub(at).as_millis() < LONGEST_WAY_MS as u128
        })
    }

    /// Remembers a message; those that are forgotten for it.
    fn remember(&mut self, new: Seen) -> [Option<Seen>; 2] {
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
    fn answered(&mut self, message_type: u16, stamp: TimeStamp, answer: AckType) -> Option<Seen> {
        let is_it = |seen: &&mut Seen| seen.message_type == message_type && seen.stamp == stamp;
        let seen = match self.latest_command(message_type, stamp) {
            Some(seen) => seen,
            None => self.others.iter_mut().rev().find(is_it)?,
        };
        seen.answer = Some(answer);
        Some(*seen)
    }
}

fn is_final(answer: Option<AckType>) -> bool {
    answer.is_some_and(|answer| answer != AckType::Received)
}

fn write_line(out: &mut String, seen: &Seen) {
    for byte in seen.digest.0 {
        let _ = write!(out, "{byte:02x}");
    }
    let Seen {
        stamp,
        message_type,
        destination,
        ack_requested,
        mode,
        answer,
        accepted,
        ..
    } = *seen;
    let (stamp, destination, ack) = (stamp.0, destination.0, u8::from(ack_requested));
    let _ = write!(
        out,
        " {message_type} {stamp} {destination:08x} {ack} {mode} "
    );
    let _ = match answer {
        Some(answer) => write!(out, "{}", answer.raw()),
        None => write!(out, "-"),
    };
    let _ = writeln!(out, "{}", if accepted { "" } else { UNAUTHORISED });
}

fn write_span(out: &mut String, name: &str, first: u64, last: u64) {
    let _ = writeln!(out, "{name} {first} {last}");
}

fn parse_span(line: &str) -> Option<(&str, u64, u64)> {
    let mut words = line.split(' ');
    let name = words
        .next()
        .filter(|name| [USED_LINE, STICKS_LINE].contains(name))?;
    let (first, last) = (words.next()?.parse().ok()?, words.next()?.parse().ok()?);
    (first <= last && words.next().is_none()).then_some((name, first, last))
}

fn parse_line(line: &str) -> Option<Seen> {
    let (line, accepted) = match line.strip_suffix(UNAUTHORISED) {
        Some(line) => (line, false),
        None => (line, true),
    };
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
        question: false,
        accepted,
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
const LONGEST_WAY_MS: i64 = 10_000;

/// Sticks, subsystem status requests, heartbeat, acknowledgement, schedule and request of reports, configuration
/// request; parameter request and ping of ours.
const NO_COMMANDS: [u16; 10] = [
    2010, 15000, 15001, 16002, 17000, 17001, 17002, 40000, 50010, 50014,
];
/// Requests for rights, and positive handovers.
const REQUESTS: [u16; 3] = [1, 4, 34_000];
/// Messages remembered a CUCS, of each of the two kinds: an upload of 500 waypoints, sent twice, is told apart.
const DEPTH: usize = 1024;
/// Commands remembered while they are young.
const MAX_COMMANDS: usize = 4 * DEPTH;
/// A log of so many lines is compacted.
const MAX_LINES: usize = 3 * MAX_COMMANDS;
const STICKS: u16 = 2010;
/// How far the log is ahead of the sticks. After a restart of the VSM they count again that much later; PX4 has left manual
/// flight by then, and every other command counts at once.
const STICKS_AHEAD_MS: u64 = 10_000;
const USED_LINE: &str = "used";
const STICKS_LINE: &str = "sticks";
/// Ends a line of the log.
const UNAUTHORISED: &str = " unauthorised";
/// Its sender has ordered something else since.
const OVERTAKEN: &str = "overtaken by a later command, which applies instead";
const USED: &str = "its Time Stamp lies where this CUCS has commanded before: it is a repetition, or the clock of the CUCS was \
     set back";
const TOO_MANY_AHEAD: &str = "its Time Stamp is ahead of the clock of its CUCS, as those of many commands before it were: set the clock \
     of the CUCS, and send it again";

const REPEATED: &str = "it was received before: it is a repetition";
const FLOWN: &str = "its Time Stamp lies where this CUCS has sent sticks before, of which each is no longer known: the VSM has restarted \
     within 10 s, or the clock of the CUCS was set back; sticks count again once it has passed that time: set the clock \
     of the CUCS";
const OLDER: &str = "it is older, by its Time Stamp, than sticks that have come before: the clock of the CUCS was set back; sticks count \
     again after 5 s in which they come in order";

fn late_text(late: Late) -> String {
    let (expected_s, settle_s) = (MAX_LATE.as_secs(), SETTLE.as_secs());
    let behind = |by: Duration| {
        let by_s = by.as_secs();
        format!(
            "its Time Stamp is {by_s} s behind the clock of its CUCS, expected at most {expected_s} s"
        )
    };
    match late {
        Late::Behind(by) => format!(
            "{}; send it again (once its clock was set, it is followed within {settle_s} s)",
            behind(by)
        ),
        Late::Contested(by) => format!(
            "{}, as other messages of that CUCS show it: stamp all messages by one clock; send it again (once its clock \
             was set, it is followed within {settle_s} s)",
            behind(by)
        ),
        Late::Standing(newest, since) => format!(
            "the Time Stamps of its CUCS do not rise: none was newer than {} ms for {} s, so that nobody can know how old a \
             command is; let the CUCS count them on with its clock, and it is followed within {settle_s} s",
            newest.0,
            since.as_secs()
        ),
    }
}

#[cfg(test)]
mod tests {
    use mavlink_link::store::MemoryDisk;

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
            question: false,
            accepted: true,
            came: None,
        }
    }

    const STATION: Id = Id(0x1b00_00a0);

    fn line(seen: &Seen) -> String {
        let mut line = String::new();
        write_line(&mut line, seen);
        line
    }

    fn read(bytes: &[u8]) -> Remembered {
        let mut remembered = Remembered::default();
        remembered.read_log(bytes);
        remembered
    }

    #[test]
    fn a_log_reads_back_with_the_latest_answers_and_without_a_torn_line() {
        let (one, two) = (seen(1, None), seen(2, None));
        let answered = seen(1, Some(AckType::CarriedOut));
        let mut bytes = [one, two, answered].iter().map(line).collect::<String>();
        bytes.push_str(&line(&seen(3, None))[..50]);
        let known = read(bytes.as_bytes());
        assert_eq!(known.recent.commands, [answered, two]);
        assert_eq!(known.used, UsedStamps::default());
    }

    #[test]
    fn of_what_is_no_longer_remembered_the_stamp_stays() {
        let bytes: String = (0..MAX_COMMANDS + 10)
            .map(|n| {
                let mut one = seen(1, None);
                one.digest.0[..8].copy_from_slice(&n.to_be_bytes());
                one.stamp = TimeStamp(1_000_000 * n as u64);
                line(&one)
            })
            .collect();
        let known = read(bytes.as_bytes());
        let commands = &known.recent.commands;
        assert_eq!(commands.len(), MAX_COMMANDS);
        assert_eq!(commands[0].digest.0[..8], 10_usize.to_be_bytes());
        let used = |n: u64| known.used.contains(TimeStamp(1_000_000 * n));
        assert!((0..10).all(used) && !(10..4_000).any(used));
    }

    /// A station over years of its clock, recorded by somebody: what it sends, when it arrives, what is lost, replayed and
    /// repeated, its clock and the restarts of the VSM are drawn at random.
    struct History {
        random: kit::Random,
        remembered: Remembered,
        disk: MemoryDisk,
        now: Duration,
        /// Of this run of the VSM.
        started: Duration,
        /// The station's clock beside `now`, ms.
        clock_ms: u64,
        last_stamp: u64,
        recorded: Vec<Seen>,
        /// How often each was carried out.
        carried_out: HashMap<[u8; 16], u32>,
    }

    impl History {
        fn new(seed: u64) -> History {
            History {
                random: kit::Random::with_seed(seed),
                remembered: Remembered::default(),
                disk: MemoryDisk::default(),
                now: Duration::ZERO,
                started: Duration::ZERO,
                clock_ms: 850_000_000_000,
                last_stamp: 0,
                recorded: Vec::new(),
                carried_out: HashMap::new(),
            }
        }

        fn stamp(&self) -> TimeStamp {
            let now = u64::try_from(self.now.as_millis()).unwrap();
            TimeStamp((self.clock_ms + now) % TimeStamp::PERIOD_MS)
        }

        fn make(&mut self, message_type: u16) -> Seen {
            let mut digest = [0; 16];
            digest[..8].copy_from_slice(&(self.recorded.len() as u64).to_be_bytes());
            let mut stamp = self.stamp();
            if stamp.0 == self.last_stamp {
                // Stamps rise strictly while the clock does not step.
                stamp.0 += 1;
            }
            self.last_stamp = stamp.0;
            let new = Seen {
                digest: Digest(digest),
                stamp,
                message_type,
                destination: Id(0x1b00_0101),
                ack_requested: true,
                mode: 0,
                answer: None,
                question: false,
                accepted: false,
                came: None,
            };
            self.recorded.push(new);
            new
        }

        fn arrives(&mut self, mut seen: Seen) -> Verdict {
            let now = self.now - self.started;
            seen.came = Some((now, None));
            let commands = seen.commands() || seen.message_type == STICKS;
            let verdict = self.remembered.judge(&seen, commands, now);
            if commands && verdict == Verdict::New {
                let (kind, stamp) = (seen.message_type, seen.stamp);
                let disk = &mut self.disk;
                self.remembered
                    .accept(STATION, kind, stamp, true, now, disk);
                let times = self.carried_out.entry(seen.digest.0).or_default();
                *times += 1;
                assert_eq!(*times, 1, "{seen:?} is carried out again");
                let answer = [AckType::Received, AckType::CarriedOut, AckType::Refused]
                    [self.random.usize(0..3)];
                self.remembered
                    .answered(STATION, kind, stamp, answer, &mut self.disk);
            }
            verdict
        }

        fn restart(&mut self) {
            self.started = self.now;
            self.remembered = Remembered::default();
            let open = self
                .remembered
                .restore(STATION, Duration::ZERO, &self.disk)
                .unwrap();
            // Answered as cut off, as the router does with what commands a vehicle.
            for seen in open {
                let (kind, stamp) = (seen.message_type, seen.stamp);
                self.remembered
                    .answered(STATION, kind, stamp, AckType::Refused, &mut self.disk);
            }
            self.remembered.compact(STATION, &mut self.disk).unwrap();
        }

        fn replay_some(&mut self) {
            for _ in 0..self.random.usize(0..30) {
                let index = self.random.usize(0..self.recorded.len().max(1));
                if let Some(seen) = self.recorded.get(index).copied() {
                    // What never arrived may arrive now, once.
                    self.arrives(seen);
                }
            }
        }
    }

    #[test]
    fn no_command_is_carried_out_twice_in_any_history() {
        for seed in 0..5 {
            let mut history = History::new(seed);
            for _ in 0..3_000 {
                let step = Duration::from_millis(history.random.u64(1..4_000));
                history.now += step;
                let draw = history.random.u16(0..1_000);
                match draw {
                    0..3 => history.restart(),
                    3..6 => {
                        // Years, hours or seconds, either way; or a clock that begins again.
                        let far = [1 << 38, 90_000_000, 5_000][history.random.usize(0..3)];
                        let by = history.random.u64(0..far);
                        history.clock_ms = match history.random.u8(0..3) {
                            0 => history.clock_ms + by,
                            1 => history.clock_ms.saturating_sub(by),
                            _ => 0,
                        };
                    }
                    6..9 => {
                        for _ in 0..1_200 {
                            history.now += Duration::from_millis(20);
                            let seen = history.make(13_002);
                            history.arrives(seen);
                        }
                    }
                    9..60 => history.replay_some(),
                    60..400 => {
                        let seen = history.make(STICKS);
                        history.arrives(seen);
                    }
                    400..500 => {
                        // Recorded, and never delivered.
                        history.make(2016);
                    }
                    500..700 => {
                        let seen = history.make(2016);
                        history.arrives(seen);
                    }
                    _ => {
                        let seen = history.make(16_002);
                        history.arrives(seen);
                    }
                }
            }
        }
    }

    #[test]
    fn a_station_with_a_steady_clock_is_never_refused_over_a_bad_network() {
        let mut history = History::new(1);
        let mut under_way: Vec<(Duration, Seen)> = Vec::new();
        for n in 0..12_000_u64 {
            history.now += Duration::from_millis(25);
            if n % 5_000 == 4_999 {
                history.restart();
            }
            // Heartbeats, commands of which many arrive only when they are repeated, up to 40 s later.
            let kind = if n % 40 == 0 { 16_002 } else { 2016 };
            let seen = history.make(kind);
            let first = history.now + Duration::from_millis(history.random.u64(0..1_500));
            let retries = history.random.u64(0..40) * history.random.u64(0..2);
            under_way.push((first + Duration::from_secs(retries), seen));
            let now = history.now;
            while let Some(index) = under_way.iter().position(|(at, _)| *at <= now) {
                let (_, seen) = under_way.swap_remove(index);
                assert_eq!(history.arrives(seen), Verdict::New, "{n}");
                assert!(matches!(history.arrives(seen), Verdict::Again(_)), "{n}");
            }
        }
    }

    #[test]
    fn after_any_step_of_its_clock_a_station_commands_again_in_seconds() {
        for seed in 0..100 {
            let mut history = History::new(seed);
            for _ in 0..4 {
                for second in 0..90 {
                    history.now += Duration::from_secs(1);
                    let beat = history.make(16_002);
                    history.arrives(beat);
                    let command = history.make(2016);
                    let verdict = history.arrives(command);
                    if second >= 6 {
                        assert_eq!(verdict, Verdict::New, "{seed}, {second} s after the step");
                    }
                }
                let far = [1 << 38, 90_000_000, 300_000][history.random.usize(0..3)];
                let by = history.random.u64(0..far);
                history.clock_ms = match history.random.bool() {
                    true => history.clock_ms + by,
                    false => history.clock_ms.saturating_sub(by),
                };
            }
        }
    }
}
