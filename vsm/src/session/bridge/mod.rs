//! The whole bridge as one machine: datagrams of both sides and the time go in, datagrams and log lines come out.
//!
//! Who a datagram of the DLI is from and whether it may speak is in `arrival`, to whom its message speaks in `dispatch`.

mod arrival;
mod dispatch;

use std::collections::VecDeque;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::frame::FrameView;
use mavlink_link::link::{Endpoint, Link, LinkConfig, Security};
use mavlink_link::receiver::KeyState;
use mavlink_link::service::Node;
use mavlink_link::signing::Stamp;
use stanag_msgs::{Id, Profile};

use super::aircraft::Aircraft;
use super::alerts::Alerts;
use super::configuration::Configuration;
use super::counters::{ByType, Counters};
use super::desk::Desk;
use super::link_id;
use super::log::LogEntry;
use super::outbox::{Datagram, Outbox};
use super::station::Station;
use super::vehicle::{OutFrame, Peer, VehicleLink};
use crate::config::Config;
use mavlink_link::store::{Disk, StoreError};

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
        cause: StoreError,
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
        store: &mut dyn Disk,
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
                    let started =
                        KeyState::start(key, origin, Stamp::from_unix(not_before), now, store)
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

    /// Takes a datagram, or serial bytes, of the vehicle with this index.
    pub fn handle_vehicle(
        &mut self,
        now: Now,
        index: usize,
        from: Peer,
        bytes: &[u8],
        store: &mut dyn Disk,
        tap: Tap<'_>,
    ) {
        let (mut desk, aircraft) = self.desk(now, store);
        if let Some(aircraft) = aircraft.get_mut(index) {
            aircraft.handle_datagram(&mut desk, from, bytes, tap);
        }
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Now, store: &mut dyn Disk) {
        let (mut desk, aircraft) = self.desk(now, store);
        for aircraft in aircraft.iter_mut() {
            aircraft.handle_timeout(&mut desk);
        }
        desk.clear_answers();
        self.forget_heartbeats();
    }

    /// Silence counts of a CUCS that has sent heartbeats while it holds something: who has given all up, or lost it, may
    /// come back without.
    fn forget_heartbeats(&mut self) {
        for station in self.stations.iter_mut().filter(|one| one.sends_heartbeats) {
            let id = station.id();
            let holds = |aircraft: &Aircraft| !aircraft.authority.held(id).is_empty();
            station.sends_heartbeats = self.aircraft.iter().any(holds);
        }
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
        store: &'a mut dyn Disk,
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

/// Answers come from whom the question was sent to; a question to everybody is answered by the VSM.
fn destination_as_source(destination: Id, vsm: Id) -> Id {
    if destination == Id::BROADCAST {
        vsm
    } else {
        destination
    }
}
