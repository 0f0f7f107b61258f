//! Sockets, the clock of the run, and the recording of every datagram.
//!
//! Each socket has a thread that receives and records; a scene waits on the recording. Everything is recorded, also
//! what no scene waits for, because the judges of passive rules read all of it.

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
/// How long after a drop the port may still be in use.
const NOTICE: Duration = Duration::from_millis(100);
/// Received datagrams a second that are parsed: above anything that a lawful subject answers to the suite's own
/// floods.
const MAX_RECEIVED_PER_S: usize = 10_000;
/// How far stamps may be ahead of the clock, ms: far less than the future that any VSM tolerates.
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
    /// Datagrams that were not parsed: those of a flood, or after the recording was full.
    pub dropped: usize,
    /// The current second of the run, and how many datagrams were received in it.
    second: (u64, usize),
}

impl Recording {
    /// Whether one more datagram is parsed. What the suite sends has twice the room, so that a flood of the subject
    /// cannot push it out.
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
            // Starts at the clock, so that neither this run nor the next uses an instance twice.
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

    /// The side that the suite plays, where Edition 2.5 is judged.
    #[must_use]
    pub fn dialect(&self) -> Option<Role> {
        self.dialect
    }

    /// A Message Instance ID of Edition 2.5 that no message of the suite has had.
    pub fn instance(&self) -> u32 {
        self.instances.fetch_add(1, Ordering::SeqCst)
    }

    /// Notes what could not be sent, because Edition 2.5 has no message or field for it.
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

    /// A time stamp for a message: the time, but later than every stamp before. Waits a millisecond where stamps have
    /// run ahead of the clock: a VSM may refuse stamps from the future, and that would disturb the next rule.
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

    /// Whether the recording is full, so that nothing later can be judged.
    #[must_use]
    pub fn full(&self) -> bool {
        self.recording().bytes > MAX_RECORDED_BYTES
    }

    /// How many datagrams were not parsed: any number above 0 means a flood.
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
        // The parsed form takes several times the memory of the bytes.
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
    /// Opens a socket on a fresh port, from which `remote` is reached. `acknowledge` makes the answer to a received
    /// message that requests an acknowledgement: a subject may send little to a CUCS that has never acknowledged,
    /// since its address is not proved.
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
