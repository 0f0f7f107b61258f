//! An order to zeroize, at the ground: repeated until the air side has reported its outcome, or time is up.

use core::time::Duration;

use super::machine::{Initiator, InitiatorEvent, Trust};
use super::ordering::Ordering;
use crate::exchange::identity::{NoRandom, Random};
use crate::exchange::message::{Message, Status, Step, Suite, VERSION};
use crate::exchange::order::{Answer, AutopilotKey, Nonce, Order, ZeroizeReport};
use crate::exchange::stats::Ignored;

impl Initiator {
    /// Orders the air side to zeroize; [`InitiatorEvent::Zeroize`] follows within half a minute. False where nobody is
    /// pinned.
    ///
    /// # Errors
    /// There are no random bytes: nothing is ordered.
    pub fn order_zeroize(
        &mut self,
        now: Duration,
        in_flight: bool,
        random: &mut dyn Random,
    ) -> Result<bool, NoRandom> {
        // In a pairing the peer is not proven yet, so there is nobody to order.
        if !matches!(self.config.trust, Trust::Pinned(_)) || self.gate.is_none() {
            return Ok(false);
        }
        let mut number: Nonce = [0; 16];
        random.fill(&mut number)?;
        let [a, b, c, d, ..] = number;
        self.ordering = Some(Ordering {
            order: Order {
                number,
                challenge: None,
                in_flight,
            },
            session: u32::from_le_bytes([a, b, c, d]).max(1),
            next_at: now,
            asked_at: None,
            silent_at: now.saturating_add(SILENT_AFTER),
            over_at: now.saturating_add(OVER_AFTER),
            reported: None,
            due: true,
        });
        Ok(true)
    }

    /// Step 7.
    pub(super) fn reported(&mut self, now: Duration, message: &Message) -> Result<(), Ignored> {
        let ordering = self.ordering.as_mut().ok_or(Ignored::Session)?;
        let gate = self.gate.as_ref().ok_or(Ignored::Forged)?;
        if message.session != ordering.session || message.suite != Suite::Pinned.to_wire() {
            return Err(Ignored::Session);
        }
        let opened = gate.open(message).ok_or(Ignored::Forged)?;
        let (number, answer) = Answer::parse(&opened.message.data).ok_or(Ignored::Step)?;
        if number != ordering.order.number {
            return Err(Ignored::Challenge);
        }
        if matches!(answer, Answer::Report(_)) {
            ordering.silent_at = now.saturating_add(SILENT_AFTER);
        }
        match answer {
            Answer::Challenge(_) if ordering.order.challenge.is_some() => Err(Ignored::Repeated),
            Answer::Challenge(challenge) => {
                ordering.order.challenge = Some(challenge);
                (ordering.asked_at, ordering.next_at) = (Some(now), now);
                ordering.due = true;
                Ok(())
            }
            // A late report says less than the one before.
            Answer::Report(report) if ordering.reported.is_some() && !report.is_final() => {
                Err(Ignored::Repeated)
            }
            Answer::Report(report) => {
                ordering.reported = Some(report);
                if report.is_final() {
                    self.ordering = None;
                }
                let report = Some(report);
                self.events.push_back(InitiatorEvent::Zeroize { report });
                Ok(())
            }
        }
    }

    pub(super) fn time_order(&mut self, now: Duration) {
        let Some(ordering) = &mut self.ordering else {
            return;
        };
        if now >= ordering.silent_at.min(ordering.over_at) {
            // The order was stored, which stands. Nobody will report the state of the autopilot's key any more.
            let lost = ZeroizeReport::Stored(AutopilotKey::NotReached);
            let report = ordering.reported.map(|_| lost);
            self.events.push_back(InitiatorEvent::Zeroize { report });
            self.ordering = None;
            return;
        }
        if now >= ordering.next_at {
            ordering.next_at = now.saturating_add(AGAIN_AFTER);
            ordering.due = true;
            // A challenge holds for some seconds and not over a restart of the agent, so an order without an answer asks
            // for a new one.
            let unanswered = |at: Duration| now.saturating_sub(at) >= FORGOTTEN_AFTER;
            if ordering.reported.is_none() && ordering.asked_at.is_some_and(unanswered) {
                (ordering.order.challenge, ordering.asked_at) = (None, None);
            }
        }
    }

    pub(super) fn poll_order(&mut self) -> Option<Message> {
        let ordering = self.ordering.as_mut()?;
        core::mem::take(&mut ordering.due)
            .then(|| self.order())
            .flatten()
    }

    /// The order as it is sent now, if one is in progress.
    pub(super) fn order(&self) -> Option<Message> {
        let ordering = self.ordering.as_ref()?;
        let message = Message {
            public_key: [0; 32],
            session: ordering.session,
            version: VERSION,
            step: Step::Order,
            suite: Suite::Pinned.to_wire(),
            status: Status::Ok,
            target: self.config.parties.responder,
            data: ordering.order.to_data(&self.config.parties)?,
        };
        self.gate.as_ref()?.seal(&message, None)
    }

    pub(super) fn order_timeout(&self) -> Option<Duration> {
        let ordering = self.ordering.as_ref()?;
        let end = ordering.silent_at.min(ordering.over_at);
        Some(ordering.next_at.min(end))
    }

    /// Whether an order is in progress.
    #[must_use]
    pub fn is_ordering(&self) -> bool {
        self.ordering.is_some()
    }
}

const AGAIN_AFTER: Duration = Duration::from_millis(500);
const FORGOTTEN_AFTER: Duration = Duration::from_secs(2);
/// 16 tries at a loss of four frames in ten: practically always one gets through.
const SILENT_AFTER: Duration = Duration::from_secs(8);
/// The agent needs 20 s at the most to give the autopilot another key.
const OVER_AFTER: Duration = Duration::from_secs(30);
