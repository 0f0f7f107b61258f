//! The commands of each CUCS on disk, and what they were answered: a repetition after a restart is known, and what a
//! restart cut off is said.
//!
//! A line is added before a command is carried out, and another when its answer is final: digest, message type, stamp,
//! destination, 1 where an acknowledgement was asked for, mode, and the answer, `-` before it is known. A later line
//! of the same digest takes the place of the earlier. Written for the end of the process, `kill -9` too; after a power
//! cut the last lines may be missing.
//!
//! Where no line can be written the command is carried out all the same, and that is said: a vehicle in the air must be
//! commanded with a full disk too.

use std::collections::VecDeque;
use std::fmt::Write as _;

use stanag_msgs::enums::{AckType, AlertPriority, FlightPathControlMode as Mode};
use stanag_msgs::{Id, TimeStamp};

use super::aircraft::Aircraft;
use super::alerts::Cause;
use super::bridge::Bridge;
use super::desk::{Desk, Origin};
use super::duplicate::{DEPTH, Digest, Recent, Seen};
use super::log::LogLevel;
use mavlink_link::Now;
use mavlink_link::store::{Disk, Durability, StoreError};

impl Desk<'_> {
    /// Writes a command down, before it is carried out.
    pub(super) fn note_command(&mut self, station: usize, seen: &Seen) -> Result<(), StoreError> {
        if !seen.commands() {
            return Ok(());
        }
        let Some(of) = self.stations.get_mut(station) else {
            return Ok(());
        };
        let name = journal_name(of.id());
        of.journal_lines += 1;
        if of.journal_lines > MAX_LINES {
            let whole = text(of.recent.commands());
            self.store
                .replace(&name, whole.as_bytes(), Durability::Process)?;
            of.journal_lines = of.recent.commands().count();
            return Ok(());
        }
        self.store
            .append(&name, line(seen).as_bytes(), Durability::Process)
    }

    /// Writes down how a command was answered. That nothing can be written is said where it is taken.
    pub(super) fn note_answer(&mut self, station: usize, seen: &Seen) {
        if seen.answer != Some(AckType::Received) {
            let _ = self.note_command(station, seen);
        }
    }
}

impl Bridge {
    /// Reads back what each CUCS has commanded, and says what was not answered to its end.
    pub(super) fn restore_commands(
        &mut self,
        now: Now,
        store: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        let (mut desk, aircraft) = self.desk(now, store);
        for index in 0..desk.stations.len() {
            let Some(station) = desk.stations.get_mut(index) else {
                continue;
            };
            let name = journal_name(station.id());
            let Some(bytes) = desk.store.read(&name, u64::MAX)? else {
                continue;
            };
            let known = read(&bytes);
            station.recent = Recent::restored(known.clone());
            for seen in known.iter().filter(|seen| !is_final(seen.answer)) {
                let of = aircraft.iter_mut().find(|one| one.id() == seen.destination);
                let told = of.is_some_and(|aircraft| aircraft.was_cut_off(&mut desk, index, seen));
                if !told && let Some(station) = desk.stations.get_mut(index) {
                    station.recent.forget(seen.digest);
                }
            }
            let Some(station) = desk.stations.get_mut(index) else {
                continue;
            };
            let whole = text(station.recent.commands());
            station.journal_lines = station.recent.commands().count();
            if let Err(fault) = desk
                .store
                .replace(&name, whole.as_bytes(), Durability::Process)
            {
                desk.note(LogLevel::Error, desk.vsm, fault.to_string());
            }
        }
        Ok(())
    }
}

impl Aircraft {
    /// A command that had no final answer when the VSM ended. False where it is forgotten: what only stores, and what
    /// asks for rights, leads to the same when it comes again.
    fn was_cut_off(&mut self, desk: &mut Desk<'_>, station: usize, seen: &Seen) -> bool {
        let origin = Origin {
            station,
            message_type: seen.message_type,
            stamp: Some(seen.stamp),
            ack_requested: seen.ack_requested,
        };
        let id = desk.asker(station).map(|asker| asker.id);
        match seen.message_type {
            1 | 4 | 34000 => {
                // A handover outlives the restart, and its end answers who asked for it.
                let pending = self.authority.pending().iter();
                let party =
                    |to: Id, from: Option<Id>| id == Some(to) || (from.is_some() && from == id);
                let waits = pending
                    .into_iter()
                    .any(|handover| party(handover.to, handover.from));
                if let Some(id) = id.filter(|_| waits) {
                    self.authority_record.wait(id, origin);
                }
                waits
            }
            2000 | 2017 | 13001 | 13002 | 13003 | 50001 | 50002 | 50016 => false,
            _ => {
                let what = if seen.mode == 0 {
                    String::new()
                } else {
                    format!(" (mode {})", seen.mode)
                };
                let why = format!(
                    "the VSM was started anew while it was carried out{what}: it is not gone on with, look what the \
                     vehicle does"
                );
                self.refuse(desk, Some(origin), why);
                if seen.message_type == 2016 && Mode::from_raw(seen.mode) == Mode::Launch {
                    self.launch_cut_off = true;
                }
                true
            }
        }
    }

    /// The command could not be written down.
    pub(super) fn say_not_noted(&mut self, desk: &mut Desk<'_>, noted: Result<(), StoreError>) {
        let raised = match noted {
            Ok(()) => self
                .alerts
                .clear(Cause::CommandLog, "commands are written down again"),
            Err(fault) => {
                let text = format!(
                    "commands cannot be written down, a repetition after a restart would be carried out again: {fault}"
                );
                return self.warn(desk, Cause::CommandLog, text);
            }
        };
        // Nothing is made for a message where nothing stood: this is the way of every one.
        if raised.is_some() {
            let listeners = desk.listeners(&self.authority, None);
            desk.alert(self.id(), &listeners, raised);
        }
    }

    /// A launch that a restart cut off leaves no running motors behind, as one that fails leaves none: a vehicle that
    /// still stands is disarmed, of one that flies it is said.
    pub(super) fn end_launch_cut_off(&mut self, desk: &mut Desk<'_>) {
        let telemetry = &self.mav.telemetry;
        let known = (telemetry.armed, telemetry.landed);
        let (true, true, (Some(armed), Some(_))) = (self.launch_cut_off, self.mav.live(), known)
        else {
            return;
        };
        self.launch_cut_off = false;
        let flies = telemetry.airborne();
        if self.maneuver.is_some() || !(armed || flies) {
            return;
        }
        let text = if flies {
            "the launch that a restart of the VSM cut off has taken the vehicle up: command what it is to do"
        } else {
            "the launch that a restart of the VSM cut off left the vehicle armed on the ground: it is disarmed"
        };
        self.tell_once(desk, AlertPriority::Warning, text.to_owned());
        if !flies {
            let disarm = super::maneuver::disarm();
            self.begin(
                desk,
                None,
                super::maneuver::Maneuver::new(disarm, self.commanded),
            );
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

fn text<'a>(seen: impl Iterator<Item = &'a Seen>) -> String {
    seen.map(line).collect()
}

/// The latest commands of a command_log. A line that is none, as the last may be after a crash, is passed over.
fn read(bytes: &[u8]) -> VecDeque<Seen> {
    let mut known: VecDeque<Seen> = VecDeque::new();
    for line in String::from_utf8_lossy(bytes).lines() {
        let Some(seen) = parse(line) else { continue };
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

fn parse(line: &str) -> Option<Seen> {
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

fn journal_name(station: Id) -> String {
    format!("commands-{:08x}.log", station.0)
}

/// A command_log of so many lines is written anew, shorter.
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
    fn a_journal_reads_back_with_the_latest_answers_and_without_a_torn_line() {
        let (one, two) = (seen(1, None), seen(2, None));
        let answered = seen(1, Some(AckType::CarriedOut));
        let mut bytes = text([one, two, answered].iter());
        bytes.push_str(&line(&seen(3, None))[..50]);
        assert_eq!(read(bytes.as_bytes()), [answered, two]);
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
        let known = read(bytes.as_bytes());
        assert_eq!(known.len(), DEPTH);
        assert_eq!(known[0].digest.0[..8], 10_usize.to_be_bytes());
    }
}
