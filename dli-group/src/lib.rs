//! The multicast group of a DLI: joining it, and sending to it, by IPv4 and IPv6.
//!
//! Edition 2.5 has all CUCSs and VSMs on one group and one port (clauses 1.5.1, 4.1). Which, through which network interface,
//! how far and from whom is a [`Group`]. A bridge receives and sends with [`Group::receiver`] alone; a ground station whose
//! network stack wants two sockets has [`Group::sender`] beside it.
//!
//! An interface is chosen by its name or by an address of it, and asked for by its index: a second interface in the same
//! network, or none with a default route, must not decide where an aircraft's status goes.

#![forbid(unsafe_code)]

use std::collections::BTreeMap;
use std::convert::Infallible;
use std::fmt;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, SocketAddrV6, UdpSocket};
use std::str::FromStr;

use socket2::{Domain, InterfaceIndexOrAddress, Protocol, Socket, Type};

/// A group, and how this computer takes part in it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Group {
    /// Group and port.
    pub address: SocketAddr,
    /// Where it is joined and sent to; without one, where the system's routes say.
    pub interface: Option<Interface>,
    /// Routers that what is sent may pass, plus one (TTL, hop limit); 0 stays on this computer.
    pub ttl: u8,
    /// Who may send to it; everybody where there is none. IPv4: the network is asked for these alone (IGMPv3).
    pub sources: Vec<IpAddr>,
    /// Whether other programs of this computer receive what is sent.
    pub loopback: bool,
}

/// A network interface, as a person names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Interface {
    /// By an address that it has.
    Address(IpAddr),
    /// By its name, such as `eth0`.
    Name(String),
}

impl FromStr for Interface {
    type Err = Infallible;

    fn from_str(text: &str) -> Result<Interface, Infallible> {
        Ok(match text.parse() {
            Ok(address) => Interface::Address(address),
            Err(_) => Interface::Name(text.to_owned()),
        })
    }
}

impl fmt::Display for Interface {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Interface::Address(address) => address.fmt(f),
            Interface::Name(name) => name.fmt(f),
        }
    }
}

/// Why a group cannot be joined or sent to.
#[derive(Debug, thiserror::Error)]
pub enum GroupError {
    /// This computer has no such interface.
    #[error("{interface} is no interface of this computer: expected one of {there}")]
    NoInterface {
        /// What was named.
        interface: Interface,
        /// What there is.
        there: String,
    },
    /// The interface has no address of the group's kind.
    #[error("the interface {interface} has no IPv4 address, and the group {group} is one of IPv4")]
    NoAddress {
        /// What was named.
        interface: Interface,
        /// The group.
        group: SocketAddr,
    },
    /// The system refuses.
    #[error(transparent)]
    System(#[from] io::Error),
}

/// An interface as the system knows it.
#[derive(Debug, Clone, Copy)]
struct Place {
    index: u32,
    v4: Option<Ipv4Addr>,
}

impl Group {
    /// A group in the network at hand: through the system's interface, to the next router (TTL 1), from everybody, to other
    /// programs of this computer too.
    #[must_use]
    pub fn new(address: SocketAddr) -> Group {
        Group {
            address,
            interface: None,
            ttl: 1,
            sources: Vec::new(),
            loopback: true,
        }
    }

    /// Whether a datagram from there is taken. The kernel filters by source too where it can (IPv4); this holds for all.
    #[must_use]
    pub fn takes_from(&self, from: IpAddr) -> bool {
        self.sources.is_empty() || self.sources.contains(&from)
    }

    /// A socket that receives what is sent to the group, through its interface alone, and can send to it. Its port is shared
    /// with other programs of this computer.
    ///
    /// # Errors
    /// There is no such interface, or the system refuses.
    pub fn receiver(&self) -> Result<UdpSocket, GroupError> {
        let place = self.place()?;
        let socket = udp(self.address, true)?;
        // Bound to the group itself only its datagrams arrive, and none of another group with this port.
        let at = self.bound_to(place);
        let any = match self.address {
            SocketAddr::V4(_) => IpAddr::from(Ipv4Addr::UNSPECIFIED),
            SocketAddr::V6(_) => IpAddr::from(Ipv6Addr::UNSPECIFIED),
        };
        let any = SocketAddr::new(any, self.address.port());
        socket
            .bind(&at.into())
            .or_else(|_| socket.bind(&any.into()))?;
        self.join(&socket, place)?;
        self.send_through(&socket, place)?;
        Ok(socket.into())
    }

    /// A socket that sends to the group, from this port, or any for 0, and receives what is sent to it alone.
    ///
    /// # Errors
    /// There is no such interface, the port is taken, or the system refuses.
    pub fn sender(&self, port: u16) -> Result<UdpSocket, GroupError> {
        let place = self.place()?;
        let socket = udp(self.address, false)?;
        let from = match (self.address, place) {
            // What comes back to the sender's address arrives where it has gone out.
            (SocketAddr::V4(_), Some(Place { v4: Some(v4), .. })) => IpAddr::from(v4),
            (SocketAddr::V4(_), _) => Ipv4Addr::UNSPECIFIED.into(),
            (SocketAddr::V6(_), _) => Ipv6Addr::UNSPECIFIED.into(),
        };
        socket.bind(&SocketAddr::new(from, port).into())?;
        self.send_through(&socket, place)?;
        Ok(socket.into())
    }

    fn bound_to(&self, place: Option<Place>) -> SocketAddr {
        match self.address {
            SocketAddr::V6(group) => {
                // A group of a link or an interface (ff01::, ff02::) is none without the interface.
                let scope = place.map_or(group.scope_id(), |place| place.index);
                let of_link = matches!(group.ip().segments()[0] & 0xf, 1 | 2);
                let scope = if of_link { scope } else { 0 };
                SocketAddrV6::new(*group.ip(), group.port(), 0, scope).into()
            }
            v4 => v4,
        }
    }

    fn join(&self, socket: &Socket, place: Option<Place>) -> io::Result<()> {
        match self.address.ip() {
            IpAddr::V4(group) => {
                // Else what arrives on an interface that some other program has joined would be received, too.
                socket.set_multicast_all_v4(false)?;
                let at = place.and_then(|place| place.v4);
                let at = at.unwrap_or(Ipv4Addr::UNSPECIFIED);
                let mut filtered = false;
                for source in &self.sources {
                    if let IpAddr::V4(source) = source {
                        socket.join_ssm_v4(source, &group, &at)?;
                        filtered = true;
                    }
                }
                if filtered {
                    return Ok(());
                }
                let at = match place {
                    Some(place) => InterfaceIndexOrAddress::Index(place.index),
                    None => InterfaceIndexOrAddress::Address(Ipv4Addr::UNSPECIFIED),
                };
                socket.join_multicast_v4_n(&group, &at)
            }
            IpAddr::V6(group) => {
                socket.set_multicast_all_v6(false)?;
                socket.join_multicast_v6(&group, place.map_or(0, |place| place.index))
            }
        }
    }

    fn send_through(&self, socket: &Socket, place: Option<Place>) -> io::Result<()> {
        match self.address {
            SocketAddr::V4(_) => {
                if let Some(v4) = place.and_then(|place| place.v4) {
                    socket.set_multicast_if_v4(&v4)?;
                }
                socket.set_multicast_ttl_v4(self.ttl.into())?;
                socket.set_multicast_loop_v4(self.loopback)
            }
            SocketAddr::V6(_) => {
                if let Some(place) = place {
                    socket.set_multicast_if_v6(place.index)?;
                }
                socket.set_multicast_hops_v6(self.ttl.into())?;
                socket.set_multicast_loop_v6(self.loopback)
            }
        }
    }

    fn place(&self) -> Result<Option<Place>, GroupError> {
        let Some(interface) = &self.interface else {
            return Ok(None);
        };
        let there = interfaces()?;
        let is_meant = |(address, name): &(&IpAddr, &String)| match interface {
            Interface::Address(wanted) => *address == wanted,
            Interface::Name(wanted) => *name == wanted,
        };
        let name = match (there.iter().find(is_meant), interface) {
            (Some((_, name)), _) => name.clone(),
            // One without any address can still be joined by IPv6.
            (None, Interface::Name(name)) if index_of(name).is_some() => name.clone(),
            (None, _) => {
                let there = there
                    .iter()
                    .map(|(address, name)| format!("{name} ({address})"));
                return Err(GroupError::NoInterface {
                    interface: interface.clone(),
                    there: there.collect::<Vec<_>>().join(", "),
                });
            }
        };
        let of_it = there.iter().filter(|(_, of)| **of == name);
        let own = |address: &IpAddr| match (address, interface) {
            (IpAddr::V4(v4), Interface::Address(IpAddr::V4(wanted))) => {
                (v4 == wanted).then_some(*v4)
            }
            (IpAddr::V4(v4), _) => Some(*v4),
            (IpAddr::V6(_), _) => None,
        };
        let v4 = of_it.filter_map(|(address, _)| own(address)).next();
        if self.address.is_ipv4() && v4.is_none() {
            return Err(GroupError::NoAddress {
                interface: interface.clone(),
                group: self.address,
            });
        }
        let index = index_of(&name).ok_or_else(|| io::Error::from(io::ErrorKind::NotFound))?;
        Ok(Some(Place { index, v4 }))
    }
}

/// The addresses of this computer, with the name of the interface of each.
///
/// # Errors
/// The system's.
pub fn interfaces() -> io::Result<BTreeMap<IpAddr, String>> {
    let all = nix::ifaddrs::getifaddrs()?;
    let of = |one: nix::ifaddrs::InterfaceAddress| {
        let address = one.address?;
        let ip = match (address.as_sockaddr_in(), address.as_sockaddr_in6()) {
            (Some(v4), _) => v4.ip().into(),
            (_, Some(v6)) => v6.ip().into(),
            _ => return None,
        };
        Some((ip, one.interface_name))
    };
    Ok(all.filter_map(of).collect())
}

fn index_of(name: &str) -> Option<u32> {
    nix::net::if_::if_nametoindex(name).ok()
}

fn udp(family: SocketAddr, shared: bool) -> io::Result<Socket> {
    let socket = Socket::new(
        Domain::for_address(family),
        Type::DGRAM,
        Some(Protocol::UDP),
    )?;
    socket.set_reuse_address(shared)?;
    socket.set_nonblocking(true)?;
    // The system's default does as well, only with more loss in bursts.
    let _ = socket.set_recv_buffer_size(RECEIVE_BUFFER);
    let _ = socket.set_send_buffer_size(SEND_BUFFER);
    Ok(socket)
}

/// Bursts of an upload wait here while a record is written. The system may grant less.
const RECEIVE_BUFFER: usize = 1 << 20;
/// More than ARP holds for one computer that is not there (`unres_qlen_bytes`, 212,992 bytes), so that what is sent to the others
/// finds room. The system may grant less.
const SEND_BUFFER: usize = 1 << 20;

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn on_loopback(group: &str) -> Group {
        Group {
            interface: Some(Interface::Name("lo".to_owned())),
            ..Group::new(group.parse().expect("a group"))
        }
    }

    fn received(socket: &UdpSocket) -> Option<(Vec<u8>, SocketAddr)> {
        socket.set_nonblocking(false).expect("a socket");
        let patience = Some(Duration::from_millis(200));
        socket.set_read_timeout(patience).expect("a socket");
        let mut bytes = [0; 16];
        let (length, from) = socket.recv_from(&mut bytes).ok()?;
        Some((bytes[..length].to_vec(), from))
    }

    #[test]
    fn several_members_receive_what_one_sends() {
        // Loopback carries no multicast of IPv6: that is tested between namespaces (tests/end-to-end).
        for group in ["239.45.86.10:26010", "239.45.86.16:26011"] {
            let group = on_loopback(group);
            let members = [group.receiver().unwrap(), group.receiver().unwrap()];
            let sender = group.sender(0).unwrap();
            let to = group.bound_to(group.place().unwrap());
            sender.send_to(b"x", to).unwrap();
            for member in &members {
                assert_eq!(received(member).expect("it arrives").0, b"x", "{group:?}");
            }
            // A member sends, too, and another port than the group's is no way in.
            members[0].send_to(b"y", to).unwrap();
            assert_eq!(received(&members[1]).expect("it arrives").0, b"y");
        }
    }

    #[test]
    fn what_is_not_wanted_does_not_arrive() {
        let group = on_loopback("239.45.86.11:26013");
        let filtered = Group {
            sources: vec![[127, 0, 0, 9].into()],
            ..group.clone()
        };
        let member = filtered.receiver().unwrap();
        group
            .sender(0)
            .unwrap()
            .send_to(b"x", group.address)
            .unwrap();
        assert_eq!(received(&member), None);
        assert!(
            !filtered.takes_from([127, 0, 0, 1].into()) && group.takes_from([127, 0, 0, 1].into())
        );
        let from_source = Group {
            interface: Some(Interface::Address([127, 0, 0, 1].into())),
            sources: vec![[127, 0, 0, 1].into()],
            ..group.clone()
        };
        let member = from_source.receiver().unwrap();
        group
            .sender(0)
            .unwrap()
            .send_to(b"z", group.address)
            .unwrap();
        assert_eq!(received(&member).expect("it arrives").0, b"z");
        // Another group with the same port.
        let other = on_loopback("239.45.86.12:26013").receiver().unwrap();
        group
            .sender(0)
            .unwrap()
            .send_to(b"x", group.address)
            .unwrap();
        assert_eq!(received(&other), None);
    }

    #[test]
    fn an_unknown_interface_is_named_with_those_that_there_are() {
        for name in ["nosuch0", "203.0.113.9"] {
            let group = Group {
                interface: Some(name.parse().expect("any text")),
                ..Group::new(SocketAddr::from(([239, 45, 86, 14], 26_015)))
            };
            let fault = group.receiver().expect_err("no such interface").to_string();
            assert!(
                fault.contains(name) && fault.contains("lo (127.0.0.1)"),
                "{fault}"
            );
        }
    }

    #[test]
    fn hops_and_loopback_are_those_that_are_asked_for() {
        let group = Group {
            ttl: 7,
            ..on_loopback("239.45.86.15:26016")
        };
        let socket = group.sender(0).unwrap();
        assert_eq!(
            socket2::SockRef::from(&socket).multicast_ttl_v4().unwrap(),
            7
        );
        assert!(socket2::SockRef::from(&socket).multicast_loop_v4().unwrap());
        let six = Group {
            ttl: 0,
            loopback: false,
            ..on_loopback("[ff15::4587]:26017")
        };
        let socket = six.receiver().unwrap();
        assert_eq!(
            socket2::SockRef::from(&socket).multicast_hops_v6().unwrap(),
            0
        );
    }
}
