//! The captures of `cargo xtask faults`: packet sockets on the computer of the vehicles and on that of the stations.
//!
//! Datagrams to stations are decoded by `vsm decode`, one process for each node, so that an answer is counted for the node
//! that sent it.

use std::io::{BufRead as _, BufReader, ErrorKind, Write as _};
use std::net::Ipv4Addr;
use std::os::fd::OwnedFd;
use std::path::Path;
use std::process::{Child, ChildStdin, Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use anyhow::{Context as _, Result};
use rustix::net::sockopt::{Timeout, set_socket_timeout};
use rustix::net::{
    AddressFamily, Protocol, RawProtocol, RecvFlags, SocketFlags, SocketType, recv, socket_with,
};

use super::network::{Host, NODES, Network, node_of};
use super::wire::{Answer, Wire};

/// The wire as all threads see it.
pub(super) type Shared = Arc<Mutex<Wire>>;

/// Captures that run until they are dropped.
#[derive(Debug)]
pub(super) struct Captures {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
    decoders: Vec<Child>,
}

/// What is expected of a vehicle's frames: the port of the first vehicle's link; the others follow.
pub(super) const FIRST_PORT: u16 = 14_601;

impl Captures {
    /// Begins to capture.
    pub(super) fn start(network: &Network, bins: &Path, wire: &Shared) -> Result<Captures> {
        let stop = Arc::new(AtomicBool::new(false));
        let mut captures = Captures {
            stop: stop.clone(),
            threads: Vec::new(),
            decoders: Vec::new(),
        };
        let socket = network.on(Host::Vehicles, packets)?;
        let of_vehicles = wire.clone();
        let at_vehicles = move |at, node, datagram: &Datagram<'_>| {
            // Links of the nodes have the number of the vehicle in their port.
            if let Some(vehicle) = datagram.from_port.checked_sub(FIRST_PORT) {
                let mut wire = locked(&of_vehicles);
                wire.note_frame(at, node, vehicle.into(), datagram.payload);
                wire.last = Some((datagram.to_port, datagram.payload.to_vec()));
            }
        };
        captures
            .threads
            .push(follow(socket, stop.clone(), at_vehicles));
        let mut inputs = Vec::new();
        for node in 0..NODES {
            inputs.push(captures.decoder(node, bins, wire)?);
        }
        let socket = network.on(Host::Station, packets)?;
        let of_stations = wire.clone();
        let at_stations = move |at, node: usize, datagram: &Datagram<'_>| {
            // IGMP and others do not get here; a query of a name server would.
            if datagram.to_port != GROUP_PORT {
                return;
            }
            locked(&of_stations).note_report(at, node);
            let hex: String = datagram
                .payload
                .iter()
                .map(|byte| format!("{byte:02x}"))
                .collect();
            // It ends with the world.
            let _ = writeln!(inputs[node], "{hex}");
        };
        captures.threads.push(follow(socket, stop, at_stations));
        Ok(captures)
    }

    /// A decoder of what this node sends to stations; returns where its datagrams are written.
    fn decoder(&mut self, node: usize, bins: &Path, wire: &Shared) -> Result<ChildStdin> {
        let mut child = Command::new(bins.join("vsm"))
            .args(["decode", "--raw"])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .context("vsm decode")?;
        let (input, output) = (child.stdin.take(), child.stdout.take());
        self.decoders.push(child);
        let output = output.context("its output")?;
        let wire = wire.clone();
        self.threads.push(thread::spawn(move || {
            for line in BufReader::new(output).lines().map_while(Result::ok) {
                if let Some(kind) = acknowledged(&line) {
                    let answer = Answer {
                        at: Instant::now(),
                        node,
                        kind,
                    };
                    locked(&wire).answers.push(answer);
                }
            }
        }));
        input.context("its input")
    }
}

impl Drop for Captures {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for decoder in &mut self.decoders {
            let _ = decoder.kill();
            let _ = decoder.wait();
        }
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

pub(super) fn locked(wire: &Mutex<Wire>) -> MutexGuard<'_, Wire> {
    wire.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The Acknowledgement Type of a 17000.
fn acknowledged(line: &str) -> Option<u64> {
    // The others are not worth the parsing.
    if !line.contains("17000") {
        return None;
    }
    let message: serde_json::Value = serde_json::from_str(line).ok()?;
    let is_answer = message["id"] == 17_000;
    let kind = message["fields"]["Acknowledgement Type"].as_u64();
    kind.filter(|_| is_answer)
}

/// A socket that receives every frame of its namespace.
fn packets() -> Result<OwnedFd> {
    let every = RawProtocol::new(u16::to_be(ETH_P_ALL).into()).map(Protocol::from_raw);
    let socket = socket_with(
        AddressFamily::PACKET,
        SocketType::RAW,
        SocketFlags::CLOEXEC,
        every,
    )
    .context("a packet socket")?;
    set_socket_timeout(&socket, Timeout::Recv, Some(Duration::from_millis(100)))?;
    Ok(socket)
}

/// Calls `then` for each datagram of a node, until stopped.
fn follow(
    socket: OwnedFd,
    stop: Arc<AtomicBool>,
    mut then: impl FnMut(Instant, usize, &Datagram<'_>) + Send + 'static,
) -> JoinHandle<()> {
    thread::spawn(move || {
        let mut buffer = [0_u8; 2_048];
        while !stop.load(Ordering::Relaxed) {
            let length = match recv(&socket, &mut buffer, RecvFlags::empty()) {
                Ok((length, _)) => length,
                Err(cause) if cause.kind() == ErrorKind::WouldBlock => continue,
                Err(_) => return,
            };
            let datagram = Datagram::parse(&buffer[..length]);
            if let Some((node, datagram)) = datagram {
                then(Instant::now(), node, &datagram);
            }
        }
    })
}

/// A datagram of UDP over IPv4.
struct Datagram<'a> {
    from_port: u16,
    to_port: u16,
    payload: &'a [u8],
}

impl Datagram<'_> {
    /// That of an Ethernet frame, and the node that sent it; `None` for everything else.
    fn parse(frame: &[u8]) -> Option<(usize, Datagram<'_>)> {
        let node = node_of(frame.get(6..12)?)?;
        let packet = frame.get(14..).filter(|_| frame[12..14] == [8, 0])?;
        let first = *packet.first()?;
        let head = usize::from(first & 0xf) * 4;
        let total = usize::from(u16::from_be_bytes([*packet.get(2)?, *packet.get(3)?]));
        let is_udp = first >> 4 == 4 && *packet.get(9)? == 17;
        // Broadcasts of other programs are none of ours.
        let to = Ipv4Addr::new(
            *packet.get(16)?,
            *packet.get(17)?,
            *packet.get(18)?,
            *packet.get(19)?,
        );
        let udp = packet
            .get(head..total)
            .filter(|_| is_udp && !to.is_broadcast())?;
        let port = |at: usize| Some(u16::from_be_bytes([*udp.get(at)?, *udp.get(at + 1)?]));
        let (from_port, to_port) = (port(0)?, port(2)?);
        let payload = udp.get(8..)?;
        Some((
            node,
            Datagram {
                from_port,
                to_port,
                payload,
            },
        ))
    }
}

const ETH_P_ALL: u16 = 3;
/// Of the group of the stations.
pub(super) const GROUP_PORT: u16 = 26_001;
