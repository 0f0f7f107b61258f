//! The bridge between simulated vehicles and ground stations of a few lines, in one process, under a virtual clock.
//!
//! No socket, no thread, no wall clock: the same seed gives the same history. Both links can be as bad as
//! [`Faults`] says; bridge and vehicles can be restarted at any moment; the store can be full.
#![allow(
    dead_code,
    unreachable_pub,
    reason = "each test file uses its own part"
)]

pub mod flight;
pub mod heap;
pub mod orders;
pub mod processes;
pub mod station;
pub mod wire;

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::signing::SigningKey;
use px4_sim::{Autopilot, Signing, Truth};
use stanag_msgs::enums::AckType;
use stanag_msgs::{Id, Message};
use vsm::config::Config;
use vsm::session::{Bridge, Destination, LinkEnd, LogEntry, Peer};

pub use mavlink_link::store::MemoryDisk;
pub use station::{Station, Ticket};
pub use wire::Faults;

/// What a rig is made with.
#[derive(Debug, Clone)]
pub struct Setup {
    pub seed: u64,
    /// Between the stations and the bridge.
    pub dli: Faults,
    /// Between the bridge and the vehicles.
    pub mav: Faults,
    /// One for each vehicle.
    pub vehicles: Vec<px4_sim::Config>,
    pub stations: u8,
    /// Further keys of `[dli]`, as TOML.
    pub dli_keys: &'static str,
    /// Keys of each `[[vehicle]]`, as TOML.
    pub vehicle_keys: &'static str,
    /// Further tables, as TOML.
    pub tables: &'static str,
}

impl Default for Setup {
    fn default() -> Self {
        Setup {
            seed: 1,
            dli: Faults::NONE,
            mav: Faults::NONE,
            vehicles: vec![px4_sim::Config::default()],
            stations: 1,
            dli_keys: "",
            vehicle_keys: "",
            tables: "",
        }
    }
}

/// Everything together.
pub struct Rig {
    /// Virtual time since the start of the test.
    pub clock: Duration,
    /// Added to the bridge's wall clock: the clock stepped.
    pub wall_step: f64,
    pub stations: Vec<Station>,
    pub vehicles: Vec<Autopilot<SocketAddr>>,
    /// `None` while the bridge is down.
    pub bridge: Option<Bridge>,
    pub store: MemoryDisk,
    pub dli: wire::Wire,
    pub mav: wire::Wire,
    pub log: Vec<LogEntry>,
    /// What went to the group, where the configuration has one.
    pub group: Vec<Vec<u8>>,
    /// MAVLink messages that arrived at the vehicles, by their ids.
    pub arrived: BTreeMap<u32, u64>,
    /// What the flight has come to.
    pub phase: &'static str,
    /// Something is restarted once, at this time.
    pub restart_at: Option<(Duration, Restart)>,
    /// In which phase that was.
    pub restarted_in: Option<&'static str>,
    /// When a bridge that was killed comes back.
    back_at: Option<Duration>,
    config: Config,
    started: Duration,
}

/// What is restarted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Restart {
    /// The bridge is killed, and comes back from its store a second later.
    Bridge,
    /// The vehicle starts anew: a simulated one on the ground at home.
    Vehicle,
}

impl Rig {
    pub fn new(setup: Setup) -> Rig {
        let config = Config::parse(&toml(&setup), Path::new("/nowhere"))
            .expect("the configuration of the test is good");
        let vehicles = setup.vehicles.iter().enumerate().map(|(index, vehicle)| {
            let vehicle = px4_sim::Config {
                system_id: index as u8 + 1,
                seed: setup.seed.wrapping_mul(31).wrapping_add(index as u64),
                ..vehicle.clone()
            };
            // A real PX4 starts from whatever stamp its key file holds.
            Autopilot::new(
                vehicle,
                Signing::with_key(key(index), 0),
                vec![Some(bridge_mav(index))],
            )
        });
        let vehicles = vehicles.collect();
        let stations = (0..setup.stations)
            .map(|index| Station::new(cucs(index.into()), station_address(index.into())))
            .collect();
        let mut rig = Rig {
            clock: Duration::ZERO,
            wall_step: 0.0,
            stations,
            vehicles,
            bridge: None,
            store: MemoryDisk::default(),
            dli: wire::Wire::new(setup.seed ^ 0x00d1_1d11, setup.dli),
            mav: wire::Wire::new(setup.seed ^ 0x03a7_73a0, setup.mav),
            log: Vec::new(),
            group: Vec::new(),
            arrived: BTreeMap::new(),
            phase: "",
            restart_at: None,
            restarted_in: None,
            back_at: None,
            config,
            started: Duration::ZERO,
        };
        rig.start_bridge();
        rig
    }

    /// One vehicle, one station, good links, ready to arm, all rights granted.
    pub fn ready() -> Rig {
        Rig::ready_with(Setup::default())
    }

    /// The same with another setup.
    pub fn ready_with(setup: Setup) -> Rig {
        let mut rig = Rig::new(setup);
        rig.run(9.0);
        let end = rig.carry_out(orders::request_control());
        assert_eq!(
            end,
            Some(AckType::CarriedOut),
            "{:?}",
            rig.station().alerts()
        );
        rig.run(1.0);
        rig
    }

    /// Starts the bridge anew from its store: as after `kill -9`.
    pub fn restart_bridge(&mut self) {
        self.stop_bridge();
        self.start_bridge();
    }

    /// The bridge is gone; what it has not written is lost.
    pub fn stop_bridge(&mut self) {
        self.bridge = None;
    }

    /// Starts the bridge.
    pub fn start_bridge(&mut self) {
        self.started = self.clock;
        let ends = (0..self.vehicles.len())
            .map(|index| LinkEnd {
                key: Some(key(index)),
                peer: None,
            })
            .collect();
        let now = self.now();
        let bridge = Bridge::new(&self.config, ends, now, EPOCH, &mut self.store);
        self.bridge = Some(bridge.expect("the bridge starts from its store"));
    }

    /// Lets seconds pass.
    pub fn run(&mut self, seconds: f64) {
        let end = self.clock + Duration::from_secs_f64(seconds);
        while self.clock < end {
            self.step();
        }
    }

    /// Lets time pass until it is so; false after `limit` seconds.
    pub fn until(&mut self, limit: f64, so: impl Fn(&Rig) -> bool) -> bool {
        let end = self.clock + Duration::from_secs_f64(limit);
        while self.clock < end {
            if so(self) {
                return true;
            }
            self.step();
        }
        so(self)
    }

    /// Sends a message of station 0 to vehicle 0 until it is answered.
    pub fn tell(&mut self, message: impl Into<Message>) -> Ticket {
        self.tell_as(0, 0, message)
    }

    /// Sends a message of a station to a vehicle until it is answered.
    pub fn tell_as(
        &mut self,
        station: usize,
        vehicle: usize,
        message: impl Into<Message>,
    ) -> Ticket {
        let (clock, wall) = (self.clock, self.now().wall);
        self.stations[station].tell(clock, wall, vehicle_id(vehicle), &mut message.into())
    }

    /// Sends a message of station 0 to vehicle 0 once.
    pub fn say(&mut self, message: impl Into<Message>) {
        let wall = self.now().wall;
        self.stations[0].say(wall, vehicle_id(0), &mut message.into());
    }

    /// Sends a message and waits for its end, 90 s at most.
    pub fn carry_out(&mut self, message: impl Into<Message>) -> Option<AckType> {
        let ticket = self.tell(message);
        self.end(ticket)
    }

    /// Lets these bytes arrive from station 0.
    pub fn hear_from_station(&mut self, bytes: &[u8]) {
        let (clock, from) = (self.clock, self.stations[0].address);
        self.dli.send(clock, from, bridge_dli(), bytes);
    }

    /// Sends every message of a plan, then waits until each is carried out.
    pub fn send_plan(&mut self, plan: Vec<Message>) {
        let tickets: Vec<_> = plan.into_iter().map(|message| self.tell(message)).collect();
        for ticket in tickets {
            let end = self.end(ticket);
            assert_eq!(
                end,
                Some(AckType::CarriedOut),
                "{:?}",
                self.station().alerts()
            );
        }
    }

    /// Launches to metres above home, and waits until it is there.
    pub fn take_off(&mut self, height_m: f64) {
        let end = self.carry_out(orders::launch(height_m));
        assert_eq!(
            end,
            Some(AckType::CarriedOut),
            "{:?}",
            self.station().alerts()
        );
        assert!(self.until(60.0, |rig| -rig.truth().position.d > height_m - 1.0));
    }

    /// Waits for the end of a message, 90 s at most.
    pub fn end(&mut self, ticket: Ticket) -> Option<AckType> {
        self.until(90.0, |rig| rig.station().end(ticket).is_some());
        self.station().end(ticket)
    }

    /// Waits for the end of a message of a station, 90 s at most.
    pub fn end_as(&mut self, station: usize, ticket: Ticket) -> Option<AckType> {
        self.until(90.0, |rig| rig.stations[station].end(ticket).is_some());
        self.stations[station].end(ticket)
    }

    /// Station 0.
    pub fn station(&self) -> &Station {
        &self.stations[0]
    }

    /// What is really so of vehicle 0.
    pub fn truth(&self) -> Truth {
        self.vehicles[0].vehicle().truth()
    }

    /// Both clocks as the bridge reads them.
    pub fn now(&self) -> Now {
        Now {
            mono: self.clock - self.started,
            wall: Duration::from_secs_f64(
                EPOCH.as_secs_f64() + self.clock.as_secs_f64() + self.wall_step,
            ),
        }
    }

    fn step(&mut self) {
        self.clock += STEP;
        self.restart_what_is_due();
        let (clock, now) = (self.clock, self.now());
        let mut frame = [0; MAX_FRAME];
        for (index, vehicle) in self.vehicles.iter_mut().enumerate() {
            vehicle.step(STEP);
            while let Some(sent) = vehicle.poll_transmit(&mut frame) {
                self.mav
                    .send(clock, vehicle_address(index), sent.to, &frame[..sent.len]);
            }
        }
        for station in &mut self.stations {
            for bytes in station.advance(clock, now.wall) {
                self.dli.send(clock, station.address, bridge_dli(), &bytes);
            }
        }
        while let Some(packet) = self.dli.receive(clock) {
            if packet.to == bridge_dli() {
                if let Some(bridge) = &mut self.bridge {
                    bridge.handle_dli(now, packet.from, &packet.bytes, &mut self.store);
                }
            } else if let Some(station) = self
                .stations
                .iter_mut()
                .find(|station| station.address == packet.to)
            {
                station.receive(clock, &packet.bytes);
            }
        }
        while let Some(packet) = self.mav.receive(clock) {
            let to = |address: fn(usize) -> SocketAddr| {
                (0..self.vehicles.len()).find(|index| address(*index) == packet.to)
            };
            if let (Some(index), Some(bridge)) = (to(bridge_mav), &mut self.bridge) {
                bridge.handle_vehicle(
                    now,
                    index,
                    Peer::Udp(packet.from),
                    &packet.bytes,
                    &mut self.store,
                    &mut |_| {},
                );
            } else if let Some(index) = to(vehicle_address) {
                if let Some([a, b, c]) = packet.bytes.get(7..10) {
                    *self
                        .arrived
                        .entry(u32::from_le_bytes([*a, *b, *c, 0]))
                        .or_default() += 1;
                }
                self.vehicles[index].handle_datagram(0, packet.from, &packet.bytes);
            }
        }
        let Some(bridge) = &mut self.bridge else {
            return;
        };
        if bridge.poll_timeout(now.mono) <= now.mono {
            bridge.handle_timeout(now, &mut self.store);
        }
        while let Some(datagram) = bridge.poll_dli() {
            match datagram.to {
                Destination::Unicast(to) => {
                    self.dli.send(clock, bridge_dli(), to, datagram.bytes());
                }
                Destination::Multicast => self.group.push(datagram.bytes().to_vec()),
            }
        }
        while let Some((index, frame)) = bridge.poll_vehicle() {
            if let Peer::Udp(to) = frame.to {
                self.mav.send(clock, bridge_mav(index), to, frame.bytes());
            }
        }
        while let Some(entry) = bridge.poll_log() {
            self.log.push(entry);
        }
    }
}

impl Rig {
    fn restart_what_is_due(&mut self) {
        if let Some((_, what)) = self.restart_at.take_if(|(at, _)| *at <= self.clock) {
            self.restarted_in = Some(self.phase);
            match what {
                Restart::Vehicle => self.vehicles[0].restart(),
                Restart::Bridge => {
                    self.stop_bridge();
                    self.back_at = Some(self.clock + Duration::from_secs(1));
                }
            }
        }
        if self.back_at.take_if(|at| *at <= self.clock).is_some() {
            self.restart_bridge();
        }
    }
}

/// The id of a vehicle.
pub fn vehicle_id(index: usize) -> Id {
    Id(0x1b00_0101 + index as u32)
}

/// The id of a station.
pub fn cucs(index: usize) -> Id {
    Id(0x1b00_00a0 + index as u32)
}

/// The id of the VSM.
pub const VSM: Id = Id(0x1b00_0001);

pub fn key(index: usize) -> SigningKey {
    SigningKey::new([0x41 + index as u8; 32]).expect("not all zero")
}

fn bridge_dli() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 4_586))
}

pub fn bridge_mav(index: usize) -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 14_550 + index as u16))
}

pub fn vehicle_address(index: usize) -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 18_570 + index as u16))
}

pub fn station_address(index: usize) -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 40_000 + index as u16))
}

fn toml(setup: &Setup) -> String {
    let mut text = format!(
        "[dli]\nvsm_id = \"{VSM}\"\nlisten = \"{}\"\n{}\n",
        bridge_dli(),
        setup.dli_keys
    );
    for index in 0..setup.stations {
        let id = cucs(index.into());
        text += &format!("[[cucs]]\nid = \"{id}\"\nloi = [2, 3, 4, 5]\n");
    }
    for index in 0..setup.vehicles.len() {
        text += &format!(
            "[[vehicle]]\nid = \"{}\"\nlink = \"udpin:{}\"\nsystem_id = {}\n\
             signing = {{ key_file = \"uav.key\" }}\n{}\n",
            vehicle_id(index),
            bridge_mav(index),
            index + 1,
            setup.vehicle_keys
        );
    }
    text + "[store]\ndir = \"state\"\n" + setup.tables
}

/// 2026-01-01: what the wall clock shows at the start of a test.
const EPOCH: Duration = Duration::from_secs(1_767_225_600);
const STEP: Duration = Duration::from_millis(10);
