//! The sockets of the configuration: bound, joined, or refused with an error that says what to do.

use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, ToSocketAddrs};

use dli_group::{Group, GroupError};
use socket2::{Domain, Protocol, Socket, Type};
use tokio::io::{AsyncReadExt, AsyncWrite, AsyncWriteExt, ReadHalf};
use tokio::net::UdpSocket;
use tokio::sync::mpsc;
use tokio::time::{Duration, Instant};
use tokio_serial::{SerialPortBuilderExt, SerialStream};
use zeroize::Zeroizing;

use super::tcp::{self, TcpReader, TcpWriter};
use crate::config::{Config, Dli, ForwardLink, LinkAddress, Vehicle};
use crate::session::Peer;
use mavlink_link::store::{Disk, Durability, MAX_RECORD_BYTES};

/// A socket that cannot be opened.
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
    /// The interface of the group does not exist on this computer, or has no address of the group's kind.
    #[error("dli.interface: {0}; for example interface = \"lo\"")]
    Interface(GroupError),
    /// The host of a udpout or tcpout link has no address.
    #[error("{key}: the host of \"{address}\" cannot be resolved: {cause}")]
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
    /// The system's reason, without the address: of which kind, and in words.
    pub(super) fn reason(&self) -> (io::ErrorKind, String) {
        match self {
            SocketError::Bind { cause, .. } | SocketError::Resolve { cause, .. } => {
                (cause.kind(), cause.to_string())
            }
            SocketError::Interface(cause) => (io::ErrorKind::Other, cause.to_string()),
            SocketError::Serial { cause, .. } => {
                let kind = match cause.kind {
                    // Another program has locked it.
                    tokio_serial::ErrorKind::NoDevice => io::ErrorKind::ResourceBusy,
                    tokio_serial::ErrorKind::Io(kind) => kind,
                    _ => io::ErrorKind::Other,
                };
                (kind, cause.to_string())
            }
        }
    }

    fn bind(key: &'static str, address: impl ToString, cause: io::Error) -> SocketError {
        let hint = match cause.kind() {
            io::ErrorKind::AddrInUse => {
                " (another program uses it: is a vsm or a ground station running?)"
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

/// The DLI side: a socket for stations, and one for the group, if any.
#[derive(Debug)]
pub struct DliSockets {
    /// Bound to `dli.listen`.
    pub unicast: UdpSocket,
    /// Joined to `dli.multicast`, and the group.
    pub group: Option<(UdpSocket, Group)>,
}

impl DliSockets {
    /// Binds and joins.
    ///
    /// # Errors
    /// An address is taken or not this computer's.
    pub fn open(dli: &Dli) -> Result<DliSockets, SocketError> {
        Ok(DliSockets {
            unicast: DliSockets::open_unicast(dli)?,
            group: DliSockets::open_group(dli)?,
        })
    }

    /// Binds the socket for stations.
    pub(super) fn open_unicast(dli: &Dli) -> Result<UdpSocket, SocketError> {
        udp(dli.listen).map_err(|cause| SocketError::bind("dli.listen", dli.listen, cause))
    }

    /// Joins the group, if there is one.
    pub(super) fn open_group(dli: &Dli) -> Result<Option<(UdpSocket, Group)>, SocketError> {
        let group = dli.group().map(|group| {
            let joined = group
                .receiver()
                .and_then(|socket| Ok(UdpSocket::from_std(socket)?));
            match joined {
                Ok(socket) => Ok((socket, group)),
                Err(GroupError::System(cause)) => {
                    Err(SocketError::bind("dli.multicast", group.address, cause))
                }
                Err(cause) => Err(SocketError::Interface(cause)),
            }
        });
        group.transpose()
    }
}

/// The reading end of a vehicle's link.
#[derive(Debug)]
pub enum VehicleReader {
    /// Datagrams.
    Udp(std::rc::Rc<UdpSocket>),
    /// Connections of TCP.
    Tcp(TcpReader),
    /// A stream of bytes.
    Serial(ReadHalf<SerialStream>),
}

/// The writing end of a vehicle's link; vehicles that share a link have one each.
#[derive(Debug, Clone)]
pub enum VehicleWriter {
    /// Datagrams.
    Udp(std::rc::Rc<UdpSocket>),
    /// Connections of TCP, each with a queue.
    Tcp(TcpWriter),
    /// A stream of bytes, written by a separate task, so that a blocked port (flow control, an unplugged device) delays no
    /// other link. Frames beyond its queue are lost, as on any link.
    Serial(SerialQueue),
}

/// Frames queued for a serial port, each with its time.
#[derive(Debug, Clone)]
pub struct SerialQueue(mpsc::Sender<(Instant, Zeroizing<Vec<u8>>)>);

impl SerialQueue {
    fn push(&self, bytes: &[u8]) -> io::Result<()> {
        let frame = (Instant::now(), Zeroizing::new(bytes.to_vec()));
        self.0.try_send(frame).map_err(|refused| match refused {
            mpsc::error::TrySendError::Full(_) => io::ErrorKind::WouldBlock.into(),
            mpsc::error::TrySendError::Closed(_) => io::ErrorKind::BrokenPipe.into(),
        })
    }
}

impl VehicleReader {
    /// Receives at most `MAX_AT_ONCE` bytes, with their source. A longer datagram is not the vehicle's and is dropped.
    ///
    /// # Errors
    /// The system's.
    pub async fn receive(&mut self, bytes: &mut [u8]) -> io::Result<(usize, Peer)> {
        match self {
            VehicleReader::Udp(socket) => loop {
                // One byte more, to detect a longer datagram.
                let room = bytes.len().min(MAX_AT_ONCE + 1);
                let (length, from) = socket.recv_from(&mut bytes[..room]).await?;
                if length <= MAX_AT_ONCE {
                    return Ok((length, Peer::Udp(from)));
                }
                tracing::debug!("a datagram of over {MAX_AT_ONCE} bytes from {from} is dropped");
            },
            VehicleReader::Tcp(connections) => connections.receive(bytes).await,
            VehicleReader::Serial(port) => match port.read(bytes).await? {
                0 => Err(io::ErrorKind::UnexpectedEof.into()),
                length => Ok((length, Peer::Serial)),
            },
        }
    }
}

impl VehicleReader {
    /// A datagram that has already arrived; `None` if there is none, or if this is not a datagram socket.
    pub fn try_receive(&mut self, bytes: &mut [u8]) -> Option<(usize, Peer)> {
        let VehicleReader::Udp(socket) = self else {
            return None;
        };
        let room = bytes.len().min(MAX_AT_ONCE + 1);
        // The next `receive` reports a fault.
        let (length, from) = socket.try_recv_from(&mut bytes[..room]).ok()?;
        (length <= MAX_AT_ONCE).then_some((length, Peer::Udp(from)))
    }
}

impl VehicleWriter {
    /// The address at which the other end reaches it; `None` if it has none.
    #[must_use]
    pub fn local_addr(&self) -> Option<SocketAddr> {
        match self {
            VehicleWriter::Udp(socket) => socket.local_addr().ok(),
            VehicleWriter::Tcp(_) | VehicleWriter::Serial(_) => None,
        }
    }

    /// The other end is the ground station. (A TCP connection that does not prove this is closed after some seconds.)
    pub fn accept(&self, peer: Peer) {
        if let (VehicleWriter::Tcp(connections), Peer::Tcp(peer)) = (self, peer) {
            connections.accept(peer);
        }
    }

    /// Waits until a frame can be sent. Until the runtime has looked at a socket once, [`try_send`](Self::try_send) drops all.
    pub async fn ready(&self) {
        if let VehicleWriter::Udp(socket) = self {
            // A fault is reported by the next frame.
            let _ = socket.writable().await;
        }
    }

    /// Sends one frame or drops it, without waiting. One socket leads to several vehicles or ground stations: what is sent to
    /// one that is not there must not hold up the others.
    ///
    /// # Errors
    /// The system's; [`io::ErrorKind::WouldBlock`] where there is no room; [`io::ErrorKind::BrokenPipe`] where the task that
    /// writes a serial port is gone, which is the end of the program.
    pub fn try_send(&self, bytes: &[u8], to: Peer) -> io::Result<()> {
        match (self, to) {
            (VehicleWriter::Udp(socket), Peer::Udp(to)) => {
                socket.try_send_to(bytes, to).map(|_| ())
            }
            (VehicleWriter::Tcp(connections), Peer::Tcp(to)) => connections.push(bytes, to),
            (VehicleWriter::Serial(queue), _) => queue.push(bytes),
            (VehicleWriter::Udp(_) | VehicleWriter::Tcp(_), _) => {
                Err(io::ErrorKind::AddrNotAvailable.into())
            }
        }
    }

    /// Sends one frame, when there is room.
    ///
    /// # Errors
    /// As [`try_send`](Self::try_send).
    pub async fn send(&self, bytes: &[u8], to: Peer) -> io::Result<()> {
        self.ready().await;
        self.try_send(bytes, to)
    }
}

/// MAVLink senders fill a datagram up to what a network carries unfragmented, 1,500 bytes. In a longer one each byte could
/// begin a frame whose checksum would have to be computed.
const MAX_AT_ONCE: usize = 2_048;

/// The most frames that wait for a serial port.
const SERIAL_QUEUE: usize = 64;

/// How long a frame may wait for its port. A later command might no longer be intended; the protocols above repeat what is
/// lost.
const SERIAL_PATIENCE: Duration = Duration::from_secs(2);

/// Writes the queue in order until all senders are gone. A frame that the port does not accept is lost, as on any link: if
/// this task ended on an error, the link would be dead while the rest of the program runs.
fn write_apart(mut port: impl AsyncWrite + Unpin + Send + 'static) -> SerialQueue {
    let (queue, mut frames) = mpsc::channel::<(Instant, Zeroizing<Vec<u8>>)>(SERIAL_QUEUE);
    tokio::spawn(async move {
        let mut failing = false;
        while let Some((queued, frame)) = frames.recv().await {
            if queued.elapsed() > SERIAL_PATIENCE {
                tracing::debug!("a frame waited too long for the serial port and is not sent");
                continue;
            }
            if let Err(cause) = port.write_all(&frame).await {
                if !failing {
                    tracing::warn!(%cause, "the serial port cannot be written");
                }
                failing = true;
                continue;
            }
            failing = false;
        }
    });
    SerialQueue(queue)
}

/// How the hosts of `udpout` and `tcpout` links are resolved. A resolver without an answer blocks its thread for half a
/// minute, so while a bridge serves, another thread resolves the names before anything is opened.
#[derive(Debug)]
pub enum Hosts {
    /// Resolved when a link is opened.
    AskNow,
    /// Resolved before; there are no others.
    Known(BTreeMap<String, SocketAddr>),
}

impl Hosts {
    /// Resolves the hosts of these links, each named by its key of the configuration. Blocks.
    ///
    /// # Errors
    /// A host is unknown.
    pub fn ask<'a>(
        links: impl Iterator<Item = (&'static str, &'a str)>,
        resolver: Resolver,
    ) -> Result<Hosts, SocketError> {
        let asked = links.map(|(key, host)| {
            let address = found(key, host, resolver(host))?;
            Ok((host.to_owned(), address))
        });
        Ok(Hosts::Known(asked.collect::<Result<_, SocketError>>()?))
    }

    fn find(&self, key: &'static str, host: &str) -> Result<SocketAddr, SocketError> {
        let address = match self {
            Hosts::AskNow => ask_system(host),
            Hosts::Known(hosts) => Ok(hosts.get(host).copied()),
        };
        found(key, host, address)
    }
}

fn found(
    key: &'static str,
    host: &str,
    address: io::Result<Option<SocketAddr>>,
) -> Result<SocketAddr, SocketError> {
    let address = address.and_then(|found| found.ok_or_else(|| io::ErrorKind::NotFound.into()));
    address.map_err(|cause| SocketError::Resolve {
        key,
        address: host.to_owned(),
        cause,
    })
}

/// Resolves host and port; may be slow.
pub type Resolver = fn(&str) -> io::Result<Option<SocketAddr>>;

/// The system's resolver.
pub(super) fn ask_system(host: &str) -> io::Result<Option<SocketAddr>> {
    host.to_socket_addrs().map(|mut all| all.next())
}

/// The record of a link's local port. It is named by the first vehicle on the link, so that every program opens a shared
/// link from the same port.
#[must_use]
pub fn port_record(config: &Config, vehicle: &Vehicle) -> String {
    let mut on_link = config.vehicles().filter(|one| one.link == vehicle.link);
    let first = on_link.next().unwrap_or(vehicle);
    format!("port-{:08x}", first.id.0)
}

/// Opens a MAVLink link, named by its `key` of the configuration: returns its ends, and the fixed peer if there is one.
///
/// PX4 answers the first address that sends to it for as long as it runs. So the local port of a udpout link is stored, and
/// used again after a restart.
///
/// # Errors
/// The port is taken, the host unknown, the device missing.
pub fn open_link(
    key: &'static str,
    link: &LinkAddress,
    hosts: &Hosts,
    record: &str,
    store: &mut dyn Disk,
) -> Result<(VehicleReader, VehicleWriter, Option<Peer>), SocketError> {
    let (socket, peer) = match link {
        LinkAddress::UdpIn(address) => {
            let socket = udp(*address).map_err(|cause| SocketError::bind(key, link, cause))?;
            (socket, None)
        }
        LinkAddress::UdpOut(host) => {
            let to = hosts.find(key, host)?;
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
                VehicleWriter::Serial(write_apart(writer)),
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

/// Opens the link of another ground station: the kinds of vehicle links, and TCP.
///
/// # Errors
/// As [`open_link`].
pub fn open_forward(
    link: &ForwardLink,
    hosts: &Hosts,
    record: &str,
    store: &mut dyn Disk,
) -> Result<(VehicleReader, VehicleWriter, Option<Peer>), SocketError> {
    const KEY: &str = "forward.link";
    let ((reader, writer), peer) = match link {
        ForwardLink::Shared(link) => return open_link(KEY, link, hosts, record, store),
        ForwardLink::TcpIn(address) => {
            let opened = tcp::listen(*address);
            let opened = opened.map_err(|cause| SocketError::bind(KEY, link, cause))?;
            (opened, None)
        }
        ForwardLink::TcpOut(host) => {
            let to = hosts.find(KEY, host)?;
            (tcp::connect(to), Some(Peer::Tcp(to)))
        }
    };
    Ok((VehicleReader::Tcp(reader), VehicleWriter::Tcp(writer), peer))
}

fn same_port(to: SocketAddr, record: &str, store: &mut dyn Disk) -> io::Result<UdpSocket> {
    // Towards loopback only loopback is bound: nobody else on the network can reach the port.
    let any: IpAddr = match (to.ip().is_loopback(), to.is_ipv4()) {
        (true, true) => Ipv4Addr::LOCALHOST.into(),
        (true, false) => Ipv6Addr::LOCALHOST.into(),
        (false, true) => Ipv4Addr::UNSPECIFIED.into(),
        (false, false) => Ipv6Addr::UNSPECIFIED.into(),
    };
    let kept = store.read(record, MAX_RECORD_BYTES).ok().flatten();
    let kept = kept.and_then(|bytes| std::str::from_utf8(&bytes).ok()?.trim().parse().ok());
    if let Some(port) = kept {
        match udp(SocketAddr::new(any, port)) {
            Ok(socket) => return Ok(socket),
            Err(cause) => tracing::warn!(
                "local port {port}, used before, is not available ({cause}): using another"
            ),
        }
    }
    let socket = udp(SocketAddr::new(any, 0))?;
    let port = socket.local_addr()?.port();
    // Not worth refusing the start: only a PX4 that runs longer than this bridge would not answer the next one.
    if let Err(fault) = store.replace(record, format!("{port}\n").as_bytes(), Durability::Answered)
    {
        tracing::warn!("the local port {port} cannot be kept for a restart: {fault}");
    }
    Ok(socket)
}

fn udp(address: SocketAddr) -> io::Result<UdpSocket> {
    let socket = Socket::new(
        Domain::for_address(address),
        Type::DGRAM,
        Some(Protocol::UDP),
    )?;
    // Not shared, unlike a group's socket: two programs on one unicast port would each get half of the datagrams.
    socket.set_reuse_address(false)?;
    if address.ip() == IpAddr::V6(Ipv6Addr::UNSPECIFIED) {
        // `[::]` means every address, IPv4 included, whatever the system's default.
        socket.set_only_v6(false)?;
    }
    socket.set_nonblocking(true)?;
    // The system's default buffer works too, with more loss in bursts.
    let _ = socket.set_recv_buffer_size(RECEIVE_BUFFER);
    let _ = socket.set_send_buffer_size(SEND_BUFFER);
    socket.bind(&address.into())?;
    UdpSocket::from_std(socket.into())
}

/// Bursts of an upload wait here while a record is written. The system may grant less.
const RECEIVE_BUFFER: usize = 1 << 20;
/// More than ARP holds for one computer that is not there (`unres_qlen_bytes`, 212,992 bytes), so that what is sent to the others
/// finds room. The system may grant less.
const SEND_BUFFER: usize = 1 << 20;

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_datagram_that_no_vehicle_sends_is_passed_over() {
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let to = socket.local_addr().unwrap();
        let mut reader = VehicleReader::Udp(std::rc::Rc::new(socket));
        let sender = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        for length in [60_000, 2_049, 2_048, 1] {
            sender.send_to(&vec![0xfd; length], to).await.unwrap();
        }
        let mut bytes = vec![0; 65_536];
        for length in [2_048, 1] {
            assert_eq!(reader.receive(&mut bytes).await.unwrap().0, length);
        }
    }

    #[tokio::test(start_paused = true)]
    async fn a_port_that_takes_nothing_holds_nobody_up() {
        let (port, mut far) = tokio::io::duplex(16);
        let writer = VehicleWriter::Serial(write_apart(port));
        let frame = [7_u8; 16];
        let mut lost = 0;
        for _ in 0..200 {
            // Each of these returns at once; were it to wait, the test would not end.
            match writer.send(&frame, Peer::Serial).await {
                Ok(()) => tokio::task::yield_now().await,
                Err(cause) => {
                    assert_eq!(cause.kind(), io::ErrorKind::WouldBlock);
                    lost += 1;
                }
            }
        }
        assert!((1..200).contains(&lost), "{lost} lost");
        // What was taken arrives whole and in order, once the port moves again.
        let mut got = vec![0; (200 - lost) * 16];
        far.read_exact(&mut got).await.unwrap();
        assert!(got.iter().all(|&byte| byte == 7));
        writer.send(&frame, Peer::Serial).await.unwrap();
        far.read_exact(&mut got[..16]).await.unwrap();
    }

    #[tokio::test(start_paused = true)]
    async fn a_command_that_waited_too_long_is_not_sent() {
        let (port, mut far) = tokio::io::duplex(16);
        let writer = VehicleWriter::Serial(write_apart(port));
        // Two go into the stalled port, one whole and one in the writing task's hand; two more wait behind them.
        for byte in 1..=4 {
            writer.send(&[byte; 16], Peer::Serial).await.unwrap();
            tokio::task::yield_now().await;
        }
        tokio::time::advance(SERIAL_PATIENCE + Duration::from_millis(1)).await;
        writer.send(&[5; 16], Peer::Serial).await.unwrap();
        drop(writer);
        let mut got = vec![];
        far.read_to_end(&mut got).await.unwrap();
        let order: Vec<u8> = got.chunks(16).map(|frame| frame[0]).collect();
        assert_eq!(order, [1, 2, 5]);
    }

    #[test]
    fn vehicles_on_one_link_have_one_local_port() {
        let vehicle = |number: u32, link: &str| {
            format!(
                "[[vehicle]]\nid = \"1b:00:01:0{number}\"\nlink = \"udpout:127.0.0.1:{link}\"\nsystem_id = {number}\n\
                 signing = {{ key_file = \"{number}.key\" }}\n"
            )
        };
        let text =
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:0\"\n[store]\ndir = \"state\"\n"
                .to_owned()
                + &vehicle(1, "14580")
                + &vehicle(2, "14580")
                + &vehicle(3, "14581");
        let config = Config::parse(&text, std::path::Path::new(".")).unwrap();
        let records = config.vehicles().map(|one| port_record(&config, one));
        let records: Vec<String> = records.collect();
        assert_eq!(records, ["port-1b000101", "port-1b000101", "port-1b000103"]);
    }
}
