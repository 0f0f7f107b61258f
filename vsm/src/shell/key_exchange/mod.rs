//! The ground side of the key exchange inside `vsm run`: the machine, its disk and its random source, beside the bridge
//! that carries its messages.
//!
//! The bridge goes on under its current key whatever happens here; a key that is agreed waits as `next` until the
//! vehicle signs with it.

mod disk;
mod telling;

pub(super) use disk::{Disk, memory};

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::exchange::{
    Identity, Initiator, InitiatorConfig, Legacy, Node, Parties, Trust, Wanted,
};
use mavlink_link::signing::KeyId;
use stanag_msgs::Id;
use stanag_msgs::enums::AlertPriority;

use super::disk::FileDisk;
use super::exchange_record::{self, ExchangeRecord, system_random};
use super::key_store::KeyStore;
use super::server::NOT_BEFORE;
use crate::config::{Config, Exchange, ExchangeMode, Vehicle};
use crate::session::{Bridge, ExchangeNotice, Peer};

/// The exchange of one vehicle.
#[derive(Debug)]
pub struct KeyExchange {
    index: usize,
    vehicle: Id,
    settings: Exchange,
    parties: Parties,
    machine: Machine,
    record: ExchangeRecord,
    /// From where a message of the agent came last: the vehicle's link may not have a peer yet.
    heard_from: Option<Peer>,
    look_at: Duration,
    /// When an exchange that was rolled back may be tried again.
    again_at: Duration,
    state: String,
    /// The key in force has been seen in use, in this run or by what the store says.
    settled: bool,
}

#[derive(Debug)]
enum Machine {
    /// No agent is paired.
    Unpaired,
    Paired(Box<Initiator>),
    Legacy(Box<Legacy>),
}

/// What an exchange works with for one call.
pub struct Surroundings<'a> {
    /// The bridge.
    pub bridge: &'a mut Bridge,
    /// The records.
    pub store: &'a mut FileDisk,
    /// The key files.
    pub keys: &'a KeyStore,
}

impl KeyExchange {
    /// The exchange of a vehicle, where its configuration wants one.
    ///
    /// # Errors
    /// A record cannot be read.
    pub fn open(
        config: &Config,
        vehicle: &Vehicle,
        index: usize,
        settings: Exchange,
        now: Now,
        with: &mut Surroundings<'_>,
    ) -> Result<KeyExchange, mavlink_link::store::StoreError> {
        let record = ExchangeRecord::load(with.store, vehicle.id)?;
        let current = with.keys.current().ok().flatten().map(|key| key.id());
        let settled = current.is_some_and(|id| record.key == Some(*id.bytes()));
        let parties = parties(config, vehicle, settings);
        let machine = match settings.mode {
            ExchangeMode::Legacy => {
                let identity = fresh_identity()?;
                let legacy = Legacy::new(identity, parties.responder, now.mono);
                Machine::Legacy(Box::new(legacy))
            }
            _ => Machine::Unpaired,
        };
        let mut exchange = KeyExchange {
            index,
            vehicle: vehicle.id,
            settings,
            parties,
            machine,
            record,
            heard_from: None,
            look_at: now.mono,
            again_at: now.mono,
            state: "idle".to_owned(),
            settled,
        };
        with.bridge.want_key_exchange(index);
        exchange.pair(now, with)?;
        exchange.announce(now, with);
        Ok(exchange)
    }

    /// With an agent that is paired, the initiator.
    fn pair(
        &mut self,
        now: Now,
        with: &mut Surroundings<'_>,
    ) -> Result<(), mavlink_link::store::StoreError> {
        let (Machine::Unpaired, Some(peer)) = (&self.machine, self.record.peer()) else {
            return Ok(());
        };
        let config = InitiatorConfig {
            parties: self.parties,
            identity: exchange_record::identity(with.store)?,
            trust: Trust::Pinned(peer),
            wanted: WANTED,
        };
        let memory = memory(&self.record, with.keys);
        let mut initiator = Initiator::new(config, memory, now.mono);
        if memory.next.is_some() {
            // Nobody knows what became of it: the agent does.
            initiator.want();
        }
        self.machine = Machine::Paired(Box::new(initiator));
        Ok(())
    }

    /// Does what is due, and what has come in. Called after everything that the bridge does.
    pub fn step(&mut self, now: Now, with: &mut Surroundings<'_>) {
        self.settled |= with.bridge.proven_key(self.index).is_some();
        while let Some(frame) = with.bridge.poll_key_exchange(self.index) {
            let header = frame.header;
            let source = Node {
                system: header.system_id,
                component: header.component_id,
            };
            if source == self.parties.responder {
                self.heard_from = Some(frame.from);
            }
            self.take(now, source, frame.payload(), with);
        }
        if now.mono >= self.look_at {
            self.look_at = now.mono.saturating_add(LOOK_EVERY);
            self.look(now, with);
        }
        let mut disk = Disk {
            store: with.store,
            keys: with.keys,
            record: &mut self.record,
            vehicle: self.vehicle,
        };
        match &mut self.machine {
            Machine::Unpaired => {}
            Machine::Legacy(legacy) => {
                let due = legacy.poll_transmit(now.mono);
                // A peer that heard this run's public key would leave the key in force.
                if let Some(payload) = due.filter(|_| !self.settled) {
                    self.send(now, &payload, with);
                }
            }
            Machine::Paired(initiator) => {
                initiator.handle_timeout(now, &mut system_random, &mut disk);
                while let Some(message) = initiator.poll_transmit() {
                    with.bridge.send_key_exchange(
                        self.index,
                        now,
                        &message.to_payload(),
                        self.heard_from,
                        with.store,
                    );
                }
            }
        }
        self.report(now, with);
    }

    fn send(&self, now: Now, payload: &[u8], with: &mut Surroundings<'_>) {
        with.bridge
            .send_key_exchange(self.index, now, payload, self.heard_from, with.store);
    }

    fn take(&mut self, now: Now, source: Node, payload: &[u8], with: &mut Surroundings<'_>) {
        let mut disk = Disk {
            store: with.store,
            keys: with.keys,
            record: &mut self.record,
            vehicle: self.vehicle,
        };
        match &mut self.machine {
            Machine::Unpaired => {}
            Machine::Paired(initiator) => {
                // Counted there.
                let _ = initiator.handle(now, source, payload, &mut disk);
            }
            // Anyone can have sent it: it brings a first key, and replaces none that the vehicle signs with.
            Machine::Legacy(_) if self.settled => {}
            Machine::Legacy(legacy) => {
                let Ok(key) = legacy.handle(source, payload) else {
                    return;
                };
                let id = key.id();
                match with.keys.restage(&key) {
                    Ok(()) => {
                        self.offer(now, with);
                        let text = format!("key {id} is agreed by the legacy exchange");
                        self.once(now, AlertPriority::Warning, text, with);
                    }
                    Err(fault) => self.once(now, AlertPriority::Caution, fault.to_string(), with),
                }
            }
        }
    }

    /// What the passing of time makes due.
    fn look(&mut self, now: Now, with: &mut Surroundings<'_>) {
        let wall_s = now.wall.as_secs();
        if let Some(proven) = with.bridge.proven_key(self.index) {
            self.prove_pairing(now, proven, with);
            if self.record.note_key(proven, wall_s)
                && let Err(fault) = self.record.save(with.store, self.vehicle)
            {
                tracing::warn!("the age of the key is not kept: {fault}");
            }
        }
        let age = Duration::from_secs(wall_s.saturating_sub(self.record.since));
        let life = Duration::from_secs_f64(self.settings.rotate_days * 86_400.0);
        let old = self.record.key.is_some() && age >= life;
        if let Machine::Paired(initiator) = &mut self.machine
            && old
            && !initiator.is_busy()
            && initiator.memory().next.is_none()
            && now.mono >= self.again_at
        {
            initiator.want();
            let days = age.as_secs_f64() / 86_400.0;
            let text = format!(
                "the signing key is {days:.1} days old: another is being agreed about, this one stays in use until then"
            );
            self.once(now, AlertPriority::Nominal, text, with);
        }
    }

    /// A pairing that was answered and not confirmed is proven by a frame of the vehicle under its key.
    fn prove_pairing(&mut self, now: Now, proven: KeyId, with: &mut Surroundings<'_>) {
        let pending = self.record.pending.as_ref();
        let Some(pending) = pending.filter(|pending| pending.key == Some(*proven.bytes())) else {
            return;
        };
        let mut record = self.record.clone();
        (record.peer, record.pending) = (pending.peer, None);
        if let Err(fault) = record.save(with.store, self.vehicle) {
            tracing::warn!("the pairing is not kept: {fault}");
            return;
        }
        self.record = record;
        if let Err(fault) = self.pair(now, with) {
            tracing::error!("{fault}");
        }
        self.tell(
            now,
            ExchangeNotice::Over("the air-side agent is paired"),
            with,
        );
    }

    /// The vehicle signs with the next key, and it is the current one on disk.
    pub fn key_in_use(&mut self, now: Now, with: &mut Surroundings<'_>) {
        if let Machine::Paired(initiator) = &mut self.machine {
            let mut disk = Disk {
                store: with.store,
                keys: with.keys,
                record: &mut self.record,
                vehicle: self.vehicle,
            };
            // A paired initiator has nothing to store here.
            let _ = initiator.key_in_use(&mut disk);
        }
        if let Ok(Some(key)) = with.keys.current() {
            let id = key.id();
            self.once(
                now,
                AlertPriority::Nominal,
                format!("the vehicle signs with the new key {id}"),
                with,
            );
        }
        if !matches!(self.machine, Machine::Legacy(_)) {
            self.tell(now, ExchangeNotice::Over("the new key is in use"), with);
        }
        self.look_at = now.mono;
    }

    /// The next key on disk is looked for in the vehicle's frames.
    fn offer(&mut self, now: Now, with: &mut Surroundings<'_>) {
        let offered = match with.keys.next() {
            Ok(Some(next)) => with
                .bridge
                .offer_next_key(self.index, next, now, NOT_BEFORE, with.store),
            Ok(None) => return,
            Err(fault) => {
                tracing::error!("{fault}");
                return;
            }
        };
        if let Err(fault) = offered {
            tracing::error!("the agreed key cannot be used before a restart: {fault}");
        }
    }

    /// When [`KeyExchange::step`] is next needed.
    #[must_use]
    pub fn poll_timeout(&self) -> Duration {
        let machine = match &self.machine {
            Machine::Unpaired => None,
            Machine::Paired(initiator) => initiator.poll_timeout(),
            Machine::Legacy(legacy) => Some(legacy.poll_timeout()),
        };
        machine.unwrap_or(Duration::MAX).min(self.look_at)
    }

    /// Takes up a key that an earlier process agreed about and that is not known to be in use.
    pub fn take_up_next(&mut self, now: Now, with: &mut Surroundings<'_>) {
        self.offer(now, with);
    }
}

/// Both ends' ids, as they go into the exchange.
#[must_use]
pub fn parties(config: &Config, vehicle: &Vehicle, settings: Exchange) -> Parties {
    let ground = Node {
        system: config.mavlink.system_id,
        component: config.mavlink.component_id,
    };
    let air = Node {
        system: vehicle.system_id,
        component: settings.agent,
    };
    Parties::new(ground, air, config.dli.vsm_id.0, vehicle.id.0)
}

fn fresh_identity() -> Result<Identity, mavlink_link::store::StoreError> {
    Identity::generate(&mut system_random).map_err(|fault| mavlink_link::store::StoreError {
        name: "legacy".to_owned(),
        cause: fault.to_string(),
    })
}

/// What keys are agreed for.
pub(super) const WANTED: Wanted = Wanted {
    signing: true,
    confidential: false,
};
const LOOK_EVERY: Duration = Duration::from_secs(1);
