//! MAVLink's events interface, as a ground station receives it: EVENT (410) in the order of their numbers, the lost ones
//! requested again.
//!
//! PX4 v1.18 numbers its events from a count that all its links share, keeps the last 20, names the newest number every 3 s
//! (CURRENT_EVENT_SEQUENCE), and answers a request for one that it no longer has by RESPONSE_EVENT_ERROR. It sends each
//! event once, so an event that a link loses is lost unless requested. Events before the first message are not requested:
//! they belong to the past, and conditions that persist are reported otherwise.

use std::collections::BTreeMap;
use std::time::Duration;

use mavlink::dialects::development::{
    EVENT_DATA, MavEventCurrentSequenceFlags, MavMessage, REQUEST_EVENT_DATA,
};

use super::bounded::Bounded;
use crate::frame::Node;

/// What a [`Client`] delivers.
#[derive(Clone, PartialEq, Debug)]
pub enum Event {
    /// The next event.
    Received(Received),
    /// This many did not arrive and can no longer be requested.
    Lost(u16),
    /// The vehicle counts from the beginning: it does not continue earlier reports.
    Restarted,
}

/// An event of the vehicle, without its meaning: that is in the vehicle's metadata.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Received {
    /// EVENT.id: component in the upper 8 bits, number below.
    pub id: u32,
    /// EVENT.sequence.
    pub sequence: u16,
    /// The external part of EVENT.log_levels: 0 emergency to 7 debug, 8 for other programs alone.
    pub level: u8,
    /// EVENT.arguments, packed as the metadata has them.
    pub arguments: [u8; 40],
}

/// The events of one autopilot.
#[derive(Debug)]
pub struct Client {
    us: Node,
    vehicle: Node,
    /// The number of the next event to deliver, once one is known.
    next: Option<u16>,
    /// Events beyond a gap, by their distance from `next` at the time: renumbered when that moves.
    ahead: BTreeMap<u16, Received>,
    /// The newest number that is known, as a distance from `next`: 0, nothing is missing.
    newest: u16,
    request: Option<Request>,
    /// When a number before `next` was named as the newest.
    behind_at: Option<Duration>,
    events: Bounded<Event>,
    /// What did not fit in `events`.
    dropped: u16,
    out: Bounded<MavMessage>,
}

/// A request for the events that are missing.
#[derive(Debug, Clone, Copy)]
struct Request {
    due: Duration,
    left: u8,
}

impl Client {
    /// A client named `us` on the link, for the events of `vehicle`.
    #[must_use]
    pub const fn new(us: Node, vehicle: Node) -> Self {
        Self {
            us,
            vehicle,
            next: None,
            ahead: BTreeMap::new(),
            newest: 0,
            request: None,
            behind_at: None,
            events: Bounded::new(MAX_EVENTS),
            dropped: 0,
            out: Bounded::new(MAX_OUT),
        }
    }

    /// The vehicle has restarted, or may have: numbering starts again with its next message.
    pub fn reset(&mut self) {
        self.next = None;
        self.ahead.clear();
        self.newest = 0;
        self.request = None;
        self.behind_at = None;
    }

    /// Whether the vehicle has shown that it sends events.
    #[must_use]
    pub const fn is_in_use(&self) -> bool {
        self.next.is_some()
    }

    /// Takes a message of `from`; returns whether it was about events.
    pub fn handle_message(&mut self, now: Duration, from: Node, message: &MavMessage) -> bool {
        if from != self.vehicle {
            return false;
        }
        match message {
            MavMessage::EVENT(event) => self.take(now, event),
            MavMessage::CURRENT_EVENT_SEQUENCE(current) => {
                let reset = MavEventCurrentSequenceFlags::MAV_EVENT_CURRENT_SEQUENCE_FLAGS_RESET;
                self.note_newest(now, current.sequence, current.flags.contains(reset));
            }
            MavMessage::RESPONSE_EVENT_ERROR(error)
                if self.us == Node::new(error.target_system, error.target_component) =>
            {
                self.give_up_before(now, error.sequence, error.sequence_oldest_available);
            }
            _ => return false,
        }
        true
    }

    /// Requests missing events again.
    pub fn handle_timeout(&mut self, now: Duration) {
        let Some(request) = self.request.filter(|request| request.due <= now) else {
            return;
        };
        if request.left > 0 {
            self.ask(now, request.left - 1);
        } else {
            // No answer: continue with the events that are here, or after the newest.
            let missing = self.gap();
            self.skip(missing);
            self.follow(now);
        }
    }

    /// When [`Client::handle_timeout`] is next needed.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Duration> {
        self.request.map(|request| request.due)
    }

    /// The next message for the vehicle.
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.out.pop()
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        // The loss is reported after the events that did fit: it came after them.
        self.events.pop().or_else(|| {
            let dropped = std::mem::take(&mut self.dropped);
            (dropped > 0).then_some(Event::Lost(dropped))
        })
    }

    fn take(&mut self, now: Duration, event: &EVENT_DATA) {
        let for_us = |target, own| target == 0 || target == own;
        if !for_us(event.destination_system, self.us.system)
            || !for_us(event.destination_component, self.us.component)
        {
            // It takes a number all the same, so it leaves no gap.
            return self.skip_own(now, event.sequence);
        }
        let received = Received {
            id: event.id,
            sequence: event.sequence,
            level: event.log_levels & 0xf,
            arguments: event.arguments,
        };
        let next = *self.next.get_or_insert(event.sequence);
        match event.sequence.wrapping_sub(next) {
            0 => {
                self.deliver(Event::Received(received));
                self.advance(1);
            }
            // Delivered before, or given up: a copy, or the late answer to a request.
            behind if behind > u16::MAX / 2 => return,
            ahead if ahead > MAX_AHEAD => {
                // More than any vehicle keeps, or meaningless numbers: no request would bring them.
                self.abandon(ahead);
                self.deliver(Event::Received(received));
                self.advance(1);
            }
            ahead => {
                self.ahead.insert(ahead, received);
                self.newest = self.newest.max(ahead + 1);
            }
        }
        self.follow(now);
    }

    /// An event for somebody else.
    fn skip_own(&mut self, now: Duration, sequence: u16) {
        if self.next == Some(sequence) {
            self.advance(1);
            self.follow(now);
        }
    }

    fn note_newest(&mut self, now: Duration, sequence: u16, reset: bool) {
        let after = sequence.wrapping_add(1);
        let Some(next) = self.next.filter(|_| !reset) else {
            return self.begin_at(after);
        };
        // Half the range of a wrapping counter is "ahead", the other half "behind".
        if after.wrapping_sub(next) <= u16::MAX / 2 {
            self.behind_at = None;
        }
        match after.wrapping_sub(next) {
            0 => {}
            // It counts from an earlier number than before: it has restarted. Or events only overtook this message; the
            // next one, 3 s later, then names them.
            behind if behind > u16::MAX / 2 => {
                let since = *self.behind_at.get_or_insert(now);
                if behind.wrapping_neg() > MAX_OVERTAKEN || now >= since + AGAIN {
                    return self.begin_at(after);
                }
            }
            missing if missing > MAX_AHEAD => self.abandon(missing),
            missing => self.newest = self.newest.max(missing),
        }
        self.follow(now);
    }

    /// The vehicle counts from this number. What waits beyond a gap is delivered, and the gap counted, before.
    fn begin_at(&mut self, next: u16) {
        if self.next.is_some_and(|before| before != next) {
            if self.gap() > 0 {
                self.abandon(self.newest);
            }
            self.deliver(Event::Restarted);
        }
        self.reset();
        self.next = Some(next);
    }

    /// The vehicle has no events from `sequence` up to `oldest`.
    fn give_up_before(&mut self, now: Duration, sequence: u16, oldest: u16) {
        let Some(next) = self.next.filter(|_| self.request.is_some()) else {
            return;
        };
        if sequence != next {
            return;
        }
        // An answer that names nothing ahead still refers to this event.
        let gone = oldest.wrapping_sub(next).clamp(1, self.gap().max(1));
        self.skip(gone);
        self.follow(now);
    }

    /// How many are missing before the first that is there.
    fn gap(&self) -> u16 {
        let first = self.ahead.keys().next().copied();
        first.unwrap_or(self.newest)
    }

    /// Counts the next ones as lost.
    fn skip(&mut self, count: u16) {
        if count > 0 {
            self.deliver(Event::Lost(count));
            self.advance(count);
        }
        self.request = None;
    }

    /// Gives up everything before a number `count` ahead; delivers first what waits beyond a gap there.
    fn abandon(&mut self, count: u16) {
        let waiting = std::mem::take(&mut self.ahead);
        let there = u16::try_from(waiting.len()).unwrap_or(count);
        for event in waiting.into_values() {
            self.deliver(Event::Received(event));
        }
        self.deliver(Event::Lost(count.saturating_sub(there)));
        self.advance(count);
        self.request = None;
    }

    fn advance(&mut self, count: u16) {
        self.next = self.next.map(|next| next.wrapping_add(count));
        self.newest = self.newest.saturating_sub(count);
        let ahead = std::mem::take(&mut self.ahead);
        let moved = ahead
            .into_iter()
            // A key below `count` is dropped: that event is given up with the numbers before it.
            .filter_map(|(at, event)| Some((at.checked_sub(count)?, event)));
        self.ahead = moved.collect();
    }

    /// Delivers what is next, and requests what is missing then.
    fn follow(&mut self, now: Duration) {
        while let Some(event) = self.ahead.remove(&0) {
            self.deliver(Event::Received(event));
            self.advance(1);
            self.request = None;
        }
        if self.gap() == 0 {
            self.request = None;
        } else if self.request.is_none() {
            self.ask(now, TRIES - 1);
        }
    }

    fn ask(&mut self, now: Duration, left: u8) {
        let (Some(next), gap) = (self.next, self.gap()) else {
            return;
        };
        self.out.push(MavMessage::REQUEST_EVENT(REQUEST_EVENT_DATA {
            first_sequence: next,
            // PX4 sends an error for each number it no longer has, so one request for the whole gap is enough.
            last_sequence: next.wrapping_add(gap - 1),
            target_system: self.vehicle.system,
            target_component: self.vehicle.component,
        }));
        let due = now + AGAIN;
        self.request = Some(Request { due, left });
    }

    fn deliver(&mut self, event: Event) {
        let count = match event {
            Event::Received(_) => 1,
            Event::Lost(count) => count,
            Event::Restarted => 0,
        };
        if !self.events.push(event) {
            self.dropped = self.dropped.saturating_add(count);
        }
    }
}

/// Beyond a gap this wide nothing is requested or kept: PX4 keeps 20 events.
const MAX_AHEAD: u16 = 64;
/// As many events may overtake the message that names an earlier one: PX4 keeps no more.
const MAX_OVERTAKEN: u16 = 20;
const MAX_EVENTS: usize = 128;
const MAX_OUT: usize = 4;
/// How often a gap is requested.
const TRIES: u8 = 5;
const AGAIN: Duration = Duration::from_millis(500);

#[cfg(test)]
mod tests {
    use super::*;
    use mavlink::dialects::development::{
        CURRENT_EVENT_SEQUENCE_DATA, MavEventErrorReason, RESPONSE_EVENT_ERROR_DATA,
    };

    const US: Node = Node::new(245, 190);
    const VEHICLE: Node = Node::new(1, 1);
    const RESTARTED: i32 = 1_000_000;

    fn client() -> Client {
        Client::new(US, VEHICLE)
    }

    fn event(client: &mut Client, now: Duration, sequence: u16) {
        let data = EVENT_DATA {
            id: 1 << 24 | u32::from(sequence),
            sequence,
            log_levels: 0x64,
            ..EVENT_DATA::default()
        };
        assert!(client.handle_message(now, VEHICLE, &MavMessage::EVENT(data)));
    }

    fn current(client: &mut Client, now: Duration, sequence: u16, reset: bool) {
        let mut data = CURRENT_EVENT_SEQUENCE_DATA {
            sequence,
            flags: MavEventCurrentSequenceFlags::empty(),
        };
        let flag = MavEventCurrentSequenceFlags::MAV_EVENT_CURRENT_SEQUENCE_FLAGS_RESET;
        data.flags.set(flag, reset);
        client.handle_message(now, VEHICLE, &MavMessage::CURRENT_EVENT_SEQUENCE(data));
    }

    /// What was delivered: the numbers of events, and a minus sign before counts of lost ones.
    fn delivered(client: &mut Client) -> Vec<i32> {
        std::iter::from_fn(|| client.poll_event())
            .map(|event| match event {
                Event::Received(event) => i32::from(event.sequence),
                Event::Lost(count) => -i32::from(count),
                Event::Restarted => RESTARTED,
            })
            .collect()
    }

    fn requested(client: &mut Client) -> Vec<(u16, u16)> {
        std::iter::from_fn(|| client.poll_transmit())
            .map(|message| match message {
                MavMessage::REQUEST_EVENT(m) => (m.first_sequence, m.last_sequence),
                other => panic!("{other:?}"),
            })
            .collect()
    }

    #[test]
    fn lost_events_are_requested_and_delivered_in_order_also_where_the_numbers_wrap() {
        let (mut client, now) = (client(), Duration::ZERO);
        current(&mut client, now, 65_533, true);
        event(&mut client, now, 65_534);
        event(&mut client, now, 1);
        event(&mut client, now, 2);
        assert_eq!(delivered(&mut client), [65_534]);
        assert_eq!(requested(&mut client), [(65_535, 0)]);
        event(&mut client, now, 65_535);
        event(&mut client, now, 65_535);
        event(&mut client, now, 0);
        assert_eq!(delivered(&mut client), [65_535, 0, 1, 2]);
        // The last one of several is lost: only its number shows it.
        current(&mut client, now, 3, false);
        assert_eq!(requested(&mut client), [(3, 3)]);
        event(&mut client, now, 3);
        assert_eq!(delivered(&mut client), [3]);
        assert_eq!(client.poll_timeout(), None);
    }

    #[test]
    fn what_the_vehicle_no_longer_has_is_lost_and_the_rest_is_delivered() {
        let (mut client, now) = (client(), Duration::ZERO);
        event(&mut client, now, 10);
        event(&mut client, now, 15);
        assert_eq!(requested(&mut client), [(11, 14)]);
        let error = |sequence, oldest, target_system| {
            MavMessage::RESPONSE_EVENT_ERROR(RESPONSE_EVENT_ERROR_DATA {
                sequence,
                sequence_oldest_available: oldest,
                target_system,
                target_component: 190,
                reason: MavEventErrorReason::MAV_EVENT_ERROR_REASON_UNAVAILABLE,
            })
        };
        // Of another station's request.
        client.handle_message(now, VEHICLE, &error(11, 13, 255));
        assert_eq!(delivered(&mut client), [10]);
        client.handle_message(now, VEHICLE, &error(11, 13, 245));
        assert_eq!(delivered(&mut client), [-2]);
        assert_eq!(requested(&mut client), [(13, 14)]);
        event(&mut client, now, 13);
        event(&mut client, now, 14);
        assert_eq!(delivered(&mut client), [13, 14, 15]);
    }

    #[test]
    fn a_vehicle_that_never_answers_is_asked_five_times() {
        let (mut client, mut now) = (client(), Duration::ZERO);
        event(&mut client, now, 1);
        event(&mut client, now, 3);
        let mut requests = requested(&mut client).len();
        for _ in 0..20 {
            now += Duration::from_millis(500);
            client.handle_timeout(now);
            requests += requested(&mut client).len();
        }
        assert_eq!(requests, 5);
        assert_eq!(delivered(&mut client), [1, -1, 3]);
        assert_eq!(client.poll_timeout(), None);
    }

    #[test]
    fn jumps_and_storms_of_numbers_cost_neither_memory_nor_requests() {
        let (mut client, now) = (client(), Duration::ZERO);
        let mut sequence = 7_u16;
        for round in 0..10_000_u32 {
            sequence = sequence.wrapping_mul(31).wrapping_add(11 + round as u16);
            if round % 7 == 0 {
                current(&mut client, now, sequence.rotate_left(3), round % 21 == 0);
            }
            event(&mut client, now, sequence);
            assert!(client.ahead.len() <= usize::from(MAX_AHEAD));
            assert!(client.events.len() <= MAX_EVENTS);
            assert!(client.out.len() <= MAX_OUT);
        }
        assert!(delivered(&mut client).len() <= MAX_EVENTS + 1);
        client.reset();
        event(&mut client, now, 5);
        event(&mut client, now, 1_005);
        assert_eq!(delivered(&mut client), [5, -999, 1_005]);
        assert_eq!(client.poll_timeout(), None);
    }

    #[test]
    fn a_restart_with_a_gap_counts_it_and_keeps_what_is_there() {
        let (mut client, now) = (client(), Duration::ZERO);
        event(&mut client, now, 500);
        event(&mut client, now, 503);
        current(&mut client, now, 3, false);
        assert_eq!(delivered(&mut client), [500, 503, -2, RESTARTED]);
    }

    #[test]
    fn a_number_that_its_events_overtook_is_no_restart_but_one_named_twice_is() {
        let (mut client, now) = (client(), Duration::ZERO);
        event(&mut client, now, 500);
        event(&mut client, now, 501);
        current(&mut client, now, 500, false);
        current(&mut client, now, 500, false);
        assert_eq!(delivered(&mut client), [500, 501]);
        assert_eq!(requested(&mut client), []);
        current(&mut client, now, 501, false);
        let later = now + Duration::from_secs(3);
        current(&mut client, later, 490, false);
        assert_eq!(delivered(&mut client), []);
        current(&mut client, later + Duration::from_secs(3), 490, false);
        assert_eq!(delivered(&mut client), [RESTARTED]);
    }

    #[test]
    fn a_restart_begins_the_numbers_again_and_nothing_counts_as_lost() {
        let (mut client, now) = (client(), Duration::ZERO);
        event(&mut client, now, 500);
        // Its flag may be lost with its message: the number alone shows it.
        current(&mut client, now, 3, false);
        event(&mut client, now, 4);
        assert_eq!(delivered(&mut client), [500, RESTARTED, 4]);
        assert!(!client.handle_message(
            now,
            Node::new(2, 1),
            &MavMessage::EVENT(EVENT_DATA::default())
        ));
    }
}
