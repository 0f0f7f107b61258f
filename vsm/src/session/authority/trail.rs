//! The trail: the audit logs of one vehicle, one for changes of control and one for monitors, each over several rotated
//! files; the end of each log ([`Head`], kept in the authority record), and the faults found in them.
//!
//! Monitors and holders of payload stations may gain and release rights at any rate. Their changes have a separate log, so
//! that they cannot cause a rotation of the control log, and all changes of one station within [`COALESCED`] are one line
//! with their number.
//!
//! A start and `vsm audit verify` both use [`examine`]. The head reveals an older copy of the logs. An older copy of the
//! whole folder is revealed only by a later head that was kept elsewhere.
//!
//! A file is put aside before the first line beyond [`MAX_BYTES`], so that only something else can make one longer than
//! [`MAX_LOG_BYTES`]. Of such a file no more is read, whatever its length: a start takes neither its time nor its memory. The
//! log continues from the head, in a new file.

use std::collections::{BTreeMap, VecDeque};
use std::fmt;
use std::time::Duration;

use mavlink_link::store::{Disk, Durability, StoreError, log_name};
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;
use zeroize::Zeroizing;

use super::audit::{AuditKey, Broken, Chain, Entry};
use super::rules::Change;

/// Which of the two logs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    /// Changes of LOI 4 and 5, and the starts of the VSM.
    Control,
    /// Changes of LOI 2 and 3.
    Monitors,
}

impl Kind {
    /// Both.
    pub(crate) const ALL: [Kind; 2] = [Kind::Control, Kind::Monitors];

    /// The current file.
    pub(crate) fn file(self, vehicle: Id) -> String {
        match self {
            Kind::Control => format!("audit-{:08x}.log", vehicle.0),
            Kind::Monitors => format!("audit-monitors-{:08x}.log", vehicle.0),
        }
    }

    /// Its files, the oldest first, with their numbers. During a rotation there is one more file than are kept.
    pub(crate) fn files(self, vehicle: Id) -> impl Iterator<Item = (u32, String)> {
        let name = self.file(vehicle);
        let numbers = (0..=MAX_FILES + 1).rev();
        numbers.map(move |number| (number, log_name(&name, number)))
    }

    /// Its name in an export.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Kind::Control => "control",
            Kind::Monitors => "monitors",
        }
    }

    /// The log that a change belongs to.
    pub(super) fn of(change: &Change) -> Kind {
        if change.lost.control().is_empty() && change.gained.control().is_empty() {
            Kind::Monitors
        } else {
            Kind::Control
        }
    }
}

/// The end of a log, as stored in the authority record: the number and the digits of its last line.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Head {
    lines: u64,
    digits: String,
    /// HMAC of the head, so that it cannot be replaced by the digits of an earlier line.
    mac: String,
}

impl Head {
    fn of(chain: &Chain, vehicle: Id, kind: Kind, key: &AuditKey) -> Head {
        let mut head = Head {
            lines: chain.lines(),
            digits: chain.digits().to_owned(),
            mac: String::new(),
        };
        head.mac = head.by(key, vehicle, kind);
        head
    }

    fn by(&self, key: &AuditKey, vehicle: Id, kind: Kind) -> String {
        let (lines, vehicle) = (self.lines.to_string(), vehicle.to_string());
        key.mac(&["head", kind.name(), &vehicle, &lines, &self.digits])
    }
}

/// A fault of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Finding {
    /// The file.
    pub(crate) file: String,
    /// The fault.
    pub(crate) fault: Fault,
}

/// Kinds of faults.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Fault {
    /// A line was changed, removed, moved or inserted.
    Line(Broken),
    /// The file does not follow the previous one, or that one is missing; its first line.
    Gap(u64),
    /// It has fewer lines than were recorded.
    Short { lines: u64, recorded: u64 },
    /// It is missing; it had this many lines.
    Gone(u64),
    /// The line with the recorded number differs.
    Replaced(u64),
    /// The recorded head is not by the key of this installation.
    ForgedHead,
    /// Lines by a key that is not available.
    OtherKey(String),
    /// A key exists, but the log has no line by it.
    NotKeyed,
    /// The log uses a key, but no head of it is recorded.
    NoHead,
    /// It is longer than it becomes.
    TooLong,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let file = &self.file;
        match &self.fault {
            Fault::Line(broken) => write!(f, "{file} is broken: {broken}"),
            Fault::Gap(line) => write!(
                f,
                "{file} is broken: line {line} does not follow from the file before it: a file was changed or deleted"
            ),
            Fault::Short { lines, recorded } => write!(
                f,
                "{file} ends with line {lines}, expected line {recorded} as recorded: its end was cut off, or it is an \
                 older copy"
            ),
            Fault::Gone(recorded) => write!(
                f,
                "{file} is deleted: line {recorded} was recorded as its last"
            ),
            Fault::Replaced(line) => write!(
                f,
                "{file} is another log: line {line} is not the line that was recorded"
            ),
            Fault::ForgedHead => write!(
                f,
                "{file}: its recorded end is not by the key of this installation: the record or audit.key was replaced"
            ),
            Fault::OtherKey(id) => write!(
                f,
                "{file} has lines by another key (id {id}), which cannot be verified with audit.key"
            ),
            Fault::NotKeyed => write!(
                f,
                "{file} has no line by the key of this installation: it is an older copy or was rewritten"
            ),
            Fault::NoHead => write!(
                f,
                "{file}: no end of it is recorded: the authority record was replaced or changed, or deleted"
            ),
            Fault::TooLong => write!(
                f,
                "{file} has more than {MAX_LOG_BYTES} bytes: something else has written to it, and only its beginning is verified"
            ),
        }
    }
}

/// The result of examining a log.
#[derive(Debug)]
pub(crate) struct Examined {
    pub(crate) kind: Kind,
    /// Where to continue.
    pub(crate) chain: Chain,
    pub(crate) findings: Vec<Finding>,
    /// The requested lines (by their digits) that were found, with their numbers.
    pub(crate) present: Vec<(String, u64)>,
    /// What its own lines report ([`Verified::reported`](super::audit::Verified)): line number and text.
    pub(crate) reported: Vec<(u64, String)>,
    /// Length of the current file.
    pub(super) bytes: usize,
    /// Files whose last line is incomplete.
    pub(super) torn: Vec<String>,
}

/// Examines the files of a log, the oldest first, and looks for lines by their digits.
///
/// # Errors
/// A file exists but cannot be read.
pub(crate) fn examine(
    kind: Kind,
    vehicle: Id,
    key: Option<&AuditKey>,
    head: Option<&Head>,
    digits: &[String],
    disk: &dyn Disk,
) -> Result<Examined, StoreError> {
    let name = kind.file(vehicle);
    let wanted = head.map_or(0, |head| head.lines);
    let mut found = Examined {
        kind,
        chain: Chain::default(),
        findings: Vec::new(),
        present: Vec::new(),
        reported: Vec::new(),
        bytes: 0,
        torn: Vec::new(),
    };
    let (mut before, mut recorded) = (None::<Chain>, None);
    // How many files there are, and the oldest with the number of its first line.
    let (mut files, mut oldest) = (0, None);
    // The file before is longer than it becomes: where it ends is not known.
    let mut cut_before = false;
    for (number, file) in kind.files(vehicle) {
        let (bytes, cut) = read_log(&file, disk)?;
        if bytes.is_empty() && !cut {
            continue;
        }
        if cut_before {
            // What was added to it counts as lines, too.
            recorded = None;
        }
        let verified = Chain::verify(&bytes, key);
        if verified.torn {
            found.torn.push(file.clone());
        }
        if verified.digits.is_empty() && !cut {
            // A crash has cut off its only line. Where it claims to follow something, somebody else has made it, in place of files
            // that are gone.
            continue;
        }
        files += 1;
        let first = verified.follows.lines() + 1;
        oldest.get_or_insert_with(|| (file.clone(), first));
        let mut find = |fault| {
            let file = file.clone();
            found.findings.push(Finding { file, fault });
        };
        // Only the oldest file may follow a file that no longer exists.
        let follows = before
            .as_ref()
            .is_none_or(|before| cut_before || *before == verified.follows);
        if !follows {
            find(Fault::Gap(first));
        } else if let Some(broken) = verified.broken {
            find(Fault::Line(broken));
        }
        if let Some(id) = verified.other_key {
            find(Fault::OtherKey(id));
        }
        if cut {
            find(Fault::TooLong);
        }
        if number == 0 {
            // One that was cut is put aside before the next line.
            found.bytes = if cut { MAX_BYTES } else { bytes.len() };
        }
        for (line, number) in verified.digits.iter().zip(first..) {
            if digits.contains(line) {
                found.present.push((line.clone(), number));
            }
            if number == wanted && recorded.is_none() {
                recorded = Some(line.clone());
            }
        }
        found.reported.extend(verified.reported);
        found.chain = verified.chain.clone();
        before = Some(verified.chain);
        cut_before = cut;
    }
    // A file is deleted where newer ones are as many as are kept, whatever their names.
    if let Some((file, first)) = oldest.filter(|(_, first)| *first > 1 && files < MAX_FILES) {
        let fault = Fault::Gap(first);
        found.findings.push(Finding { file, fault });
    }
    let forged = |head: &Head| key.is_some_and(|key| head.mac != head.by(key, vehicle, kind));
    if cut_before && let (Some(key), Some(head)) = (key, head.filter(|head| !forged(head))) {
        // Where the file ends says nothing: the log continues from its recorded end, which may be beyond what was read.
        if recorded.is_some_and(|digits| digits != head.digits) {
            let fault = Fault::Replaced(head.lines);
            found.findings.push(Finding { file: name, fault });
        }
        found.chain = Chain::at(head.lines, &head.digits, key);
        return Ok(found);
    }
    let lines = found.chain.lines();
    let fault = match head {
        Some(head) if forged(head) => Some(Fault::ForgedHead),
        Some(head) if head.lines > 0 && before.is_none() => Some(Fault::Gone(head.lines)),
        Some(head) if head.lines > lines => Some(Fault::Short {
            lines,
            recorded: head.lines,
        }),
        Some(head) if head.lines > 0 && recorded.as_ref() != Some(&head.digits) => {
            Some(Fault::Replaced(head.lines))
        }
        None if found.chain.keyed().is_some() => Some(Fault::NoHead),
        _ => None,
    };
    if let Some(fault) = fault {
        found.findings.push(Finding { file: name, fault });
    }
    Ok(found)
}

/// What a file of a log can have, up to the end of a line, and whether there is more in the file.
///
/// # Errors
/// It exists but cannot be read.
pub(crate) fn read_log(
    file: &str,
    disk: &dyn Disk,
) -> Result<(Zeroizing<Vec<u8>>, bool), StoreError> {
    let mut bytes = disk.read(file, MAX_LOG_BYTES + 1)?.unwrap_or_default();
    let cut = bytes.len() as u64 > MAX_LOG_BYTES;
    if cut {
        let end = bytes.iter().rposition(|byte| *byte == b'\n');
        bytes.truncate(end.map_or(0, |end| end + 1));
    }
    Ok((bytes, cut))
}

/// One of the logs, as it is written.
#[derive(Debug)]
pub(super) struct Trail {
    kind: Kind,
    chain: Chain,
    /// Length of the file that is being written; 0 before its first line.
    bytes: usize,
    /// Its last changes are not in effect, and no line records that yet.
    retracts: bool,
    /// What holds though its line could not be written, and since when (since 1970). In memory alone: what a full disk lets be
    /// written over in its place are the records of a few digits that a link lives by, and nothing else may wait in their way.
    owed: VecDeque<(Duration, Entry)>,
}

impl Trail {
    pub(super) fn new(kind: Kind) -> Trail {
        Trail {
            kind,
            chain: Chain::default(),
            bytes: 0,
            retracts: false,
            owed: VecDeque::new(),
        }
    }

    /// Continues the examined log, and closes lines that a crash has cut off.
    ///
    /// # Errors
    /// A line cannot be closed.
    pub(super) fn restore(
        &mut self,
        found: &Examined,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        for file in &found.torn {
            // So that the next line begins on a new line.
            disk.append(file, b"\n", Durability::Power)?;
        }
        self.chain.clone_from(&found.chain);
        self.bytes = found.bytes;
        Ok(())
    }

    /// The head for the record. Without a key it would prove nothing.
    pub(super) fn head(&self, vehicle: Id, key: Option<&AuditKey>) -> Option<Head> {
        key.map(|key| Head::of(&self.chain, vehicle, self.kind, key))
    }

    /// It has lines by a key.
    pub(super) fn is_keyed(&self) -> bool {
        self.chain.keyed().is_some()
    }

    /// The log is of an earlier version; the next line starts to use the key.
    pub(super) fn begins_to_be_keyed(&self, key: Option<&AuditKey>) -> bool {
        key.is_some() && self.chain.lines() > 0 && self.chain.keyed().is_none()
    }

    /// The changes that were written last are not in effect: writes a line about that, now or before the next one.
    pub(super) fn retract(&mut self, at: &Place<'_>, disk: &mut dyn Disk) {
        self.retracts = true;
        // The disk has just refused another write, of which operators are alerted.
        let _ = self.write_retraction(at, disk);
    }

    fn write_retraction(&mut self, at: &Place<'_>, disk: &mut dyn Disk) -> Result<(), StoreError> {
        if self.retracts {
            self.write_after(&Entry::NotKept, Durability::Power, at, disk)?;
            self.retracts = false;
        }
        Ok(())
    }

    /// Whether the line of a right that is given may be owed: half of the room is for rights that end, of which there are no more
    /// than were given, and for terminations.
    pub(super) fn has_room(&self) -> bool {
        self.owed.len() < MAX_OWED / 2
    }

    /// This holds since then, and its line could not be written: it comes before the next one. Beyond [`MAX_OWED`] lines are only
    /// counted, by a last one that stands for them in the log. Returns how many are since the last that has room; 0 where this one
    /// has.
    pub(super) fn owe(&mut self, wall: Duration, entry: Entry) -> u64 {
        if self.owed.len() < MAX_OWED {
            self.owed.push_back((wall, entry));
            return 0;
        }
        if let Some((_, Entry::NotWritten { lines, until })) = self.owed.back_mut() {
            *lines = lines.saturating_add(1);
            *until = wall;
            return *lines;
        }
        let (lines, until) = (1, wall);
        self.owed
            .push_back((wall, Entry::NotWritten { lines, until }));
        lines
    }

    /// Writes the lines that are owed.
    ///
    /// # Errors
    /// Not all of them could be written.
    pub(super) fn write_owed(
        &mut self,
        at: &Place<'_>,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        self.write_retraction(at, disk)?;
        while let Some((wall, entry)) = self.owed.front().cloned() {
            let then = Place { wall, ..*at };
            self.write_after(&entry, Durability::Power, &then, disk)?;
            self.owed.pop_front();
        }
        Ok(())
    }

    /// Writes one line, preceded by the lines that retract changes, that are owed, and that begin a file or the use of a key if
    /// needed.
    ///
    /// # Errors
    /// It could not be written.
    pub(super) fn write(
        &mut self,
        entry: &Entry,
        durability: Durability,
        at: &Place<'_>,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        self.write_owed(at, disk)?;
        self.write_after(entry, durability, at, disk)
    }

    fn write_after(
        &mut self,
        entry: &Entry,
        durability: Durability,
        at: &Place<'_>,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        if self.bytes >= MAX_BYTES {
            disk.rotate(&self.kind.file(at.vehicle), MAX_FILES)?;
            self.bytes = 0;
        }
        let own = at.key.map(AuditKey::id);
        let is_own = self.chain.keyed() == own.as_deref();
        // After a rotation, and after a start that found rotated files only: with the same key as the previous line.
        if self.bytes == 0 && self.chain.lines() > 0 && (is_own || self.chain.keyed().is_none()) {
            let key = at.key.filter(|_| self.chain.keyed().is_some());
            let as_before = Place { key, ..*at };
            self.write_line(&Entry::Continued, Durability::Power, &as_before, disk)?;
        }
        if at.key.is_some() && !is_own {
            self.write_line(&Entry::Keyed, Durability::Power, at, disk)?;
        }
        self.write_line(entry, durability, at, disk)
    }

    fn write_line(
        &mut self,
        entry: &Entry,
        durability: Durability,
        at: &Place<'_>,
        disk: &mut dyn Disk,
    ) -> Result<(), StoreError> {
        let (chain, line) = self.chain.extended(at.key, at.wall, at.vehicle, entry);
        let file = self.kind.file(at.vehicle);
        disk.append(&file, line.as_bytes(), durability)?;
        // Advance only once the line is written: a failed write leaves no gap in the chain.
        self.chain = chain;
        self.bytes += line.len();
        Ok(())
    }
}

/// What every line contains, and its key.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place<'a> {
    pub(super) vehicle: Id,
    /// Since 1970.
    pub(super) wall: Duration,
    pub(super) key: Option<&'a AuditKey>,
}

/// Changes of monitors that are counted until their line is due.
#[derive(Debug, Clone, Default)]
pub(super) struct Repetitions {
    of: BTreeMap<Id, Repeated>,
}

#[derive(Debug, Clone, Copy)]
struct Repeated {
    /// Changes are counted until then.
    until: Duration,
    gained: u32,
    lost: u32,
}

impl Repetitions {
    /// Whether a change is counted instead of written.
    pub(super) fn count(&mut self, change: &Change, now: Duration) -> bool {
        let Some(repeated) = station(change).and_then(|id| self.of.get_mut(&id)) else {
            return false;
        };
        // If its line is due, the change is counted in that line.
        if repeated.until <= now && !repeated.is_pending() {
            return false;
        }
        repeated.gained = repeated
            .gained
            .saturating_add(u32::from(change.to.is_some()));
        repeated.lost = repeated
            .lost
            .saturating_add(u32::from(change.from.is_some()));
        true
    }

    /// A line about the station was written: later changes are counted.
    pub(super) fn written(&mut self, change: &Change, now: Duration) {
        if let Some(id) = station(change) {
            let repeated = Repeated {
                until: now + COALESCED,
                gained: 0,
                lost: 0,
            };
            self.of.insert(id, repeated);
        }
    }

    /// The next due line; if it cannot be written its changes are counted again ([`Repetitions::failed`]).
    pub(super) fn due(&mut self, now: Duration) -> Option<Entry> {
        let mut all = self.of.iter_mut();
        let (id, repeated) = all.find(|(_, one)| one.until <= now && one.is_pending())?;
        let entry = Entry::Repeated {
            station: *id,
            gained: std::mem::take(&mut repeated.gained),
            lost: std::mem::take(&mut repeated.lost),
        };
        // Continuing changes yield one line per period.
        repeated.until = now + COALESCED;
        Some(entry)
    }

    pub(super) fn failed(&mut self, entry: &Entry) {
        if let Entry::Repeated {
            station,
            gained,
            lost,
        } = entry
            && let Some(repeated) = self.of.get_mut(station)
        {
            repeated.gained = repeated.gained.saturating_add(*gained);
            repeated.lost = repeated.lost.saturating_add(*lost);
        }
    }

    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        let pending = self.of.values().filter(|one| one.is_pending());
        pending.map(|one| one.until).min()
    }
}

impl Repeated {
    fn is_pending(&self) -> bool {
        self.gained > 0 || self.lost > 0
    }
}

/// The station of a change of monitors.
fn station(change: &Change) -> Option<Id> {
    change.to.or(change.from)
}

/// Changes of one monitor within this time are combined into one line.
const COALESCED: Duration = Duration::from_secs(10);
/// A log of this length is rotated.
const MAX_BYTES: usize = 1 << 20;
/// No log gets here: the lines that follow [`MAX_BYTES`] at once, of all stations, have some kB.
pub(crate) const MAX_LOG_BYTES: u64 = 2 << 20;
/// Number of rotated files that are kept, with some four thousand lines each.
const MAX_FILES: u32 = 8;
/// Lines of what holds that wait for a disk: rights that end, or that the record still has, and terminations. One more counts
/// those beyond.
pub(super) const MAX_OWED: usize = 256;

#[cfg(test)]
mod tests {
    use mavlink_link::store::MemoryDisk;

    use super::*;

    #[test]
    fn lines_that_are_only_counted_are_named_at_their_place_whenever_there_is_room_again() {
        let (mut trail, vehicle) = (Trail::new(Kind::Control), Id(0x1b00_0101));
        let wall = |s: u64| Duration::from_secs(1_795_219_200 + s);
        let owe = |trail: &mut Trail, seconds: std::ops::Range<u64>| {
            seconds.fold(0, |_, s| trail.owe(wall(s), Entry::NotKept))
        };
        let room = MAX_OWED as u64;
        assert_eq!(owe(&mut trail, 0..room), 0);
        assert_eq!(owe(&mut trail, room..room + 3), 3);
        // The disk takes ten lines, and then none again: what has room comes behind what was counted.
        trail.owed.drain(..10);
        assert_eq!(owe(&mut trail, 1_000..1_009), 0);
        assert_eq!(owe(&mut trail, 1_009..1_011), 2);
        let at = Place {
            vehicle,
            wall: wall(2_000),
            key: None,
        };
        let mut disk = MemoryDisk::default();
        trail.write_owed(&at, &mut disk).expect("written");
        assert!(trail.owed.is_empty());
        let log = &disk.records[&Kind::Control.file(vehicle)];
        let verified = Chain::verify(log, None);
        assert_eq!(verified.broken, None);
        let reported = |line: u64, text: &str| (line, text.to_owned());
        assert_eq!(
            verified.reported,
            [
                reported(
                    room - 9,
                    "not written: 3 lines, from 2026-11-21T00:04:16Z to 2026-11-21T00:04:18Z: the disk took none"
                ),
                reported(
                    room + 1,
                    "not written: 2 lines, from 2026-11-21T00:16:49Z to 2026-11-21T00:16:50Z: the disk took none"
                ),
            ]
        );
    }
}
