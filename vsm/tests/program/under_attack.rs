//! A disk that takes 100 ms to synchronise, to create a file and to rename it, and a station that keeps it busy: the vehicle's
//! heartbeats and the controller's commands continue as if neither were there. Real sockets, real time.
//!
//! The figures of docs/guide/reliability.md come from here: `cargo test --release -p vsm --test program under_attack --
//! --nocapture`. On a machine that does other things as well no test can hold 20 ms for each command. So it holds them for half of the
//! answers, and half of the heartbeats, beside the same without the attack: what delays each command shows there, and what the computer
//! does now and then does not. With `VSM_QUIET=1`, on a computer with nothing else to do, it holds them for 99 of 100.

use std::fs::{self, File};
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, mpsc};
use std::thread;
use std::time::{Duration, Instant};

use kit::bridge::{VSM, cucs, key, vehicle_id};
use kit::clock::wall;
use kit::process::{free_udp_port, write_key};
use mavlink_link::dialect::{HEARTBEAT_DATA, MavMessage};
use mavlink_link::exchange::{
    self, Agreed, Data, Identity, Inbound, Node, Parties, PinnedPeer, Responder, ResponderConfig,
    ResponderMemory, ResponderStore, Status as ExchangeStatus, Step, StoreError, VERSION, Wanted,
};
use mavlink_link::frame::{
    FrameView, Header, INCOMPAT_SIGNED, KEY_EXCHANGE_ID, MAX_FRAME, encode, encode_raw,
};
use mavlink_link::signing::{Stamp, sign};
use px4_sim::{Autopilot, Signing};
use stanag_msgs::enums::{AckType, ConfigRequestType, LoiBitmap, RequestedAccess, WaitTransition};
use stanag_msgs::messages::{
    AreaVertex, CucsAuthorisationRequest, FieldConfigurationRequest, LoiterConfiguration,
};
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, Scaled, TimeStamp, frames};
use vsm::config::Config;
use vsm::config::airside::AirsideConfig;
use vsm::key_exchange::{ExchangeRecord, identity};
use vsm::session::{Stations, Status};
use vsm::shell::airside::AirsideServer;
use vsm::shell::disk::{Added, FileDisk, FileSystem, NativeFileSystem};
use vsm::shell::key_file::system_random;
use vsm::shell::server::Server;
use zeroize::Zeroizing;

/// A file system of which each synchronisation takes so long, and from some moment on each reading, or each change.
#[derive(Debug)]
pub(crate) struct Slow {
    sync: Duration,
    /// Milliseconds.
    pub(crate) read: Arc<AtomicU64>,
    /// What was read on a thread of the name [`BRIDGE`] since then.
    pub(crate) waited: Arc<Mutex<Vec<PathBuf>>>,
    changes: Changes,
}

/// How long it takes to create, write, rename or delete a file, milliseconds, and those for which the thread of the name
/// [`BRIDGE`] had to wait. A line of a log that is there goes to memory.
#[derive(Debug, Clone, Default)]
struct Changes {
    slow: Arc<AtomicU64>,
    waited: Arc<Mutex<Vec<PathBuf>>>,
}

impl Changes {
    fn wait(&self, path: &Path) {
        let slow = self.slow.load(Ordering::Relaxed);
        if slow > 0 && thread::current().name() == Some(BRIDGE) {
            let mut waited = self.waited.lock().expect("no panic");
            waited.push(path.to_owned());
        }
        thread::sleep(Duration::from_millis(slow));
    }
}

pub(crate) const BRIDGE: &str = "bridge";

impl Slow {
    pub(crate) fn new(sync: Duration) -> Slow {
        Slow {
            sync,
            read: Arc::default(),
            waited: Arc::default(),
            changes: Changes::default(),
        }
    }
}

impl FileSystem for Slow {
    fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        self.changes.wait(path);
        NativeFileSystem.write(path, bytes)
    }

    fn add(&self, path: &Path, bytes: &[u8]) -> io::Result<Added> {
        if !path.exists() {
            self.changes.wait(path);
        }
        NativeFileSystem.add(path, bytes)
    }

    fn sync(&self, path: &Path) -> io::Result<()> {
        thread::sleep(self.sync);
        NativeFileSystem.sync(path)
    }

    fn sync_open(&self, file: &File) -> io::Result<()> {
        thread::sleep(self.sync);
        NativeFileSystem.sync_open(file)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        self.changes.wait(to);
        NativeFileSystem.rename(from, to)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        self.changes.wait(path);
        NativeFileSystem.remove(path)
    }

    fn read(&self, path: &Path, most: u64) -> io::Result<Option<Zeroizing<Vec<u8>>>> {
        let slow = self.read.load(Ordering::Relaxed);
        if slow > 0 && thread::current().name() == Some(BRIDGE) {
            let mut waited = self.waited.lock().expect("no panic");
            waited.push(path.to_owned());
        }
        thread::sleep(Duration::from_millis(slow));
        NativeFileSystem.read(path, most)
    }
}

const AIR: Node = Node {
    system: 1,
    component: 191,
};

/// The agent beside the vehicle: its end of the key exchange, which is silent until it is asked to answer.
struct Agent {
    responder: Responder<()>,
    next: Next,
    answers: bool,
    seq: u8,
}

#[derive(Default)]
struct Next(u32);

impl ResponderStore for Next {
    fn withdraw_next(&mut self) -> Result<(), StoreError> {
        Ok(())
    }

    fn store_agreed(&mut self, _: &PinnedPeer, _: &Agreed) -> Result<(), StoreError> {
        self.0 += 1;
        Ok(())
    }
}

impl Agent {
    /// Paired with the bridge of this store, whose key has grown old.
    fn pair(config: &Config) -> Agent {
        let air = Identity::new([3; 32]);
        let mut store = FileDisk::open(&config.store.dir).expect("a store");
        let mut record = ExchangeRecord {
            peer: Some(*air.public().bytes()),
            ..ExchangeRecord::default()
        };
        record.note_key(key(0).id(), 0);
        record.save(&mut store, vehicle_id(0)).expect("it is kept");
        let ground = identity(&mut store, &mut system_random).expect("made");
        let here = Node {
            system: 245,
            component: 190,
        };
        let responder = ResponderConfig {
            parties: Parties::new(here, AIR, config.dli.vsm_id.0, vehicle_id(0).0),
            identity: air,
            wanted: Wanted {
                signing: true,
                confidential: false,
            },
        };
        let memory = ResponderMemory {
            peer: Some(PinnedPeer {
                key: ground.public(),
                counter: 0,
            }),
            ..ResponderMemory::default()
        };
        Agent {
            responder: Responder::new(responder, memory, Duration::ZERO),
            next: Next::default(),
            answers: false,
            seq: 0,
        }
    }

    /// Takes what it was sent; the frames of its answer.
    fn take(&mut self, now: Duration, frame: &FrameView<'_>) -> Vec<Vec<u8>> {
        if !self.answers || frame.header().message_id != KEY_EXCHANGE_ID {
            return vec![];
        }
        let inbound = Inbound {
            from: (),
            source: Node {
                system: frame.header().system_id,
                component: frame.header().component_id,
            },
            verified: true,
            payload: frame.payload(),
        };
        let _ = (self.responder).handle(now, inbound, &mut system_random, &mut self.next);
        let answers = std::iter::from_fn(|| self.responder.poll_transmit());
        answers
            .map(|answer| {
                self.seq = self.seq.wrapping_add(1);
                let header = Header {
                    seq: self.seq,
                    system_id: AIR.system,
                    component_id: AIR.component,
                    message_id: KEY_EXCHANGE_ID,
                    ..Header::default()
                };
                let mut out = [0; MAX_FRAME];
                let payload = answer.message.to_payload();
                let length = encode_raw(header, &payload, &mut out).expect("it fits");
                out[..length].to_vec()
            })
            .collect()
    }
}

/// What B sends, by the number of the message.
type Attack = fn(&mut World, u64);

/// What A and the vehicle have seen of the bridge.
struct Figures {
    /// How long A's answers took, sorted.
    took: Vec<Duration>,
    missing: usize,
    /// The times between two heartbeats, sorted.
    gaps: Vec<Duration>,
}

/// By how much half of the answers, and half of the heartbeats, are late at most.
#[derive(Debug, Clone, Copy, Default)]
struct Typical {
    answer: Duration,
    heartbeat: Duration,
}

impl Figures {
    fn answer_at(&self, part: f64) -> Duration {
        at(part, &self.took)
    }

    fn longest_gap(&self) -> Duration {
        at(1.0, &self.gaps)
    }

    fn typical(&self) -> Typical {
        let due = Duration::from_secs(1);
        let mut late: Vec<Duration> = self.gaps.iter().map(|gap| gap.abs_diff(due)).collect();
        late.sort();
        Typical {
            answer: self.answer_at(0.5),
            heartbeat: at(0.5, &late),
        }
    }
}

impl Typical {
    /// Whether nothing is late by more than is promised, beside this without the attack.
    fn is_held_beside(self, quiet: Typical) -> bool {
        self.answer <= quiet.answer + PROMISED && self.heartbeat <= quiet.heartbeat + PROMISED
    }
}

/// Of sorted times, the one that so large a part is below.
fn at(part: f64, sorted: &[Duration]) -> Duration {
    let last = sorted.len().saturating_sub(1) as f64;
    (sorted.get((last * part) as usize).copied()).unwrap_or(Duration::MAX)
}

/// A bridge on a thread of its own, its vehicle, the controller A, and B, who attacks.
struct World {
    server: Option<thread::JoinHandle<Status>>,
    stop: Option<tokio::sync::oneshot::Sender<()>>,
    vehicle: Autopilot<SocketAddr>,
    mav: UdpSocket,
    a: UdpSocket,
    b: UdpSocket,
    dli: SocketAddr,
    mavlink: SocketAddr,
    began: Instant,
    flown: Duration,
    /// When HEARTBEATs of the bridge arrived at the vehicle.
    heartbeats: Vec<Instant>,
    /// What A has sent and was not answered yet, by stamp.
    open: Vec<(TimeStamp, Instant)>,
    /// How long A's answers took.
    took: Vec<Duration>,
    /// What went out in the names of others, and what came back for it.
    forged_bytes: u64,
    reflected_bytes: u64,
    /// How often a second A commands.
    commands: f64,
    agent: Option<Agent>,
    changes: Changes,
    _folder: tempfile::TempDir,
}

impl World {
    fn start(sync: Duration) -> World {
        World::start_with(sync, "off")
    }

    fn start_with(sync: Duration, exchange: &str) -> World {
        let folder = tempfile::tempdir().expect("a folder");
        write_key(&folder.path().join("uav.key"), &[0x41; 32]);
        let loopback = |port| SocketAddr::from(([127, 0, 0, 1], port));
        let (dli, mavlink) = (loopback(free_udp_port()), loopback(free_udp_port()));
        let text = format!(
            "[dli]\nvsm_id = \"{VSM}\"\nlisten = \"{dli}\"\n[[cucs]]\nid = \"{}\"\nloi = [2, 3, 4, 5]\n[[cucs]]\n\
             id = \"{}\"\nloi = [2, 3, 4, 5]\n[[vehicle]]\nid = \"{}\"\nlink = \"udpin:{mavlink}\"\nsystem_id = 1\n\
             signing = {{ key_file = \"uav.key\", exchange = \"{exchange}\" }}\n[[vehicle.payload]]\nstation = 1\n[store]\ndir = \"state\"\n",
            cucs(0),
            cucs(1),
            vehicle_id(0),
        );
        fs::write(folder.path().join("vsm.toml"), text).expect("the configuration");
        let config = Config::load(&folder.path().join("vsm.toml")).expect("a good configuration");
        let agent = (exchange == "on").then(|| Agent::pair(&config));
        let (ready, started) = mpsc::channel();
        let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
        let disk = Slow::new(sync);
        let changes = disk.changes.clone();
        let bridge = thread::Builder::new().name(BRIDGE.to_owned());
        let server = bridge.spawn(move || {
            let runtime = tokio::runtime::Builder::new_current_thread()
                .enable_all()
                .build()
                .expect("a runtime");
            runtime.block_on(async {
                let disk = FileDisk::open_on(&config.store.dir, Box::new(disk));
                let server = Server::open_on(&config, disk.expect("a store")).expect("it starts");
                ready.send(()).expect("the test waits");
                let stop = async {
                    let _ = stopped.await;
                };
                server.serve(stop).await.expect("it serves until the end")
            })
        });
        started.recv().expect("the bridge starts");
        let vehicle = px4_sim::Config {
            unix_time_us: wall().as_micros() as u64,
            ..px4_sim::Config::default()
        };
        let signing = Signing::with_key(key(0), 0);
        let socket = || {
            let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
            socket.set_nonblocking(true).expect("it need not block");
            socket
        };
        let mut world = World {
            server: Some(server.expect("a thread")),
            stop: Some(stop),
            vehicle: Autopilot::new(vehicle, signing, vec![Some(mavlink)]),
            mav: socket(),
            a: socket(),
            b: socket(),
            dli,
            mavlink,
            began: Instant::now(),
            flown: Duration::ZERO,
            heartbeats: Vec::new(),
            open: Vec::new(),
            took: Vec::new(),
            forged_bytes: 0,
            reflected_bytes: 0,
            commands: 5.0,
            agent,
            changes,
            _folder: folder,
        };
        world.run(4.0, 0, |_, _| ());
        world.send(
            0,
            request(LoiBitmap::from_raw(0x0d), RequestedAccess::Request),
        );
        world.run(3.0, 0, |_, _| ());
        world.take_figures("before");
        world
    }

    /// Sends a message of a station, with an acknowledgement requested; a command of A is waited for.
    fn send(&mut self, station: usize, mut message: Message) {
        let stamp = TimeStamp::from_unix_ms(wall().as_millis() as u64);
        match &mut message {
            Message::CucsAuthorisationRequest(message) => message.time_stamp = Some(stamp),
            Message::LoiterConfiguration(message) => message.time_stamp = Some(stamp),
            Message::AreaVertex(message) => message.time_stamp = Some(stamp),
            _ => {}
        }
        let envelope = Envelope::new(cucs(station), vehicle_id(0)).requesting_ack();
        let mut bytes = [0; MAX_DATAGRAM];
        let length = message.encode(&envelope, &mut bytes).expect("it fits");
        if station == 0 {
            self.open.push((stamp, Instant::now()));
        }
        let from = [&self.a, &self.b][station];
        let _ = from.send_to(&bytes[..length], self.dli);
    }

    /// Seconds of real time; B sends `attack` so often a second, A commands five times a second.
    fn run(&mut self, seconds: f64, rate: u32, attack: impl Fn(&mut World, u64)) {
        let begun = Instant::now();
        let (mut sent, mut commanded) = (0_u64, 0_u64);
        while begun.elapsed().as_secs_f64() < seconds {
            let elapsed = begun.elapsed().as_secs_f64();
            // After a pause of the whole machine time is lost rather than made up for at once.
            let due = (elapsed * f64::from(rate)) as u64;
            let first = sent.max(due.saturating_sub(20));
            for number in first..due {
                attack(self, number);
            }
            sent = sent.max(due);
            if rate > 0 && commanded < (elapsed * self.commands) as u64 {
                commanded += 1;
                let message = LoiterConfiguration {
                    loiter_radius: Some(Scaled::saturating_from_si(50.0 + commanded as f64)),
                    ..LoiterConfiguration::default()
                };
                self.send(0, message.into());
            }
            self.fly();
            self.listen();
            thread::sleep(Duration::from_micros(200));
        }
    }

    fn fly(&mut self) {
        let mut frame = [0; MAX_FRAME];
        let due = self.began.elapsed();
        self.flown = self
            .flown
            .max(due.saturating_sub(Duration::from_millis(200)));
        while self.flown < due {
            self.flown += Duration::from_millis(10);
            self.vehicle.step(Duration::from_millis(10));
            while let Some(sent) = self.vehicle.poll_transmit(&mut frame) {
                let _ = self.mav.send_to(&frame[..sent.len], self.mavlink);
            }
        }
    }

    fn listen(&mut self) {
        let mut bytes = [0; 2_048];
        while let Ok((length, _)) = self.mav.recv_from(&mut bytes) {
            let bytes = &bytes[..length];
            if let Ok(frame) = FrameView::parse(bytes) {
                if frame.header().message_id == 0 {
                    self.heartbeats.push(Instant::now());
                }
                let now = self.began.elapsed();
                let agent = self.agent.iter_mut();
                for answer in agent.flat_map(|agent| agent.take(now, &frame)) {
                    let _ = self.mav.send_to(&answer, self.mavlink);
                }
            }
            self.vehicle.handle_datagram(0, self.mavlink, bytes);
        }
        while let Ok((length, _)) = self.b.recv_from(&mut bytes) {
            self.reflected_bytes += length as u64;
        }
        while let Ok((length, _)) = self.a.recv_from(&mut bytes) {
            for frame in frames(&bytes[..length]).flatten() {
                let message = Message::decode(frame.header.message_type, frame.data);
                if let Ok(Message::MessageAcknowledgement(ack)) = message {
                    assert_ne!(ack.acknowledgement_type, Some(AckType::Refused));
                    let stamp = ack.original_message_time_stamp;
                    let took = &mut self.took;
                    self.open.retain(|(of, at)| {
                        let answered = Some(*of) == stamp;
                        took.extend(answered.then(|| at.elapsed()));
                        !answered
                    });
                }
            }
        }
    }

    /// Lets B attack, and takes the figures of that; again, three times at most, while they do not hold what is promised beside those
    /// without the attack. What delays each command does so each time.
    fn attacked(
        &mut self,
        what: &str,
        (seconds, rate): (f64, u32),
        attack: impl Fn(&mut World, u64),
        quiet: Typical,
    ) -> Figures {
        for _ in 0..2 {
            self.run(seconds, rate, &attack);
            let figures = self.take_figures(what);
            if figures.typical().is_held_beside(quiet) {
                return figures;
            }
        }
        self.run(seconds, rate, &attack);
        self.take_figures(what)
    }

    #[allow(clippy::print_stderr, reason = "figures are printed")]
    fn take_figures(&mut self, what: &str) -> Figures {
        let mut took = std::mem::take(&mut self.took);
        took.sort();
        let missing = self
            .open
            .iter()
            .filter(|(_, at)| at.elapsed().as_millis() > 500);
        let missing = missing.count();
        self.open.clear();
        let heartbeats = std::mem::take(&mut self.heartbeats);
        let gaps = heartbeats.windows(2).map(|two| two[1] - two[0]);
        let mut gaps: Vec<Duration> = gaps.collect();
        gaps.sort();
        let figures = Figures {
            took,
            missing,
            gaps,
        };
        if !figures.took.is_empty() {
            eprintln!(
                "{what}: {} commands, {missing} unanswered, p50 {:?}, p99 {:?}, longest {:?}; heartbeats at most {:?} apart",
                figures.took.len(),
                figures.answer_at(0.5),
                figures.answer_at(0.99),
                figures.answer_at(1.0),
                figures.longest_gap(),
            );
        }
        figures
    }

    /// What is promised: see the top.
    fn hold_the_promise(what: &str, figures: &Figures, quiet: Typical) {
        let typical = figures.typical();
        assert!(
            typical.is_held_beside(quiet),
            "{what}: {typical:?}, without it {quiet:?}"
        );
        let longest = figures.longest_gap();
        assert!(
            longest < Duration::from_millis(1_800),
            "{what}: {longest:?}"
        );
        if std::env::var_os("VSM_QUIET").is_none() {
            return;
        }
        let p99 = figures.answer_at(0.99);
        assert!(p99 <= PROMISED, "{what}: p99 {p99:?}");
        let late = longest.saturating_sub(Duration::from_secs(1));
        assert!(late <= PROMISED, "{what}: heartbeats {longest:?} apart");
    }

    fn end(mut self) -> Status {
        drop(self.stop.take());
        self.server
            .take()
            .expect("it runs")
            .join()
            .expect("it ends")
    }
}

fn request(levels: LoiBitmap, access: RequestedAccess) -> Message {
    Message::from(CucsAuthorisationRequest {
        requested_handover_loi: Some(levels),
        requested_handover_access: Some(access),
        controlled_station_1_16: Some(Stations::one(1).low()),
        vsm_id: Some(Id::NULL),
        ..CucsAuthorisationRequest::default()
    })
}

/// Takes LOI 2 and 3, gives up LOI 3, and so on.
fn flip(world: &mut World, number: u64) {
    let message = match number % 2 {
        1 => request(LoiBitmap::from_raw(0x03), RequestedAccess::Request),
        _ => request(LoiBitmap::from_raw(0x02), RequestedAccess::Relinquish),
    };
    world.send(1, message);
}

/// Takes LOI 2 and gives it up, which is not synchronised.
fn monitor(world: &mut World, number: u64) {
    let access = match number % 2 {
        1 => RequestedAccess::Request,
        _ => RequestedAccess::Relinquish,
    };
    world.send(1, request(LoiBitmap::LOI2, access));
}

/// Asks A for control, without end: a handover begins and ends.
fn handovers(world: &mut World, number: u64) {
    let access = match number % 2 {
        1 => RequestedAccess::Request,
        _ => RequestedAccess::Relinquish,
    };
    let message = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(0x0c)),
        requested_handover_access: Some(access),
        wait_for_vehicle_data_link_transition_coordination_message: Some(WaitTransition::Wait),
        vsm_id: Some(Id::NULL),
        ..CucsAuthorisationRequest::default()
    };
    world.send(1, message.into());
}

/// A fence that B has no right to send.
fn vertices(world: &mut World, number: u64) {
    let message = AreaVertex {
        area_id: Some(1),
        vertex_number: Some((number % 64) as u8),
        ..AreaVertex::default()
    };
    world.send(1, message.into());
}

/// 40000, the shortest request with the longest answer: in A's name and in B's own, from an address that has proved
/// nothing.
fn forged_40000(world: &mut World, number: u64) {
    let message = Message::from(FieldConfigurationRequest {
        request_type: Some(ConfigRequestType::Loi4),
        ..FieldConfigurationRequest::default()
    });
    let mut bytes = [0; MAX_DATAGRAM];
    let envelope = Envelope::new(cucs((number % 2) as usize), vehicle_id(0));
    let length = message.encode(&envelope, &mut bytes).expect("it fits");
    let _ = world.b.send_to(&bytes[..length], world.dli);
    world.forged_bytes += length as u64;
}

/// A KEY_EXCHANGE for the ground, of any step, that nobody has made with a key or a code.
fn forged_exchange(number: u64) -> Vec<u8> {
    let mut public_key = [0x5a; 32];
    public_key[..8].copy_from_slice(&number.to_be_bytes());
    let steps = [Step::Please, Step::Offer, Step::Answer, Step::Confirm];
    let step = steps[(number % 4) as usize];
    let message = exchange::Message {
        public_key,
        session: if step == Step::Please {
            0
        } else {
            number as u32 | 1
        },
        version: VERSION,
        step,
        suite: 1 + (number % 2) as u8,
        status: ExchangeStatus::Ok,
        target: Node {
            system: 245,
            component: 190,
        },
        data: Data::new(&[0x33; 104]).expect("it fits"),
    };
    let header = Header {
        seq: number as u8,
        system_id: AIR.system,
        component_id: AIR.component,
        message_id: KEY_EXCHANGE_ID,
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let length = encode_raw(header, &message.to_payload(), &mut out).expect("it fits");
    out[..length].to_vec()
}

/// One synchronisation. Whatever waits for the disk waits for two of them at least.
const SYNC: Duration = Duration::from_millis(100);
/// The most by which anyone's durable decisions delay the vehicle link or the controller.
const PROMISED: Duration = Duration::from_millis(20);

const NO_ATTACK: &str = "no attack";

/// Of A's 160 commands all are answered, nine of ten without a wait for the disk.
fn hold_all_answers(what: &str, figures: &Figures, quiet: Typical) {
    assert_eq!(figures.missing, 0, "{what}");
    let answered = figures.took.len();
    assert!(answered >= 100, "{what}: {answered} answered");
    let most = figures.answer_at(0.9);
    assert!(most < SYNC, "{what}: a tenth took over {most:?}");
    World::hold_the_promise(what, figures, quiet);
}

/// The figures above would show a bridge that delays each command by 90 ms, or its heartbeats, and are held on a computer that does something
/// else for a third of the time.
#[test]
fn a_delay_of_each_command_shows_and_one_by_the_computer_does_not() {
    let ms = Duration::from_millis;
    let held = |slow: usize, late: u64, gaps: [u64; 4]| {
        let mut took = vec![ms(1); 24 - slow];
        took.extend(vec![ms(1 + late); slow]);
        let (missing, mut gaps) = (0, gaps.map(ms).to_vec());
        gaps.sort();
        let figures = Figures {
            took,
            missing,
            gaps,
        };
        let quiet = Typical {
            answer: ms(1),
            heartbeat: ms(2),
        };
        figures.typical().is_held_beside(quiet)
    };
    let punctual = [1_000, 1_002, 998, 1_001];
    assert!(held(0, 0, punctual));
    assert!(held(8, 400, [1_000, 1_300, 700, 1_001]));
    assert!(!held(24, 90, punctual));
    assert!(!held(13, 25, punctual));
    assert!(!held(0, 0, [1_090, 910, 1_090, 910]));
}

#[test]
fn a_station_that_keeps_a_slow_disk_busy_delays_neither_the_vehicle_nor_the_controller() {
    let mut world = World::start(SYNC);
    let slow = SYNC.as_millis() as u64;
    world.changes.slow.store(slow, Ordering::Relaxed);
    let attacks: [(&str, u32, Attack); 6] = [
        (NO_ATTACK, 1, |_, _| ()),
        ("LOI 3 on and off, 30/s", 30, flip),
        ("LOI 3 on and off, 2000/s", 2_000, flip),
        ("LOI 2 on and off, 30/s", 30, monitor),
        ("LOI 4 of a handover and back, 30/s", 30, handovers),
        ("50016 without a right, 2000/s", 2_000, vertices),
    ];
    let mut quiet = Typical::default();
    for (what, rate, attack) in attacks {
        let figures = world.attacked(what, (5.0, rate), attack, quiet);
        let (answered, missing) = (figures.took.len(), figures.missing);
        assert!(missing <= 5, "{what}: {missing} unanswered");
        assert!(answered >= 15, "{what}: {answered} answered");
        let most = figures.answer_at(0.75);
        assert!(most < SYNC, "{what}: a quarter took over {most:?}");
        World::hold_the_promise(what, &figures, quiet);
        if what == NO_ATTACK {
            quiet = figures.typical();
        }
    }
    let waited = world.changes.waited.lock().expect("no panic").clone();
    assert!(waited.is_empty(), "on the bridge's thread: {waited:?}");
    // The end waits for what is on its way.
    world.changes.slow.store(0, Ordering::Relaxed);
    let status = world.end();
    assert!(status.refused.get("too many changes of rights") > 0);
    assert!(status.refused.get("over the station's rate") > 0);
}

#[test]
fn a_flood_of_forged_requests_delays_neither_the_vehicle_nor_the_controller() {
    let mut world = World::start(SYNC);
    world.commands = 20.0;
    let mut quiet = Typical::default();
    for (what, rate) in [(NO_ATTACK, 1), ("forged 40000, 2000/s", 2_000)] {
        (world.forged_bytes, world.reflected_bytes) = (0, 0);
        let forges = |world: &mut World, number: u64| {
            if rate > 1 {
                forged_40000(world, number);
            }
        };
        let figures = world.attacked(what, (8.0, rate), forges, quiet);
        hold_all_answers(what, &figures, quiet);
        quiet = figures.typical();
    }
    let (forged, reflected) = (world.forged_bytes, world.reflected_bytes);
    assert!(forged > 100_000, "{forged} bytes were forged");
    assert!(reflected <= 3 * forged, "{reflected} for {forged} bytes");
    // In A's name they came from where A is not.
    let status = world.end();
    assert!(status.refused.get("unproven address") > 1_000);
}

#[test]
fn messages_of_exchanges_from_forty_addresses_delay_neither_the_vehicle_nor_the_controller() {
    let mut world = World::start_with(SYNC, "on");
    world.commands = 20.0;
    let crowd: Vec<UdpSocket> = (1..=40)
        .map(|host| {
            UdpSocket::bind(SocketAddr::from(([127, 0, 1, host], 0)))
                .expect("loopback has each address")
        })
        .collect();
    let mut quiet = Typical::default();
    for (what, rate) in [
        (NO_ATTACK, 1),
        ("messages of exchanges from forty addresses, 4000/s", 4_000),
    ] {
        let forges = |world: &mut World, number: u64| {
            if rate > 1 {
                let from = &crowd[number as usize % crowd.len()];
                let _ = from.send_to(&forged_exchange(number), world.mavlink);
            }
        };
        let figures = world.attacked(what, (8.0, rate), forges, quiet);
        hold_all_answers(what, &figures, quiet);
        quiet = figures.typical();
    }
    world.end();
}

#[test]
fn a_change_of_keys_on_a_slow_disk_delays_neither_the_vehicle_nor_the_controller() {
    // Three times as slow, so that a bridge that waits for it shows.
    let mut world = World::start_with(3 * SYNC, "on");
    world.commands = 20.0;
    let agent = world.agent.as_mut().expect("it is paired");
    agent.answers = true;
    // A request that was not answered is repeated every 4 s.
    world.run(8.0, 1, |_, _| ());
    let figures = world.take_figures("a change of keys");
    let agreed = world.agent.as_ref().expect("it is there").next.0;
    assert_eq!(agreed, 1, "the exchange completes");
    assert!(world._folder.path().join("uav.key.next").exists());
    assert_eq!(figures.missing, 0);
    let slow = figures.took.iter().filter(|took| **took >= SYNC).count();
    assert!(
        slow <= 4,
        "{slow} of {} commands are slow",
        figures.took.len()
    );
    World::hold_the_promise("a change of keys", &figures, Typical::default());
    world.end();
}

#[test]
fn a_slow_disk_of_the_agent_holds_up_no_frame() {
    let folder = tempfile::tempdir().expect("a folder");
    write_key(&folder.path().join("airside.key"), &[0x41; 32]);
    let px4 = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    px4.set_nonblocking(true).expect("it need not block");
    let radio = SocketAddr::from(([127, 0, 0, 1], free_udp_port()));
    let text = format!(
        "[agent]\nvehicle_id = \"1b:00:01:01\"\nvsm_id = \"1b:00:00:01\"\nkey_file = \"airside.key\"\n\
         [radio]\nlink = \"udpin:{radio}\"\n[px4]\nlink = \"udpout:{}\"\nsystem_id = 1\n[store]\ndir = \"state\"\n",
        px4.local_addr().expect("bound")
    );
    let config = AirsideConfig::parse(&text, folder.path()).expect("a good configuration");
    let (stop, stopped) = tokio::sync::oneshot::channel::<()>();
    let agent = thread::spawn(move || {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .expect("a runtime");
        runtime.block_on(async {
            let slow = |dir: &Path| FileDisk::open_on(dir, Box::new(Slow::new(3 * SYNC)));
            let server = AirsideServer::open_on(&config, &slow).expect("it starts");
            let stop = async {
                let _ = stopped.await;
            };
            server.serve(stop).await.expect("it serves until the end")
        })
    });
    let vehicle = px4_sim::Config {
        unix_time_us: wall().as_micros() as u64,
        ..px4_sim::Config::default()
    };
    let mut vehicle = Autopilot::new(vehicle, Signing::with_key(key(0), 0), vec![Some(radio)]);
    let ground = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let (mut seq, mut px4_at) = (0_u8, None);
    let (mut sent, mut relayed) = (Vec::<Instant>::new(), Vec::<Instant>::new());
    let mut took = Vec::<Duration>::new();
    let begun = Instant::now();
    // The ceiling of its clock is raised every six seconds or ten.
    while relayed
        .first()
        .is_none_or(|first| first.elapsed() < Duration::from_secs(12))
    {
        assert!(begun.elapsed() < Duration::from_secs(40), "nothing passes");
        let mut frame = [0; MAX_FRAME];
        vehicle.step(Duration::from_millis(10));
        while let Some(sent) = vehicle.poll_transmit(&mut frame) {
            if let Some(at) = px4_at {
                let _ = px4.send_to(&frame[..sent.len], at);
            }
        }
        seq = seq.wrapping_add(1);
        let header = Header {
            seq,
            system_id: 245,
            component_id: 190,
            incompat: INCOMPAT_SIGNED,
            ..Header::default()
        };
        let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        let length = encode(&beat, header, &mut frame);
        let stamp = Stamp::from_unix(wall());
        let length = sign(&key(0), 0, stamp, &mut frame, length).expect("it fits");
        sent.push(Instant::now());
        let _ = ground.send_to(&frame[..length], radio);
        thread::sleep(Duration::from_millis(10));
        let mut bytes = [0; 2_048];
        while let Ok((length, from)) = px4.recv_from(&mut bytes) {
            px4_at = Some(from);
            vehicle.handle_datagram(0, radio, &bytes[..length]);
            let frame = FrameView::parse(&bytes[..length]).ok();
            if let Some(frame) = frame.filter(|frame| frame.header().system_id == 245) {
                relayed.push(Instant::now());
                let later = usize::from(seq.wrapping_sub(frame.header().seq));
                took.extend(sent.iter().rev().nth(later).map(Instant::elapsed));
            }
        }
    }
    drop(stop);
    agent.join().expect("it ends");
    let gaps = |times: &[Instant]| {
        let gaps = times.windows(2).map(|two| two[1] - two[0]);
        let mut gaps: Vec<Duration> = gaps.collect();
        gaps.sort();
        gaps
    };
    let longest = at(1.0, &gaps(&relayed));
    assert!(longest < 5 * SYNC, "{longest:?} without a frame");
    // What has passed is looked for as often as frames are sent.
    took.sort();
    let (half, each) = (at(0.5, &took), at(0.5, &gaps(&sent)));
    assert!(half <= each + PROMISED, "{half:?}, sent each {each:?}");
}
