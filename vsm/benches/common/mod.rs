//! What the benches of `vsm run` as a process share: sockets on loopback. Beside it, for those that need it: the bridge, and the
//! vehicle's frames.

use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::time::Duration;

/// The program that was built with the bench.
pub(crate) fn vsm() -> &'static Path {
    Path::new(env!("CARGO_BIN_EXE_vsm"))
}

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
