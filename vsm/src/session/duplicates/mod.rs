//! Duplicates: messages with the same source, destination, type, stamp and bytes are acknowledged again but not carried out
//! again.
//!
//! [`Remembered`] is the memory of one CUCS's messages; it decides about each message. Its parts, in the order in which a
//! message passes through them:
//!
//! 1. `recent`: the latest messages, each with its answer and its subject. A repetition is answered from here; a command
//!    that was overtaken by a later one is refused.
//! 2. `stamps`: the Time Stamps that commands have used ([`UsedStamps`]), and the station's clock as estimated from its
//!    traffic ([`StationClock`]); `delay`: the delay of a message. `stick_stamps`: the same for sticks ([`StickStamps`]).
//! 3. `refusals`: the reasons sent to a station.
//! 4. `command_log`: the lines of the log on disk, for the time after a restart.
//!
//! A message is identified by the digest of its bytes. Commands are remembered apart from queries and streams, so that
//! neither sticks nor heartbeats displace them. They are also logged on disk: they are known after a restart, and a command
//! that the restart interrupted is answered.
//!
//! When an authorised command is displaced from memory, its stamp is kept ([`UsedStamps`]): no command is carried out twice,
//! however many others arrive in between. Unauthorised commands leave nothing. A message that moves the aircraft, changes
//! what it will fly, or changes who controls it (`commands` of the caller) needs a stamp and must be recent by its station's
//! own clock ([`StationClock`]). There are too many sticks to log each one: each must be newer than the last
//! ([`StickStamps`]), and the log holds an upper bound on their stamps that is ahead of them.
//!
//! A command is logged before it is carried out, and again when its answer is final. The log survives the end of the
//! process, also by `kill -9`; after a power cut the last lines may be missing. If a line cannot be written, the command is
//! still carried out and an alert is raised: a vehicle in the air must remain controllable with a full disk.

mod command_log;
mod delay;
mod recent;
mod refusals;
mod stamps;
mod stick_stamps;
#[cfg(test)]
mod tests;

use std::collections::HashMap;
use std::time::Duration;

use mavlink_link::store::{Disk, Durability, MAX_RECORD_BYTES, StoreError};
use stanag_msgs::enums::AckType;
use stanag_msgs::{Id, TimeStamp};

use self::command_log::{
    STICKS_LINE, USED_LINE, log_file, parse_line, parse_span, write_line, write_span,
};
pub(crate) use self::delay::Delay;
pub(crate) use self::recent::{Digest, Seen, commands_values, is_command};
use self::recent::{MAX_COMMANDS, Recent, is_final};
use self::refusals::{FLOWN, OLDER, OVERTAKEN, REPEATED, TOO_MANY_AHEAD, USED, late_text};
pub(crate) use self::stamps::stamps_apart_ms;
use self::stamps::{MAX_AHEAD, StationClock, UsedStamps};
use self::stick_stamps::{Stick, StickStamps};

/// Recent messages of one CUCS, in memory and in its log.
#[derive(Debug, Default)]
pub(crate) struct Remembered {
    recent: Recent,
    /// Stamps of commands that `recent` had no room for.
    used: UsedStamps,
    /// Stamps of sticks, as the log has them.
    sticks: UsedStamps,
    stick_stamps: StickStamps,
    /// The last stick stamp in the log.
    sticks_logged: u64,
    clock: StationClock,
    /// Lines of the log since it was last written whole.
    lines: usize,
    /// The name of the log and a buffer for one line, kept so that logging sticks does not allocate.
    log_name: String,
    line: String,
}

/// The decision about a message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Verdict {
    /// It is carried out.
    New,
    /// It was received before; with the answer, if it has one.
    Again(Option<AckType>),
    /// It is refused: the name of the counter, and the reason.
    Refused(&'static str, String),
}

impl Remembered {
    /// Decides about a message and remembers it. `timed`: it must be recent.
    ///
    /// Reception alone does not use a stamp: otherwise a CUCS without a right, or an attacker in its name, could use up
    /// future stamps and lock the CUCS out. An authorised command is [accepted](Remembered::accept) before it is carried
    /// out.
    pub(crate) fn judge(&mut self, new: &Seen, timed: bool, now: Duration) -> Verdict {
        if let Some(answer) = self.recent.find(new) {
            return Verdict::Again(answer);
        }
        let sticks = new.message_type == STICKS;
        if new.commands() && self.used.contains(new.stamp) {
            // Do not remember it: replays must not displace other messages.
            return Verdict::Refused("used time stamp", USED.into());
        }
        if sticks {
            let ahead = self.clock.is_ahead(new.stamp, now);
            let why = match self.stick_stamps.judge(new.stamp, new.digest.0, ahead, now) {
                Stick::New => None,
                Stick::Repeated => Some(REPEATED),
                Stick::Flown => Some(FLOWN),
                Stick::Older => {
                    // It may be the first message of a clock that was set back: later messages show whether it was.
                    self.clock.note(new.stamp, now);
                    Some(OLDER)
                }
            };
            if let Some(why) = why {
                return Verdict::Refused("used time stamp", why.into());
            }
        }
        // Note it first: this may be the message that confirms that the clock was set.
        self.clock.note(new.stamp, now);
        // A stamp ahead of the clock stays used until the clock has passed it, however many there are.
        if timed
            && self.clock.is_ahead(new.stamp, now)
            && let Some(reading) = self.clock.reading(now)
            && self.ahead(sticks, reading) >= MAX_AHEAD
        {
            return Verdict::Refused("too far ahead", TOO_MANY_AHEAD.into());
        }
        // Remember overtaken and late commands too, so that their repetitions are refused as duplicates.
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

    /// The delay of the message that was just decided about.
    pub(crate) fn delay(&self, stamp: TimeStamp, now: Duration) -> Delay {
        self.clock.delay(stamp, now)
    }

    /// How many used stamps are ahead of the station's clock.
    fn ahead(&self, sticks: bool, reading: TimeStamp) -> usize {
        if sticks {
            self.stick_stamps.ahead(reading)
        } else {
            self.used.ahead(reading)
        }
    }

    /// Whether all sticks of the station have been refused for so long that it must be notified.
    pub(crate) fn refuses_sticks(&self, now: Duration) -> bool {
        self.stick_stamps.are_refused(now)
    }

    /// The last message will be carried out: logs it first. `authorised`: its stamp is used from here on. Returns `None` if
    /// such messages are not logged, otherwise whether the write succeeded. The message counts as received in either case.
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
        // Logged once: a message 1 that names several vehicles is accepted by each of them.
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
            // Do not log "received": after a restart it would mean the same as no answer.
            && is_final(seen.answer)
        {
            // The alert about a failed write was raised when the command arrived.
            let _ = self.log(station, &seen, disk);
        }
    }

    /// Whether the latest command of this type and stamp was refused.
    pub(crate) fn was_refused(&self, message_type: u16, stamp: TimeStamp) -> bool {
        let is_it = |seen: &&Seen| (seen.message_type, seen.stamp) == (message_type, stamp);
        let seen = self.recent.commands.iter().rev().find(is_it);
        seen.is_some_and(|seen| seen.answer == Some(AckType::Refused))
    }

    /// Reads the log after a restart; returns the commands without a final answer.
    ///
    /// # Errors
    /// The log exists and cannot be read, or is longer than it becomes.
    pub(crate) fn restore(
        &mut self,
        station: Id,
        now: Duration,
        disk: &dyn Disk,
    ) -> Result<Vec<Seen>, StoreError> {
        let Some(bytes) = disk.read_whole(&log_file(station), MAX_RECORD_BYTES)? else {
            return Ok(Vec::new());
        };
        self.read_log(&bytes);
        let commands = &self.recent.commands;
        // Nothing is learned from unauthorised commands.
        if let Some(latest) = commands.iter().rev().find(|seen| seen.has_used_its_stamp()) {
            self.clock.restore(latest.stamp, now);
            self.used.bound(latest.stamp);
            self.sticks.bound(latest.stamp);
        }
        self.stick_stamps.restore(self.sticks.clone());
        let open = commands.iter().filter(|seen| !is_final(seen.answer));
        Ok(open.copied().collect())
    }

    /// Forgets a command, so that it is carried out if it is sent again.
    pub(crate) fn forget(&mut self, digest: Digest) {
        self.recent.commands.retain(|seen| seen.digest != digest);
    }

    /// Rewrites the whole log, without replaced lines. Every line of it is in the log already.
    ///
    /// # Errors
    /// The log is unchanged.
    pub(crate) fn compact(&mut self, station: Id, disk: &mut dyn Disk) -> Result<(), StoreError> {
        let mut whole = String::new();
        for (name, used) in [(USED_LINE, &self.used), (STICKS_LINE, &self.sticks)] {
            for (first, last) in used.spans() {
                write_span(&mut whole, name, first, last);
            }
        }
        if let Some(last) = self.sticks_logged.checked_sub(STICKS_AHEAD_MS) {
            // Ahead of the received sticks, like its line in the log.
            write_span(&mut whole, STICKS_LINE, last, self.sticks_logged);
        }
        for seen in &self.recent.commands {
            write_line(&mut whole, seen);
        }
        self.lines = whole.lines().count();
        disk.compact(&log_file(station), whole.as_bytes())
    }

    fn log(&mut self, station: Id, seen: &Seen, disk: &mut dyn Disk) -> Result<(), StoreError> {
        if !seen.commands() {
            return Ok(());
        }
        self.line.clear();
        write_line(&mut self.line, seen);
        self.append(station, disk)
    }

    /// Notes the stamp of a stick. Sticks arrive 50 times a second, so the log holds a stamp up to which they count as used
    /// after a restart, and a new one is written when they reach it.
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
        if self.log_name.is_empty() {
            self.log_name = log_file(station);
        }
        // First, since a command follows at once, and a log may be rewritten later.
        disk.append(&self.log_name, self.line.as_bytes(), Durability::Process)?;
        self.lines += 1;
        if self.lines > MAX_LINES {
            // One that cannot be rewritten stays longer, and is tried again as many lines later.
            let _ = self.compact(station, disk);
        }
        Ok(())
    }

    /// The latest commands of a log, and the stamps of those before. A line that cannot be read, as the last may be after
    /// a crash, is skipped.
    fn read_log(&mut self, bytes: &[u8]) {
        let known = &mut self.recent.commands;
        known.clear();
        // The position of a digest, counted from the first line.
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
            // As many as `remember` keeps, since retransmissions may still arrive.
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

/// A log with this many lines is compacted.
const MAX_LINES: usize = 3 * MAX_COMMANDS;
const STICKS: u16 = 2010;
/// How far the log is ahead of the sticks. After a restart of the VSM, sticks are accepted again after this time; by then
/// PX4 has left manual flight. All other commands are accepted at once.
const STICKS_AHEAD_MS: u64 = 10_000;
