//! The CUCS as a state machine: datagrams and the time in, datagrams and events out.
//!
//! Promised: stamps rise strictly. A message that requests an acknowledgement is sent again, the same bytes, until a
//! 17000 of type 1, 2 or 3 has arrived or all tries are used up. Late or duplicate messages, and those for other
//! stations, change nothing. A 17000 is sent only for a message to this CUCS that requests one, and never for a
//! 17000.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use stanag_msgs::enums::{AckType, LoiBitmap, PresenceVectorSupport};
use stanag_msgs::messages::{Heartbeat, MessageAcknowledgement};
use stanag_msgs::table::Direction;
use stanag_msgs::wrapper::{Frame, frames};
use stanag_msgs::{Id, Message, TimeStamp, ed25};

use super::alert::{Alert, push_bounded};
use super::edition_25::Received;
use super::sender::{Delivery, Edition, Now, SendError, Sender, SessionConfig, Ticket};
use super::traffic::Traffic;
use super::vehicle::{Change, Vehicle};

/// Something that happened.
#[derive(Clone, Debug, PartialEq)]
pub enum Event {
    /// A message was accepted; periodic status, 16000 and 17000 are such events too.
    Message {
        /// The vehicle or VSM that sent it.
        from: Id,
        /// The message.
        message: Box<Message>,
    },
    /// An alert is complete, with all its parts.
    Alert {
        /// The vehicle that it is about.
        from: Id,
        /// The alert.
        alert: Alert,
    },
    /// Another CUCS requests rights that this one holds: message 4.
    HandoverRequested {
        /// The vehicle.
        vehicle: Id,
        /// The requesting CUCS.
        by: Id,
        /// The requested levels.
        loi: LoiBitmap,
    },
    /// The holder offers rights to this CUCS: message 5.
    HandoverOffered {
        /// The vehicle.
        vehicle: Id,
        /// The offered levels.
        loi: LoiBitmap,
    },
    /// A message that this CUCS sent has been answered.
    Answered {
        /// The message.
        ticket: Ticket,
        /// Its present state.
        delivery: Delivery,
    },
}

/// The state machine.
#[derive(Debug)]
pub struct Session {
    config: SessionConfig,
    sender: Sender,
    vehicles: BTreeMap<Id, Vehicle>,
    heartbeat_due: Option<Duration>,
    events: VecDeque<Event>,
    traffic: Traffic,
}

impl Session {
    /// A session that has received nothing yet.
    #[must_use]
    pub fn new(config: SessionConfig) -> Session {
        Session {
            config,
            sender: Sender::new(config),
            vehicles: BTreeMap::new(),
            heartbeat_due: None,
            events: VecDeque::new(),
            traffic: Traffic::default(),
        }
    }

    /// The id of this CUCS.
    #[must_use]
    pub fn id(&self) -> Id {
        self.config.id
    }

    /// The edition that it uses.
    #[must_use]
    pub fn edition(&self) -> Edition {
        self.config.edition
    }

    /// What this CUCS declares in messages 1 and 4: it accepts partial presence vectors. `None` in editions without
    /// the field.
    #[must_use]
    pub fn presence_vector_support(&self) -> Option<PresenceVectorSupport> {
        (self.config.edition == Edition::Ed4).then_some(PresenceVectorSupport::Partial)
    }

    /// Switches heartbeats (16002, 1 Hz) on or off. A CUCS that never sent one does not lose control by sending none.
    pub fn set_heartbeats(&mut self, now: Now, on: bool) {
        self.heartbeat_due = match self.heartbeat_due {
            Some(due) if on => Some(due),
            _ => on.then_some(now.mono),
        };
        self.handle_timeout(now);
    }

    /// Sends a message that requests an acknowledgement. Its Time Stamp is set when it is sent.
    ///
    /// # Errors
    /// The message cannot be written, or the edition cannot express it.
    pub fn send(
        &mut self,
        now: Now,
        destination: Id,
        message: impl Into<Message>,
    ) -> Result<Ticket, SendError> {
        let ticket = self.sender.submit(destination, message.into(), true)?;
        self.sender.advance(now, &mut self.traffic);
        Ok(ticket)
    }

    /// Sends several such messages, packed into as few datagrams as the window allows.
    ///
    /// # Errors
    /// One of them cannot be written; none is sent.
    pub fn send_all(
        &mut self,
        now: Now,
        destination: Id,
        messages: impl IntoIterator<Item = Message>,
    ) -> Result<Vec<Ticket>, SendError> {
        let mut tickets = Vec::new();
        for message in messages {
            match self.sender.submit(destination, message, true) {
                Ok(ticket) => tickets.push(ticket),
                Err(fault) => {
                    for ticket in tickets {
                        self.sender.withdraw(ticket);
                    }
                    return Err(fault);
                }
            }
        }
        self.sender.advance(now, &mut self.traffic);
        Ok(tickets)
    }

    /// Sends a message once, without requesting an acknowledgement.
    ///
    /// # Errors
    /// The message cannot be written.
    pub fn send_unconfirmed(
        &mut self,
        now: Now,
        destination: Id,
        message: impl Into<Message>,
    ) -> Result<Ticket, SendError> {
        let ticket = self.sender.submit(destination, message.into(), false)?;
        self.sender.advance(now, &mut self.traffic);
        Ok(ticket)
    }

    /// The delivery state of a message.
    #[must_use]
    pub fn delivery(&self, ticket: Ticket) -> Delivery {
        self.sender.delivery(ticket)
    }

    /// Message Type and Time Stamp of a recently sent message.
    #[must_use]
    pub fn sent(&self, ticket: Ticket) -> Option<(u16, TimeStamp)> {
        self.sender.sent(ticket)
    }

    /// The delivery state of a message of this type and stamp.
    #[must_use]
    pub fn acknowledgement(&self, message_type: u16, stamp: TimeStamp) -> Option<Delivery> {
        self.sender.answer(message_type, stamp)
    }

    /// Stops sending a message.
    pub fn withdraw(&mut self, ticket: Ticket) {
        self.sender.withdraw(ticket);
    }

    /// Sends the same bytes once more, now: for tests of duplicates.
    pub fn resend(&mut self, ticket: Ticket) {
        self.sender.resend(ticket, &mut self.traffic);
    }

    /// Handles a datagram from the VSM.
    pub fn handle_datagram(&mut self, now: Now, bytes: &[u8]) {
        let uses_25 = self.config.edition == Edition::Ed25;
        if uses_25 != ed25::is_ed25(bytes) {
            // A group carries the datagrams of all editions.
            self.traffic.drop("another edition");
        } else if uses_25 {
            for frame in ed25::frames(bytes) {
                match frame {
                    Ok(frame) => self.handle_ed25(now, &frame),
                    Err(fault) => self.traffic.drop(fault.reason()),
                }
            }
        } else {
            for frame in frames(bytes) {
                match frame {
                    Ok(frame) => self.handle_frame(now, &frame),
                    Err(fault) => self.traffic.drop(fault.reason()),
                }
            }
        }
        // The acknowledgements have made room in the window.
        self.sender.advance(now, &mut self.traffic);
    }

    fn handle_frame(&mut self, now: Now, frame: &Frame<'_>) {
        let header = frame.header;
        // Its own broadcasts, where the network returns them.
        if header.source == self.config.id {
            return self.traffic.drop("own");
        }
        if header.destination != self.config.id && header.destination != Id::BROADCAST {
            return self.traffic.drop("misaddressed");
        }
        let message = match Message::decode(header.message_type, frame.data) {
            Ok(message) => message,
            Err(fault) => return self.traffic.drop(fault.reason()),
        };
        let received = Received {
            source: header.source,
            destination: header.destination,
            message,
        };
        if self.take(now, received) {
            // Never for a 17000: two stations that acknowledge acknowledgements would never stop.
            let to_us = header.destination == self.config.id;
            if header.ack_requested && to_us && header.message_type != MessageAcknowledgement::ID {
                self.acknowledge(header.source, header.message_type, frame);
            }
        }
    }

    fn handle_ed25(&mut self, now: Now, frame: &ed25::Frame<'_>) {
        let Some(border) = self.sender.border() else {
            return;
        };
        match border.received(frame) {
            Ok(all) => {
                for received in all {
                    self.take(now, received);
                }
            }
            Err(reason) => self.traffic.drop(reason),
        }
    }

    /// Handles a message of any edition; true where it was used.
    fn take(&mut self, now: Now, received: Received) -> bool {
        let Received {
            source,
            destination,
            message,
        } = received;
        let message_type = message.id();
        let to_us = destination == self.config.id;
        let mut dropped = |reason| {
            self.traffic.drop(reason);
            false
        };
        // A group also carries the requests of other stations: their sender is not a vehicle.
        if !to_us && message.info().direction == Direction::ToVsm {
            return dropped("for a VSM");
        }
        match &message {
            Message::MessageAcknowledgement(answer) => self.take_answer(source, answer),
            // Broadcasts, and messages to other stations, are not about the rights of this CUCS.
            Message::VsmAuthorisationResponse(_)
            | Message::PositiveHandoverAuthorisationRequest(_)
            | Message::PositiveHandoverAuthorisationGranted(_)
                if !to_us =>
            {
                return dropped("for others");
            }
            _ => match self.take_report(now, source, &message) {
                Change::Taken | Change::Unused => {}
                Change::Late => {
                    self.traffic.drop("late");
                    return false;
                }
                Change::Alert(alert) => self.push_event(Event::Alert {
                    from: source,
                    alert,
                }),
                Change::HandoverRequested(by, loi) => self.push_event(Event::HandoverRequested {
                    vehicle: source,
                    by,
                    loi,
                }),
                Change::HandoverOffered(loi) => self.push_event(Event::HandoverOffered {
                    vehicle: source,
                    loi,
                }),
            },
        }
        self.traffic.received.count(message_type);
        self.push_event(Event::Message {
            from: source,
            message: Box::new(message),
        });
        true
    }

    fn take_report(&mut self, now: Now, source: Id, message: &Message) -> Change {
        let reports_vehicle = !matches!(message, Message::Heartbeat(_));
        // The number of vehicles is limited, whoever sends; and a heartbeat alone does not prove a vehicle.
        if !self.vehicles.contains_key(&source)
            && (!reports_vehicle || self.vehicles.len() >= MAX_VEHICLES)
        {
            return Change::Unused;
        }
        let vehicle = self
            .vehicles
            .entry(source)
            .or_insert_with(|| Vehicle::new(source, now.mono));
        vehicle.last_received = now.mono;
        vehicle.take(message)
    }

    fn take_answer(&mut self, source: Id, answer: &MessageAcknowledgement) {
        let (Some(message_type), Some(stamp), Some(kind)) = (
            answer.original_message_type,
            answer.original_message_time_stamp,
            answer.acknowledgement_type,
        ) else {
            return self.traffic.drop("incomplete acknowledgement");
        };
        match self.sender.acknowledged(source, message_type, stamp, kind) {
            Some((ticket, delivery)) => self.push_event(Event::Answered { ticket, delivery }),
            None => self.traffic.drop("unmatched acknowledgement"),
        }
    }

    fn acknowledge(&mut self, to: Id, message_type: u16, frame: &Frame<'_>) {
        let answer = MessageAcknowledgement {
            original_message_time_stamp: stamp_of(frame),
            original_message_type: Some(message_type),
            acknowledgement_type: Some(AckType::Received),
            ..MessageAcknowledgement::default()
        };
        // A 17000 always fits a datagram.
        let _ = self.sender.submit(to, answer.into(), false);
    }

    /// Handles what is due: retransmissions and the heartbeat.
    pub fn handle_timeout(&mut self, now: Now) {
        if let Some(due) = self.heartbeat_due
            && due <= now.mono
        {
            // Keeps the rhythm, unless a pause was longer than the period.
            let next = due + HEARTBEAT;
            self.heartbeat_due = Some(if next > now.mono {
                next
            } else {
                now.mono + HEARTBEAT
            });
            // A heartbeat always fits a datagram.
            let _ = self
                .sender
                .submit(Id::BROADCAST, Heartbeat::default().into(), false);
        }
        self.sender.advance(now, &mut self.traffic);
    }

    /// When [`Session::handle_timeout`] is next needed.
    #[must_use]
    pub fn poll_timeout(&self) -> Option<Duration> {
        let again = self.sender.poll_timeout();
        again.into_iter().chain(self.heartbeat_due).min()
    }

    /// The next datagram for the VSM.
    pub fn poll_transmit(&mut self) -> Option<Vec<u8>> {
        self.sender.poll_transmit()
    }

    /// The next event. Where nobody polls events, the oldest are dropped.
    pub fn poll_event(&mut self) -> Option<Event> {
        self.events.pop_front()
    }

    /// Returns polled events that somebody else is to read.
    pub(crate) fn put_back(&mut self, events: Vec<Event>) {
        self.events.extend(events);
    }

    /// A vehicle from which a message was received.
    #[must_use]
    pub fn vehicle(&self, id: Id) -> Option<&Vehicle> {
        self.vehicles.get(&id)
    }

    /// All vehicles from which messages were received, by rising id.
    pub fn vehicles(&self) -> impl Iterator<Item = &Vehicle> {
        self.vehicles.values()
    }

    /// Discards the received plan of a vehicle: what arrives from now on is a new download.
    pub fn start_download(&mut self, vehicle: Id) {
        if let Some(vehicle) = self.vehicles.get_mut(&vehicle) {
            vehicle.download.clear();
        }
    }

    /// The counters.
    #[must_use]
    pub fn traffic(&self) -> &Traffic {
        &self.traffic
    }

    fn push_event(&mut self, event: Event) {
        push_bounded(&mut self.events, event, MAX_EVENTS);
    }
}

/// The Time Stamp on the wire: field 1 of every message.
fn stamp_of(frame: &Frame<'_>) -> Option<TimeStamp> {
    let info = stanag_msgs::table::message(frame.header.message_type)?;
    let presence = usize::from(info.presence_bytes);
    let (vector, fields) = frame.data.split_at_checked(presence)?;
    if vector.last()? & 1 == 0 || info.fields.first()?.wire.bytes() != Some(5) {
        return None;
    }
    let bytes = fields.get(..5)?;
    Some(TimeStamp(
        bytes
            .iter()
            .fold(0, |stamp, byte| stamp << 8 | u64::from(*byte)),
    ))
}

/// Period of 16002.
const HEARTBEAT: Duration = Duration::from_secs(1);
/// Vehicles that are kept; further ones are ignored.
const MAX_VEHICLES: usize = 256;
/// Events that wait; beyond that the oldest are dropped.
const MAX_EVENTS: usize = 4_096;
