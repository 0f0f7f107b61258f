//! `vsm run` with many vehicles: processor time, memory, how long a mode change takes to its 3001 meanwhile, and what was lost.
//! Prints a Markdown table; `cargo bench -p vsm --bench fleet`, `-- --vehicles 200 --seconds 2` for one row of another size and shorter
//! turns, `--pack` with what is due together for a CUCS in one datagram (`cucs.pack`), `--bridges 2` for the vehicles divided between two
//! processes, `--before PROGRAM` for another build of `vsm` beside it, each twice. A figure is the median of five turns.
//!
//! Each vehicle signs with a key of its own, and sends HEARTBEAT at 1 Hz and ATTITUDE, GLOBAL_POSITION_INT, VFR_HUD and
//! ATTITUDE_QUATERNION at 10 Hz each; 200 share a link. Three CUCSs listen to all of them with the schedules that a bridge has
//! by itself. The vehicles answer nothing: what the bridge asks, it asks again.

#![allow(missing_docs, reason = "a bench has no callers")]
#![allow(clippy::print_stdout, reason = "figures are printed")]

mod common;

use std::collections::{HashMap, HashSet};
use std::fmt::Write as _;
use std::fs;
use std::net::{SocketAddr, UdpSocket};
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Barrier, Mutex};
use std::thread;
use std::time::{Duration, Instant};

use kit::clock::wall;
use kit::measure::{Spread, cpu_time, given, memory_kb, quantile, waited_for_a_core};
use kit::process::write_key;
use mavlink_link::dialect::{
    ATTITUDE_DATA, ATTITUDE_QUATERNION_DATA, GLOBAL_POSITION_INT_DATA, HEARTBEAT_DATA,
    MavAutopilot, MavMessage, MavModeFlag, MavType, VFR_HUD_DATA,
};
use mavlink_link::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::signing::{SigningKey, Stamp, sign};
use stanag_msgs::enums::{LoiBitmap, RequestedAccess};
use stanag_msgs::messages::CucsAuthorisationRequest;
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, TimeStamp, frames};

use common::{free, socket};

fn main() {
    // `cargo test --benches` asks for nothing to be measured.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    println!(
        "| `vsm run`, three CUCSs | frames/s | of a core, % | waited for a core, % | CPU a frame, us | memory | mode change p50, us | p99, us | reports/s | lost |"
    );
    println!("|---|---|---|---|---|---|---|---|---|---|");
    let seconds = number("--seconds").unwrap_or(4);
    let pack = std::env::args().any(|argument| argument == "--pack");
    let all = [
        (1, false, 1),
        (200, false, 1),
        (1_000, false, 1),
        (1_000, true, 1),
        (1_000, false, 2),
        (2_000, false, 1),
        (2_000, true, 1),
    ];
    let bridges = number("--bridges").unwrap_or(1);
    let rows = number("--vehicles").map_or(all.to_vec(), |only| vec![(only, pack, bridges)]);
    let now = Program {
        path: common::vsm().to_owned(),
        is_before: false,
    };
    let programs = given("--before").map_or(vec![now.clone()], |path| {
        let before = Program {
            path: PathBuf::from(path),
            is_before: true,
        };
        vec![now.clone(), before.clone(), before, now.clone()]
    });
    for (vehicles, pack, bridges) in rows {
        for program in &programs {
            // Of several, each has its part of the vehicles, and a driver and stations of its own.
            let all_fly = Barrier::new(bridges as usize);
            thread::scope(|scope| {
                for _ in 0..bridges {
                    scope.spawn(|| {
                        let world = World::start(program, vehicles / bridges, pack);
                        all_fly.wait();
                        world.measure(seconds, bridges);
                    });
                }
            });
        }
    }
}

/// A build of `vsm`.
#[derive(Clone)]
struct Program {
    path: PathBuf,
    is_before: bool,
}

fn number(option: &str) -> Option<u32> {
    given(option)?.parse().ok()
}

/// The bridge, its vehicles, and threads that read what its CUCSs are sent.
struct World {
    program: Program,
    vsm: Child,
    vehicles: Vec<Vehicle>,
    links: Vec<(UdpSocket, SocketAddr)>,
    stations: Vec<Arc<Station>>,
    /// Whether what is due together for a CUCS is in one datagram.
    pack: bool,
    folder: tempfile::TempDir,
    sent: u64,
    stamp: u64,
}

/// What one turn has cost.
struct Turn {
    frames_s: f64,
    core_percent: f64,
    /// How long it could have run and did not, as a part of the turn.
    waited_percent: f64,
    frame_us: f64,
    p50_us: f64,
    p99_us: f64,
    reports_s: f64,
}

struct Vehicle {
    id: Id,
    system: u8,
    link: usize,
    key: SigningKey,
    seq: u8,
    changed: bool,
}

struct Station {
    id: Id,
    socket: UdpSocket,
    reports: AtomicU64,
    ended: AtomicBool,
    /// The vehicles that have answered the request for LOI 2.
    answered: Mutex<HashSet<Id>>,
    /// Mode changes whose 3001 is waited for, and how long others took.
    waits: Mutex<HashMap<Id, Instant>>,
    took: Mutex<Vec<Duration>>,
}

impl World {
    fn start(program: &Program, count: u32, pack: bool) -> World {
        let folder = tempfile::tempdir().expect("a folder");
        let dli = free();
        let links: Vec<_> = (0..count.div_ceil(ON_A_LINK))
            .map(|_| (socket(), free()))
            .collect();
        let mut text = format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"{dli}\"\nlease_s = 3600\nmax_bytes_s = 10000000\nmax_messages_s = 100000\n"
        );
        let stations: Vec<_> = (0..3)
            .map(|at| Station::new(Id(0x1b00_00a0 + at)))
            .collect();
        for station in &stations {
            let id = station.id;
            let _ = writeln!(
                text,
                "[[cucs]]\nid = \"{id}\"\nloi = [2]\naddress = \"127.0.0.1\"\npack = {pack}"
            );
        }
        let mut vehicles = Vec::new();
        for at in 0..count {
            let (id, system) = (Id(0x1b01_0000 + at), (at % ON_A_LINK + 1) as u8);
            let link = (at / ON_A_LINK) as usize;
            let mut key = [0x5a; 32];
            key[..4].copy_from_slice(&at.to_be_bytes());
            let file = folder.path().join(format!("{at}.key"));
            write_key(&file, &key);
            let _ = writeln!(
                text,
                "[[vehicle]]\nid = \"{id}\"\nlink = \"udpin:{}\"\nsystem_id = {system}\nsigning = {{ key_file = \"{at}.key\" }}",
                links[link].1
            );
            vehicles.push(Vehicle {
                id,
                system,
                link,
                key: SigningKey::new(key).expect("a key"),
                seq: 0,
                changed: false,
            });
        }
        text += "[store]\ndir = \"state\"\n";
        let config = folder.path().join("vsm.toml");
        fs::write(&config, text).expect("the configuration");
        let vsm = Command::new(&program.path)
            .args(["run", "--config"])
            .arg(&config)
            .env("RUST_LOG", "off")
            .stderr(Stdio::null())
            .spawn()
            .expect("vsm run");
        let mut world = World {
            program: program.clone(),
            vsm,
            vehicles,
            links,
            stations,
            pack,
            folder,
            sent: 0,
            stamp: 0,
        };
        thread::sleep(Duration::from_millis(500 + u64::from(count)));
        // What a vehicle that appears leads to is no steady state.
        world.fly(2, false);
        for station in &world.stations {
            station.listen(dli, &world.vehicles);
        }
        world.fly(3, false);
        world
    }

    /// Sends what the vehicles send in this time; `changes`: with a hundred mode changes a second among it.
    fn fly(&mut self, seconds: u32, changes: bool) {
        let rounds = 10 * seconds;
        let steps = rounds * self.vehicles.len() as u32;
        let begun = Instant::now();
        let every = (self.vehicles.len() / 10).max(1);
        let mut done = 0;
        for round in 0..rounds {
            for at in 0..self.vehicles.len() {
                let due = begun
                    + Duration::from_secs_f64(
                        f64::from(seconds) * f64::from(done) / f64::from(steps),
                    );
                if let Some(wait) = due.checked_duration_since(Instant::now()) {
                    thread::sleep(wait);
                }
                done += 1;
                if (round as usize + at).is_multiple_of(10) {
                    self.send(at, &heartbeat(self.vehicles[at].changed));
                }
                for message in telemetry(round) {
                    self.send(at, &message);
                }
                if changes && (at + 7 * round as usize).is_multiple_of(every) {
                    self.change_mode(at);
                }
            }
            for (socket, _) in &self.links {
                drain(socket);
            }
        }
    }

    fn change_mode(&mut self, at: usize) {
        let vehicle = &mut self.vehicles[at];
        vehicle.changed = !vehicle.changed;
        let (id, message) = (vehicle.id, heartbeat(vehicle.changed));
        for station in &self.stations {
            let mut waits = station.waits.lock().expect("no panic");
            waits.insert(id, Instant::now());
        }
        self.send(at, &message);
    }

    fn send(&mut self, at: usize, message: &MavMessage) {
        let vehicle = &mut self.vehicles[at];
        vehicle.seq = vehicle.seq.wrapping_add(1);
        let header = Header {
            system_id: vehicle.system,
            component_id: 1,
            seq: vehicle.seq,
            incompat: INCOMPAT_SIGNED,
            ..Header::default()
        };
        let mut out = [0; MAX_FRAME];
        let length = encode(message, header, &mut out);
        // As every signer must: two frames within 10 us do not share a stamp.
        self.stamp = Stamp::from_unix(wall()).get().max(self.stamp + 1);
        let stamp = Stamp::new(self.stamp);
        let length = sign(&vehicle.key, 0, stamp, &mut out, length).expect("it fits");
        let (socket, to) = &self.links[vehicle.link];
        socket.send_to(&out[..length], to).expect("it is sent");
        self.sent += 1;
    }

    /// In turns of so many seconds.
    fn measure(mut self, seconds: u32, bridges: u32) {
        let (taken, sent) = (self.taken(), self.sent);
        let turns: Vec<Turn> = (0..TURNS).map(|_| self.turn(seconds)).collect();
        thread::sleep(Duration::from_millis(500));
        let (taken, sent) = (self.taken() - taken, self.sent - sent);
        let waits = |station: &Arc<Station>| station.waits.lock().expect("no panic").len();
        let unanswered: usize = self.stations.iter().map(waits).sum();
        let memory_mb = memory_kb(self.vsm.id()) / 1_000.0;
        let of = |part: fn(&Turn) -> f64| {
            let values: Vec<f64> = turns.iter().map(part).collect();
            Spread::of(&values)
        };
        let (core, p99) = (of(|turn| turn.core_percent), of(|turn| turn.p99_us));
        let vehicles = self.vehicles.len();
        let (kind, name) = match (self.pack, bridges) {
            (true, 1) => (", `pack`".to_owned(), "packed-".to_owned()),
            (_, 1) => Default::default(),
            _ => (
                format!(", one of {bridges} bridges"),
                format!("of-{bridges}-bridges-"),
            ),
        };
        let before = if self.program.is_before {
            ", before"
        } else {
            ""
        };
        println!(
            "| {vehicles} vehicles{kind}{before} | {:.0} | {core:.1} | {:.1} | {:.1} | {memory_mb:.1} MB | {:.0} | {p99:.0} | {:.0} | {} frames, {unanswered} mode changes |",
            of(|turn| turn.frames_s).median,
            of(|turn| turn.waited_percent),
            of(|turn| turn.frame_us),
            of(|turn| turn.p50_us),
            of(|turn| turn.reports_s).median,
            sent.saturating_sub(taken),
        );
        if self.program.is_before {
            return;
        }
        for (what, spread) in [
            ("core-percent", core),
            ("mode-p99-us", p99),
            ("memory-mb", Spread::of(&[memory_mb])),
        ] {
            println!(
                "{}",
                spread.figure(&format!("fleet-{vehicles}-{name}{what}"))
            );
        }
    }

    fn turn(&mut self, seconds: u32) -> Turn {
        let (cpu, sent, reports) = (cpu_time(self.vsm.id()), self.sent, self.reports());
        let waited = waited_for_a_core(self.vsm.id());
        let begun = Instant::now();
        self.fly(seconds, true);
        let took = begun.elapsed().as_secs_f64();
        let cpu = cpu_time(self.vsm.id()).saturating_sub(cpu).as_secs_f64();
        let waited = waited_for_a_core(self.vsm.id()).saturating_sub(waited);
        let (sent, reports) = ((self.sent - sent) as f64, self.reports() - reports);
        let mut times = Vec::new();
        for station in &self.stations {
            let took = std::mem::take(&mut *station.took.lock().expect("no panic"));
            times.extend(took.into_iter().map(|took| took.as_secs_f64() * 1e6));
        }
        Turn {
            frames_s: sent / took,
            core_percent: cpu / took * 100.0,
            waited_percent: waited.as_secs_f64() / took * 100.0,
            frame_us: cpu * 1e6 / sent,
            p50_us: quantile(&mut times, 0.5),
            p99_us: quantile(&mut times, 0.99),
            reports_s: reports as f64 / took,
        }
    }

    fn reports(&self) -> u64 {
        let each = self.stations.iter();
        each.map(|one| one.reports.load(Ordering::Relaxed)).sum()
    }

    /// How many messages the bridge has believed of all vehicles.
    fn taken(&self) -> u64 {
        let status = Command::new(&self.program.path)
            .args(["status", "--json", "--config"])
            .arg(self.folder.path().join("vsm.toml"))
            .output()
            .expect("vsm status");
        let status: serde_json::Value = serde_json::from_slice(&status.stdout).expect("JSON");
        let vehicles = status["vehicles"].as_array().expect("vehicles");
        let counts = vehicles
            .iter()
            .filter_map(|one| one["link"]["received"].as_object());
        counts
            .flat_map(|counts| counts.values())
            .filter_map(serde_json::Value::as_u64)
            .sum()
    }
}

impl Drop for World {
    fn drop(&mut self) {
        for station in &self.stations {
            station.ended.store(true, Ordering::Relaxed);
        }
        let _ = self.vsm.kill();
        let _ = self.vsm.wait();
    }
}

impl Station {
    fn new(id: Id) -> Arc<Station> {
        Arc::new(Station {
            id,
            socket: socket(),
            reports: AtomicU64::new(0),
            ended: AtomicBool::new(false),
            answered: Mutex::default(),
            waits: Mutex::default(),
            took: Mutex::default(),
        })
    }

    /// Requests LOI 2 of every vehicle, and counts what comes from then on. As a CUCS does, it asks again where nothing is
    /// answered: while the files of so many new vehicles are made, not every request finds room to wait for the disk.
    fn listen(self: &Arc<Station>, dli: SocketAddr, vehicles: &[Vehicle]) {
        let station = Arc::clone(self);
        thread::spawn(move || station.count());
        for _ in 0..ATTEMPTS {
            let answered = self.answered.lock().expect("no panic").clone();
            let asked = vehicles.iter().filter(|one| !answered.contains(&one.id));
            if self.request(dli, asked) == 0 {
                return;
            }
            thread::sleep(Duration::from_millis(500));
        }
        panic!("{} is not answered for every vehicle", self.id);
    }

    /// Returns how many vehicles it has asked for.
    fn request<'a>(&self, dli: SocketAddr, vehicles: impl Iterator<Item = &'a Vehicle>) -> usize {
        let mut asked = 0;
        for vehicle in vehicles {
            asked += 1;
            let request = Message::from(CucsAuthorisationRequest {
                time_stamp: Some(TimeStamp::from_unix_ms(wall().as_millis() as u64)),
                requested_handover_loi: Some(LoiBitmap::LOI2),
                requested_handover_access: Some(RequestedAccess::Request),
                ..CucsAuthorisationRequest::default()
            });
            let mut out = [0; MAX_DATAGRAM];
            let envelope = Envelope::new(self.id, vehicle.id);
            let length = request.encode(&envelope, &mut out).expect("it fits");
            let sent = self.socket.send_to(&out[..length], dli);
            sent.expect("it is sent");
            thread::sleep(Duration::from_millis(2));
        }
        asked
    }

    fn count(&self) {
        let mut bytes = [0; 2_048];
        while !self.ended.load(Ordering::Relaxed) {
            let Ok((length, _)) = self.socket.recv_from(&mut bytes) else {
                continue;
            };
            let now = Instant::now();
            for frame in frames(&bytes[..length]).flatten() {
                self.reports.fetch_add(1, Ordering::Relaxed);
                if frame.header.message_type == 2 {
                    let mut answered = self.answered.lock().expect("no panic");
                    answered.insert(frame.header.source);
                }
                if frame.header.message_type == 3001 {
                    let begun = self
                        .waits
                        .lock()
                        .expect("no panic")
                        .remove(&frame.header.source);
                    if let Some(begun) = begun {
                        self.took.lock().expect("no panic").push(now - begun);
                    }
                }
            }
        }
    }
}

fn heartbeat(changed: bool) -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: [0x0304_0000, 0x0404_0000][usize::from(changed)],
        mavtype: MavType::MAV_TYPE_QUADROTOR,
        autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
        base_mode: MavModeFlag::MAV_MODE_FLAG_CUSTOM_MODE_ENABLED,
        mavlink_version: 3,
        ..HEARTBEAT_DATA::default()
    })
}

fn telemetry(round: u32) -> [MavMessage; 4] {
    let time_boot_ms = 1_000 + 100 * round;
    let part = f32::from((round % 100) as u8) / 100.0;
    [
        MavMessage::ATTITUDE(ATTITUDE_DATA {
            time_boot_ms,
            roll: part,
            yaw: part * 3.0,
            ..ATTITUDE_DATA::default()
        }),
        MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            time_boot_ms,
            lat: 473_977_419 + round as i32,
            lon: 85_455_938,
            alt: 500_000,
            relative_alt: 12_000,
            ..GLOBAL_POSITION_INT_DATA::default()
        }),
        MavMessage::VFR_HUD(VFR_HUD_DATA {
            groundspeed: 5.0 + part,
            alt: 500.0,
            ..VFR_HUD_DATA::default()
        }),
        MavMessage::ATTITUDE_QUATERNION(ATTITUDE_QUATERNION_DATA {
            time_boot_ms,
            q1: 1.0,
            ..ATTITUDE_QUATERNION_DATA::default()
        }),
    ]
}

fn drain(socket: &UdpSocket) {
    socket.set_nonblocking(true).expect("a socket");
    while socket.recv_from(&mut [0; 2_048]).is_ok() {}
    socket.set_nonblocking(false).expect("a socket");
}

const TURNS: usize = 5;
/// How often a station asks for LOI 2 before it gives up.
const ATTEMPTS: usize = 20;
/// Vehicles that share a link: each has a system id of its own there.
const ON_A_LINK: u32 = 200;
