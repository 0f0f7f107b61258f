//! What goes out on the DLI side: stamps that rise strictly, one queue, no allocation a message once it has grown.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::Duration;

use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, Profile, TimeStamp};

use super::counters::ByType;

/// Where a datagram goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Destination {
    /// To one CUCS.
    Unicast(SocketAddr),
    /// To the group, where there is one.
    Multicast,
}

/// One datagram.
#[derive(Debug, Clone)]
pub struct Datagram {
    /// Where it goes.
    pub to: Destination,
    length: usize,
    bytes: [u8; MAX_DATAGRAM],
}

impl Datagram {
    /// Its bytes.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.bytes.get(..self.length).unwrap_or_default()
    }
}

/// The queue of one bridge.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    profile: Profile,
    queue: VecDeque<Datagram>,
    last_stamp: u64,
    pub(crate) sent: ByType,
}

impl Outbox {
    /// A queue of messages as peers of this profile read them.
    pub(crate) fn new(profile: Profile) -> Outbox {
        Outbox {
            profile,
            ..Outbox::default()
        }
    }

    /// The stamp of a message made now: later than every one before.
    pub(crate) fn stamp(&mut self, wall: Duration) -> TimeStamp {
        let now = TimeStamp::from_unix_ms(u64::try_from(wall.as_millis()).unwrap_or(u64::MAX)).0;
        // Two messages within a millisecond, or a wall clock that was set back, still get rising stamps.
        self.last_stamp = now.max(self.last_stamp + 1);
        TimeStamp(self.last_stamp)
    }

    /// Queues a message from `source` to `destination`, in a datagram of its own.
    pub(crate) fn push(&mut self, to: Destination, source: Id, destination: Id, message: &Message) {
        let mut datagram = Datagram {
            to,
            length: 0,
            bytes: [0; MAX_DATAGRAM],
        };
        let envelope = Envelope::new(source, destination);
        match self.profile.encode(message, &envelope, &mut datagram.bytes) {
            Ok(length) => datagram.length = length,
            // Every message of ours is shorter than a datagram; one that is not is lost, and visibly so.
            Err(_) => debug_assert!(false, "message {} does not fit a datagram", message.id()),
        }
        if datagram.length > 0 && self.queue.len() < MAX_QUEUED {
            self.sent.count(message.id().into());
            self.queue.push_back(datagram);
        }
    }

    pub(crate) fn pop(&mut self) -> Option<Datagram> {
        self.queue.pop_front()
    }
}

/// Datagrams that wait for the socket at most: a download of a full plan to several stations.
const MAX_QUEUED: usize = 65_536;
