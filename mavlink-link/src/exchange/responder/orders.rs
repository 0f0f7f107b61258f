//! An order to zeroize, at the air side: it counts once, and only with the challenge given for it.

use core::hash::Hash;
use core::time::Duration;

use super::machine::{Responder, ResponderEvent};
use super::sessions::Arrival;
use super::taken::Taken;
use crate::exchange::identity::Random;
use crate::exchange::message::{Message, Status, Step, Suite};
use crate::exchange::order::{Answer, Nonce, Order, ZeroizeReport};
use crate::exchange::stats::Ignored;

impl<A: Copy + Eq + Hash> Responder<A> {
    /// Step 6. It costs a few hashes, and its answer is shorter than it is, so it needs no rate limit.
    pub(super) fn ordered(
        &mut self,
        now: Duration,
        arrival: &Arrival<A>,
        suite: Suite,
        message: &Message,
        random: &mut dyn Random,
    ) -> Result<(), Ignored> {
        if suite != Suite::Pinned {
            return Err(Ignored::Suite);
        }
        let order = Order::parse(&message.data, &self.config.parties)?;
        let Some(challenge) = order.challenge else {
            let given = self.challenges.make(&order.number, now, random);
            let given = Answer::Challenge(given.ok_or(Ignored::NoRandom)?);
            self.answer_order(arrival, message.session, &order.number, given);
            return Ok(());
        };
        // Carrying an order out may take longer than its challenge holds, so a known number is answered without one.
        let known = |one: &&mut Taken<A>| one.number == order.number;
        if let Some(known) = self.orders.iter_mut().find(known) {
            known.from = arrival.from;
            if let Some(report) = known.report {
                let report = Answer::Report(report);
                self.answer_order(arrival, message.session, &order.number, report);
            }
            return Ok(());
        }
        if !self.challenges.is_of(&challenge, &order.number, now) {
            return Err(Ignored::Challenge);
        }
        // Never forget an order to make room: it could be replayed for as long as its challenge holds.
        if self.orders.len() >= MAX_ORDERS {
            return Err(Ignored::Limited);
        }
        self.orders.push_back(Taken {
            number: order.number,
            session: message.session,
            from: arrival.from,
            gate: arrival.gate.clone(),
            at: now,
            report: None,
        });
        let in_flight = order.in_flight;
        self.note(ResponderEvent::Zeroize { in_flight });
        Ok(())
    }

    /// Reports the outcome of the order taken last: sent at once, and whenever the order is repeated.
    pub fn report_zeroize(&mut self, report: ZeroizeReport) {
        let Some(taken) = self.orders.back_mut() else {
            return;
        };
        taken.report = Some(report);
        let (from, gate) = (taken.from, taken.gate.clone());
        let (session, number) = (taken.session, taken.number);
        let answer = Answer::Report(report);
        if let Some(sealed) = self
            .order_answer(session, &number, answer)
            .and_then(|message| gate.seal(&message, None))
        {
            self.queue(from, sealed);
        }
    }

    /// Forgets refused orders once their challenge has expired: they can no longer be replayed.
    pub(super) fn forget_orders(&mut self, now: Duration) {
        let challenges = &self.challenges;
        self.orders
            .retain(|one| !is_refused(one) || challenges.holds_since(one.at, now));
    }

    fn answer_order(&mut self, arrival: &Arrival<A>, session: u32, number: &Nonce, answer: Answer) {
        if let Some(message) = self.order_answer(session, number, answer) {
            self.send(arrival, &message);
        }
    }

    fn order_answer(&self, session: u32, number: &Nonce, answer: Answer) -> Option<Message> {
        let suite = Suite::Pinned.to_wire();
        Some(Message {
            data: answer.to_data(number)?,
            ..self.message(suite, session, Step::Report, Status::Ok)
        })
    }
}

fn is_refused<A>(one: &Taken<A>) -> bool {
    matches!(one.report, Some(ZeroizeReport::Refused(_)))
}

/// Orders within the life of a challenge: the ground sends one, and an operator who tries again sends another.
const MAX_ORDERS: usize = 8;
