//! `vsm run` as a process between real sockets on loopback; its vehicle and its station are this process, in real time.
//!
//! The same [`Wire`] as under the virtual clock stands on either side, so that what is lost, doubled, late, bent and cut
//! really arrives so at the bridge's sockets.

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, UdpSocket};
use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use mavlink_link::frame::MAX_FRAME;
use px4_sim::{Autopilot, Signing, Truth};
use serialport::{SerialPort as _, TTYPort};
use stanag_msgs::Message;
use tempfile::TempDir;

use super::flight::World;
use super::{Faults, Station, Ticket, VSM, cucs, key, vehicle_id, wire::Wire};

/// The bridge, its vehicle and its station.
pub struct Processes {
    pub station: Station,
    pub vehicle: Autopilot<SocketAddr>,
    /// What the bridge is started with in place of `vsm`: a shell that ends in it.
    pub shell: Option<String>,
    /// A flight that takes longer has failed, and says where.
    pub longest: Duration,
    bridge: Option<Child>,
    folder: TempDir,
    began: Instant,
    /// How much faster than time the vehicle flies.
    speed: f64,
    /// How far the vehicle's own time has come.
    flown: Duration,
    dli: Side,
    mav: Side,
}

/// One of the bridge's ends, and what speaks to it.
struct Side {
    wire: Wire,
    end: End,
    own: SocketAddr,
    bridge: SocketAddr,
}

enum End {
    Udp(UdpSocket),
    /// The near end of a serial line, and the far one, held so that the line outlives the bridge.
    Serial(TTYPort, fs::File),
}

impl End {
    /// What has come, if anything has; `None` from another sender than the bridge.
    fn receive(&mut self, bridge: SocketAddr, buffer: &mut [u8]) -> std::io::Result<Option<usize>> {
        match self {
            End::Udp(socket) => {
                let (length, from) = socket.recv_from(buffer)?;
                Ok((from == bridge).then_some(length))
            }
            End::Serial(port, _) => {
                let waiting = port.bytes_to_read().map_err(std::io::Error::from)?;
                if waiting == 0 {
                    return Err(std::io::ErrorKind::WouldBlock.into());
                }
                port.read(buffer).map(Some)
            }
        }
    }

    fn send(&mut self, bridge: SocketAddr, bytes: &[u8]) {
        // What a link has no room for is lost.
        let _ = match self {
            End::Udp(socket) => socket.send_to(bytes, bridge).map(drop),
            End::Serial(port, _) => port.write_all(bytes),
        };
    }
}

impl Side {
    fn new(seed: u64, faults: Faults) -> Side {
        let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        socket.set_nonblocking(true).expect("it need not block");
        let free = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        Side {
            wire: Wire::new(seed, faults),
            own: socket.local_addr().expect("its address"),
            bridge: free.local_addr().expect("its address"),
            end: End::Udp(socket),
        }
    }

    /// A pseudo terminal in place of sockets: the same, and the device for the bridge.
    fn serial(seed: u64, faults: Faults) -> (Side, String) {
        let (mut near, far) = TTYPort::pair().expect("a pseudo terminal");
        near.set_timeout(Duration::from_millis(20))
            .expect("a time-out");
        let device = far.name().expect("the name of a pseudo terminal");
        // A port that is open as one is locked for the bridge.
        let held = fs::File::options().read(true).write(true).open(&device);
        drop(far);
        let side = Side {
            end: End::Serial(near, held.expect("the device")),
            ..Side::new(seed, faults)
        };
        (side, device)
    }

    fn send(&mut self, now: Duration, bytes: &[u8]) {
        self.wire.send(now, self.own, self.bridge, bytes);
    }

    /// Carries what has come through; gives what is for this end.
    fn carry(&mut self, now: Duration) -> Vec<Vec<u8>> {
        let mut buffer = [0; 2_048];
        loop {
            match self.end.receive(self.bridge, &mut buffer) {
                Ok(Some(length)) => {
                    self.wire
                        .send(now, self.bridge, self.own, &buffer[..length]);
                }
                Ok(None) => {}
                Err(cause) if cause.kind() == std::io::ErrorKind::WouldBlock => break,
                // A bridge that is down makes a socket fail once.
                Err(_) => {}
            }
        }
        let mut arrived = Vec::new();
        while let Some(packet) = self.wire.receive(now) {
            if packet.to == self.bridge {
                self.end.send(packet.to, &packet.bytes);
            } else {
                arrived.push(packet.bytes);
            }
        }
        arrived
    }
}

impl Processes {
    /// Starts them, with these faults on both links.
    pub fn start(seed: u64, faults: Faults, speed: f64) -> Processes {
        let mut processes = Processes::laid_out(seed, faults, speed);
        processes.start_bridge();
        processes
    }

    /// All but the bridge.
    pub fn laid_out(seed: u64, faults: Faults, speed: f64) -> Processes {
        let mav = Side::new(seed ^ 0x03a7_73a0, faults);
        let link = format!("udpin:{}", mav.bridge);
        Processes::with_vehicle(seed, faults, speed, mav, &link)
    }

    /// The vehicle on a serial line.
    pub fn on_a_serial_line(seed: u64, faults: Faults, speed: f64) -> Processes {
        let (mav, device) = Side::serial(seed ^ 0x03a7_73a0, faults);
        let link = format!("serial:{device}:57600");
        let mut processes = Processes::with_vehicle(seed, Faults::NONE, speed, mav, &link);
        processes.start_bridge();
        processes
    }

    fn with_vehicle(seed: u64, faults: Faults, speed: f64, mav: Side, link: &str) -> Processes {
        let dli = Side::new(seed ^ 0x00d1_1d11, faults);
        let folder = tempfile::tempdir().expect("a folder");
        let keys = folder.path().join("uav.key");
        fs::write(&keys, "41".repeat(32)).expect("the key");
        fs::set_permissions(&keys, fs::Permissions::from_mode(0o600)).expect("its mode");
        let text = format!(
            "[dli]\nvsm_id = \"{VSM}\"\nlisten = \"{}\"\n[[cucs]]\nid = \"{}\"\nloi = [2, 3, 4, 5]\n[[vehicle]]\n\
             id = \"{}\"\nlink = \"{link}\"\nsystem_id = 1\nsigning = {{ key_file = \"uav.key\" }}\n[store]\n\
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

    /// A file beside the configuration.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// The bridge's process.
    pub fn bridge_id(&self) -> u32 {
        self.bridge.as_ref().expect("it runs").id()
    }

    /// Starts the bridge, and waits until it serves; what it said where it does not.
    pub fn try_bridge(&mut self) -> Result<(), String> {
        let config = self.path("vsm.toml");
        let mut command = match &self.shell {
            None => {
                let mut command = Command::new(env!("CARGO_BIN_EXE_vsm"));
                command.args(["run", "--config"]).arg(&config);
                command
            }
            Some(shell) => {
                let mut command = Command::new("sh");
                command.args(["-c", shell]);
                command
            }
        };
        let mut child = command
            .stderr(Stdio::piped())
            .stdout(Stdio::null())
            .spawn()
            .expect("the bridge");
        let lines = BufReader::new(child.stderr.take().expect("a pipe")).lines();
        // Its log is read to the end, so that it never waits for who reads it.
        let (sender, log) = mpsc::channel();
        std::thread::spawn(move || {
            for line in lines.map_while(Result::ok) {
                let _ = sender.send(line);
            }
        });
        let mut said = String::new();
        loop {
            match log.recv_timeout(READY) {
                Ok(line) if line.contains("ready") => break,
                Ok(line) => said += &(line + "\n"),
                Err(why) => {
                    if why == RecvTimeoutError::Timeout {
                        child.kill().expect("it was there");
                    }
                    let status = child.wait().expect("its end");
                    return Err(format!("{status}: {said}"));
                }
            }
        }
        self.bridge = Some(child);
        Ok(())
    }

    /// Starts the bridge.
    pub fn start_bridge(&mut self) {
        if let Err(said) = self.try_bridge() {
            panic!("the bridge does not serve: {said}");
        }
    }

    /// Ends it by SIGKILL.
    pub fn stop_bridge(&mut self) {
        if let Some(mut bridge) = self.bridge.take() {
            bridge.kill().expect("it was there");
            bridge.wait().expect("its end");
        }
    }

    fn step(&mut self) {
        std::thread::sleep(BEAT);
        let now = self.began.elapsed();
        let mut frame = [0; MAX_FRAME];
        let due = now.mul_f64(self.speed);
        // After a pause of the whole machine time is lost rather than made up for.
        self.flown = self.flown.max(due.saturating_sub(CATCH_UP));
        while self.flown < due {
            self.flown += PIECE;
            self.vehicle.step(PIECE);
            while let Some(sent) = self.vehicle.poll_transmit(&mut frame) {
                self.mav.send(now, &frame[..sent.len]);
            }
        }
        for bytes in self.station.advance(now, wall()) {
            self.dli.send(now, &bytes);
        }
        for bytes in self.dli.carry(now) {
            self.station.receive(now, &bytes);
        }
        for bytes in self.mav.carry(now) {
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

    fn give(&mut self, mut message: Message) -> Ticket {
        let now = self.began.elapsed();
        self.station.tell(now, wall(), vehicle_id(0), &mut message)
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

impl Drop for Processes {
    fn drop(&mut self) {
        if let Some(bridge) = &mut self.bridge {
            let _ = bridge.kill();
            let _ = bridge.wait();
        }
    }
}

fn wall() -> Duration {
    let wall = SystemTime::now().duration_since(UNIX_EPOCH);
    wall.expect("after 1970")
}

/// Within which a bridge serves.
const READY: Duration = Duration::from_secs(20);
const LONGEST: Duration = Duration::from_secs(280);
const BEAT: Duration = Duration::from_millis(2);
const PIECE: Duration = Duration::from_millis(10);
const CATCH_UP: Duration = Duration::from_millis(500);
