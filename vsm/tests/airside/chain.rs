//! The whole chain under virtual time: a station, the bridge, an agent and a simulated PX4. Bridge and agent are two
//! computers, each with a disk and a wall clock of its own, and can be restarted. An attacker records the radio; with an
//! encrypted one (`radio`) between the two, what passes is inside its packets.

use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use kit::bridge::{Station, Ticket, VSM, cucs, orders, vehicle_id};
use kit::clock::VirtualClock;
use mavlink_link::Now;
use mavlink_link::frame::MAX_FRAME;
use mavlink_link::link::Endpoint;
use mavlink_link::store::MemoryDisk;
use px4_sim::{Autopilot, Signing};
use stanag_msgs::enums::AckType;
use vsm::airside::{Agent, Side};
use vsm::config::Config;
use vsm::session::{Bridge, Destination, LinkEnd, Peer};

use crate::radio::{AIR_END, EncryptedRadio, GROUND_END};
use crate::world::{Disk, GROUND, PX4, STRANGER, at, key, settings, start};

/// 2026-11-21 07:31 UTC.
const WALL: Duration = Duration::from_secs(1_795_246_260);
const BUILD: Duration = Duration::from_secs(1_793_491_200);
const STEP: Duration = Duration::from_millis(20);
/// The agent, as the bridge reaches it.
const RADIO: u16 = 1004;

pub(crate) struct Chain {
    /// The computers' clocks.
    pub(crate) ground: VirtualClock,
    pub(crate) air: VirtualClock,
    station_clock: VirtualClock,
    pub(crate) bridge: Bridge,
    config: Config,
    store: MemoryDisk,
    pub(crate) agent: Agent,
    disk: Disk,
    pub(crate) px4: Autopilot<Peer>,
    station: Station,
    /// Between bridge and agent, where the link is encrypted.
    encrypted: Option<EncryptedRadio>,
    /// Nothing of the bridge arrives at the agent.
    pub(crate) uplink_cut: bool,
    /// All that the bridge has sent over the radio.
    pub(crate) recorded: Vec<Vec<u8>>,
    pub(crate) log: Vec<String>,
}

impl Chain {
    /// All three have the key; the station holds every right, and the vehicle is on the ground.
    pub(crate) fn ready() -> Chain {
        let mut chain = Chain::with("signing = { key_file = \"uav.key\" }\n", None);
        chain.run(9.0);
        let end = chain.carry_out(orders::request_control(), 20.0);
        assert_eq!(end, Some(AckType::CarriedOut), "{:#?}", chain.log);
        assert_eq!(chain.states(), ("live", "live"), "{:#?}", chain.log);
        chain
    }

    /// `keys`: of the `[[vehicle]]`, beside its id and link.
    pub(crate) fn with(keys: &str, encrypted: Option<EncryptedRadio>) -> Chain {
        let text = format!(
            "[dli]\nvsm_id = \"{VSM}\"\nlisten = \"127.0.0.1:4586\"\n[[cucs]]\nid = \"{}\"\nloi = [2, 3, 4, 5]\n\
             [[vehicle]]\nid = \"{}\"\nlink = \"udpout:127.0.0.1:{RADIO}\"\nsystem_id = 1\n{keys}[store]\ndir = \"state\"\n",
            cucs(0),
            vehicle_id(0),
        );
        let config = Config::parse(&text, Path::new("/nowhere")).unwrap();
        let clock = VirtualClock::starting_at(WALL);
        let mut store = MemoryDisk::default();
        let mut disk = Disk::with(Some(key(5)));
        Chain {
            bridge: bridge(&config, clock.now(), &mut store),
            agent: start(air_settings(), &mut disk, clock.now()),
            ground: clock.clone(),
            air: clock.clone(),
            station_clock: clock,
            config,
            store,
            disk,
            px4: Autopilot::new(
                px4_sim::Config::default(),
                Signing::with_key(key(5), 0),
                vec![Some(at(9))],
            ),
            station: Station::new(cucs(0), STATION),
            encrypted,
            uplink_cut: false,
            recorded: Vec::new(),
            log: Vec::new(),
        }
    }

    pub(crate) fn restart_bridge(&mut self) {
        self.ground.restart_process();
        self.bridge = bridge(&self.config, self.ground.now(), &mut self.store);
    }

    pub(crate) fn restart_agent(&mut self) {
        self.air.restart_process();
        self.agent = start(air_settings(), &mut self.disk, self.air.now());
    }

    pub(crate) fn run(&mut self, seconds: f64) {
        for _ in 0..(seconds / STEP.as_secs_f64()) as usize {
            self.step();
        }
    }

    /// Time since the start of the test.
    pub(crate) fn elapsed(&self) -> Duration {
        self.station_clock.elapsed()
    }

    /// The encrypted radio of a chain that has one.
    pub(crate) fn encrypted(&mut self) -> &mut EncryptedRadio {
        self.encrypted.as_mut().expect("an encrypted radio")
    }

    /// Whether both ends of the encrypted radio receive each other.
    pub(crate) fn is_encrypted(&self) -> bool {
        let now = [self.ground.now().mono, self.air.now().mono];
        let radio = self.encrypted.as_ref();
        radio.is_some_and(|radio| radio.is_up(now))
    }

    /// How the bridge and the agent's radio say that the link stands.
    pub(crate) fn states(&self) -> (&'static str, &'static str) {
        let (ground, air) = self.status();
        let air = match air["radio"]["state"].as_str() {
            Some("live") => "live",
            _ => "not live",
        };
        (ground, air)
    }

    /// Frames of PX4 that the agent has refused as too far ahead.
    pub(crate) fn refused_of_px4(&self) -> u64 {
        let (_, air) = self.status();
        air["px4"]["frames"]["future"].as_u64().unwrap_or(0)
    }

    fn status(&self) -> (&'static str, serde_json::Value) {
        let status = self.bridge.status(String::new(), self.ground.now().mono);
        let air = self.agent.status(String::new(), self.air.now().mono);
        (
            status.vehicles[0].link.state,
            serde_json::to_value(air).unwrap(),
        )
    }

    /// Whether the command is carried out within so many seconds.
    pub(crate) fn carry_out(
        &mut self,
        order: impl Into<stanag_msgs::Message>,
        within_s: f64,
    ) -> Option<AckType> {
        let now = self.station_clock.now();
        let ticket: Ticket = self.station.send(now, vehicle_id(0), order.into());
        for _ in 0..(within_s / STEP.as_secs_f64()) as usize {
            if let Some(end) = self.station.end(ticket) {
                return Some(end);
            }
            self.step();
        }
        self.station.end(ticket)
    }

    /// Plays all that was recorded at the agent, from elsewhere. How many frames reached PX4 by it.
    pub(crate) fn replay(&mut self) -> u64 {
        let before = self.agent.status(String::new(), Duration::ZERO).to_px4;
        for bytes in std::mem::take(&mut self.recorded) {
            self.radio(STRANGER, &bytes);
        }
        self.agent.status(String::new(), Duration::ZERO).to_px4 - before
    }

    fn radio(&mut self, from: u16, bytes: &[u8]) {
        let mut random = |out: &mut [u8]| {
            out.fill(9);
            Ok(())
        };
        let now = self.air.now();
        self.agent
            .handle_radio(now, at(from), bytes, &mut random, &mut self.disk);
    }

    /// Frames of the agent arrive at the bridge.
    fn receive(&mut self, now: Now, frames: &[u8]) {
        let (bridge, store) = (&mut self.bridge, &mut self.store);
        bridge.handle_vehicle(now, 0, at(RADIO), frames, store, &mut |_, _| {});
    }

    fn step(&mut self) {
        for clock in [&mut self.ground, &mut self.air, &mut self.station_clock] {
            clock.advance(STEP);
        }
        let (ground, air) = (self.ground.now(), self.air.now());
        let clock = self.station_clock.elapsed();
        let mut out = [0; MAX_FRAME];
        if let Some(mut radio) = self.encrypted.take() {
            for (end, frames) in radio.step(clock, [ground, air]) {
                if end == AIR_END {
                    self.radio(GROUND, &frames);
                } else {
                    self.receive(ground, &frames);
                }
            }
            self.encrypted = Some(radio);
        }
        self.px4.step(STEP);
        while let Some(sent) = self.px4.poll_transmit(&mut out) {
            self.agent
                .handle_px4(air, at(PX4), &out[..sent.len], &mut self.disk);
        }
        if self.agent.poll_timeout() <= air.mono {
            self.agent.handle_timeout(air, &mut self.disk);
        }
        for bytes in self.station.advance(self.station_clock.now()) {
            self.bridge
                .handle_dli(ground, STATION, &bytes, &mut self.store);
        }
        if self.bridge.poll_timeout(ground.mono) <= ground.mono {
            self.bridge.handle_timeout(ground, &mut self.store);
        }
        // Answers follow at once, and the answers to them with the next step.
        while let Some((_, frame)) = self.bridge.poll_vehicle() {
            if self.uplink_cut {
                continue;
            }
            let bytes = frame.bytes().to_vec();
            match &mut self.encrypted {
                Some(radio) => radio.send(GROUND_END, ground, clock, &bytes),
                None => self.radio(GROUND, &bytes),
            }
            self.recorded.push(bytes);
        }
        while let Some(sent) = self.agent.poll_transmit(air, &mut self.disk, &mut out) {
            let bytes = &out[..sent.len];
            match sent.side {
                Side::Px4 => self.px4.handle_datagram(0, at(9), bytes),
                // What is sent to the attacker does not arrive at the bridge.
                Side::Radio if sent.to == at(GROUND) => match &mut self.encrypted {
                    Some(radio) => radio.send(AIR_END, air, clock, bytes),
                    None => self.receive(ground, bytes),
                },
                Side::Radio => {}
            }
        }
        while let Some(datagram) = self.bridge.poll_dli() {
            if let Destination::Unicast(_) = datagram.to {
                self.station
                    .receive(self.station_clock.now(), datagram.bytes());
            }
        }
        while let Some(entry) = self.bridge.poll_log() {
            self.log.push(format!("bridge: {}", entry.text));
        }
        while let Some(note) = self.agent.poll_note() {
            self.log.push(format!("agent: {}", note.text));
        }
    }
}

fn bridge(config: &Config, now: Now, store: &mut MemoryDisk) -> Bridge {
    let end = LinkEnd {
        key: Some(key(5)),
        peer: Some(at(RADIO)),
    };
    Bridge::new(config, vec![end], now, BUILD, store).unwrap()
}

/// The agent learns where the ground is, as on a radio that it does not configure.
fn air_settings() -> vsm::airside::Settings {
    vsm::airside::Settings {
        radio: Endpoint::Listen,
        ..settings()
    }
}

const STATION: SocketAddr =
    SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 40_000);
