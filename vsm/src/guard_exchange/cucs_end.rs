//! The end of the guard beside a CUCS: it asks the VSM, and puts a key in force once it is certain that the VSM has it.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::exchange::{
    Identity, Ignored, Inbound, Initiator, InitiatorConfig, InitiatorEvent, KeyInForce,
    PairingCode, PublicKey, Random, Status, Trust,
};
use mavlink_link::signing::KeyId;
use mavlink_link::store::{Disk, StoreError};
use stanag_msgs::Id;
use stanag_msgs::guard::{Direction, ExchangeDatagram};

use super::{WANTED, datagram, parties};
use crate::key_exchange::{ExchangeRecord, GroundKeys, Keyring, memory, records};

/// What is on this end's disk.
pub struct CucsFiles<'a> {
    /// The stamps of keys.
    pub store: &'a mut dyn Disk,
    /// The record of the exchange, whose writes must stay in order with the key files; `None`: in `store` too.
    pub records: Option<&'a mut dyn Disk>,
    /// The key in force, and the one that the VSM may have.
    pub keys: &'a dyn Keyring,
}

impl CucsFiles<'_> {
    fn records(&mut self) -> &mut dyn Disk {
        records(self.store, &mut self.records)
    }
}

/// What has happened.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum CucsNews {
    /// Another key is stored, which the VSM may have from now on: it is to be believed too.
    Waiting,
    /// It is in force, here and at the VSM, whose static key is this where that is known.
    InForce(KeyId, Option<PublicKey>),
    /// The VSM does not have it: it is deleted.
    Dropped(Status),
    /// Nobody has answered so far.
    NotAnswered,
    /// An answer that anybody can have sent.
    Rejected(Status),
    /// The disk or the system failed.
    Failed(String),
}

/// The machine.
#[derive(Debug)]
pub struct CucsEnd {
    vsm: Id,
    cucs: Id,
    /// None while the VSM is not proven.
    initiator: Option<Initiator>,
    record: ExchangeRecord,
    /// When an empty datagram under the key that waits is due, and how long after it the next.
    probe: Option<(Duration, Duration)>,
    news: VecDeque<CucsNews>,
}

impl CucsEnd {
    /// An end with what is on its disk. With a code it pairs, and begins at once; without one it waits for the VSM to ask.
    ///
    /// # Errors
    /// The record cannot be read.
    pub fn new(
        (cucs, vsm): (Id, Id),
        identity: Identity,
        code: Option<PairingCode>,
        now: Now,
        files: &mut CucsFiles<'_>,
    ) -> Result<CucsEnd, StoreError> {
        let record = ExchangeRecord::load(files.records(), cucs)?;
        let memory = memory(&record, files.keys);
        let pairs = code.is_some();
        let trust = match (code, record.peer()) {
            (Some(code), _) => Some(Trust::Pairing(code)),
            (None, peer) => peer.map(Trust::Pinned),
        };
        let initiator = trust.map(|trust| {
            let config = InitiatorConfig {
                parties: parties(vsm, cucs),
                identity,
                trust,
                wanted: WANTED,
            };
            let mut initiator = Initiator::new(config, memory, now.mono);
            // A key that waits was agreed about when an earlier process was ended: whether the VSM has it is found out.
            if pairs || memory.next.is_some() {
                initiator.want();
            }
            initiator
        });
        let waits = memory.next.is_some() && !pairs;
        Ok(CucsEnd {
            vsm,
            cucs,
            initiator,
            record,
            probe: waits.then_some((now.mono, FIRST_PROBE)),
            news: VecDeque::new(),
        })
    }

    /// The VSM that it is paired with.
    #[must_use]
    pub fn peer(&self) -> Option<PublicKey> {
        self.record.peer()
    }

    /// Agrees about another key now.
    pub fn want(&mut self) {
        if let Some(initiator) = &mut self.initiator {
            initiator.want();
        }
    }

    /// Whether an exchange is on its way.
    #[must_use]
    pub fn is_busy(&self) -> bool {
        self.initiator.as_ref().is_some_and(Initiator::is_busy)
    }

    /// Takes what has come from the VSM's address. `verified`: sealed under the key in force.
    ///
    /// # Errors
    /// Why it was ignored.
    pub fn handle(
        &mut self,
        now: Now,
        verified: bool,
        step: &ExchangeDatagram<'_>,
        files: &mut CucsFiles<'_>,
    ) -> Result<(), Ignored> {
        if step.direction != Direction::ToCucs {
            return Err(Ignored::Reflected);
        }
        if (step.cucs, step.vsm) != (self.cucs, self.vsm) {
            return Err(Ignored::Target);
        }
        let source = parties(self.vsm, self.cucs).responder;
        let inbound = Inbound {
            from: (),
            source,
            verified,
            payload: step.payload,
        };
        let taken = self.with(files, |initiator, disk| {
            initiator.handle(now, inbound, disk)
        });
        self.settle(now, files);
        taken.unwrap_or(Err(Ignored::Session))
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Now, random: &mut dyn Random, files: &mut CucsFiles<'_>) {
        self.with(files, |initiator, disk| {
            initiator.handle_timeout(now, random, disk);
        });
        self.settle(now, files);
    }

    /// Something of the VSM has verified under this key: if it is the one that waits, the VSM has it.
    pub fn key_in_use(&mut self, now: Now, key: KeyId, files: &mut CucsFiles<'_>) {
        // The files are not read for each datagram.
        if self.probe.is_none() {
            return;
        }
        let next = files.keys.next().ok().flatten();
        if next.is_some_and(|next| next.id() == key) {
            self.put_in_force(key, files);
            self.settle(now, files);
        }
    }

    fn with<T>(
        &mut self,
        files: &mut CucsFiles<'_>,
        act: impl FnOnce(&mut Initiator, &mut GroundKeys<'_, '_>) -> T,
    ) -> Option<T> {
        let initiator = self.initiator.as_mut()?;
        let mut disk = GroundKeys {
            store: files.store,
            records: &mut files.records,
            keys: files.keys,
            record: &mut self.record,
            vehicle: self.cucs,
        };
        Some(act(initiator, &mut disk))
    }

    fn settle(&mut self, now: Now, files: &mut CucsFiles<'_>) {
        while let Some(event) = self.initiator.as_mut().and_then(Initiator::poll_event) {
            let news = match event {
                InitiatorEvent::NextStored { .. } => {
                    self.probe = Some((now.mono + FIRST_PROBE, FIRST_PROBE));
                    CucsNews::Waiting
                }
                // The VSM has it in force, and has proved it.
                InitiatorEvent::Agreed { key, .. } => {
                    self.put_in_force(key, files);
                    continue;
                }
                InitiatorEvent::Promoted => {
                    let current = files.keys.current().ok().flatten();
                    let Some(current) = current else { continue };
                    CucsNews::InForce(current.id(), self.record.peer())
                }
                InitiatorEvent::Dropped { status } => {
                    self.probe = None;
                    CucsNews::Dropped(status)
                }
                InitiatorEvent::GaveUp { .. } => CucsNews::NotAnswered,
                InitiatorEvent::Rejected { status } => CucsNews::Rejected(status),
                InitiatorEvent::NotStored(cause) => CucsNews::Failed(cause.to_string()),
                InitiatorEvent::NoRandom => {
                    CucsNews::Failed("the system has no random bytes".to_owned())
                }
                InitiatorEvent::Begun { .. }
                | InitiatorEvent::Status { .. }
                // A guard orders nothing of its VSM by this exchange.
                | InitiatorEvent::Zeroize { .. } => continue,
            };
            self.note(news);
        }
    }

    /// The key that waits takes the place of the one in force, and the VSM of a pairing is proven. Nothing is lost where the disk
    /// fails: the key still waits, and its next proof does it.
    fn put_in_force(&mut self, key: KeyId, files: &mut CucsFiles<'_>) {
        // The pairing first: a key in force of a VSM that nobody is paired with could not be replaced over the air.
        let pending = self.record.pending.clone();
        if let Some(pending) = pending.filter(|one| one.key == Some(*key.bytes())) {
            let mut record = self.record.clone();
            (record.peer, record.pending) = (pending.peer, None);
            if let Err(fault) = record.save(files.records(), self.cucs) {
                return self.note(CucsNews::Failed(fault.to_string()));
            }
            self.record = record;
        }
        if let Err(fault) = files.keys.commit() {
            return self.note(CucsNews::Failed(fault.to_string()));
        }
        // What it leaves behind does no harm, and is deleted at the next change.
        let _ = files.keys.bury(files.store);
        let pinned = self.with(files, |initiator, disk| {
            // From here on a request counts only where the key in force has sealed it.
            initiator.set_key_in_force(KeyInForce::Settled);
            initiator.key_in_use(disk)
        });
        if let Some(Err(fault)) = pinned {
            self.note(CucsNews::Failed(fault.to_string()));
        }
        self.probe = None;
        let peer = self.record.peer();
        self.note(CucsNews::InForce(key, peer));
    }

    fn note(&mut self, news: CucsNews) {
        if self.news.len() < MAX_NEWS {
            self.news.push_back(news);
        }
    }

    /// Whether an empty datagram is to be sent under the key that waits. Seldom in the end: a VSM that never got as far counts it.
    pub fn takes_probe(&mut self, now: Duration) -> bool {
        let Some((at, pause)) = self.probe.filter(|(at, _)| *at <= now) else {
            return false;
        };
        let _ = at;
        self.probe = Some((now + pause, (pause * 2).min(LAST_PROBE)));
        true
    }

    /// The next datagram for the VSM. On a disk that queues it is not taken before everything that was written is durable.
    pub fn poll_transmit(&mut self) -> Option<Vec<u8>> {
        let message = self.initiator.as_mut()?.poll_transmit()?;
        Some(datagram(Direction::ToVsm, self.cucs, self.vsm, &message))
    }

    /// What has happened since the last call.
    pub fn poll_news(&mut self) -> Option<CucsNews> {
        self.news.pop_front()
    }

    /// When anything is next due.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Duration> {
        let initiator = self.initiator.as_ref().and_then(Initiator::poll_timeout);
        let probe = self.probe.map(|(at, _)| at);
        initiator.into_iter().chain(probe).min()
    }
}

const FIRST_PROBE: Duration = Duration::from_secs(1);
const LAST_PROBE: Duration = Duration::from_secs(60);
const MAX_NEWS: usize = 32;
