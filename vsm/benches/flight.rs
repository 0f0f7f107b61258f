//! What a pilot waits for, with a simulated PX4 behind `vsm run`: how long a stick takes through it at 50 Hz, and a route of 500
//! waypoints, beside pymavlink, which uploads them to another such vehicle and reads them back. Prints Markdown tables; `cargo bench
//! -p vsm --bench flight`.
//!
//! The stick's time is from the 2010 that leaves the CUCS until its MANUAL_CONTROL is at the vehicle's socket, where a relay in
//! this process looks at the frames. Of the route there are three times: all of it, from the first of the 500 messages of the CUCS until
//! 14000 reports the route as loaded; of it, what follows 13000; and of that what is alike on both sides, from the MISSION_COUNT of the
//! upload to the MISSION_ACK for the last item that was read back, by the same relay. pymavlink's vehicle has such a relay before it
//! too. Everything is signed.

#![allow(missing_docs, reason = "a bench has no callers")]
#![allow(clippy::print_stdout, reason = "figures are printed")]

mod common;

use std::fs;
use std::net::{SocketAddr, UdpSocket};
use std::process::Command;
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use cucs::{Route, Station, Waypoint};
use kit::Random;
use kit::clock::wall;
use kit::measure::{Spread, in_turns, pace, quantile};
use kit::process::{Running, hex, write_key};
use mavlink_link::dialect::{MavMessage, MavMissionType};
use mavlink_link::frame::FrameView;
use mavlink_link::signing::{SigningKey, Stamp};
use px4_sim::{LinkAddress, Mode, Simulator, SimulatorConfig};
use stanag_msgs::enums::{AltitudeType, FlightPathControlMode, LoiBitmap, RequestedAccess};
use stanag_msgs::messages::{UaStickCommand, VehicleOperatingModeCommand};
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, TimeStamp};
use tokio::runtime::{Builder, Runtime};

use common::{free, socket};

fn main() {
    // `cargo test --benches` asks for nothing to be measured.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    let mut world = World::start();
    waypoints(&mut world);
    sticks(&mut world);
}

/// The bridge, its vehicle behind a relay, and its CUCS.
struct World {
    station: Station,
    vehicle: Simulator,
    relay: Relay,
    dli: SocketAddr,
    foreground: Runtime,
    /// Runs the simulators.
    background: Runtime,
    _vsm: Running,
    _folder: tempfile::TempDir,
}

impl World {
    fn start() -> World {
        let folder = tempfile::tempdir().expect("a folder");
        let (dli, mavlink) = (free(), free());
        write_key(&folder.path().join("uav.key"), &KEY);
        let config = folder.path().join("vsm.toml");
        let text = format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"{dli}\"\nlease_s = 3600\n\
             [[cucs]]\nid = \"{CUCS}\"\nloi = [2, 4, 5]\naddress = \"127.0.0.1\"\n[[vehicle]]\n\
             id = \"{VEHICLE}\"\nlink = \"udpin:{mavlink}\"\nsystem_id = 1\nsigning = {{ key_file = \"uav.key\" }}\n\
             [store]\ndir = \"state\"\n"
        );
        fs::write(&config, text).expect("the configuration");
        let mut command = Command::new(common::vsm());
        command.args(["run", "--config"]).arg(&config);
        let mut vsm = Running::spawn(&mut command);
        vsm.wait_for("ready", Duration::from_secs(20));
        let relay = Relay::start(mavlink);
        let background = Builder::new_multi_thread()
            .worker_threads(1)
            .enable_all()
            .build()
            .expect("a runtime");
        let vehicle = simulator(&background, relay.air);
        let foreground = Builder::new_current_thread().enable_all().build();
        let foreground = foreground.expect("a runtime");
        let station = foreground.block_on(async {
            let local = "127.0.0.1:0".parse().expect("an address");
            let mut station = Station::bind(CUCS, local, dli).await.expect("a station");
            station.discover().await.expect("the bridge answers");
            let rights = LoiBitmap::LOI4.union(LoiBitmap::LOI5);
            let granted = station.request(VEHICLE, rights, RequestedAccess::Request);
            granted.await.expect("the rights");
            let there = station.wait_until("position of the vehicle", BOOTS_WITHIN, |session| {
                let vehicle = session.vehicle(VEHICLE);
                vehicle.is_some_and(|vehicle| vehicle.position().is_some())
            });
            there.await.expect("the vehicle is there");
            station
        });
        World {
            station,
            vehicle,
            relay,
            dli,
            foreground,
            background,
            _vsm: vsm,
            _folder: folder,
        }
    }
}

fn simulator(runtime: &Runtime, to: SocketAddr) -> Simulator {
    let config = SimulatorConfig {
        key: Some(SigningKey::new(KEY).expect("a key")),
        // pymavlink takes no stream that begins a minute in its past.
        initial_timestamp: Stamp::from_unix(wall()).get(),
        ..SimulatorConfig::on(LinkAddress::UdpOut(to))
    };
    let simulator = runtime.block_on(Simulator::spawn(config));
    simulator.expect("it starts")
}

/// Carries datagrams between the vehicle and the bridge, and notes each MANUAL_CONTROL on its way, and the ends of a transfer.
struct Relay {
    /// Where the vehicle sends to.
    air: SocketAddr,
    /// When a lateral stick of this value arrived.
    sticks: Arc<Mutex<Vec<(i16, Instant)>>>,
    /// When the last MISSION_COUNT and MISSION_ACK of the bridge came, for a mission.
    counted: Arc<Mutex<Option<Instant>>>,
    read_back: Arc<Mutex<Option<Instant>>>,
}

impl Relay {
    fn start(bridge: SocketAddr) -> Relay {
        let (air, ground) = (socket(), socket());
        let at = air.local_addr().expect("its address");
        ground.connect(bridge).expect("the bridge");
        let sticks = Arc::new(Mutex::new(Vec::new()));
        let vehicle = Arc::new(Mutex::new(None));
        let (up, down) = (clone(&air), clone(&ground));
        let known = Arc::clone(&vehicle);
        // Both end with the bench.
        std::thread::spawn(move || {
            let mut bytes = [0; 2_048];
            loop {
                let Ok((length, from)) = air.recv_from(&mut bytes) else {
                    continue;
                };
                *known.lock().expect("no panic") = Some(from);
                // pymavlink may listen later than the vehicle begins to send.
                let _ = ground.send(&bytes[..length]);
            }
        });
        let noted = Arc::clone(&sticks);
        let [counted, read_back] = [(); 2].map(|()| Arc::new(Mutex::new(None)));
        let (counts, ends) = (Arc::clone(&counted), Arc::clone(&read_back));
        std::thread::spawn(move || {
            let mut bytes = [0; 2_048];
            loop {
                let Ok(length) = down.recv(&mut bytes) else {
                    continue;
                };
                let now = Instant::now();
                let message = FrameView::parse(&bytes[..length]).map(|frame| frame.message());
                match message {
                    Ok(Ok(MavMessage::MANUAL_CONTROL(sticks))) => {
                        noted.lock().expect("no panic").push((sticks.y, now));
                    }
                    Ok(Ok(MavMessage::MISSION_COUNT(one))) if one.mission_type == MISSION => {
                        *counts.lock().expect("no panic") = Some(now);
                    }
                    Ok(Ok(MavMessage::MISSION_ACK(one))) if one.mission_type == MISSION => {
                        *ends.lock().expect("no panic") = Some(now);
                    }
                    _ => {}
                }
                if let Some(to) = *vehicle.lock().expect("no panic") {
                    up.send_to(&bytes[..length], to).expect("it is sent");
                }
            }
        });
        Relay {
            air: at,
            sticks,
            counted,
            read_back,
        }
    }

    /// How long the upload of a mission and its read-back took, s.
    fn transferred_s(&self) -> f64 {
        let [begun, ended] =
            [&self.counted, &self.read_back].map(|one| one.lock().expect("no panic").take());
        let took = ended.zip(begun).map(|(ended, begun)| ended - begun);
        took.expect("an upload and its read-back").as_secs_f64()
    }
}

fn clone(socket: &UdpSocket) -> UdpSocket {
    socket.try_clone().expect("a socket")
}

fn waypoints(world: &mut World) {
    // Before the station: it answers nothing while it is not polled.
    let peer = Pymavlink::start(&world.background);
    let mut turn = 0;
    let mut subjects = vec![Uploader::Bridge(world)];
    match peer {
        Ok(peer) => subjects.push(Uploader::Pymavlink(peer)),
        Err(missing) => println!("note: LEFT OUT: pymavlink: {missing}"),
    }
    let times = in_turns(TURNS, &mut Random::new(), &mut subjects, |subject| {
        turn += 1;
        // Each time another altitude: what is aboard already would not be uploaded again.
        subject.upload(30.0 + f64::from(turn))
    });
    let times = |at: usize, part: usize| -> Vec<f64> {
        times
            .get(at)
            .into_iter()
            .flatten()
            .map(|all| all[part])
            .collect()
    };
    let [whole, load, transfer] = [0, 1, 2].map(|part| times(0, part));
    let beside = times(1, 0);
    println!("| {WAYPOINTS} waypoints, signed, s | time | of pymavlink's |");
    println!("|---|---|---|");
    let rows = [
        (
            "from the CUCS through the bridge, until 14000 reports them loaded",
            Some("waypoints-of-pymavlink"),
            &whole,
        ),
        ("of which from 13000 on", None, &load),
        (
            "of which the bridge uploads and reads back",
            Some("waypoints-transfer-of-pymavlink"),
            &transfer,
        ),
    ];
    let mut figures = Vec::new();
    for (what, name, times) in rows {
        let ratio = (!beside.is_empty()).then(|| Spread::of_ratios(times, &beside));
        let shown = ratio.map_or("-".to_owned(), |ratio| format!("{ratio:.2}"));
        println!("| {what} | {:.2} | {shown} |", Spread::of(times));
        figures.extend(ratio.zip(name).map(|(ratio, name)| ratio.figure(name)));
    }
    if !beside.is_empty() {
        println!(
            "| pymavlink uploads and reads back | {:.2} | |",
            Spread::of(&beside)
        );
    }
    println!("\n{}", figures.join("\n"));
}

enum Uploader<'a> {
    Bridge(&'a mut World),
    Pymavlink(Pymavlink),
}

impl Uploader<'_> {
    /// All of it, what follows 13000, and the upload with its read-back; s.
    fn upload(&mut self, altitude_m: f64) -> [f64; 3] {
        match self {
            Uploader::Bridge(world) => {
                let World {
                    station,
                    foreground,
                    relay,
                    ..
                } = &mut **world;
                let [whole, load] = foreground.block_on(upload(station, altitude_m));
                [whole, load, relay.transferred_s()]
            }
            Uploader::Pymavlink(peer) => [peer.upload(altitude_m); 3],
        }
    }
}

async fn upload(station: &mut Station, altitude_m: f64) -> [f64; 2] {
    let route = route(altitude_m);
    let cleared = station.clear(VEHICLE).await.expect("an answer");
    cleared.accepted().expect("it is cleared");
    // Reports that have come meanwhile are not part of it.
    station
        .idle(Duration::from_millis(200))
        .await
        .expect("it listens");
    let begun = Instant::now();
    let messages = route.messages(VEHICLE, CUCS).expect("messages");
    let stored = station.store(VEHICLE, &messages).await.expect("an answer");
    stored.accepted().expect("they are stored");
    let stored = begun.elapsed();
    let load = route.load_command().expect("a command");
    let loaded = station.transfer(VEHICLE, load).await.expect("an answer");
    loaded.accepted().expect("it is loaded");
    let whole = begun.elapsed();
    [whole, whole - stored].map(|time| time.as_secs_f64())
}

/// The same as in `tests/interop/mission_upload.py`.
fn route(altitude_m: f64) -> Route {
    let waypoint = |at: u16| Waypoint {
        number: at + 1,
        latitude_deg: 47.397_743_4 + 9e-5 * f64::from(at),
        longitude_deg: 8.545_593_9,
        altitude_m,
        altitude_type: Some(AltitudeType::Agl),
        next: if at + 1 < WAYPOINTS { at + 2 } else { 0 },
        ..Waypoint::default()
    };
    Route {
        mission_id: Some("BENCH".to_owned()),
        id: Some("BENCH ROUTE".to_owned()),
        waypoints: (0..WAYPOINTS).map(waypoint).collect(),
        ..Route::default()
    }
}

/// pymavlink with a vehicle of its own.
struct Pymavlink {
    running: Running,
    _vehicle: Simulator,
    printed: usize,
}

impl Pymavlink {
    fn start(runtime: &Runtime) -> Result<Pymavlink, String> {
        let python = comparison_benches::python()?;
        let at = free();
        // As far away as that of the bridge.
        let relay = Relay::start(at);
        let vehicle = simulator(runtime, relay.air);
        let script = kit::workspace().join("tests/interop/mission_upload.py");
        let port = at.port().to_string();
        let arguments = [port, hex(&KEY), WAYPOINTS.to_string()];
        let script = script.to_string_lossy().into_owned();
        let mut running = Running::start_shell(&python, [script].into_iter().chain(arguments));
        running.wait_for("ready", BOOTS_WITHIN);
        Ok(Pymavlink {
            running,
            _vehicle: vehicle,
            printed: 0,
        })
    }

    fn upload(&mut self, altitude_m: f64) -> f64 {
        self.running.type_line(&altitude_m.to_string());
        let end = Instant::now() + Duration::from_secs(60);
        loop {
            let output = self.running.output();
            let seconds = output
                .lines()
                .filter_map(|line| line.strip_prefix("seconds "));
            // The last line may not be complete yet.
            let mut seconds = seconds.filter_map(|number| number.parse().ok());
            if output.ends_with('\n')
                && let Some(seconds) = seconds.nth(self.printed)
            {
                self.printed += 1;
                return seconds;
            }
            assert!(Instant::now() < end, "no end of the upload:\n{output}");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

fn sticks(world: &mut World) {
    let World {
        station,
        foreground,
        ..
    } = world;
    foreground.block_on(async {
        let launched = station.launch(VEHICLE, 20.0, AltitudeType::Agl).await;
        launched
            .expect("an answer")
            .accepted()
            .expect("it launches");
        let holds = station.wait_until("end of the launch", FLIES_WITHIN, |session| {
            let vehicle = session.vehicle(VEHICLE);
            vehicle.is_some_and(|vehicle| vehicle.mode() == Some(FlightPathControlMode::Loiter))
        });
        holds.await.expect("it holds");
    });
    let mut pilot = Pilot::new(world.dli);
    pilot.enter(world);
    let turns = in_turns(TURNS, &mut Random::new(), &mut [()], |()| pilot.turn(world));
    assert_eq!(world.vehicle.truth().mode, Mode::PosCtl, "flown by hand");
    let of = |part: f64| {
        let each = turns[0]
            .iter()
            .map(|(times, _)| quantile(&mut times.clone(), part));
        Spread::of(&each.collect::<Vec<_>>())
    };
    let lost: usize = turns[0].iter().map(|(_, lost)| lost).sum();
    let sent = TURNS * (STICKS_HZ * STICKS_S) as usize;
    println!("| a 2010, to its MANUAL_CONTROL at the vehicle, us | p50 | p99 | lost |");
    println!("|---|---|---|---|");
    println!(
        "| {STICKS_HZ} Hz | {:.0} | {:.0} | {lost} of {sent} |",
        of(0.5),
        of(0.99)
    );
    println!("\n{}", of(0.99).figure("sticks-p99-us"));
}

/// The same CUCS from a socket of its own, which is not shared with what the [`Station`] does meanwhile.
struct Pilot {
    socket: UdpSocket,
    stamp_ms: u64,
    number: u32,
}

impl Pilot {
    fn new(dli: SocketAddr) -> Pilot {
        let socket = socket();
        socket.connect(dli).expect("the bridge");
        socket.set_nonblocking(true).expect("a socket");
        Pilot {
            socket,
            stamp_ms: 0,
            number: 0,
        }
    }

    /// PX4 enters the mode once sticks come.
    fn enter(&mut self, world: &World) {
        let begun = Instant::now();
        for number in 0.. {
            pace(begun, number, STICKS_HZ);
            self.stick();
            if number == STICKS_HZ {
                let stamp = self.stamp();
                self.send(&Message::from(VehicleOperatingModeCommand {
                    time_stamp: Some(stamp),
                    select_flight_path_control_mode: Some(FlightPathControlMode::FlightDirector),
                    ..VehicleOperatingModeCommand::default()
                }));
            }
            if number > 2 * STICKS_HZ && world.vehicle.truth().mode == Mode::PosCtl {
                return;
            }
            assert!(begun.elapsed() < FLIES_WITHIN, "manual mode is not entered");
        }
    }

    /// How long each stick took, us, and how many did not arrive.
    fn turn(&mut self, world: &World) -> (Vec<f64>, usize) {
        world.relay.sticks.lock().expect("no panic").clear();
        let begun = Instant::now();
        let sent: Vec<_> = (0..STICKS_HZ * STICKS_S)
            .map(|number| {
                pace(begun, number, STICKS_HZ);
                self.stick()
            })
            .collect();
        std::thread::sleep(Duration::from_millis(20));
        let arrived = world.relay.sticks.lock().expect("no panic");
        let took = |(stick, at): &(i16, Instant)| {
            // The bridge repeats the last one: the first of this value counts. It comes again after 420 ms.
            let after = |(_, when): &&(i16, Instant)| when > at && *when < *at + STALE;
            let mut of_this = arrived.iter().filter(|(value, _)| value == stick);
            let (_, when) = of_this.find(after)?;
            Some((*when - *at).as_secs_f64() * 1e6)
        };
        let times: Vec<f64> = sent.iter().filter_map(took).collect();
        let lost = sent.len() - times.len();
        (times, lost)
    }

    /// Sends a 2010; what its MANUAL_CONTROL has for it, and when it was sent. The values cancel out: the vehicle stays about
    /// where it is.
    fn stick(&mut self) -> (i16, Instant) {
        self.number += 1;
        let lateral = (self.number % 21) as i8 - 10;
        let stamp = self.stamp();
        let message = Message::from(UaStickCommand {
            time_stamp: Some(stamp),
            lateral_stick: Some(lateral),
            longitudinal_stick: Some(0),
            rotational_stick_rudder: Some(0),
            throttle_stick_engine_1: Some(50),
            ..UaStickCommand::default()
        });
        let now = Instant::now();
        self.send(&message);
        (i16::from(lateral) * 10, now)
    }

    fn send(&self, message: &Message) {
        let mut out = [0; MAX_DATAGRAM];
        let envelope = Envelope::new(CUCS, VEHICLE);
        let length = message.encode(&envelope, &mut out).expect("it fits");
        self.socket.send(&out[..length]).expect("it is sent");
        // Reports are the station's matter.
        while self.socket.recv(&mut [0; 2_048]).is_ok() {}
    }

    /// They rise strictly.
    fn stamp(&mut self) -> TimeStamp {
        self.stamp_ms = (wall().as_millis() as u64).max(self.stamp_ms + 1);
        TimeStamp::from_unix_ms(self.stamp_ms)
    }
}

const MISSION: MavMissionType = MavMissionType::MAV_MISSION_TYPE_MISSION;
const TURNS: usize = 5;
const WAYPOINTS: u16 = 500;
const STICKS_HZ: u32 = 50;
const STICKS_S: u32 = 10;
/// Nothing of a stick is awaited for longer.
const STALE: Duration = Duration::from_millis(200);
/// A PX4 takes some ten seconds.
const BOOTS_WITHIN: Duration = Duration::from_secs(40);
const FLIES_WITHIN: Duration = Duration::from_secs(60);
const KEY: [u8; 32] = [0x5a; 32];
const CUCS: Id = Id(0x1b00_00a0);
const VEHICLE: Id = Id(0x1b00_0101);
