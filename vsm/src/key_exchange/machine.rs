//! The initiator of one vehicle's exchange, beside the bridge that carries its messages, and what operators see of it.

use std::collections::VecDeque;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::exchange::{
    Callers, Identity, Ignored, Inbound, Initiator, InitiatorConfig, InitiatorEvent, KeyInForce,
    Legacy, Message, Node, Parties, Random, Status, Trust, Wanted,
};
use mavlink_link::link::KeyExchangeFrame;
use mavlink_link::signing::KeyId;
use mavlink_link::store::{Changes, Disk, Progress, StoreError};
use stanag_msgs::Id;
use stanag_msgs::enums::AlertPriority;

use super::ground::{GroundKeys, Keyring, memory, records};
use super::record::{ExchangeRecord, identity};
use crate::config::{Config, Exchange, ExchangeMode, Vehicle};
use crate::session::{Bridge, ExchangeNotice, ExchangeStatus, LogEntry, LogLevel, Peer};

/// The exchange of one vehicle.
#[derive(Debug)]
pub struct KeyExchange {
    index: usize,
    vehicle: Id,
    settings: Exchange,
    parties: Parties,
    machine: Machine,
    record: ExchangeRecord,
    /// Where the latest message of the agent came from: the vehicle's link may not have a peer yet.
    agent_at: Option<Peer>,
    /// Who else may be the agent until the link has a peer.
    callers: Callers<Peer>,
    /// A message that could not be sent, for example because the ceiling of the clock is still being written, and until
    /// when to retry it.
    unsent: Option<(Vec<u8>, Duration)>,
    check_at: Duration,
    /// The agent has the key that waits for the vehicle: until this time no other key is agreed on.
    keep_until: Option<Duration>,
    /// When an exchange that was rolled back may be retried.
    again_at: Duration,
    state: String,
    /// The key in force has been seen in use, in this run or, by the stored record, in an earlier one.
    settled: bool,
    /// When the key in force came into use, if that was in this run: monotonic, since the wall clock may jump.
    adopted_at: Option<Duration>,
    log: VecDeque<LogEntry>,
    /// How many lines of the log found no room.
    left_out: u64,
    /// The result of an order to the agent to zeroize.
    zeroize: Option<String>,
}

#[derive(Debug)]
enum Machine {
    /// No agent is paired.
    Unpaired,
    Paired(Box<Initiator>),
    Legacy(Box<Legacy>),
}

/// What an exchange needs for one call.
pub struct Surroundings<'a> {
    /// The bridge.
    pub bridge: &'a mut Bridge,
    /// The clocks of keys, and what the bridge keeps.
    pub store: &'a mut dyn Disk,
    /// The exchange's records, whose writes must stay in order with the key files; `None`: in `store` too.
    pub records: Option<&'a mut dyn Disk>,
    /// The key files.
    pub keys: &'a dyn Keyring,
    /// For the exchange.
    pub random: &'a mut dyn Random,
    /// A date that cannot be in the future, since 1970: that of the build.
    pub not_before: Duration,
}

impl Surroundings<'_> {
    fn records(&mut self) -> &mut dyn Disk {
        records(self.store, &mut self.records)
    }

    /// Whether everything that the exchange has written is durable.
    fn is_stored(&mut self) -> bool {
        let disk = self.records();
        let (after, until) = (0, disk.queued());
        disk.progress(Changes { after, until }) == Progress::Durable
    }
}

impl KeyExchange {
    /// The vehicle has another index, because one before it was removed.
    pub fn set_index(&mut self, index: usize) {
        self.index = index;
    }

    /// The exchange of a vehicle, if its configuration has one.
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
    ) -> Result<KeyExchange, StoreError> {
        let record = ExchangeRecord::load(with.records(), vehicle.id)?;
        let current = with.keys.current().ok().flatten().map(|key| key.id());
        let settled = current.is_some_and(|id| record.key == Some(*id.bytes()));
        let parties = parties(config, vehicle, settings);
        let machine = match settings.mode {
            ExchangeMode::Legacy => {
                let identity = fresh_identity(with.random)?;
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
            agent_at: None,
            callers: Callers::by_host(Peer::host),
            unsent: None,
            check_at: now.mono,
            keep_until: None,
            again_at: now.mono,
            state: "idle".to_owned(),
            settled,
            adopted_at: None,
            log: VecDeque::new(),
            left_out: 0,
            zeroize: None,
        };
        with.bridge.want_key_exchange(index);
        exchange.pair(now, with)?;
        exchange.announce(now, with);
        Ok(exchange)
    }

    /// With an agent that is paired, the initiator.
    fn pair(&mut self, now: Now, with: &mut Surroundings<'_>) -> Result<(), StoreError> {
        let (Machine::Unpaired, Some(peer)) = (&self.machine, self.record.peer()) else {
            return Ok(());
        };
        let config = InitiatorConfig {
            parties: self.parties,
            identity: identity(records(with.store, &mut with.records), with.random)?,
            trust: Trust::Pinned(peer),
            wanted: WANTED,
        };
        let memory = memory(&self.record, with.keys);
        let mut initiator = Initiator::new(config, memory, now.mono);
        // A first key is already the current one before the vehicle has it.
        let first = memory.current.filter(|_| !self.settled);
        let waits = memory.next.or(first).map(|key| *key.bytes());
        if waits.is_some() && waits == self.record.agreed {
            // The agent has it and will give it to the vehicle: a new exchange would make the agent throw the key away.
            self.keep_until = Some(now.mono.saturating_add(self.min_key_age()));
        } else if memory.next.is_some() {
            // Only the agent knows what happened to that key.
            initiator.want();
        }
        self.machine = Machine::Paired(Box::new(initiator));
        Ok(())
    }

    /// Processes received messages and what is due. Called after everything that the bridge does.
    pub fn handle(&mut self, now: Now, with: &mut Surroundings<'_>) {
        self.settled |= with.bridge.proven_key(self.index).is_some();
        if let Some((payload, until)) = self.unsent.take()
            && now.mono < until
        {
            self.send(now, payload, until, with);
        }
        while let Some(frame) = with.bridge.poll_key_exchange(self.index) {
            let header = frame.header;
            let source = Node {
                system: header.system_id,
                component: header.component_id,
            };
            // Only a message that only the agent can have made shows where it is: at worst it is a recording of one.
            if self.take(now, source, &frame, with) && source == self.parties.responder {
                self.locate(now, &frame, with);
            }
        }
        if now.mono >= self.check_at {
            self.check_at = now.mono.saturating_add(LOOK_EVERY);
            self.check_age(now, with);
        }
        let mut disk = GroundKeys {
            store: with.store,
            records: &mut with.records,
            keys: with.keys,
            record: &mut self.record,
            vehicle: self.vehicle,
        };
        match &mut self.machine {
            Machine::Unpaired => {}
            Machine::Legacy(legacy) => {
                let due = legacy.poll_transmit(now.mono);
                // A peer that receives this run's public key would switch away from the key in force.
                if let Some(payload) = due.filter(|_| !self.settled) {
                    let until = now.mono.saturating_add(WORTH_SENDING);
                    self.send(now, payload.to_vec(), until, with);
                }
            }
            Machine::Paired(initiator) => {
                initiator.handle_timeout(now, with.random, &mut disk);
            }
        }
        // Persist, then send: its writes may be on their way to a slow disk, and nothing waits for them here.
        while with.is_stored()
            && let Machine::Paired(initiator) = &mut self.machine
            && let Some(message) = initiator.poll_transmit()
        {
            let until = now.mono.saturating_add(WORTH_SENDING);
            self.send(now, message.to_payload().to_vec(), until, with);
            if let Some(at) = self.agent_at {
                self.callers.served(at);
            }
        }
        // With a peer each would go there.
        while !with.bridge.has_peer(self.index)
            && with.is_stored()
            && let Machine::Paired(initiator) = &self.machine
            && let Some((to, message)) = self
                .callers
                .poll(now.mono, || initiator.message_in_progress())
        {
            let payload = message.to_payload();
            with.bridge
                .send_key_exchange(self.index, now, &payload, Some(to), with.store);
        }
        self.report(now, with);
    }

    /// Where the agent may be, by a message that it has made, now or some time ago.
    fn locate(&mut self, now: Now, frame: &KeyExchangeFrame<Peer>, with: &Surroundings<'_>) {
        let requests = Message::is_request(frame.payload());
        if requests && !with.bridge.has_peer(self.index) {
            self.callers.note(frame.from, now.mono);
        }
        let answered = matches!(&self.machine, Machine::Paired(one) if one.is_answered());
        if !(requests && answered) {
            self.agent_at = Some(frame.from);
        }
    }

    fn send(&mut self, now: Now, payload: Vec<u8>, until: Duration, with: &mut Surroundings<'_>) {
        let (index, to) = (self.index, self.agent_at);
        let bridge = &mut *with.bridge;
        if !bridge.send_key_exchange(index, now, &payload, to, with.store) {
            self.unsent = Some((payload, until));
        }
    }

    fn take(
        &mut self,
        now: Now,
        source: Node,
        frame: &KeyExchangeFrame<Peer>,
        with: &mut Surroundings<'_>,
    ) -> bool {
        let in_force = self.key_in_force(now);
        let mut disk = GroundKeys {
            store: with.store,
            records: &mut with.records,
            keys: with.keys,
            record: &mut self.record,
            vehicle: self.vehicle,
        };
        match &mut self.machine {
            Machine::Unpaired => false,
            Machine::Paired(initiator) => {
                let inbound = Inbound {
                    from: (),
                    source,
                    verified: frame.verified.is_some(),
                    payload: frame.payload(),
                };
                initiator.set_key_in_force(in_force);
                let taken = initiator.handle(now, inbound, &mut disk);
                // A request that comes too early, or is not verified, has been authenticated nevertheless.
                matches!(taken, Ok(()) | Err(Ignored::Limited | Ignored::Hint))
            }
            // Anyone can have sent this: it can bring a first key, but never replace one that the vehicle signs with.
            Machine::Legacy(_) if self.settled => false,
            Machine::Legacy(legacy) => {
                let Ok(key) = legacy.handle(source, frame.payload()) else {
                    return true;
                };
                let id = key.id();
                match with.keys.restage(&key) {
                    Ok(()) => {
                        self.offer(now, with);
                        let text = format!("key {id} is agreed by the legacy exchange");
                        self.notify_once(now, AlertPriority::Warning, text, with);
                    }
                    Err(fault) => {
                        self.notify_once(now, AlertPriority::Caution, fault.to_string(), with)
                    }
                }
                true
            }
        }
    }

    fn min_key_age(&self) -> Duration {
        MIN_KEY_AGE.min(self.life())
    }

    /// How long a key is used before another is agreed on.
    fn life(&self) -> Duration {
        Duration::from_secs_f64(self.settings.rotate_days * 86_400.0)
    }

    /// How long the key in force has been in use. In the run in which it came into use, the wall clock does not count:
    /// whoever can make that clock jump could otherwise cause one exchange after another.
    fn key_age(&self, now: Now) -> Duration {
        match self.adopted_at {
            Some(at) => now.mono.saturating_sub(at),
            None => Duration::from_secs(now.wall.as_secs().saturating_sub(self.record.since)),
        }
    }

    fn key_in_force(&self, now: Now) -> KeyInForce {
        if self.keep_until.is_some_and(|until| now.mono < until) {
            KeyInForce::Young
        } else if !self.settled {
            KeyInForce::None
        } else if self.key_age(now) < self.min_key_age() {
            KeyInForce::Young
        } else {
            KeyInForce::Settled
        }
    }

    /// Checks what has become due with time.
    fn check_age(&mut self, now: Now, with: &mut Surroundings<'_>) {
        // A clock that shows a time before the build is wrong.
        let wall_s = now.wall.as_secs().max(with.not_before.as_secs());
        let mut changed = self.record.note_clock(wall_s);
        if let Some(proven) = with.bridge.proven_key(self.index) {
            self.prove_pairing(now, proven, with);
            if self.record.note_key(proven, wall_s) {
                self.adopted_at = Some(now.mono);
                changed = true;
            }
        }
        if changed && let Err(fault) = self.record.save(with.records(), self.vehicle) {
            self.note(
                LogLevel::Warning,
                format!("the age of the key cannot be stored: {fault}"),
            );
        }
        self.replace_old(now, with);
    }

    /// Agrees on another key if the one in force is old.
    fn replace_old(&mut self, now: Now, with: &mut Surroundings<'_>) {
        let in_force = self.key_in_force(now);
        let (age, life) = (self.key_age(now), self.life());
        // Age never ends a key that is in use: it only starts an agreement about the next one.
        let old = self.record.key.is_some() && age >= life;
        let Machine::Paired(initiator) = &mut self.machine else {
            return;
        };
        initiator.set_key_in_force(in_force);
        let kept = self.keep_until.take_if(|until| now.mono >= *until);
        if kept.is_some() && initiator.memory().next.is_some() && !initiator.is_busy() {
            // The vehicle has not switched to it, or the agent has dropped it: only the agent knows.
            initiator.want();
        }
        if old
            && !initiator.is_busy()
            && initiator.memory().next.is_none()
            && now.mono >= self.again_at
        {
            initiator.want();
            let days = age.as_secs_f64() / 86_400.0;
            let text = format!(
                "the signing key is {days:.1} days old: agreeing on a new one, this one stays in use until then"
            );
            self.notify_once(now, AlertPriority::Nominal, text, with);
        }
    }

    /// A pairing that was answered and not confirmed is proven by a frame of the vehicle under its key.
    fn prove_pairing(&mut self, now: Now, proven: KeyId, with: &mut Surroundings<'_>) {
        let pending = self.record.pending.as_ref();
        let Some(pending) = pending.filter(|pending| pending.key == Some(*proven.bytes())) else {
            return;
        };
        // Stored first: a pairing that a restart would forget must not be used.
        let mut record = self.record.clone();
        (record.peer, record.pending) = (pending.peer, None);
        if let Err(fault) = record.save(with.records(), self.vehicle) {
            self.note(
                LogLevel::Warning,
                format!("the pairing cannot be stored: {fault}"),
            );
            return;
        }
        self.record = record;
        if let Err(fault) = self.pair(now, with) {
            self.note(LogLevel::Error, fault.to_string());
        }
        self.notify(
            now,
            ExchangeNotice::Over("the air-side agent is paired"),
            with,
        );
    }

    /// The vehicle signs with the next key, and it is the current one on disk.
    pub fn key_in_use(&mut self, now: Now, with: &mut Surroundings<'_>) {
        if let Machine::Paired(initiator) = &mut self.machine {
            let mut disk = GroundKeys {
                store: with.store,
                records: &mut with.records,
                keys: with.keys,
                record: &mut self.record,
                vehicle: self.vehicle,
            };
            // A paired initiator has nothing to store here.
            let _ = initiator.key_in_use(&mut disk);
            // The agent's last report, such as that it waits for the vehicle, no longer holds.
            "idle".clone_into(&mut self.state);
        }
        if let Ok(Some(key)) = with.keys.current() {
            let id = key.id();
            self.notify_once(
                now,
                AlertPriority::Nominal,
                format!("the vehicle signs with the new key {id}"),
                with,
            );
        }
        if !matches!(self.machine, Machine::Legacy(_)) {
            self.notify(now, ExchangeNotice::Over("the new key is in use"), with);
        }
        self.adopted_at = Some(now.mono);
        // Record the age of the new key now, not at the next check.
        self.check_at = now.mono;
    }

    /// Has the bridge look for the next key on disk in the vehicle's frames.
    fn offer(&mut self, now: Now, with: &mut Surroundings<'_>) {
        let offered = match with.keys.next() {
            Ok(Some(next)) => {
                with.bridge
                    .offer_next_key(self.index, next, now, with.not_before, with.store)
            }
            Ok(None) => return,
            Err(fault) => {
                self.note(LogLevel::Error, fault.to_string());
                return;
            }
        };
        if let Err(fault) = offered {
            let text = format!("the agreed key cannot be used before a restart: {fault}");
            self.note(LogLevel::Error, text);
        }
    }

    /// The next line for the log.
    pub fn poll_log(&mut self) -> Option<LogEntry> {
        if let Some(entry) = self.log.pop_front() {
            return Some(entry);
        }
        let lines = std::mem::take(&mut self.left_out);
        (lines > 0).then(|| LogEntry {
            level: LogLevel::Warning,
            about: self.vehicle,
            text: format!("too much at once: {lines} lines about the key exchange are not logged"),
        })
    }

    fn note(&mut self, level: LogLevel, text: String) {
        if self.log.len() < MAX_LOGGED {
            let about = self.vehicle;
            self.log.push_back(LogEntry { level, about, text });
        } else {
            self.left_out += 1;
        }
    }

    /// When [`KeyExchange::handle`] is next needed.
    #[must_use]
    pub fn poll_timeout(&self) -> Duration {
        let machine = match &self.machine {
            Machine::Unpaired => None,
            Machine::Paired(initiator) => initiator.poll_timeout(),
            Machine::Legacy(legacy) => Some(legacy.poll_timeout()),
        };
        machine.unwrap_or(Duration::MAX).min(self.check_at)
    }

    /// Orders the paired agent to zeroize. [`KeyExchange::zeroized`] returns the result.
    pub fn order_zeroize(&mut self, now: Now, in_flight: bool, with: &mut Surroundings<'_>) {
        let ordered = match &mut self.machine {
            Machine::Paired(one) => one.order_zeroize(now.mono, in_flight, with.random),
            Machine::Unpaired | Machine::Legacy(_) => Ok(false),
        };
        self.callers.call_back();
        self.zeroize = Some(match ordered {
            Ok(true) => NOT_REACHED.to_owned(),
            Ok(false) => "no agent is paired, and none was ordered to erase itself".to_owned(),
            Err(fault) => format!("{NOT_REACHED} ({fault})"),
        });
        self.handle(now, with);
    }

    /// The result of the order to zeroize; `None` while more may follow.
    #[must_use]
    pub fn zeroized(&self) -> Option<&str> {
        let waits = matches!(&self.machine, Machine::Paired(one) if one.is_ordering());
        self.zeroize.as_deref().filter(|_| !waits)
    }

    /// The vehicle.
    #[must_use]
    pub fn vehicle(&self) -> Id {
        self.vehicle
    }

    /// Resumes with a key that an earlier process agreed on and that is not known to be in use.
    pub fn take_up_next(&mut self, now: Now, with: &mut Surroundings<'_>) {
        self.offer(now, with);
    }
}

/// What operators see, and the status.
impl KeyExchange {
    /// Alerts that are active from the start: no agent is paired, or anyone may listen.
    fn announce(&mut self, now: Now, with: &mut Surroundings<'_>) {
        let text = match &self.machine {
            Machine::Unpaired => {
                "no air-side agent is paired: no key can be agreed on; run `vsm pair`"
            }
            Machine::Legacy(_) => {
                "the legacy key exchange is on: anyone in the middle can obtain the signing key"
            }
            Machine::Paired(_) => return,
        };
        self.notify(
            now,
            ExchangeNotice::Stands(AlertPriority::Warning, text.to_owned()),
            with,
        );
    }

    /// Processes the machine's events, and updates the status.
    fn report(&mut self, now: Now, with: &mut Surroundings<'_>) {
        while let Machine::Paired(initiator) = &mut self.machine
            && let Some(event) = initiator.poll_event()
        {
            self.follow(now, event, with);
        }
    }

    /// How it stands.
    pub(crate) fn status(&self) -> ExchangeStatus {
        let (mode, stats, next) = match &self.machine {
            Machine::Unpaired => ("on", None, None),
            Machine::Paired(initiator) => ("on", Some(initiator.stats()), initiator.memory().next),
            Machine::Legacy(legacy) => ("legacy", Some(legacy.stats()), None),
        };
        ExchangeStatus {
            mode,
            peer: self
                .record
                .peer()
                .map(|peer| peer.fingerprint().to_string()),
            state: self.state.clone(),
            next_key_id: next.map(|key| key.to_string()),
            taken: stats.map_or(0, |stats| stats.taken),
            ignored: stats.map_or(0, |stats| stats.by_reason().map(|(_, count)| count).sum()),
        }
    }

    fn follow(&mut self, now: Now, event: InitiatorEvent, with: &mut Surroundings<'_>) {
        use InitiatorEvent as E;
        match event {
            E::Begun { .. } => {
                "agreeing on a key".clone_into(&mut self.state);
            }
            E::NextStored { key } => {
                // Offered before the confirmation, which can be lost although PX4 is sent the key.
                self.offer(now, with);
                self.state = format!("key {key} is stored, waiting for the agent's confirmation");
            }
            E::Agreed { key, peer, epoch } => {
                self.state = format!("key {key} is agreed");
                self.record.agreed = Some(*key.bytes());
                self.keep_until = Some(now.mono.saturating_add(self.min_key_age()));
                if let Err(fault) = self.record.save(with.records(), self.vehicle) {
                    // After a restart another key is agreed on, which does no harm.
                    self.note(LogLevel::Warning, fault.to_string());
                }
                let peer = peer.fingerprint();
                let text = format!("key {key} is agreed with agent {peer} (epoch {epoch})");
                self.notify_once(now, AlertPriority::Nominal, text, with);
            }
            E::Status { status, reason } => self.notify_status(now, status, reason, with),
            E::Dropped { status } => {
                with.bridge.withdraw_next_key(self.index);
                self.keep_until = None;
                self.again_at = now.mono.saturating_add(AGAIN_AFTER);
                self.state = format!("the new key was dropped: {status}");
                let text = format!("the new key is dropped, the old one stays in use: {status}");
                self.notify(now, ExchangeNotice::Over("no key is pending"), with);
                self.notify_once(now, AlertPriority::Caution, text, with);
            }
            E::Promoted => {
                with.bridge.adopt_next_key(self.index, now, with.store);
                let text = "the vehicle already uses the new key";
                self.notify_once(now, AlertPriority::Nominal, text.to_owned(), with);
            }
            E::GaveUp { unanswered } => {
                let text = format!("the air-side agent does not answer ({unanswered:?})");
                self.note(LogLevel::Info, text);
                "the agent does not answer".clone_into(&mut self.state);
            }
            E::Rejected {
                status: Status::OtherVersion,
            } => {
                "the agent seems to speak another version of the exchange: update the older end"
                    .clone_into(&mut self.state);
            }
            // Anyone can send these in any number: they are counted, but neither alerted nor logged.
            E::Rejected { .. } => {}
            E::NotStored(cause) => {
                let text = format!("the key exchange cannot be stored: {cause}");
                self.notify_once(now, AlertPriority::Warning, text, with);
            }
            E::Zeroize { report: None } => self.zeroize = Some(NOT_REACHED.to_owned()),
            E::Zeroize {
                report: Some(report),
            } => self.zeroize = Some(report.to_string()),
            E::NoRandom => self.note(LogLevel::Error, "the system has no random bytes".to_owned()),
        }
    }

    fn notify_status(&mut self, now: Now, status: Status, reason: u8, with: &mut Surroundings<'_>) {
        self.state = format!("the agent reports: {status}");
        if reason != 0 {
            self.state += &format!(" ({reason})");
        }
        let (priority, text) = match status {
            Status::WaitDisarm => (
                AlertPriority::Nominal,
                "a new signing key waits until the vehicle is disarmed",
            ),
            Status::Sent => (
                AlertPriority::Nominal,
                "sending a new signing key to the vehicle: do not cut its power for 5 s",
            ),
            Status::Silent => (
                AlertPriority::Caution,
                "no data from the vehicle after a new key was sent: both keys are kept",
            ),
            Status::CannotSign => (
                AlertPriority::Warning,
                "the vehicle cannot sign: PX4 1.17 or older",
            ),
            _ => return,
        };
        self.notify(now, ExchangeNotice::Stands(priority, text.to_owned()), with);
    }

    fn notify_once(
        &self,
        now: Now,
        priority: AlertPriority,
        text: String,
        with: &mut Surroundings<'_>,
    ) {
        self.notify(now, ExchangeNotice::Once(priority, text), with);
    }

    fn notify(&self, now: Now, notice: ExchangeNotice, with: &mut Surroundings<'_>) {
        with.bridge
            .notify_of_exchange(self.index, now, notice, with.store);
    }
}

/// The ids of both ends, as used in the exchange.
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

fn fresh_identity(random: &mut dyn Random) -> Result<Identity, StoreError> {
    Identity::generate(random).map_err(|fault| StoreError::new("legacy", fault))
}

/// The text for operators about an agent that has not answered an order to zeroize.
pub(crate) const NOT_REACHED: &str = "the agent was NOT reached, and may erase nothing: run `vsm zeroize` with its airside.toml \
                                      on the vehicle's computer";
/// The purposes for which keys are agreed on.
pub(crate) const WANTED: Wanted = Wanted {
    signing: true,
    confidential: false,
};
const MAX_LOGGED: usize = 64;
/// How long a message that could not be sent is retried; after that the protocol repeats it.
const WORTH_SENDING: Duration = Duration::from_secs(2);
const LOOK_EVERY: Duration = Duration::from_secs(1);
/// A key that was agreed on less than this long ago is not replaced, whoever requests it. A key with a shorter configured
/// life is replaced at the end of that.
const MIN_KEY_AGE: Duration = Duration::from_secs(3_600);
/// Pause after a key that the vehicle did not accept.
const AGAIN_AFTER: Duration = Duration::from_secs(600);
