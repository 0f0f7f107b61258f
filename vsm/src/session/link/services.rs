//! Requests to the vehicle: commands, missions, parameters, message rates, and messages without an answer.
//!
//! Each is a machine of `mavlink_link::service` that retries until it is answered. The link machine sends their queued
//! messages, signed at the moment of sending, and reports results as [`VehicleEvent`](super::event::VehicleEvent)s.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use mavlink_link::dialect::MavMessage;
use mavlink_link::service::interval::Intervals;
use mavlink_link::service::{Node, command, event, ftp, mission, param, timesync};

use super::budget::Capacity;
use super::ground::GroundService;
use super::rates::Rates;

/// The services of one vehicle.
#[derive(Debug)]
pub(crate) struct Services {
    pub(crate) missions: mission::Client,
    pub(crate) commands: command::Client,
    pub(crate) parameters: param::Client,
    /// The vehicle's clock against ours.
    pub(crate) clock: timesync::Client,
    pub(crate) ground: GroundService,
    /// Events of the vehicle (EVENT).
    pub(crate) events: event::Client,
    /// The requesting program takes its events, not a machine.
    pub(crate) files: ftp::Client,
    /// Commands for the payload, with one client for each component, because an answer names the command but not the
    /// component. The autopilot as a gimbal manager has its own client too, so that a mode command never waits behind a
    /// gimbal that does not answer.
    pub(super) components: BTreeMap<u8, command::Client>,
    pub(super) intervals: Intervals,
    rates: Rates,
    pub(super) posts: VecDeque<MavMessage>,
    own: Node,
    vehicle: Node,
}

impl Services {
    /// Services from `own`, this VSM, to `vehicle`, its autopilot.
    /// `capacity`: what the link carries, where that is little.
    pub(crate) fn new(own: Node, vehicle: Node, capacity: Option<Capacity>) -> Services {
        let rates = Rates::new(capacity);
        Services {
            missions: mission::Client::new(own, vehicle, mission::Timing::default()),
            commands: command::Client::new(own, vehicle, command::Timing::default()),
            parameters: param::Client::new(own, vehicle, param::Timing::default()),
            clock: timesync::Client::new(vehicle),
            ground: GroundService::default(),
            events: event::Client::new(own, vehicle),
            files: ftp::Client::new(own, vehicle, ftp::Timing::default()),
            intervals: Intervals::new(rates.requested()),
            rates,
            components: BTreeMap::new(),
            posts: VecDeque::new(),
            own,
            vehicle,
        }
    }

    /// The bridge did not run for so long: an answer may wait unread. The other services lose one of many tries by that.
    pub(crate) fn postpone(&mut self, stopped: Duration) {
        for commands in self.components.values_mut().chain([&mut self.commands]) {
            commands.postpone(stopped);
        }
    }

    /// Sends a message that has no answer.
    pub(crate) fn post(&mut self, message: MavMessage) {
        self.posts.push_back(message);
    }

    /// The messages to send, without a link.
    #[cfg(test)]
    pub(crate) fn take_posts(&mut self) -> Vec<MavMessage> {
        self.posts.drain(..).collect()
    }

    /// Requests a message at a rate from now on, as soon as another command may be sent.
    pub(crate) fn request_rate(&mut self, message: u32, hertz: f32) {
        self.rates.add(message, hertz);
        for (message, rate) in self.rates.requested() {
            self.intervals.request(message, rate);
        }
    }

    /// The client for payload commands to a component: a gimbal, a camera, or the autopilot as a gimbal manager. Flight
    /// commands never use these clients.
    pub(crate) fn commands_to(&mut self, component: u8) -> &mut command::Client {
        let (own, node) = (self.own, Node::new(self.vehicle.system, component));
        (self.components)
            .entry(component)
            .or_insert_with(|| command::Client::new(own, node, command::Timing::default()))
    }

    /// This VSM as the vehicle knows it.
    pub(crate) fn own(&self) -> Node {
        self.own
    }

    /// The vehicle's autopilot.
    pub(crate) fn autopilot(&self) -> Node {
        self.vehicle
    }

    /// The MAVLink system id of this VSM.
    pub(crate) fn own_system(&self) -> u8 {
        self.own.system
    }
}
