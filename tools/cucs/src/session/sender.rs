//! Messages on their way to the VSM: stamps that rise strictly, a window, the same bytes again until an answer comes.
//!
//! "Received" is not the end: the 17000 with the outcome can be lost as well, and the VSM sends it once. So the same
//! bytes are sent again, more slowly, until the outcome is known or the message is withdrawn; the VSM recognises the
//! duplicate and only repeats its last answer.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use stanag_msgs::enums::AckType;
use stanag_msgs::wrapper::{ChecksumStyle, Header};
use stanag_msgs::{EncodeError, Envelope, Id, MAX_DATAGRAM, Message, Packer, TimeStamp};

use super::edition_25::{Border, NoCounterpart, STAMPS_EACH};
use super::traffic::Traffic;

/// One time on two clocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Now {
    /// Time since any fixed start, never decreasing: for timeouts.
    pub mono: Duration,
    /// Unix time in ms: for stamps.
    pub unix_ms: u64,
}

/// Identifies a message that a session sends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Ticket(u64);

/// The state of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Delivery {
    /// Waiting for room in the window.
    Queued,
    /// Sent this many times, not answered yet.
    Sent(u32),
    /// No acknowledgement was requested.
    Unconfirmed,
    /// 17000 type 1: it arrived.
    Received,
    /// 17000 type 2.
    CarriedOut,
    /// 17000 type 3.
    Refused,
    /// No answer after every try.
    Unanswered,
}

impl Delivery {
    /// Whether the state is final.
    #[must_use]
    pub fn is_final(self) -> bool {
        matches!(
            self,
            Self::Unconfirmed | Self::CarriedOut | Self::Refused | Self::Unanswered
        )
    }

    fn rank(self) -> u8 {
        match self {
            Self::Queued => 0,
            Self::Sent(_) => 1,
            Self::Unconfirmed | Self::Unanswered => 2,
            Self::Received => 3,
            Self::CarriedOut | Self::Refused => 4,
        }
    }
}

/// The edition that a station uses.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Edition {
    /// 2.5: other messages, translated at the border of the session.
    Ed25,
    /// 3: IDD version 30, additive checksums.
    Ed3,
    /// 4: IDD version 31.
    #[default]
    Ed4,
}

impl std::str::FromStr for Edition {
    type Err = String;

    fn from_str(text: &str) -> Result<Edition, String> {
        match text {
            "2.5" => Ok(Edition::Ed25),
            "3" => Ok(Edition::Ed3),
            "4" => Ok(Edition::Ed4),
            _ => Err("expected 2.5, 3 or 4".to_owned()),
        }
    }
}

/// Why a message is not sent.
#[derive(Clone, Debug, thiserror::Error)]
pub enum SendError {
    /// It cannot be written.
    #[error(transparent)]
    Encode(#[from] EncodeError),
    /// The edition cannot express it.
    #[error(transparent)]
    NoCounterpart(#[from] NoCounterpart),
}

/// Settings of a session.
#[derive(Clone, Copy, Debug)]
pub struct SessionConfig {
    /// The id of this CUCS.
    pub id: Id,
    /// The edition that it uses; with Edition 3 or 4 it receives messages of both.
    pub edition: Edition,
    /// Checksum of its messages; in Edition 2.5 always the sum of the bytes.
    pub checksum: ChecksumStyle,
    /// A message without a 17000 is sent again after this time.
    pub retry: Duration,
    /// How often a message is sent at most.
    pub tries: u32,
}

impl SessionConfig {
    /// The defaults: Edition 4, no checksum, 5 tries, 0.5 s apart.
    #[must_use]
    pub fn new(id: Id) -> SessionConfig {
        SessionConfig::of(Edition::Ed4, id)
    }

    /// The same for an edition; Edition 3 gets the checksum of its text, the sum of the bytes.
    #[must_use]
    pub fn of(edition: Edition, id: Id) -> SessionConfig {
        SessionConfig {
            id,
            edition,
            checksum: match edition {
                Edition::Ed3 => ChecksumStyle::Sum32,
                Edition::Ed25 | Edition::Ed4 => ChecksumStyle::None,
            },
            retry: Duration::from_millis(500),
            tries: 5,
        }
    }
}

#[derive(Debug)]
pub(crate) struct Sender {
    config: SessionConfig,
    queue: VecDeque<(Ticket, Id, Message, bool)>,
    sent: BTreeMap<Ticket, Sent>,
    out: VecDeque<Vec<u8>>,
    /// Present in Edition 2.5 only.
    border: Option<Border>,
    next_ticket: u64,
    /// Stamp of the latest message, ms since 1970.
    last_stamp_ms: u64,
}

#[derive(Debug)]
struct Sent {
    destination: Id,
    message_type: u16,
    stamp: TimeStamp,
    bytes: Box<[u8]>,
    tries: u32,
    /// How often it was sent again after "received".
    outcome_requests: u32,
    due: Duration,
    delivery: Delivery,
}

impl Sent {
    fn is_repeated(&self) -> bool {
        match self.delivery {
            Delivery::Sent(_) => true,
            Delivery::Received => self.outcome_requests < MAX_OUTCOME_REQUESTS,
            _ => false,
        }
    }

    /// The same bytes, counted as a retransmission.
    fn again(&self, traffic: &mut Traffic) -> Vec<u8> {
        traffic.sent.count(self.message_type);
        traffic.retransmitted += 1;
        self.bytes.to_vec()
    }
}

impl Sender {
    pub(crate) fn new(config: SessionConfig) -> Sender {
        Sender {
            config,
            queue: VecDeque::new(),
            sent: BTreeMap::new(),
            out: VecDeque::new(),
            border: (config.edition == Edition::Ed25).then(|| Border::new(config.id)),
            next_ticket: 0,
            last_stamp_ms: 0,
        }
    }

    /// Queues a message. Its Time Stamp is set when it is sent.
    ///
    /// # Errors
    /// It cannot be written.
    pub(crate) fn submit(
        &mut self,
        destination: Id,
        message: Message,
        acknowledged: bool,
    ) -> Result<Ticket, SendError> {
        if let Some(border) = &self.border {
            border.check(destination, &message)?;
        }
        // Encoded once now, so that the caller gets the error, and not a later retransmission.
        message.encode(
            &self.envelope(destination, acknowledged),
            &mut [0; MAX_DATAGRAM],
        )?;
        let ticket = Ticket(self.next_ticket);
        self.next_ticket += 1;
        self.queue
            .push_back((ticket, destination, message, acknowledged));
        Ok(ticket)
    }

    /// Sends what the window allows, several messages in a datagram, and what is due again.
    pub(crate) fn advance(&mut self, now: Now, traffic: &mut Traffic) {
        self.retransmit(now.mono, traffic);
        let mut room = WINDOW.saturating_sub(self.in_flight());
        let mut packer = Packer::new();
        while room > 0
            && let Some((ticket, destination, message, acknowledged)) = self.queue.pop_front()
        {
            let stamp = self.stamp(now.unix_ms);
            let message = message.stamped(stamp);
            let envelope = self.envelope(destination, acknowledged);
            let mut bytes = [0; MAX_DATAGRAM];
            let out = &mut self.out;
            let written = match &mut self.border {
                Some(border) => border
                    .datagram(destination, &message, stamp, acknowledged)
                    .inspect(|datagram| {
                        if !datagram.is_empty() {
                            out.push_back(datagram.clone());
                        }
                    })
                    .map_err(SendError::from),
                None => message
                    .encode(&envelope, &mut bytes)
                    .and_then(|length| {
                        packer.push(&envelope, &message, |full| out.push_back(full.to_vec()))?;
                        Ok(bytes[..length].to_vec())
                    })
                    .map_err(SendError::from),
            };
            let (bytes, delivery) = match written {
                Ok(bytes) if acknowledged && !bytes.is_empty() => (bytes, Delivery::Sent(1)),
                Ok(_) => (Vec::new(), Delivery::Unconfirmed),
                // It could be encoded without its Time Stamp; with the stamp it is too long.
                Err(_) => (Vec::new(), Delivery::Unanswered),
            };
            if delivery != Delivery::Unanswered {
                traffic.sent.count(message.id());
            }
            // Only messages that await an acknowledgement take room in the window.
            room -= usize::from(acknowledged);
            let sent = Sent {
                destination,
                message_type: message.id(),
                stamp,
                bytes: bytes.into(),
                tries: 1,
                outcome_requests: 0,
                due: now.mono + self.config.retry,
                delivery,
            };
            self.sent.insert(ticket, sent);
        }
        packer.flush(|rest| self.out.push_back(rest.to_vec()));
        self.forget_old();
    }

    fn retransmit(&mut self, now: Duration, traffic: &mut Traffic) {
        for sent in self.sent.values_mut() {
            // Edition 2.5 acknowledges once: another request would bring nothing.
            let done = self.border.is_some() && sent.delivery == Delivery::Received;
            if done || !sent.is_repeated() || sent.due > now {
                continue;
            }
            sent.due = now + self.config.retry;
            if sent.delivery == Delivery::Received {
                sent.outcome_requests += 1;
                sent.due += self.config.retry;
            } else if sent.tries >= self.config.tries {
                sent.delivery = Delivery::Unanswered;
                continue;
            } else {
                sent.tries += 1;
                sent.delivery = Delivery::Sent(sent.tries);
            }
            self.out.push_back(sent.again(traffic));
        }
    }

    /// Handles a 17000 (its source, Original Message Type, Original Message Time Stamp, Acknowledgement Type).
    /// Returns the ticket that it is for, and the new state.
    pub(crate) fn acknowledged(
        &mut self,
        source: Id,
        message_type: u16,
        stamp: TimeStamp,
        answer: AckType,
    ) -> Option<(Ticket, Delivery)> {
        let delivery = match answer {
            AckType::Received => Delivery::Received,
            AckType::CarriedOut => Delivery::CarriedOut,
            AckType::Refused => Delivery::Refused,
            AckType::Unknown(_) => return None,
        };
        let (ticket, sent) = self.sent.iter_mut().rev().find(|(_, sent)| {
            // A broadcast is answered by the VSM or the vehicle under its own id.
            let from_there = sent.destination == source || sent.destination == Id::BROADCAST;
            sent.message_type == message_type && sent.stamp == stamp && from_there
        })?;
        // Acknowledgements may overtake each other: one that is behind the known state changes nothing.
        if delivery.rank() > sent.delivery.rank() {
            sent.delivery = delivery;
        }
        Some((*ticket, sent.delivery))
    }

    pub(crate) fn delivery(&self, ticket: Ticket) -> Delivery {
        match self.sent.get(&ticket) {
            Some(sent) => sent.delivery,
            None if self.queue.iter().any(|(queued, ..)| *queued == ticket) => Delivery::Queued,
            // Final long ago, and forgotten.
            None => Delivery::Unconfirmed,
        }
    }

    /// Message Type and stamp of a message that was sent.
    pub(crate) fn sent(&self, ticket: Ticket) -> Option<(u16, TimeStamp)> {
        let sent = self.sent.get(&ticket)?;
        Some((sent.message_type, sent.stamp))
    }

    /// The latest answer to a message of this type and stamp.
    pub(crate) fn answer(&self, message_type: u16, stamp: TimeStamp) -> Option<Delivery> {
        let mut latest = self.sent.values().rev();
        latest
            .find(|sent| sent.message_type == message_type && sent.stamp == stamp)
            .map(|sent| sent.delivery)
    }

    /// Sends the same bytes once more, now.
    pub(crate) fn resend(&mut self, ticket: Ticket, traffic: &mut Traffic) {
        if let Some(sent) = self.sent.get(&ticket)
            && !sent.bytes.is_empty()
        {
            self.out.push_back(sent.again(traffic));
        }
    }

    /// Stops sending this message.
    pub(crate) fn withdraw(&mut self, ticket: Ticket) {
        self.queue.retain(|(queued, ..)| *queued != ticket);
        if let Some(sent) = self.sent.get_mut(&ticket)
            && !sent.delivery.is_final()
        {
            sent.delivery = Delivery::Unanswered;
        }
    }

    pub(crate) fn poll_transmit(&mut self) -> Option<Vec<u8>> {
        let answer = || self.border.as_mut()?.poll_transmit();
        self.out.pop_front().or_else(answer)
    }

    /// The border to VSMs of Edition 2.5, where that is spoken.
    pub(crate) fn border(&mut self) -> Option<&mut Border> {
        self.border.as_mut()
    }

    /// When [`Sender::advance`] is next needed.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        let once = self.border.is_some();
        let repeated = self
            .sent
            .values()
            .filter(|sent| sent.is_repeated() && !(once && sent.delivery == Delivery::Received));
        repeated.map(|sent| sent.due).min()
    }

    fn in_flight(&self) -> usize {
        let all = self.sent.values();
        all.filter(|sent| matches!(sent.delivery, Delivery::Sent(_)))
            .count()
    }

    /// Later than every stamp before, even where the wall clock was set back: 17000 identifies a message by its type
    /// and stamp.
    fn stamp(&mut self, unix_ms: u64) -> TimeStamp {
        let apart = if self.border.is_some() {
            STAMPS_EACH
        } else {
            1
        };
        // Compared before the rollover: the highest stamp of five bytes is followed by 0.
        self.last_stamp_ms = unix_ms
            .max(TimeStamp::EPOCH_UNIX_MS)
            .max(self.last_stamp_ms + apart);
        if let Some(border) = &mut self.border {
            border.keep_time(self.last_stamp_ms);
        }
        TimeStamp::from_unix_ms(self.last_stamp_ms)
    }

    fn envelope(&self, destination: Id, acknowledged: bool) -> Envelope {
        let mut envelope = Envelope::new(self.config.id, destination).summed(self.config.checksum);
        if self.config.edition == Edition::Ed3 {
            envelope.idd = Header::IDD_ED3;
        }
        if acknowledged {
            envelope.requesting_ack()
        } else {
            envelope
        }
    }

    fn forget_old(&mut self) {
        while self.sent.len() > MAX_REMEMBERED {
            let mut sent = self.sent.iter();
            let Some((&oldest, _)) = sent.find(|(_, sent)| sent.delivery.is_final()) else {
                return;
            };
            self.sent.remove(&oldest);
        }
    }
}

/// Messages without an answer at most: as many acknowledgements as fit a socket's buffer.
const WINDOW: usize = 32;
/// Sent messages whose stamp and state are kept.
const MAX_REMEMBERED: usize = 4_096;
/// Two retry intervals each: a minute by default, longer than a command may take.
const MAX_OUTCOME_REQUESTS: u32 = 60;
