//! What operators and the status are told of an exchange.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::exchange::{InitiatorEvent, Status};
use stanag_msgs::enums::AlertPriority;

use super::{KeyExchange, Machine, Surroundings};
use crate::session::{ExchangeNotice, ExchangeStatus};

impl KeyExchange {
    /// What stands from the start: that there is no agent, or that anyone may listen.
    pub(super) fn announce(&mut self, now: Now, with: &mut Surroundings<'_>) {
        let text = match &self.machine {
            Machine::Unpaired => {
                "no air-side agent is paired: no key can be agreed about; run `vsm pair`"
            }
            Machine::Legacy(_) => {
                "the legacy key exchange is on: anyone in the middle can have the signing key"
            }
            Machine::Paired(_) => return,
        };
        self.tell(
            now,
            ExchangeNotice::Stands(AlertPriority::Warning, text.to_owned()),
            with,
        );
    }

    /// Follows what the machine has to say, and puts the status right.
    pub(super) fn report(&mut self, now: Now, with: &mut Surroundings<'_>) {
        while let Machine::Paired(initiator) = &mut self.machine
            && let Some(event) = initiator.poll_event()
        {
            self.tell_of(now, event, with);
        }
        let (mode, stats) = match &self.machine {
            Machine::Unpaired => ("on", None),
            Machine::Paired(initiator) => ("on", Some(initiator.stats())),
            Machine::Legacy(legacy) => ("legacy", Some(legacy.stats())),
        };
        let next = match &self.machine {
            Machine::Paired(initiator) => initiator.memory().next,
            _ => None,
        };
        let status = ExchangeStatus {
            mode,
            peer: self
                .record
                .peer()
                .map(|peer| peer.fingerprint().to_string()),
            state: self.state.clone(),
            next_key_id: next.map(|key| key.to_string()),
            taken: stats.map_or(0, |stats| stats.taken),
            ignored: stats.map_or(0, |stats| stats.by_reason().map(|(_, count)| count).sum()),
        };
        with.bridge.set_exchange_status(self.index, status);
    }

    fn tell_of(&mut self, now: Now, event: InitiatorEvent, with: &mut Surroundings<'_>) {
        use InitiatorEvent as E;
        match event {
            E::Begun { session } => {
                tracing::debug!("key exchange {session:08x} with the air-side agent begins");
                "agreeing about a key".clone_into(&mut self.state);
            }
            E::NextStored { key } => {
                self.offer(now, with);
                self.state = format!("key {key} is stored, waiting for the agent's confirmation");
            }
            E::Agreed { key, peer, epoch } => {
                self.state = format!("key {key} is agreed");
                let peer = peer.fingerprint();
                let text = format!("key {key} is agreed with agent {peer} (epoch {epoch})");
                self.once(now, AlertPriority::Nominal, text, with);
            }
            E::Status { status, reason } => self.tell_status(now, status, reason, with),
            E::Dropped { status } => {
                with.bridge.withdraw_next_key(self.index);
                self.again_at = now.mono.saturating_add(AGAIN_AFTER);
                self.state = format!("the new key was given up: {status}");
                let text = format!("the new key is given up, the old one stays in use: {status}");
                self.tell(now, ExchangeNotice::Over("no key waits"), with);
                self.once(now, AlertPriority::Caution, text, with);
            }
            E::Promoted => {
                with.bridge.adopt_next_key(self.index, now, with.store);
                let text = "the vehicle has had the new key in use already";
                self.once(now, AlertPriority::Nominal, text.to_owned(), with);
            }
            E::GaveUp { unanswered } => {
                tracing::info!("the air-side agent does not answer ({unanswered:?})");
                "the agent does not answer".clone_into(&mut self.state);
            }
            E::Rejected { status } => {
                // Anyone can send these, and as many as they like.
                tracing::debug!("somebody answers for the air-side agent, unproven: {status}");
            }
            E::NotStored(cause) => {
                let text = format!("the key exchange cannot be stored: {cause}");
                self.once(now, AlertPriority::Warning, text, with);
            }
            E::NoRandom => tracing::error!("the system has no random bytes"),
        }
    }

    fn tell_status(&mut self, now: Now, status: Status, reason: u8, with: &mut Surroundings<'_>) {
        self.state = format!("the agent says: {status}");
        if reason != 0 {
            self.state += &format!(" ({reason})");
        }
        let (priority, text) = match status {
            Status::WaitDisarm => (
                AlertPriority::Nominal,
                "a new signing key waits until the vehicle is disarmed",
            ),
            Status::Sent => (
                AlertPriority::Nominal,
                "a new signing key is being given to the vehicle: do not cut its power for 5 s",
            ),
            Status::Silent => (
                AlertPriority::Caution,
                "the vehicle is silent after a new key was sent: both keys are kept",
            ),
            Status::CannotSign => (
                AlertPriority::Warning,
                "the vehicle cannot sign: PX4 1.17 or older",
            ),
            _ => return,
        };
        self.tell(now, ExchangeNotice::Stands(priority, text.to_owned()), with);
    }

    pub(super) fn once(
        &self,
        now: Now,
        priority: AlertPriority,
        text: String,
        with: &mut Surroundings<'_>,
    ) {
        self.tell(now, ExchangeNotice::Once(priority, text), with);
    }

    pub(super) fn tell(&self, now: Now, notice: ExchangeNotice, with: &mut Surroundings<'_>) {
        with.bridge
            .tell_of_exchange(self.index, now, notice, with.store);
    }
}

/// After a key that the vehicle did not take.
const AGAIN_AFTER: Duration = Duration::from_secs(600);
