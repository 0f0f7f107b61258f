//! The parts of the machine. What a single part does is in its own file; what needs several parts is in the files above.

use std::time::Duration;

use mavlink_link::exchange::{Fingerprint, Node, Parties};
use mavlink_link::link::{Endpoint, Link};
use mavlink_link::receiver::Stream;
use mavlink_link::signing::Stamp;

use super::contingency::Alone;
use super::exchange::Exchange;
use super::fallback::Fallback;
use super::output::Reports;
use super::phase::Phase;
use super::phase::Stage;
use super::relay::Relay;
use super::watch::Watch;
use crate::config::AgentContingency;
use crate::relay_policy::RelayPolicy;
use crate::session::Peer;

/// The configuration of an agent.
#[derive(Debug, Clone, PartialEq)]
pub struct Settings {
    /// The vehicle's system id: PX4's, and the agent's own towards the ground.
    pub vehicle_system: u8,
    /// The agent's own system id towards PX4, which must differ from the vehicle's.
    pub own_system: u8,
    /// The agent's component id on both sides.
    pub own_component: u8,
    /// The agent's link id on both sides.
    pub own_link_id: u8,
    /// Who may send to PX4, the VSM first; at most [`AllowedStreams::MAX`](mavlink_link::receiver::AllowedStreams::MAX).
    pub talkers: Vec<Stream>,
    /// What they may send to PX4.
    pub policy: RelayPolicy,
    /// The address of the ground, if it is known.
    pub radio: Endpoint<Peer>,
    /// The address of PX4, if it is known.
    pub px4: Endpoint<Peer>,
    /// Whether PX4 is sent the same key with a new stamp after each of its starts.
    pub restamp: bool,
    /// What the agent flies by itself while nothing is received from the ground.
    pub contingency: Option<AgentContingency>,
    /// Whether a zeroize installs a key on PX4 that nobody keeps.
    pub replace_px4_key: bool,
    /// A date that cannot be in the future.
    pub not_before: Stamp,
    /// The VSM's and the vehicle's identification numbers, DLI.
    pub ids: [u32; 2],
}

impl Settings {
    /// Both ends of an exchange with the VSM, the first of the talkers.
    #[must_use]
    pub fn parties(&self) -> Parties {
        let ground = self.talkers.first();
        let [vsm, vehicle] = self.ids;
        Parties::new(
            Node {
                system: ground.map_or(0, |one| one.system),
                component: ground.map_or(0, |one| one.component),
            },
            Node {
                system: self.vehicle_system,
                component: self.own_component,
            },
            vsm,
            vehicle,
        )
    }
}

/// The machine.
#[derive(Debug)]
pub struct Agent {
    pub(super) settings: Settings,
    pub(super) started: Duration,
    pub(super) radio: Link<Peer>,
    pub(super) px4: Link<Peer>,
    pub(super) phase: Phase,
    /// The fingerprint of the agent's own static key, for people to compare.
    pub(super) identity: Fingerprint,
    pub(super) exchange: Exchange,
    pub(super) fallback: Fallback,
    pub(super) watch: Watch,
    pub(super) relay: Relay,
    pub(super) reports: Reports,
    /// An order to zeroize.
    pub(super) zeroize: Stage,
    /// What the agent flies by itself.
    pub(super) alone: Alone,
    /// A key that is due to be sent to PX4 waits for the shell.
    pub(super) key_held: bool,
}
