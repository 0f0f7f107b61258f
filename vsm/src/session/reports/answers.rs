//! Answers of many messages, sent a few at a time so that they do not overflow the buffers of a small ground station; 17000
//! "carried out" follows the last message. The stations are independent: none waits for the answers to another.

use std::time::Duration;

use stanag_msgs::enums::AckType;
use stanag_msgs::{Message, TimeStamp};

use crate::session::context::Origin;
use crate::session::effects::Effects;
use crate::session::turns::Turns;

/// The machine.
#[derive(Debug, Default)]
pub(super) struct AnswerQueue {
    queues: Turns<Outgoing>,
    due: Option<Duration>,
}

#[derive(Debug)]
enum Outgoing {
    Answer(Box<Message>),
    Done(Origin),
}

impl AnswerQueue {
    /// Number of messages waiting for a station.
    pub(super) fn waiting(&self, station: usize) -> usize {
        self.queues.waiting(station)
    }

    /// Whether the queue of a station is full.
    pub(super) fn is_full(&self, station: usize) -> bool {
        self.waiting(station) > MAX_WAITING
    }

    /// Queues answers to a station, without sending any.
    pub(super) fn push(
        &mut self,
        now: Duration,
        station: usize,
        answers: impl IntoIterator<Item = Message>,
        origin: Option<Origin>,
    ) {
        for answer in answers {
            let answer = Outgoing::Answer(Box::new(answer));
            self.queues.push(station, answer);
        }
        if let Some(origin) = origin {
            self.queues.push(station, Outgoing::Done(origin));
        }
        if !self.queues.is_empty() {
            self.due.get_or_insert(now);
        }
    }

    /// Answers a station, a few messages at a time, then acknowledges `origin` as carried out.
    pub(super) fn answer(
        &mut self,
        station: usize,
        answers: impl IntoIterator<Item = Message>,
        origin: Option<Origin>,
        effects: &mut Effects<'_>,
    ) {
        if self.is_full(station) {
            if let Some(origin) = origin {
                effects.refuse(Some(origin), "too many answers wait to be sent");
            }
            return;
        }
        self.push(effects.dli.now.mono, station, answers, origin);
        self.send_due(effects);
    }

    /// Drops a station's unsent messages; returns the requests that were not answered completely.
    pub(super) fn abort(&mut self, station: usize) -> Vec<Origin> {
        let dropped = self.queues.take(station).into_iter();
        let done = |outgoing| match outgoing {
            Outgoing::Answer(_) => None,
            Outgoing::Done(origin) => Some(origin),
        };
        dropped.filter_map(done).collect()
    }

    /// Sends what is due.
    pub(super) fn send_due(&mut self, effects: &mut Effects<'_>) {
        let now = effects.dli.now.mono;
        if self.due.is_none_or(|due| due > now) {
            return;
        }
        for _ in 0..BURST {
            match self.queues.pop() {
                None => break,
                Some((to, Outgoing::Answer(answer))) => {
                    // Stamped when sent, not when queued: stamps rise strictly, and other messages are sent in between.
                    let answer = stamped(*answer, effects.stamp());
                    effects.send(to, &answer);
                }
                Some((_, Outgoing::Done(origin))) => {
                    effects.acknowledge(&origin, AckType::CarriedOut);
                }
            }
        }
        self.due = (!self.queues.is_empty()).then_some(now + PAUSE);
    }

    /// When the next answers are due.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        self.due
    }
}

/// An answer with its time.
fn stamped(mut answer: Message, stamp: TimeStamp) -> Message {
    let place = match &mut answer {
        Message::FieldConfigurationIntegerResponse(m) => &mut m.time_stamp,
        Message::FieldConfigurationFloatResponse(m) => &mut m.time_stamp,
        Message::FieldConfigurationEnumeratedResponse(m) => &mut m.time_stamp,
        Message::FieldConfigurationUnsignedResponse(m) => &mut m.time_stamp,
        Message::FieldConfigurationCharacterResponse(m) => &mut m.time_stamp,
        Message::ConfigurationComplete(m) => &mut m.time_stamp,
        Message::VsmServicesReportMessage(m) => &mut m.time_stamp,
        Message::UaRouteConfiguration(m) => &mut m.time_stamp,
        Message::MessageParameterAvailability(m) => &mut m.time_stamp,
        Message::FieldChangeIntegerCommand(m) => &mut m.time_stamp,
        Message::FieldChangeFloatCommand(m) => &mut m.time_stamp,
        Message::FieldChangeEnumeratedCommand(m) => &mut m.time_stamp,
        Message::ParameterReport(m) => &mut m.time_stamp,
        Message::AreaVertex(m) => &mut m.time_stamp,
        Message::AreaTransferStatus(m) => &mut m.time_stamp,
        _ => return answer,
    };
    *place = Some(stamp);
    answer
}

/// Messages of one burst, and the pause after it.
const BURST: usize = 16;
const PAUSE: Duration = Duration::from_millis(20);
/// Maximum number of queued answers per station; one level of interoperability has some 200.
pub(super) const MAX_WAITING: usize = 4_096;

#[cfg(test)]
mod tests {
    use stanag_msgs::messages::ParameterReport;

    use super::*;
    use crate::session::testing::{World, acknowledgements, origin};

    fn reports(count: usize) -> Vec<Message> {
        vec![ParameterReport::default().into(); count]
    }

    /// How many of them station 0 has been sent, and the acknowledgements.
    fn sent(world: &mut World) -> (usize, Vec<AckType>) {
        let messages = world.sent_to(0);
        let report = |message: &&Message| matches!(message, Message::ParameterReport(_));
        let count = messages.iter().filter(report).count();
        (count, acknowledgements(&messages))
    }

    #[test]
    fn answers_go_out_in_bursts_and_the_acknowledgement_follows_the_last() {
        let (mut world, mut queue) = (World::new(), AnswerQueue::default());
        let of = origin(&ParameterReport::default().into());
        world.act(|_, _, effects| queue.answer(0, reports(40), Some(of), effects));
        assert_eq!(sent(&mut world), (BURST, vec![]));
        assert_eq!(queue.poll_timeout(), Some(world.now.mono + PAUSE));
        world.act(|_, _, effects| queue.send_due(effects));
        assert_eq!(
            sent(&mut world),
            (0, vec![]),
            "not before the pause is over"
        );
        world.advance(PAUSE);
        world.act(|_, _, effects| queue.send_due(effects));
        assert_eq!(sent(&mut world), (BURST, vec![]));
        world.advance(PAUSE);
        world.act(|_, _, effects| queue.send_due(effects));
        assert_eq!(sent(&mut world), (8, vec![AckType::CarriedOut]));
        assert_eq!(queue.poll_timeout(), None);
    }

    #[test]
    fn what_a_station_is_not_sent_any_more_ends_its_request_and_no_other() {
        let (mut world, mut queue) = (World::new(), AnswerQueue::default());
        let of = origin(&ParameterReport::default().into());
        let other = Origin { station: 1, ..of };
        queue.push(world.now.mono, 1, reports(1), Some(other));
        queue.push(world.now.mono, 0, reports(1), Some(of));
        assert_eq!(queue.abort(1), [other]);
        world.act(|_, _, effects| queue.send_due(effects));
        assert_eq!(sent(&mut world), (1, vec![AckType::CarriedOut]));
        assert!(queue.queues.is_empty());
    }

    #[test]
    fn a_full_queue_refuses_and_keeps_what_it_has() {
        let (mut world, mut queue) = (World::new(), AnswerQueue::default());
        let of = origin(&ParameterReport::default().into());
        queue.push(world.now.mono, 0, reports(MAX_WAITING + 1), None);
        world.act(|_, _, effects| queue.answer(0, reports(1), Some(of), effects));
        assert_eq!(sent(&mut world), (0, vec![AckType::Refused]));
        assert_eq!(queue.waiting(0), MAX_WAITING + 1);
        // And keeps nobody else waiting.
        let other = Origin { station: 1, ..of };
        world.advance(PAUSE);
        world.act(|_, _, effects| queue.answer(1, reports(1), Some(other), effects));
        assert_eq!(queue.waiting(1), 0);
    }
}
