//! Sockets, the clock of the run, and the recording of every datagram.
//!
//! Each socket has a thread that receives and records; a scene waits on the recording. What a scene has not asked for is
//! recorded as well: the judges of passive rules look at everything.

use std::io;
use std::net::SocketAddr;
use std::ops::Deref;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use super::listener::{Listener, towards};
use super::tape::{MAX_RECORDED_BYTES, Tape};
use crate::wire::dialect::{self, Role};
use crate::wire::{self, Direction, Seen};

/// Seconds from 1970 to 2000.
const EPOCH_2000_S: u64 = 946_684_800;
/// A socket that is dropped is free again within this time.
const NOTICE: Duration = Duration::from_millis(100);
/// Datagrams a second that are looked at. What a subject may answer to the floods of the suite's own rules is below it.
const MAX_RECEIVED_PER_S: usize = 10_000;
/// How far stamps may be ahead of the clock, ms: far less than any VSM allows.
const MAX_AHEAD_MS: u64 = 100;

/// A datagram of the run.
#[derive(Clone, Debug)]
pub struct Datagram {
    /// Time since the run began.
    pub at: Duration,
    /// Time since 1970.
    pub wall: Duration,
    /// Sent or received.
    pub direction: Direction,
    /// The suite's end.
    pub local: SocketAddr,
    /// The other end.
    pub remote: SocketAddr,
    /// The payload.
    pub bytes: Vec<u8>,
    /// Its messages as the rules look at them: of Edition 2.5 their counterparts in Edition 4.
    pub messages: Vec<Arc<Seen>>,
    /// Its messages as they are.
    pub originals: Vec<Arc<Seen>>,
    /// Why the rest of it is no message.
    pub fault: Option<String>,
}

impl Datagram {
    /// Its messages, as they are or as the rules look at them.
    #[must_use]
    pub fn seen(&self, as_they_are: bool) -> &[Arc<Seen>] {
        if as_they_are {
            &self.originals
        } else {
            &self.messages
        }
    }

    /// Takes the bytes of a datagram apart; `dialect` where Edition 2.5 is judged.
    #[must_use]
    pub fn new(
        (at, wall): (Duration, Duration),
        direction: Direction,
        socket: usize,
        (local, remote): (SocketAddr, SocketAddr),
        bytes: Vec<u8>,
        dialect: Option<Role>,
    ) -> Self {
        let wall_ms = (wall.as_millis() as u64).saturating_sub(EPOCH_2000_S * 1000);
        let (pieces, fault) = wire::split(&bytes);
        let by_cucs = matches!(
            (dialect, direction),
            (Some(Role::Cucs), Direction::Sent) | (Some(Role::Vehicle), Direction::Received)
        );
        let originals: Vec<Arc<Seen>> = pieces
            .into_iter()
            .map(|piece| piece.sent_by_cucs(by_cucs))
            .map(|piece| Arc::new(Seen::new(at, wall_ms, direction, socket, piece)))
            .collect();
        let messages = match dialect {
            Some(_) => originals.iter().flat_map(dialect::counterparts).collect(),
            None => originals.clone(),
        };
        Self {
            at,
            wall,
            direction,
            local,
            remote,
            bytes,
            messages,
            originals,
            fault,
        }
    }
}

/// Everything sent and received so far.
#[derive(Debug, Default)]
pub struct Recording {
    /// In the order of time.
    pub datagrams: Vec<Datagram>,
    bytes: usize,
    /// Datagrams that were not looked at: of a flood, or because there was no room.
    pub dropped: usize,
    /// The second of the run, and how many were received in it.
    second: (u64, usize),
}

impl Recording {
    /// Whether one datagram more is looked at.
    fn has_room(&mut self, direction: Direction, at: Duration) -> bool {
        if direction == Direction::Received {
            if self.second.0 != at.as_secs() {
                self.second = (at.as_secs(), 0);
            }
            self.second.1 += 1;
        }
        self.second.1 <= MAX_RECEIVED_PER_S && self.bytes <= MAX_RECORDED_BYTES
            || direction == Direction::Sent && self.bytes <= 2 * MAX_RECORDED_BYTES
    }
}

/// The messages of a datagram.
#[derive(Clone, Debug, Default)]
pub struct Recorded {
    /// As the rules look at them.
    pub messages: Vec<Arc<Seen>>,
    /// As they are.
    pub originals: Vec<Arc<Seen>>,
}

/// The network of a run.
#[derive(Debug)]
pub struct Net {
    tape: Tape<Recording>,
    last_stamp: AtomicU64,
    dialect: Option<Role>,
    instances: AtomicU32,
    missing: Mutex<Vec<String>>,
}

impl Net {
    /// A network without sockets, for this edition; `role` is the side that the suite plays.
    #[must_use]
    pub fn new(edition: &str, role: Role) -> Arc<Self> {
        Arc::new(Self {
            dialect: (edition == "2.5").then_some(role),
            // An instance is not used again, also not by the next run.
            instances: AtomicU32::new(
                SystemTime::now()
                    .duration_since(UNIX_EPOCH)
                    .map_or(0, |now| (now.as_millis() >> 4) as u32),
            ),
            missing: Mutex::default(),
            tape: Tape::default(),
            last_stamp: AtomicU64::new(0),
        })
    }

    /// The suite's side, where Edition 2.5 is spoken.
    #[must_use]
    pub fn dialect(&self) -> Option<Role> {
        self.dialect
    }

    /// A Message Instance ID of Edition 2.5 that no message of the suite has had.
    pub fn instance(&self) -> u32 {
        self.instances.fetch_add(1, Ordering::SeqCst)
    }

    /// What could not be sent, since Edition 2.5 has nothing for it.
    pub fn note_missing(&self, what: Vec<String>) {
        let mut missing = self.missing.lock().unwrap_or_else(PoisonError::into_inner);
        for one in what {
            if !missing.contains(&one) {
                missing.push(one);
            }
        }
    }

    /// What was noted since the last call.
    pub fn take_missing(&self) -> Vec<String> {
        std::mem::take(&mut *self.missing.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Milliseconds since 2000 by the clock of this computer.
    #[must_use]
    pub fn wall_ms(&self) -> u64 {
        let now = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        (now.as_millis() as u64).saturating_sub(EPOCH_2000_S * 1000)
    }

    /// A time stamp for a message: the time, but later than every one before. Waits a millisecond where more messages than
    /// milliseconds have gone by: a VSM may refuse what comes from the future, and that is no part of the rule that is played next.
    pub fn stamp(&self) -> i64 {
        if self.last_stamp.load(Ordering::SeqCst) > self.wall_ms() + MAX_AHEAD_MS {
            std::thread::sleep(Duration::from_millis(1));
        }
        let now = self.wall_ms();
        let next = |last: u64| Some(now.max(last + 1));
        let last = self
            .last_stamp
            .fetch_update(Ordering::SeqCst, Ordering::SeqCst, next);
        now.max(last.unwrap_or_default() + 1) as i64
    }

    /// Whether nothing more can be recorded, so that nothing more can be judged.
    #[must_use]
    pub fn full(&self) -> bool {
        self.recording().bytes > MAX_RECORDED_BYTES
    }

    /// How many datagrams were not looked at: more than none is a flood.
    #[must_use]
    pub fn dropped(&self) -> usize {
        self.recording().dropped
    }

    /// How many datagrams there are: a mark to search from.
    #[must_use]
    pub fn mark(&self) -> usize {
        self.recording().datagrams.len()
    }

    /// Records a datagram; its messages as the rules look at them, and as they are.
    pub fn record(
        &self,
        direction: Direction,
        socket: usize,
        local: SocketAddr,
        remote: SocketAddr,
        bytes: &[u8],
    ) -> Recorded {
        let at = self.now();
        {
            let mut recording = self.recording();
            if !recording.has_room(direction, at) {
                recording.dropped += 1;
                return Recorded::default();
            }
        }
        let wall = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        let datagram = Datagram::new(
            (at, wall),
            direction,
            socket,
            (local, remote),
            bytes.to_vec(),
            self.dialect,
        );
        let parsed = Recorded {
            messages: datagram.messages.clone(),
            originals: datagram.originals.clone(),
        };
        let mut recording = self.recording();
        // The parsed form takes a few times the bytes.
        recording.bytes += 500 + 4 * bytes.len();
        recording.datagrams.push(datagram);
        drop(recording);
        if direction == Direction::Received {
            self.notify();
        }
        parsed
    }

    /// Whether a datagram from `mark` on is one that `wanted` accepts, waited for until `deadline` (time of the run).
    pub fn wait_datagram(
        &self,
        mark: usize,
        deadline: Duration,
        wanted: impl FnMut(&Datagram) -> bool,
    ) -> bool {
        let mut wanted = wanted;
        self.first(mark, deadline, |datagram| wanted(datagram).then_some(()))
            .is_some()
    }

    /// The first message from `mark` on that `wanted` accepts, waited for until `deadline` (time of the run).
    pub fn wait(
        &self,
        mark: usize,
        deadline: Duration,
        mut wanted: impl FnMut(&Datagram, &Arc<Seen>) -> bool,
    ) -> Option<Arc<Seen>> {
        self.first(mark, deadline, |datagram| {
            let mut messages = datagram.messages.iter();
            messages.find(|seen| wanted(datagram, seen)).cloned()
        })
    }

    fn first<T>(
        &self,
        mark: usize,
        deadline: Duration,
        mut wanted: impl FnMut(&Datagram) -> Option<T>,
    ) -> Option<T> {
        let mut next = mark;
        self.wait_for(deadline, |recording| {
            let found = recording
                .datagrams
                .get(next..)?
                .iter()
                .find_map(&mut wanted);
            next = recording.datagrams.len();
            found
        })
    }
}

impl Deref for Net {
    type Target = Tape<Recording>;

    fn deref(&self) -> &Self::Target {
        &self.tape
    }
}

/// A socket of the suite with its receiving thread; closed when dropped.
#[derive(Debug)]
pub struct Socket {
    net: Arc<Net>,
    listener: Listener,
    /// Its number in the recording.
    pub number: usize,
    remote: SocketAddr,
}

impl Socket {
    /// Opens a socket on a fresh port, from which `remote` is reached. `acknowledge` makes the answer to a message, as it is,
    /// that requests an acknowledgement: a CUCS that never acknowledges has not proved its address.
    ///
    /// # Errors
    /// The system has no socket, or no way to the address.
    pub fn open(
        net: &Arc<Net>,
        remote: SocketAddr,
        acknowledge: impl Fn(&Seen) -> Option<Vec<u8>> + Send + 'static,
    ) -> io::Result<Self> {
        let socket = towards(remote)?;
        let (local, number) = (socket.local_addr()?, net.next_socket());
        let receives = net.clone();
        let listener = Listener::start(socket, NOTICE, move |socket, from, bytes| {
            let recorded = receives.record(Direction::Received, number, local, from, bytes);
            for answer in recorded
                .originals
                .iter()
                .filter_map(|seen| acknowledge(seen))
            {
                receives.record(Direction::Sent, number, local, from, &answer);
                let _ = socket.send_to(&answer, from);
            }
        })?;
        Ok(Self {
            net: net.clone(),
            listener,
            number,
            remote,
        })
    }

    /// Sends a datagram.
    pub fn send(&self, bytes: &[u8]) {
        let local = self.listener.local;
        self.net
            .record(Direction::Sent, self.number, local, self.remote, bytes);
        self.listener.send(bytes, self.remote);
    }

    /// Sends a datagram that is not recorded: floods.
    pub fn send_unrecorded(&self, bytes: &[u8]) {
        self.listener.send(bytes, self.remote);
    }
}
