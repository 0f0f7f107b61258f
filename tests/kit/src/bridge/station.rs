//! A ground station for tests: the session of the `cucs` crate, and a record of everything that arrives.
//!
//! The session stamps, encodes and repeats as a CUCS does. A test needs more than a CUCS: to repeat a message until
//! its final answer comes, however long that takes; to send one with a stamp of its own choice; and to see what a
//! CUCS drops (messages for others, late ones, each single 17000).

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::time::Duration;

use cucs::{Session, SessionConfig};
use mavlink_link::Now;
use stanag_msgs::enums::AckType;
use stanag_msgs::messages::MessageAcknowledgement;
use stanag_msgs::{ChecksumStyle, Envelope, Id, MAX_DATAGRAM, Message, TimeStamp, frames};

/// A message that a station sent, by which its answers are looked up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Ticket(usize);

/// The station.
#[derive(Debug)]
pub struct Station {
    /// Its id.
    pub id: Id,
    /// Where it sends from.
    pub address: SocketAddr,
    /// Whether it sends 16002 at 1 Hz.
    pub heartbeats: bool,
    /// Whether it acknowledges (17000) messages that request it, as the standard requires; not every CUCS does.
    pub acknowledges: bool,
    /// A message without a final answer is sent again after this time.
    pub retry: Duration,
    /// The latest message of each type, by source.
    pub latest: BTreeMap<(Id, u16), Message>,
    /// Everything that arrived except acknowledgements, in order.
    pub received: Vec<(Duration, Id, Message)>,
    /// Number of messages that arrived here but were for another station.
    pub misaddressed: u64,
    session: Session,
    sent: Vec<Sent>,
    out: Vec<Vec<u8>>,
}

#[derive(Debug)]
struct Sent {
    ticket: cucs::Ticket,
    again_at: Option<Duration>,
    answers: Vec<AckType>,
}

impl Station {
    /// A station that has sent nothing yet.
    pub fn new(id: Id, address: SocketAddr) -> Station {
        let config = SessionConfig {
            // Without a checksum a message with an inverted bit would be accepted as another message.
            checksum: ChecksumStyle::Crc32,
            // Repeated here instead: also after 17000 type 1, until the final answer.
            tries: 1,
            ..SessionConfig::new(id)
        };
        Station {
            id,
            address,
            heartbeats: false,
            acknowledges: true,
            retry: RETRY,
            latest: BTreeMap::new(),
            received: Vec::new(),
            misaddressed: 0,
            session: Session::new(config),
            sent: Vec::new(),
            out: Vec::new(),
        }
    }

    /// Sends a message repeatedly until it is carried out or refused.
    pub fn send(&mut self, now: Now, to: Id, message: Message) -> Ticket {
        let sent = self.session.send(cucs_time(now), to, message);
        self.sent.push(Sent {
            ticket: sent.expect(FITS),
            again_at: Some(now.mono + self.retry),
            answers: Vec::new(),
        });
        Ticket(self.sent.len() - 1)
    }

    /// Sends a message once, with no answer requested.
    pub fn send_once(&mut self, now: Now, to: Id, message: Message) {
        let sent = self.session.send_unconfirmed(cucs_time(now), to, message);
        sent.expect(FITS);
    }

    /// Sends a message once, unchanged: the test has set its stamp.
    pub fn send_as_is(&mut self, to: Id, message: &Message) {
        let envelope = Envelope::new(self.id, to).summed(ChecksumStyle::Crc32);
        let mut bytes = [0; MAX_DATAGRAM];
        let length = message.encode(&envelope, &mut bytes).expect(FITS);
        self.out.push(bytes[..length].to_vec());
    }

    /// Sends the same bytes of a message once more.
    pub fn repeat(&mut self, ticket: Ticket) {
        self.session.resend(self.sent[ticket.0].ticket);
    }

    /// Stops sending it.
    pub fn give_up(&mut self, ticket: Ticket) {
        self.sent[ticket.0].again_at = None;
        self.session.withdraw(self.sent[ticket.0].ticket);
    }

    /// The answers to it so far, in order, repetitions included.
    pub fn answers(&self, ticket: Ticket) -> &[AckType] {
        &self.sent[ticket.0].answers
    }

    /// The final answer: carried out or refused.
    pub fn end(&self, ticket: Ticket) -> Option<AckType> {
        let mut answers = self.answers(ticket).iter().copied();
        answers.find(|answer| *answer != AckType::Received)
    }

    /// What `pick` returns for the latest message of a type.
    pub fn last<T>(
        &self,
        from: Id,
        message_type: u16,
        pick: impl Fn(&Message) -> Option<T>,
    ) -> Option<T> {
        self.latest.get(&(from, message_type)).and_then(pick)
    }

    /// The text of every 16000, in order, parts joined.
    pub fn alerts(&self) -> Vec<String> {
        let mut texts: Vec<String> = Vec::new();
        for (_, _, message) in &self.received {
            if let Message::SubsystemStatusAlert(alert) = message {
                let text = alert.text.as_ref().map_or("", |text| text.as_str());
                match (alert.append_order, texts.last_mut()) {
                    (Some(2..), Some(before)) => before.push_str(text),
                    _ => texts.push(text.to_owned()),
                }
            }
        }
        texts
    }

    /// Whether an alert contained this text.
    pub fn has_alert(&self, text: &str) -> bool {
        self.alerts().iter().any(|alert| alert.contains(text))
    }

    /// Does what is due; returns the datagrams to send.
    pub fn advance(&mut self, now: Now) -> Vec<Vec<u8>> {
        self.session.set_heartbeats(cucs_time(now), self.heartbeats);
        for sent in &mut self.sent {
            if sent.again_at.is_some_and(|at| at <= now.mono) {
                sent.again_at = Some(now.mono + self.retry);
                self.session.resend(sent.ticket);
            }
        }
        let mut out = std::mem::take(&mut self.out);
        out.extend(std::iter::from_fn(|| self.session.poll_transmit()));
        if !self.acknowledges {
            out.retain(|bytes| {
                bytes.get(12..14) != Some(&MessageAcknowledgement::ID.to_be_bytes())
            });
        }
        out
    }

    /// Receives a datagram.
    pub fn receive(&mut self, now: Now, bytes: &[u8]) {
        self.session.handle_datagram(cucs_time(now), bytes);
        // The session's events leave out what a CUCS drops, so the test reads the datagram itself.
        while self.session.poll_event().is_some() {}
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
                let about = answer.original_message_type;
                if let Some(about) = about.zip(answer.original_message_time_stamp)
                    && let Some(kind) = answer.acknowledgement_type
                {
                    self.note_answer(about, kind);
                }
                continue;
            }
            self.received
                .push((now.mono, header.source, message.clone()));
            self.latest
                .insert((header.source, header.message_type), message);
        }
    }

    fn note_answer(&mut self, about: (u16, TimeStamp), kind: AckType) {
        for sent in &mut self.sent {
            if self.session.sent(sent.ticket) == Some(about) {
                sent.answers.push(kind);
                if kind != AckType::Received {
                    sent.again_at = None;
                }
            }
        }
    }
}

fn cucs_time(now: Now) -> cucs::Now {
    cucs::Now {
        mono: now.mono,
        unix_ms: now.wall.as_millis() as u64,
    }
}

const FITS: &str = "a message of a test fits a datagram";
/// The default of [`Station::retry`].
const RETRY: Duration = Duration::from_millis(500);
