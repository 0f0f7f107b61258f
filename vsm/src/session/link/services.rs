//! What may be asked of the vehicle: commands, missions, parameters, rates, and messages that nothing answers.
//!
//! Each is a machine of `mavlink_link::service` that repeats until it is answered. The link machine sends what they
//! queue, signed at the moment of sending, and returns their ends as [`VehicleEvent`](super::event::VehicleEvent)s.

use std::collections::{BTreeMap, VecDeque};

use mavlink_link::dialect::MavMessage;
use mavlink_link::service::interval::Intervals;
use mavlink_link::service::{Node, command, event, ftp, mission, param, timesync};

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
    /// What it reports by EVENT.
    pub(crate) events: event::Client,
    /// Its events are taken by who asked, not by a machine.
    pub(crate) files: ftp::Client,
    /// For the payload, by component, each with a client of its own: an answer names the command, not the component. The
    /// autopilot as the manager of a gimbal is among them: a mode does not wait behind a gimbal that does not answer.
    pub(super) components: BTreeMap<u8, command::Client>,
    pub(super) intervals: Intervals,
    rates: Rates,
    pub(super) posts: VecDeque<MavMessage>,
    own: Node,
    vehicle: Node,
}

impl Services {
    /// For `own`, this VSM, towards `vehicle`, its autopilot.
    /// `rate_bps`: what the link carries, where that is little.
    pub(crate) fn new(own: Node, vehicle: Node, rate_bps: Option<u32>) -> Services {
        let rates = Rates::new(rate_bps);
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

    /// Sends a message that nothing answers.
    pub(crate) fn post(&mut self, message: MavMessage) {
        self.posts.push_back(message);
    }

    /// What would be sent, without a link.
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

    /// Commands for the payload to a component of the vehicle: a gimbal, a camera, or the autopilot as a gimbal's manager. No
    /// command that flies the vehicle goes or waits here.
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
