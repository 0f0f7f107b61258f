//! The scripted vehicle: a VSM and its aircraft, played for a CUCS under test.
//!
//! It answers discoveries and requests, reports at 2 Hz, acknowledges, loads routes and declares a configuration. A
//! [`Scenario`] adds what it does to the CUCS: what it denies, loses, damages or delays, and the events that happen.

mod scenario;

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::time::Duration;

use stanag_msgs::Id;

use crate::bench::net::Net;
use crate::wire::dialect::writing::{self, Writer};
use crate::wire::dialect::{self, Role};
use crate::wire::{Direction, Draft, Seen};

use scenario::{Action, After, Event, Upload, Values};
pub use scenario::{Answer, Done, Scenario, ScenarioError, Step};

/// The vehicle's id.
pub const VEHICLE: Id = Id(0x1b00_0101);
/// The VSM's id.
pub const VSM: Id = Id(0x1b00_0001);
/// Where the vehicle is, latitude and longitude in radians and altitude in metres: in the western hemisphere, so that
/// a lost sign shows.
const PLACE: (f64, f64, f64) = (0.679, -1.345, 120.0);
/// LOI 4 and 5: control of the vehicle.
const CONTROL: i64 = 0x0C;
/// Between two rounds of status.
const STATUS_EVERY: Duration = Duration::from_millis(500);
/// CUCS ids that are remembered at most: a CUCS that invents ids must not fill the memory.
const MAX_STATIONS: usize = 64;

/// The vehicle.
#[derive(Debug)]
pub struct Vehicle {
    net: Arc<Net>,
    socket: UdpSocket,
    local: SocketAddr,
    scenario: Scenario,
    stations: BTreeMap<u32, Ground>,
    reports: Vec<Values>,
    /// Which events have happened to which CUCS: kept over a restart, or a restart event would repeat for ever.
    happened: BTreeSet<(u32, usize)>,
    steps: BTreeMap<String, Duration>,
    late: Vec<(Duration, SocketAddr, Vec<u8>)>,
    silent_until: Duration,
    /// Whether another CUCS has control.
    taken: bool,
    radius: f64,
    mode: i64,
    next_status: Duration,
}

/// A CUCS as the vehicle knows it.
#[derive(Clone, Debug)]
struct Ground {
    address: SocketAddr,
    style: u8,
    /// In Edition 2.5: the message types for which it has requested acknowledgements (#1401).
    acknowledged: BTreeSet<u16>,
    granted: i64,
    revoked: bool,
    lost: BTreeMap<u16, u32>,
    refused: BTreeMap<u16, u32>,
    contact: Duration,
    control: Option<Duration>,
    load: Option<Duration>,
    command: Option<Duration>,
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
            reports: scenario.report.clone(),
            scenario,
            stations: BTreeMap::new(),
            happened: BTreeSet::new(),
            steps: BTreeMap::new(),
            late: Vec::new(),
            silent_until: Duration::ZERO,
            taken: false,
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

    /// A step of the operator begins: events may be tied to it.
    pub fn begin_step(&mut self, id: &str) {
        self.steps.insert(id.to_owned(), self.net.now());
    }

    /// Serves until `end` of the run's time, or until the operator stops it.
    pub fn serve(&mut self, end: Duration) {
        let mut buffer = vec![0; 65_536];
        while self.net.now() < end && !self.net.interrupted() {
            if let Ok((length, from)) = self.socket.recv_from(&mut buffer) {
                let bytes = &buffer[..length];
                let recorded = (self.net).record(Direction::Received, 0, self.local, from, bytes);
                for seen in &recorded.originals {
                    self.configure_acknowledgement(seen);
                }
                for seen in recorded.messages {
                    self.take(&seen, from);
                }
            }
            self.happen();
            self.push();
            self.send_late();
        }
    }

    fn silent(&self) -> bool {
        self.net.now() < self.silent_until
    }

    fn send(&mut self, to: Id, ground: &Ground, draft: Draft, damaged: bool) {
        let kind = draft.message_type;
        let draft = draft.raw("Time Stamp", self.net.stamp());
        let mut bytes = if self.net.dialect().is_some() {
            let made = writing::encode(&draft, &writer(to), || self.net.instance());
            let bytes = made.bytes();
            self.net.note_missing(made.missing);
            bytes
        } else {
            draft.encode(VEHICLE, to, 32, if damaged { 1 } else { ground.style })
        };
        // A draft that has no message in Edition 2.5 becomes no bytes: nothing is sent.
        if bytes.is_empty() {
            return;
        }
        if damaged && let Some(last) = bytes.last_mut() {
            *last ^= 0x5A;
        }
        let delay = (self.scenario.delay.iter()).find(|delay| delay.message == kind);
        match delay {
            Some(delay) => {
                let due = self.net.now() + Duration::from_secs_f64(delay.seconds);
                self.late.push((due, ground.address, bytes));
            }
            None => self.send_bytes(ground.address, &bytes),
        }
    }

    fn send_bytes(&self, to: SocketAddr, bytes: &[u8]) {
        if self.silent() {
            return;
        }
        self.net.record(Direction::Sent, 0, self.local, to, bytes);
        let _ = self.socket.send_to(bytes, to);
    }

    fn send_late(&mut self) {
        let now = self.net.now();
        let (due, late) = std::mem::take(&mut self.late)
            .into_iter()
            .partition::<Vec<_>, _>(|(due, _, _)| *due <= now);
        self.late = late;
        for (_, to, bytes) in due {
            self.send_bytes(to, &bytes);
        }
    }

    fn authorised(&self) -> i64 {
        let bit = |&level: &u8| 1 << (i64::from(level) - 2);
        self.scenario.authority.authorised.iter().map(bit).sum()
    }

    fn respond(&mut self, to: Id, ground: &Ground) {
        let draft = Draft::new(2)
            .id("VSM ID", VSM)
            .raw("Access Granted", i64::from(ground.granted != 0))
            .raw("LOI Authorized", self.authorised())
            .raw("LOI Granted", ground.granted)
            .raw("Controlled Station 1-16", 1)
            .raw("Vehicle Type", 21)
            .raw("Vehicle Subtype", 3);
        let damaged = self.scenario.authority.damaged && ground.granted & CONTROL != 0;
        self.send(to, ground, draft, damaged);
    }

    /// #1401: a message type is to be acknowledged from now on.
    fn configure_acknowledgement(&mut self, seen: &Seen) {
        if seen.piece.wrapped.is_none() || seen.kind() != dialect::ACKNOWLEDGE {
            return;
        }
        let kind = seen
            .raw("Message Type")
            .and_then(|kind| u16::try_from(kind).ok());
        if let (Some(ground), Some(kind)) = (self.stations.get_mut(&seen.piece.source.0), kind) {
            ground.acknowledged.insert(kind);
        }
    }

    fn acknowledge(&mut self, to: Id, ground: &Ground, seen: &Seen, steps: &[i64]) {
        if let Some(original) = &seen.original {
            // Edition 2.5 acknowledges only that a message arrived.
            if ground.acknowledged.contains(&original.kind()) && steps.contains(&1) {
                let (stamp, instance) = (self.net.stamp(), self.net.instance());
                let bytes = writing::acknowledgement(original, &writer(to), stamp, instance);
                self.send_bytes(ground.address, &bytes);
            }
            return;
        }
        if !seen.piece.ack() || seen.kind() == 17_000 {
            return;
        }
        for &step in steps {
            let answer = Draft::new(17_000)
                .raw(
                    "Original Message Time Stamp",
                    seen.stamp().unwrap_or_default(),
                )
                .raw("Original Message Type", seen.kind().into())
                .raw("Acknowledgement Type", step);
            self.send(to, ground, answer, false);
        }
    }

    fn take(&mut self, seen: &Seen, from: SocketAddr) {
        let (source, kind) = (seen.piece.source, seen.kind());
        // A message whose checksum is wrong is dropped here as well.
        if !seen.sound()
            || ![VEHICLE, VSM, Id::BROADCAST].contains(&seen.piece.destination)
            || source == Id::BROADCAST
            || self.silent()
        {
            return;
        }
        let now = self.net.now();
        if !self.stations.contains_key(&source.0) && self.stations.len() >= MAX_STATIONS {
            return;
        }
        let mut ground = self.stations.remove(&source.0).unwrap_or(Ground {
            address: from,
            style: seen.piece.style(),
            acknowledged: BTreeSet::new(),
            granted: 0,
            revoked: false,
            lost: BTreeMap::new(),
            refused: BTreeMap::new(),
            contact: now,
            control: None,
            load: None,
            command: None,
        });
        ground.address = from;
        if !lost(&self.scenario.lose, &mut ground.lost, kind) {
            self.answer(source, &mut ground, seen);
        }
        self.stations.insert(source.0, ground);
    }

    fn answer(&mut self, source: Id, ground: &mut Ground, seen: &Seen) {
        let kind = seen.kind();
        let commands = matches!(kind, 2000..=2999 | 13_000..=13_006);
        if commands && ground.granted & CONTROL == 0 {
            self.acknowledge(source, ground, seen, &[3]);
            self.respond(source, ground);
            return;
        }
        if lost(&self.scenario.refuse, &mut ground.refused, kind) {
            self.acknowledge(source, ground, seen, &[3]);
            return;
        }
        // A load that does not end well is acknowledged as received, but never as carried out.
        let unloaded = kind == 13_000 && self.scenario.upload != Upload::Loaded;
        if matches!(kind, 2016 | 2017) {
            ground.command.get_or_insert(self.net.now());
        }
        self.acknowledge(source, ground, seen, if unloaded { &[1] } else { &[1, 2] });
        match kind {
            1 => self.authorise(source, ground, seen),
            2016 => {
                self.mode = seen
                    .raw("Select Flight Path Control Mode")
                    .unwrap_or(self.mode);
            }
            2017 => self.radius = seen.value("Loiter Radius").unwrap_or(self.radius),
            13_000 => self.load(source, ground, seen),
            17_002 => {
                if let Some(report) = self.report(seen.raw("Message Type").unwrap_or_default()) {
                    self.send(source, ground, report, false);
                }
            }
            40_000 if seen.raw("Request Type") != Some(6) => self.configure(source, ground),
            _ => {}
        }
    }

    fn authorise(&mut self, source: Id, ground: &mut Ground, seen: &Seen) {
        let levels = seen.raw("Requested/Handover LOI").unwrap_or_default();
        match seen.raw("Requested/Handover Access").unwrap_or_default() {
            0 if levels != 0 => ground.granted &= !levels,
            1 | 2 if self.taken => ground.granted |= levels & self.authorised() & !CONTROL,
            1 | 2 => ground.granted |= levels & self.authorised(),
            _ => {}
        }
        if ground.granted & CONTROL != 0 {
            ground.control.get_or_insert(self.net.now());
        }
        if ground.granted == 0 {
            // A disconnection also ends what #1401 has configured.
            ground.acknowledged.clear();
        }
        self.respond(source, ground);
    }

    fn load(&mut self, source: Id, ground: &mut Ground, seen: &Seen) {
        let mode = seen.raw("Mission Plan Mode").unwrap_or_default();
        let loads = mode == 2;
        if loads {
            ground.load.get_or_insert(self.net.now());
        }
        let steps: &[(i64, i64)] = match self.scenario.upload {
            Upload::Stuck if loads => &[(0, 50)],
            Upload::Rejected if loads => &[(0, 50), (2, 50)],
            _ => &[(0, 50), (1, 100)],
        };
        for &(status, percent) in steps {
            let report = Draft::new(14_000)
                .text(
                    "Mission ID",
                    seen.text("Mission ID").unwrap_or_default().as_bytes(),
                )
                .raw("Status", status)
                .raw("Percent Complete", percent)
                .raw("Mission Plan Mode", mode);
            self.send(source, ground, report, false);
        }
    }

    fn configure(&mut self, to: Id, ground: &Ground) {
        for values in self.scenario.declare.clone() {
            self.send(to, ground, values.apply(Draft::new(values.message)), false);
        }
        let complete = Draft::new(41_005)
            .id("VSM ID", VSM)
            .raw("Vehicle Type", 21)
            .raw("Vehicle Subtype", 3);
        self.send(to, ground, complete, false);
    }

    fn report(&self, kind: i64) -> Option<Draft> {
        let draft = match kind {
            3 => Draft::new(3)
                .id("VSM ID", VSM)
                .id("Vehicle ID Update", VEHICLE)
                .raw("Vehicle Type", 21)
                .raw("Vehicle Subtype", 3)
                .text("Tail Number", b"SCRIPTED"),
            3001 => Draft::new(3001).raw("Select Flight Path Control Mode", self.mode),
            3002 => Draft::new(3002)
                .set("Commanded Altitude", PLACE.2)
                .raw("Altitude Type", 1),
            3004 => Draft::new(3004)
                .raw("Loiter Type", 1)
                .set("Loiter Radius", self.radius)
                .raw("Loiter Direction", 1),
            4000 => Draft::new(4000)
                .set("Latitude", PLACE.0)
                .set("Longitude", PLACE.1)
                .set("Altitude", PLACE.2)
                .raw("Altitude Type", 1)
                .set("U_Speed", 0.0)
                .set("V_Speed", 0.0)
                .set("W_Speed", 0.0)
                .set("Heading", 1.0),
            4001 => Draft::new(4001).raw("To Waypoint Number", 0),
            _ => return None,
        };
        let values = self
            .reports
            .iter()
            .filter(|values| i64::from(values.message) == kind);
        Some(values.fold(draft, |draft, values| values.apply(draft)))
    }

    /// Sends status to each CUCS that holds anything, or has just lost it.
    fn push(&mut self) {
        let now = self.net.now();
        if now < self.next_status {
            return;
        }
        self.next_status = now + STATUS_EVERY;
        for (id, ground) in self.stations.clone() {
            if ground.granted == 0 && !ground.revoked {
                continue;
            }
            for kind in [3001, 3002, 4000, 4001] {
                if let Some(report) = self.report(kind) {
                    self.send(Id(id), &ground, report, false);
                }
            }
        }
    }

    /// Carries out the events whose time has come.
    fn happen(&mut self) {
        let now = self.net.now();
        for index in 0..self.scenario.event.len() {
            let event = self.scenario.event[index].clone();
            for (id, ground) in self.stations.clone() {
                let since = match event.after {
                    After::Contact => Some(ground.contact),
                    After::Control => ground.control,
                    After::Load => ground.load,
                    After::Command => ground.command,
                    After::Step => event
                        .step
                        .as_ref()
                        .and_then(|id| self.steps.get(id).copied()),
                };
                let due = since.map(|since| since + Duration::from_secs_f64(event.seconds));
                if due.is_some_and(|due| due <= now) && self.happened.insert((id, index)) {
                    self.carry_out(&event, Id(id), &ground);
                }
            }
        }
    }

    fn carry_out(&mut self, event: &Event, to: Id, ground: &Ground) {
        match event.action {
            Action::Send => {
                let mut draft = event.values().apply(Draft::new(event.message));
                draft.ack = event.ack;
                self.send(to, ground, draft, event.damaged);
            }
            Action::Report => self.reports.push(event.values()),
            Action::Datagram => self.send_bytes(ground.address, &event.datagram()),
            Action::Revoke => {
                let mut without = ground.clone();
                (without.granted, without.revoked) = (0, true);
                self.taken = true;
                self.respond(to, &without);
                self.stations.insert(to.0, without);
            }
            Action::Restart | Action::Silence => {
                self.silent_until = self.net.now() + Duration::from_secs_f64(event.lasts_s);
                if event.action == Action::Restart {
                    self.stations.clear();
                    self.late.clear();
                }
            }
        }
    }
}

fn writer(to: Id) -> Writer {
    Writer {
        role: Role::Vehicle,
        source: VEHICLE,
        destination: to,
        vsm: VSM,
        loiter: None,
    }
}

/// Whether this message is one of the first few that the scenario loses.
fn lost(list: &[scenario::Times], counted: &mut BTreeMap<u16, u32>, kind: u16) -> bool {
    let Some(times) = list.iter().find(|times| times.message == kind) else {
        return false;
    };
    let count = counted.entry(kind).or_default();
    *count += 1;
    *count <= times.times
}
