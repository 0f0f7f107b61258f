//! MAVLink over TCP, only for other ground stations (`[[forward]]`): a vehicle's link would queue stale data.
//!
//! A connection is a peer, like a UDP address: the machine decides which of them is the ground station, and only that one
//! is sent anything. What a connection does not accept is lost, as on any link, and one that accepts nothing for `PATIENCE`
//! is closed. Few may connect at once. Strangers must not keep the ground station out, so a connection that the machine has
//! not accepted ([`TcpWriter::accept`]) within `ACCEPTED_WITHIN` is closed. Before that it gives its place to a newcomer
//! when all places are taken: first the oldest of the host with the most of them, so that one host takes no place of
//! another. An accepted connection is never replaced. One attack is left: strangers on the ground station's own host, or on
//! many hosts, who reconnect `MAX_CONNECTIONS` times between its connection and its first signed frame, each time it tries.
//! The system's probes find a connection whose other end is gone.

use std::cmp::Reverse;
use std::collections::HashMap;
use std::io;
use std::net::{IpAddr, SocketAddr};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use socket2::{SockRef, TcpKeepalive};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, watch};
use tokio::time::{sleep, timeout};

use crate::session::Peer;

/// The data of all connections.
#[derive(Debug)]
pub struct TcpReader(mpsc::Receiver<(SocketAddr, Vec<u8>)>);

/// The connections.
#[derive(Debug, Clone, Default)]
pub struct TcpWriter(Arc<Mutex<Connections>>);

#[derive(Debug, Default)]
struct Connections {
    all: HashMap<SocketAddr, Connection>,
    /// The connection that the machine accepted last.
    station: Option<SocketAddr>,
    /// Connections so far.
    count: u64,
    /// When a displaced connection was last logged.
    crowded: Option<Instant>,
}

#[derive(Debug)]
struct Connection {
    /// Younger connections have higher numbers.
    number: u64,
    queue: mpsc::Sender<Vec<u8>>,
    /// Whether the machine has accepted its other end as the ground station. Dropping this closes the connection.
    accepted: watch::Sender<bool>,
}

/// What the connection's task needs.
struct Ends {
    number: u64,
    queue: mpsc::Receiver<Vec<u8>>,
    accepted: watch::Receiver<bool>,
}

impl TcpReader {
    /// Received bytes, and their source.
    ///
    /// # Errors
    /// The task that accepts or connects is gone.
    pub async fn receive(&mut self, bytes: &mut [u8]) -> io::Result<(usize, Peer)> {
        let (from, received) = self.0.recv().await.ok_or(io::ErrorKind::BrokenPipe)?;
        let length = received.len().min(bytes.len());
        bytes[..length].copy_from_slice(&received[..length]);
        Ok((length, Peer::Tcp(from)))
    }
}

impl TcpWriter {
    /// Queues one frame, or loses it.
    ///
    /// # Errors
    /// [`io::ErrorKind::NotConnected`], or [`io::ErrorKind::WouldBlock`] where there is no room.
    pub fn push(&self, bytes: &[u8], to: SocketAddr) -> io::Result<()> {
        let connections = self.lock();
        let connection = connections.all.get(&to);
        let connection = connection.ok_or(io::ErrorKind::NotConnected)?;
        let queued = connection.queue.try_send(bytes.to_vec());
        queued.map_err(|_| io::ErrorKind::WouldBlock.into())
    }

    /// The machine has accepted the other end as the ground station: the connection stays. An earlier accepted connection
    /// stays as long as nobody needs its place.
    pub fn accept(&self, peer: SocketAddr) {
        let mut connections = self.lock();
        if let Some(connection) = connections.all.get(&peer) {
            connection.accepted.send_replace(true);
            connections.station = Some(peer);
        }
    }

    fn add(&self, peer: SocketAddr) -> Ends {
        let mut connections = self.lock();
        if connections.all.len() >= MAX_CONNECTIONS {
            connections.make_room(peer);
        }
        connections.count += 1;
        let number = connections.count;
        let (sender, queue) = mpsc::channel(QUEUE);
        let (waits, accepted) = watch::channel(false);
        let connection = Connection {
            number,
            queue: sender,
            accepted: waits,
        };
        connections.all.insert(peer, connection);
        Ends {
            number,
            queue,
            accepted,
        }
    }

    fn remove(&self, peer: SocketAddr, number: u64) {
        let mut connections = self.lock();
        // It may have been displaced, and another may be there from the same address.
        if connections
            .all
            .get(&peer)
            .is_some_and(|one| one.number == number)
        {
            connections.all.remove(&peer);
        }
    }

    fn lock(&self) -> MutexGuard<'_, Connections> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Connections {
    /// Closes the least important connection: one that was never accepted before one that was, the host with the most of
    /// these first, and of those the oldest.
    fn make_room(&mut self, newcomer: SocketAddr) {
        let never = |one: &Connection| !*one.accepted.borrow();
        let from = |host: IpAddr| {
            let strangers = self.all.iter().filter(|(_, one)| never(one));
            strangers.filter(|(peer, _)| peer.ip() == host).count()
                + usize::from(newcomer.ip() == host)
        };
        let others = self
            .all
            .iter()
            .filter(|(peer, _)| Some(**peer) != self.station);
        let least = others.max_by_key(|(peer, one)| {
            let strangers = if never(one) { from(peer.ip()) } else { 0 };
            (strangers, Reverse(one.number))
        });
        let Some(peer) = least.map(|(peer, _)| *peer) else {
            return;
        };
        self.all.remove(&peer);
        let now = Instant::now();
        // Repeated connections must not fill the log.
        if self
            .crowded
            .is_none_or(|at| now.duration_since(at) > SAID_AGAIN)
        {
            self.crowded = Some(now);
            tracing::warn!(
                "TCP: {MAX_CONNECTIONS} are connected, {peer} has not shown itself as the ground station and gives way to \
                 {newcomer}"
            );
        }
    }
}

/// Listens. Must be called within a tokio runtime.
///
/// # Errors
/// The address is taken, or not this computer's.
pub fn listen(address: SocketAddr) -> io::Result<(TcpReader, TcpWriter)> {
    let listener = std::net::TcpListener::bind(address)?;
    listener.set_nonblocking(true)?;
    let listener = TcpListener::from_std(listener)?;
    let (sender, receiver) = mpsc::channel(QUEUE);
    let writer = TcpWriter::default();
    let connections = writer.clone();
    tokio::spawn(async move {
        loop {
            let accepted = tokio::select! {
                // Removed from the configuration.
                () = sender.closed() => return,
                accepted = listener.accept() => accepted,
            };
            match accepted {
                Ok((stream, peer)) => {
                    let ends = connections.add(peer);
                    let serve = serve(stream, peer, ends, sender.clone(), connections.clone());
                    tokio::spawn(serve);
                }
                Err(cause) => {
                    tracing::warn!("TCP {address}: {cause}");
                    sleep(AGAIN).await;
                }
            }
        }
    });
    Ok((TcpReader(receiver), writer))
}

/// Connects, and reconnects. Must be called within a tokio runtime.
#[must_use]
pub fn connect(peer: SocketAddr) -> (TcpReader, TcpWriter) {
    let (sender, receiver) = mpsc::channel(QUEUE);
    let writer = TcpWriter::default();
    let connections = writer.clone();
    tokio::spawn(async move {
        let mut failing = false;
        while !sender.is_closed() {
            let connected = timeout(PATIENCE, TcpStream::connect(peer)).await;
            match connected.unwrap_or_else(|_| Err(io::ErrorKind::TimedOut.into())) {
                Ok(stream) => {
                    failing = false;
                    let ends = connections.add(peer);
                    // The connected host is the configured one.
                    connections.accept(peer);
                    serve(stream, peer, ends, sender.clone(), connections.clone()).await;
                }
                Err(cause) => {
                    if !failing {
                        tracing::warn!(
                            "TCP {peer}: {cause}; tried again every {} s",
                            AGAIN.as_secs()
                        );
                    }
                    failing = true;
                }
            }
            tokio::select! {
                () = sender.closed() => return,
                () = sleep(AGAIN) => {}
            }
        }
    });
    (TcpReader(receiver), writer)
}

/// One connection, until either end closes it.
async fn serve(
    stream: TcpStream,
    peer: SocketAddr,
    ends: Ends,
    received: mpsc::Sender<(SocketAddr, Vec<u8>)>,
    connections: TcpWriter,
) {
    // Frames are small, and their receiver waits for each.
    let _ = stream.set_nodelay(true);
    // A ground station that is switched off closes nothing.
    let probes = TcpKeepalive::new()
        .with_time(PROBED_AFTER)
        .with_interval(PROBED_AFTER)
        .with_retries(3);
    let _ = SockRef::from(&stream).set_tcp_keepalive(&probes);
    let Ends {
        number,
        mut queue,
        mut accepted,
    } = ends;
    let (mut reading, mut writing) = stream.into_split();
    let read = async {
        let mut bytes = vec![0; AT_ONCE];
        loop {
            match reading.read(&mut bytes).await {
                Ok(0) | Err(_) => return,
                // A sender that is faster than the reader waits: TCP holds it back.
                Ok(length)
                    if received
                        .send((peer, bytes[..length].to_vec()))
                        .await
                        .is_err() =>
                {
                    return;
                }
                Ok(_) => {}
            }
        }
    };
    let write = async {
        while let Some(frame) = queue.recv().await {
            if !matches!(
                timeout(PATIENCE, writing.write_all(&frame)).await,
                Ok(Ok(()))
            ) {
                return;
            }
        }
    };
    let place = async {
        let waited = timeout(ACCEPTED_WITHIN, accepted.wait_for(|accepted| *accepted)).await;
        match waited.map(|accepted| accepted.is_ok()) {
            // Until it is displaced, which may have happened already.
            Ok(accepted_once) => while accepted_once && accepted.changed().await.is_ok() {},
            Err(_) => tracing::info!(
                "TCP: {peer} has not shown itself as the ground station within {} s and is disconnected",
                ACCEPTED_WITHIN.as_secs()
            ),
        }
    };
    tokio::select! {
        () = read => {}
        () = write => {}
        () = place => {}
        () = received.closed() => {}
    }
    connections.remove(peer, number);
}

/// Connections of one link at once: the ground station, its next attempt, and strangers.
const MAX_CONNECTIONS: usize = 8;
/// Between two log lines about displaced connections.
const SAID_AGAIN: Duration = Duration::from_secs(60);
/// Frames that wait for a connection, and pieces that wait for the reader.
const QUEUE: usize = 64;
/// Bytes read at once.
const AT_ONCE: usize = 2_048;
/// How long a connection may accept nothing, and how long an attempt to connect may last.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long a connection may stay unproven; the ground station's HEARTBEAT comes once a second.
const ACCEPTED_WITHIN: Duration = Duration::from_secs(10);
/// A connection silent for so long is probed, three times at the same interval.
const PROBED_AFTER: Duration = Duration::from_secs(5);
/// Between attempts.
const AGAIN: Duration = Duration::from_secs(2);

#[cfg(test)]
mod tests {
    use tokio::net::TcpSocket;

    use super::*;

    #[tokio::test]
    async fn both_ends_exchange_bytes_and_who_is_gone_is_sent_nothing() {
        let address = free();
        let (mut server, to_clients) = listen(address).unwrap();
        let (mut client, to_server) = connect(address);
        let mut bytes = [0; 100];
        while to_server.push(b"hello", address).is_err() {
            sleep(Duration::from_millis(5)).await;
        }
        let (length, from) = server.receive(&mut bytes).await.unwrap();
        assert_eq!(&bytes[..length], b"hello");
        let Peer::Tcp(from) = from else {
            panic!("{from:?}")
        };
        to_clients.push(b"there", from).unwrap();
        let (length, from_server) = client.receive(&mut bytes).await.unwrap();
        assert_eq!(
            (&bytes[..length], from_server),
            (&b"there"[..], Peer::Tcp(address))
        );
        // The client's end is closed: its connection goes, and so does what is for it.
        drop(client);
        let gone = async {
            while to_clients.push(b"nobody", from).is_ok() {
                sleep(Duration::from_millis(5)).await;
            }
        };
        timeout(PATIENCE, gone).await.expect("it is noticed");
        let fault = to_clients
            .push(b"nobody", from)
            .map_err(|fault| fault.kind());
        assert_eq!(fault, Err(io::ErrorKind::NotConnected));
    }

    fn free() -> SocketAddr {
        let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        free.local_addr().unwrap()
    }

    /// Connects from a host, and is received.
    async fn client(from: &str, to: SocketAddr, server: &mut TcpReader) -> (TcpStream, SocketAddr) {
        let socket = TcpSocket::new_v4().unwrap();
        socket.bind(from.parse().unwrap()).unwrap();
        let mut client = socket.connect(to).await.unwrap();
        client.write_all(b"x").await.unwrap();
        let received = timeout(PATIENCE, server.receive(&mut [0; 9])).await;
        match received.expect("it is served").unwrap() {
            (_, Peer::Tcp(peer)) => (client, peer),
            other => panic!("{other:?}"),
        }
    }

    async fn is_closed(client: &mut TcpStream) -> bool {
        let read = timeout(PATIENCE, client.read(&mut [0; 9])).await;
        !matches!(read, Ok(Ok(1..)) | Err(_))
    }

    const LOCAL: &str = "127.0.0.1:0";

    #[tokio::test]
    async fn who_connects_last_takes_the_place_of_the_oldest_stranger_and_never_that_of_the_ground_station()
     {
        let address = free();
        let (mut server, to_clients) = listen(address).unwrap();
        let mut strangers = vec![];
        for _ in 0..MAX_CONNECTIONS {
            strangers.push(client(LOCAL, address, &mut server).await.0);
        }
        let (mut station, peer) = client(LOCAL, address, &mut server).await;
        assert!(is_closed(&mut strangers[0]).await, "the oldest gives way");
        to_clients.accept(peer);
        // They come again and again.
        for _ in 0..3 * MAX_CONNECTIONS {
            strangers.push(client(LOCAL, address, &mut server).await.0);
        }
        to_clients.push(b"on", peer).unwrap();
        let mut bytes = [0; 2];
        station.read_exact(&mut bytes).await.unwrap();
        assert_eq!(&bytes, b"on");
        // Its next connection is taken too, and is the one that stays from then on.
        let (_again, peer) = client(LOCAL, address, &mut server).await;
        to_clients.accept(peer);
        for _ in 0..3 * MAX_CONNECTIONS {
            strangers.push(client(LOCAL, address, &mut server).await.0);
        }
        to_clients.push(b"on", peer).unwrap();
        assert_eq!(to_clients.lock().all.len(), MAX_CONNECTIONS);
    }

    #[tokio::test]
    async fn one_host_takes_no_place_of_another() {
        let address = free();
        let (mut server, to_clients) = listen(address).unwrap();
        let (_station, peer) = client(LOCAL, address, &mut server).await;
        let mut strangers = vec![];
        for _ in 0..3 * MAX_CONNECTIONS {
            strangers.push(client("127.0.0.2:0", address, &mut server).await.0);
        }
        // Before it has shown itself.
        to_clients.push(b"on", peer).unwrap();
    }

    #[tokio::test]
    async fn silent_strangers_keep_nobody_out_and_who_is_accepted_stays() {
        let address = free();
        let (mut server, to_clients) = listen(address).unwrap();
        let (mut station, from) = client(LOCAL, address, &mut server).await;
        to_clients.accept(from);
        let mut strangers = vec![];
        while strangers.len() + 1 < MAX_CONNECTIONS {
            strangers.push(TcpStream::connect(address).await.unwrap());
        }
        // They are served, and wait.
        while to_clients.lock().all.len() < MAX_CONNECTIONS {
            sleep(Duration::from_millis(5)).await;
        }
        tokio::time::pause();
        sleep(ACCEPTED_WITHIN + Duration::from_secs(1)).await;
        tokio::time::resume();
        for mut stranger in strangers {
            let read = timeout(PATIENCE, stranger.read(&mut [0; 9])).await;
            assert!(matches!(read, Ok(Ok(0))), "{read:?}");
        }
        to_clients.push(b"on", from).unwrap();
        let mut bytes = [0; 2];
        station.read_exact(&mut bytes).await.unwrap();
        assert_eq!(&bytes, b"on");
        assert_eq!(to_clients.lock().all.len(), 1, "there is room again");
    }
}
