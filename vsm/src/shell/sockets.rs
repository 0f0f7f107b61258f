//! The sockets of the configuration: bound, joined, or refused with what to do about it.

use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs};

use socket2::{Domain, Protocol, Socket, Type};
use tokio::io::{AsyncReadExt, AsyncWriteExt, ReadHalf, WriteHalf};
use tokio::net::UdpSocket;
use tokio_serial::{SerialPortBuilderExt, SerialStream};

use crate::config::{Dli, LinkAddress};
use crate::session::{Durability, Peer, Store};

/// A socket that cannot be had.
#[derive(Debug, thiserror::Error)]
pub enum SocketError {
    /// The address cannot be bound.
    #[error("cannot listen on {key} = \"{address}\": {cause}{hint}")]
    Bind {
        /// The key of the configuration.
        key: &'static str,
        /// The address.
        address: String,
        /// The system's reason.
        cause: io::Error,
        /// What to do.
        hint: &'static str,
    },
    /// The host of a udpout link has no address.
    #[error("{key}: the host of \"udpout:{address}\" cannot be resolved: {cause}")]
    Resolve {
        /// The key of the configuration.
        key: &'static str,
        /// Host and port.
        address: String,
        /// The system's reason.
        cause: io::Error,
    },
    /// A serial device cannot be opened.
    #[error("{key}: the serial device {device} cannot be opened: {cause}")]
    Serial {
        /// The key of the configuration.
        key: &'static str,
        /// The device.
        device: String,
        /// The system's reason.
        cause: tokio_serial::Error,
    },
}

impl SocketError {
    fn bind(key: &'static str, address: impl ToString, cause: io::Error) -> SocketError {
        let hint = match cause.kind() {
            io::ErrorKind::AddrInUse => {
                " (another program has it: is a vsm or a ground station running?)"
            }
            io::ErrorKind::AddrNotAvailable => " (this computer has no such address)",
            io::ErrorKind::PermissionDenied => " (ports below 1024 need rights)",
            _ => "",
        };
        SocketError::Bind {
            key,
            address: address.to_string(),
            cause,
            hint,
        }
    }
}

/// The DLI side: a socket for stations, and one for the group where there is one.
#[derive(Debug)]
pub struct DliSockets {
    /// Bound to `dli.listen`.
    pub unicast: UdpSocket,
    /// Joined to `dli.multicast`, and the group.
    pub group: Option<(UdpSocket, SocketAddr)>,
}

impl DliSockets {
    /// Binds and joins.
    ///
    /// # Errors
    /// An address is taken or not this computer's.
    pub fn open(dli: &Dli) -> Result<DliSockets, SocketError> {
        let unicast = udp(dli.listen, false)
            .map_err(|cause| SocketError::bind("dli.listen", dli.listen, cause))?;
        let group = match dli.multicast {
            None => None,
            Some(group) => {
                let socket = join(group, dli.interface)
                    .map_err(|cause| SocketError::bind("dli.multicast", group, cause))?;
                Some((socket, group))
            }
        };
        Ok(DliSockets { unicast, group })
    }
}

/// The reading end of a vehicle's link.
#[derive(Debug)]
pub enum VehicleReader {
    /// Datagrams.
    Udp(std::rc::Rc<UdpSocket>),
    /// A stream of octets.
    Serial(ReadHalf<SerialStream>),
}

/// The writing end of a vehicle's link.
#[derive(Debug)]
pub enum VehicleWriter {
    /// Datagrams.
    Udp(std::rc::Rc<UdpSocket>),
    /// A stream of octets.
    Serial(WriteHalf<SerialStream>),
}

impl VehicleReader {
    /// What came, and from where.
    ///
    /// # Errors
    /// The system's.
    pub async fn receive(&mut self, octets: &mut [u8]) -> io::Result<(usize, Peer)> {
        match self {
            VehicleReader::Udp(socket) => {
                let (length, from) = socket.recv_from(octets).await?;
                Ok((length, Peer::Udp(from)))
            }
            VehicleReader::Serial(port) => match port.read(octets).await? {
                0 => Err(io::ErrorKind::UnexpectedEof.into()),
                length => Ok((length, Peer::Serial)),
            },
        }
    }
}

impl VehicleWriter {
    /// Sends one frame.
    ///
    /// # Errors
    /// The system's.
    pub async fn send(&mut self, octets: &[u8], to: Peer) -> io::Result<()> {
        match (self, to) {
            (VehicleWriter::Udp(socket), Peer::Udp(to)) => {
                socket.send_to(octets, to).await.map(|_| ())
            }
            (VehicleWriter::Serial(port), _) => port.write_all(octets).await,
            (VehicleWriter::Udp(_), Peer::Serial) => Err(io::ErrorKind::AddrNotAvailable.into()),
        }
    }
}

/// Opens a MAVLink link, named by its `key` of the configuration: its ends, and the fixed peer where there is one.
///
/// PX4 answers the first address that speaks to it for as long as it runs: the local port of a udpout link is kept in
/// the store, and taken again after a restart.
///
/// # Errors
/// The port is taken, the host unknown, the device missing.
pub fn open_link(
    key: &'static str,
    link: &LinkAddress,
    record: &str,
    store: &mut dyn Store,
) -> Result<(VehicleReader, VehicleWriter, Option<Peer>), SocketError> {
    let (socket, peer) = match link {
        LinkAddress::UdpIn(address) => {
            let socket =
                udp(*address, false).map_err(|cause| SocketError::bind(key, link, cause))?;
            (socket, None)
        }
        LinkAddress::UdpOut(host) => {
            let to = host
                .to_socket_addrs()
                .and_then(|mut all| all.next().ok_or_else(|| io::ErrorKind::NotFound.into()))
                .map_err(|cause| SocketError::Resolve {
                    key,
                    address: host.clone(),
                    cause,
                })?;
            let socket = same_port(to, record, store)
                .map_err(|cause| SocketError::bind(key, link, cause))?;
            (socket, Some(Peer::Udp(to)))
        }
        LinkAddress::Serial { device, baud } => {
            let port = tokio_serial::new(device, *baud)
                .open_native_async()
                .map_err(|cause| SocketError::Serial {
                    key,
                    device: device.clone(),
                    cause,
                })?;
            let (reader, writer) = tokio::io::split(port);
            return Ok((
                VehicleReader::Serial(reader),
                VehicleWriter::Serial(writer),
                Some(Peer::Serial),
            ));
        }
    };
    let socket = std::rc::Rc::new(socket);
    Ok((
        VehicleReader::Udp(socket.clone()),
        VehicleWriter::Udp(socket),
        peer,
    ))
}

fn same_port(to: SocketAddr, record: &str, store: &mut dyn Store) -> io::Result<UdpSocket> {
    let any: IpAddr = match (to.ip().is_loopback(), to.is_ipv4()) {
        (true, true) => Ipv4Addr::LOCALHOST.into(),
        (true, false) => Ipv6Addr::LOCALHOST.into(),
        (false, true) => Ipv4Addr::UNSPECIFIED.into(),
        (false, false) => Ipv6Addr::UNSPECIFIED.into(),
    };
    let kept = store.load(record).ok().flatten();
    let kept = kept
        .and_then(|octets| String::from_utf8(octets).ok())
        .and_then(|text| text.trim().parse().ok());
    if let Some(port) = kept {
        match udp(SocketAddr::new(any, port), false) {
            Ok(socket) => return Ok(socket),
            Err(cause) => tracing::warn!(
                "local port {port}, used before, is not to be had ({cause}): another is used"
            ),
        }
    }
    let socket = udp(SocketAddr::new(any, 0), false)?;
    let port = socket.local_addr()?.port();
    if let Err(fault) = store.save(record, format!("{port}\n").as_bytes(), Durability::Process) {
        tracing::warn!("the local port {port} cannot be kept for a restart: {fault}");
    }
    Ok(socket)
}

fn join(group: SocketAddr, interface: Option<IpAddr>) -> io::Result<UdpSocket> {
    let any: IpAddr = if group.is_ipv4() {
        Ipv4Addr::UNSPECIFIED.into()
    } else {
        Ipv6Addr::UNSPECIFIED.into()
    };
    // Bound to the group itself: only its datagrams arrive.
    let socket = udp(SocketAddr::new(group.ip(), group.port()), true)
        .or_else(|_| udp(SocketAddr::new(any, group.port()), true))?;
    match (group.ip(), interface) {
        (IpAddr::V4(group), Some(IpAddr::V4(interface))) => {
            socket.join_multicast_v4(group, interface)?;
            socket2::SockRef::from(&socket).set_multicast_if_v4(&interface)?;
        }
        (IpAddr::V4(group), _) => socket.join_multicast_v4(group, Ipv4Addr::UNSPECIFIED)?,
        (IpAddr::V6(group), _) => socket.join_multicast_v6(&group, 0)?,
    }
    Ok(socket)
}

fn udp(address: SocketAddr, shared: bool) -> io::Result<UdpSocket> {
    let socket = Socket::new(
        Domain::for_address(address),
        Type::DGRAM,
        Some(Protocol::UDP),
    )?;
    // Only a group's port is shared: two programs on one unicast port would each get half of the datagrams.
    socket.set_reuse_address(shared)?;
    socket.set_nonblocking(true)?;
    let _ = socket.set_recv_buffer_size(RECEIVE_BUFFER);
    socket.bind(&address.into())?;
    UdpSocket::from_std(socket.into())
}

/// Bursts of an upload wait here while a record is written. The system may grant less.
const RECEIVE_BUFFER: usize = 1 << 20;
