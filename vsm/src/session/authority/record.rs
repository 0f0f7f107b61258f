//! The record of authority over one vehicle, stored before a decision is answered: the holders of rights and since when, the
//! audit logs and their ends, and the messages that wait for a decision.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::store::{Changes, Disk, Durability, Progress, Store as _, StoreError};
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;
use stanag_msgs::ed25::Version;

use super::audit::{AuditKey, Entry};
use super::rules::{Authority, Change, Decision, Handover, Record, Rights};
use super::trail::{
    self, Examined, Fault, Finding, Head, Kind, MAX_OWED, Place, Repetitions, Trail,
};
use crate::session::alerts::Cause;
use crate::session::context::{Context, Origin};
use crate::session::effects::Effects;
use crate::session::log::LogLevel;
use crate::session::station::GroundStation;
use crate::session::station_profile::Shown;
use crate::session::store::vehicle_record;

/// Information about the holders of rights, and the audit log.
#[derive(Debug)]
pub(crate) struct AuthorityRecord {
    /// When each holder last gained a right, since 1970.
    since: BTreeMap<Id, Duration>,
    /// Messages 1, 4 and 34000 that were acknowledged as received, with their request still pending.
    waiting: Vec<(Id, Origin)>,
    /// Holders that have sent heartbeats, as stored: their silence is detected after a restart too.
    beats: BTreeSet<Id>,
    /// Proven addresses of holders, and their edition, as stored: status is sent there after a restart.
    places: BTreeMap<Id, (SocketAddr, Option<Version>)>,
    /// The key of the audit logs.
    key: Option<AuditKey>,
    control: Trail,
    monitors: Trail,
    repetitions: Repetitions,
    /// The rights that the record has, and the change of the disk that it came with.
    stored: (Authority, Changes),
    /// Something holds that the record or its logs lack: when it is tried again to store that.
    owed_at: Option<Duration>,
}

impl Default for AuthorityRecord {
    fn default() -> AuthorityRecord {
        AuthorityRecord {
            since: BTreeMap::new(),
            waiting: Vec::new(),
            beats: BTreeSet::new(),
            places: BTreeMap::new(),
            key: None,
            control: Trail::new(Kind::Control),
            monitors: Trail::new(Kind::Monitors),
            repetitions: Repetitions::default(),
            stored: (Authority::default(), Changes::NONE),
            owed_at: None,
        }
    }
}

impl AuthorityRecord {
    /// When a CUCS last gained a right, since 1970.
    pub(crate) fn since(&self, id: Id) -> Option<Duration> {
        self.since.get(&id).copied()
    }

    /// Keeps a message to answer it once its request is decided. Returns the oldest message of its station where that had to make
    /// room, to be answered now: a station that repeats its request with new stamps looks for the answer to the latest.
    #[must_use]
    pub(super) fn wait(&mut self, asker: Id, origin: Origin) -> Option<Origin> {
        self.waiting.retain(|(_, known)| *known != origin);
        let oldest = (self.waiting.iter())
            .position(|(of, _)| *of == asker)
            .filter(|_| !self.has_place(asker));
        let oldest = oldest.map(|at| self.waiting.remove(at).1);
        self.waiting.push((asker, origin));
        oldest
    }

    /// Whether another message of a station can wait for its decision. The limit is per station, so that no station can prevent
    /// another's answer.
    pub(super) fn has_place(&self, asker: Id) -> bool {
        let of_it = self.waiting.iter().filter(|(of, _)| *of == asker);
        of_it.count() < MAX_WAITING
    }

    /// The messages to answer after a handover has ended: those of its two parties that wait for no other handover.
    pub(super) fn ended(&mut self, ended: &Handover, pending: &[Handover]) -> Vec<(Id, Origin)> {
        let party = |handover: &Handover, id: Id| handover.to == id || handover.from == Some(id);
        let (done, wait) = std::mem::take(&mut self.waiting)
            .into_iter()
            .partition(|(asker, _)| {
                party(ended, *asker) && !pending.iter().any(|other| party(other, *asker))
            });
        self.waiting = wait;
        done
    }
}

/// The record of authority.
#[derive(Serialize, Deserialize)]
struct Stored {
    authority: Record,
    holders: Vec<Holder>,
    /// The ends of the audit logs; absent in records of earlier versions.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    audit: Option<Head>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    monitors: Option<Head>,
}

vehicle_record!(Stored, "authority", Power);

/// Information about a holder or a party of a handover, apart from its rights.
#[derive(Serialize, Deserialize)]
struct Holder {
    id: u32,
    since_ms: u64,
    beats: bool,
    peer: Option<SocketAddr>,
    #[serde(default)]
    proven: bool,
    /// Its edition and dialect.
    #[serde(flatten)]
    shown: Shown,
}

/// A station as the record knows it from before a restart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct KnownStation {
    pub(crate) id: Id,
    pub(crate) sends_heartbeats: bool,
    pub(crate) peer: Option<SocketAddr>,
    /// Its address was proven.
    pub(crate) proven: bool,
    /// Its edition and dialect.
    pub(crate) shown: Shown,
}

impl AuthorityRecord {
    /// Stores a decision that results in `rights`: first its lines of the audit logs, then the record.
    ///
    /// # Errors
    /// It could not be stored. If it `stands` all the same, it is stored by [`AuthorityRecord::store_owed`]. Otherwise each log
    /// with lines of it gets one that they are not in effect: now, or before its next line.
    pub(super) fn store_decision(
        &mut self,
        rights: &Authority,
        decision: &Decision,
        stands: bool,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        let before = (self.since.clone(), self.repetitions.clone());
        let mut logged = Vec::new();
        let stored = self.write_decision(rights, decision, stands, &mut logged, context, effects);
        if stored.is_err() && stands {
            self.owed_at = Some(context.mono() + TRY_AGAIN);
        }
        if stored.is_err() && !stands {
            (self.since, self.repetitions) = before;
            for kind in Kind::ALL.into_iter().filter(|kind| logged.contains(kind)) {
                let (trail, at) = self.trail(kind, context);
                trail.retract(&at, effects.disk());
            }
        }
        stored
    }

    /// As [`AuthorityRecord::store_decision`], without what follows from a failure. Notes the logs that got lines.
    fn write_decision(
        &mut self,
        rights: &Authority,
        decision: &Decision,
        stands: bool,
        logged: &mut Vec<Kind>,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        let durability = durability(decision);
        let mut lacking = None;
        // Write the log before the record: a crash between them may leave an extra line, but never a change without its
        // line.
        for change in &decision.changes {
            let (kind, now) = (Kind::of(change), context.mono());
            if kind == Kind::Control || !self.repetitions.count(change, now) {
                let entry = Entry::Change(*change);
                match self.write_audit(kind, &entry, durability, context, effects) {
                    Ok(()) => logged.push(kind),
                    Err(fault) if stands => {
                        self.owe(kind, entry, context, effects);
                        lacking = Some(fault);
                    }
                    Err(fault) => return Err(fault),
                }
                if kind == Kind::Monitors {
                    self.repetitions.written(change, now);
                }
            }
            if let Some(to) = change.to {
                self.since.insert(to, context.now.wall);
            }
        }
        self.since.retain(|id, _| !rights.held(*id).is_empty());
        match lacking {
            Some(fault) => Err(fault),
            None => self.store(rights, durability, context, effects),
        }
    }

    /// The log lacks the line of what holds all the same.
    fn owe(&mut self, kind: Kind, entry: Entry, context: &Context<'_>, effects: &mut Effects<'_>) {
        let counted = self.trail(kind, context).0.owe(context.now.wall, entry);
        if counted > 0 {
            effects.dli.counters.count("no room in the audit log");
        }
        if counted == 1 {
            let file = kind.file(context.id());
            let text = format!(
                "{file}: {MAX_OWED} lines wait for the disk; more are only counted, and their number is written to the log once \
                 the disk takes it"
            );
            effects.note(LogLevel::Warning, text);
        }
        self.owed_at = Some(context.mono() + TRY_AGAIN);
    }

    /// Stores what holds though the disk did not take it, as soon as it does: the lines of the logs, then the record. Until then a
    /// restart would return a right that was released, and so may its station have it again before that.
    pub(super) fn store_owed(
        &mut self,
        rights: &Authority,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) {
        if self.owed_at.is_none_or(|at| context.mono() < at) {
            return;
        }
        self.owed_at = match self.store(rights, Durability::Power, context, effects) {
            // Operators were alerted when it began.
            Err(_) => Some(context.mono() + TRY_AGAIN),
            Ok(()) => {
                effects.clear(Cause::Store, "authority is stored again");
                None
            }
        };
    }

    /// Whether a restart finds every right that a decision gives: it gives none, or only what the record still has, because a disk
    /// without room has not taken that it ended.
    pub(super) fn has_what_is_given(&self, decision: &Decision, disk: &dyn Disk) -> bool {
        let (stored, change) = &self.stored;
        let had = |id| {
            let held = stored.held(id);
            // Any right implies LOI 2.
            if held.is_empty() {
                held
            } else {
                held.with(Rights::monitor())
            }
        };
        let is_there = || disk.progress(*change) == Progress::Durable;
        let may_be_owed = self.control.has_room() && self.monitors.has_room();
        let has = |one: &Change| {
            let is_had = |to| may_be_owed && had(to).contains(one.gained) && is_there();
            one.to.is_none_or(is_had)
        };
        decision.begun.is_empty() && decision.changes.iter().all(has)
    }

    /// Stores whether the silence of a holder counts (it has sent heartbeats), and its proven address. After a restart its
    /// silence is still detected, and status is sent there.
    pub(super) fn store_station(
        &mut self,
        rights: &Authority,
        station: &GroundStation,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) {
        if self.owed_at.is_some() {
            // It is stored with the rest, once the disk takes that.
            return;
        }
        let id = station.id();
        let beats = station.sends_heartbeats != self.beats.contains(&id);
        // Do not store an unproven address: anyone could change it a thousand times a second.
        let here = station.peer.map(|peer| (peer, station.ed25_version()));
        let moved = station.proven && self.places.get(&id).copied() != here;
        let durability = match (beats, moved) {
            (true, _) => Durability::Power,
            (false, true) => Durability::Answered,
            (false, false) => return,
        };
        if let Err(fault) = self.store(rights, durability, context, effects) {
            effects.warn(Cause::Store, format!("authority cannot be stored: {fault}"));
            self.owed_at = Some(context.mono() + TRY_AGAIN);
        }
    }

    /// Restores the rights and the information about their holders after a restart.
    ///
    /// # Errors
    /// A record exists and cannot be read.
    pub(super) fn restore(
        &mut self,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<(Authority, Vec<KnownStation>), StoreError> {
        let Some(stored) = effects.disk().load::<Stored>(&context.id())? else {
            return Ok((Authority::default(), Vec::new()));
        };
        let rights = Authority::restored(&stored.authority, context.mono(), &context.keepers());
        self.stored = (rights.clone(), Changes::NONE);
        let mut known = Vec::new();
        for holder in &stored.holders {
            let id = Id(holder.id);
            if !rights.held(id).is_empty() {
                self.since
                    .insert(id, Duration::from_millis(holder.since_ms));
            }
            known.push(KnownStation {
                id,
                sends_heartbeats: holder.beats,
                peer: holder.peer,
                proven: holder.proven,
                shown: holder.shown.clone(),
            });
        }
        Ok((rights, known))
    }

    /// Verifies the audit logs and continues them. A fault raises an alert; the vehicle is still served.
    ///
    /// # Errors
    /// A log or the key exists and cannot be read, or the line of this start, or the record of it, cannot be written.
    pub(super) fn restore_audit(
        &mut self,
        rights: &Authority,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        let vehicle = context.id();
        self.key = AuditKey::load(effects.disk())?;
        let key = self.key.as_ref();
        let mut faults = Vec::new();
        for found in examine_both(vehicle, key, &[], effects.disk())? {
            let kind = found.kind;
            for finding in &found.findings {
                effects.warn(Cause::Audit, format!("the audit log {finding}"));
                faults.push(Entry::Fault(finding.to_string()));
            }
            let trail = match kind {
                Kind::Control => &mut self.control,
                Kind::Monitors => &mut self.monitors,
            };
            trail.restore(&found, effects.disk())?;
            if trail.begins_to_be_keyed(key) {
                let file = kind.file(vehicle);
                let text =
                    format!("the audit log {file} of an earlier version is continued by a key");
                effects.note(LogLevel::Warning, text);
            }
        }
        let started = Entry::Started(rights.holders().collect());
        let power = Durability::Power;
        if self.key.is_some() && !self.control.is_keyed() {
            // The end before the first line by the key: a process that is killed between that and the record would leave a log that
            // looks as if its end had been taken from the record.
            self.store(rights, power, context, effects)?;
        }
        for fault in &faults {
            self.write_audit(Kind::Control, fault, power, context, effects)?;
        }
        self.write_audit(Kind::Control, &started, power, context, effects)?;
        match self.key {
            // Synchronise, so that this line cannot be cut off either.
            Some(_) => self.store(rights, power, context, effects),
            None => Ok(()),
        }
    }

    /// Writes the counted changes of monitors when they are due.
    pub(super) fn write_repetitions(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        while let Some(entry) = self.repetitions.due(context.mono()) {
            let answered = Durability::Answered;
            if self
                .write_audit(Kind::Monitors, &entry, answered, context, effects)
                .is_err()
            {
                // They are written with the next line; a full disk has its own alerts.
                return self.repetitions.failed(&entry);
            }
        }
    }

    /// Writes the outcome of a flight termination. Returns the disk change that will make it durable.
    ///
    /// # Errors
    /// It could not be written; it is once the disk takes it, see [`AuthorityRecord::store_owed`].
    pub(super) fn write_termination(
        &mut self,
        what: &'static str,
        by: Option<Id>,
        why: &str,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<Changes, StoreError> {
        let after = effects.disk().queued();
        let why = why.to_owned();
        let entry = Entry::Termination { what, by, why };
        let written = self.write_audit(Kind::Control, &entry, Durability::Power, context, effects);
        if let Err(fault) = written {
            self.owe(Kind::Control, entry, context, effects);
            return Err(fault);
        }
        let until = effects.disk().queued();
        Ok(Changes { after, until })
    }

    /// When [`AuthorityRecord::write_repetitions`] or [`AuthorityRecord::store_owed`] is next needed.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        let repetitions = self.repetitions.poll_timeout();
        repetitions.into_iter().chain(self.owed_at).min()
    }

    fn store(
        &mut self,
        rights: &Authority,
        durability: Durability,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        // Whatever leads to it: the record never has a change without its line.
        for kind in Kind::ALL {
            let (trail, at) = self.trail(kind, context);
            trail.write_owed(&at, effects.disk())?;
        }
        // The parties of a handover are notified of its end, also after a restart.
        let parties = rights
            .pending()
            .iter()
            .flat_map(|handover| handover.from.into_iter().chain([handover.to]));
        let known: BTreeSet<Id> = parties.chain(rights.holders().map(|(id, _)| id)).collect();
        let holders = known.into_iter().map(|id| {
            let station = context.stations.iter().find(|station| station.id() == id);
            let since = self.since(id).unwrap_or(context.now.wall);
            Holder {
                id: id.0,
                since_ms: u64::try_from(since.as_millis()).unwrap_or(u64::MAX),
                beats: station.is_some_and(|station| station.sends_heartbeats),
                peer: station.and_then(|station| station.peer),
                proven: station.is_some_and(|station| station.proven),
                shown: station.map(GroundStation::shown).unwrap_or_default(),
            }
        });
        let holders: Vec<Holder> = holders.collect();
        let beats = holders.iter().filter(|holder| holder.beats);
        let beats: BTreeSet<Id> = beats.map(|holder| Id(holder.id)).collect();
        let places: BTreeMap<_, _> = (holders.iter().filter(|holder| holder.proven))
            .filter_map(|holder| {
                let version = holder.shown.ed25.as_deref().and_then(Version::from_text);
                Some((Id(holder.id), (holder.peer?, version)))
            })
            .collect();
        let (vehicle, key) = (context.id(), self.key.as_ref());
        let stored = Stored {
            authority: rights.record(),
            holders,
            audit: self.control.head(vehicle, key),
            monitors: self.monitors.head(vehicle, key),
        };
        let disk = effects.disk();
        let after = disk.queued();
        disk.save_as(&context.id(), &stored, durability)?;
        let until = disk.queued();
        (self.beats, self.places) = (beats, places);
        self.stored = (rights.clone(), Changes { after, until });
        Ok(())
    }

    fn write_audit(
        &mut self,
        kind: Kind,
        entry: &Entry,
        durability: Durability,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        let (trail, at) = self.trail(kind, context);
        trail.write(entry, durability, &at, effects.disk())
    }

    fn trail(&mut self, kind: Kind, context: &Context<'_>) -> (&mut Trail, Place<'_>) {
        let at = Place {
            vehicle: context.id(),
            wall: context.now.wall,
            key: self.key.as_ref(),
        };
        let trail = match kind {
            Kind::Control => &mut self.control,
            Kind::Monitors => &mut self.monitors,
        };
        (trail, at)
    }
}

/// Verifies a vehicle's logs for `vsm audit verify`, in a store that another process may be using.
///
/// # Errors
/// A file exists but cannot be read.
pub(crate) fn examine(
    vehicle: Id,
    digits: &[String],
    disk: &dyn Disk,
) -> Result<Vec<Examined>, StoreError> {
    let key = AuditKey::load(disk)?;
    let mut all = examine_both(vehicle, key.as_ref(), digits, disk)?;
    if all.iter().any(|found| !found.findings.is_empty()) {
        // A file that was put aside meanwhile looks like one that is deleted. What is wrong is found again.
        all = examine_both(vehicle, key.as_ref(), digits, disk)?;
    }
    for found in &mut all {
        // At a start this may be the log of an earlier version; since then it has been continued with the key.
        let is_due = found.kind == Kind::Control || found.chain.lines() > 0;
        if key.is_some() && is_due && found.chain.keyed().is_none() {
            let file = found.kind.file(vehicle);
            let fault = Fault::NotKeyed;
            found.findings.push(Finding { file, fault });
        }
    }
    Ok(all)
}

/// Examines both logs, by the ends that the record has of them.
fn examine_both(
    vehicle: Id,
    key: Option<&AuditKey>,
    digits: &[String],
    disk: &dyn Disk,
) -> Result<Vec<Examined>, StoreError> {
    // The record first: a log that is longer than recorded is being written.
    let stored = disk.load::<Stored>(&vehicle)?;
    let has_record = stored.is_some();
    let (control, monitors) = stored.map_or((None, None), |one| (one.audit, one.monitors));
    let has_an_end = control.is_some() || monitors.is_some();
    let mut all = Vec::new();
    for (kind, head) in [(Kind::Control, control), (Kind::Monitors, monitors)] {
        let mut found = trail::examine(kind, vehicle, key, head.as_ref(), digits, disk)?;
        // Both ends are recorded at once, and no record is made before the first line of control but one with both. A keyed log
        // without its end is found above; here it is deleted, or rewritten without a key, too.
        let (lines, is_keyed) = (found.chain.lines(), found.chain.keyed().is_some());
        let is_due = has_an_end || kind == Kind::Control && has_record && lines == 0;
        if key.is_some() && head.is_none() && is_due && !is_keyed {
            let file = kind.file(vehicle);
            let fault = Fault::NoHead;
            found.findings.push(Finding { file, fault });
        }
        all.push(found);
    }
    Ok(all)
}

/// Rights and requests that must survive a power cut: every right to command, and every request for one. LOI 2 commands
/// nothing and may be requested and released at any rate: synchronising the disk for it would let one station slow down all
/// others, and so would writing it while they wait.
pub(super) fn durability(decision: &Decision) -> Durability {
    let commands = |rights: Rights| !rights.without(Rights::monitor()).is_empty();
    let weighs = |change: &Change| commands(change.lost) || commands(change.gained);
    let status_only = !decision.changes.is_empty()
        && decision.begun.is_empty()
        && decision.ended.is_empty()
        && !decision.changes.iter().any(weighs);
    if status_only {
        Durability::Answered
    } else {
        Durability::Power
    }
}

/// Maximum number of messages of one station that wait for a decision about a vehicle.
const MAX_WAITING: usize = 16;
/// How often it is tried again to store what holds.
const TRY_AGAIN: Duration = Duration::from_secs(1);

#[cfg(test)]
mod tests {
    use std::cell::{Cell, RefCell};
    use std::rc::Rc;

    use mavlink_link::store::MemoryDisk;
    use stanag_msgs::enums::LoiBitmap;
    use stanag_msgs::messages::CucsAuthorisationRequest;
    use stanag_msgs::{Message, TimeStamp};
    use zeroize::Zeroizing;

    use super::super::audit::{AUDIT_KEY, Chain};
    use super::super::rules::Reason;
    use super::*;
    use crate::session::log::LogEntry;
    use crate::session::testing::{CUCS, VEHICLE, World, origin};

    fn gains(gained: Rights) -> Change {
        Change {
            from: None,
            lost: Rights::NONE,
            to: Some(CUCS),
            gained,
            why: Reason::Requested,
        }
    }

    /// A decision with lines in both logs.
    fn of_both() -> Decision {
        Decision {
            changes: vec![
                gains(Rights::of_control(LoiBitmap::LOI4)),
                gains(Rights::monitor()),
            ],
            ..Decision::default()
        }
    }

    fn disk(full: Option<&'static str>) -> MemoryDisk {
        MemoryDisk {
            full,
            ..MemoryDisk::default()
        }
    }

    fn store(world: &mut World, record: &mut AuthorityRecord, stands: bool) {
        let stored = world.act(|context, _, effects| {
            let rights = Authority::default();
            record.store_decision(&rights, &of_both(), stands, &context, effects)
        });
        stored.expect_err("the disk is full");
    }

    /// Whether each line of a log is a retraction.
    fn lines(world: &mut World, kind: Kind) -> Vec<bool> {
        world.act(|context, _, effects| {
            let bytes = effects.disk().read(&kind.file(context.id()), 1 << 20);
            let bytes = bytes.expect("it is read").unwrap_or_default();
            let text = String::from_utf8_lossy(&bytes);
            text.lines().map(|line| line.contains("not kept")).collect()
        })
    }

    #[test]
    fn both_logs_record_that_a_decision_is_not_in_effect() {
        for stands in [false, true] {
            let (mut world, mut record) = (World::new(), AuthorityRecord::default());
            world.disk = Box::new(disk(Some("authority")));
            store(&mut world, &mut record, stands);
            let expected: &[bool] = if stands { &[false] } else { &[false, true] };
            for kind in Kind::ALL {
                assert_eq!(lines(&mut world, kind), expected, "{}", kind.name());
            }
        }
    }

    #[test]
    fn no_line_by_the_key_comes_before_a_record_of_where_the_log_ends() {
        let (mut world, mut record) = (World::new(), AuthorityRecord::default());
        let mut full = disk(Some("authority"));
        let key = "5a".repeat(32).into_bytes();
        full.records.insert(AUDIT_KEY.to_owned(), key);
        world.disk = Box::new(full);
        let stored = world.act(|context, _, effects| {
            record.restore_audit(&Authority::default(), &context, effects)
        });
        stored.expect_err("the disk is full");
        // A process that was killed here leaves nothing that looks like a record without its end.
        assert!(lines(&mut world, Kind::Control).is_empty());
    }

    /// A disk on which the control log is put aside once, just after its place for that was read.
    struct Rotating {
        disk: RefCell<MemoryDisk>,
        is_rotated: Rc<Cell<bool>>,
    }

    impl Disk for Rotating {
        fn read(
            &self,
            name: &str,
            max_bytes: u64,
        ) -> Result<Option<Zeroizing<Vec<u8>>>, StoreError> {
            let read = self.disk.borrow().read(name, max_bytes);
            let log = Kind::Control.file(VEHICLE);
            if name == format!("{log}.1") && !self.is_rotated.replace(true) {
                self.disk.borrow_mut().rotate(&log, 8)?;
            }
            read
        }

        fn replace(
            &mut self,
            name: &str,
            bytes: &[u8],
            durability: Durability,
        ) -> Result<(), StoreError> {
            self.disk.get_mut().replace(name, bytes, durability)
        }

        fn append(
            &mut self,
            name: &str,
            bytes: &[u8],
            durability: Durability,
        ) -> Result<(), StoreError> {
            self.disk.get_mut().append(name, bytes, durability)
        }

        fn rename(&mut self, from: &str, to: &str) -> Result<(), StoreError> {
            self.disk.get_mut().rename(from, to)
        }

        fn remove(&mut self, name: &str) -> Result<(), StoreError> {
            self.disk.get_mut().remove(name)
        }
    }

    #[test]
    fn a_log_that_is_put_aside_while_it_is_verified_is_whole() {
        let (mut world, mut record) = (World::new(), AuthorityRecord::default());
        let mut memory = disk(None);
        let key = "5a".repeat(32).into_bytes();
        memory.records.insert(AUDIT_KEY.to_owned(), key);
        let is_rotated = Rc::new(Cell::new(true));
        world.disk = Box::new(Rotating {
            disk: RefCell::new(memory),
            is_rotated: is_rotated.clone(),
        });
        let stored = world.act(|context, _, effects| {
            record.restore_audit(&Authority::default(), &context, effects)
        });
        stored.expect("stored");
        is_rotated.set(false);
        let all = examine(VEHICLE, &[], &*world.disk).expect("it is read");
        assert!(is_rotated.get());
        assert!(all.iter().all(|one| one.findings.is_empty()), "{all:?}");
    }

    #[test]
    fn a_retraction_that_finds_no_room_comes_before_the_next_line() {
        let (mut world, mut record) = (World::new(), AuthorityRecord::default());
        // The line of the control log is written, that of the monitors' log is not.
        world.disk = Box::new(disk(Some("audit-monitors")));
        store(&mut world, &mut record, false);
        assert_eq!(lines(&mut world, Kind::Control), [false, true]);
        assert!(lines(&mut world, Kind::Monitors).is_empty());

        let (mut world, mut record) = (World::new(), AuthorityRecord::default());
        world.disk = Box::new(disk(None));
        let at = Place {
            vehicle: VEHICLE,
            wall: world.now.wall,
            key: None,
        };
        let change = Entry::Change(gains(Rights::of_control(LoiBitmap::LOI4)));
        let (trail, power) = (&mut record.control, Durability::Power);
        trail
            .write(&change, power, &at, &mut *world.disk)
            .expect("written");
        let mut full = disk(Some(""));
        trail.retract(&at, &mut full);
        trail
            .write(&change, power, &at, &mut *world.disk)
            .expect("written");
        assert_eq!(lines(&mut world, Kind::Control), [false, true, false]);
    }

    #[test]
    fn a_message_beyond_those_that_wait_for_a_decision_takes_the_place_of_the_oldest_of_its_station()
     {
        let mut record = AuthorityRecord::default();
        let request = Message::from(CucsAuthorisationRequest::default());
        let of = |stamp: u64| Origin {
            stamp: Some(TimeStamp(stamp)),
            ..origin(&request)
        };
        let other = Id(CUCS.0 + 1);
        assert_eq!(record.wait(other, of(1_000)), None);
        let full = MAX_WAITING as u64;
        for stamp in 0..full + 2 {
            let oldest = stamp.checked_sub(full).map(of);
            assert_eq!(record.wait(CUCS, of(stamp)), oldest, "{stamp}");
        }
        // The same message again takes no place.
        assert_eq!(record.wait(CUCS, of(full)), None);
        assert!(record.has_place(other) && !record.has_place(CUCS));
        let waits = |stamp| record.waiting.iter().any(|(_, one)| *one == of(stamp));
        assert!(!waits(0) && !waits(1));
        assert!(waits(2) && waits(full) && waits(full + 1) && waits(1_000));
    }

    #[test]
    fn lines_that_found_no_room_are_counted_by_one_line_and_the_chain_stays_whole() {
        let (mut world, mut record) = (World::new(), AuthorityRecord::default());
        world.disk = Box::new(disk(Some("audit")));
        record.key = Some(AuditKey::new([7; 32]));
        let order = |world: &mut World, record: &mut AuthorityRecord| {
            world.now.mono += Duration::from_secs(2);
            world.now.wall += Duration::from_secs(2);
            world.act(|context, _, effects| {
                record
                    .write_termination("termination ordered", Some(CUCS), "", &context, effects)
                    .is_ok()
            })
        };
        for _ in 0..MAX_OWED + 100 {
            assert!(!order(&mut world, &mut record), "the disk is full");
        }
        assert_eq!(world.counters.get("no room in the audit log"), 100);
        let said = |entry: &&LogEntry| entry.text.contains("wait for the disk");
        assert_eq!(world.log.iter().filter(said).count(), 1);

        // There is room again.
        let last = world.now.wall;
        world.disk = Box::new(disk(None));
        let at = Place {
            vehicle: VEHICLE,
            wall: last,
            key: record.key.as_ref(),
        };
        record
            .control
            .write_owed(&at, &mut *world.disk)
            .expect("written");
        assert!(order(&mut world, &mut record));
        let log = world.act(|context, _, effects| {
            let bytes = effects
                .disk()
                .read(&Kind::Control.file(context.id()), 1 << 20);
            bytes.expect("it is read").expect("it is there").to_vec()
        });
        let text = String::from_utf8_lossy(&log);
        // The first line names the key, the last one is of an order that found room.
        assert_eq!(text.lines().count(), 1 + MAX_OWED + 2, "{text}");
        let counting = text.lines().nth(1 + MAX_OWED).expect("a line");
        let first = last - Duration::from_secs(99 * 2);
        for expected in [
            "\"what\":\"not written\"".to_owned(),
            "\"not_written\":100".to_owned(),
            format!("\"time_ms\":{}", first.as_millis()),
            format!("\"until_ms\":{}", last.as_millis()),
        ] {
            assert!(counting.contains(&expected), "{expected}: {counting}");
        }
        let verified = Chain::verify(&log, record.key.as_ref());
        assert_eq!((verified.broken, verified.other_key), (None, None));
        let [(line, report)] = &verified.reported[..] else {
            panic!("{:?}", verified.reported);
        };
        assert_eq!(*line, 2 + MAX_OWED as u64);
        assert!(
            report.starts_with("not written: 100 lines, from "),
            "{report}"
        );
    }
}
