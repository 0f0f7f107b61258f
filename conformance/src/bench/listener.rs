//! A UDP socket with its receiving thread: shared by the programs of the suite.

use std::io;
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// A socket that passes on what it receives; closed when dropped.
#[derive(Debug)]
pub struct Listener {
    socket: Arc<UdpSocket>,
    /// Its address.
    pub local: SocketAddr,
    closing: Arc<AtomicBool>,
}

/// A socket on a fresh port, bound to the address from which `remote` is reached: a recording with 0.0.0.0 in it would not open
/// as one conversation.
///
/// # Errors
/// The system has no socket, or no way to the address.
pub fn towards(remote: SocketAddr) -> io::Result<UdpSocket> {
    let any: IpAddr = if remote.is_ipv4() {
        [0, 0, 0, 0].into()
    } else {
        [0_u16; 8].into()
    };
    let probe = UdpSocket::bind((any, 0))?;
    probe.connect(remote)?;
    UdpSocket::bind((probe.local_addr()?.ip(), 0))
}

impl Listener {
    /// Receives in a thread of its own. `take` is given the socket to answer by, the sender, and the datagram. After
    /// the drop the port is free within `notice`.
    ///
    /// # Errors
    /// The socket has no address, or takes no time-out.
    pub fn start(
        socket: UdpSocket,
        notice: Duration,
        mut take: impl FnMut(&UdpSocket, SocketAddr, &[u8]) + Send + 'static,
    ) -> io::Result<Self> {
        let local = socket.local_addr()?;
        socket.set_read_timeout(Some(notice))?;
        let socket = Arc::new(socket);
        let closing = Arc::new(AtomicBool::new(false));
        let (of_thread, closes) = (socket.clone(), closing.clone());
        // Not joined: the thread ends within its read timeout, and a join would make every drop wait for it.
        std::thread::spawn(move || {
            let mut buffer = vec![0; 65_536];
            while !closes.load(Ordering::SeqCst) {
                // A refused datagram (ICMP) is reported as an error of the next receive: the loop continues, since
                // the subject may come back.
                if let Ok((length, from)) = of_thread.recv_from(&mut buffer) {
                    take(&of_thread, from, &buffer[..length]);
                }
            }
        });
        Ok(Self {
            socket,
            local,
            closing,
        })
    }

    /// Sends a datagram. An error (no listener, too long) is ignored: the rule sees that no answer comes.
    pub fn send(&self, bytes: &[u8], to: SocketAddr) {
        let _ = self.socket.send_to(bytes, to);
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        self.closing.store(true, Ordering::SeqCst);
    }
}
