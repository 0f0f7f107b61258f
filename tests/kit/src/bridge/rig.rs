//! The bridge with its vehicles and stations, and the links between them.

use std::collections::{BTreeMap, VecDeque};
use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::frame::MAX_FRAME;
use px4_sim::{Autopilot, Signing, Truth};
use stanag_msgs::Message;
use stanag_msgs::enums::AckType;
use stanag_msgs::guard::MAX_GUARDED;
use vsm::config::{Changes, Config, Report};
use vsm::relay_policy::RelayPolicy;
use vsm::session::web::WebRefusal;
use vsm::session::{
    Boot, Bridge, Destination, HostClocks, LinkEnd, LogEntry, OutFrame, Peer, WebWay,
};

use super::guard::{StationGuard, access_key, guard_key};
use super::orders;
use super::parties::{
    VSM, bridge_dli, bridge_mav, cucs, key, station_address, vehicle_address, vehicle_id,
};
use super::station::{Station, Ticket};
use super::web::WebParty;
use crate::clock::{START, VirtualClock};
use crate::network::{Faults, Network, Packet};
use mavlink_link::signing::SigningKey;
use mavlink_link::store::MemoryDisk;

/// What a rig is made with.
#[derive(Debug, Clone)]
pub struct Setup {
    /// Seed for both links and the vehicles.
    pub seed: u64,
    /// Faults between the stations and the bridge.
    pub dli: Faults,
    /// Faults between the bridge and the vehicles.
    pub mav: Faults,
    /// One for each vehicle.
    pub vehicles: Vec<px4_sim::Config>,
    /// Number of stations; each may have every level of interoperability.
    pub stations: u8,
    /// Whether all vehicles share the link of the first.
    pub one_link: bool,
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
            one_link: false,
            dli_keys: "",
            vehicle_keys: "",
            tables: "",
        }
    }
}

/// The bridge with everything around it.
pub struct Rig {
    /// Virtual time since the start of the test, and the clocks of the bridge.
    pub clock: VirtualClock,
    /// The ground stations.
    pub stations: Vec<Station>,
    /// The guards of the stations that the configuration gives one, by the station's index. Where a test removes one,
    /// its station sends unsealed.
    pub guards: BTreeMap<usize, StationGuard>,
    /// The connections of the stations that are web clients, by the station's index. Where a test removes one, its
    /// station is not connected; a connection that has ended is opened again.
    pub web: BTreeMap<usize, WebParty>,
    /// Number of connections so far.
    web_number: u64,
    /// The file of the access list, where the configuration names one: signed by [`access_key`](super::access_key).
    pub access: String,
    /// The vehicles.
    pub vehicles: Vec<Autopilot<SocketAddr>>,
    /// `None` while the bridge is down.
    pub bridge: Option<Bridge>,
    /// The bridge's disk.
    pub store: MemoryDisk,
    /// The boot of the bridge's computer: with another number its next start follows a restart of the computer.
    pub boot: u64,
    /// How long that computer has slept.
    slept: Duration,
    /// How long the disk takes to synchronise, where it `queues`: a synchronisation writes everything that was queued
    /// meanwhile.
    pub sync: Duration,
    /// When the current synchronisation ends, and up to which change.
    synced_at: Option<(Duration, u64)>,
    /// The network between the stations and the bridge.
    pub dli: Network<SocketAddr, Vec<u8>>,
    /// The network between the bridge and the vehicles.
    pub mav: Network<SocketAddr, Vec<u8>>,
    /// Ids of MAVLink messages that are lost on the way from the vehicles to the bridge.
    pub lost: Vec<u32>,
    /// Ids of MAVLink messages that are lost on the way from the bridge to the vehicles.
    pub lost_to_vehicles: Vec<u32>,
    /// What the bridge logged.
    pub log: Vec<LogEntry>,
    /// What was forwarded to other ground stations (`[[forward]]`), with the index of each.
    pub forwarded: Vec<(usize, OutFrame)>,
    /// The other ground stations accept nothing.
    pub forward_is_stuck: bool,
    /// What was sent to the multicast group, where the configuration has one.
    pub group: Vec<Vec<u8>>,
    /// What the bridge sent to addresses that are not those of `stations`.
    pub others: Vec<(SocketAddr, Vec<u8>)>,
    /// What the bridge sent to each address of the DLI side: (messages, bytes).
    pub sent_to: BTreeMap<SocketAddr, (u64, u64)>,
    /// MAVLink messages that arrived at the vehicles, by their ids.
    pub arrived: BTreeMap<u32, u64>,
    /// The present phase of the flight.
    pub phase: &'static str,
    /// What is restarted once, and when.
    pub restart_at: Option<(Duration, Restart)>,
    /// The phase of that restart.
    pub restarted_in: Option<&'static str>,
    /// When a killed bridge starts again.
    back_at: Option<Duration>,
    /// What waits at the bridge's MAVLink sockets while its process is suspended.
    waiting: Option<VecDeque<Packet<SocketAddr, Vec<u8>>>>,
    /// Time of one step: shorter than anything that is measured.
    pub step: Duration,
    /// What an air-side agent passes by default.
    relayed: RelayPolicy,
    one_link: bool,
    config: Config,
    /// The same configuration as the text of its file.
    pub text: String,
}

/// What is restarted during a flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Restart {
    /// The bridge is killed, and starts again from its store a second later.
    Bridge,
    /// The vehicle restarts: a simulated one on the ground at home.
    Vehicle,
}

impl Rig {
    /// A rig in which everything has just been switched on.
    pub fn new(setup: Setup) -> Rig {
        let text = toml(&setup);
        let mut config = Config::parse(&text, Path::new("/nowhere"))
            .expect("the configuration of the test is good");
        config
            .read_terrain(None)
            .expect("elevation files of the test");
        let vehicles = setup.vehicles.iter().enumerate().map(|(index, vehicle)| {
            let vehicle = px4_sim::Config {
                system_id: index as u8 + 1,
                seed: setup.seed.wrapping_mul(31).wrapping_add(index as u64),
                ..vehicle.clone()
            };
            // A real PX4 starts from the timestamp in its key file, which can be any.
            Autopilot::new(
                vehicle,
                Signing::with_key(key(index), 0),
                vec![Some(bridge_mav(if setup.one_link { 0 } else { index }))],
            )
        });
        let vehicles = vehicles.collect();
        let stations = (0..setup.stations)
            .map(|index| Station::new(cucs(index.into()), station_address(index.into())))
            .collect();
        let mut rig = Rig {
            clock: VirtualClock::default(),
            stations,
            guards: BTreeMap::new(),
            web: BTreeMap::new(),
            web_number: 0,
            access: String::new(),
            vehicles,
            bridge: None,
            store: MemoryDisk::default(),
            boot: 1,
            slept: Duration::ZERO,
            sync: Duration::ZERO,
            synced_at: None,
            dli: Network::new(setup.seed ^ 0x00d1_1d11, setup.dli),
            mav: Network::new(setup.seed ^ 0x03a7_73a0, setup.mav),
            lost: Vec::new(),
            lost_to_vehicles: Vec::new(),
            log: Vec::new(),
            forwarded: Vec::new(),
            forward_is_stuck: false,
            group: Vec::new(),
            others: Vec::new(),
            sent_to: BTreeMap::new(),
            arrived: BTreeMap::new(),
            phase: "",
            restart_at: None,
            restarted_in: None,
            back_at: None,
            waiting: None,
            step: STEP,
            relayed: RelayPolicy::default(),
            one_link: setup.one_link,
            config,
            text,
        };
        rig.start_bridge();
        rig
    }

    /// One vehicle, one station, good links, ready to arm, all rights granted.
    pub fn ready() -> Rig {
        Rig::ready_with(Setup::default())
    }

    /// The same as [`ready`](Self::ready), with another setup.
    pub fn ready_with(setup: Setup) -> Rig {
        let mut rig = Rig::new(setup);
        rig.run(9.0);
        rig.done(orders::request_control());
        rig.run(1.0);
        rig
    }

    /// Restarts the bridge from its store: as after `kill -9`.
    pub fn restart_bridge(&mut self) {
        self.stop_bridge();
        self.start_bridge();
    }

    /// Restarts the bridge from its store, with a configuration that was changed while it was down.
    pub fn restart_with(&mut self, text: &str) {
        self.stop_bridge();
        self.config = Config::parse(text, Path::new("/nowhere")).expect("a configuration");
        text.clone_into(&mut self.text);
        self.start_bridge();
    }

    /// Stops the bridge; what it has not written is lost.
    pub fn stop_bridge(&mut self) {
        self.bridge = None;
        self.store.kill();
        self.synced_at = None;
    }

    /// Lets the bridge stand still for this many seconds, as a stopped process does; what arrives meanwhile is lost.
    pub fn freeze_bridge(&mut self, seconds: f64) {
        let bridge = self.bridge.take();
        self.run(seconds);
        self.bridge = bridge;
    }

    /// Stops the bridge for this many seconds, as SIGSTOP does its process. What vehicles send meanwhile waits at its sockets, up to
    /// what Linux keeps, and is read afterwards, a part in each step. `timers_first`: its timers run before it reads the first part.
    pub fn suspend_bridge(&mut self, seconds: f64, timers_first: bool) {
        self.waiting = Some(VecDeque::new());
        let bridge = self.bridge.take();
        self.run(seconds);
        self.bridge = bridge;
        if timers_first {
            self.step();
        }
        while self.read_waiting() {
            self.step();
        }
        self.waiting = None;
    }

    /// Delivers a part of what waits; returns whether there is more.
    fn read_waiting(&mut self) -> bool {
        let now = self.now();
        let Some(waiting) = &mut self.waiting else {
            return false;
        };
        for packet in waiting.drain(..waiting.len().min(READ_AT_ONCE)) {
            let mut vehicles = 0..self.vehicles.len();
            let index = vehicles.find(|index| bridge_mav(*index) == packet.to);
            if let (Some(index), Some(bridge)) = (index, &mut self.bridge) {
                let (from, store) = (Peer::Udp(packet.from), &mut self.store);
                bridge.handle_vehicle(now, index, from, &packet.payload, store, &mut |_, _| {});
            }
        }
        !waiting.is_empty()
    }

    /// The bridge's computer sleeps: its time since boot counts that, the monotonic time does not.
    pub fn sleep_computer(&mut self, time: Duration) {
        self.slept += time;
        let zero = self.zero();
        if let Some(bridge) = &mut self.bridge {
            bridge.note_zero(zero);
        }
    }

    /// The time since boot at which the process began.
    fn zero(&self) -> Duration {
        self.clock.elapsed() - self.now().mono + self.slept
    }

    /// Starts the bridge.
    pub fn start_bridge(&mut self) {
        self.clock.restart_process();
        let ends = (0..self.vehicles.len())
            .map(|index| LinkEnd {
                key: Some(key(index)),
                peer: None,
            })
            .collect();
        let now = self.now();
        let boot = Boot {
            id: self.boot,
            zero: self.zero(),
        };
        let clocks = HostClocks {
            not_before: START,
            boot: Some(boot),
        };
        let bridge = Bridge::new(&self.config, ends, now, clocks, &mut self.store);
        let mut bridge = bridge.expect("the bridge starts from its store");
        let ends = self.config.forwards().zip(FORWARD_KEYS..);
        let ends = ends.map(|(forward, index)| LinkEnd {
            key: forward.key_file.is_some().then(|| key(index)),
            peer: None,
        });
        bridge
            .serve_forwards(&self.config, ends.collect(), now, START, &mut self.store)
            .expect("the ground stations beside it are served");
        // A new secret at each start, as the shell draws one.
        let mut secret = [7; 32];
        secret[..8].copy_from_slice(&self.clock.elapsed().as_millis().to_le_bytes()[..8]);
        bridge.set_group_secret(secret, now);
        self.bridge = Some(bridge);
        self.give_guard_keys();
        if self.config.access.is_some() {
            let file = Ok(self.access.clone().into_bytes());
            let bridge = self.bridge.as_mut().expect("it runs");
            bridge
                .set_access(&access_key(), file, now, START, &mut self.store)
                .expect("an access list");
        }
    }

    /// Gives the bridge the guard keys, as the shell reads them from files, and each station with a guard its own.
    fn give_guard_keys(&mut self) {
        let guarded = self.config.stations().filter(|one| one.guard.is_some());
        let ids: Vec<_> = guarded.map(|one| (one.id, one.web)).collect();
        let (now, station_now) = (self.now(), self.station_now());
        for (id, _) in ids.iter().filter(|(_, web)| !web) {
            let stations = self.stations.iter();
            if let Some(index) = stations.clone().position(|one| one.id == *id) {
                let guard = || StationGuard::new(*id, station_now);
                self.guards.entry(index).or_insert_with(guard);
            }
        }
        let keys = ids
            .into_iter()
            .map(|(id, _)| (id, vec![(guard_key(id), None)]));
        let bridge = self.bridge.as_mut().expect("it runs");
        let given = bridge.set_guard_keys(keys.collect(), now, START, &mut self.store);
        given.expect("their clocks can be read");
        self.web.clear();
        for index in 0..self.stations.len() {
            let id = self.stations[index].id;
            if self.config.stations().any(|one| one.id == id && one.web) {
                self.connect_web(index, &guard_key(id))
                    .expect("its key is right");
            }
        }
    }

    /// Opens a connection of a station that is a web client, with this key.
    ///
    /// # Errors
    /// It is refused.
    pub fn connect_web(&mut self, index: usize, key: &SigningKey) -> Result<(), WebRefusal> {
        self.web_number += 1;
        let station = &self.stations[index];
        let (place, who) = ((self.web_number, station.address), (station.id, key));
        let now = self.clock.now();
        let bridge = self.bridge.as_mut().expect("it runs");
        let party = WebParty::open(bridge, now, place, who, &mut self.store)?;
        self.web.insert(index, party);
        Ok(())
    }

    /// Delivers a frame on the connection of a station, whoever has written it.
    pub fn deliver_frame(&mut self, index: usize, frame: &str) {
        let now = self.now();
        let bridge = self.bridge.as_mut().expect("it runs");
        if let Some(party) = self.web.get_mut(&index) {
            party.deliver(bridge, now, frame, &mut self.store);
        }
    }

    /// Lets the running bridge read another configuration.
    ///
    /// # Errors
    /// It is refused, with the reason.
    pub fn reload(&mut self, text: &str) -> Result<Report, String> {
        let mut new =
            Config::parse(text, Path::new("/nowhere")).map_err(|fault| fault.to_string())?;
        new.read_terrain(None).map_err(|fault| fault.to_string())?;
        let Changes { config, mut report } = self.config.changes(&new)?;
        let added = config
            .vehicles()
            .filter(|one| self.config.vehicles().all(|old| old.id != one.id));
        let ends = added.map(|vehicle| LinkEnd {
            key: Some(key(usize::from(vehicle.system_id) - 1)),
            peer: None,
        });
        // `[[forward]]`s are known by name: one that was there before keeps its index, a new one is given the next;
        // the index chooses the key.
        let places = |config: &Config| -> Vec<String> {
            config.forwards().map(|one| one.name.clone()).collect()
        };
        let before = places(&self.config);
        let mut next = before.len();
        let forwards = config.forwards().map(|one| {
            if let Some(number) = before.iter().position(|name| *name == one.name) {
                return (number, None);
            }
            next += 1;
            let key = one.key_file.is_some().then(|| key(FORWARD_KEYS + next - 1));
            (next - 1, Some(LinkEnd { key, peer: None }))
        });
        let forwards = forwards.collect();
        let (ends, now) = (ends.collect(), self.now());
        let bridge = self.bridge.as_mut().expect("it runs");
        let prepared = bridge.prepare_forwards(&config, forwards, now, START, &mut self.store);
        let prepared = prepared.map_err(|fault| fault.to_string())?;
        let access = config.access.as_ref();
        let access = access.map(|_| bridge.prepare_access(self.access.as_bytes()));
        let access = match access.transpose() {
            Ok(access) => access.flatten(),
            Err(fault) => {
                bridge.refuse_access(&fault.to_string(), now, &mut self.store);
                return Err(fault.to_string());
            }
        };
        let stored = bridge.store_access(access.as_ref(), &mut self.store);
        stored.expect("it is stored");
        let reloaded = bridge.reload(&config, ends, now, START, &mut self.store);
        reloaded.map_err(|fault| fault.to_string())?;
        bridge.take_forwards(prepared);
        let taken = bridge.take_access(access, now, &mut self.store);
        report.applied.extend(taken);
        (self.config, self.text) = (config, text.to_owned());
        self.give_guard_keys();
        Ok(report)
    }

    /// Lets this many seconds pass.
    pub fn run(&mut self, seconds: f64) {
        let end = self.clock.elapsed() + Duration::from_secs_f64(seconds);
        while self.clock.elapsed() < end {
            self.step();
        }
    }

    /// Lets time pass until `so` is true; returns false after `limit` seconds.
    pub fn until(&mut self, limit: f64, so: impl Fn(&Rig) -> bool) -> bool {
        let end = self.clock.elapsed() + Duration::from_secs_f64(limit);
        while self.clock.elapsed() < end {
            if so(self) {
                return true;
            }
            self.step();
        }
        so(self)
    }

    /// Sends a message of station 0 to vehicle 0, repeated until it is answered.
    pub fn send(&mut self, message: impl Into<Message>) -> Ticket {
        self.send_as(0, 0, message)
    }

    /// Sends a message of a station to a vehicle, repeated until it is answered.
    pub fn send_as(
        &mut self,
        station: usize,
        vehicle: usize,
        message: impl Into<Message>,
    ) -> Ticket {
        let now = self.station_now();
        self.stations[station].send(now, vehicle_id(vehicle), message.into())
    }

    /// Sends a message of station 0 to vehicle 0 once.
    pub fn send_once(&mut self, message: impl Into<Message>) {
        let now = self.station_now();
        self.stations[0].send_once(now, vehicle_id(0), message.into());
    }

    /// Sends a message and waits for its final answer, 90 s at most.
    pub fn carry_out(&mut self, message: impl Into<Message>) -> Option<AckType> {
        let ticket = self.send(message);
        self.end(ticket)
    }

    /// Sends a message and waits until it is carried out.
    ///
    /// # Panics
    /// The final answer is another one, or none comes within 90 s: the text has the answer, and the alerts that
    /// station 0 has received.
    #[track_caller]
    pub fn done(&mut self, message: impl Into<Message>) {
        let end = self.carry_out(message);
        let alerts = self.station().alerts();
        assert_eq!(end, Some(AckType::CarriedOut), "{alerts:?}");
    }

    /// Delivers these bytes to the bridge, from station 0.
    pub fn deliver_from_station(&mut self, bytes: &[u8]) {
        self.deliver_from(self.stations[0].address, bytes);
    }

    /// Delivers these bytes to the bridge, from any address.
    pub fn deliver_from(&mut self, from: SocketAddr, bytes: &[u8]) {
        let now = self.clock.elapsed();
        self.dli.send(now, from, bridge_dli(), bytes.to_vec());
    }

    /// Sends every message of a plan, then waits until each is carried out.
    pub fn send_plan(&mut self, plan: Vec<Message>) {
        let tickets: Vec<_> = plan.into_iter().map(|message| self.send(message)).collect();
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

    /// Launches to this many metres above home, and waits until the vehicle is there.
    pub fn take_off(&mut self, height_m: f64) {
        self.done(orders::launch(height_m));
        assert!(self.until(60.0, |rig| -rig.truth().position.d > height_m - 1.0));
    }

    /// Waits for the final answer to a message, 90 s at most.
    pub fn end(&mut self, ticket: Ticket) -> Option<AckType> {
        self.until(90.0, |rig| rig.station().end(ticket).is_some());
        self.station().end(ticket)
    }

    /// Waits for the final answer to a message of a station, 90 s at most.
    pub fn end_as(&mut self, station: usize, ticket: Ticket) -> Option<AckType> {
        self.until(90.0, |rig| rig.stations[station].end(ticket).is_some());
        self.stations[station].end(ticket)
    }

    /// Station 0.
    pub fn station(&self) -> &Station {
        &self.stations[0]
    }

    /// The true state of vehicle 0, from the simulator.
    pub fn truth(&self) -> Truth {
        self.vehicles[0].vehicle().truth()
    }

    /// Both clocks as the bridge reads them.
    pub fn now(&self) -> Now {
        self.clock.now()
    }

    /// The stations' clocks: they do not restart with the bridge.
    pub fn station_now(&self) -> Now {
        Now {
            mono: self.clock.elapsed(),
            ..self.clock.now()
        }
    }

    fn step(&mut self) {
        // One fixed order, so that a seed gives one history: vehicles and stations send, then what has arrived is
        // delivered, then the bridge's disk and timers run, then what it has to send is sent.
        self.clock.advance(self.step);
        self.restart_what_is_due();
        let (clock, now) = (self.clock.elapsed(), self.now());
        let station_now = self.station_now();
        let mut frame = [0; MAX_FRAME];
        for (index, vehicle) in self.vehicles.iter_mut().enumerate() {
            vehicle.step(self.step);
            while let Some(sent) = vehicle.poll_transmit(&mut frame) {
                let bytes = frame[..sent.len].to_vec();
                self.mav.send(clock, vehicle_address(index), sent.to, bytes);
            }
        }
        for (index, station) in self.stations.iter_mut().enumerate() {
            for bytes in station.advance(station_now) {
                // A web client's frames go to the bridge directly: there is no socket, and no datagram for the
                // network.
                if let (Some(party), Some(bridge)) = (self.web.get_mut(&index), &mut self.bridge) {
                    for frame in party.frames(&bytes) {
                        party.deliver(bridge, now, &frame, &mut self.store);
                    }
                    continue;
                }
                let bytes = match self.guards.get_mut(&index) {
                    Some(guard) => guard.seal(station_now, &bytes),
                    None => bytes,
                };
                self.dli.send(clock, station.address, bridge_dli(), bytes);
            }
        }
        while let Some(packet) = self.dli.receive(clock) {
            if packet.to == bridge_dli() {
                if let Some(bridge) = &mut self.bridge {
                    bridge.handle_dli(now, packet.from, &packet.payload, &mut self.store);
                }
            } else if let Some((index, station)) = self
                .stations
                .iter_mut()
                .enumerate()
                .find(|(_, station)| station.address == packet.to)
            {
                match self.guards.get_mut(&index) {
                    None => station.receive(station_now, &packet.payload),
                    Some(guard) => match guard.open(station_now, &packet.payload) {
                        Ok(inside) => station.receive(station_now, &inside),
                        // The guard answers a datagram about clocks by itself; its station never sees it.
                        Err(Some(lift)) => {
                            let from = station.address;
                            self.dli.send(clock, from, bridge_dli(), lift);
                        }
                        Err(None) => {}
                    },
                }
            } else {
                self.others.push((packet.to, packet.payload));
            }
        }
        while let Some(packet) = self.mav.receive(clock) {
            let to = |address: fn(usize) -> SocketAddr| {
                (0..self.vehicles.len()).find(|index| address(*index) == packet.to)
            };
            if let Some(waiting) = &mut self.waiting
                && to(bridge_mav).is_some()
            {
                if waiting.len() < SOCKET_HOLDS {
                    waiting.push_back(packet);
                }
                continue;
            }
            // The message id of a MAVLink 2 frame.
            let id = packet.payload.get(7..10);
            let id = id.map(|id| u32::from_le_bytes([id[0], id[1], id[2], 0]));
            if let (Some(index), Some(bridge)) = (to(bridge_mav), &mut self.bridge) {
                if id.is_some_and(|id| self.lost.contains(&id)) {
                    continue;
                }
                bridge.handle_vehicle(
                    now,
                    index,
                    Peer::Udp(packet.from),
                    &packet.payload,
                    &mut self.store,
                    &mut |_, _| {},
                );
            } else if let Some(index) = to(vehicle_address) {
                if id.is_some_and(|id| self.lost_to_vehicles.contains(&id)) {
                    continue;
                }
                if let Some(id) = id {
                    *self.arrived.entry(id).or_default() += 1;
                }
                self.vehicles[index].handle_datagram(0, packet.from, &packet.payload);
            }
        }
        let Some(bridge) = &mut self.bridge else {
            return;
        };
        // Everything that is queued by now becomes durable at once, `sync` later.
        if let Some((_, change)) = self.synced_at.take_if(|(at, _)| *at <= clock) {
            self.store.complete(change);
            bridge.handle_durable(now, &mut self.store);
        }
        if self.synced_at.is_none() && self.store.durable < self.store.queued {
            self.synced_at = Some((clock + self.sync, self.store.queued));
        }
        if bridge.poll_timeout(now.mono) <= now.mono {
            bridge.handle_timeout(now, &mut self.store);
        }
        if !bridge.may_send() {
            let nothing = bridge.poll_lift().is_none()
                && bridge.poll_dli().is_none()
                && bridge.poll_vehicle().is_none()
                && bridge.poll_forward().is_none();
            assert!(nothing, "the shell would not be woken to send this");
        }
        while let Some((to, lift)) = bridge.poll_lift() {
            self.dli.send(clock, bridge_dli(), to, lift.into_vec());
        }
        let mut sealed = [0; MAX_GUARDED];
        while let Some(datagram) = bridge.poll_dli() {
            match bridge.web_way(datagram.destination()) {
                WebWay::Datagrams => {}
                WebWay::Nowhere => continue,
                WebWay::Connection(number) => {
                    let parties = self.web.iter_mut();
                    let found = parties.into_iter().find(|(_, one)| one.number == number);
                    if let Some((index, party)) = found {
                        for bytes in party.receive(datagram.bytes()) {
                            self.stations[*index].receive(station_now, &bytes);
                        }
                    }
                    continue;
                }
            }
            let bytes = bridge.sealed(now, &datagram, &mut sealed, &mut self.store);
            let Some(sent) = bytes.map(<[u8]>::to_vec) else {
                continue;
            };
            match datagram.to {
                Destination::Unicast(to) => {
                    let (messages, bytes) = self.sent_to.entry(to).or_default();
                    *messages += 1;
                    *bytes += sent.len() as u64;
                    self.dli.send(clock, bridge_dli(), to, sent);
                }
                Destination::Multicast => {
                    for (index, guard) in &mut self.guards {
                        if let Some(inside) = guard.take_group(station_now, &sent) {
                            self.stations[*index].receive(station_now, &inside);
                        }
                    }
                    self.group.push(sent);
                }
            }
        }
        while let Some((index, frame)) = bridge.poll_vehicle() {
            if let Peer::Udp(to) = frame.to {
                let bytes = frame.bytes().to_vec();
                assert_relayed(&bytes, &self.relayed);
                let port = if self.one_link { 0 } else { index };
                self.mav.send(clock, bridge_mav(port), to, bytes);
            }
        }
        while !self.forward_is_stuck
            && let Some(frame) = bridge.poll_forward()
        {
            self.forwarded.push(frame);
        }
        while let Some(entry) = bridge.poll_log() {
            self.log.push(entry);
        }
    }
}

impl Rig {
    fn restart_what_is_due(&mut self) {
        if let Some((_, what)) = self
            .restart_at
            .take_if(|(at, _)| *at <= self.clock.elapsed())
        {
            self.restarted_in = Some(self.phase);
            match what {
                Restart::Vehicle => self.vehicles[0].restart(),
                Restart::Bridge => {
                    self.stop_bridge();
                    self.back_at = Some(self.clock.elapsed() + Duration::from_secs(1));
                }
            }
        }
        if self
            .back_at
            .take_if(|at| *at <= self.clock.elapsed())
            .is_some()
        {
            self.restart_bridge();
        }
    }
}

/// Whatever a test makes the bridge send, an air-side agent passes it by default, but for what its owner has to list.
fn assert_relayed(frame: &[u8], policy: &RelayPolicy) {
    let byte = |at: usize| frame.get(at).copied().unwrap_or(0);
    // Frames of a `[[forward]]` keep their sender.
    if [byte(5), byte(6)] != OWN {
        return;
    }
    let id = u32::from_le_bytes([byte(7), byte(8), byte(9), 0]);
    let passes = policy.messages.contains(&id) || NOT_RELAYED.contains(&id);
    assert!(passes, "relay_policy.rs: message {id} is not on its list");
    // Zeros at the end of a payload are cut off.
    let payload = |at: u8| {
        if at < byte(1) {
            byte(10 + usize::from(at))
        } else {
            0
        }
    };
    if MISSION_ITEMS.contains(&id) {
        let item = u16::from_le_bytes([payload(30), payload(31)]);
        let passes = policy.lets_fly(item);
        assert!(passes, "relay_policy.rs: item {item} is not on its list");
    }
    if COMMANDS.contains(&id) {
        let command = u16::from_le_bytes([payload(28), payload(29)]);
        let passes = policy.commands.contains(&command) || command == TERMINATION;
        assert!(
            passes,
            "relay_policy.rs: command {command} is not on its list"
        );
    }
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
            bridge_mav(if setup.one_link { 0 } else { index }),
            index + 1,
            setup.vehicle_keys
        );
    }
    text + "[store]\ndir = \"state\"\n" + setup.tables
}

/// The first index of keys for `[[forward]]`s that have one, as `key` takes it.
pub const FORWARD_KEYS: usize = 20;

/// Small datagrams that Linux keeps for a UDP socket by default, about; later ones are dropped.
const SOCKET_HOLDS: usize = 256;
/// Of those, what the bridge reads between two rounds of its timers.
const READ_AT_ONCE: usize = 40;
/// The bridge's MAVLink system and component id.
const OWN: [u8; 2] = [245, 190];
/// FILE_TRANSFER_PROTOCOL, which the owner lists, and KEY_EXCHANGE, which the agent takes itself.
const NOT_RELAYED: [u32; 2] = [110, 229];
/// COMMAND_INT and COMMAND_LONG.
const COMMANDS: [u32; 2] = [75, 76];
/// MISSION_ITEM and MISSION_ITEM_INT.
const MISSION_ITEMS: [u32; 2] = [39, 73];
/// DO_FLIGHTTERMINATION, which the owner lists.
const TERMINATION: u16 = 185;
/// Shorter than anything that most tests measure.
const STEP: Duration = Duration::from_millis(10);
