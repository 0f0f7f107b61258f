//! Duplicates: the same source, destination, type, stamp and bytes; acknowledged again, not carried out again.
//!
//! [`Remembered`] is what the bridge knows of one CUCS; it judges each message. Its parts, in the order in which a
//! message meets them:
//!
//! 1. `recent`: the latest messages, each with its answer and with what it orders about. A repetition is answered from
//!    here; an order that a later one has overtaken is refused.
//! 2. `stamps`: the Time Stamps that commands have used ([`UsedStamps`]), and the clock of the station as its traffic
//!    shows it ([`StationClock`]); `delay`: how fresh a message is by it. `stick_stamps`: the same for sticks
//!    ([`StickStamps`]).
//! 3. `refusals`: the reasons that a station is sent.
//! 4. `command_log`: the lines of the log on disk, for the time after a restart.
//!
//! Each message is known by the digest of its bytes. Those that command are remembered apart from questions and
//! streams, so that neither sticks nor heartbeats push them out, and are logged on disk: they are known after a restart
//! too, and one that the restart cut off is answered.
//!
//! What was authorised and the memory has no room for any more leaves its stamp behind ([`UsedStamps`]): no command is
//! carried out twice, however many others came between. What was not authorised leaves nothing. What moves the aircraft,
//! changes what it will fly or decides who may (`commands` of the caller) needs a stamp, and comes in time by its station's
//! own clock ([`StationClock`]). Sticks are too many to be logged one by one: of them each must be newer than the last
//! ([`StickStamps`]), and the log has a bound on their stamps that is ahead of them.
//!
//! A command is logged before it is carried out, and again when its answer is final. The log survives the end of the
//! process, `kill -9` too; after a power cut the last lines may be missing. Where no line can be written the command is
//! carried out all the same, and an alert reports it: a vehicle in the air must be commanded with a full disk too.

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

use mavlink_link::store::{Disk, Durability, StoreError};
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
            let ahead = self.clock.is_ahead(new.stamp, now);
            let why = match self.stick_stamps.judge(new.stamp, new.digest.0, ahead, now) {
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

    /// How long a message that was judged just now has been on its way.
    pub(crate) fn delay(&self, stamp: TimeStamp, now: Duration) -> Delay {
        self.clock.delay(stamp, now)
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

    /// Whether the latest command of this type and stamp was refused.
    pub(crate) fn was_refused(&self, message_type: u16, stamp: TimeStamp) -> bool {
        let is_it = |seen: &&Seen| (seen.message_type, seen.stamp) == (message_type, stamp);
        let seen = self.recent.commands.iter().rev().find(is_it);
        seen.is_some_and(|seen| seen.answer == Some(AckType::Refused))
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

/// A log of so many lines is compacted.
const MAX_LINES: usize = 3 * MAX_COMMANDS;
const STICKS: u16 = 2010;
/// How far the log is ahead of the sticks. After a restart of the VSM they count again that much later; PX4 has left manual
/// flight by then, and every other command counts at once.
const STICKS_AHEAD_MS: u64 = 10_000;
