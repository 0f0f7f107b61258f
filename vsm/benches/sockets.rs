//! `vsm run` between sockets on loopback: how long a message takes through it, what it costs, and how many a second it
//! takes before one is lost. Prints Markdown tables; `cargo bench -p vsm --bench sockets`.
//!
//! Vehicle to CUCS: a signed HEARTBEAT that changes the mode, until the 3001 that reports it; ten a second, which is what a bridge
//! reports by itself, among so much telemetry that the rate is reached. CUCS to vehicle nothing passes by itself: a command waits
//! for what the vehicle shows. Measured is a 17002 until its answer. With each message that is awaited one goes to a process that does
//! nothing but send it back, before it or after it as it is drawn: what the bridge adds is the difference, the rest is the system's. Then the whole program under telemetry at PX4's rate and far above it, with signing on
//! and off: its share of a core and its memory. Everything is measured in turns of random order ([`kit::measure`]); a figure is
//! the median of the turns.

#![allow(missing_docs, reason = "a bench has no callers")]
#![allow(clippy::print_stdout, reason = "figures are printed")]

#[path = "common/bridge.rs"]
mod bridge;
mod common;
#[path = "common/driver.rs"]
mod driver;
#[path = "common/vehicle.rs"]
mod vehicle;

use std::cell::Cell;
use std::io::{BufRead as _, BufReader};
use std::net::UdpSocket;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use kit::Random;
use kit::measure::{Spread, cpu_time, in_turns, memory_kb, pace, quantile};
use kit::process::KillOnDrop;
use stanag_msgs::messages::GenericInformationRequestMessage;
use stanag_msgs::{Message, TimeStamp, frames};

use bridge::{World, stamp};
use common::socket;
use driver::Frames;

fn main() {
    // `cargo test --benches` asks for nothing to be measured.
    if !std::env::args().any(|argument| argument == "--bench") {
        if std::env::args().any(|argument| argument == ECHO) {
            echo();
        }
        return;
    }
    latencies();
    flood();
    loads();
}

fn latencies() {
    let (path, mut random) = (Path::start(), Random::new());
    let mut subjects = [
        (
            "mode change to 3001, among 100 messages/s",
            100,
            Question::ModeChange,
        ),
        (
            "mode change to 3001, among 1,000 messages/s",
            1_000,
            Question::ModeChange,
        ),
        ("17002 to its answer, 1,000/s", 1_000, Question::Request),
    ];
    let turns = in_turns(TURNS, &mut random, &mut subjects, |(_, rate, question)| {
        path.measure(*rate, *question)
    });
    println!(
        "| through `vsm run` on loopback, us | p50 | p99 | bare echo p50 | p99 | added p50 | p99 | CPU a message | lost |"
    );
    println!("|---|---|---|---|---|---|---|---|---|");
    for ((what, ..), turns) in subjects.iter().zip(&turns) {
        let of = |part: fn(&Turn) -> f64| {
            let values: Vec<f64> = turns.iter().map(part).collect();
            Spread::of(&values)
        };
        let lost: usize = turns.iter().map(|turn| turn.lost).sum();
        let awaited: usize = turns.iter().map(|turn| turn.awaited).sum();
        println!(
            "| {what} | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} | {:.0} | {lost} of {awaited} |",
            of(|turn| turn.through[0]),
            of(|turn| turn.through[1]),
            of(|turn| turn.bare[0]),
            of(|turn| turn.bare[1]),
            of(|turn| turn.through[0] - turn.bare[0]),
            of(|turn| turn.through[1] - turn.bare[1]),
            of(|turn| turn.cpu_us),
        );
    }
    println!();
    let added = turns[1].iter().map(|turn| turn.through[1] - turn.bare[1]);
    let added: Vec<f64> = added.collect();
    println!("{}", Spread::of(&added).figure("added-p99-us"));
}

/// One turn of messages through the bridge.
struct Turn {
    /// p50 and p99, us.
    through: [f64; 2],
    /// The same of the bare echo.
    bare: [f64; 2],
    /// A message.
    cpu_us: f64,
    lost: usize,
    awaited: usize,
}

#[derive(Clone, Copy)]
enum Question {
    /// The vehicle's: a 3001 reports it.
    ModeChange,
    /// The CUCS's: a 17002 for 3001, which answers it.
    Request,
}

/// A bridge, and a process beside it that sends back what it gets.
struct Path {
    world: World,
    echo: Echo,
    asked: Cell<u64>,
}

impl Path {
    fn start() -> Path {
        Path {
            world: World::start(common::vsm(), true, ""),
            echo: Echo::start(),
            asked: Cell::new(0),
        }
    }

    /// Sends at this rate for one turn, and awaits what is to be answered, one at a time.
    fn measure(&self, rate: u32, question: Question) -> Turn {
        let (sent, mut lost) = (rate * LATENCIES_S, 0);
        let awaited_every = match question {
            Question::ModeChange => rate / MODE_CHANGES_HZ,
            Question::Request => 1,
        };
        let (mut through, mut bare, mut random) = (Vec::new(), Vec::new(), Random::new());
        let cpu = cpu_time(self.world.process());
        let mut due = Instant::now();
        for number in 0..sent {
            pace(due, 0, rate);
            due = Instant::now().max(due + Duration::from_secs(1) / rate);
            if !number.is_multiple_of(awaited_every) {
                self.world.report(&self.world.autopilot.attitude());
                continue;
            }
            self.world.discard();
            let echo_first = random.bool();
            if echo_first {
                bare.push(self.echo.measure());
            }
            let begun = Instant::now();
            match question {
                Question::ModeChange => {
                    let mission = (number / awaited_every).is_multiple_of(2);
                    self.world.report(&self.world.autopilot.heartbeat(mission));
                }
                Question::Request => self.request(),
            }
            match self.await_report(begun) {
                Some(took) => through.push(took.as_secs_f64() * 1e6),
                None => lost += 1,
            }
            if !echo_first {
                bare.push(self.echo.measure());
            }
        }
        let cpu = cpu_time(self.world.process()).saturating_sub(cpu);
        let percentiles = |times: &mut [f64]| [0.5, 0.99].map(|part| quantile(times, part));
        Turn {
            through: percentiles(&mut through),
            bare: percentiles(&mut bare),
            cpu_us: cpu.as_secs_f64() * 1e6 / f64::from(sent),
            lost,
            awaited: bare.len(),
        }
    }

    fn request(&self) {
        // A second one of the same stamp would be the first one come again.
        let unix_ms = stamp().unix_ms().max(self.asked.get() + 1);
        self.asked.set(unix_ms);
        self.world
            .send(&Message::from(GenericInformationRequestMessage {
                time_stamp: Some(TimeStamp::from_unix_ms(unix_ms)),
                message_type: Some(3001),
                ..GenericInformationRequestMessage::default()
            }));
    }

    /// How long after `begun` a 3001 arrives, if one does.
    fn await_report(&self, begun: Instant) -> Option<Duration> {
        let mut bytes = [0; 2_048];
        loop {
            let (length, _) = self.world.station.recv_from(&mut bytes).ok()?;
            let took = begun.elapsed();
            let mut found = frames(&bytes[..length]).flatten();
            if found.any(|frame| frame.header.message_type == 3001) {
                return Some(took);
            }
        }
    }
}

struct Echo {
    _process: KillOnDrop,
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
        let printed = process.stdout.take().expect("a pipe");
        let mut printed = BufReader::new(printed);
        printed.read_line(&mut line).expect("its port");
        let socket = socket();
        socket.connect(line.trim()).expect("its address");
        Echo {
            _process: KillOnDrop(process),
            socket,
        }
    }

    /// How long a datagram of the size of a signed HEARTBEAT is under way there and back, us.
    fn measure(&self) -> f64 {
        let begun = Instant::now();
        self.socket.send(&[0; 34]).expect("it is sent");
        self.socket.recv(&mut [0; 64]).expect("it comes back");
        begun.elapsed().as_secs_f64() * 1e6
    }
}

/// Prints its address, then sends back what comes until it is killed.
fn echo() {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    println!("{}", socket.local_addr().expect("its address"));
    let mut bytes = [0; 2_048];
    while let Ok((length, from)) = socket.recv_from(&mut bytes) {
        let _ = socket.send_to(&bytes[..length], from);
    }
}

/// Signed frames at rising rates, a second each, until not all of them were taken.
fn flood() {
    let world = World::start(common::vsm(), true, "");
    let mut held = 0;
    let ended = RATES.into_iter().find_map(|rate| {
        let frames = Frames::telemetry(&world.autopilot, rate, 1);
        let before = world.taken();
        let took = frames.drive(&world.vehicle, rate).as_secs_f64();
        std::thread::sleep(Duration::from_millis(300));
        world.discard();
        let lost = frames.count().saturating_sub(world.taken() - before);
        let driven = f64::from(rate) / took;
        if lost == 0 {
            held = driven as u32;
        }
        (lost > 0).then(|| format!("at {driven:.0} it loses {lost} of {rate}"))
    });
    let ended = ended.unwrap_or_else(|| "the driver is no faster".to_owned());
    println!("| signed frames a second, before one is lost | and above |");
    println!("|---|---|");
    println!("| {held} | {ended} |");
    println!();
}

/// Telemetry at PX4's rate and far above it, and what it costs: processor time, and memory at the end.
fn loads() {
    println!(
        "| `vsm run` under telemetry, one vehicle | of a core, % | CPU a frame, us | memory |"
    );
    println!("|---|---|---|---|");
    let mut random = Random::new();
    for rate in [PX4_RATE, 5_000] {
        let mut worlds = [false, true].map(|signed| World::start(common::vsm(), signed, ""));
        let turns = in_turns(TURNS, &mut random, &mut worlds, |world| load(world, rate));
        for (world, turns) in worlds.iter().zip(turns) {
            let (cpu_s, taken): (Vec<f64>, Vec<u64>) = turns.into_iter().unzip();
            let each = |factor: f64| {
                let values: Vec<f64> = cpu_s.iter().map(|cpu_s| cpu_s * factor).collect();
                Spread::of(&values)
            };
            println!(
                "| {rate} frames/s, signing {}, {} of {} taken | {:.1} | {:.1} | {:.1} MB |",
                if world.autopilot.signed { "on" } else { "off" },
                taken.iter().sum::<u64>(),
                TURNS as u64 * u64::from(rate * TURN_S),
                each(100.0 / f64::from(TURN_S)),
                each(1e6 / f64::from(rate * TURN_S)),
                memory_kb(world.process()) / 1_000.0,
            );
        }
    }
}

/// Processor time of one turn, s, and how many frames were taken.
fn load(world: &World, rate: u32) -> (f64, u64) {
    let frames = Frames::telemetry(&world.autopilot, rate, TURN_S);
    // The status is served by the bridge: that is not of the load.
    let before = world.taken();
    let cpu = cpu_time(world.process());
    frames.drive(&world.vehicle, rate);
    std::thread::sleep(Duration::from_millis(100));
    world.discard();
    let cpu = cpu_time(world.process()).saturating_sub(cpu);
    (cpu.as_secs_f64(), world.taken() - before)
}

/// Each kind of message, or load, is measured so often; a load for so many seconds.
const TURNS: usize = 5;
const TURN_S: u32 = 4;
const LATENCIES_S: u32 = 10;
/// A bridge reports as many changes of a vehicle's mode by themselves; of more the scheduled reports have to be enough.
const MODE_CHANGES_HZ: u32 = 10;
const RATES: [u32; 9] = [
    2_000, 5_000, 10_000, 20_000, 40_000, 80_000, 160_000, 320_000, 640_000,
];
/// What PX4 v1.18 sends a second on a link of a ground station.
const PX4_RATE: u32 = 370;
/// The argument that makes this program the echo.
const ECHO: &str = "--send-back";
