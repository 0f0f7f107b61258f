//! Both ends, an autopilot, a network that can do its worst and a person who pairs again: under a virtual clock.

use core::time::Duration;
use std::collections::{BTreeMap, VecDeque};
use std::time::Instant;

use mavlink_link::Now;
use mavlink_link::exchange::{
    Identity, Inbound, Initiator, InitiatorConfig, InitiatorEvent, Node, PairingCode, Parties,
    Responder, ResponderConfig, ResponderEvent, Status, Trust, Wanted,
};

use crate::disks::{AirDisk, GroundDisk, Key};

pub(crate) const GROUND: Node = Node {
    system: 245,
    component: 190,
};
pub(crate) const AIR: Node = Node {
    system: 1,
    component: 191,
};
/// Where the ground is.
pub(crate) const HONEST: u8 = 7;
pub(crate) const WANTED: Wanted = Wanted {
    signing: true,
    confidential: false,
};

pub(crate) fn parties() -> Parties {
    Parties::new(GROUND, AIR, 0x1b00_0001, 0x1b00_0101)
}

/// A message as it comes in at the ground.
pub(crate) fn inbound(source: Node, verified: bool, payload: &[u8]) -> Inbound<'_, ()> {
    Inbound {
        from: (),
        source,
        verified,
        payload,
    }
}

pub(crate) const fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// Random bytes that a test can have again.
#[derive(Debug, Clone)]
pub(crate) struct Dice(u64);

impl Dice {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1)
    }

    pub(crate) fn roll(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 16
    }

    pub(crate) fn below(&mut self, bound: u64) -> u64 {
        self.roll() % bound
    }

    pub(crate) fn chance(&mut self, percent: u64) -> bool {
        self.below(100) < percent
    }

    pub(crate) fn bytes(&mut self) -> [u8; 32] {
        core::array::from_fn(|_| self.roll() as u8)
    }

    pub(crate) fn fill(
        &mut self,
    ) -> impl FnMut(&mut [u8]) -> Result<(), mavlink_link::exchange::NoRandom> {
        |out: &mut [u8]| {
            out.iter_mut().for_each(|byte| *byte = self.roll() as u8);
            Ok(())
        }
    }
}

/// What the network does to one message of the exchange.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Treatment {
    Lose,
    Double,
    /// Comes late, behind what is sent after it.
    Delay(Duration),
}

/// What may go wrong at random, percent.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Weather {
    pub(crate) loss: u64,
    pub(crate) double: u64,
    pub(crate) late: u64,
    pub(crate) most_late: Duration,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Parcel {
    /// A KEY_EXCHANGE payload.
    Up(Vec<u8>),
    Down(Vec<u8>),
    /// A frame of the autopilot, signed with this key.
    Telemetry(Option<Key>),
}

pub(crate) struct World {
    pub(crate) now: Duration,
    pub(crate) dice: Dice,
    pub(crate) ground: Option<Initiator>,
    pub(crate) ground_disk: GroundDisk,
    pub(crate) air: Option<Responder<u8>>,
    pub(crate) air_disk: AirDisk,
    /// The key that the autopilot signs with.
    pub(crate) autopilot: Option<Key>,
    pub(crate) autopilot_refuses: bool,
    pub(crate) armed: bool,
    pub(crate) code: PairingCode,
    pub(crate) events: Vec<InitiatorEvent>,
    pub(crate) air_events: Vec<ResponderEvent>,
    /// Messages of the exchange sent so far.
    pub(crate) sent: usize,
    /// Bytes of the exchange on the wire, frames unsigned.
    pub(crate) bytes: usize,
    /// Real time spent in the machine on the ground and in that in the air, on this computer.
    pub(crate) worked: [Duration; 2],
    pub(crate) treatments: BTreeMap<usize, Treatment>,
    pub(crate) weather: Weather,
    /// Everything that was sent over the air, for an attacker who records.
    pub(crate) tape: Vec<Parcel>,
    /// Where a test is the network, what waits for it.
    pub(crate) held: Option<VecDeque<Parcel>>,
    /// What the air answers to other addresses than the ground's does not come to the ground.
    pub(crate) addressed: bool,
    under_way: Vec<(Duration, u64, Parcel)>,
    parcels: u64,
    identities: (Identity, Identity),
    ground_up: Option<Duration>,
    air_up: Option<Duration>,
    telemetry_at: Duration,
    hand_over_at: Option<Duration>,
    takes_at: Option<(Duration, Key)>,
    person_at: Duration,
}

impl World {
    /// Both paired and flying under one key.
    pub(crate) fn paired(seed: u64) -> Self {
        let mut world = Self::strangers(seed);
        let key = world.dice.bytes();
        world.ground_disk.current = Some(key);
        world.air_disk.current = Some(key);
        world.autopilot = Some(key);
        world.ground_disk.peer = Some(world.identities.1.public());
        world.air_disk.peer = Some(mavlink_link::exchange::PinnedPeer {
            key: world.identities.0.public(),
            counter: 0,
        });
        world.start_air();
        world.start_ground();
        if let Some(ground) = &mut world.ground {
            ground.want();
        }
        world
    }

    /// Never paired, the autopilot unsigned; a person opens the window and starts pairing.
    pub(crate) fn pairing(seed: u64) -> Self {
        let mut world = Self::strangers(seed);
        world.start_air();
        world.person();
        world
    }

    pub(crate) fn strangers(seed: u64) -> Self {
        let mut dice = Dice::new(seed);
        let identities = (Identity::new(dice.bytes()), Identity::new(dice.bytes()));
        let code = PairingCode::generate(&mut dice.fill()).unwrap();
        Self {
            now: Duration::from_secs(1),
            dice,
            ground: None,
            ground_disk: GroundDisk::default(),
            air: None,
            air_disk: AirDisk::default(),
            autopilot: None,
            autopilot_refuses: false,
            armed: false,
            code,
            events: Vec::new(),
            air_events: Vec::new(),
            sent: 0,
            bytes: 0,
            worked: [Duration::ZERO; 2],
            treatments: BTreeMap::new(),
            weather: Weather::default(),
            tape: Vec::new(),
            held: None,
            addressed: false,
            under_way: Vec::new(),
            parcels: 0,
            identities,
            ground_up: None,
            air_up: None,
            telemetry_at: Duration::ZERO,
            hand_over_at: None,
            takes_at: None,
            person_at: Duration::MAX,
        }
    }

    pub(crate) fn clock(&self) -> Now {
        Now {
            mono: self.now,
            wall: Duration::from_secs(1_800_000_000) + self.now,
        }
    }

    pub(crate) fn ground_identity(&self) -> &Identity {
        &self.identities.0
    }

    pub(crate) fn air_identity(&self) -> &Identity {
        &self.identities.1
    }

    /// `vsm run` where the agent is known, else `vsm pair`.
    pub(crate) fn start_ground(&mut self) {
        let trust = match self.ground_disk.peer {
            Some(peer) => Trust::Pinned(peer),
            None => Trust::Pairing(self.code.duplicate()),
        };
        let pairing = matches!(trust, Trust::Pairing(_));
        let config = InitiatorConfig {
            parties: parties(),
            identity: self.identities.0.duplicate(),
            trust,
            wanted: WANTED,
        };
        let mut ground = Initiator::new(config, self.ground_disk.memory(), self.now);
        if pairing || self.ground_disk.next.is_some() {
            ground.want();
        }
        self.ground = Some(ground);
    }

    pub(crate) fn start_air(&mut self) {
        let config = ResponderConfig {
            parties: parties(),
            identity: self.identities.1.duplicate(),
            wanted: WANTED,
        };
        self.air = Some(Responder::new(config, self.air_disk.memory(), self.now));
        self.hand_over_at = None;
        if let Some((key, true)) = self.air_disk.next {
            // It may have been taken: asked, and sent again where it was not.
            self.takes_at = self.takes_at.or(Some((self.now + ms(200), key)));
        }
    }

    pub(crate) fn kill_ground(&mut self, down_for: Duration) {
        self.ground = None;
        self.ground_up = Some(self.now + down_for);
        self.ground_disk.writes.died = false;
    }

    pub(crate) fn kill_air(&mut self, down_for: Duration) {
        self.air = None;
        self.air_up = Some(self.now + down_for);
        self.air_disk.writes.died = false;
    }

    /// A person who sees that the two are not paired opens the window and starts `vsm pair`, again.
    pub(crate) fn person(&mut self) {
        self.person_at = self.now + Duration::from_secs(30);
        if self.is_paired() {
            self.person_at = Duration::MAX;
            return;
        }
        if let Some(air) = &mut self.air
            && air.window(self.now).is_none()
        {
            // Refused while a key is on its way: next time, then.
            let _ = air.open_window(self.now, &self.code, &mut self.air_disk);
            self.after_air();
        }
        if self.ground_up.is_none() {
            let idle = self.ground.as_ref().is_none_or(|ground| !ground.is_busy());
            let pinned = self.ground_disk.peer.take();
            if idle || pinned.is_some() {
                self.start_ground();
            }
        }
    }

    pub(crate) fn is_paired(&self) -> bool {
        self.ground_disk.peer == Some(self.identities.1.public())
            && self.air_disk.peer.map(|peer| peer.key) == Some(self.identities.0.public())
    }

    /// One key everywhere, and none that waits.
    pub(crate) fn is_settled(&self) -> bool {
        self.ground.as_ref().is_some_and(|ground| !ground.is_busy())
            && self.autopilot.is_some()
            && self.ground_disk.current == self.autopilot
            && self.air_disk.current == self.autopilot
            && self.ground_disk.next.is_none()
            && self.air_disk.next.is_none()
            && self.is_paired()
    }

    /// Lets time pass until then.
    pub(crate) fn run_until(&mut self, end: Duration) {
        while let Some(next) = self.next_event().filter(|next| *next <= end) {
            self.now = self.now.max(next);
            self.step();
            self.check();
        }
        self.now = self.now.max(end);
    }

    /// Lets time pass until it is settled; gives the time that took.
    pub(crate) fn run_until_settled(&mut self, most: Duration) -> Option<Duration> {
        let begun = self.now;
        while self.now < begun + most {
            if self.is_settled() {
                return Some(self.now - begun);
            }
            let next = self.now + ms(10);
            self.run_until(next);
        }
        self.is_settled().then(|| self.now - begun)
    }

    fn next_event(&self) -> Option<Duration> {
        let ground = self.ground.as_ref().and_then(Initiator::poll_timeout);
        let air = self.air.as_ref().and_then(Responder::poll_timeout);
        let parcels = self.under_way.iter().map(|(at, _, _)| *at);
        let takes = self.takes_at.map(|(at, _)| at);
        parcels
            .chain(ground)
            .chain(air)
            .chain(takes)
            .chain([self.telemetry_at, self.person_at])
            .chain(self.hand_over_at)
            .chain(self.ground_up)
            .chain(self.air_up)
            .min()
    }

    fn step(&mut self) {
        if self.ground_up.take_if(|at| *at <= self.now).is_some() {
            self.start_ground();
        }
        if self.air_up.take_if(|at| *at <= self.now).is_some() {
            self.start_air();
        }
        if self.person_at <= self.now {
            self.person();
        }
        self.autopilot_step();
        if self.telemetry_at <= self.now {
            self.telemetry_at = self.now + ms(200);
            if self.air.is_some() {
                self.post(Parcel::Telemetry(self.autopilot));
            }
        }
        if let Some(ground) = &mut self.ground {
            let now = Now {
                mono: self.now,
                wall: Duration::from_secs(1_800_000_000) + self.now,
            };
            let begun = Instant::now();
            ground.handle_timeout(now, &mut self.dice.fill(), &mut self.ground_disk);
            self.worked[0] += begun.elapsed();
        }
        self.after_ground();
        if let Some(air) = &mut self.air {
            air.handle_timeout(self.now);
        }
        self.after_air();
        while let Some(at) = self.under_way.iter().position(|(at, _, _)| *at <= self.now) {
            let (_, _, parcel) = self.under_way.remove(at);
            self.deliver(&parcel);
        }
    }

    /// The agent hands a staged key over, and the autopilot takes it, or does not.
    fn autopilot_step(&mut self) {
        if self.hand_over_at.take_if(|at| *at <= self.now).is_some()
            && let (Some((key, sent)), Some(air)) = (&mut self.air_disk.next, &mut self.air)
        {
            if self.armed {
                air.report(Status::WaitDisarm, 0);
                self.hand_over_at = Some(self.now + ms(500));
            } else {
                *sent = true;
                air.key_sent();
                self.takes_at = Some((self.now + ms(300), *key));
            }
        }
        if let Some((_, key)) = self.takes_at.take_if(|(at, _)| *at <= self.now) {
            let refused = self.autopilot_refuses;
            if !refused {
                self.autopilot = Some(key);
            }
            if let (Some(air), Some((next, _))) = (&mut self.air, self.air_disk.next)
                && next == key
            {
                self.air_disk.next = None;
                if refused {
                    air.key_dropped();
                } else {
                    self.air_disk.current = Some(key);
                    air.key_active();
                }
            }
        }
    }

    pub(crate) fn deliver(&mut self, parcel: &Parcel) {
        match parcel {
            Parcel::Up(payload) => self.air_hears(HONEST, GROUND, false, payload),
            Parcel::Down(payload) => self.ground_hears(AIR, payload),
            Parcel::Telemetry(key) => self.receive_signed(*key),
        }
    }

    pub(crate) fn air_hears(&mut self, from: u8, source: Node, verified: bool, payload: &[u8]) {
        if let Some(air) = &mut self.air {
            let inbound = Inbound {
                from,
                source,
                verified,
                payload,
            };
            let begun = Instant::now();
            let _ = air.handle(self.now, inbound, &mut self.dice.fill(), &mut self.air_disk);
            self.worked[1] += begun.elapsed();
        }
        self.after_air();
    }

    pub(crate) fn ground_hears(&mut self, source: Node, payload: &[u8]) {
        self.ground_hears_as(source, false, payload);
    }

    pub(crate) fn ground_hears_as(&mut self, source: Node, verified: bool, payload: &[u8]) {
        let now = self.clock();
        if let Some(ground) = &mut self.ground {
            let begun = Instant::now();
            let _ = ground.handle(
                now,
                inbound(source, verified, payload),
                &mut self.ground_disk,
            );
            self.worked[0] += begun.elapsed();
        }
        self.after_ground();
    }

    /// A frame of the autopilot at the ground.
    fn receive_signed(&mut self, key: Option<Key>) {
        let Some(key) = key.filter(|key| self.ground_disk.next == Some(*key)) else {
            return;
        };
        if self.ground.is_none() {
            return;
        }
        use mavlink_link::exchange::InitiatorStore as _;
        if self.ground_disk.promote_next().is_ok() {
            if let Some(ground) = &mut self.ground {
                let _ = ground.key_in_use(&mut self.ground_disk);
            }
            if let Some((peer, _)) = self
                .ground_disk
                .pending
                .take_if(|(_, pending)| *pending == key)
            {
                self.ground_disk.peer = Some(peer);
                self.start_ground();
            }
        }
        self.after_ground();
    }

    fn after_ground(&mut self) {
        if self.ground_disk.writes.died {
            self.kill_ground(ms(100));
            return;
        }
        let Some(mut ground) = self.ground.take() else {
            return;
        };
        while let Some(message) = ground.poll_transmit() {
            self.post(Parcel::Up(wire(&message.to_payload())));
        }
        while let Some(event) = ground.poll_event() {
            // A first key is in force as soon as it is agreed: there is no other.
            if matches!(event, InitiatorEvent::Agreed { .. }) && self.ground_disk.current.is_none()
            {
                self.ground_disk.current = self.ground_disk.next.take();
                let _ = ground.key_in_use(&mut self.ground_disk);
            }
            self.events.push(event);
        }
        self.ground = Some(ground);
    }

    fn after_air(&mut self) {
        if self.air_disk.writes.died {
            self.kill_air(ms(100));
            return;
        }
        let Some(mut air) = self.air.take() else {
            return;
        };
        while let Some(outbound) = air.poll_transmit() {
            if self.addressed && outbound.to != HONEST {
                continue;
            }
            self.post(Parcel::Down(wire(&outbound.message.to_payload())));
        }
        while let Some(event) = air.poll_event() {
            self.air_events.push(event);
        }
        self.air = Some(air);
        let staged = matches!(self.air_disk.next, Some((_, false)));
        match (staged, self.hand_over_at) {
            (true, None) => self.hand_over_at = Some(self.now + ms(1_000)),
            (false, Some(_)) => self.hand_over_at = None,
            _ => {}
        }
    }

    /// Puts something on the network, which treats it as configured.
    pub(crate) fn post(&mut self, parcel: Parcel) {
        let mut arrivals = vec![ms(20)];
        if let Parcel::Up(payload) | Parcel::Down(payload) = &parcel {
            self.bytes += payload.len() + 12;
            match self.treatments.get(&self.sent) {
                Some(Treatment::Lose) => arrivals.clear(),
                Some(Treatment::Double) => arrivals.push(ms(25)),
                Some(Treatment::Delay(by)) => arrivals[0] += *by,
                None => {}
            }
            self.sent += 1;
            self.tape.push(parcel.clone());
            if let Some(held) = &mut self.held {
                held.push_back(parcel);
                return;
            }
        }
        let weather = self.weather;
        if self.dice.chance(weather.double) {
            arrivals.push(ms(30));
        }
        for mut delay in arrivals {
            if self.dice.chance(weather.loss) {
                continue;
            }
            if self.dice.chance(weather.late) {
                delay += ms(self.dice.below(weather.most_late.as_millis() as u64 + 1));
            }
            self.parcels += 1;
            self.under_way
                .push((self.now + delay, self.parcels, parcel.clone()));
        }
        self.under_way.sort_by_key(|(at, number, _)| (*at, *number));
    }

    /// What must hold at every moment, whichever end has just died: the ground has the key that the vehicle signs with, and
    /// every key that the agent could hand to it.
    fn check(&self) {
        if let Some(key) = self.autopilot {
            assert!(
                self.ground_disk.has(&key),
                "{:?}: the vehicle signs with a key that the ground has not",
                self.now
            );
        }
        if let Some((key, _)) = self.air_disk.next {
            assert!(
                self.ground_disk.has(&key),
                "{:?}: the agent could hand over a key that the ground has not",
                self.now
            );
        }
        if let Some((_, key)) = self.takes_at {
            assert!(self.ground_disk.has(&key), "{:?}: on its way", self.now);
        }
    }
}

/// A payload as it travels: trailing zeros trimmed.
pub(crate) fn wire(payload: &[u8]) -> Vec<u8> {
    let used = payload
        .iter()
        .rposition(|&byte| byte != 0)
        .map_or(1, |at| at + 1);
    payload[..used].to_vec()
}
