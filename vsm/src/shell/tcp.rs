//! MAVLink over TCP, for other ground stations (`[[forward]]`) alone: a vehicle's link would queue what is stale.
//!
//! A connection is a peer as an address of UDP is one: the machine decides which of them is the ground station, and only that one
//! is sent anything. What a connection does not take is lost, as on any link, and one that takes nothing for `PATIENCE` is
//! closed. Few may connect at once; what comes after them is turned away. So that strangers who say nothing do not keep the
//! ground station out, one that has connected and that the machine has not accepted ([`TcpWriter::accept`]) within
//! `ACCEPTED_WITHIN` is closed, and one whose other end is gone is found by the system's probes.

use std::collections::HashMap;
use std::io;
use std::net::SocketAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

use socket2::{SockRef, TcpKeepalive};
use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{mpsc, watch};
use tokio::time::{sleep, timeout};

use crate::session::Peer;

/// What arrives on any connection.
#[derive(Debug)]
pub struct TcpReader(mpsc::Receiver<(SocketAddr, Vec<u8>)>);

/// The connections.
#[derive(Debug, Clone, Default)]
pub struct TcpWriter(Arc<Mutex<HashMap<SocketAddr, Connection>>>);

#[derive(Debug)]
struct Connection {
    queue: mpsc::Sender<Vec<u8>>,
    /// Whether the machine has taken its other end for the ground station.
    accepted: watch::Sender<bool>,
}

/// What its task needs of it.
struct Ends {
    queue: mpsc::Receiver<Vec<u8>>,
    accepted: watch::Receiver<bool>,
}

impl TcpReader {
    /// What came, and from where.
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
        let connections = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let connection = connections.get(&to).ok_or(io::ErrorKind::NotConnected)?;
        let queued = connection.queue.try_send(bytes.to_vec());
        queued.map_err(|_| io::ErrorKind::WouldBlock.into())
    }

    /// The machine takes who is at the other end for the ground station: the connection stays.
    pub fn accept(&self, peer: SocketAddr) {
        let connections = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(connection) = connections.get(&peer) {
            connection.accepted.send_replace(true);
        }
    }

    fn add(&self, peer: SocketAddr) -> Option<Ends> {
        let mut connections = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if connections.len() >= MAX_CONNECTIONS {
            return None;
        }
        let (sender, queue) = mpsc::channel(QUEUE);
        let (waits, accepted) = watch::channel(false);
        let connection = Connection {
            queue: sender,
            accepted: waits,
        };
        connections.insert(peer, connection);
        Some(Ends { queue, accepted })
    }

    fn remove(&self, peer: SocketAddr) {
        let mut connections = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        connections.remove(&peer);
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
                // The configuration has it no more.
                () = sender.closed() => return,
                accepted = listener.accept() => accepted,
            };
            match accepted {
                Ok((stream, peer)) => match connections.add(peer) {
                    Some(ends) => {
                        let serve = serve(stream, peer, ends, sender.clone(), connections.clone());
                        tokio::spawn(serve);
                    }
                    None => tracing::warn!(
                        "TCP {address}: {MAX_CONNECTIONS} are connected, {peer} is turned away"
                    ),
                },
                Err(cause) => {
                    tracing::warn!("TCP {address}: {cause}");
                    sleep(AGAIN).await;
                }
            }
        }
    });
    Ok((TcpReader(receiver), writer))
}

/// Connects, again and again. Must be called within a tokio runtime.
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
                    if let Some(ends) = connections.add(peer) {
                        // Who is connected to is who the configuration names.
                        connections.accept(peer);
                        serve(stream, peer, ends, sender.clone(), connections.clone()).await;
                    }
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
    // Frames are small, and each is awaited.
    let _ = stream.set_nodelay(true);
    // A ground station that is switched off closes nothing.
    let probes = TcpKeepalive::new()
        .with_time(PROBED_AFTER)
        .with_interval(PROBED_AFTER)
        .with_retries(3);
    let _ = SockRef::from(&stream).set_tcp_keepalive(&probes);
    let Ends {
        mut queue,
        mut accepted,
    } = ends;
    let (mut reading, mut writing) = stream.into_split();
    let read = async {
        let mut bytes = vec![0; AT_ONCE];
        loop {
            match reading.read(&mut bytes).await {
                Ok(0) | Err(_) => return,
                // Whoever sends faster than it is read waits: TCP holds it back.
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
    let stranger = async {
        let waited = timeout(ACCEPTED_WITHIN, accepted.wait_for(|accepted| *accepted));
        if waited.await.is_ok() {
            std::future::pending::<()>().await;
        }
        tracing::info!(
            "TCP: {peer} has not shown itself as the ground station within {} s and is disconnected",
            ACCEPTED_WITHIN.as_secs()
        );
    };
    tokio::select! {
        () = read => {}
        () = write => {}
        () = stranger => {}
        () = received.closed() => {}
    }
    connections.remove(peer);
}

/// Connections of one link at once: the ground station, its next try, and strangers.
const MAX_CONNECTIONS: usize = 4;
/// Frames that wait for a connection, and pieces that wait to be read.
const QUEUE: usize = 64;
/// Bytes read at once.
const AT_ONCE: usize = 2_048;
/// How long a connection may take nothing, or an attempt to connect last.
const PATIENCE: Duration = Duration::from_secs(5);
/// How long who connects may leave open whether it is the ground station, whose HEARTBEAT comes once a second.
const ACCEPTED_WITHIN: Duration = Duration::from_secs(10);
/// A connection that is silent so long is probed, three times at the same interval.
const PROBED_AFTER: Duration = Duration::from_secs(5);
/// Between attempts.
const AGAIN: Duration = Duration::from_secs(2);

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn both_ends_exchange_bytes_and_who_is_gone_is_sent_nothing() {
        let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = free.local_addr().unwrap();
        drop(free);
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

    #[tokio::test]
    async fn no_more_than_a_few_connect_at_once() {
        let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = free.local_addr().unwrap();
        drop(free);
        let (mut server, _to_clients) = listen(address).unwrap();
        let mut clients = vec![];
        for _ in 0..MAX_CONNECTIONS {
            let mut client = TcpStream::connect(address).await.unwrap();
            client.write_all(b"x").await.unwrap();
            server.receive(&mut [0; 9]).await.unwrap();
            clients.push(client);
        }
        let mut late = TcpStream::connect(address).await.unwrap();
        let read = timeout(PATIENCE, late.read(&mut [0; 9])).await;
        assert!(
            !matches!(read, Ok(Ok(1..)) | Err(_)),
            "it is turned away: {read:?}"
        );
    }

    #[tokio::test]
    async fn silent_strangers_keep_nobody_out_and_who_is_accepted_stays() {
        let free = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
        let address = free.local_addr().unwrap();
        drop(free);
        let (mut server, to_clients) = listen(address).unwrap();
        let mut station = TcpStream::connect(address).await.unwrap();
        station.write_all(b"x").await.unwrap();
        let (_, from) = server.receive(&mut [0; 9]).await.unwrap();
        let Peer::Tcp(from) = from else {
            panic!("{from:?}")
        };
        to_clients.accept(from);
        let mut strangers = vec![];
        while strangers.len() + 1 < MAX_CONNECTIONS {
            strangers.push(TcpStream::connect(address).await.unwrap());
        }
        // They are served, and wait.
        while to_clients.0.lock().unwrap().len() < MAX_CONNECTIONS {
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
        let mut late = TcpStream::connect(address).await.unwrap();
        late.write_all(b"y").await.unwrap();
        let received = timeout(PATIENCE, server.receive(&mut [0; 9])).await;
        assert!(received.is_ok(), "there is room again");
    }
}
