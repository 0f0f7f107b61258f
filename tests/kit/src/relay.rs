//! The simulated network between two programs that use UDP over the loopback address, in real time.

use std::net::{SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering::Relaxed};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use crate::network::{Faults, Network};

/// A relay between a server and one client. It ends when this value is dropped.
#[derive(Debug)]
pub struct Relay {
    front: SocketAddr,
    ended: Arc<AtomicBool>,
    lost: Arc<AtomicU64>,
    carrier: Option<JoinHandle<()>>,
}

/// Where a datagram goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum End {
    /// To the client.
    Client,
    /// To the server.
    Server,
}

/// Is shown every datagram that is delivered, and where to.
type Observer = Box<dyn FnMut(End, &[u8]) + Send>;

impl Relay {
    /// Listens on a free port, and relays to and from `server`.
    pub fn start(server: &str, faults: Faults, seed: u64) -> Relay {
        Relay::observed(server, faults, seed, |_, _| {})
    }

    /// The same; each datagram is shown to `observer` before it is delivered.
    pub fn observed(
        server: &str,
        faults: Faults,
        seed: u64,
        observer: impl FnMut(End, &[u8]) + Send + 'static,
    ) -> Relay {
        let [front, back] = [(); 2].map(|()| {
            let socket = UdpSocket::bind("127.0.0.1:0").expect("a loopback socket");
            socket.set_nonblocking(true).expect("it need not block");
            socket
        });
        let address = front.local_addr().expect("its address");
        let ended = Arc::new(AtomicBool::new(false));
        let lost = Arc::new(AtomicU64::new(0));
        let mut carrier = Carrier {
            front,
            back,
            server: server.parse().expect("an address"),
            client: None,
            network: Network::new(seed, faults),
            observer: Box::new(observer),
            started: Instant::now(),
        };
        let (ends, counter) = (Arc::clone(&ended), Arc::clone(&lost));
        let carrier = thread::spawn(move || {
            while !ends.load(Relaxed) {
                carrier.carry();
                counter.store(carrier.network.lost(), Relaxed);
                thread::sleep(Duration::from_millis(1));
            }
        });
        Relay {
            front: address,
            ended,
            lost,
            carrier: Some(carrier),
        }
    }

    /// The address to which the client sends.
    pub fn address(&self) -> String {
        self.front.to_string()
    }

    /// How many datagrams were lost so far.
    pub fn lost(&self) -> u64 {
        self.lost.load(Relaxed)
    }
}

impl Drop for Relay {
    fn drop(&mut self) {
        self.ended.store(true, Relaxed);
        if let Some(carrier) = self.carrier.take() {
            let _ = carrier.join();
        }
    }
}

struct Carrier {
    front: UdpSocket,
    back: UdpSocket,
    server: SocketAddr,
    /// Where the client last sent from.
    client: Option<SocketAddr>,
    network: Network<End, Vec<u8>>,
    observer: Observer,
    started: Instant,
}

impl Carrier {
    fn carry(&mut self) {
        let now = self.started.elapsed();
        let mut buffer = [0; 2_048];
        while let Ok((length, from)) = self.front.recv_from(&mut buffer) {
            self.client = Some(from);
            let bytes = buffer[..length].to_vec();
            self.network.send(now, End::Client, End::Server, bytes);
        }
        // A server that is down makes this fail once; a later datagram may find it running again.
        while let Ok((length, from)) = self.back.recv_from(&mut buffer) {
            if from == self.server {
                let bytes = buffer[..length].to_vec();
                self.network.send(now, End::Server, End::Client, bytes);
            }
        }
        while let Some(packet) = self.network.receive(now) {
            (self.observer)(packet.to, &packet.payload);
            let _ = match (packet.to, self.client) {
                (End::Server, _) => self.back.send_to(&packet.payload, self.server),
                (End::Client, Some(client)) => self.front.send_to(&packet.payload, client),
                (End::Client, None) => continue,
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn carries_both_ways_and_counts_what_it_loses() {
        let server = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        let client = UdpSocket::bind("127.0.0.1:0").expect("a socket");
        for socket in [&server, &client] {
            let limit = Some(Duration::from_secs(10));
            socket.set_read_timeout(limit).expect("a time-out");
        }
        let address = server.local_addr().expect("its address").to_string();
        let relay = Relay::start(&address, Faults::NONE, 1);
        client.send_to(b"there", relay.address()).expect("sent");
        let mut buffer = [0; 16];
        let (length, from) = server.recv_from(&mut buffer).expect("it arrives");
        assert_eq!(&buffer[..length], b"there");
        server.send_to(b"back", from).expect("sent");
        let (length, from) = client.recv_from(&mut buffer).expect("it arrives");
        assert_eq!(
            (&buffer[..length], from.to_string()),
            (&b"back"[..], relay.address())
        );
        assert_eq!(relay.lost(), 0);

        let all = Faults {
            loss: 1.0,
            ..Faults::NONE
        };
        let deaf = Relay::start(&address, all, 1);
        client.send_to(b"there", deaf.address()).expect("sent");
        let end = Instant::now() + Duration::from_secs(10);
        while deaf.lost() == 0 && Instant::now() < end {
            thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(deaf.lost(), 1);
    }
}
