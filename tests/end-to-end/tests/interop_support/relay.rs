//! A network between two programs on the loopback: datagrams are lost, doubled, held up and overtaken, by a seed.

use std::collections::BTreeMap;
use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// How bad it is, each way: probabilities of 0 to 1 for each datagram, and the shortest and longest travel time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Faults {
    pub(crate) loss: f64,
    pub(crate) duplicate: f64,
    /// Held back so long that later ones overtake it.
    pub(crate) reorder: f64,
    pub(crate) delay: (Duration, Duration),
}

/// Stands before a server for one client. It ends when this value goes.
pub(crate) struct Relay {
    front: SocketAddr,
    over: Arc<AtomicBool>,
    lost: Arc<AtomicU64>,
    carrying: Option<JoinHandle<()>>,
}

impl Relay {
    /// Listens on a free port, and carries to and from `server`.
    pub(crate) fn start(server: &str, faults: Faults, seed: u64) -> Relay {
        let front = UdpSocket::bind("127.0.0.1:0").expect("a loopback socket");
        let back = UdpSocket::bind("127.0.0.1:0").expect("a loopback socket");
        for socket in [&front, &back] {
            socket.set_nonblocking(true).expect("it need not block");
        }
        let address = front.local_addr().expect("its address");
        let server = server.parse().expect("an address");
        let over = Arc::new(AtomicBool::new(false));
        let lost = Arc::new(AtomicU64::new(0));
        let mut carrier = Carrier {
            front,
            back,
            server,
            client: None,
            faults,
            random: Random(seed | 1),
            under_way: BTreeMap::new(),
            count: 0,
            lost: Arc::clone(&lost),
        };
        let ends = Arc::clone(&over);
        let carrying = thread::spawn(move || {
            while !ends.load(Relaxed) {
                carrier.carry();
                thread::sleep(Duration::from_millis(1));
            }
        });
        Relay {
            front: address,
            over,
            lost,
            carrying: Some(carrying),
        }
    }

    /// Where the client finds the server.
    pub(crate) fn address(&self) -> String {
        self.front.to_string()
    }

    /// How many datagrams were lost so far.
    pub(crate) fn lost(&self) -> u64 {
        self.lost.load(Relaxed)
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.over.store(true, Relaxed);
        if let Some(carrying) = self.carrying.take() {
            let _ = carrying.join();
        }
    }
}

struct Carrier {
    front: UdpSocket,
    back: UdpSocket,
    server: SocketAddr,
    /// From where the client spoke last.
    client: Option<SocketAddr>,
    faults: Faults,
    random: Random,
    under_way: BTreeMap<(Instant, u64), (bool, Vec<u8>)>,
    count: u64,
    lost: Arc<AtomicU64>,
}

impl Carrier {
    fn carry(&mut self) {
        let mut buffer = [0; 2_048];
        while let Ok((bytes, from)) = self.front.recv_from(&mut buffer) {
            self.client = Some(from);
            self.put(true, buffer.get(..bytes).unwrap_or_default());
        }
        // A server that is down makes this fail once; the next datagram may find it up again.
        while let Ok((bytes, from)) = self.back.recv_from(&mut buffer) {
            if from == self.server {
                self.put(false, buffer.get(..bytes).unwrap_or_default());
            }
        }
        let now = Instant::now();
        while let Some(entry) = self.under_way.first_entry()
            && entry.key().0 <= now
        {
            let (to_server, bytes) = entry.remove();
            let _ = match (to_server, self.client) {
                (true, _) => self.back.send_to(&bytes, self.server),
                (false, Some(client)) => self.front.send_to(&bytes, client),
                (false, None) => continue,
            };
        }
    }

    fn put(&mut self, to_server: bool, bytes: &[u8]) {
        let Faults {
            loss,
            duplicate,
            reorder,
            delay,
        } = self.faults;
        let copies = if self.random.happens(duplicate) { 2 } else { 1 };
        for _ in 0..copies {
            if self.random.happens(loss) {
                self.lost.fetch_add(1, Relaxed);
                continue;
            }
            let spread = (delay.1 - delay.0).mul_f64(self.random.unit());
            let held = if self.random.happens(reorder) {
                HELD_BACK
            } else {
                Duration::ZERO
            };
            self.count += 1;
            let due = Instant::now() + delay.0 + spread + held;
            let key = (due, self.count);
            self.under_way.insert(key, (to_server, bytes.to_vec()));
        }
    }
}

/// Xorshift: even enough for a network.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    fn happens(&mut self, probability: f64) -> bool {
        self.unit() < probability
    }
}

const HELD_BACK: Duration = Duration::from_millis(80);
