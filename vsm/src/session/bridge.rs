//! The whole bridge as one machine: who a datagram is from, whether it may speak, and to whom it speaks.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::frame::FrameView;
use mavlink_link::link::{Endpoint, Link, LinkConfig, Security};
use mavlink_link::receiver::KeyState;
use mavlink_link::service::Node;
use mavlink_link::signing::Stamp;
use stanag_msgs::enums::{AckType, AlertPriority, LoiBitmap};
use stanag_msgs::table::{self, Direction};
use stanag_msgs::wrapper::{Frame, WrapperError};
use stanag_msgs::{Id, Message, Profile, TimeStamp};

use super::aircraft::Aircraft;
use super::alerts::Alerts;
use super::ceiling::Ceilings;
use super::configuration::Configuration;
use super::counters::{ByType, Counters};
use super::desk::{Desk, Origin};
use super::duplicate::Seen;
use super::link_id;
use super::outbox::{Datagram, Destination, Outbox};
use super::station::Station;
use super::store::{Store, StoreError};
use super::vehicle::{OutFrame, Peer, VehicleLink};
use crate::config::Config;

/// The machine.
#[derive(Debug)]
pub struct Bridge {
    vsm: Id,
    profile: Profile,
    loss: crate::config::Authority,
    provisional: crate::config::Provisional,
    multicast: bool,
    stations: Vec<Station>,
    pub(super) aircraft: Vec<Aircraft>,
    outbox: Outbox,
    /// Of the VSM itself, not of a vehicle.
    alerts: Alerts,
    pub(super) counters: Counters,
    pub(super) received: ByType,
    log: VecDeque<LogEntry>,
    pub(super) started: Duration,
}

/// How much a log entry matters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogLevel {
    /// Said in passing.
    Info,
    /// Something an operator should know.
    Warning,
    /// Something an operator must act on.
    Error,
}

impl LogLevel {
    pub(crate) fn of(priority: AlertPriority) -> LogLevel {
        match priority {
            AlertPriority::Emergency | AlertPriority::Failed => LogLevel::Error,
            AlertPriority::Warning | AlertPriority::Caution => LogLevel::Warning,
            _ => LogLevel::Info,
        }
    }
}

/// A line for the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LogEntry {
    /// How much it matters.
    pub level: LogLevel,
    /// The vehicle, CUCS or VSM that it is about.
    pub about: Id,
    /// What happened.
    pub text: String,
}

/// Sees frames that were believed, for a recording.
pub type Tap<'a> = &'a mut dyn FnMut(&FrameView<'_>);

/// A bridge that cannot start.
#[derive(Debug, thiserror::Error)]
pub enum BridgeError {
    /// What was stored cannot be read.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The signing clock cannot be read.
    #[error("vehicle {vehicle}: {cause}")]
    Clock {
        /// The vehicle.
        vehicle: Id,
        /// Why.
        cause: mavlink_link::clock::StoreError,
    },
}

/// What the shell knows of a vehicle's link: its key, and where to send before the vehicle is heard.
#[derive(Debug)]
pub struct LinkEnd {
    /// The key; `None` where signing is off by configuration.
    pub key: Option<mavlink_link::signing::SigningKey>,
    /// The fixed peer of a udpout or serial link.
    pub peer: Option<Peer>,
}

impl Bridge {
    /// Starts from a configuration, one [`LinkEnd`] for each of its vehicles in order, and what was stored.
    ///
    /// # Errors
    /// A record of the store cannot be read.
    pub fn new(
        config: &Config,
        ends: Vec<LinkEnd>,
        now: Now,
        not_before: Duration,
        store: &mut dyn Store,
    ) -> Result<Bridge, BridgeError> {
        let own = Node::new(config.mavlink.system_id, config.mavlink.component_id);
        let mut bridge = Bridge {
            vsm: config.dli.vsm_id,
            profile: config.dli.disputed.profile.clone(),
            loss: *config.authority.get_ref(),
            provisional: config.dli.provisional,
            multicast: config.dli.multicast.is_some(),
            stations: config.stations().cloned().map(Station::new).collect(),
            aircraft: Vec::new(),
            outbox: Outbox::new(config.dli.disputed.profile.clone()),
            alerts: Alerts::new(i32::try_from(config.vehicles().count()).unwrap_or(i32::MAX / 2)),
            counters: Counters::default(),
            received: ByType::default(),
            log: VecDeque::new(),
            started: now.mono,
        };
        for ((vehicle, end), number) in config.vehicles().zip(ends).zip(0..) {
            let security = if end.key.is_some() {
                Security::Signed
            } else {
                Security::Off
            };
            let endpoint = end.peer.map_or(Endpoint::Listen, Endpoint::Fixed);
            let mut link = LinkConfig::new(vehicle.system_id, security, endpoint);
            link.own_system = own.system;
            link.own_component = own.component;
            link.link_id = vehicle.link_id;
            link.vehicle_link_id = vehicle.vehicle_link_id;
            link.known_link_id = link_id::known(vehicle.id, store)?;
            let key = match end.key {
                None => None,
                Some(key) => {
                    let origin = mavlink_link::clock::Origin::KeyFile;
                    let started = KeyState::start(
                        key,
                        origin,
                        Stamp::from_unix(not_before),
                        now,
                        &mut Ceilings(store),
                    )
                    .map_err(|cause| BridgeError::Clock {
                        vehicle: vehicle.id,
                        cause,
                    })?;
                    Some(started)
                }
            };
            let mav = VehicleLink::new(own, Link::new(link), key);
            let mut aircraft = Aircraft::new(vehicle.clone(), mav, number);
            aircraft.configuration = Configuration::of(config);
            aircraft.kept_link_id = link.known_link_id;
            let (mut desk, _) = bridge.desk(now, store);
            aircraft.restore(&mut desk)?;
            aircraft.announce(&mut desk);
            bridge.aircraft.push(aircraft);
        }
        bridge.restore_commands(now, store)?;
        Ok(bridge)
    }

    /// Takes a datagram of the DLI side.
    pub fn handle_dli(&mut self, now: Now, from: SocketAddr, octets: &[u8], store: &mut dyn Store) {
        for frame in self.profile.frames(octets) {
            match frame {
                Ok(frame) => self.handle_frame(now, from, &frame, store),
                Err(fault) => self.counters.count(drop_name(&fault)),
            }
        }
    }

    fn handle_frame(
        &mut self,
        now: Now,
        from: SocketAddr,
        frame: &Frame<'_>,
        store: &mut dyn Store,
    ) {
        let header = frame.header;
        if header.source == self.vsm
            || self
                .aircraft
                .iter()
                .any(|aircraft| aircraft.id() == header.source)
        {
            // What we sent to the group comes back to us.
            self.counters.count("our own");
            return;
        }
        let Some(index) = self
            .stations
            .iter()
            .position(|station| station.id() == header.source)
        else {
            self.counters.count("unauthorised source");
            return;
        };
        let Some(station) = self.stations.get_mut(index) else {
            return;
        };
        if station
            .config
            .address
            .is_some_and(|address| address != from.ip())
        {
            self.counters.count("unauthorised address");
            return;
        }
        if self
            .aircraft
            .iter()
            .all(|aircraft| aircraft.id() != header.destination)
            && header.destination != self.vsm
            && header.destination != Id::BROADCAST
        {
            self.counters.count("misaddressed");
            return;
        }
        let origin = Origin {
            station: index,
            message_type: header.message_type,
            stamp: stamp_of(frame),
            ack_requested: header.ack_requested && header.message_type != ACKNOWLEDGEMENT,
        };
        let message = match self.profile.decode(header.message_type, frame.data) {
            Ok(message) => message,
            Err(fault) => {
                let known = table::message(header.message_type).is_some();
                self.counters.count(if known {
                    "undecodable"
                } else {
                    "unknown message type"
                });
                let why = fault.to_string();
                return self.refuse(now, &origin, header.destination, why, store);
            }
        };
        if table::message(header.message_type)
            .is_some_and(|info| info.direction == Direction::ToCucs)
        {
            self.counters.count("wrong direction");
            let why = "a VSM sends it, and takes none".to_owned();
            return self.refuse(now, &origin, header.destination, why, store);
        }
        self.received.count(header.message_type.into());
        // From here it is a message of a station that may speak: answers go to where it sends from.
        let station = &mut self.stations[index];
        station.peer = Some(from);
        station.heard = Some(now.mono);
        if let Some(stamp) = origin.stamp {
            let seen = Seen::new(frame, &message, stamp, origin.ack_requested);
            if let Some(answer) = self.stations[index].recent.find(&seen) {
                self.counters.count("duplicate");
                return self.answer_again(now, &origin, frame, &message, answer, store);
            }
            self.stations[index].recent.remember(seen);
            let (mut desk, aircraft) = self.desk(now, store);
            let noted = desk.note_command(index, &seen);
            if let Some(aircraft) = aircraft
                .iter_mut()
                .find(|aircraft| aircraft.id() == header.destination)
            {
                aircraft.say_not_noted(&mut desk, noted);
            }
        }
        self.dispatch(now, origin, header.destination, &message, store);
    }

    fn dispatch(
        &mut self,
        now: Now,
        origin: Origin,
        destination: Id,
        message: &Message,
        store: &mut dyn Store,
    ) {
        match message {
            Message::Heartbeat(_) => {
                // One before any grant is harmless: it does not make later silence count.
                let id = self.stations[origin.station].id();
                let holds = |aircraft: &Aircraft| {
                    aircraft.authority.holders().any(|(holder, _)| holder == id)
                };
                self.stations[origin.station].sends_heartbeats |= self.aircraft.iter().any(holds);
                self.acknowledge(now, &origin, destination, AckType::CarriedOut, store);
            }
            Message::MessageAcknowledgement(_) => {}
            Message::CucsAuthorisationRequest(request) => {
                let (mut desk, aircraft) = self.desk(now, store);
                if destination == Id::BROADCAST && !desk.is_meant(request.vsm_id) {
                    // Who is discovered by name is another.
                    return desk.counters.count("another VSM's");
                }
                let to_all = destination == Id::BROADCAST || destination == desk.vsm;
                let mut answer = AckType::CarriedOut;
                for aircraft in aircraft.iter_mut() {
                    let of_one = if aircraft.id() == destination {
                        aircraft.authorise(&mut desk, &origin, request)
                    } else if to_all {
                        aircraft.authorise_to_all(&mut desk, &origin, request)
                    } else {
                        continue;
                    };
                    if of_one != AckType::CarriedOut {
                        answer = of_one;
                    }
                }
                let vehicle = aircraft
                    .iter()
                    .map(Aircraft::id)
                    .find(|id| *id == destination);
                let source = vehicle.unwrap_or(desk.vsm);
                desk.acknowledge(source, &origin, answer);
            }
            Message::PositiveHandoverAuthorisationRequest(request) => {
                let (mut desk, aircraft) = self.desk(now, store);
                let meant = aircraft.iter_mut().find(|one| one.id() == destination);
                match meant {
                    Some(aircraft) => {
                        let answer = aircraft.hand_over(&mut desk, &origin, request);
                        desk.acknowledge(destination, &origin, answer);
                    }
                    None => desk.refuse(&origin, TO_ONE),
                }
            }
            Message::VehicleDataLinkTransitionCoordination(request) => {
                let (mut desk, aircraft) = self.desk(now, store);
                match aircraft.iter_mut().find(|one| one.id() == destination) {
                    Some(aircraft) => aircraft.coordinate_transition(&mut desk, origin, request),
                    None => desk.refuse(&origin, TO_ONE),
                }
            }
            Message::ScheduleMessageUpdateCommand(command) => {
                self.inform(now, origin, destination, store, |aircraft, desk| {
                    aircraft.schedule(desk, origin.station, command)
                });
            }
            Message::GenericInformationRequestMessage(request) => {
                self.inform(now, origin, destination, store, |aircraft, desk| {
                    aircraft.report_once(desk, origin.station, request)
                });
            }
            Message::FieldConfigurationRequest(request) => {
                let (mut desk, aircraft) = self.desk(now, store);
                for aircraft in aircraft.iter_mut() {
                    let to_all = destination == Id::BROADCAST || destination == desk.vsm;
                    if to_all || aircraft.id() == destination {
                        aircraft.configure(&mut desk, origin, request);
                    }
                }
            }
            command => self.command(now, origin, destination, command, store),
        }
    }

    /// 17001 and 17002: for those that may listen, to one vehicle or all. To all it is carried out where any vehicle does.
    fn inform(
        &mut self,
        now: Now,
        origin: Origin,
        destination: Id,
        store: &mut dyn Store,
        mut ask: impl FnMut(&mut Aircraft, &mut Desk<'_>) -> Result<(), String>,
    ) {
        let asker = self.stations[origin.station].id();
        let (mut desk, aircraft) = self.desk(now, store);
        if let Some(one) = aircraft.iter_mut().find(|one| one.id() == destination) {
            if !one.authority.holds(asker, LoiBitmap::LOI2) {
                return one.refuse_without_right(&mut desk, &origin, LoiBitmap::LOI2);
            }
            return match ask(one, &mut desk) {
                Ok(()) => desk.acknowledge(destination, &origin, AckType::CarriedOut),
                Err(why) => one.refuse(&mut desk, Some(origin), why),
            };
        }
        let (mut told, mut why) = (false, "it needs LOI 2, and none is held".to_owned());
        for one in aircraft.iter_mut() {
            if one.authority.holds(asker, LoiBitmap::LOI2) {
                match ask(one, &mut desk) {
                    Ok(()) => told = true,
                    Err(fault) => why = fault,
                }
            }
        }
        if told {
            let vsm = desk.vsm;
            desk.acknowledge(vsm, &origin, AckType::CarriedOut);
        } else {
            desk.refuse(&origin, &why);
        }
    }

    fn command(
        &mut self,
        now: Now,
        origin: Origin,
        destination: Id,
        message: &Message,
        store: &mut dyn Store,
    ) {
        let cucs = self.stations[origin.station].id();
        let (mut desk, aircraft) = self.desk(now, store);
        let Some(aircraft) = aircraft
            .iter_mut()
            .find(|aircraft| aircraft.id() == destination)
        else {
            // A command to everybody is a command to nobody in particular: refused.
            desk.counters.count("misaddressed");
            return desk.refuse(&origin, TO_ONE);
        };
        match aircraft.right_for(message) {
            Some(right) if aircraft.authority.holds(cucs, right) => {
                aircraft.command(&mut desk, origin, message);
            }
            Some(right) => aircraft.refuse_without_right(&mut desk, &origin, right),
            None => {
                desk.counters.count("not supported");
                let why = format!(
                    "message {} is not supported by this VSM",
                    origin.message_type
                );
                aircraft.refuse_foreign(&mut desk, &origin, why);
            }
        }
    }

    /// A duplicate: what answered it before answers it again. A question is answered anew.
    fn answer_again(
        &mut self,
        now: Now,
        origin: &Origin,
        frame: &Frame<'_>,
        message: &Message,
        answer: Option<AckType>,
        store: &mut dyn Store,
    ) {
        let destination = frame.header.destination;
        let (mut desk, aircraft) = self.desk(now, store);
        if let Message::CucsAuthorisationRequest(request) = message {
            for aircraft in aircraft.iter_mut() {
                if aircraft.id() == destination
                    || destination == Id::BROADCAST
                    || destination == desk.vsm
                {
                    aircraft.answer_authorisation(&mut desk, origin.station, Some(request));
                }
            }
        }
        if let Message::PositiveHandoverAuthorisationRequest(_) = message
            && let Some(aircraft) = aircraft.iter_mut().find(|one| one.id() == destination)
        {
            aircraft.hand_over_again(&mut desk, origin.station);
        }
        if let Some(answer) = answer {
            desk.acknowledge(destination_as_source(destination, desk.vsm), origin, answer);
        }
    }

    /// Refuses a message that cannot be read, or that a CUCS never sends. Where nobody waits for an answer nothing is told.
    fn refuse(
        &mut self,
        now: Now,
        origin: &Origin,
        destination: Id,
        why: String,
        store: &mut dyn Store,
    ) {
        let (mut desk, aircraft) = self.desk(now, store);
        if !origin.ack_requested {
            return desk.counters.count("refused");
        }
        match aircraft.iter_mut().find(|one| one.id() == destination) {
            Some(one) => one.refuse_foreign(&mut desk, origin, why),
            None => desk.refuse(origin, &why),
        }
    }

    fn acknowledge(
        &mut self,
        now: Now,
        origin: &Origin,
        destination: Id,
        answer: AckType,
        store: &mut dyn Store,
    ) {
        let (mut desk, _) = self.desk(now, store);
        desk.acknowledge(destination_as_source(destination, desk.vsm), origin, answer);
    }

    /// Takes a datagram, or serial octets, of the vehicle with this index.
    pub fn handle_vehicle(
        &mut self,
        now: Now,
        index: usize,
        from: Peer,
        octets: &[u8],
        store: &mut dyn Store,
        tap: Tap<'_>,
    ) {
        let (mut desk, aircraft) = self.desk(now, store);
        if let Some(aircraft) = aircraft.get_mut(index) {
            aircraft.handle_datagram(&mut desk, from, octets, tap);
        }
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Now, store: &mut dyn Store) {
        let (mut desk, aircraft) = self.desk(now, store);
        for aircraft in aircraft.iter_mut() {
            aircraft.handle_timeout(&mut desk);
        }
        desk.clear_answers();
    }

    /// When [`Bridge::handle_timeout`] is next needed.
    #[must_use]
    pub fn poll_timeout(&self, now: Duration) -> Duration {
        let each = self
            .aircraft
            .iter()
            .map(|aircraft| aircraft.poll_timeout(now));
        each.fold(now + Duration::from_secs(1), Duration::min)
    }

    /// The next datagram for the DLI side.
    pub fn poll_dli(&mut self) -> Option<Datagram> {
        self.outbox.pop()
    }

    /// The next frame for a vehicle: (index of the vehicle, frame).
    pub fn poll_vehicle(&mut self) -> Option<(usize, OutFrame)> {
        self.aircraft
            .iter_mut()
            .enumerate()
            .find_map(|(index, aircraft)| aircraft.mav.poll_transmit().map(|frame| (index, frame)))
    }

    /// The next line for the log.
    pub fn poll_log(&mut self) -> Option<LogEntry> {
        self.log.pop_front()
    }

    /// The number of DLI messages sent, by type.
    pub(super) fn sent(&self) -> &ByType {
        &self.outbox.sent
    }

    pub(super) fn stations(&self) -> &[Station] {
        &self.stations
    }

    pub(super) fn desk<'a>(
        &'a mut self,
        now: Now,
        store: &'a mut dyn Store,
    ) -> (Desk<'a>, &'a mut Vec<Aircraft>) {
        let desk = Desk {
            now,
            vsm: self.vsm,
            multicast: self.multicast,
            loss: self.loss,
            provisional: self.provisional,
            stations: &mut self.stations,
            alerts: &mut self.alerts,
            outbox: &mut self.outbox,
            counters: &mut self.counters,
            log: &mut self.log,
            store,
        };
        (desk, &mut self.aircraft)
    }
}

impl Datagram {
    /// Whether it goes to the group.
    #[must_use]
    pub fn is_multicast(&self) -> bool {
        self.to == Destination::Multicast
    }
}

/// Answers come from whom the question was sent to; a question to everybody is answered by the VSM.
fn destination_as_source(destination: Id, vsm: Id) -> Id {
    if destination == Id::BROADCAST {
        vsm
    } else {
        destination
    }
}

/// The Time Stamp of a message, also of one that cannot be decoded: field 1 of every message.
fn stamp_of(frame: &Frame<'_>) -> Option<TimeStamp> {
    let info = table::message(frame.header.message_type)?;
    let (presence, rest) = frame
        .data
        .split_at_checked(usize::from(info.presence_octets))?;
    if presence.last()? & 1 == 0 {
        return None;
    }
    let first = info.fields.first()?;
    if first.wire == table::Wire::F64 {
        // 50001 carries milliseconds as a float: 17000 names them as it names all others.
        let ms = f64::from_be_bytes(rest.first_chunk().copied()?);
        let fits = (0.0..TimeStamp::PERIOD_MS as f64).contains(&ms.round());
        return fits.then(|| TimeStamp(ms.round() as u64));
    }
    if first.wire.octets()? != 5 {
        return None;
    }
    let stamp = rest
        .get(..5)?
        .iter()
        .fold(0, |stamp, octet| stamp << 8 | u64::from(*octet));
    Some(TimeStamp(stamp))
}

fn drop_name(fault: &WrapperError) -> &'static str {
    match fault {
        WrapperError::Oversized { .. } => "oversized",
        WrapperError::NoHeader { .. } | WrapperError::Truncated { .. } => "truncated",
        WrapperError::Length { .. } => "bad length",
        WrapperError::Idd { .. } => "unknown IDD version",
        WrapperError::ChecksumStyle { .. } => "unknown checksum style",
        WrapperError::Checksum { .. } => "wrong checksum",
    }
}

const ACKNOWLEDGEMENT: u16 = 17000;
/// A command to everybody is a command to nobody in particular.
const TO_ONE: &str = "it is for one vehicle, and is addressed to none";
