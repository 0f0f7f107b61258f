//! What belongs to the authority of one vehicle and is no right: since when, who waits for an answer, the audit log;
//! and how all of it is stored before it is answered.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use stanag_msgs::Id;

use super::aircraft::Aircraft;
use super::alerts::Cause;
use super::audit::{Broken, Chain, Entry};
use super::authority::{Authority, Change, Decision, Handover, Record, Rights};
use super::desk::{Desk, Origin};
use super::store::vehicle_record;
use mavlink_link::store::{Durability, Store as _, StoreError, log_name};

/// Beside the rights of one vehicle.
#[derive(Debug, Default)]
pub(crate) struct AuthorityRecord {
    /// When each holder last gained a right, since 1970.
    since: BTreeMap<Id, Duration>,
    /// Messages 1, 4 and 34000 that were answered with "received": what they asked for is not decided yet.
    waiting: Vec<(Id, Origin)>,
    /// Holders that have sent heartbeats, as stored: their silence counts after a restart too.
    beats: BTreeSet<Id>,
    audit: Chain,
    /// Length of the log that is written now; 0 where it is yet to begin.
    audit_bytes: usize,
}

impl AuthorityRecord {
    /// Since when, on the clock since 1970, a CUCS has held what it holds.
    pub(crate) fn since(&self, id: Id) -> Option<Duration> {
        self.since.get(&id).copied()
    }

    /// A message that asked for something is answered later.
    pub(super) fn wait(&mut self, asker: Id, origin: Origin) {
        self.waiting.retain(|(_, known)| *known != origin);
        if self.waiting.len() < MAX_WAITING {
            self.waiting.push((asker, origin));
        }
    }

    /// The messages to answer now that a handover has ended: those of its two parties that wait for no other.
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
}

vehicle_record!(Stored, "authority", Power);

/// What is known of a holder, or of who takes part in a handover, beside its rights.
#[derive(Serialize, Deserialize)]
struct Holder {
    id: u32,
    since_ms: u64,
    beats: bool,
    peer: Option<SocketAddr>,
}

impl Aircraft {
    /// Writes a decision down: its lines of the audit log first, then the record that a restart finds.
    pub(super) fn keep(
        &mut self,
        desk: &mut Desk<'_>,
        decision: &Decision,
    ) -> Result<(), StoreError> {
        let wall = desk.now.wall;
        let since = self.authority_record.since.clone();
        let durability = durability(decision);
        for change in &decision.changes {
            self.write_audit(desk, &Entry::Change(*change), durability)?;
            if let Some(to) = change.to {
                self.authority_record.since.insert(to, wall);
            }
        }
        let authority = &self.authority;
        self.authority_record
            .since
            .retain(|id, _| !authority.held(*id).is_empty());
        let kept = self.store_authority(desk, durability);
        if kept.is_ok()
            && let Some(cleared) = self
                .alerts
                .clear(Cause::Store, "what must be kept is stored again")
        {
            let listeners = desk.listeners(&self.authority, None);
            desk.alert(self.id(), &listeners, Some(cleared));
        }
        if kept.is_err() {
            self.authority_record.since = since;
            if !decision.changes.is_empty() {
                // The log says what holds: it says too that this does not.
                self.write_audit(desk, &Entry::NotKept, Durability::Power)?;
            }
        }
        kept
    }

    fn write_audit(
        &mut self,
        desk: &mut Desk<'_>,
        entry: &Entry,
        durability: Durability,
    ) -> Result<(), StoreError> {
        let name = audit_name(self.id());
        if self.authority_record.audit_bytes >= MAX_AUDIT_BYTES {
            desk.store.rotate(&name, MAX_AUDIT_LOGS)?;
            self.authority_record.audit_bytes = 0;
        }
        if self.authority_record.audit_bytes == 0 && self.authority_record.audit.lines() > 0 {
            self.write_line(desk, &name, &Entry::Continued, Durability::Power)?;
        }
        self.write_line(desk, &name, entry, durability)
    }

    fn write_line(
        &mut self,
        desk: &mut Desk<'_>,
        name: &str,
        entry: &Entry,
        durability: Durability,
    ) -> Result<(), StoreError> {
        let (chain, line) = self
            .authority_record
            .audit
            .extended(desk.now.wall, self.id(), entry);
        desk.store.append(name, line.as_bytes(), durability)?;
        self.authority_record.audit = chain;
        self.authority_record.audit_bytes += line.len();
        Ok(())
    }

    fn store_authority(
        &mut self,
        desk: &mut Desk<'_>,
        durability: Durability,
    ) -> Result<(), StoreError> {
        let pending = self.authority.pending().iter();
        let holders = self.authority.holders().map(|(id, _)| id);
        // Who takes part in a handover must hear of its end.
        let known: BTreeSet<Id> = pending
            .flat_map(|handover| handover.from.into_iter().chain([handover.to]))
            .chain(holders)
            .collect();
        let holders = known.into_iter().map(|id| {
            let station = desk.stations.iter().find(|station| station.id() == id);
            let since = self.authority_record.since(id).unwrap_or(desk.now.wall);
            Holder {
                id: id.0,
                since_ms: u64::try_from(since.as_millis()).unwrap_or(u64::MAX),
                beats: station.is_some_and(|station| station.sends_heartbeats),
                peer: station.and_then(|station| station.peer),
            }
        });
        let holders: Vec<Holder> = holders.collect();
        let beats = holders.iter().filter(|holder| holder.beats);
        self.authority_record.beats = beats.map(|holder| Id(holder.id)).collect();
        let stored = Stored {
            authority: self.authority.record(),
            holders,
        };
        desk.store.save_as(&self.id(), &stored, durability)
    }

    /// That a holder sends heartbeats is stored once: its silence counts after a restart too.
    pub(super) fn remember_heartbeats(&mut self, desk: &mut Desk<'_>, id: Id, beats: bool) {
        if !beats || self.authority_record.beats.contains(&id) {
            return;
        }
        if let Err(fault) = self.store_authority(desk, Durability::Power) {
            let text = format!("authority cannot be stored: {fault}");
            self.warn(desk, Cause::Store, text);
        }
    }

    /// What a restart finds of the authority.
    pub(super) fn restore_authority(&mut self, desk: &mut Desk<'_>) -> Result<(), StoreError> {
        let id = self.id();
        if let Some(stored) = desk.store.load::<Stored>(&id)? {
            for station in desk.stations.iter_mut() {
                let known = stored
                    .holders
                    .iter()
                    .find(|holder| holder.id == station.id().0);
                let Some(known) = known else { continue };
                // Status goes on to where it went before: nobody has to ask again.
                station.peer = station.peer.or(known.peer);
                if known.beats {
                    station.sends_heartbeats = true;
                    station.heard = station.heard.or(Some(desk.now.mono));
                }
                let since = Duration::from_millis(known.since_ms);
                self.authority_record.since.insert(station.id(), since);
            }
            self.authority = Authority::restored(&stored.authority, desk.now.mono, &desk.roster());
            let authority = &self.authority;
            self.authority_record
                .since
                .retain(|id, _| !authority.held(*id).is_empty());
        }
        self.restore_audit(desk)
    }

    /// Verifies the audit logs, and goes on with the last. A broken one is said aloud; the vehicle is served all the
    /// same.
    fn restore_audit(&mut self, desk: &mut Desk<'_>) -> Result<(), StoreError> {
        let name = audit_name(self.id());
        let mut before: Option<Chain> = None;
        for number in (0..=MAX_AUDIT_LOGS).rev() {
            let name = log_name(&name, number);
            let bytes = desk.store.read(&name, u64::MAX)?.unwrap_or_default();
            if bytes.is_empty() {
                continue;
            }
            let verified = Chain::verify(&bytes);
            // The oldest that is kept may follow one that is not.
            let follows = before.is_none_or(|before| before == verified.follows);
            let first = Broken {
                line: verified.follows.lines() + 1,
            };
            let broken = if follows {
                verified.broken
            } else {
                Some(first)
            };
            if let Some(broken) = broken {
                let text = format!("the audit log {name} is broken: {broken}");
                self.warn(desk, Cause::Audit, text);
            }
            if verified.torn {
                // What a crash cut off is closed, so that the next line is a line.
                desk.store.append(&name, b"\n", Durability::Power)?;
            }
            if number == 0 {
                self.authority_record.audit_bytes = bytes.len();
            }
            self.authority_record.audit = verified.chain.clone();
            before = Some(verified.chain);
        }
        let holders = self.authority.holders().collect();
        self.write_audit(desk, &Entry::Started(holders), Durability::Power)
    }
}

/// What must outlive a power cut: every right to command, and what is asked for it. LOI 2 commands nothing, and may be
/// asked for and given up as often as a CUCS likes.
fn durability(decision: &Decision) -> Durability {
    let commands = |rights: Rights| !rights.without(Rights::monitor()).is_empty();
    let weighs = |change: &Change| commands(change.lost) || commands(change.gained);
    let status_only = !decision.changes.is_empty()
        && decision.begun.is_empty()
        && decision.ended.is_empty()
        && !decision.changes.iter().any(weighs);
    if status_only {
        Durability::Process
    } else {
        Durability::Power
    }
}

fn audit_name(vehicle: Id) -> String {
    format!("audit-{:08x}.log", vehicle.0)
}

/// Messages that wait for a decision at most, of a vehicle.
const MAX_WAITING: usize = 64;
/// A log of this length is put aside.
const MAX_AUDIT_BYTES: usize = 1 << 20;
/// Logs that are kept beside the one that is written, some four thousand changes each.
const MAX_AUDIT_LOGS: u32 = 8;
