//! What guard and encryption cost `vsm run`: three of it side by side under the same load, message by message in turn: nothing
//! protected; signed; and signed, with an encrypted link and a guarded CUCS. Prints Markdown tables; `cargo bench -p vsm --bench
//! protected`.
//!
//! Processor time is the kernel's, of all threads of each process. Each figure is the median of segments of two seconds, and so
//! are the ratios, which are taken within a segment: what else the machine does falls on all three. Which is served first is
//! drawn for each message: the first of three wakes the processor for the others.

#![allow(missing_docs, reason = "a bench has no callers")]
#![allow(clippy::print_stdout, reason = "figures are printed")]

mod common;
#[path = "common/vehicle.rs"]
mod vehicle;

use std::cell::{Cell, RefCell};
use std::fs;
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::fs::PermissionsExt as _;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use kit::Random;
use kit::bridge::StationGuard;
use kit::clock::wall;
use kit::measure::{Spread, cpu_time, pace, quantile};
use mavlink_link::Now;
use mavlink_link::encrypted::{Carrier, EncryptedConfig, EncryptedLink, MAX_WIRE, Role};
use mavlink_link::exchange::{Identity, Node, Parties};
use mavlink_link::signing::SigningKey;
use mavlink_link::store::MemoryDisk;
use stanag_msgs::enums::{LoiBitmap, RequestedAccess};
use stanag_msgs::messages::{CucsAuthorisationRequest, GenericInformationRequestMessage};
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, TimeStamp, frames};
use vsm::key_exchange::{ExchangeRecord, identity};
use vsm::shell::disk::FileDisk;
use vsm::shell::key_file::system_random;

use common::{free, socket};
use vehicle::Autopilot;

fn main() {
    // `cargo test --benches` asks for nothing to be measured.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    let worlds = KINDS.map(|kind| World::start(kind, LINGER));
    println!(
        "| `vsm run`, one vehicle and one CUCS | plain | signed | signed, encrypted, guarded | of signed |"
    );
    println!("|---|---|---|---|---|");
    for (rate, segments) in [(PX4_RATE, 8), (2_000, 8)] {
        load(&worlds, rate, segments);
    }
    drop(worlds);
    let worlds = KINDS.map(|kind| World::start(kind, Duration::ZERO));
    println!(
        "| a HEARTBEAT with another mode, to its 3001 | plain | signed | signed, encrypted, guarded |"
    );
    println!("|---|---|---|---|");
    latency(&worlds);
}

/// Frames of telemetry at this rate to each, and questions of its CUCS.
fn load(worlds: &[World; 3], rate: u32, segments: u32) {
    let mut costs = [const { Vec::new() }; 3];
    let (mut random, mut order) = (Random::new(), [0, 1, 2]);
    let begun = Instant::now();
    let mut number = 0;
    for _ in 0..segments {
        let before = worlds.each_ref().map(|world| cpu_time(world.vsm.id()));
        for _ in 0..2 * rate {
            number += 1;
            let due = begun + Duration::from_secs(1) * number / rate;
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            random.shuffle(&mut order);
            for world in order.map(|at| &worlds[at]) {
                world.attitude();
                world.work();
                if number.is_multiple_of((rate / QUESTIONS).max(1)) {
                    world.question();
                }
            }
        }
        for ((costs, world), before) in costs.iter_mut().zip(worlds).zip(before) {
            let took = cpu_time(world.vsm.id()).saturating_sub(before);
            costs.push(took.as_secs_f64() * 1e6 / f64::from(2 * rate));
        }
    }
    for world in worlds {
        assert!(world.answered.get() > 0, "its CUCS is answered");
    }
    let ratio = Spread::of_ratios(&costs[2], &costs[1]);
    let [plain, signed, protected] = costs.map(|costs| Spread::of(&costs));
    println!(
        "| CPU a frame at {rate} frames/s, {QUESTIONS} questions/s, us | {plain:.1} | {signed:.1} | {protected:.1} | {ratio:.2} |"
    );
}

fn latency(worlds: &[World; 3]) {
    let mut times = [const { Vec::new() }; 3];
    let (mut random, mut order) = (Random::new(), [0, 1, 2]);
    let begun = Instant::now();
    for number in 0..LATENCIES as u32 {
        pace(begun, number, MODE_CHANGES_HZ);
        random.shuffle(&mut order);
        for at in order {
            let (world, times) = (&worlds[at], &mut times[at]);
            world.work();
            let begun = Instant::now();
            world.report(&world.autopilot.heartbeat(number.is_multiple_of(2)));
            if world.await_report(begun) {
                times.push(begun.elapsed().as_secs_f64() * 1e6);
            }
        }
    }
    for times in &times {
        assert!(times.len() > LATENCIES * 9 / 10, "{}", times.len());
    }
    for (name, part) in [("p50", 0.5), ("p99", 0.99)] {
        let [plain, signed, protected] = times.each_mut().map(|times| quantile(times, part));
        println!("| {name} | {plain:.0} us | {signed:.0} us | {protected:.0} us |");
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Plain,
    Signed,
    Protected,
}

const KINDS: [Kind; 3] = [Kind::Plain, Kind::Signed, Kind::Protected];

struct World {
    autopilot: Autopilot,
    vsm: Child,
    vehicle: UdpSocket,
    station: UdpSocket,
    mavlink: SocketAddr,
    dli: SocketAddr,
    air: Option<RefCell<Air>>,
    guard: Option<RefCell<StationGuard>>,
    asked: Cell<u64>,
    answered: Cell<u64>,
    started: Instant,
    _folder: tempfile::TempDir,
}

/// The agent's end of the encrypted link.
struct Air {
    link: EncryptedLink<u8>,
    disk: MemoryDisk,
}

impl World {
    fn start(kind: Kind, linger: Duration) -> World {
        let folder = tempfile::tempdir().expect("a folder");
        let (dli, mavlink) = (free(), free());
        for (name, digits) in [("uav.key", "5a"), ("guard.key", "3c")] {
            let key = folder.path().join(name);
            fs::write(&key, digits.repeat(32)).expect("the key");
            fs::set_permissions(&key, fs::Permissions::from_mode(0o600)).expect("its mode");
        }
        let (signing, guard) = match kind {
            Kind::Plain => ("\"off\"", ""),
            Kind::Signed => ("{ key_file = \"uav.key\" }", ""),
            Kind::Protected => (
                "{ key_file = \"uav.key\", exchange = \"on\" }\nencrypt = true",
                "guard = { key_file = \"guard.key\" }",
            ),
        };
        let config = folder.path().join("vsm.toml");
        let text = format!(
            "[dli]\nvsm_id = \"{VSM_ID}\"\nlisten = \"{dli}\"\nlease_s = 3600\nmax_bytes_s = 10000000\nmax_messages_s = 100000\n\
             [[cucs]]\nid = \"{CUCS}\"\nloi = [2]\naddress = \"127.0.0.1\"\n{guard}\n[[vehicle]]\n\
             id = \"{VEHICLE}\"\nlink = \"udpin:{mavlink}\"\nsystem_id = 1\nsigning = {signing}\n\
             [store]\ndir = \"state\"\n"
        );
        fs::write(&config, text).expect("the configuration");
        let started = Instant::now();
        let now = Now {
            mono: Duration::ZERO,
            wall: wall(),
        };
        let protected = kind == Kind::Protected;
        let air =
            protected.then(|| RefCell::new(Air::paired(&folder.path().join("state"), linger)));
        let guard = protected.then(|| {
            let key = SigningKey::new([0x3c; 32]).expect("a key");
            RefCell::new(StationGuard::with_key(CUCS, key, now))
        });
        let vsm = Command::new(common::vsm())
            .args(["run", "--config"])
            .arg(&config)
            .env("RUST_LOG", "off")
            .stderr(Stdio::null())
            .spawn()
            .expect("vsm run");
        let world = World {
            autopilot: Autopilot::new(kind != Kind::Plain),
            vsm,
            vehicle: socket(),
            station: socket(),
            mavlink,
            dli,
            air,
            guard,
            asked: Cell::new(0),
            answered: Cell::new(0),
            started,
            _folder: folder,
        };
        std::thread::sleep(Duration::from_millis(500));
        let until = Instant::now() + Duration::from_secs(10);
        let mut round = 0_u32;
        // Until the keys are agreed on, the vehicle is live and the CUCS is answered.
        while world.answered.get() < 20 {
            assert!(Instant::now() < until, "{kind:?}: nothing is answered");
            if round.is_multiple_of(25) {
                world.say(&Message::from(CucsAuthorisationRequest {
                    time_stamp: Some(world.stamp()),
                    requested_handover_loi: Some(LoiBitmap::LOI2),
                    requested_handover_access: Some(RequestedAccess::Request),
                    ..CucsAuthorisationRequest::default()
                }));
            }
            round += 1;
            world.report(&world.autopilot.heartbeat(false));
            world.question();
            std::thread::sleep(Duration::from_millis(20));
            world.work();
        }
        world
    }

    fn now(&self) -> Now {
        Now {
            mono: self.started.elapsed(),
            wall: wall(),
        }
    }

    fn attitude(&self) {
        self.report(&self.autopilot.attitude());
    }

    fn report(&self, frame: &[u8]) {
        match &self.air {
            Some(air) => {
                let now = self.now().mono;
                air.borrow_mut().link.send(now, 0, frame);
                self.transmit();
            }
            None => self.radio(frame),
        }
    }

    /// What the encrypted link has for the radio.
    fn transmit(&self) {
        let Some(air) = &self.air else { return };
        let (mut air, mut out) = (air.borrow_mut(), [0; MAX_WIRE]);
        let Air { link, disk } = &mut *air;
        while let Some((_, length)) = link.poll_transmit(self.now().mono, disk, &mut out) {
            self.radio(&out[..length]);
        }
    }

    fn radio(&self, bytes: &[u8]) {
        let sent = self.vehicle.send_to(bytes, self.mavlink);
        sent.expect("it is sent");
    }

    /// A 17002 for 3001; a 3001 answers it.
    fn question(&self) {
        self.say(&Message::from(GenericInformationRequestMessage {
            time_stamp: Some(self.stamp()),
            message_type: Some(3001),
            ..GenericInformationRequestMessage::default()
        }));
    }

    /// A second message of the same stamp would be the first one repeated.
    fn stamp(&self) -> TimeStamp {
        let unix_ms = (wall().as_millis() as u64).max(self.asked.get() + 1);
        self.asked.set(unix_ms);
        TimeStamp::from_unix_ms(unix_ms)
    }

    fn say(&self, message: &Message) {
        let mut out = [0; MAX_DATAGRAM];
        let envelope = Envelope::new(CUCS, VEHICLE);
        let length = message.encode(&envelope, &mut out).expect("it fits");
        let bytes = match &self.guard {
            Some(guard) => guard.borrow_mut().seal(self.now(), &out[..length]),
            None => out[..length].to_vec(),
        };
        let sent = self.station.send_to(&bytes, self.dli);
        sent.expect("it is sent");
    }

    /// Takes what has arrived on both sides.
    fn work(&self) {
        let mut bytes = [0; 2_048];
        self.vehicle.set_nonblocking(true).expect("a socket");
        self.station.set_nonblocking(true).expect("a socket");
        while let Ok((length, _)) = self.vehicle.recv_from(&mut bytes) {
            if let Some(air) = &self.air {
                let Air { link, disk } = &mut *air.borrow_mut();
                link.handle(self.now(), 0, &bytes[..length], &mut system_random, disk);
            }
        }
        if let Some(air) = &self.air {
            let Air { link, disk } = &mut *air.borrow_mut();
            link.handle_timeout(self.now(), &mut system_random, disk);
        }
        self.transmit();
        while let Ok((length, _)) = self.station.recv_from(&mut bytes) {
            self.take(&bytes[..length]);
        }
        self.station.set_nonblocking(false).expect("a socket");
    }

    /// Whether there is a 3001 in it.
    fn take(&self, bytes: &[u8]) -> bool {
        let opened = self.guard.as_ref().map(|guard| {
            let opened = guard.borrow_mut().open(self.now(), bytes);
            opened.unwrap_or_default()
        });
        let bytes = opened.as_deref().unwrap_or(bytes);
        let mut found = frames(bytes).flatten();
        let reported = found.any(|frame| frame.header.message_type == 3001);
        self.answered.set(self.answered.get() + u64::from(reported));
        reported
    }

    /// Whether a 3001 arrives.
    fn await_report(&self, begun: Instant) -> bool {
        let mut bytes = [0; 2_048];
        while begun.elapsed() < Duration::from_millis(200) {
            let Ok((length, _)) = self.station.recv_from(&mut bytes) else {
                return false;
            };
            if self.take(&bytes[..length]) {
                return true;
            }
        }
        false
    }
}

impl Drop for World {
    fn drop(&mut self) {
        let _ = self.vsm.kill();
        let _ = self.vsm.wait();
    }
}

impl Air {
    /// Paired with the bridge of this store, as a pairing by a code would leave it.
    fn paired(store: &std::path::Path, linger: Duration) -> Air {
        let own = Identity::new([0x77; 32]);
        let mut ground = FileDisk::open(store).expect("a store");
        let peer = identity(&mut ground, &mut system_random).expect("its identity");
        let key = SigningKey::new([0x5a; 32]).expect("a key").id();
        let record = ExchangeRecord {
            peer: Some(*own.public().bytes()),
            agreed: Some(*key.bytes()),
            key: Some(*key.bytes()),
            since: wall().as_secs(),
            ..ExchangeRecord::default()
        };
        record.save(&mut ground, VEHICLE).expect("it is stored");
        let node = |system, component| Node { system, component };
        let config = EncryptedConfig {
            role: Role::Air,
            parties: Parties::new(node(245, 190), node(1, AGENT), VSM_ID.0, VEHICLE.0),
            identity: own,
            peer: Some(peer.public()),
            carrier: Carrier::Datagrams,
            at: Some(0),
            before: None,
            linger,
        };
        let disk = MemoryDisk::default();
        Air {
            link: EncryptedLink::open(config, Duration::ZERO, &disk).expect("it opens"),
            disk,
        }
    }
}

/// What PX4 v1.18 sends a second on a link of a ground station.
const PX4_RATE: u32 = 370;
/// A second, of the CUCS.
const QUESTIONS: u32 = 10;
const LATENCIES: usize = 400;
/// A bridge reports as many changes of a vehicle's mode by themselves; of more the scheduled reports have to be enough.
const MODE_CHANGES_HZ: u32 = 10;
/// As the agent's.
const LINGER: Duration = Duration::from_millis(5);
/// The agent's component id where nothing else is configured.
const AGENT: u8 = 191;
const VSM_ID: Id = Id(0x1b00_0001);
const CUCS: Id = Id(0x1b00_00a0);
const VEHICLE: Id = Id(0x1b00_0101);
