//! `vsm run` between sockets on loopback: how long a message takes through it, what it costs, and how many a second it
//! takes before one is lost. Prints a Markdown table; `cargo bench -p vsm --bench sockets`.
//!
//! Vehicle to CUCS: a signed HEARTBEAT that changes the mode, until the 3001 that tells it. CUCS to vehicle nothing
//! passes by itself: an order waits for what the vehicle shows. Measured is a 17002 until its answer. By turns with each
//! message one goes to a process that does nothing but send it back: what the bridge adds is the difference, the rest is
//! the system's. Sticks (2010) at 50 Hz pass as they come, to `px4-sim` flown by hand within this program: their age when the vehicle
//! has them. Then the whole program under telemetry at PX4's rate and far above it, with signing on and off: its
//! share of a core and its memory.

#![allow(missing_docs, reason = "a bench has no callers")]
#![allow(clippy::print_stdout, reason = "figures are printed")]

mod common;
#[path = "common/process.rs"]
mod process;
#[path = "common/vehicle.rs"]
mod vehicle;

use std::cell::Cell;
use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead as _, BufReader};
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::fs::PermissionsExt as _;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use kit::clock::wall;
use mavlink_link::frame::{FrameView, MAX_FRAME};
use mavlink_link::signing::SigningKey;
use stanag_msgs::enums::{FlightPathControlMode, LoiBitmap, RequestedAccess};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, GenericInformationRequestMessage, UaStickCommand,
    VehicleOperatingModeCommand,
};
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, TimeStamp, frames};

use common::{free, socket};
use process::{cpu_time, memory_kb};
use vehicle::Autopilot;

fn main() {
    // `cargo test --benches` asks for nothing to be measured.
    if !std::env::args().any(|argument| argument == "--bench") {
        if std::env::args().any(|argument| argument == ECHO) {
            echo();
        }
        return;
    }
    let world = World::start(true);
    println!(
        "| through `vsm run` on loopback | p50 | p99 | bare echo p50 | p99 | added p50 | p99 | CPU a message | lost |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    world.measure("mode change to 3001, 100/s", 100, World::mode_change);
    world.measure("mode change to 3001, 1000/s", 1_000, World::mode_change);
    world.measure("17002 to its answer, 1000/s", 1_000, World::question);
    world.flood();
    drop(world);
    World::start(true).sticks();
    println!("| `vsm run` under telemetry, one vehicle | of a core | CPU a frame | memory |");
    println!("|---|---|---|---|");
    for (rate, seconds) in [(PX4_RATE, 30), (5_000, 10)] {
        for signed in [false, true] {
            World::start(signed).load(rate, seconds);
        }
    }
}

struct World {
    autopilot: Autopilot,
    vsm: Child,
    vehicle: UdpSocket,
    station: UdpSocket,
    mavlink: SocketAddr,
    dli: SocketAddr,
    asked: Cell<u64>,
    echo: Echo,
    folder: tempfile::TempDir,
}

/// A process that sends back what it gets.
struct Echo {
    process: Child,
    socket: UdpSocket,
}

impl Echo {
    fn start() -> Echo {
        let own = std::env::current_exe().expect("this program");
        let mut process = Command::new(own)
            .arg(ECHO)
            .stdout(Stdio::piped())
            .spawn()
            .expect("the echo");
        let mut line = String::new();
        let said = process.stdout.take().expect("a pipe");
        BufReader::new(said).read_line(&mut line).expect("its port");
        let socket = socket();
        socket.connect(line.trim()).expect("its address");
        Echo { process, socket }
    }

    /// How long a datagram of the size of a signed HEARTBEAT is under way there and back.
    fn measure(&self) -> Duration {
        let begun = Instant::now();
        self.socket.send(&[0; 34]).expect("it is sent");
        self.socket.recv(&mut [0; 64]).expect("it comes back");
        begun.elapsed()
    }
}

impl Drop for Echo {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// Tells its address, then sends back what comes until it is killed.
fn echo() {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    println!("{}", socket.local_addr().expect("its address"));
    let mut bytes = [0; 2_048];
    while let Ok((length, from)) = socket.recv_from(&mut bytes) {
        let _ = socket.send_to(&bytes[..length], from);
    }
}

impl World {
    fn start(signed: bool) -> World {
        let folder = tempfile::tempdir().expect("a folder");
        let (dli, mavlink) = (free(), free());
        let key = folder.path().join("uav.key");
        fs::write(&key, "5a".repeat(32)).expect("the key");
        fs::set_permissions(&key, fs::Permissions::from_mode(0o600)).expect("its mode");
        let config = folder.path().join("vsm.toml");
        let signing = match signed {
            true => "{ key_file = \"uav.key\" }",
            false => "\"off\"",
        };
        let text = format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"{dli}\"\nlease_s = 3600\n\
             [[cucs]]\nid = \"{CUCS}\"\nloi = [2, 4]\naddress = \"127.0.0.1\"\n[[vehicle]]\n\
             id = \"{VEHICLE}\"\nlink = \"udpin:{mavlink}\"\nsystem_id = 1\nsigning = {signing}\n\
             [store]\ndir = \"state\"\n"
        );
        fs::write(&config, text).expect("the configuration");
        let vsm = Command::new(VSM)
            .args(["run", "--config"])
            .arg(&config)
            .env("RUST_LOG", "off")
            .stderr(Stdio::null())
            .spawn()
            .expect("vsm run");
        let world = World {
            autopilot: Autopilot::new(signed),
            vsm,
            vehicle: socket(),
            station: socket(),
            mavlink,
            dli,
            asked: Cell::new(0),
            echo: Echo::start(),
            folder,
        };
        std::thread::sleep(Duration::from_millis(500));
        world.request(LoiBitmap::LOI2);
        for _ in 0..50 {
            world.mode_change();
            std::thread::sleep(Duration::from_millis(20));
        }
        world.discard();
        world
    }

    fn request(&self, loi: LoiBitmap) {
        self.say(&Message::from(CucsAuthorisationRequest {
            time_stamp: Some(stamp()),
            requested_handover_loi: Some(loi),
            requested_handover_access: Some(RequestedAccess::Request),
            ..CucsAuthorisationRequest::default()
        }));
    }

    /// A 3001 reports it.
    fn mode_change(&self) {
        self.report(&self.autopilot.mode_change());
    }

    fn attitude(&self) {
        self.report(&self.autopilot.attitude());
    }

    fn report(&self, frame: &[u8]) {
        let sent = self.vehicle.send_to(frame, self.mavlink);
        sent.expect("it is sent");
    }

    /// A 17002 for 3001; a 3001 answers it.
    fn question(&self) {
        // A second one of the same stamp would be the first one come again.
        let unix_ms = stamp().unix_ms().max(self.asked.get() + 1);
        self.asked.set(unix_ms);
        self.say(&Message::from(GenericInformationRequestMessage {
            time_stamp: Some(TimeStamp::from_unix_ms(unix_ms)),
            message_type: Some(3001),
            ..GenericInformationRequestMessage::default()
        }));
    }

    fn say(&self, message: &Message) {
        let mut out = [0; MAX_DATAGRAM];
        let envelope = Envelope::new(CUCS, VEHICLE);
        let length = message.encode(&envelope, &mut out).expect("it fits");
        let sent = self.station.send_to(&out[..length], self.dli);
        sent.expect("it is sent");
    }

    /// Sends at this rate for three seconds, one at a time, and awaits each.
    fn measure(&self, what: &str, rate: u32, send: impl Fn(&World)) {
        let count = rate * 10;
        let (mut times, mut bare, mut lost) = (Vec::new(), Vec::new(), 0);
        let cpu = cpu_time(self.vsm.id());
        let mut due = Instant::now();
        for _ in 0..count {
            while Instant::now() < due {
                std::hint::spin_loop();
            }
            due = Instant::now().max(due + Duration::from_secs(1) / rate);
            self.discard();
            let begun = Instant::now();
            send(self);
            match self.await_report(begun) {
                Some(took) => times.push(took),
                None => lost += 1,
            }
            bare.push(self.echo.measure());
        }
        let cpu = cpu_time(self.vsm.id()).saturating_sub(cpu);
        row(what, [times, bare], cpu, (lost, count));
    }

    /// Sticks at 50 Hz, and how old each is when the vehicle has it. The stick's own value tells which one it is.
    fn sticks(&self) {
        let signing = px4_sim::Signing::with_key(SigningKey::new([0x5a; 32]).expect("a key"), 0);
        let config = px4_sim::Config {
            unix_time_us: wall().as_micros() as u64,
            ..px4_sim::Config::default()
        };
        let mut vehicle = px4_sim::Autopilot::new(config, signing, vec![Some(self.mavlink)]);
        self.discard();
        self.vehicle.set_nonblocking(true).expect("a socket");
        let (begun, mut flown) = (Instant::now(), Duration::ZERO);
        let (mut on_the_way, mut ages, mut bare) = (BTreeMap::new(), Vec::new(), Vec::new());
        let (mut frame, mut bytes) = ([0; MAX_FRAME], [0; 2_048]);
        let (mut number, mut cpu) = (0, Duration::ZERO);
        while number < MEASURED_FROM + STICKS {
            while flown < begun.elapsed() {
                flown += SIMULATED;
                vehicle.step(SIMULATED);
                while let Some(sent) = vehicle.poll_transmit(&mut frame) {
                    self.report(&frame[..sent.len]);
                }
            }
            while let Ok((length, _)) = self.vehicle.recv_from(&mut bytes) {
                let sent = lateral_stick(&bytes[..length]).and_then(|it| on_the_way.remove(&it));
                ages.extend(sent.map(|at: Instant| at.elapsed()));
                vehicle.handle_datagram(0, self.mavlink, &bytes[..length]);
            }
            if begun.elapsed() < STICK_PERIOD * number {
                std::hint::spin_loop();
                continue;
            }
            match number {
                // The vehicle has reported itself under its own stamps.
                REQUESTED_AT => self.request(LoiBitmap::from_raw(0x05)),
                ENGAGED_AT => self.say(&Message::from(VehicleOperatingModeCommand {
                    time_stamp: Some(stamp()),
                    select_flight_path_control_mode: Some(FlightPathControlMode::FlightDirector),
                    ..VehicleOperatingModeCommand::default()
                })),
                MEASURED_FROM => cpu = cpu_time(self.vsm.id()),
                _ => {}
            }
            let lateral = (number % 200) as i8 - 100;
            let stick = Message::from(UaStickCommand {
                time_stamp: Some(stamp()),
                lateral_stick: Some(lateral),
                throttle_stick_engine_1: Some(50),
                ..UaStickCommand::default()
            });
            if number >= MEASURED_FROM {
                bare.push(self.echo.measure());
                on_the_way.insert(lateral, Instant::now());
            }
            // Whoever is not in control has its sticks refused.
            if number >= STICKS_FROM {
                self.say(&stick);
            }
            number += 1;
        }
        let cpu = cpu_time(self.vsm.id()).saturating_sub(cpu);
        let lost = STICKS.saturating_sub(ages.len() as u32);
        row(
            "2010 to MANUAL_CONTROL, 50/s",
            [ages, bare],
            cpu,
            (lost, STICKS),
        );
    }

    /// Telemetry at this rate, and what it costs: processor time, and memory at the end.
    fn load(&self, rate: u32, seconds: u32) {
        let (cpu, before) = (cpu_time(self.vsm.id()), self.taken(ATTITUDE));
        let begun = Instant::now();
        for number in 0..rate * seconds {
            let due = begun + Duration::from_secs(1) * number / rate;
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            self.attitude();
            if number.is_multiple_of(16) {
                self.discard();
            }
        }
        let took = begun.elapsed();
        std::thread::sleep(Duration::from_millis(300));
        self.discard();
        let cpu = cpu_time(self.vsm.id()).saturating_sub(cpu);
        let taken = self.taken(ATTITUDE) - before;
        println!(
            "| {rate} frames/s, signing {}, {taken} of {} taken | {:.1} % | {:.1} us | {:.1} MB |",
            if self.autopilot.signed { "on" } else { "off" },
            rate * seconds,
            cpu.as_secs_f64() / took.as_secs_f64() * 100.0,
            cpu.as_secs_f64() * 1e6 / f64::from(rate * seconds),
            memory_kb(self.vsm.id()) / 1_000.0,
        );
    }

    fn await_report(&self, begun: Instant) -> Option<Duration> {
        let mut bytes = [0; 2_048];
        loop {
            let (length, _) = self.station.recv_from(&mut bytes).ok()?;
            let took = begun.elapsed();
            let mut found = frames(&bytes[..length]).flatten();
            if found.any(|frame| frame.header.message_type == 3001) {
                return Some(took);
            }
        }
    }

    /// Throws away what has come.
    fn discard(&self) {
        for socket in [&self.station, &self.vehicle] {
            socket.set_nonblocking(true).expect("a socket");
            while socket.recv_from(&mut [0; 2_048]).is_ok() {}
            socket.set_nonblocking(false).expect("a socket");
        }
    }

    /// Signed frames at rising rates, a second each, until not all of them were taken.
    fn flood(&self) {
        let mut best = "under 2000".to_owned();
        for rate in [2_000_u32, 5_000, 10_000, 20_000, 40_000, 80_000] {
            let before = self.taken(HEARTBEAT);
            let begun = Instant::now();
            for number in 0..rate {
                while begun.elapsed() < Duration::from_secs(1) * number / rate {
                    std::hint::spin_loop();
                }
                self.mode_change();
                if number.is_multiple_of(16) {
                    self.discard();
                }
            }
            let late = begun.elapsed() > Duration::from_millis(1_050);
            std::thread::sleep(Duration::from_millis(300));
            self.discard();
            if late || self.taken(HEARTBEAT) - before < u64::from(rate) {
                break;
            }
            best = rate.to_string();
        }
        println!("| signed frames a second before one is lost: {best} | | | | | | | | |");
    }

    /// How many messages of this id the bridge has believed of the vehicle.
    fn taken(&self, id: &str) -> u64 {
        let status = Command::new(VSM)
            .args(["status", "--json", "--config"])
            .arg(self.folder.path().join("vsm.toml"))
            .output()
            .expect("vsm status");
        let status: serde_json::Value = serde_json::from_slice(&status.stdout).expect("JSON");
        let link = &status["vehicles"][0]["link"];
        assert!(link["received"].is_object(), "no counts in {status:#}");
        // None is counted before the first.
        link["received"][id].as_u64().unwrap_or(0)
    }
}

impl Drop for World {
    fn drop(&mut self) {
        let _ = self.vsm.kill();
        let _ = self.vsm.wait();
    }
}

/// A row of the first table: times through the bridge and of the bare echo.
fn row(what: &str, times: [Vec<Duration>; 2], cpu: Duration, (lost, count): (u32, u32)) {
    let [whole, bare] = times.map(Percentiles::of);
    println!(
        "| {what} | {:.0} us | {:.0} us | {:.0} us | {:.0} us | {:.0} us | {:.0} us | {:.0} us | {lost} of {count} |",
        whole.p50,
        whole.p99,
        bare.p50,
        bare.p99,
        whole.p50 - bare.p50,
        whole.p99 - bare.p99,
        cpu.as_secs_f64() * 1e6 / f64::from(count),
    );
}

/// The lateral stick that a frame of the bridge carries, per cent, if it is a MANUAL_CONTROL.
fn lateral_stick(frame: &[u8]) -> Option<i8> {
    let frame = FrameView::parse(frame).ok()?;
    // MAVLink leaves zeros at the end of a payload out.
    let at = |index| frame.payload().get(index).copied().unwrap_or(0);
    let per_mille = i16::from_le_bytes([at(2), at(3)]);
    let is_sticks = frame.header().message_id == MANUAL_CONTROL;
    is_sticks.then(|| i8::try_from(per_mille / 10).ok())?
}

/// Of durations, in us.
struct Percentiles {
    p50: f64,
    p99: f64,
}

impl Percentiles {
    fn of(mut times: Vec<Duration>) -> Percentiles {
        times.sort();
        let micros = |part: f64| {
            let at = (times.len() as f64 * part) as usize;
            times
                .get(at)
                .map_or(f64::NAN, |took| took.as_secs_f64() * 1e6)
        };
        Percentiles {
            p50: micros(0.5),
            p99: micros(0.99),
        }
    }
}

fn stamp() -> TimeStamp {
    TimeStamp::from_unix_ms(wall().as_millis() as u64)
}

const MANUAL_CONTROL: u32 = 69;
const STICK_PERIOD: Duration = Duration::from_millis(20);
/// When control is requested, since when sticks are sent, and when they are to be flown, in periods of a stick.
const REQUESTED_AT: u32 = 250;
const STICKS_FROM: u32 = 300;
const ENGAGED_AT: u32 = 350;
/// From here on they are measured: half a minute.
const MEASURED_FROM: u32 = 500;
const STICKS: u32 = 1_500;
/// The step of the simulation.
const SIMULATED: Duration = Duration::from_millis(10);
/// Message ids, as the status has them.
const HEARTBEAT: &str = "0";
const ATTITUDE: &str = "30";
/// What PX4 v1.18 sends a second on a link of a ground station.
const PX4_RATE: u32 = 370;
/// The argument that makes this program the echo.
const ECHO: &str = "--send-back";
const VSM: &str = env!("CARGO_BIN_EXE_vsm");
const CUCS: Id = Id(0x1b00_00a0);
const VEHICLE: Id = Id(0x1b00_0101);
