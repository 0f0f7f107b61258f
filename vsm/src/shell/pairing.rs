//! `vsm pair`: this VSM and a vehicle's air-side agent get to know each other, over the vehicle's link, by a code that a
//! person carries from one to the other. It holds the locks of the store and of the key, so no bridge runs meanwhile. `vsm
//! zeroize` orders a paired agent to zeroize in the same way when no bridge runs.

use std::path::Path;
use std::time::Duration;

use mavlink_link::encrypted::Role;
use mavlink_link::exchange::{
    Callers, Ignored, Inbound, Initiator, InitiatorConfig, InitiatorEvent, Message, Node,
    PairingCode, PublicKey, Status, Trust,
};
use mavlink_link::frame::{Header, KEY_EXCHANGE_ID, MAX_FRAME, Parser, encode_raw};
use tokio::time::{Instant, sleep_until};

use super::clock::Clock;
use super::disk::{FileDisk, OpenError};
use super::encryption::{Encryption, EncryptionEnd};
use super::key_file::system_random;
use super::key_store::{KeyStore, KeyStoreError};
use super::sockets::{self, Hosts, SocketError, VehicleReader, VehicleWriter};
use crate::config::{Config, Exchange, Vehicle};
use crate::key_exchange::{
    ExchangeRecord, GroundKeys, NOT_REACHED, WANTED, identity, memory, parties,
};
use crate::session::Peer;
use mavlink_link::store::StoreError;

/// Why a pairing cannot be tried.
#[derive(Debug, thiserror::Error)]
pub enum PairingError {
    /// The store.
    #[error(transparent)]
    Store(#[from] OpenError),
    /// A record.
    #[error(transparent)]
    Record(#[from] StoreError),
    /// The keys.
    #[error(transparent)]
    Keys(#[from] KeyStoreError),
    /// The link.
    #[error(transparent)]
    Socket(#[from] SocketError),
}

/// A pairing in progress.
#[derive(Debug)]
pub struct Pairing {
    initiator: Initiator,
    parties: mavlink_link::exchange::Parties,
    record: ExchangeRecord,
    vehicle: stanag_msgs::Id,
    store: FileDisk,
    keys: KeyStore,
    clock: Clock,
    reader: VehicleReader,
    writer: VehicleWriter,
    peer: Option<Peer>,
    /// The peer's address comes from a message of the exchange.
    exchanged: bool,
    /// Who else may be the agent.
    callers: Callers<Peer>,
    parser: Parser,
    seq: u8,
    /// For an encrypted link: a pairing passes it in the clear, framed like the rest.
    encryption: Option<Encryption>,
}

/// How the pairing ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Ending {
    /// Both know each other, and share a key.
    Paired {
        /// The agent's static key.
        peer: PublicKey,
        /// The shared key's name.
        key: mavlink_link::signing::KeyId,
    },
    /// Nobody answered with the code; holds the last unproven status.
    NotAnswered(Option<Status>),
}

impl Pairing {
    /// Opens the vehicle's link. Must be called within a tokio runtime.
    ///
    /// # Errors
    /// Another process uses the store or the key, or a file or socket cannot be opened.
    pub fn open(
        config: &Config,
        vehicle: &Vehicle,
        (key_file, settings): (&Path, Exchange),
        code: PairingCode,
    ) -> Result<Pairing, PairingError> {
        let store = FileDisk::open(&config.store.dir)?;
        let trust = Trust::Pairing(code);
        let mut pairing = Pairing::open_on(config, vehicle, (key_file, settings), trust, store)?;
        pairing.initiator.want();
        Ok(pairing)
    }

    /// Opens the link to the paired agent, with an open store; `None` if there is no pairing.
    ///
    /// # Errors
    /// As [`Pairing::open`].
    pub fn with_agent(
        config: &Config,
        vehicle: &Vehicle,
        of: (&Path, Exchange),
        store: FileDisk,
    ) -> Result<Option<Pairing>, PairingError> {
        match ExchangeRecord::load(&store, vehicle.id)?.peer() {
            None => Ok(None),
            Some(peer) => {
                Pairing::open_on(config, vehicle, of, Trust::Pinned(peer), store).map(Some)
            }
        }
    }

    fn open_on(
        config: &Config,
        vehicle: &Vehicle,
        (key_file, settings): (&Path, Exchange),
        trust: Trust,
        mut store: FileDisk,
    ) -> Result<Pairing, PairingError> {
        let clock = Clock::default();
        let keys = KeyStore::open(key_file)?;
        keys.bury(&mut store)?;
        let port = sockets::port_record(config, vehicle);
        let (reader, writer, peer) = sockets::open_link(
            "vehicle.link",
            &vehicle.link,
            &Hosts::AskNow,
            &port,
            &mut store,
        )?;
        let record = ExchangeRecord::load(&store, vehicle.id)?;
        let parties = parties(config, vehicle, settings);
        let encryption = if vehicle.encrypt {
            let end = EncryptionEnd {
                role: Role::Ground,
                parties,
                identity: identity(&mut store, &mut system_random)?,
                peer: match &trust {
                    Trust::Pinned(peer) => Some(*peer),
                    Trust::Pairing(_) => None,
                },
                at: peer,
            };
            Some(Encryption::open(&vehicle.link, end, clock.now(), &store)?)
        } else {
            None
        };
        let config = InitiatorConfig {
            parties,
            identity: identity(&mut store, &mut system_random)?,
            trust,
            wanted: WANTED,
        };
        let initiator = Initiator::new(config, memory(&record, &keys), clock.mono());
        Ok(Pairing {
            initiator,
            parties,
            record,
            vehicle: vehicle.id,
            store,
            keys,
            clock,
            reader,
            writer,
            peer,
            exchanged: false,
            callers: Callers::by_host(Peer::host),
            parser: Parser::new(),
            seq: 0,
            encryption,
        })
    }

    /// The key that the people of this VSM and of the agent compare.
    #[must_use]
    pub fn own_key(&self) -> PublicKey {
        self.initiator.config().identity.public()
    }

    /// Tries until it succeeds, at most `patience`. `report` receives each event as it happens.
    pub async fn run(
        mut self,
        patience: Duration,
        report: &mut dyn FnMut(&InitiatorEvent),
    ) -> Ending {
        let mut bytes = vec![0; 65_536];
        let mut unproven = None;
        loop {
            self.step(patience, &mut bytes).await;
            while let Some(event) = self.initiator.poll_event() {
                report(&event);
                match event {
                    InitiatorEvent::Agreed { key, peer, .. } => {
                        if let Some(one) = &mut self.encryption {
                            one.store_far_end(self.peer, self.clock.mono(), &mut self.store);
                        }
                        return Ending::Paired { peer, key };
                    }
                    InitiatorEvent::Rejected { status } => unproven = Some(status),
                    _ => {}
                }
            }
            if self.clock.mono() >= patience {
                return Ending::NotAnswered(unproven);
            }
        }
    }

    /// Orders the agent to zeroize; returns its answer.
    pub async fn order_zeroize(mut self, in_flight: bool) -> String {
        let now = self.clock.mono();
        let ordered = self
            .initiator
            .order_zeroize(now, in_flight, &mut system_random);
        let mut bytes = vec![0; 65_536];
        let mut outcome = NOT_REACHED.to_owned();
        while ordered == Ok(true) && self.initiator.is_ordering() {
            self.step(Duration::MAX, &mut bytes).await;
            while let Some(event) = self.initiator.poll_event() {
                if let InitiatorEvent::Zeroize {
                    report: Some(report),
                } = event
                {
                    outcome = report.to_string();
                }
            }
        }
        outcome
    }

    /// Sends what is due and waits for a datagram, no longer than `end`.
    async fn step(&mut self, end: Duration, bytes: &mut [u8]) {
        self.send().await;
        let encrypted = self.encryption.as_ref().map(Encryption::poll_timeout);
        let due = self.initiator.poll_timeout().unwrap_or(Duration::MAX);
        let due = due.min(encrypted.unwrap_or(Duration::MAX)).min(end);
        let until = due.max(self.clock.mono());
        tokio::select! {
            received = self.reader.receive(bytes) => match received {
                Ok((length, from)) => self.take(from, bytes.get(..length).unwrap_or_default()),
                Err(_) => tokio::time::sleep(PAUSE).await,
            },
            () = sleep_until(Instant::from_std(self.clock.instant(until))) => {}
        }
    }

    /// Only KEY_EXCHANGE is used, signed or not: the code authenticates it.
    fn take(&mut self, from: Peer, bytes: &[u8]) {
        let now = self.clock.now();
        let (from, bytes) = match &mut self.encryption {
            Some(one) => one.handle(now, from, bytes, &mut self.store),
            None => (from, bytes),
        };
        let mut disk = GroundKeys {
            store: &mut self.store,
            records: &mut None,
            keys: &self.keys,
            record: &mut self.record,
            vehicle: self.vehicle,
        };
        let mut frames = self.parser.feed(bytes);
        while let Some(item) = frames.next() {
            let Ok(frame) = item else { continue };
            let header = frame.header();
            // The ids of other systems on a shared radio must not move the peer's address.
            if header.system_id != self.parties.responder.system || !frame.is_checked() {
                continue;
            }
            let mut exchanged = false;
            if header.message_id == KEY_EXCHANGE_ID {
                let source = Node {
                    system: header.system_id,
                    component: header.component_id,
                };
                let inbound = Inbound {
                    from: (),
                    source,
                    verified: false,
                    payload: frame.payload(),
                };
                // The machine counts useless messages.
                let taken = self.initiator.handle(now, inbound, &mut disk);
                // A hint during an attempt still shows where the agent is.
                exchanged = matches!(taken, Ok(()) | Err(Ignored::Limited | Ignored::Hint));
                if exchanged && Message::is_request(frame.payload()) {
                    self.callers.note(from, now.mono);
                    // An answer was made for this attempt, and a request may be a recording.
                    exchanged = !self.initiator.is_answered();
                }
            }
            // A listening link learns here where the vehicle is. Nothing is proven before the end, so a sender of an
            // exchange message replaces any earlier one: nobody can block the place by being first. Nor by being last:
            // each sender of a request is sent the message in progress too.
            if exchanged || !self.exchanged {
                self.peer = Some(from);
                self.exchanged |= exchanged;
            }
        }
        // Half a frame of one sender must not swallow the next sender's frame.
        if from != Peer::Serial {
            self.parser.discard_pending();
        }
    }

    async fn send(&mut self) {
        let mut disk = GroundKeys {
            store: &mut self.store,
            records: &mut None,
            keys: &self.keys,
            record: &mut self.record,
            vehicle: self.vehicle,
        };
        self.initiator
            .handle_timeout(self.clock.now(), &mut system_random, &mut disk);
        while let Some(message) = self.initiator.poll_transmit() {
            let Some(to) = self.peer else { return };
            self.callers.served(to);
            self.transmit(to, &message).await;
        }
        let now = self.clock.mono();
        while let Some((to, message)) = self
            .callers
            .poll(now, || self.initiator.message_in_progress())
        {
            self.transmit(to, &message).await;
        }
        self.send_encrypted().await;
    }

    async fn transmit(&mut self, to: Peer, message: &Message) {
        let header = Header {
            seq: self.seq,
            system_id: self.parties.initiator.system,
            component_id: self.parties.initiator.component,
            message_id: KEY_EXCHANGE_ID,
            ..Header::default()
        };
        self.seq = self.seq.wrapping_add(1);
        let mut out = [0; MAX_FRAME];
        let Ok(len) = encode_raw(header, &message.to_payload(), &mut out) else {
            return;
        };
        let frame = out.get(..len).unwrap_or_default();
        // A frame that cannot be sent counts as lost.
        match &mut self.encryption {
            None => drop(self.writer.send(frame, to).await),
            Some(one) => {
                one.send(self.clock.mono(), to, frame);
                self.send_encrypted().await;
            }
        }
    }

    async fn send_encrypted(&mut self) {
        let Some(one) = &mut self.encryption else {
            return;
        };
        one.handle_timeout(self.clock.now(), &mut self.store);
        while let Some((to, bytes)) = one.poll_transmit(self.clock.mono(), &mut self.store) {
            drop(self.writer.send(bytes, to).await);
        }
    }
}

const PAUSE: Duration = Duration::from_millis(200);
