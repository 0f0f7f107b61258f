//! How an agent starts: for the first time, or where an earlier process ended, with a rollover that continues.

use mavlink_link::Now;
use mavlink_link::clock::Ceiling;
use mavlink_link::exchange::{
    Identity, Responder, ResponderConfig, ResponderMemory, StagedKey, Wanted,
};
use mavlink_link::link::{Link, LinkConfig, Role, Security};
use mavlink_link::provisioning;
use mavlink_link::receiver::AllowedStreams;
use mavlink_link::signing::SigningKey;
use mavlink_link::store::{Store as _, StoreError};
use stanag_msgs::Id;

use super::agent::{Agent, Settings};
use super::contingency::Alone;
use super::exchange::Exchange;
use super::fallback::Fallback;
use super::keys::{Held, Keys, with_clock};
use super::output::Reports;
use super::phase::Stage;
use super::phase::{Cause, Phase};
use super::relay::Relay;
use super::watch::Watch;
use crate::session::LogLevel;

/// Why an agent does not start.
#[derive(Debug, thiserror::Error)]
pub enum AgentError {
    /// The list of talkers.
    #[error("{0} talkers, expected 1 to 8")]
    AllowedStreams(usize),
    /// An unfinished rollover.
    #[error(transparent)]
    KeyRollover(#[from] provisioning::StartError),
    /// The record of what it has flown by itself.
    #[error("what was flown for contingencies cannot be read: {0}")]
    Contingencies(StoreError),
    /// A clock.
    #[error("the signing clock cannot be read: {0}")]
    Clock(#[from] StoreError),
}

impl Agent {
    /// Begins, or continues where an earlier process ended.
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
        // Towards the ground the agent is a component of the vehicle: the link refuses received frames with that system id.
        radio.own_system = settings.vehicle_system;
        radio.only = only;
        let mut px4 = LinkConfig::new(settings.vehicle_system, Security::Signed, settings.px4);
        px4.own_system = settings.own_system;
        for link in [&mut radio, &mut px4] {
            link.own_component = settings.own_component;
            link.link_id = settings.own_link_id;
            link.role = Role::OnboardComputer;
            // RADIO_STATUS (109) is accepted unsigned by default, but the relay passes verified frames only.
            link.accept_unsigned = &[];
        }
        let fingerprint = identity.public().fingerprint();
        let exchange = ResponderConfig {
            parties: settings.parties(),
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
            exchange: Exchange::new(Responder::new(exchange, memory, now.mono)),
            started: now.mono,
            radio: Link::new(radio),
            px4: Link::new(px4),
            phase: Phase::Keyless,
            fallback: Fallback::default(),
            watch: Watch::default(),
            relay: Relay::new(settings.policy.clone()),
            reports: Reports::default(),
            zeroize: Stage::default(),
            alone: Alone::new(settings.contingency.as_ref(), Id(settings.ids[1])),
            key_held: false,
            settings,
        };
        agent.resume(held, now, keys)?;
        agent
            .alone
            .restore(now, keys.disk(), &mut agent.reports)
            .map_err(AgentError::Contingencies)?;
        Ok(agent)
    }

    fn resume(&mut self, held: Held, now: Now, keys: &mut dyn Keys) -> Result<(), AgentError> {
        let current = match held.current {
            None => None,
            Some(key) => Some(with_clock(key, self.settings.not_before, now, keys)?),
        };
        if let Some(next) = held.next {
            self.reports.note(
                LogLevel::Warning,
                format!(
                    "the rotation to key {} is not finished: resuming it",
                    next.id()
                ),
            );
            // PX4 may or may not have it: the rollover verifies under both keys until a frame decides.
            return Ok(self.hand_over(current, next, Cause::NewKey, now, keys)?);
        }
        if let Some(key) = current {
            self.phase = Phase::relaying(key, held.previous);
        }
        Ok(())
    }
}
