//! The interfaces of this computer, and whether a group's datagrams arrive on another one than the interface that joined
//! the group.

use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket as BlockingSocket};
use std::time::Duration;

use dli_group::Interface;
use socket2::{Domain, Protocol, Socket, Type};
use tokio::net::UdpSocket;

/// Listens for this long on every interface except the one that the group was joined on. Returns the first interface on
/// which a datagram of the group arrives, and its sender. IPv4 only: a group of IPv6 is joined on the interface that the
/// system chooses.
///
/// # Errors
/// The system's.
pub async fn listen_elsewhere(
    group: SocketAddr,
    joined: Option<&Interface>,
    span: Duration,
) -> io::Result<Option<(IpAddr, SocketAddr)>> {
    let SocketAddr::V4(group) = group else {
        tokio::time::sleep(span).await;
        return Ok(None);
    };
    let addresses = dli_group::interfaces()?;
    let joined = match joined {
        Some(Interface::Name(name)) => Some(name.clone()),
        Some(Interface::Address(at)) => addresses.get(at).cloned(),
        None => routed(group.into())
            .ok()
            .and_then(|at| addresses.get(&at).cloned()),
    };
    let mut sockets = vec![];
    let mut names = vec![];
    for (address, name) in addresses {
        // A second address of the same interface is the same network.
        if let IpAddr::V4(at) = address
            && joined.as_ref() != Some(&name)
            && !names.contains(&name)
        {
            // An interface without multicast cannot join, and nothing arrives there.
            if let Ok(socket) = join_only((*group.ip(), group.port()), at) {
                sockets.push((at, socket));
                names.push(name);
            }
        }
    }
    let end = tokio::time::Instant::now() + span;
    // A longer datagram is cut off, which is fine: only its sender is of interest.
    let mut byte = [0; 1];
    while tokio::time::Instant::now() < end {
        for (at, socket) in &sockets {
            if let Ok((_, from)) = socket.try_recv_from(&mut byte) {
                return Ok(Some(((*at).into(), from)));
            }
        }
        tokio::time::sleep(POLL).await;
    }
    Ok(None)
}

/// The address of the interface that the system would join a group on.
fn routed(group: SocketAddr) -> io::Result<IpAddr> {
    let socket = BlockingSocket::bind((Ipv4Addr::UNSPECIFIED, 0))?;
    // Nothing is sent: connecting a UDP socket only looks up the route.
    socket.connect(group)?;
    Ok(socket.local_addr()?.ip())
}

/// A socket that receives the group's datagrams on this interface only, whatever other programs have joined.
fn join_only((group, port): (Ipv4Addr, u16), at: Ipv4Addr) -> io::Result<UdpSocket> {
    let socket = Socket::new(Domain::IPV4, Type::DGRAM, Some(Protocol::UDP))?;
    socket.set_reuse_address(true)?;
    socket.set_nonblocking(true)?;
    // Linux otherwise delivers a group's datagrams to every socket bound to its address, from any joined interface.
    socket.set_multicast_all_v4(false)?;
    socket.bind(&SocketAddr::from((group, port)).into())?;
    socket.join_multicast_v4(&group, &at)?;
    UdpSocket::from_std(socket.into())
}

const POLL: Duration = Duration::from_millis(50);

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_loopback_address_is_one_of_this_computer() {
        let addresses = dli_group::interfaces().unwrap();
        assert_eq!(
            addresses
                .get(&Ipv4Addr::LOCALHOST.into())
                .map(String::as_str),
            Some("lo")
        );
    }

    #[tokio::test]
    async fn what_arrives_on_the_interface_that_joined_is_not_elsewhere() {
        let group = SocketAddr::from(([225, 200, 77, 1], 51_771));
        let sender = Socket::new(Domain::IPV4, Type::DGRAM, None).unwrap();
        sender.set_multicast_if_v4(&Ipv4Addr::LOCALHOST).unwrap();
        let sending = async {
            for _ in 0..10 {
                sender.send_to(b"x", &group.into()).unwrap();
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
        };
        let here = Interface::Address(Ipv4Addr::LOCALHOST.into());
        let listening = listen_elsewhere(group, Some(&here), Duration::from_millis(600));
        let (found, ()) = tokio::join!(listening, sending);
        assert_eq!(found.unwrap(), None);
    }
}
