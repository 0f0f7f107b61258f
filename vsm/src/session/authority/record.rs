//! What is stored of the authority over one vehicle before it is answered: who holds what since when, and the audit log;
//! and the messages that wait for a decision.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::store::{Durability, Store as _, StoreError, log_name};
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;

use super::audit::{Broken, Chain, Entry};
use super::rules::{Authority, Change, Decision, Handover, Record, Rights};
use crate::session::alerts::Cause;
use crate::session::context::{Context, Origin};
use crate::session::effects::Effects;
use crate::session::station::GroundStation;
use crate::session::store::vehicle_record;

/// What is known of the holders of rights beside these, and the audit log.
#[derive(Debug, Default)]
pub(crate) struct AuthorityRecord {
    /// When each holder last gained a right, since 1970.
    since: BTreeMap<Id, Duration>,
    /// Messages 1, 4 and 34000 that were answered with "received": what they request is not decided yet.
    waiting: Vec<(Id, Origin)>,
    /// Holders that have sent heartbeats, as stored: their silence counts after a restart too.
    beats: BTreeSet<Id>,
    audit: Chain,
    /// Length of the audit log that is being written; 0 before its first line.
    audit_bytes: usize,
}

impl AuthorityRecord {
    /// Since when, on the clock since 1970, a CUCS has held what it holds.
    pub(crate) fn since(&self, id: Id) -> Option<Duration> {
        self.since.get(&id).copied()
    }

    /// A message that requests something is answered once that is decided.
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

/// A station as the record knows it from before a restart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct KnownStation {
    pub(crate) id: Id,
    pub(crate) sends_heartbeats: bool,
    pub(crate) peer: Option<SocketAddr>,
}

impl AuthorityRecord {
    /// Stores a decision that has led to `rights`: its lines of the audit log first, then the record that a restart
    /// finds.
    ///
    /// # Errors
    /// It could not be stored, and does not hold: the audit log says so, where it can still be written.
    pub(super) fn store_decision(
        &mut self,
        rights: &Authority,
        decision: &Decision,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        let since = self.since.clone();
        let durability = durability(decision);
        // The log before the record: a crash between them leaves a line too many, never a change without its line.
        for change in &decision.changes {
            self.write_audit(&Entry::Change(*change), durability, context, effects)?;
            if let Some(to) = change.to {
                self.since.insert(to, context.now.wall);
            }
        }
        self.since.retain(|id, _| !rights.held(*id).is_empty());
        let stored = self.store(rights, durability, context, effects);
        match &stored {
            Ok(()) => effects.clear(Cause::Store, "authority is stored again"),
            Err(_) => {
                self.since = since;
                if !decision.changes.is_empty() {
                    // The log has the changes already: it must say too that they do not hold.
                    self.write_audit(&Entry::NotKept, Durability::Power, context, effects)?;
                }
            }
        }
        stored
    }

    /// Stores once that a holder sends heartbeats: its silence counts after a restart too.
    pub(super) fn store_heartbeats(
        &mut self,
        rights: &Authority,
        station: &GroundStation,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) {
        if !station.sends_heartbeats || self.beats.contains(&station.id()) {
            return;
        }
        if let Err(fault) = self.store(rights, Durability::Power, context, effects) {
            effects.warn(Cause::Store, format!("authority cannot be stored: {fault}"));
        }
    }

    /// What a restart finds: the rights, and what is known of their holders.
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
        let rights = Authority::restored(&stored.authority, context.mono(), &context.roster());
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
            });
        }
        Ok((rights, known))
    }

    /// Verifies the audit logs and continues the last. A broken one raises an alert; the vehicle is served all the same.
    ///
    /// # Errors
    /// A log exists and cannot be read, or the line of this start cannot be written.
    pub(super) fn restore_audit(
        &mut self,
        rights: &Authority,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        let name = audit_name(context.id());
        let mut before: Option<Chain> = None;
        // The oldest first: each log is checked against the end of the one before it.
        for number in (0..=MAX_AUDIT_LOGS).rev() {
            let name = log_name(&name, number);
            let bytes = effects.disk().read(&name, u64::MAX)?.unwrap_or_default();
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
                effects.warn(Cause::Audit, text);
            }
            if verified.torn {
                // What a crash cut off is closed, so that the next line is a line.
                effects.disk().append(&name, b"\n", Durability::Power)?;
            }
            if number == 0 {
                self.audit_bytes = bytes.len();
            }
            self.audit = verified.chain.clone();
            before = Some(verified.chain);
        }
        let started = Entry::Started(rights.holders().collect());
        self.write_audit(&started, Durability::Power, context, effects)
    }

    fn store(
        &mut self,
        rights: &Authority,
        durability: Durability,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        // Who takes part in a handover is sent how it ends, after a restart too.
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
            }
        });
        let holders: Vec<Holder> = holders.collect();
        let beats = holders.iter().filter(|holder| holder.beats);
        self.beats = beats.map(|holder| Id(holder.id)).collect();
        let stored = Stored {
            authority: rights.record(),
            holders,
        };
        effects.disk().save_as(&context.id(), &stored, durability)
    }

    fn write_audit(
        &mut self,
        entry: &Entry,
        durability: Durability,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        let name = audit_name(context.id());
        if self.audit_bytes >= MAX_AUDIT_BYTES {
            effects.disk().rotate(&name, MAX_AUDIT_LOGS)?;
            self.audit_bytes = 0;
        }
        // After a rotation, and after a start that found rotated logs only.
        if self.audit_bytes == 0 && self.audit.lines() > 0 {
            self.write_line(
                &name,
                &Entry::Continued,
                Durability::Power,
                context,
                effects,
            )?;
        }
        self.write_line(&name, entry, durability, context, effects)
    }

    fn write_line(
        &mut self,
        name: &str,
        entry: &Entry,
        durability: Durability,
        context: &Context<'_>,
        effects: &mut Effects<'_>,
    ) -> Result<(), StoreError> {
        let (chain, line) = self.audit.extended(context.now.wall, context.id(), entry);
        effects.disk().append(name, line.as_bytes(), durability)?;
        // Only once the line is written: a failed write leaves no gap in the chain.
        self.audit = chain;
        self.audit_bytes += line.len();
        Ok(())
    }
}

/// What must outlive a power cut: every right to command, and every request for one. LOI 2 commands nothing, and may be
/// requested and released as often as a CUCS likes: synchronising the disk for it would let a station slow down all others.
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
/// A log of this length is rotated.
const MAX_AUDIT_BYTES: usize = 1 << 20;
/// Logs that are kept beside the one that is written, some four thousand changes each.
const MAX_AUDIT_LOGS: u32 = 8;
