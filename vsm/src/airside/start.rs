//! How an agent starts: anew, or where an earlier process was ended, with a handover that goes on.

use std::collections::VecDeque;

use mavlink_link::Now;
use mavlink_link::clock::{Ceiling, Origin};
use mavlink_link::exchange::{
    Identity, Node, Parties, Responder, ResponderConfig, ResponderMemory, StagedKey, Wanted,
};
use mavlink_link::link::{Endpoint, Link, LinkConfig, Role, Security};
use mavlink_link::provisioning;
use mavlink_link::receiver::{AllowedStreams, KeyState, Stream};
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::{Store as _, StoreError};

use super::phase::{Cause, Phase};
use super::watch::Watch;
use super::{Agent, Held, Keys};
use crate::session::{Counters, LogLevel, Peer};

/// What an agent is told before it starts.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Settings {
    /// The vehicle's system id: PX4's, and the agent's own towards the ground.
    pub vehicle_system: u8,
    /// The agent's own system id towards PX4, which must be another than the vehicle's.
    pub own_system: u8,
    /// The agent's component id on both sides.
    pub own_component: u8,
    /// The agent's link id on both sides.
    pub own_link_id: u8,
    /// Who may speak to PX4, the VSM first; at most [`AllowedStreams::MAX`].
    pub talkers: Vec<Stream>,
    /// Where the ground is, where that is known.
    pub radio: Endpoint<Peer>,
    /// Where PX4 is, where that is known.
    pub px4: Endpoint<Peer>,
    /// Whether PX4 is given the same key with a new stamp after each of its starts.
    pub restamp: bool,
    /// A date that cannot be in the future.
    pub not_before: Stamp,
    /// The VSM's and the vehicle's identification numbers, DLI.
    pub ids: [u32; 2],
}

/// Why an agent does not start.
#[derive(Debug, thiserror::Error)]
pub enum AgentError {
    /// The list of talkers.
    #[error("{0} talkers, expected 1 to 8")]
    AllowedStreams(usize),
    /// A handover that is not finished.
    #[error(transparent)]
    KeyRollover(#[from] provisioning::StartError),
    /// A clock.
    #[error("the signing clock cannot be read: {0}")]
    Clock(#[from] StoreError),
}

impl Agent {
    /// Begins, or goes on where an earlier process was ended.
    ///
    /// # Errors
    /// The list of talkers is empty or too long, or a clock cannot be read.
    pub fn start(
        settings: Settings,
        identity: Identity,
        held: Held,
        now: Now,
        keys: &mut dyn Keys,
    ) -> Result<Agent, AgentError> {
        let talkers = settings.talkers.len();
        let only =
            AllowedStreams::listed(&settings.talkers).ok_or(AgentError::AllowedStreams(talkers))?;
        let first = settings
            .talkers
            .first()
            .ok_or(AgentError::AllowedStreams(0))?;
        let mut radio = LinkConfig::new(first.system, Security::Signed, settings.radio);
        // Towards the ground the agent is a component of the vehicle: the link refuses what comes in under that id.
        radio.own_system = settings.vehicle_system;
        radio.only = only;
        let mut px4 = LinkConfig::new(settings.vehicle_system, Security::Signed, settings.px4);
        px4.own_system = settings.own_system;
        for link in [&mut radio, &mut px4] {
            link.own_component = settings.own_component;
            link.link_id = settings.own_link_id;
            link.role = Role::OnboardComputer;
            link.accept_unsigned = &[];
        }
        let [vsm, vehicle] = settings.ids;
        let fingerprint = identity.public().fingerprint();
        let exchange = ResponderConfig {
            parties: Parties::new(
                Node {
                    system: first.system,
                    component: first.component,
                },
                Node {
                    system: settings.vehicle_system,
                    component: settings.own_component,
                },
                vsm,
                vehicle,
            ),
            identity,
            wanted: Wanted {
                signing: true,
                confidential: false,
            },
        };
        let next = match &held.next {
            None => None,
            Some(next) => Some(StagedKey {
                id: next.id(),
                // A key with a clock has been sent.
                sent: keys.disk().load::<Ceiling>(&next.id())?.is_some(),
            }),
        };
        let memory = ResponderMemory {
            peer: held.peer,
            epoch: held.epoch,
            current: held.current.as_ref().map(SigningKey::id),
            next,
        };
        let mut agent = Agent {
            identity: fingerprint,
            responder: Responder::new(exchange, memory, now.mono),
            news: VecDeque::new(),
            started: now.mono,
            radio: Link::new(radio),
            px4: Link::new(px4),
            phase: Phase::Keyless,
            fallback: None,
            watch: Watch::default(),
            queue: VecDeque::new(),
            notes: VecDeque::new(),
            texts: VecDeque::new(),
            held_back: Counters::default(),
            to_px4: 0,
            to_ground: 0,
            settings,
        };
        agent.resume(held, now, keys)?;
        Ok(agent)
    }

    fn resume(&mut self, held: Held, now: Now, keys: &mut dyn Keys) -> Result<(), AgentError> {
        let current = match held.current {
            None => None,
            Some(key) => Some(self.state_of(key, now, keys)?),
        };
        if let Some(next) = held.next {
            self.note(
                LogLevel::Warning,
                format!(
                    "the handover of key {} is not finished: resuming it",
                    next.id()
                ),
            );
            return Ok(self.hand_over(current, next, Cause::NewKey, now, keys)?);
        }
        if let Some(key) = current {
            self.phase = Phase::relaying(key, held.previous);
        }
        Ok(())
    }

    /// A key with its clock, read from disk.
    pub(super) fn state_of(
        &self,
        key: SigningKey,
        now: Now,
        keys: &mut dyn Keys,
    ) -> Result<KeyState, StoreError> {
        let not_before = self.settings.not_before;
        KeyState::start(key, Origin::KeyFile, not_before, now, keys.disk())
    }
}
