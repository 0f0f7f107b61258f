//! `vsm run` as a process between real sockets on the loopback address; its vehicle and its station are this process,
//! in real time.
//!
//! The same [`Network`] as under the virtual clock is on either side, so that packets are lost, duplicated, delayed
//! and damaged at the bridge's real sockets.

use std::fs;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::path::PathBuf;
use std::process::Command;
use std::time::{Duration, Instant};

use mavlink_link::Now;
use mavlink_link::frame::{MAX_FRAME, extent};
use px4_sim::{Autopilot, Signing, Truth};
use stanag_msgs::Message;
use tempfile::TempDir;

use super::flight::World;
use super::parties::{VSM, cucs, key, vehicle_id};
use super::station::{Station, Ticket};
use crate::clock::wall;
use crate::network::{Faults, Network};
use crate::process::{Running, free_udp_port, program, write_key};
use crate::serial::Device;

/// A folder for the files of a bridge, in memory where the system has such a place.
///
/// A right is answered once it is synchronised, by three or four calls in a row. Behind a build one of them has taken 2.9 s on a
/// disk, and a station gives up after 2.5 s: that is no fault of what such a test is about.
pub fn memory_folder() -> TempDir {
    let in_memory = tempfile::tempdir_in("/dev/shm");
    in_memory
        .or_else(|_| tempfile::tempdir())
        .expect("a folder")
}

/// The bridge, its vehicle and its station.
#[derive(Debug)]
pub struct Processes {
    /// The station.
    pub station: Station,
    /// The vehicle.
    pub vehicle: Autopilot<SocketAddr>,
    /// A shell command that is run in place of `vsm`, and ends by starting it.
    pub shell: Option<String>,
    /// A flight that takes longer than this fails, and reports where it was.
    pub longest: Duration,
    bridge: Option<Running>,
    folder: TempDir,
    began: Instant,
    /// How much faster than real time the vehicle flies.
    speed: f64,
    /// How much of the vehicle's own time has passed.
    flown: Duration,
    dli: Side,
    mav: Side,
}

/// One of the bridge's two sides, and the party on it.
#[derive(Debug)]
struct Side {
    network: Network<SocketAddr, Vec<u8>>,
    end: End,
    own: SocketAddr,
    bridge: SocketAddr,
}

#[derive(Debug)]
enum End {
    Udp(UdpSocket),
    /// A device, and what it has brought of a frame that is not there as a whole yet.
    Serial(Device, Vec<u8>),
}

impl Side {
    fn new(seed: u64, faults: Faults) -> Side {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        socket.set_nonblocking(true).expect("it need not block");
        Side {
            network: Network::new(seed, faults),
            own: socket.local_addr().expect("its address"),
            bridge: SocketAddr::from(([127, 0, 0, 1], free_udp_port())),
            end: End::Udp(socket),
        }
    }

    /// A pseudo terminal in place of sockets; also returns its device, for the bridge.
    fn serial(seed: u64, faults: Faults) -> (Side, String) {
        let device = Device::new();
        let name = device.name.clone();
        let side = Side {
            end: End::Serial(device, Vec::new()),
            ..Side::new(seed, faults)
        };
        (side, name)
    }

    fn send(&mut self, now: Duration, bytes: Vec<u8>) {
        self.network.send(now, self.own, self.bridge, bytes);
    }

    /// Carries packets through the network; returns those for this side.
    fn carry(&mut self, now: Duration) -> Vec<Vec<u8>> {
        while let Some(bytes) = self.read() {
            self.network.send(now, self.bridge, self.own, bytes);
        }
        let mut arrived = Vec::new();
        while let Some(packet) = self.network.receive(now) {
            if packet.to != self.bridge {
                arrived.push(packet.payload);
                continue;
            }
            match &mut self.end {
                // A packet for which the socket has no room is lost.
                End::Udp(socket) => drop(socket.send_to(&packet.payload, packet.to)),
                End::Serial(device, _) => device.port.write(&packet.payload),
            }
        }
        arrived
    }

    /// The next datagram or frame that the bridge has sent, if any.
    fn read(&mut self) -> Option<Vec<u8>> {
        let mut buffer = [0; 2_048];
        match &mut self.end {
            End::Udp(socket) => loop {
                match socket.recv_from(&mut buffer) {
                    Ok((length, from)) if from == self.bridge => {
                        return Some(buffer[..length].to_vec());
                    }
                    Err(error) if error.kind() == ErrorKind::WouldBlock => return None,
                    // From another sender; or the bridge is down, which makes a socket fail once.
                    Ok(_) | Err(_) => {}
                }
            },
            End::Serial(device, begun) => {
                let length = device.port.read(&mut buffer);
                begun.extend_from_slice(&buffer[..length]);
                // Between frames there is nothing, but for one that a bridge was killed in.
                let noise = begun.iter().take_while(|byte| !FRAME_STARTS.contains(byte));
                begun.drain(..noise.count());
                let (_, length) = extent(begun)?;
                Some(begun.drain(..length).collect())
            }
        }
    }
}

impl Processes {
    /// Starts all of them, with these faults on both links.
    pub fn start(seed: u64, faults: Faults, speed: f64) -> Processes {
        let mut processes = Processes::laid_out(seed, faults, speed);
        processes.start_bridge();
        processes
    }

    /// Prepares everything but starts no bridge.
    pub fn laid_out(seed: u64, faults: Faults, speed: f64) -> Processes {
        let mav = Side::new(seed ^ 0x03a7_73a0, faults);
        let link = format!("link = \"udpin:{}\"", mav.bridge);
        Processes::with_vehicle(seed, faults, speed, mav, &link)
    }

    /// The same with the vehicle on a serial line.
    pub fn on_a_serial_line(seed: u64, faults: Faults, speed: f64) -> Processes {
        Processes::on_a_device(seed, faults, speed, |device| {
            format!("link = \"serial:{device}:57600\"")
        })
    }

    /// The vehicle on a radio of this many bits a second, both directions together, at its own speed. How fast the line really is,
    /// these faults say, and [`Processes::line_mut`] later.
    pub fn on_a_radio(seed: u64, faults: Faults, rate_bps: u32) -> Processes {
        Processes::on_a_device(seed, faults, 1.0, |device| {
            format!("link = \"serial:{device}:{rate_bps}\"\nrate_bps = {rate_bps}")
        })
    }

    fn on_a_device(
        seed: u64,
        faults: Faults,
        speed: f64,
        link: impl FnOnce(&str) -> String,
    ) -> Processes {
        let (mav, device) = Side::serial(seed ^ 0x03a7_73a0, faults);
        let mut processes = Processes::with_vehicle(seed, Faults::NONE, speed, mav, &link(&device));
        processes.start_bridge();
        processes
    }

    /// Between the bridge and the vehicle.
    pub fn line(&self) -> &Network<SocketAddr, Vec<u8>> {
        &self.mav.network
    }

    /// The same, to make it another one from now on.
    pub fn line_mut(&mut self) -> &mut Network<SocketAddr, Vec<u8>> {
        &mut self.mav.network
    }

    /// The address that [`Processes::line`] has for the bridge.
    pub fn bridge_end(&self) -> SocketAddr {
        self.mav.bridge
    }

    /// `link`: the keys of the vehicle's table that say where it is.
    fn with_vehicle(seed: u64, faults: Faults, speed: f64, mav: Side, link: &str) -> Processes {
        let dli = Side::new(seed ^ 0x00d1_1d11, faults);
        let folder = memory_folder();
        write_key(&folder.path().join("uav.key"), &[0x41; 32]);
        let text = format!(
            "[dli]\nvsm_id = \"{VSM}\"\nlisten = \"{}\"\n[[cucs]]\nid = \"{}\"\nloi = [2, 3, 4, 5]\n[[vehicle]]\n\
             id = \"{}\"\n{link}\nsystem_id = 1\nsigning = {{ key_file = \"uav.key\" }}\n[store]\n\
             dir = \"state\"\n",
            dli.bridge,
            cucs(0),
            vehicle_id(0),
        );
        fs::write(folder.path().join("vsm.toml"), text).expect("the configuration");
        let vehicle = px4_sim::Config {
            seed,
            unix_time_us: wall().as_micros() as u64,
            ..px4_sim::Config::default()
        };
        Processes {
            station: Station::new(cucs(0), dli.own),
            vehicle: Autopilot::new(
                vehicle,
                Signing::with_key(key(0), 0),
                vec![Some(mav.bridge)],
            ),
            shell: None,
            longest: LONGEST,
            bridge: None,
            folder,
            began: Instant::now(),
            speed,
            flown: Duration::ZERO,
            dli,
            mav,
        }
    }

    /// The path of a file beside the configuration.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The bridge's process id.
    pub fn bridge_id(&self) -> u32 {
        self.bridge.as_ref().expect("it runs").id()
    }

    /// Starts the bridge, and waits until it serves.
    ///
    /// # Errors
    ///
    /// It ended, or does not serve within 20 s; with everything that it printed.
    pub fn try_bridge(&mut self) -> Result<(), String> {
        let mut command = match &self.shell {
            None => {
                let mut command = Command::new(program("vsm"));
                command.args(["run", "--config"]).arg(self.path("vsm.toml"));
                command
            }
            Some(shell) => {
                let mut command = Command::new("sh");
                command.args(["-c", shell]);
                command
            }
        };
        let mut bridge = Running::spawn(&mut command);
        bridge.try_wait_for("ready", READY)?;
        self.bridge = Some(bridge);
        Ok(())
    }

    /// Starts the bridge.
    pub fn start_bridge(&mut self) {
        if let Err(why) = self.try_bridge() {
            panic!("the bridge does not serve: {why}");
        }
    }

    /// Kills it by SIGKILL.
    pub fn stop_bridge(&mut self) {
        if let Some(mut bridge) = self.bridge.take() {
            bridge.kill();
        }
    }

    /// The station's clocks.
    fn now(&self) -> Now {
        Now {
            mono: self.began.elapsed(),
            wall: wall(),
        }
    }

    fn step(&mut self) {
        std::thread::sleep(PERIOD);
        let (clock, now) = (self.began.elapsed(), self.now());
        let mut frame = [0; MAX_FRAME];
        let due = clock.mul_f64(self.speed);
        // After a pause of the whole machine the vehicle's lost time is skipped, and not simulated afterwards.
        self.flown = self.flown.max(due.saturating_sub(CATCH_UP));
        while self.flown < due {
            self.flown += STEP;
            self.vehicle.step(STEP);
            while let Some(sent) = self.vehicle.poll_transmit(&mut frame) {
                self.mav.send(clock, frame[..sent.len].to_vec());
            }
        }
        for bytes in self.station.advance(now) {
            self.dli.send(clock, bytes);
        }
        for bytes in self.dli.carry(clock) {
            self.station.receive(now, &bytes);
        }
        for bytes in self.mav.carry(clock) {
            self.vehicle.handle_datagram(0, self.mav.bridge, &bytes);
        }
    }
}

impl World for Processes {
    fn clock(&self) -> Duration {
        self.began.elapsed()
    }

    fn wait(&mut self, limit: f64, so: &dyn Fn(&Processes) -> bool) -> bool {
        let end = Instant::now() + Duration::from_secs_f64(limit);
        let end = end.min(self.began + self.longest);
        while Instant::now() < end {
            if so(self) {
                return true;
            }
            self.step();
        }
        so(self)
    }

    fn give(&mut self, message: Message) -> Ticket {
        let now = self.now();
        self.station.send(now, vehicle_id(0), message)
    }

    fn ground(&self) -> &Station {
        &self.station
    }

    fn ground_mut(&mut self) -> &mut Station {
        &mut self.station
    }

    fn flown(&self) -> Truth {
        self.vehicle.vehicle().truth()
    }

    fn is_over(&self) -> bool {
        self.clock() >= self.longest
    }

    fn kill_bridge(&mut self) {
        self.stop_bridge();
        self.start_bridge();
    }
}

/// The first bytes of MAVLink 2 and 1.
const FRAME_STARTS: [u8; 2] = [0xfd, 0xfe];
/// Time within which a bridge has to serve.
const READY: Duration = Duration::from_secs(20);
/// The default of [`Processes::longest`].
const LONGEST: Duration = Duration::from_secs(280);
/// How often the sockets are read.
const PERIOD: Duration = Duration::from_millis(2);
/// The step of the simulation.
const STEP: Duration = Duration::from_millis(10);
/// After a pause of the whole machine longer than this, the vehicle's lost time is skipped.
const CATCH_UP: Duration = Duration::from_millis(500);
