//! The whole way from a station to PX4, ground and agent with keys agreed over the air, while somebody without any key
//! sends what he likes to either end: no key changes, PX4 is given none, nothing on a disk changes, commands are obeyed.

use std::collections::BTreeSet;
use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use kit::bridge::{Station, cucs, orders, station_address, vehicle_id};
use mavlink_link::Now;
use mavlink_link::dialect::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, RADIO_STATUS_DATA, STATUSTEXT_DATA, SYSTEM_TIME_DATA,
};
use mavlink_link::exchange::{
    Data, Identity, Message, NoRandom, Node, PinnedPeer, Random, Received, Responder,
    ResponderConfig, ResponderMemory, Status, Step, VERSION, Wanted,
};
use mavlink_link::frame::{FrameView, KEY_EXCHANGE_ID, MAX_FRAME};
use mavlink_link::receiver::Stream;
use mavlink_link::signing::{KeyId, SigningKey, Stamp};
use px4_sim::{Autopilot, Signing};
use stanag_msgs::enums::AckType;
use vsm::airside::{Agent, Side};
use vsm::config::{Config, Signing as LinkSigning};
use vsm::key_exchange::{self, ExchangeRecord, KeyExchange, Surroundings};
use vsm::session::{Bridge, Destination, KeyChange, LinkEnd, Peer};
use vsm::shell::disk::FileDisk;
use vsm::shell::key_store::KeyStore;

use crate::world::{self, Disk, at, frame, key};

const NOT_BEFORE: Duration = Duration::from_secs(1_767_225_600);
/// Where the agent's radio and the ground are for each other, and where the attacker is.
const AGENT: u16 = 2_001;
const ATTACKER: u16 = 6_666;
const TICK: Duration = Duration::from_millis(50);
const AIR: Node = Node {
    system: 1,
    component: 191,
};
const GROUND: Node = Node {
    system: 245,
    component: 190,
};

/// Station, ground, agent and PX4.
struct Flight {
    now: Now,
    station: Station,
    bridge: Bridge,
    exchange: KeyExchange,
    store: FileDisk,
    keys: KeyStore,
    agent: Agent,
    disk: Disk,
    px4: Autopilot<Peer>,
    /// How often the key in force has changed on the ground.
    changes: usize,
    /// How often PX4 was sent a key.
    secrets: usize,
    /// KEY_EXCHANGE frames that the ground sent, and the agent.
    exchanged: [usize; 2],
    log: Vec<String>,
    seed: u64,
    folder: tempfile::TempDir,
}

fn config(folder: &Path, link: &str) -> Config {
    let text = format!(
        "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:0\"\n\
         [[vehicle]]\nid = \"1b:00:01:01\"\nlink = \"{link}\"\nsystem_id = 1\n\
         signing = {{ key_file = \"uav1.key\", exchange = \"on\" }}\n\
         [[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2, 3, 4, 5]\n[store]\ndir = \"state\"\n"
    );
    Config::parse(&text, folder).expect("good")
}

impl Flight {
    /// Paired, and flying under one key for a day.
    fn begin(agents_key: Option<SigningKey>, px4: Signing, seen: bool) -> Flight {
        let now = Now {
            mono: Duration::from_secs(100),
            wall: Duration::from_secs(1_795_246_260),
        };
        let folder = tempfile::tempdir().unwrap();
        let config = config(folder.path(), "udpout:127.0.0.1:2001");
        let mut store = FileDisk::open(&config.store.dir).unwrap();
        let keys = KeyStore::open(&folder.path().join("uav1.key")).unwrap();
        keys.stage(&key(5)).unwrap();
        keys.commit().unwrap();
        let mut dice = dice(1);
        let ground = key_exchange::identity(&mut store, &mut dice)
            .unwrap()
            .public();
        let vehicle = config.vehicles().next().unwrap();
        let mut record = ExchangeRecord {
            peer: Some(*Identity::new([7; 32]).public().bytes()),
            ..ExchangeRecord::default()
        };
        if seen {
            record.note_key(key(5).id(), now.wall.as_secs() - 86_400);
        }
        record.save(&mut store, vehicle.id).unwrap();
        let end = LinkEnd {
            key: Some(key(5)),
            peer: Some(at(AGENT)),
        };
        let mut bridge = Bridge::new(&config, vec![end], now, NOT_BEFORE, &mut store).unwrap();
        let LinkSigning::KeyFile(_, settings) = &vehicle.signing else {
            panic!("signed");
        };
        let mut with = surroundings(&mut bridge, &mut store, &keys, &mut dice);
        let exchange = KeyExchange::open(&config, vehicle, 0, *settings, now, &mut with).unwrap();
        let mut disk = Disk {
            current: agents_key,
            peer: Some(PinnedPeer {
                key: ground,
                counter: 0,
            }),
            ..Disk::default()
        };
        Flight {
            now,
            station: Station::new(cucs(0), station_address(0)),
            bridge,
            exchange,
            store,
            keys,
            agent: world::start(self::settings(), &mut disk, now),
            disk,
            px4: Autopilot::new(px4_sim::Config::default(), px4, vec![Some(at(9))]),
            changes: 0,
            secrets: 0,
            exchanged: [0; 2],
            log: vec![],
            seed: 7,
            folder,
        }
    }

    /// In the air's usual state: all three share a key, the station has all rights.
    fn live() -> Flight {
        let mut flight = Flight::begin(Some(key(5)), Signing::with_key(key(5), 0), true);
        flight.run(9.0);
        assert_eq!(
            flight.carry_out(orders::request_control().into()),
            Some(AckType::CarriedOut)
        );
        flight.run(1.0);
        (flight.exchanged, flight.secrets) = ([0; 2], 0);
        flight
    }

    fn with_exchange<T>(
        &mut self,
        act: impl FnOnce(&mut KeyExchange, Now, &mut Surroundings<'_>) -> T,
    ) -> T {
        self.seed += 1;
        let mut dice = dice(self.seed);
        let mut with = surroundings(&mut self.bridge, &mut self.store, &self.keys, &mut dice);
        act(&mut self.exchange, self.now, &mut with)
    }

    /// What the shell of the ground does after each call of the bridge.
    fn follow_ground(&mut self) {
        self.with_exchange(|exchange, now, with| exchange.handle(now, with));
        while let Some((_, change)) = self.bridge.poll_key_change() {
            assert_eq!(change, KeyChange::Commit);
            self.keys.commit().unwrap();
            self.changes += 1;
            self.with_exchange(|exchange, now, with| {
                exchange.key_in_use(now, with);
                exchange.handle(now, with);
            });
        }
        while let Some(entry) = self.bridge.poll_log() {
            self.log.push(entry.text);
        }
        while let Some(entry) = self.exchange.poll_log() {
            self.log.push(entry.text);
        }
        while let Some(datagram) = self.bridge.poll_dli() {
            if datagram.to == Destination::Unicast(self.station.address) {
                self.station.receive(self.now, datagram.bytes());
            }
        }
        while let Some((_, frame)) = self.bridge.poll_vehicle() {
            self.exchanged[0] += usize::from(is_exchange(frame.bytes()));
            if frame.to == at(AGENT) {
                self.agent_hears(world::GROUND, frame.bytes());
            }
        }
    }

    /// A datagram at the ground.
    fn ground_hears(&mut self, from: u16, bytes: &[u8]) {
        self.bridge.handle_vehicle(
            self.now,
            0,
            at(from),
            bytes,
            &mut self.store,
            &mut |_, _| {},
        );
        self.follow_ground();
    }

    /// A datagram at the agent's radio.
    fn agent_hears(&mut self, from: u16, bytes: &[u8]) {
        self.seed += 1;
        let mut dice = dice(self.seed);
        self.agent
            .handle_radio(self.now, at(from), bytes, &mut dice, &mut self.disk);
        self.follow_agent();
    }

    fn follow_agent(&mut self) {
        let mut out = [0; MAX_FRAME];
        while let Some(sent) = self.agent.poll_transmit(self.now, &mut self.disk, &mut out) {
            let bytes = out[..sent.len].to_vec();
            match sent.side {
                Side::Px4 => {
                    self.secrets += usize::from(sent.secret);
                    self.px4.handle_datagram(0, at(9), &bytes);
                }
                Side::Radio => {
                    self.exchanged[1] += usize::from(is_exchange(&bytes));
                    if sent.to == at(world::GROUND) {
                        self.ground_hears(AGENT, &bytes);
                    }
                }
            }
        }
        while let Some(note) = self.agent.poll_note() {
            self.log.push(note.text);
        }
    }

    fn tick(&mut self) {
        self.now = self.now.after(TICK);
        self.px4.step(TICK);
        let mut out = [0; MAX_FRAME];
        while let Some(sent) = self.px4.poll_transmit(&mut out) {
            let bytes = out[..sent.len].to_vec();
            self.agent
                .handle_px4(self.now, at(world::PX4), &bytes, &mut self.disk);
            self.follow_agent();
        }
        self.agent.handle_timeout(self.now, &mut self.disk);
        self.follow_agent();
        for bytes in self.station.advance(self.now) {
            let from: SocketAddr = self.station.address;
            self.bridge
                .handle_dli(self.now, from, &bytes, &mut self.store);
            self.follow_ground();
        }
        self.bridge.handle_timeout(self.now, &mut self.store);
        self.follow_ground();
    }

    fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / TICK.as_secs_f64()) as usize {
            self.tick();
        }
    }

    fn carry_out(&mut self, message: stanag_msgs::Message) -> Option<AckType> {
        self.carry_out_beside(message, &mut |_| {})
    }

    /// Sends a command and waits for its end, while somebody else does what he does at each tick.
    fn carry_out_beside(
        &mut self,
        message: stanag_msgs::Message,
        beside: &mut dyn FnMut(&mut Flight),
    ) -> Option<AckType> {
        let ticket = self.station.send(self.now, vehicle_id(0), message);
        for _ in 0..600 {
            if let Some(end) = self.station.end(ticket) {
                return Some(end);
            }
            beside(self);
            self.tick();
        }
        None
    }

    /// Names of the files at both ends.
    fn files(&self) -> BTreeSet<String> {
        let mut names = BTreeSet::new();
        for folder in [
            self.folder.path().to_owned(),
            self.folder.path().join("state"),
        ] {
            for entry in std::fs::read_dir(folder).unwrap() {
                names.insert(entry.unwrap().file_name().into_string().unwrap());
            }
        }
        names.extend(
            self.disk
                .ceilings
                .records
                .keys()
                .map(|name| format!("air: {name}")),
        );
        let held = [&self.disk.current, &self.disk.next, &self.disk.previous];
        names.extend(
            held.into_iter()
                .flatten()
                .map(|key| format!("air: key {}", key.id())),
        );
        // That a mode was commanded, lawfully.
        names.retain(|name| !name.starts_with("repeated-"));
        names
    }

    fn key_in_force(&self) -> KeyId {
        self.keys.current().unwrap().unwrap().id()
    }

    /// Nothing has come of it.
    fn assert_untouched(&self, files: &BTreeSet<String>) {
        assert_eq!(self.changes, 0, "keys changed: {:?}", self.log);
        assert_eq!(self.secrets, 0, "PX4 was sent a key: {:?}", self.log);
        assert_eq!(self.key_in_force(), key(5).id());
        assert_eq!(&self.files(), files);
        assert_eq!(self.exchanged[0], 0, "the ground has begun an exchange");
        let alarm = |text: &String| text.contains("key may be lost") || text.contains("wrong code");
        assert!(
            !self.station.alerts().iter().any(alarm),
            "{:?}",
            self.station.alerts()
        );
        assert!(!self.log.iter().any(alarm), "{:?}", self.log);
    }
}

/// What an exchange of the ground needs for one call.
fn surroundings<'a>(
    bridge: &'a mut Bridge,
    store: &'a mut FileDisk,
    keys: &'a KeyStore,
    random: &'a mut dyn Random,
) -> Surroundings<'a> {
    Surroundings {
        bridge,
        store,
        records: None,
        keys,
        random,
        not_before: NOT_BEFORE,
    }
}

fn settings() -> vsm::airside::Settings {
    vsm::airside::Settings {
        restamp: true,
        ..world::settings()
    }
}

fn dice(mut seed: u64) -> impl FnMut(&mut [u8]) -> Result<(), NoRandom> {
    move |out: &mut [u8]| {
        for byte in out {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695);
            *byte = (seed >> 56) as u8;
        }
        Ok(())
    }
}

fn is_exchange(bytes: &[u8]) -> bool {
    let frame = FrameView::parse(bytes).unwrap();
    frame.header().message_id == KEY_EXCHANGE_ID
}

fn stream(node: Node) -> Stream {
    Stream {
        system: node.system,
        component: node.component,
        link: 0,
    }
}

/// A KEY_EXCHANGE frame of anyone, unsigned.
fn exchange(from: Node, target: Node, step: Step, suite: u8, n: u32) -> Vec<u8> {
    let message = Message {
        public_key: [n as u8 | 1; 32],
        session: n.wrapping_mul(2_654_435_761) | 1,
        version: VERSION,
        step,
        suite,
        status: Status::from((n % 12) as u8),
        target,
        data: Data::new(&[n as u8; 104]).unwrap(),
    };
    frame(stream(from), KEY_EXCHANGE_ID, &message.to_payload(), None)
}

/// The document's 54 bytes: step 0 with nothing in it.
fn please() -> Vec<u8> {
    let message = Message {
        public_key: [0; 32],
        session: 0,
        version: VERSION,
        step: Step::Please,
        suite: 1,
        status: Status::Ok,
        target: GROUND,
        data: Data::EMPTY,
    };
    frame(stream(AIR), KEY_EXCHANGE_ID, &message.to_payload(), None)
}

const STEPS: [Step; 8] = [
    Step::Please,
    Step::Offer,
    Step::Answer,
    Step::Confirm,
    Step::Outcome,
    Step::Unknown(5),
    Step::Reject,
    Step::Unknown(200),
];

#[test]
fn an_unsigned_please_changes_no_key() {
    let mut flight = Flight::live();
    let files = flight.files();
    for second in 0..180 {
        flight.ground_hears(ATTACKER, &please());
        flight.ground_hears(AGENT, &please());
        flight.run(1.0);
        if second % 60 == 59 {
            let end = flight.carry_out(orders::request_control().into());
            assert_eq!(end, Some(AckType::CarriedOut), "{:?}", flight.log);
        }
    }
    flight.assert_untouched(&files);
}

#[test]
fn nothing_unsigned_changes_a_key_at_either_end() {
    let mut flight = Flight::live();
    let files = flight.files();
    let mut n = 0;
    let mut attack = |flight: &mut Flight| {
        for step in STEPS {
            for suite in [0, 1, 2, 3] {
                n += 1;
                let from = ATTACKER + (n % 40) as u16;
                flight.ground_hears(from, &exchange(AIR, GROUND, step, suite, n));
                flight.agent_hears(from, &exchange(GROUND, AIR, step, suite, n));
            }
        }
        // The older exchange: a public key alone.
        let legacy = |of: Node| frame(stream(of), KEY_EXCHANGE_ID, &[9; 32], None);
        flight.ground_hears(ATTACKER, &legacy(AIR));
        flight.agent_hears(ATTACKER, &legacy(GROUND));
        for (message, sender) in others() {
            let bytes = world::encoded(stream(sender), &message);
            flight.ground_hears(ATTACKER, &bytes);
            flight.agent_hears(ATTACKER, &bytes);
        }
    };
    for _ in 0..2_400 {
        attack(&mut flight);
        flight.tick();
    }
    let end = flight.carry_out_beside(orders::request_control().into(), &mut attack);
    assert_eq!(end, Some(AckType::CarriedOut), "{:?}", flight.log);
    let end = flight.carry_out_beside(orders::launch(20.0).into(), &mut attack);
    assert_eq!(end, Some(AckType::CarriedOut), "{:?}", flight.log);
    flight.assert_untouched(&files);
    // What was answered is bounded: the agent refuses a few a second by name, so that an honest peer can learn of it.
    assert!(flight.exchanged[1] < 6 * 130, "{:?}", flight.exchanged);
}

/// What else may look like a vehicle that has restarted or lost its key, or like a radio.
fn others() -> Vec<(MavMessage, Node)> {
    let px4 = Node {
        system: 1,
        component: 1,
    };
    let radio = Node {
        system: 51,
        component: 68,
    };
    let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
        ..HEARTBEAT_DATA::default()
    });
    let booted = MavMessage::SYSTEM_TIME(SYSTEM_TIME_DATA {
        time_boot_ms: 5,
        ..SYSTEM_TIME_DATA::default()
    });
    vec![
        (beat.clone(), px4),
        (beat, AIR),
        (booted, px4),
        (MavMessage::STATUSTEXT(STATUSTEXT_DATA::default()), px4),
        (
            MavMessage::RADIO_STATUS(RADIO_STATUS_DATA::default()),
            radio,
        ),
    ]
}

/// A ground that listens and knows its agent by a pairing alone, and what that agent sends to ask for an exchange.
struct Listening {
    now: Now,
    bridge: Bridge,
    exchange: KeyExchange,
    store: FileDisk,
    keys: KeyStore,
    please: Vec<u8>,
    seed: u64,
    _folder: tempfile::TempDir,
}

impl Listening {
    fn start() -> Listening {
        let now = Now {
            mono: Duration::from_secs(100),
            wall: Duration::from_secs(1_795_246_260),
        };
        let folder = tempfile::tempdir().unwrap();
        let config = config(folder.path(), "udpin:127.0.0.1:0");
        let vehicle = config.vehicles().next().unwrap();
        let mut store = FileDisk::open(&config.store.dir).unwrap();
        let keys = KeyStore::open(&folder.path().join("uav1.key")).unwrap();
        let mut dice = dice(1);
        let ground = key_exchange::identity(&mut store, &mut dice)
            .unwrap()
            .public();
        let agent = Identity::new([7; 32]);
        let record = ExchangeRecord {
            peer: Some(*agent.public().bytes()),
            ..ExchangeRecord::default()
        };
        record.save(&mut store, vehicle.id).unwrap();
        let LinkSigning::KeyFile(_, settings) = &vehicle.signing else {
            panic!("signed");
        };
        let responder = ResponderConfig {
            parties: key_exchange::parties(&config, vehicle, *settings),
            identity: agent,
            wanted: Wanted {
                signing: true,
                confidential: false,
            },
        };
        let paired = ResponderMemory {
            peer: Some(PinnedPeer {
                key: ground,
                counter: 0,
            }),
            ..ResponderMemory::default()
        };
        let mut responder: Responder<u8> = Responder::new(responder, paired, now.mono);
        let please = responder.please(now.mono).unwrap().to_payload();
        let end = LinkEnd {
            key: Some(key(5)),
            peer: None,
        };
        let mut bridge = Bridge::new(&config, vec![end], now, NOT_BEFORE, &mut store).unwrap();
        let mut with = surroundings(&mut bridge, &mut store, &keys, &mut dice);
        let exchange = KeyExchange::open(&config, vehicle, 0, *settings, now, &mut with).unwrap();
        Listening {
            now,
            bridge,
            exchange,
            store,
            keys,
            please: frame(stream(AIR), KEY_EXCHANGE_ID, &please, None),
            seed: 1,
            _folder: folder,
        }
    }

    fn arrives(&mut self, from: u16, bytes: &[u8]) {
        self.bridge.handle_vehicle(
            self.now,
            0,
            at(from),
            bytes,
            &mut self.store,
            &mut |_, _| {},
        );
        self.with_exchange(|exchange, now, with| exchange.handle(now, with));
    }

    fn is_asked_from(&mut self, port: u16) {
        let please = self.please.clone();
        self.arrives(port, &please);
    }

    fn order_zeroize(&mut self) {
        self.with_exchange(|exchange, now, with| exchange.order_zeroize(now, false, with));
    }

    fn with_exchange(&mut self, act: impl FnOnce(&mut KeyExchange, Now, &mut Surroundings<'_>)) {
        self.seed += 1;
        let mut dice = dice(self.seed);
        let mut with = surroundings(&mut self.bridge, &mut self.store, &self.keys, &mut dice);
        act(&mut self.exchange, self.now, &mut with);
    }

    /// How many orders to zeroize have been sent to that port since the last call.
    fn orders_to(&mut self, port: u16) -> usize {
        let sent = std::iter::from_fn(|| self.bridge.poll_vehicle());
        let orders = sent.filter(|(_, sent)| {
            let frame = FrameView::parse(sent.bytes()).unwrap();
            let order = matches!(
                Message::parse(frame.payload()),
                Ok(Received::Exchange(message)) if message.step == Step::Order
            );
            sent.to == at(port) && is_exchange(sent.bytes()) && order
        });
        orders.count()
    }
}

#[test]
fn a_request_that_is_replayed_keeps_no_order_to_zeroize_from_the_agent() {
    // The agent asks before the order, or after it.
    for asks_at in [300, 1_300] {
        let mut ground = Listening::start();
        let mut orders = 0;
        for ms in (0..2_000).step_by(10) {
            ground.now = ground.now.after(Duration::from_millis(10));
            ground.is_asked_from(ATTACKER);
            if ms == asks_at {
                ground.is_asked_from(AGENT);
            }
            if ms == 1_000 {
                ground.order_zeroize();
            }
            orders += ground.orders_to(AGENT);
        }
        assert!(
            orders > 0,
            "the agent that asks at {asks_at} ms is not reached"
        );
    }
}

#[test]
fn what_is_owed_to_who_asked_does_not_go_to_an_agent_that_has_been_found() {
    let mut ground = Listening::start();
    for port in 1..=50 {
        ground.is_asked_from(ATTACKER + port);
    }
    let autopilot = stream(Node {
        system: 1,
        component: 1,
    });
    let stamp = Stamp::from_unix(ground.now.wall + Duration::from_secs(1));
    let beat = frame(autopilot, 0, &[1; 9], Some((&key(5), stamp)));
    ground.arrives(AGENT, &beat);
    assert!(ground.bridge.has_peer(0));
    ground.order_zeroize();
    assert_eq!(ground.orders_to(AGENT), 1);
}
