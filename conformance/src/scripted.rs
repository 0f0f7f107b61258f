//! The scripted vehicle: a VSM and its aircraft, played for a CUCS under test.
//!
//! It answers discoveries and requests, reports at 2 Hz, acknowledges, loads routes and declares a configuration. A
//! [`Scenario`] is what it does to the CUCS besides.

use std::collections::BTreeMap;
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::Id;

use crate::bench::net::Net;
use crate::wire::{Direction, Draft, Seen};

/// The vehicle's id.
pub const VEHICLE: Id = Id(0x1b00_0101);
/// The VSM's id.
pub const VSM: Id = Id(0x1b00_0001);
/// Where the vehicle stands: in the western hemisphere, so that signs count.
const PLACE: (f64, f64, f64) = (0.679, -1.345, 120.0);

/// What the vehicle does to the CUCS.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Scenario {
    /// Grants what is requested; leaves the first 2016 and 2017 without an acknowledgement; asks for one itself.
    Normal,
    /// Denies LOI 4: no command may come.
    Deny,
    /// Grants payload control only.
    Payload,
    /// Takes control away a few seconds after the grant.
    Revoke,
    /// Grants in messages with a wrong checksum only.
    Damaged,
    /// Passes on a handover request.
    Handover,
    /// Sends impossible values.
    Odd,
}

/// The vehicle.
#[derive(Debug)]
pub struct Vehicle {
    net: Arc<Net>,
    socket: UdpSocket,
    local: SocketAddr,
    scenario: Scenario,
    stations: BTreeMap<u32, Ground>,
    radius: f64,
    mode: i64,
    next_status: Duration,
}

/// A CUCS as the vehicle knows it.
#[derive(Clone, Copy, Debug)]
struct Ground {
    address: SocketAddr,
    granted: i64,
    since: Duration,
    style: u8,
    swallowed: [bool; 2],
    alerted: bool,
    revoked: bool,
    asked: bool,
}

impl Vehicle {
    /// A vehicle that listens here.
    ///
    /// # Errors
    /// The address cannot be bound.
    pub fn new(net: &Arc<Net>, listen: SocketAddr, scenario: Scenario) -> io::Result<Self> {
        let socket = UdpSocket::bind(listen)?;
        socket.set_read_timeout(Some(Duration::from_millis(20)))?;
        Ok(Self {
            net: net.clone(),
            local: socket.local_addr()?,
            socket,
            scenario,
            stations: BTreeMap::new(),
            radius: 120.0,
            mode: 12,
            next_status: Duration::ZERO,
        })
    }

    /// Where it listens.
    #[must_use]
    pub fn local(&self) -> SocketAddr {
        self.local
    }

    /// Serves until `end` of the run's time, or until the operator stops it.
    pub fn serve(&mut self, end: Duration) {
        let mut buffer = vec![0; 65_536];
        while self.net.now() < end && !self.net.interrupted() {
            if let Ok((length, from)) = self.socket.recv_from(&mut buffer) {
                let messages =
                    self.net
                        .record(Direction::Received, 0, self.local, from, &buffer[..length]);
                for seen in messages {
                    self.take(&seen, from);
                }
            }
            self.push();
        }
    }

    fn send(&self, to: Id, ground: &Ground, draft: Draft, damaged: bool) {
        let draft = draft.raw("Time Stamp", self.net.stamp());
        let mut bytes = draft.encode(VEHICLE, to, 32, if damaged { 1 } else { ground.style });
        if damaged && let Some(last) = bytes.last_mut() {
            *last ^= 0x5A;
        }
        self.net
            .record(Direction::Sent, 0, self.local, ground.address, &bytes);
        let _ = self.socket.send_to(&bytes, ground.address);
    }

    fn response(&self, to: Id, ground: &Ground) {
        let authorised = match self.scenario {
            Scenario::Deny => 1,
            Scenario::Payload => 3,
            _ => 0x0F,
        };
        let draft = Draft::new(2)
            .id("VSM ID", VSM)
            .raw("Access Granted", i64::from(ground.granted != 0))
            .raw("LOI Authorized", authorised)
            .raw("LOI Granted", ground.granted)
            .raw("Controlled Station 1-16", 1)
            .raw("Vehicle Type", 21)
            .raw("Vehicle Subtype", 3);
        let damaged = self.scenario == Scenario::Damaged && ground.granted & 0x0C != 0;
        self.send(to, ground, draft, damaged);
    }

    fn take(&mut self, seen: &Seen, from: SocketAddr) {
        let (source, kind) = (seen.piece.source, seen.kind());
        // A message whose checksum is wrong is dropped here as well.
        let (value, expected) = seen.piece.checksums();
        if value != expected
            || ![VEHICLE, VSM, Id::BROADCAST].contains(&seen.piece.destination)
            || source == Id::BROADCAST
        {
            return;
        }
        let now = self.net.now();
        let mut ground = self.stations.get(&source.0).copied().unwrap_or(Ground {
            address: from,
            granted: 0,
            since: now,
            style: seen.piece.style(),
            swallowed: [false; 2],
            alerted: false,
            revoked: false,
            asked: false,
        });
        ground.address = from;
        let place = match kind {
            2016 => Some(0),
            2017 => Some(1),
            _ => None,
        };
        // The first of each is lost, once, so that the CUCS has to repeat it.
        if let Some(place) = place.filter(|&place| {
            self.scenario == Scenario::Normal && seen.piece.ack() && !ground.swallowed[place]
        }) {
            ground.swallowed[place] = true;
            self.stations.insert(source.0, ground);
            return;
        }
        if seen.piece.ack() && kind != 17_000 {
            for step in [1, 2] {
                let answer = Draft::new(17_000)
                    .raw(
                        "Original Message Time Stamp",
                        seen.stamp().unwrap_or_default(),
                    )
                    .raw("Original Message Type", kind.into())
                    .raw("Acknowledgement Type", step);
                self.send(source, &ground, answer, false);
            }
        }
        match kind {
            1 => {
                let levels = seen.raw("Requested/Handover LOI").unwrap_or_default();
                let possible = match self.scenario {
                    Scenario::Deny => 1,
                    Scenario::Payload => 3,
                    _ => 0x0F,
                };
                let before = ground.granted;
                match seen.raw("Requested/Handover Access").unwrap_or_default() {
                    0 if levels != 0 => ground.granted &= !levels,
                    1 | 2 if !ground.revoked => ground.granted |= levels & possible,
                    _ => {}
                }
                if before != ground.granted {
                    ground.since = now;
                }
                self.response(source, &ground);
            }
            2016 => {
                self.mode = seen
                    .raw("Select Flight Path Control Mode")
                    .unwrap_or(self.mode)
            }
            2017 => self.radius = seen.value("Loiter Radius").unwrap_or(self.radius),
            13_000 => {
                let mode = seen.raw("Mission Plan Mode").unwrap_or_default();
                let mission = seen.text("Mission ID").unwrap_or_default();
                for (status, percent) in [(0, 50), (1, 100)] {
                    let report = Draft::new(14_000)
                        .text("Mission ID", mission.as_bytes())
                        .raw("Status", status)
                        .raw("Percent Complete", percent)
                        .raw("Mission Plan Mode", mode);
                    self.send(source, &ground, report, false);
                }
            }
            17_002 => {
                if let Some(report) = self.report(seen.raw("Message Type").unwrap_or_default()) {
                    self.send(source, &ground, report, false);
                }
            }
            40_000 if seen.raw("Request Type") != Some(6) => self.configure(source, &ground),
            _ => {}
        }
        self.stations.insert(source.0, ground);
    }

    fn configure(&self, to: Id, ground: &Ground) {
        for mode in [16, 17, 22] {
            let draft = Draft::new(44_003)
                .raw("Reported Message", 2016)
                .raw("Reported Field", 2)
                .raw("Field Available", 1)
                .raw("Reported Enumerated Index", mode)
                .raw("Enumerated Index Enable", -2);
            self.send(to, ground, draft, false);
        }
        let radius = Draft::new(41_001)
            .id("VSM ID", VSM)
            .raw("Requested Message", 2017)
            .raw("Requested Field", 3)
            .raw("Field Supported", 1)
            .set("Default Value", 120.0)
            .set("Max Value", 400.0)
            .set("Min Value", 80.0);
        self.send(to, ground, radius, false);
        let complete = Draft::new(41_005)
            .id("VSM ID", VSM)
            .raw("Vehicle Type", 21)
            .raw("Vehicle Subtype", 3);
        self.send(to, ground, complete, false);
    }

    fn report(&self, kind: i64) -> Option<Draft> {
        let odd = self.scenario == Scenario::Odd;
        Some(match kind {
            3 => Draft::new(3)
                .id("VSM ID", VSM)
                .id("Vehicle ID Update", VEHICLE)
                .raw("Vehicle Type", 21)
                .raw("Vehicle Subtype", 3)
                .text("Tail Number", b"SCRIPTED"),
            3001 => Draft::new(3001).raw(
                "Select Flight Path Control Mode",
                if odd { 250 } else { self.mode },
            ),
            3002 => Draft::new(3002)
                .set("Commanded Altitude", PLACE.2)
                .raw("Altitude Type", 1),
            3004 => Draft::new(3004)
                .raw("Loiter Type", 1)
                .set("Loiter Radius", self.radius)
                .raw("Loiter Direction", 1),
            4000 => Draft::new(4000)
                .set("Latitude", if odd { 3.0 } else { PLACE.0 })
                .set("Longitude", PLACE.1)
                .set("Altitude", PLACE.2)
                .raw("Altitude Type", 1)
                .set("U_Speed", 0.0)
                .set("V_Speed", 0.0)
                .set("W_Speed", 0.0)
                .set("Heading", 1.0),
            4001 => Draft::new(4001).raw("To Waypoint Number", if odd { 60_000 } else { 0 }),
            _ => return None,
        })
    }

    /// What comes by itself: status, and what the scenario does.
    fn push(&mut self) {
        let now = self.net.now();
        if now < self.next_status {
            return;
        }
        self.next_status = now + Duration::from_millis(500);
        let known: Vec<(u32, Ground)> = self
            .stations
            .iter()
            .map(|(id, ground)| (*id, *ground))
            .collect();
        for (id, mut ground) in known {
            let to = Id(id);
            if ground.granted == 0 && !ground.revoked {
                continue;
            }
            for kind in [3001, 3002, 4000, 4001] {
                if let Some(report) = self.report(kind) {
                    self.send(to, &ground, report, false);
                }
            }
            let age = now.saturating_sub(ground.since);
            if !ground.alerted && age > Duration::from_secs(1) {
                ground.alerted = true;
                let alert = Draft::new(16_000)
                    .raw("Priority", 2)
                    .raw("Subsystem ID", 5)
                    .raw("Type", 2)
                    .raw("Alert (Warning) ID", -7)
                    .text("Text", b"SCRIPTED ALERT")
                    .acked();
                self.send(to, &ground, alert, false);
            }
            if self.scenario == Scenario::Revoke
                && ground.granted & 0x0C != 0
                && age > Duration::from_secs(3)
            {
                ground.granted = 0;
                ground.revoked = true;
                self.response(to, &ground);
            }
            if self.scenario == Scenario::Handover
                && !ground.asked
                && ground.granted & 4 != 0
                && age > Duration::from_secs(2)
            {
                ground.asked = true;
                let request = Draft::new(4)
                    .id("VSM ID", VSM)
                    .raw("Requested/Handover LOI", 4)
                    .id("Requesting CUCS ID", Id(0x1b00_00b7));
                self.send(to, &ground, request, false);
            }
            self.stations.insert(id, ground);
        }
    }
}
