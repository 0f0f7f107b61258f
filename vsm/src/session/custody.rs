//! What belongs to the authority of one vehicle and is no right: since when, who waits for an answer, the audit log;
//! and how all of it is stored before it is answered.

use std::collections::{BTreeMap, BTreeSet};
use std::net::SocketAddr;
use std::time::Duration;

use serde::{Deserialize, Serialize};
use stanag_msgs::Id;

use super::aircraft::Aircraft;
use super::alerts::Cause;
use super::audit::{Chain, Entry};
use super::authority::{Authority, Decision, Handover, Record};
use super::desk::{Desk, Origin};
use super::store::{Durability, StoreError, record_name};

/// Beside the rights of one vehicle.
#[derive(Debug, Default)]
pub(crate) struct Custody {
    /// When each holder last gained a right, since 1970.
    since: BTreeMap<Id, Duration>,
    /// Messages 1, 4 and 34000 that were answered with "received": what they asked for is not decided yet.
    waiting: Vec<(Id, Origin)>,
    /// Holders that have sent heartbeats, as stored: their silence counts after a restart too.
    beats: BTreeSet<Id>,
    audit: Chain,
}

impl Custody {
    /// Since when, on the clock since 1970, a CUCS has held what it holds.
    pub(crate) fn since(&self, id: Id) -> Option<Duration> {
        self.since.get(&id).copied()
    }

    /// A message that asked for something is answered later.
    pub(super) fn wait(&mut self, asker: Id, origin: Origin) {
        self.waiting.retain(|(_, known)| *known != origin);
        if self.waiting.len() < MOST_WAITING {
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
        let since = self.custody.since.clone();
        for change in &decision.changes {
            self.write_audit(desk, &Entry::Change(*change))?;
            if let Some(to) = change.to {
                self.custody.since.insert(to, wall);
            }
        }
        let authority = &self.authority;
        self.custody
            .since
            .retain(|id, _| !authority.held(*id).is_empty());
        let kept = self.store_authority(desk);
        if kept.is_ok()
            && let Some(cleared) = self
                .alerts
                .clear(Cause::Store, "what must be kept is stored again")
        {
            let listeners = desk.listeners(&self.authority, None);
            desk.alert(self.id(), &listeners, Some(cleared));
        }
        if kept.is_err() {
            self.custody.since = since;
            if !decision.changes.is_empty() {
                // The log says what holds: it says too that this does not.
                self.write_audit(desk, &Entry::NotKept)?;
            }
        }
        kept
    }

    fn write_audit(&mut self, desk: &mut Desk<'_>, entry: &Entry) -> Result<(), StoreError> {
        let name = audit_name(self.id());
        let (chain, line) = self.custody.audit.extended(desk.now.wall, self.id(), entry);
        desk.store.append(&name, line.as_bytes())?;
        self.custody.audit = chain;
        Ok(())
    }

    fn store_authority(&mut self, desk: &mut Desk<'_>) -> Result<(), StoreError> {
        let pending = self.authority.pending().iter();
        let holders = self.authority.holders().map(|(id, _)| id);
        // Who takes part in a handover must hear of its end.
        let known: BTreeSet<Id> = pending
            .flat_map(|handover| handover.from.into_iter().chain([handover.to]))
            .chain(holders)
            .collect();
        let holders = known.into_iter().map(|id| {
            let station = desk.stations.iter().find(|station| station.id() == id);
            let since = self.custody.since(id).unwrap_or(desk.now.wall);
            Holder {
                id: id.0,
                since_ms: u64::try_from(since.as_millis()).unwrap_or(u64::MAX),
                beats: station.is_some_and(|station| station.sends_heartbeats),
                peer: station.and_then(|station| station.peer),
            }
        });
        let holders: Vec<Holder> = holders.collect();
        let beats = holders.iter().filter(|holder| holder.beats);
        self.custody.beats = beats.map(|holder| Id(holder.id)).collect();
        let stored = Stored {
            authority: self.authority.record(),
            holders,
        };
        let octets = serde_json::to_vec(&stored).unwrap_or_default();
        desk.store.save(
            &record_name("authority", self.id()),
            &octets,
            Durability::Power,
        )
    }

    /// That a holder sends heartbeats is stored once: its silence counts after a restart too.
    pub(super) fn remember_heartbeats(&mut self, desk: &mut Desk<'_>, id: Id, beats: bool) {
        if !beats || self.custody.beats.contains(&id) {
            return;
        }
        if let Err(fault) = self.store_authority(desk) {
            let text = format!("authority cannot be stored: {fault}");
            self.warn(desk, Cause::Store, text);
        }
    }

    /// What a restart finds of the authority.
    pub(super) fn restore_authority(&mut self, desk: &mut Desk<'_>) -> Result<(), StoreError> {
        let id = self.id();
        let name = record_name("authority", id);
        let unreadable = |cause: serde_json::Error| StoreError {
            name: name.clone(),
            cause: cause.to_string(),
        };
        if let Some(octets) = desk.store.load(&name)? {
            let stored: Stored = serde_json::from_slice(&octets).map_err(unreadable)?;
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
                self.custody.since.insert(station.id(), since);
            }
            self.authority = Authority::restored(&stored.authority, desk.now.mono, &desk.roster());
            let authority = &self.authority;
            self.custody
                .since
                .retain(|id, _| !authority.held(*id).is_empty());
        }
        self.restore_audit(desk)
    }

    /// Verifies the audit log, and goes on with it. A broken one is said aloud; the vehicle is served all the same.
    fn restore_audit(&mut self, desk: &mut Desk<'_>) -> Result<(), StoreError> {
        let name = audit_name(self.id());
        let octets = desk.store.load_whole(&name)?.unwrap_or_default();
        let verified = Chain::verify(&octets);
        self.custody.audit = verified.chain;
        if let Some(break_) = verified.broken {
            let text = format!("the audit log {name} is broken: {break_}");
            self.warn(desk, Cause::Audit, text);
        }
        if verified.torn {
            // What a crash cut off is closed, so that the next line is a line.
            desk.store.append(&name, b"\n")?;
        }
        let holders = self.authority.holders().collect();
        self.write_audit(desk, &Entry::Started(holders))
    }
}

fn audit_name(vehicle: Id) -> String {
    format!("audit-{:08x}.log", vehicle.0)
}

/// Messages that wait for a decision at most, of a vehicle.
const MOST_WAITING: usize = 64;
