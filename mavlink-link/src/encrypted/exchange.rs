//! The exchange that gives the link its keys: the one of [`crate::exchange`], for a purpose of its own.
//!
//! A second pair of machines beside the one that agrees on signing keys, with a policy of its own in the prologue: what
//! one agrees on, the other never accepts. Each start of either end agrees again, so that keys live in memory only.

use core::hash::Hash;
use core::time::Duration;

use super::opener::Opener;
use super::packet::PacketKey;
use super::record::{EncryptedRecord, Notes};
use super::sealer::Sealer;
use crate::Now;
use crate::exchange::{
    Agreed, Identity, Ignored, Inbound, Initiator, InitiatorConfig, InitiatorEvent, KeyInForce,
    Message, Node, Parties, PublicKey, Random, Responder, ResponderConfig, ResponderEvent, Trust,
    Wanted, policy_digest,
};
use crate::store::{Changes, Disk, Progress, Store as _};

/// Which end of the link this is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// The VSM, which starts each exchange.
    Ground,
    /// The agent beside the autopilot.
    Air,
}

/// Keys of both directions.
#[derive(Debug)]
pub(super) struct Session {
    pub(super) epoch: u32,
    pub(super) sealer: Sealer,
    pub(super) opener: Opener,
}

/// What both ends do with the keys: its digest is part of the handshake, so that two that would use another cipher, or
/// another packet, never agree.
pub const LINK_POLICY: &str = "vsm encrypted link 1\n\
    cipher: AES-256-GCM, tag 8\n\
    nonce: id 4, epoch 4, counter 4\n\
    packet: id 4, counter 4, data 80, tag 8\n";

const WANTED: Wanted = Wanted {
    signing: false,
    confidential: true,
};

/// One end of the exchange.
#[derive(Debug)]
pub(super) struct Keying<A> {
    role: Role,
    parties: Parties,
    identity: Identity,
    vehicle: u32,
    record: EncryptedRecord,
    strict: bool,
    machine: Option<Machine<A>>,
    /// Agreed on; its epoch may not be on the disk yet, and the other end may not know yet.
    pub(super) staged: Option<Session>,
    /// The other end has the staged keys.
    confirmed: bool,
    unsaved: Changes,
    fault: Option<String>,
    hastened_at: Option<Duration>,
    /// When the ground sent its last message.
    sent_at: Option<Duration>,
    hint: Hint,
}

#[derive(Debug)]
enum Machine<A> {
    Ground(Box<Initiator>),
    Air(Box<Responder<A>>),
}

/// What a message of an exchange shows of who has sent it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Shown {
    /// Nothing: anybody can have made it.
    Nothing,
    /// The other end has made it, and perhaps long ago: requests are the same at each start.
    Made,
    /// The other end has made it now, for this exchange.
    MadeNow,
}

/// When the air side next requests an exchange.
#[derive(Debug, Clone, Copy, Default)]
struct Hint {
    sent: u32,
    at: Duration,
}

impl<A: Copy + Eq + Hash> Keying<A> {
    pub(super) fn new(
        role: Role,
        parties: Parties,
        identity: Identity,
        record: EncryptedRecord,
        strict: bool,
    ) -> Self {
        Self {
            role,
            vehicle: parties.vehicle_id,
            parties: Parties {
                policy: policy_digest(LINK_POLICY),
                ..parties
            },
            identity,
            record,
            strict,
            machine: None,
            staged: None,
            confirmed: false,
            unsaved: Changes::NONE,
            fault: None,
            hastened_at: None,
            sent_at: None,
            hint: Hint::default(),
        }
    }

    /// A pairing has pinned another peer, about whose counter the one before says nothing: on disk too, or a restart before the first
    /// exchange would hold it to that one.
    pub(super) fn pin(&mut self, peer: PublicKey, now: Duration, disk: &mut dyn Disk) {
        self.record.counter = 0;
        if let Err(fault) = disk.save(&self.vehicle, &self.record) {
            self.fault = Some(fault.to_string());
        }
        self.set_peer(peer, now);
    }

    /// From now on with this peer.
    pub(super) fn set_peer(&mut self, peer: PublicKey, now: Duration) {
        (self.staged, self.confirmed, self.hint) = (None, false, Hint::default());
        let (parties, identity) = (self.parties, self.identity.duplicate());
        self.machine = Some(match self.role {
            Role::Ground => {
                let config = InitiatorConfig {
                    parties,
                    identity,
                    trust: Trust::Pinned(peer),
                    wanted: WANTED,
                };
                let mut initiator = Initiator::new(config, self.record.of_initiator(), now);
                initiator.want();
                Machine::Ground(Box::new(initiator))
            }
            Role::Air => {
                let config = ResponderConfig {
                    parties,
                    identity,
                    wanted: WANTED,
                };
                let memory = self.record.of_responder(peer);
                Machine::Air(Box::new(Responder::new(config, memory, now)))
            }
        });
    }

    pub(super) fn is_air(&self) -> bool {
        self.role == Role::Air
    }

    pub(super) fn is_paired(&self) -> bool {
        self.machine.is_some()
    }

    /// Why the disk did not keep something, once.
    pub(super) fn take_fault(&mut self) -> Option<String> {
        self.fault.take()
    }

    /// Who sends what the other end sends.
    pub(super) fn peer_node(&self) -> Node {
        match self.role {
            Role::Ground => self.parties.responder,
            Role::Air => self.parties.initiator,
        }
    }

    pub(super) fn own_node(&self) -> Node {
        match self.role {
            Role::Ground => self.parties.initiator,
            Role::Air => self.parties.responder,
        }
    }

    /// Takes a KEY_EXCHANGE of suite 1. `working`: the link carries packets just now.
    pub(super) fn handle(
        &mut self,
        now: Now,
        (from, source, payload): (A, Node, &[u8]),
        working: bool,
        random: &mut dyn Random,
        disk: &mut dyn Disk,
    ) -> Shown {
        let before = disk.queued();
        let mut staging = Staging {
            role: self.role,
            parties: &self.parties,
            strict: self.strict,
            staged: &mut self.staged,
            confirmed: &mut self.confirmed,
        };
        let mut agreed_now = false;
        let mut stage = |agreed: &Agreed| {
            agreed_now = staging.stage(agreed);
            agreed_now
        };
        let mut notes = Notes {
            disk: &mut *disk,
            vehicle: self.vehicle,
            record: &mut self.record,
            stage: &mut stage,
        };
        let result = match &mut self.machine {
            None => return Shown::Nothing,
            Some(Machine::Ground(initiator)) => {
                // A recorded request must not replace keys that work.
                initiator.set_key_in_force(if working {
                    KeyInForce::Young
                } else {
                    KeyInForce::None
                });
                let inbound = Inbound {
                    from: (),
                    source,
                    verified: false,
                    payload,
                };
                initiator.handle(now, inbound, &mut notes)
            }
            Some(Machine::Air(responder)) => {
                let inbound = Inbound {
                    from,
                    source,
                    verified: false,
                    payload,
                };
                responder.handle(now.mono, inbound, random, &mut notes)
            }
        };
        let until = disk.queued();
        self.unsaved = self.unsaved.and(Changes {
            after: before,
            until,
        });
        let requests = Message::is_request(payload);
        if result == Err(Ignored::Limited) && !working && requests {
            self.hasten(now.mono, true);
        }
        match result {
            _ if agreed_now => Shown::MadeNow,
            // All else that the ground takes answers its own message, a cookie too.
            Ok(()) if self.role == Role::Ground && !requests => Shown::MadeNow,
            // A request that comes too early, or too often, has been authenticated nevertheless.
            Ok(()) | Err(Ignored::Limited | Ignored::Hint) => Shown::Made,
            Err(_) => Shown::Nothing,
        }
    }

    /// Begins an exchange, on the ground.
    pub(super) fn want(&mut self) {
        if let Some(Machine::Ground(initiator)) = &mut self.machine {
            initiator.want();
        }
    }

    /// The other end is there and has no keys that fit ours: an attempt that waits for its time waits no longer, at most
    /// once a second. `asked`: it has requested an exchange. A packet that fits no key is anybody's: where an answer takes over a second,
    /// an attempt that began again with each would never end.
    pub(super) fn hasten(&mut self, now: Duration, asked: bool) {
        let lately = |at: Duration| now.saturating_sub(at) < HASTEN_EVERY;
        if let Some(Machine::Ground(initiator)) = &mut self.machine
            && !self.hastened_at.is_some_and(lately)
        {
            self.hastened_at = Some(now);
            initiator.hasten(now, asked);
        }
    }

    /// Does what is due.
    pub(super) fn handle_timeout(
        &mut self,
        now: Now,
        random: &mut dyn Random,
        disk: &mut dyn Disk,
    ) {
        let before = disk.queued();
        match &mut self.machine {
            None => {}
            Some(Machine::Ground(initiator)) => {
                let mut notes = Notes {
                    disk: &mut *disk,
                    vehicle: self.vehicle,
                    record: &mut self.record,
                    stage: &mut |_| false,
                };
                initiator.handle_timeout(now, random, &mut notes);
                let again = |at: Duration| at.saturating_add(REPEAT_EVERY) <= now.mono;
                if self.sent_at.is_some_and(again) {
                    self.sent_at = None;
                    initiator.repeat();
                }
            }
            Some(Machine::Air(responder)) => responder.handle_timeout(now.mono),
        }
        let until = disk.queued();
        self.unsaved = self.unsaved.and(Changes {
            after: before,
            until,
        });
        self.follow();
    }

    fn follow(&mut self) {
        match &mut self.machine {
            None => {}
            Some(Machine::Ground(initiator)) => {
                while let Some(event) = initiator.poll_event() {
                    match event {
                        InitiatorEvent::Agreed { .. } => self.confirmed = true,
                        InitiatorEvent::NotStored(fault) => self.fault = Some(fault.to_string()),
                        InitiatorEvent::NoRandom => {
                            self.fault = Some("no random bytes".to_owned());
                        }
                        _ => {}
                    }
                }
            }
            Some(Machine::Air(responder)) => {
                while let Some(event) = responder.poll_event() {
                    match event {
                        // The staged key of the exchange is a signing key, which nobody installs: it is over.
                        ResponderEvent::Staged { .. } => responder.key_active(),
                        ResponderEvent::NotStored(fault) => self.fault = Some(fault.to_string()),
                        _ => {}
                    }
                }
            }
        }
    }

    /// Keys that may be used for sending from now on: their epoch is on the disk, and the other end has them.
    /// `proven`: a packet under them has verified.
    pub(super) fn take_confirmed(&mut self, proven: bool, disk: &mut dyn Disk) -> Option<Session> {
        self.follow();
        self.confirmed |= proven && self.staged.is_some();
        if !self.confirmed || !self.is_stored(disk) {
            return None;
        }
        let session = self.staged.take()?;
        (self.confirmed, self.hint, self.sent_at) = (false, Hint::default(), None);
        if let Some(Machine::Ground(initiator)) = &mut self.machine {
            // It need not ask any more what became of the key. Nothing is stored by this.
            let _ = initiator.key_in_use(&mut Notes {
                disk,
                vehicle: self.vehicle,
                record: &mut self.record,
                stage: &mut |_| false,
            });
            while initiator.poll_event().is_some() {}
        }
        Some(session)
    }

    fn is_stored(&mut self, disk: &dyn Disk) -> bool {
        let stored = disk.progress(self.unsaved) == Progress::Durable;
        if stored {
            self.unsaved = Changes::NONE;
        }
        stored
    }

    /// The next message, once what it promises is on the disk; for the address, where it answers one.
    pub(super) fn poll_transmit(
        &mut self,
        now: Duration,
        disk: &dyn Disk,
    ) -> Option<(Option<A>, Message)> {
        if !self.is_stored(disk) {
            return None;
        }
        match &mut self.machine {
            None => None,
            Some(Machine::Ground(initiator)) => {
                let message = initiator.poll_transmit()?;
                self.sent_at = Some(now);
                Some((None, message))
            }
            Some(Machine::Air(responder)) => {
                let sent = responder.poll_transmit()?;
                Some((Some(sent.to), sent.message))
            }
        }
    }

    /// For who has called: from the ground what its attempt is sending, once what that promises is on the disk; from the air a
    /// request.
    pub(super) fn message_for_caller(
        &mut self,
        needs_keys: bool,
        disk: &dyn Disk,
    ) -> Option<Message> {
        match self.machine.as_ref()? {
            Machine::Ground(initiator) => {
                let message = initiator.message_in_progress()?;
                self.is_stored(disk).then_some(message)
            }
            Machine::Air(responder) => (needs_keys && self.staged.is_none())
                .then(|| responder.hint())
                .flatten(),
        }
    }

    /// In the air, without keys: a request for an exchange, now and then.
    pub(super) fn poll_hint(&mut self, now: Duration) -> Option<Message> {
        let Some(Machine::Air(responder)) = &self.machine else {
            return None;
        };
        if self.staged.is_some() || now < self.hint.at {
            return None;
        }
        let pause = FIRST_HINT.saturating_mul(1 << self.hint.sent.min(5));
        self.hint = Hint {
            sent: self.hint.sent.saturating_add(1),
            at: now.saturating_add(pause.min(LAST_HINT)),
        };
        responder.hint()
    }

    /// When [`handle_timeout`](Self::handle_timeout) is next needed; `needs_keys`: there are none.
    pub(super) fn poll_timeout(&self, needs_keys: bool) -> Option<Duration> {
        match self.machine.as_ref()? {
            Machine::Ground(initiator) => {
                let again = self.sent_at.map(|at| at.saturating_add(REPEAT_EVERY));
                initiator.poll_timeout().into_iter().chain(again).min()
            }
            Machine::Air(responder) => {
                let hint = (needs_keys && self.staged.is_none()).then_some(self.hint.at);
                responder.poll_timeout().into_iter().chain(hint).min()
            }
        }
    }
}

/// Makes a session of what was agreed on.
struct Staging<'a> {
    role: Role,
    parties: &'a Parties,
    strict: bool,
    staged: &'a mut Option<Session>,
    confirmed: &'a mut bool,
}

impl Staging<'_> {
    fn stage(&mut self, agreed: &Agreed) -> bool {
        let Some(keys) = &agreed.confidential else {
            return false;
        };
        let up = PacketKey::new(&keys.up, self.parties.vsm_id, agreed.epoch);
        let down = PacketKey::new(&keys.down, self.parties.vehicle_id, agreed.epoch);
        let (send, receive) = match self.role {
            Role::Ground => (up, down),
            Role::Air => (down, up),
        };
        *self.staged = Some(Session {
            epoch: agreed.epoch,
            sealer: Sealer::new(send),
            opener: Opener::new(receive, self.strict),
        });
        // The ground had the keys before it sent step 3; it learns by step 4, or by a packet, that the air has them.
        *self.confirmed = self.role == Role::Air;
        true
    }
}

/// The pause after the first request of the air side; each next one is twice as long.
const FIRST_HINT: Duration = Duration::from_millis(400);
const LAST_HINT: Duration = Duration::from_secs(10);
/// The exchange repeats itself after 0.5, 1, 2 and 4 s; over a radio that loses much that would take minutes.
const REPEAT_EVERY: Duration = Duration::from_millis(400);
const HASTEN_EVERY: Duration = Duration::from_secs(1);
