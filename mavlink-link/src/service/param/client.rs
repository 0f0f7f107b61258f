//! The client: one request at a time, the rest in a queue.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use mavlink::dialects::development::{
    MavMessage, MavParamError, PARAM_ERROR_DATA, PARAM_REQUEST_LIST_DATA, PARAM_REQUEST_READ_DATA,
    PARAM_SET_DATA, PARAM_VALUE_DATA,
};

use mavlink::types::CharArray;

use super::value::{HASH_CHECK, NO_INDEX, Name, Value};
use crate::frame::Node;
use crate::service::bounded::Bounded;

/// Waits and repeats.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Timing {
    /// Wait for an answer before a repeat. PX4 answers in 1 ms; the rest is the radio.
    pub answer: Duration,
    /// How often a request is sent in all, and how many rounds of a list may pass without a new parameter.
    pub tries: u8,
    /// Missing parameters of a list that are requested in one round.
    pub window: u8,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            answer: Duration::from_millis(700),
            tries: 8,
            window: 10,
        }
    }
}

/// One parameter of a list.
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Entry {
    /// PARAM_VALUE.param_id
    pub name: Name,
    /// PARAM_VALUE.param_value
    pub value: Value,
}

/// Why a parameter was neither read nor set.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Refusal {
    /// PARAM_ERROR.error
    Error(MavParamError),
    /// No answer to any try.
    NoAnswer,
    /// After PARAM_SET the vehicle still reports another value.
    OtherValue(Value),
}

/// What a [`Client`] reports; every request ends in one event that is not progress.
#[derive(Clone, PartialEq, Debug)]
pub enum Event {
    /// The answer to a read.
    Read {
        /// Which parameter.
        name: Name,
        /// Its value.
        value: Value,
    },
    /// The vehicle reports the value that was set.
    Set {
        /// Which parameter.
        name: Name,
        /// Its value.
        value: Value,
    },
    /// A read or a set that failed.
    Refused {
        /// Which parameter.
        name: Name,
        /// Why.
        reason: Refusal,
    },
    /// Progress of a list. Unread progress is replaced, not queued.
    Progress {
        /// Parameters received.
        have: usize,
        /// PARAM_VALUE.param_count
        total: u16,
    },
    /// The whole list, in the vehicle's order.
    List {
        /// All parameters that the vehicle uses.
        entries: Vec<Entry>,
        /// The value of _HASH_CHECK, if received.
        hash: Option<u32>,
    },
    /// A list that stayed incomplete.
    ListFailed {
        /// Parameters received.
        have: usize,
        /// PARAM_VALUE.param_count, 0 when nothing was received.
        total: u16,
    },
}

/// Why a request was not accepted.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum StartError {
    /// Too many wait already, or too many events are unread.
    #[error("{0} parameter requests are waiting already")]
    Full(usize),
}

/// The parameters of one node, as a ground station uses them.
#[derive(Debug)]
pub struct Client {
    us: Node,
    vehicle: Node,
    timing: Timing,
    waiting: VecDeque<Request>,
    active: Option<Active>,
    out: Bounded<MavMessage>,
    events: Bounded<Event>,
}

#[derive(Clone, Copy, Debug)]
enum Request {
    Read(Name),
    Set(Name, Value),
    List,
}

#[derive(Debug)]
struct Active {
    job: Job,
    tries: u8,
    deadline: Duration,
}

#[derive(Debug)]
enum Job {
    Read(Name),
    Set {
        name: Name,
        value: Value,
        other: Option<Value>,
    },
    List(List),
}

#[derive(Debug, Default)]
struct List {
    total: u16,
    entries: BTreeMap<u16, Entry>,
    hash: Option<u32>,
}

impl Client {
    /// A client named `us` on the link, for the parameters of `vehicle`.
    pub const fn new(us: Node, vehicle: Node, timing: Timing) -> Self {
        Self {
            us,
            vehicle,
            timing,
            waiting: VecDeque::new(),
            active: None,
            out: Bounded::new(MAX_OUT),
            events: Bounded::new(MAX_EVENTS),
        }
    }

    /// Queues the reading of a parameter.
    ///
    /// # Errors
    /// Too many requests are waiting, or too many events are unread.
    pub fn read(&mut self, now: Duration, name: Name) -> Result<(), StartError> {
        self.enqueue(now, Request::Read(name))
    }

    /// Queues the setting of a parameter. PX4 does not check the range: the caller must.
    ///
    /// # Errors
    /// Too many requests are waiting, or too many events are unread.
    pub fn set(&mut self, now: Duration, name: Name, value: Value) -> Result<(), StartError> {
        self.enqueue(now, Request::Set(name, value))
    }

    /// Queues the reading of all parameters.
    ///
    /// # Errors
    /// Too many requests are waiting, or too many events are unread.
    pub fn list(&mut self, now: Duration) -> Result<(), StartError> {
        self.enqueue(now, Request::List)
    }

    /// Requests that have not ended.
    pub fn pending(&self) -> usize {
        self.waiting.len() + usize::from(self.active.is_some())
    }

    /// Takes a message of `from`; `fresh` is false when it may be a replay.
    ///
    /// Returns whether it answered the current request.
    pub fn handle_message(
        &mut self,
        now: Duration,
        from: Node,
        message: &MavMessage,
        fresh: bool,
    ) -> bool {
        if from != self.vehicle || !fresh {
            return false;
        }
        let Some(mut active) = self.active.take() else {
            return false;
        };
        let (taken, end) = match message {
            MavMessage::PARAM_VALUE(data) => self.handle_value(now, &mut active, data),
            MavMessage::PARAM_ERROR(data) => {
                let end = self.handle_error(&active.job, data);
                (end.is_some(), end)
            }
            _ => (false, None),
        };
        match end {
            Some(event) => self.finish(now, event),
            None => self.active = Some(active),
        }
        taken
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Duration) {
        let Some(mut active) = self.active.take_if(|active| active.deadline <= now) else {
            return;
        };
        if active.tries >= self.timing.tries {
            let event = match active.job {
                Job::Read(name) => refused(name, Refusal::NoAnswer),
                Job::Set { name, other, .. } => {
                    refused(name, other.map_or(Refusal::NoAnswer, Refusal::OtherValue))
                }
                Job::List(list) => Event::ListFailed {
                    have: list.entries.len(),
                    total: list.total,
                },
            };
            self.finish(now, event);
            return;
        }
        active.tries += 1;
        active.deadline = now + self.timing.answer;
        // What a slow link had no room for yet is replaced, not sent twice.
        self.out.clear();
        self.send(&active.job);
        self.active = Some(active);
    }

    /// When [`Client::handle_timeout`] is next needed.
    pub fn poll_timeout(&self) -> Option<Duration> {
        self.active.as_ref().map(|active| active.deadline)
    }

    /// The next message for the vehicle.
    pub fn poll_transmit(&mut self) -> Option<MavMessage> {
        self.out.pop()
    }

    /// The next event.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop()
    }

    fn enqueue(&mut self, now: Duration, request: Request) -> Result<(), StartError> {
        let pending = self.pending();
        // One event is kept free for progress.
        if pending + self.events.len() + 1 >= MAX_EVENTS {
            return Err(StartError::Full(pending));
        }
        self.waiting.push_back(request);
        self.advance(now);
        Ok(())
    }

    fn advance(&mut self, now: Duration) {
        if self.active.is_some() {
            return;
        }
        let Some(request) = self.waiting.pop_front() else {
            return;
        };
        let job = match request {
            Request::Read(name) => Job::Read(name),
            Request::Set(name, value) => Job::Set {
                name,
                value,
                other: None,
            },
            Request::List => Job::List(List::default()),
        };
        self.send(&job);
        self.active = Some(Active {
            job,
            tries: 1,
            deadline: now + self.timing.answer,
        });
    }

    fn finish(&mut self, now: Duration, event: Event) {
        // What a slow link had no room for yet is not sent after its end was reported.
        self.out.clear();
        if matches!(self.events.last_mut(), Some(Event::Progress { .. })) {
            self.events.pop_last();
        }
        self.events.push(event);
        self.advance(now);
    }

    /// Whether the value was for the current request, and the event that ends it.
    fn handle_value(
        &mut self,
        now: Duration,
        active: &mut Active,
        data: &PARAM_VALUE_DATA,
    ) -> (bool, Option<Event>) {
        let Some(got) = Name::from_wire(&data.param_id) else {
            return (false, None);
        };
        let Some(value) = Value::from_wire(data.param_value, data.param_type) else {
            return (false, None);
        };
        match &mut active.job {
            // PARAM_VALUE has no target fields: an answer to another station has the same value, and serves as well.
            Job::Read(name) if *name == got => (true, Some(Event::Read { name: got, value })),
            Job::Set {
                name,
                value: wanted,
                other,
            } if *name == got => {
                if *wanted == value {
                    return (true, Some(Event::Set { name: got, value }));
                }
                // It may answer an earlier request: the retry decides.
                *other = Some(value);
                (true, None)
            }
            Job::List(list) => {
                if got.as_str() == HASH_CHECK {
                    // The hash's bits travel in the float (byte union), and its index is 65535.
                    list.hash = Some(data.param_value.to_bits());
                } else if data.param_count > MAX_COUNT {
                    // Gaps of such a list cannot be requested: it would only fail later, after all that it claims to have.
                    let (have, total) = (list.entries.len(), data.param_count);
                    return (true, Some(Event::ListFailed { have, total }));
                } else if data.param_index != NO_INDEX && data.param_index < data.param_count {
                    // Never index 65535, which PX4 sends for a parameter not in use yet: it has no place in the list.
                    let entry = Entry { name: got, value };
                    if data.param_count < list.total {
                        // The vehicle has stopped using a parameter while it sent the list: entries beyond are stale.
                        list.entries.split_off(&data.param_count);
                    }
                    list.total = data.param_count;
                    if list.entries.insert(data.param_index, entry).is_none() {
                        // The vehicle still sends the list: the deadline counts from its last new entry.
                        active.tries = 1;
                        active.deadline = now + self.timing.answer;
                    }
                }
                (true, self.list_progress(list))
            }
            Job::Read(_) | Job::Set { .. } => (false, None),
        }
    }

    fn list_progress(&mut self, list: &mut List) -> Option<Event> {
        let have = list.entries.len();
        // Counted, since no entry is beyond the total: to look for gaps at each value would take time with the square of what a
        // vehicle claims to have.
        if list.total > 0 && have == usize::from(list.total) {
            let entries = std::mem::take(&mut list.entries);
            return Some(Event::List {
                entries: entries.into_values().collect(),
                hash: list.hash,
            });
        }
        let total = list.total;
        let event = Event::Progress { have, total };
        match self.events.last_mut() {
            Some(last @ Event::Progress { .. }) => *last = event,
            _ => {
                self.events.push(event);
            }
        }
        None
    }

    fn handle_error(&self, job: &Job, data: &PARAM_ERROR_DATA) -> Option<Event> {
        if !self.us.is_target(data.target_system, data.target_component) {
            return None;
        }
        // PX4 leaves param_index uninitialised in PARAM_ERROR: only the name identifies the parameter.
        let about = Name::from_wire(&data.param_id)?;
        match job {
            Job::Read(name) | Job::Set { name, .. } if *name == about => {
                Some(refused(about, Refusal::Error(data.error)))
            }
            _ => None,
        }
    }

    fn send(&mut self, job: &Job) {
        match job {
            Job::Read(name) => self.request_read(Some(*name), -1),
            Job::Set { name, value, .. } => {
                self.out.push(MavMessage::PARAM_SET(PARAM_SET_DATA {
                    param_value: value.to_wire(),
                    target_system: self.vehicle.system,
                    target_component: self.vehicle.component,
                    param_id: name.to_wire(),
                    param_type: value.kind(),
                }));
            }
            // Nothing arrived: request the whole list again. Once part of it has arrived, only the gaps are requested: the
            // whole list would take the link for as long again.
            Job::List(list) if list.entries.is_empty() => {
                self.out
                    .push(MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
                        target_system: self.vehicle.system,
                        target_component: self.vehicle.component,
                    }));
            }
            Job::List(list) => {
                let window = usize::from(self.timing.window);
                for index in list.missing().take(window) {
                    // PARAM_REQUEST_READ.param_index is signed. No list is longer (`MAX_COUNT`).
                    if let Ok(index) = i16::try_from(index) {
                        self.request_read(None, index);
                    }
                }
            }
        }
    }

    fn request_read(&mut self, name: Option<Name>, param_index: i16) {
        let request = PARAM_REQUEST_READ_DATA {
            param_index,
            target_system: self.vehicle.system,
            target_component: self.vehicle.component,
            param_id: name.map_or(CharArray::new([0; 16]), Name::to_wire),
        };
        self.out.push(MavMessage::PARAM_REQUEST_READ(request));
    }
}

impl List {
    fn missing(&self) -> impl Iterator<Item = u16> + '_ {
        (0..self.total).filter(|index| !self.entries.contains_key(index))
    }
}

/// Requests and unread events together.
const MAX_EVENTS: usize = 64;
const MAX_OUT: usize = 64;
/// Parameters of a list: PARAM_REQUEST_READ.param_index is an i16, so no index above 32767 can be requested.
const MAX_COUNT: u16 = 32_768;

fn refused(name: Name, reason: Refusal) -> Event {
    Event::Refused { name, reason }
}

#[cfg(test)]
mod tests {
    use std::time::Instant;

    use mavlink::dialects::development::MavParamType;

    use super::*;

    const US: Node = Node::new(245, 190);
    const PX4: Node = Node::new(1, 1);

    fn listing() -> Client {
        let mut client = Client::new(US, PX4, Timing::default());
        client.list(Duration::ZERO).expect("nothing waits");
        client
    }

    fn report(client: &mut Client, param_index: u16, param_count: u16) -> Option<Event> {
        let name = Name::new(&format!("P{param_index}")).expect("a name");
        let value = MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
            param_value: 1.0,
            param_count,
            param_index,
            param_id: name.to_wire(),
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
        });
        client.handle_message(Duration::ZERO, PX4, &value, true);
        client.poll_event()
    }

    fn names(event: Option<Event>) -> Vec<String> {
        let Some(Event::List { entries, .. }) = event else {
            panic!("{event:?}");
        };
        let names = entries.iter().map(|entry| entry.name.as_str().to_owned());
        names.collect()
    }

    #[test]
    fn a_list_that_shrinks_while_it_is_sent_is_whole_without_its_end() {
        let mut client = listing();
        for index in [0, 1, 3] {
            let have = report(&mut client, index, 4);
            assert!(matches!(have, Some(Event::Progress { .. })), "{have:?}");
        }
        assert_eq!(names(report(&mut client, 2, 3)), ["P0", "P1", "P2"]);
    }

    #[test]
    fn a_list_takes_no_more_time_for_each_value_the_longer_it_is() {
        let (mut client, begun) = (listing(), Instant::now());
        let mut last = None;
        for index in 0..MAX_COUNT {
            last = report(&mut client, index, MAX_COUNT);
        }
        assert_eq!(names(last).len(), usize::from(MAX_COUNT));
        // To look for gaps at each value took minutes.
        let took = begun.elapsed();
        assert!(took < Duration::from_secs(10), "{took:?}");
    }

    #[test]
    fn a_list_whose_gaps_could_not_be_requested_fails_at_once() {
        let mut client = listing();
        let failed = report(&mut client, 0, MAX_COUNT + 1);
        let expected = Event::ListFailed {
            have: 0,
            total: MAX_COUNT + 1,
        };
        assert_eq!(failed, Some(expected));
        assert_eq!(client.pending(), 0);
    }
}
