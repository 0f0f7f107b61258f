//! The same signed telemetry through `vsm run`, mavlink-router, MAVSDK and pymavlink: what a message costs each of them, and what
//! they lose. Prints Markdown tables; `cargo bench -p vsm --bench beside`, `-- --turns 9` for more turns than five,
//! `--rate 20000` for that rate alone, `--before PROGRAM` for another build of `vsm` in the same turns.
//!
//! Each gets the same stream of its own, signed beforehand, one after the other in turns of random order ([`kit::measure`]).
//! They do not do the same work: `vsm run` verifies each frame and reports to a CUCS at 2 Hz; with a `[[forward]]` it sends each on
//! besides, which is all that mavlink-router does, without verifying; MAVSDK receives and decodes without verifying; pymavlink
//! verifies and decodes.
//!
//! mavlink-router is the program `MAVLINK_ROUTERD`, or `mavlink-routerd` of the search path; MAVSDK and pymavlink are those of
//! `cargo xtask peers`. What is not there is left out, which is printed.

#![allow(missing_docs, reason = "a bench has no callers")]
#![allow(clippy::print_stdout, reason = "figures are printed")]

#[path = "common/bridge.rs"]
mod bridge;
mod common;
#[path = "common/driver.rs"]
mod driver;
#[path = "common/vehicle.rs"]
mod vehicle;

use std::fs;
use std::net::{SocketAddr, UdpSocket};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use kit::Random;
use kit::measure::{Spread, cpu_time, given, in_turns, wakeups};
use kit::process::{Running, hex};

use bridge::World;
use common::{free, socket};
use driver::Frames;
use vehicle::{Autopilot, KEY};

fn main() {
    // `cargo test --benches` asks for nothing to be measured.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    let turns = number("--turns").unwrap_or(5) as usize;
    let others = Others::find();
    if let Some(rate) = number("--rate") {
        return loads(turns, rate, &others);
    }
    idle(turns, others.router.as_deref());
    for rate in [100, 1_000, 20_000] {
        loads(turns, rate, &others);
    }
}

fn number(option: &str) -> Option<u32> {
    given(option)?.parse().ok()
}

/// Other people's programs, as far as they are here.
struct Others {
    router: Option<PathBuf>,
    /// Of the environment with pymavlink and MAVSDK.
    python: Option<PathBuf>,
}

impl Others {
    fn find() -> Others {
        let named = std::env::var_os("MAVLINK_ROUTERD").map(PathBuf::from);
        let router = named.unwrap_or_else(|| PathBuf::from("mavlink-routerd"));
        let version = Command::new(&router).arg("--version").output();
        let version = version.ok().filter(|output| output.status.success());
        match &version {
            Some(output) => println!("note: {}", String::from_utf8_lossy(&output.stdout).trim()),
            None => println!(
                "note: LEFT OUT: mavlink-router: no program {}; set MAVLINK_ROUTERD",
                router.display()
            ),
        }
        let python = comparison_benches::python();
        if let Err(missing) = &python {
            println!("note: LEFT OUT: MAVSDK and pymavlink: {missing}");
        }
        Others {
            router: version.map(|_| router),
            python: python.ok(),
        }
    }
}

/// How often a second each is woken while nobody sends it anything.
fn idle(turns: usize, router: Option<&Path>) {
    let mut subjects = vec![Subject::vsm(
        "vsm run",
        World::silent(common::vsm(), true, ""),
    )];
    subjects.extend(router.map(Subject::router));
    let woken = in_turns(turns, &mut Random::new(), &mut subjects, |subject| {
        let before = wakeups(subject.process());
        std::thread::sleep(IDLE);
        (wakeups(subject.process()) - before) as f64 / IDLE.as_secs_f64()
    });
    println!("| idle, nobody sends | wake-ups/s |");
    println!("|---|---|");
    for (subject, woken) in subjects.iter().zip(&woken) {
        println!("| {} | {:.1} |", subject.name, Spread::of(woken));
    }
    println!();
    println!("{}", Spread::of(&woken[0]).figure("idle-wakeups"));
}

fn loads(turns: usize, rate: u32, others: &Others) {
    let (plain, forwarding) = (
        "`vsm run`",
        "`vsm run`, each frame sent on by a `[[forward]]`",
    );
    let mut subjects = vec![
        Subject::vsm(plain, World::start(common::vsm(), true, "")),
        Subject::forwarding(forwarding, common::vsm()),
    ];
    if let Some(before) = given("--before") {
        let before = Path::new(&before);
        let world = World::start(before, true, "");
        subjects.push(Subject::vsm("`vsm run` before", world));
        subjects.push(Subject::forwarding(
            "the same, with a `[[forward]]`",
            before,
        ));
    }
    subjects.extend(others.router.as_deref().map(Subject::router));
    if let Some(python) = &others.python {
        subjects.push(Subject::python("MAVSDK, verifies nothing", python, MAVSDK));
        subjects.push(Subject::python("pymavlink", python, PYMAVLINK));
    }
    let seconds = if rate < 1_000 { 4 } else { 2 };
    let loads = in_turns(turns, &mut Random::new(), &mut subjects, |subject| {
        subject.load(rate, seconds)
    });
    let cpu = |at: usize| loads[at].iter().map(|load| load.cpu_us).collect::<Vec<_>>();
    let router = subjects.iter().position(|subject| subject.name == ROUTER);
    println!(
        "| {rate} signed frames/s | CPU a message, us | of mavlink-router's | lost | slowest turn of the driver |"
    );
    println!("|---|---|---|---|---|");
    for (at, (subject, loads)) in subjects.iter().zip(&loads).enumerate() {
        let ratio = router.map(|router| Spread::of_ratios(&cpu(at), &cpu(router)));
        let lost: Option<u64> = loads.iter().map(|load| load.lost).sum();
        let sent: u64 = loads.iter().map(|load| load.sent).sum();
        let driven = loads.iter().map(|load| load.driven);
        println!(
            "| {} | {:.1} | {} | {} | {:.0}/s |",
            subject.name,
            Spread::of(&cpu(at)),
            ratio.map_or("-".to_owned(), |ratio| format!("{ratio:.2}")),
            lost.map_or("not counted".to_owned(), |lost| format!("{lost} of {sent}")),
            driven.fold(f64::INFINITY, f64::min),
        );
    }
    println!();
    for (at, name) in ["cpu", "cpu-forwarding"].into_iter().enumerate() {
        if let Some(router) = router {
            let ratio = Spread::of_ratios(&cpu(at), &cpu(router));
            println!("{}", ratio.figure(&format!("{name}-of-router-{rate}")));
        }
    }
}

/// What one turn has cost.
struct Load {
    cpu_us: f64,
    sent: u64,
    /// Of those sent; none where it cannot be counted.
    lost: Option<u64>,
    /// Frames a second that the driver has sent.
    driven: f64,
}

/// A program that gets telemetry.
struct Subject {
    name: &'static str,
    program: Program,
    counter: Counter,
}

enum Program {
    Vsm(World),
    Other {
        running: Running,
        autopilot: Autopilot,
        vehicle: UdpSocket,
        _folder: Option<tempfile::TempDir>,
    },
}

/// How many frames it has got.
enum Counter {
    /// By its own status.
    Status,
    /// What it has sent on.
    Arrivals(Arrivals),
    /// The last line that it printed.
    Printed,
    Nobody,
}

impl Subject {
    fn vsm(name: &'static str, world: World) -> Subject {
        Subject {
            name,
            program: Program::Vsm(world),
            counter: Counter::Status,
        }
    }

    fn forwarding(name: &'static str, program: &Path) -> Subject {
        let arrivals = Arrivals::start();
        let forward = format!(
            "[[forward]]\nname = \"station\"\nlink = \"udpout:{}\"\n",
            arrivals.at
        );
        Subject {
            counter: Counter::Arrivals(arrivals),
            ..Subject::vsm(name, World::start(program, true, &forward))
        }
    }

    /// A server for the vehicle, a client for a ground station, as its documentation has them for SITL; no log, no TCP.
    fn router(program: &Path) -> Subject {
        let (folder, vehicle, arrivals) = (
            tempfile::tempdir().expect("a folder"),
            free(),
            Arrivals::start(),
        );
        let config = folder.path().join("main.conf");
        let text = format!(
            "[General]\nTcpServerPort = 0\nReportStats = false\n\
             [UdpEndpoint vehicle]\nMode = Server\nAddress = 127.0.0.1\nPort = {}\n\
             [UdpEndpoint station]\nMode = Normal\nAddress = 127.0.0.1\nPort = {}\n",
            vehicle.port(),
            arrivals.at.port()
        );
        fs::write(&config, text).expect("its configuration");
        let mut command = Command::new(program);
        command.arg("-c").arg(&config);
        let running = Running::spawn(&mut command);
        std::thread::sleep(Duration::from_millis(500));
        Subject {
            name: ROUTER,
            program: Program::other(running, vehicle, Some(folder)),
            counter: Counter::Arrivals(arrivals),
        }
    }

    fn python(name: &'static str, python: &Path, script: &str) -> Subject {
        let vehicle = free();
        let mut command = Command::new(python);
        command.args(["-c", script]);
        command.args([vehicle.port().to_string(), hex(&KEY)]);
        let mut running = Running::spawn(&mut command);
        running.wait_for("ready", Duration::from_secs(30));
        Subject {
            name,
            program: Program::other(running, vehicle, None),
            counter: match script == PYMAVLINK {
                true => Counter::Printed,
                false => Counter::Nobody,
            },
        }
    }

    fn process(&self) -> u32 {
        match &self.program {
            Program::Vsm(world) => world.process(),
            Program::Other { running, .. } => running.id(),
        }
    }

    /// Its vehicle's frames, and the socket that they are sent from.
    fn vehicle(&self) -> (&Autopilot, &UdpSocket) {
        match &self.program {
            Program::Vsm(world) => (&world.autopilot, &world.vehicle),
            Program::Other {
                autopilot, vehicle, ..
            } => (autopilot, vehicle),
        }
    }

    fn got(&self) -> Option<u64> {
        match (&self.counter, &self.program) {
            (Counter::Status, Program::Vsm(world)) => Some(world.taken()),
            (Counter::Arrivals(arrivals), _) => Some(arrivals.count.load(Ordering::Relaxed)),
            (Counter::Printed, Program::Other { running, .. }) => {
                let printed = running.output();
                let count = printed.lines().rev().find_map(|line| line.parse().ok());
                Some(count.unwrap_or(0))
            }
            _ => None,
        }
    }

    fn load(&self, rate: u32, seconds: u32) -> Load {
        let (autopilot, vehicle) = self.vehicle();
        // What a vehicle that reappears after the turns of the others leads to is not of the load.
        Frames::telemetry(autopilot, 100, 1).drive(vehicle, 100);
        std::thread::sleep(Duration::from_millis(500));
        let frames = Frames::telemetry(autopilot, rate, seconds);
        let got = self.got();
        let cpu = cpu_time(self.process());
        let took = frames.drive(vehicle, rate);
        // What is still in its socket is its work too.
        std::thread::sleep(Duration::from_millis(500));
        let cpu = cpu_time(self.process()).saturating_sub(cpu);
        let sent = frames.count();
        let got = self.got().zip(got).map(|(now, before)| now - before);
        Load {
            // What is lost costs it nothing.
            cpu_us: cpu.as_secs_f64() * 1e6 / got.unwrap_or(sent).max(1) as f64,
            sent,
            lost: got.map(|got| sent.saturating_sub(got)),
            driven: sent as f64 / took.as_secs_f64(),
        }
    }
}

impl Program {
    fn other(running: Running, to: SocketAddr, folder: Option<tempfile::TempDir>) -> Program {
        let vehicle = socket();
        vehicle.connect(to).expect("its address");
        Program::Other {
            running,
            autopilot: Autopilot::new(true),
            vehicle,
            _folder: folder,
        }
    }
}

/// The ground station that frames are sent on to: it counts those of the vehicle.
struct Arrivals {
    at: SocketAddr,
    count: Arc<AtomicU64>,
}

impl Arrivals {
    fn start() -> Arrivals {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        let at = socket.local_addr().expect("its address");
        let count = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&count);
        // It ends with the bench.
        std::thread::spawn(move || {
            let mut bytes = [0; 65_536];
            while let Ok((length, _)) = socket.recv_from(&mut bytes) {
                counted.fetch_add(frames_in(&bytes[..length]), Ordering::Relaxed);
            }
        });
        Arrivals { at, count }
    }
}

/// How many frames of MAVLink 2 of the vehicle a datagram has: a router may put several into one.
fn frames_in(mut bytes: &[u8]) -> u64 {
    let mut count = 0;
    while let [0xfd, payload, flags, _, _, system, ..] = *bytes {
        let signature = if flags & 1 == 0 { 0 } else { 13 };
        let length = 12 + usize::from(payload) + signature;
        count += u64::from(system == 1);
        bytes = bytes.get(length..).unwrap_or_default();
    }
    count
}

const ROUTER: &str = "mavlink-router, verifies nothing";
const IDLE: Duration = Duration::from_secs(2);

const MAVSDK: &str = r#"
import sys, time
from mavsdk import ComponentType, Configuration, Mavsdk
station = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
station.add_any_connection(f"udpin://127.0.0.1:{sys.argv[1]}")
print("ready", flush=True)
while True:
    time.sleep(3600)
"#;

const PYMAVLINK: &str = r#"
import os, select, sys
os.environ["MAVLINK20"] = "1"
from pymavlink import mavutil
link = mavutil.mavlink_connection(f"udpin:127.0.0.1:{sys.argv[1]}", dialect="common")
link.setup_signing(bytes.fromhex(sys.argv[2]), sign_outgoing=True, allow_unsigned_callback=None)
print("ready", flush=True)
count = printed = 0
while True:
    if select.select([link.fd], [], [], 0.1)[0]:
        message = link.recv_msg()
        while message is not None:
            count += message.get_type() in ("ATTITUDE", "HEARTBEAT")
            message = link.recv_msg()
    elif count != printed:
        printed = count
        print(count, flush=True)
"#;
