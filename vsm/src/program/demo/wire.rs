//! The network between a client and a server of the demo, over UDP on loopback, with an attacker on it: traffic is
//! recorded, and the attacker's datagrams leave from the client's address.

use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::{Arc, Mutex, PoisonError};

use tokio::net::UdpSocket;
use tokio::task::JoinHandle;

/// It carries until it is dropped.
pub(super) struct Wire {
    /// Where the client sends to.
    pub(super) near: SocketAddr,
    far: Arc<UdpSocket>,
    server: SocketAddr,
    tape: Arc<Mutex<Tape>>,
    carrier: JoinHandle<()>,
}

/// What has passed, in its order.
#[derive(Debug, Default)]
struct Tape {
    to_server: Vec<Vec<u8>>,
    to_client: Vec<Vec<u8>>,
}

impl Wire {
    /// Between the server at this address and one client, which is to send to [`Wire::near`].
    pub(super) async fn to(server: SocketAddr) -> io::Result<Wire> {
        let near = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await?;
        let far = Arc::new(UdpSocket::bind((Ipv4Addr::LOCALHOST, 0)).await?);
        let address = near.local_addr()?;
        let tape = Arc::new(Mutex::new(Tape::default()));
        let carrier = carry(near, Arc::clone(&far), server, Arc::clone(&tape));
        Ok(Wire {
            near: address,
            far,
            server,
            tape,
            carrier: tokio::spawn(carrier),
        })
    }

    /// Sends this to the server from where the client's datagrams come from.
    pub(super) async fn inject(&self, bytes: &[u8]) -> io::Result<()> {
        self.far.send_to(bytes, self.server).await.map(drop)
    }

    /// What the client has sent so far.
    pub(super) fn to_server(&self) -> Vec<Vec<u8>> {
        let tape = self.tape.lock().unwrap_or_else(PoisonError::into_inner);
        tape.to_server.clone()
    }

    /// Everything that has passed, either way.
    pub(super) fn all(&self) -> Vec<Vec<u8>> {
        let tape = self.tape.lock().unwrap_or_else(PoisonError::into_inner);
        [tape.to_server.clone(), tape.to_client.clone()].concat()
    }
}

impl Drop for Wire {
    fn drop(&mut self) {
        self.carrier.abort();
    }
}

async fn carry(near: UdpSocket, far: Arc<UdpSocket>, server: SocketAddr, tape: Arc<Mutex<Tape>>) {
    let (mut from_client, mut from_server) = ([0; 2_048], [0; 2_048]);
    let mut client = None;
    loop {
        // A failed send is a lost datagram, as on any network whose other end is down.
        tokio::select! {
            Ok((length, from)) = near.recv_from(&mut from_client) => {
                client = Some(from);
                let bytes = from_client.get(..length).unwrap_or_default();
                let keep = |tape: &mut Tape| tape.to_server.push(bytes.to_vec());
                keep(&mut tape.lock().unwrap_or_else(PoisonError::into_inner));
                let _ = far.send_to(bytes, server).await;
            }
            Ok((length, _)) = far.recv_from(&mut from_server) => {
                let bytes = from_server.get(..length).unwrap_or_default();
                let keep = |tape: &mut Tape| tape.to_client.push(bytes.to_vec());
                keep(&mut tape.lock().unwrap_or_else(PoisonError::into_inner));
                if let Some(client) = client {
                    let _ = near.send_to(bytes, client).await;
                }
            }
            else => tokio::task::yield_now().await,
        }
    }
}
