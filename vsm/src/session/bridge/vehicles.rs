//! The vehicles on their links: how a vehicle is added, which vehicle receives a frame, and who else sends there.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::Origin;
use mavlink_link::frame::FrameView;
use mavlink_link::link::{Endpoint, Link, LinkConfig, Security};
use mavlink_link::receiver::KeyState;
use mavlink_link::service::Node;
use mavlink_link::signing::Stamp;
use mavlink_link::store::{Disk, Store as _, StoreError};

use super::port::{NamedSystem, Piece};
use super::{Bridge, BridgeError, LinkEnd, Tap};
use crate::config::{self, LinkAddress};
use crate::session::aircraft::Aircraft;
use crate::session::link::frame::Peer;
use crate::session::link::services::Services;
use crate::session::link::{Capacity, LinkId, VehicleLink};
use crate::session::log::LogLevel;
use crate::session::trace::LinkTrace;

impl Bridge {
    /// Adds a vehicle, with its stored state.
    ///
    /// # Errors
    /// A record of the store cannot be read.
    pub(super) fn add_vehicle(
        &mut self,
        vehicle: &config::Vehicle,
        end: LinkEnd,
        now: Now,
        not_before: Duration,
        disk: &mut dyn Disk,
    ) -> Result<(), BridgeError> {
        let link = link_config(vehicle, self.setup.own, &end, disk)?;
        let key = end.start_key(now, not_before, disk);
        let key = key.map_err(|cause| BridgeError::Clock {
            vehicle: vehicle.id,
            cause,
        })?;
        let capacity = Capacity::of(vehicle);
        let link = VehicleLink::new(Link::new(link), key, capacity);
        let services = Services::new(self.setup.own, link.autopilot(), capacity);
        let (settings, number) = (self.setup.settings.clone(), self.aircraft.next_number);
        let mut aircraft = Aircraft::new(vehicle.clone(), settings, link, services, number);
        let known = aircraft.restore(&mut self.effects(now, disk).0)?;
        self.aircraft.next_number += 1;
        aircraft.port = self.links.place(&vehicle.link);
        self.remember_stations(now.mono, &known);
        self.aircraft.push(aircraft);
        self.name_commanders();
        Ok(())
    }

    /// The index of a link.
    #[must_use]
    pub fn link_index(&self, link: &LinkAddress) -> Option<usize> {
        self.links.index(link)
    }

    /// Takes a datagram, or serial bytes, of the link with this index: links are numbered in the order in which the
    /// configuration first names them. `tap` is called with every accepted frame and the index of its vehicle.
    pub fn handle_vehicle(
        &mut self,
        now: Now,
        port: usize,
        from: Peer,
        bytes: &[u8],
        disk: &mut dyn Disk,
        tap: Tap<'_>,
    ) {
        let shared = self.aircraft.on_port(port).len() > 1;
        let forwards = !self.forwards.is_empty();
        let mut rest = bytes;
        loop {
            let (mut system, mut length) = (None, rest.len());
            if shared && let Some(port) = self.links.ports.get_mut(port) {
                Piece { system, length } = port.next_piece(from, rest);
            }
            let piece;
            (piece, rest) = rest.split_at(length);
            // No vehicle here has this system id: each of them counts its frames and names it.
            let here = self.aircraft.on_port(port);
            system = system.filter(|system| here.iter().any(|(known, _)| known == system));
            let trace = self.records.trace;
            // Frames are collected here first: forwarding them needs the bridge, parts of which are borrowed until the loop
            // ends.
            let mut believed = std::mem::take(&mut self.links.believed);
            let (mut dli, aircraft) = self.effects(now, disk);
            for at in 0..aircraft.on_port(port).len() {
                let (known, index) = aircraft.on_port(port)[at];
                if system.is_some_and(|system| system != known) {
                    continue;
                }
                let Some(one) = aircraft.get_mut(index) else {
                    continue;
                };
                let from_here = (one.id(), one.config.signing != config::Signing::Off);
                let before = trace.then(|| LinkTrace::begin(one.link.stats()));
                one.handle_datagram(&mut dli, from, piece, &mut |frame| {
                    tap(index, frame);
                    if forwards {
                        believed.push((from_here, frame.as_bytes().to_vec()));
                    }
                });
                if let Some(before) = before {
                    let line = before.end(one.link.stats(), from, piece);
                    dli.note(LogLevel::Debug, one.id(), line);
                }
            }
            for (of, frame) in believed.drain(..) {
                if let Ok(frame) = FrameView::parse(&frame) {
                    Bridge::pass_on(&mut self.forwards, now, of, &frame, disk);
                }
            }
            self.links.believed = believed;
            if rest.is_empty() {
                return;
            }
        }
    }

    /// Systems that send on a vehicle's link without being a vehicle there, with the number of their frames.
    pub(super) fn others_on_link<'a>(
        &'a self,
        of: &'a Aircraft,
    ) -> impl Iterator<Item = (u8, u32)> + 'a {
        // Each second for each vehicle: a search for each system would cost the third power of their number.
        let mut ours = [false; 1 << u8::BITS];
        for (system, _) in self.aircraft.on_port(of.port) {
            ours[usize::from(*system)] = true;
        }
        let others = of.link.other_systems();
        others.filter(move |(system, _)| !ours[usize::from(*system)])
    }

    /// Logs each system that sends on a link and is not configured there: nobody looks for a second autopilot or ground
    /// station beside a healthy vehicle. Repeats it once in a while, as long as the system sends.
    pub(super) fn name_others(&mut self, now: Now, disk: &mut dyn Disk) {
        for index in 0..self.aircraft.len() {
            let Some(one) = self.aircraft.get(index) else {
                continue;
            };
            let port = one.port;
            let named = &self.links.ports[port].named;
            let is_due = |(system, frames): &(u8, u32)| {
                match named.iter().find(|known| known.system == *system) {
                    Some(known) => *frames > known.frames && now.mono >= known.at + NAMED_AGAIN,
                    // Anybody can send with any system id: the log has room for some of them.
                    None => named.len() < MAX_NAMED,
                }
            };
            let found = self.others_on_link(one).find(is_due);
            let Some((system, frames)) = found else {
                continue;
            };
            let configured = self.aircraft.on_port(port).iter();
            let configured: Vec<_> = configured.map(|(system, _)| system.to_string()).collect();
            let mut text = format!(
                "MAVLink system {system} sends on {}, where the configuration has system {}: its frames are ignored",
                self.links.ports[port].link,
                configured.join(" and ")
            );
            let named = &mut self.links.ports[port].named;
            let at = now.mono;
            match named.iter_mut().find(|known| known.system == system) {
                Some(known) => {
                    text += &format!(" ({frames} so far)");
                    (known.at, known.frames) = (at, frames);
                }
                None => named.push(NamedSystem { system, at, frames }),
            }
            let vsm = self.vsm;
            self.effects(now, disk).0.note(LogLevel::Warning, vsm, text);
        }
    }
}

impl LinkEnd {
    /// The configuration of the link to this system.
    pub(super) fn link(&self, system: u8, own: Node) -> LinkConfig<Peer> {
        let security = match self.key {
            Some(_) => Security::Signed,
            None => Security::Off,
        };
        let endpoint = self.peer.map_or(Endpoint::Listen, Endpoint::Fixed);
        let mut link = LinkConfig::new(system, security, endpoint);
        link.own_system = own.system;
        link.own_component = own.component;
        link
    }

    /// The key with its clock.
    ///
    /// # Errors
    /// The clock cannot be read.
    pub(super) fn start_key(
        self,
        now: Now,
        not_before: Duration,
        disk: &mut dyn Disk,
    ) -> Result<Option<KeyState>, StoreError> {
        let not_before = Stamp::from_unix(not_before);
        let start = |key| KeyState::start(key, Origin::KeyFile, not_before, now, disk);
        self.key.map(start).transpose()
    }
}

/// The configuration of a vehicle's link, with what an earlier process has learned about it.
///
/// # Errors
/// The disk cannot be read.
pub fn link_config(
    vehicle: &config::Vehicle,
    own: Node,
    end: &LinkEnd,
    disk: &dyn Disk,
) -> Result<LinkConfig<Peer>, StoreError> {
    let mut link = end.link(vehicle.system_id, own);
    link.link_id = vehicle.link_id;
    link.vehicle_link_id = vehicle.vehicle_link_id;
    link.known_link_id = disk.load::<LinkId>(&vehicle.id)?.and_then(|LinkId(id)| id);
    Ok(link)
}

/// Maximum number of systems of one link that are named in the log.
const MAX_NAMED: usize = 8;
/// A system that still sends is named again after this time.
const NAMED_AGAIN: Duration = Duration::from_secs(300);
