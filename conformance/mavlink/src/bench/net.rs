//! Sockets, the clock of the run, and the recording of every datagram and frame.

use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::ops::Deref;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use conformance::bench::listener::{Listener, towards};
use conformance::bench::net::Datagram;
use conformance::bench::tape::{MAX_RECORDED_BYTES, Tape};
use conformance::wire::Direction;
use serde_json::{Value, json};

use crate::wire::frame::{Frame, Key, split};
use crate::wire::{STAMP_HZ, wall_stamp};

/// How long after a drop the port may still be in use.
const NOTICE: Duration = Duration::from_millis(50);
/// How far the suite's timestamps follow verified frames beyond the wall clock, in units of 10 us. ArduPilot's
/// timestamps run minutes ahead and have to be followed; a frame from next year must not move the suite's own.
const FOLLOW: u64 = 3600 * STAMP_HZ;

/// A frame that was sent or received.
#[derive(Debug)]
pub struct Seen {
    /// Time since the run began.
    pub at: Duration,
    /// Sent or received.
    pub direction: Direction,
    /// Number of the socket.
    pub socket: usize,
    /// The other end.
    pub remote: SocketAddr,
    /// The suite's signing timestamp, by the wall clock, when it was sent or received.
    pub wall_stamp: u64,
    /// The frame.
    pub frame: Frame,
    /// Whether its signature is that of the run's key; `None` where it is unsigned or no key was given.
    pub verified: Option<bool>,
}

impl Seen {
    /// As evidence in a report.
    #[must_use]
    pub fn evidence(&self) -> Value {
        let frame = &self.frame;
        let sender = format!("{}/{}", frame.system, frame.component);
        let target = frame.target().map_or_else(
            || "all".to_owned(),
            |(system, component)| format!("{system}/{component}"),
        );
        let hex = if frame.is("SETUP_SIGNING") {
            "not shown: holds a key".to_owned()
        } else {
            conformance::wire::hex(&frame.bytes)
        };
        json!({
            "time": self.at.as_secs_f64(),
            "direction": if self.direction == Direction::Sent { "sent" } else { "received" },
            "id": frame.id,
            "name": frame.name(),
            "source": sender,
            "destination": target,
            "fields": frame.fields(),
            "hex": hex,
        })
    }
}

/// Everything sent and received so far.
#[derive(Debug, Default)]
pub struct Recording {
    /// Datagrams, in the order of time.
    pub datagrams: Vec<Datagram>,
    /// Their frames.
    pub seen: Vec<Arc<Seen>>,
    /// Bytes that belonged to no frame.
    pub skipped: usize,
    /// Datagrams that were not recorded because the recording was full.
    pub dropped: usize,
    bytes: usize,
}

/// The network of a run.
#[derive(Debug)]
pub struct Net {
    tape: Tape<Recording>,
    key: Mutex<Option<Key>>,
    stamp: AtomicU64,
    sending: Mutex<()>,
}

impl Net {
    /// A network without sockets; `key` verifies what comes and signs what goes.
    #[must_use]
    pub fn new(key: Option<Key>) -> Arc<Self> {
        Arc::new(Self {
            tape: Tape::default(),
            key: Mutex::new(key),
            stamp: AtomicU64::new(0),
            sending: Mutex::default(),
        })
    }

    /// The current key.
    pub fn key(&self) -> Option<Key> {
        *self.key.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sets another key, or none.
    pub fn set_key(&self, key: Option<Key>) {
        *self.key.lock().unwrap_or_else(PoisonError::into_inner) = key;
    }

    /// The suite's next timestamp: the time, but later than every one before and than those of verified frames.
    pub fn stamp(&self) -> u64 {
        let wall = wall_stamp();
        let last = self
            .stamp
            .fetch_update(Ordering::SeqCst, Ordering::SeqCst, |last| {
                Some(wall.max(last + 1))
            })
            .unwrap_or_default();
        wall.max(last + 1)
    }

    /// Keeps every other sender of the suite waiting while the guard lives.
    pub fn hold(&self) -> MutexGuard<'_, ()> {
        self.sending.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn follow(&self, stamp: u64) {
        if stamp < wall_stamp() + FOLLOW {
            self.stamp.fetch_max(stamp, Ordering::SeqCst);
        }
    }

    /// How many frames there are: a mark to search from.
    #[must_use]
    pub fn mark(&self) -> usize {
        self.recording().seen.len()
    }

    /// How many datagrams there are.
    #[must_use]
    pub fn datagrams(&self) -> usize {
        self.recording().datagrams.len()
    }

    fn record(
        &self,
        direction: Direction,
        socket: usize,
        local: SocketAddr,
        remote: SocketAddr,
        bytes: &[u8],
    ) -> bool {
        let (frames, skipped) = split(bytes);
        let key = self.key();
        let wall = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        let found = !frames.is_empty();
        // Locked before the time is taken, so that the times in the recording never decrease.
        let mut recording = self.recording();
        let seen: Vec<_> = frames
            .into_iter()
            .map(|frame| {
                let verified = key.and_then(|key| frame.verifies(&key));
                if let (Direction::Received, Some(true), Some(signature)) =
                    (direction, verified, frame.signature)
                {
                    self.follow(signature.stamp);
                }
                Arc::new(Seen {
                    at: self.now(),
                    direction,
                    socket,
                    remote,
                    wall_stamp: wall_stamp(),
                    frame,
                    verified,
                })
            })
            .collect();
        if recording.bytes > MAX_RECORDED_BYTES {
            recording.dropped += 1;
            return found;
        }
        recording.bytes += 500 + 4 * bytes.len();
        if direction == Direction::Received {
            recording.skipped += skipped;
        }
        recording.datagrams.push(Datagram {
            at: self.now(),
            wall,
            direction,
            local,
            remote,
            bytes: bytes.to_vec(),
            messages: Vec::new(),
            originals: Vec::new(),
            fault: None,
        });
        recording.seen.extend(seen);
        drop(recording);
        if direction == Direction::Received {
            self.notify();
        }
        found
    }

    /// The first frame from `mark` on that `wanted` accepts, waited for until `deadline` (time of the run).
    pub fn wait(
        &self,
        mark: usize,
        deadline: Duration,
        mut wanted: impl FnMut(&Seen) -> bool,
    ) -> Option<Arc<Seen>> {
        let mut next = mark;
        self.wait_for(deadline, |recording| {
            let new = recording.seen.get(next..)?;
            next = recording.seen.len();
            new.iter().find(|seen| wanted(seen)).cloned()
        })
    }

    /// All frames from `mark` on that `wanted` accepts.
    pub fn all(&self, mark: usize, wanted: impl Fn(&Seen) -> bool) -> Vec<Arc<Seen>> {
        let recording = self.recording();
        recording.seen[mark.min(recording.seen.len())..]
            .iter()
            .filter(|seen| wanted(seen))
            .cloned()
            .collect()
    }
}

impl Deref for Net {
    type Target = Tape<Recording>;

    fn deref(&self) -> &Self::Target {
        &self.tape
    }
}

/// A UDP socket with its receiving thread; closed when dropped.
#[derive(Debug)]
pub struct Port {
    net: Arc<Net>,
    listener: Listener,
    /// Its number in the recording.
    pub number: usize,
    remote: Arc<Mutex<Option<SocketAddr>>>,
}

impl Port {
    /// Opens `udpin:HOST:PORT` (or `udp:`), which waits for the first sender of a frame, or `udpout:HOST:PORT`, which sends there.
    ///
    /// # Errors
    /// The text names no such address, or the socket cannot be opened.
    pub fn open(net: &Arc<Net>, text: &str) -> Result<Self, String> {
        let (scheme, address) = text
            .split_once(':')
            .filter(|(scheme, _)| matches!(*scheme, "udp" | "udpin" | "udpout"))
            .ok_or_else(|| format!("link {text:?}: expected udpin:HOST:PORT (waits for the subject) or udpout:HOST:PORT (sends to it)"))?;
        let address = address
            .to_socket_addrs()
            .map_err(|error| {
                format!("link {text:?}: {error}; expected HOST:PORT behind the scheme")
            })?
            .next()
            .ok_or_else(|| format!("link {text:?} names no host"))?;
        if scheme == "udpout" {
            Self::to(net, address).map_err(|error| format!("link {text:?}: {error}"))
        } else {
            let socket = UdpSocket::bind(address).map_err(|error| {
                format!("link {text:?}: {error}; is another station or router on this port?")
            })?;
            Self::with(net, socket, None).map_err(|error| format!("link {text:?}: {error}"))
        }
    }

    /// A socket on a fresh port that sends to this address.
    ///
    /// # Errors
    /// The system has no socket.
    pub fn to(net: &Arc<Net>, remote: SocketAddr) -> std::io::Result<Self> {
        Self::with(net, towards(remote)?, Some(remote))
    }

    fn with(
        net: &Arc<Net>,
        socket: UdpSocket,
        remote: Option<SocketAddr>,
    ) -> std::io::Result<Self> {
        let (local, number) = (socket.local_addr()?, net.next_socket());
        let remote = Arc::new(Mutex::new(remote));
        let (receives, learns) = (net.clone(), remote.clone());
        let listener = Listener::start(socket, NOTICE, move |_, from, bytes| {
            if receives.record(Direction::Received, number, local, from, bytes) {
                let mut remote = learns.lock().unwrap_or_else(PoisonError::into_inner);
                remote.get_or_insert(from);
            }
        })?;
        Ok(Self {
            net: net.clone(),
            listener,
            number,
            remote,
        })
    }

    /// Its address.
    #[must_use]
    pub fn local(&self) -> SocketAddr {
        self.listener.local
    }

    /// The other end, once it has sent a frame.
    #[must_use]
    pub fn remote(&self) -> Option<SocketAddr> {
        *self.remote.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Sends a datagram; does nothing while the other end is unknown.
    pub fn send(&self, bytes: &[u8]) {
        if let Some(remote) = self.remote() {
            self.net
                .record(Direction::Sent, self.number, self.local(), remote, bytes);
            self.listener.send(bytes, remote);
        }
    }
}
