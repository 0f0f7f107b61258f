//! A ground station of a few lines: stamps that rise, repeats until it is told the end, everything heard is kept.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::Duration;

use stanag_msgs::enums::AckType;
use stanag_msgs::messages::Heartbeat;
use stanag_msgs::{ChecksumStyle, Envelope, Id, MAX_DATAGRAM, Message, TimeStamp, frames};

/// A message of a station, to ask after it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ticket(usize);

/// The station.
#[derive(Debug)]
pub struct Station {
    pub id: Id,
    pub address: SocketAddr,
    /// Sends 16002 at 1 Hz.
    pub heartbeats: bool,
    /// What is not answered is sent again after this time.
    pub retry: Duration,
    /// The latest message of each type, by source.
    pub latest: BTreeMap<(Id, u16), Message>,
    /// Everything heard but acknowledgements, in order.
    pub heard: Vec<(Duration, Id, Message)>,
    /// Messages that were for another station, and came here.
    pub misaddressed: u64,
    sent: Vec<Sent>,
    out: Vec<Vec<u8>>,
    last_stamp: u64,
    heartbeat_due: Duration,
}

#[derive(Debug)]
struct Sent {
    message_type: u16,
    stamp: TimeStamp,
    bytes: Vec<u8>,
    again_at: Option<Duration>,
    answers: Vec<AckType>,
}

impl Station {
    pub fn new(id: Id, address: SocketAddr) -> Station {
        Station {
            id,
            address,
            heartbeats: false,
            retry: AGAIN,
            latest: BTreeMap::new(),
            heard: Vec::new(),
            misaddressed: 0,
            sent: Vec::new(),
            out: Vec::new(),
            last_stamp: 0,
            heartbeat_due: Duration::ZERO,
        }
    }

    /// Sends a message, again and again until it is answered by carried out or refused.
    pub fn tell(&mut self, now: Duration, wall: Duration, to: Id, message: &mut Message) -> Ticket {
        let stamp = self.stamp(wall);
        set_stamp(message, stamp);
        let bytes = encoded(message, &self.envelope(to).requesting_ack());
        self.sent.push(Sent {
            message_type: message.id(),
            stamp,
            bytes,
            again_at: Some(now),
            answers: Vec::new(),
        });
        Ticket(self.sent.len() - 1)
    }

    /// Sends a message once, asking for nothing.
    pub fn say(&mut self, wall: Duration, to: Id, message: &mut Message) {
        let stamp = self.stamp(wall);
        set_stamp(message, stamp);
        self.out.push(encoded(message, &Envelope::new(self.id, to)));
    }

    /// Sends a message once, as it is, its stamp too.
    pub fn say_as_is(&mut self, to: Id, message: &Message) {
        self.out.push(encoded(message, &self.envelope(to)));
    }

    /// Sends the very bytes of a message once more.
    pub fn repeat(&mut self, ticket: Ticket) {
        self.out.push(self.sent[ticket.0].bytes.clone());
    }

    /// Stops sending it.
    pub fn give_up(&mut self, ticket: Ticket) {
        self.sent[ticket.0].again_at = None;
    }

    /// The answers to it so far, in order, repeated ones included.
    pub fn answers(&self, ticket: Ticket) -> &[AckType] {
        &self.sent[ticket.0].answers
    }

    /// How it ended.
    pub fn end(&self, ticket: Ticket) -> Option<AckType> {
        let mut answers = self.answers(ticket).iter().copied();
        answers.find(|answer| *answer != AckType::Received)
    }

    /// The latest message of a type.
    pub fn last<T>(
        &self,
        from: Id,
        message_type: u16,
        pick: impl Fn(&Message) -> Option<T>,
    ) -> Option<T> {
        self.latest.get(&(from, message_type)).and_then(pick)
    }

    /// Every text of 16000, in order, parts joined.
    pub fn alerts(&self) -> Vec<String> {
        let mut texts: Vec<String> = Vec::new();
        for (_, _, message) in &self.heard {
            if let Message::SubsystemStatusAlert(alert) = message {
                let text = alert.text.as_ref().map_or("", |text| text.as_str());
                match alert.append_order {
                    Some(order) if order > 1 => {
                        if let Some(before) = texts.last_mut() {
                            before.push_str(text);
                        }
                    }
                    _ => texts.push(text.to_owned()),
                }
            }
        }
        texts
    }

    /// Whether an alert held this text.
    pub fn was_told(&self, text: &str) -> bool {
        self.alerts().iter().any(|alert| alert.contains(text))
    }

    /// Does what is due; the datagrams to send.
    pub fn advance(&mut self, now: Duration, wall: Duration) -> Vec<Vec<u8>> {
        if self.heartbeats && self.heartbeat_due <= now {
            self.heartbeat_due = now + Duration::from_secs(1);
            self.say(wall, Id::BROADCAST, &mut Heartbeat::default().into());
        }
        let mut out = std::mem::take(&mut self.out);
        for sent in &mut self.sent {
            if sent.again_at.is_some_and(|at| at <= now) {
                sent.again_at = Some(now + self.retry);
                out.push(sent.bytes.clone());
            }
        }
        out
    }

    /// Takes a datagram.
    pub fn receive(&mut self, now: Duration, bytes: &[u8]) {
        for frame in frames(bytes) {
            let Ok(frame) = frame else { continue };
            let header = frame.header;
            if header.destination != self.id && header.destination != Id::BROADCAST {
                self.misaddressed += 1;
                continue;
            }
            let Ok(message) = Message::decode(header.message_type, frame.data) else {
                continue;
            };
            if let Message::MessageAcknowledgement(answer) = &message {
                for sent in &mut self.sent {
                    if answer.original_message_type == Some(sent.message_type)
                        && answer.original_message_time_stamp == Some(sent.stamp)
                        && let Some(kind) = answer.acknowledgement_type
                    {
                        sent.answers.push(kind);
                        if kind != AckType::Received {
                            sent.again_at = None;
                        }
                    }
                }
                continue;
            }
            self.heard.push((now, header.source, message.clone()));
            self.latest
                .insert((header.source, header.message_type), message);
        }
    }

    /// Summed: without, a bent bit is another message.
    fn envelope(&self, to: Id) -> Envelope {
        Envelope::new(self.id, to).summed(ChecksumStyle::Crc32)
    }

    fn stamp(&mut self, wall: Duration) -> TimeStamp {
        let now = TimeStamp::from_unix_ms(wall.as_millis() as u64).0;
        self.last_stamp = now.max(self.last_stamp + 1);
        TimeStamp(self.last_stamp)
    }
}

fn encoded(message: &Message, envelope: &Envelope) -> Vec<u8> {
    let mut bytes = [0; MAX_DATAGRAM];
    let length = message
        .encode(envelope, &mut bytes)
        .expect("a message of ours fits a datagram");
    bytes[..length].to_vec()
}

/// Field 1 of every message.
fn set_stamp(message: &mut Message, stamp: TimeStamp) {
    macro_rules! set {
        ($($kind:ident),*) => {
            match message {
                // Its stamp is a float.
                Message::CurveSegmentPaper(m) => m.time_stamp = Some(stamp.0 as f64),
                $(Message::$kind(m) => m.time_stamp = Some(stamp),)*
                other => panic!("message {} is not one that a station sends", other.id()),
            }
        };
    }
    set!(
        CucsAuthorisationRequest,
        PositiveHandoverAuthorisationRequest,
        VehicleDataLinkTransitionCoordination,
        VehicleConfigurationCommand,
        UnmannedAircraftLights,
        EngineCommand,
        UaStickCommand,
        VehicleOperatingModeCommand,
        LoiterConfiguration,
        MissionTransferCommand,
        UaRoute,
        UaPositionWaypoint,
        UaLoiterWaypoint,
        CurveSegment,
        FieldConfigurationRequest,
        ScheduleMessageUpdateCommand,
        GenericInformationRequestMessage,
        ParameterRequest,
        ParameterSetCommand,
        PingRequest,
        AreaVertex,
        AreaTransferCommand,
        SubsystemStatusRequest,
        SubsystemStatusDetailRequest,
        Heartbeat
    );
}

const AGAIN: Duration = Duration::from_millis(500);
