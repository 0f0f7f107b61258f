//! What the benches of `vsm run` as a process share: sockets on loopback and the wall clock. Beside it, for those that need
//! it: the vehicle's frames, and what a process costs.

use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

pub(crate) fn free() -> SocketAddr {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    socket.local_addr().expect("its address")
}

pub(crate) fn socket() -> UdpSocket {
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let wait = Some(Duration::from_millis(200));
    socket.set_read_timeout(wait).expect("a time-out");
    socket
}

pub(crate) fn wall() -> Duration {
    let wall = SystemTime::now().duration_since(UNIX_EPOCH);
    wall.expect("after 1970")
}
