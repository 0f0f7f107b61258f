//! A vehicle and its links: framing, signing, and the lock on the first sender; without sockets.

use std::collections::BTreeMap;
use std::time::Duration;

use mavlink::dialects::development::{MavMessage, MavSeverity};
use mavlink_link::frame::{self, Header, INCOMPAT_SIGNED, MAX_FRAME, Parser};
use mavlink_link::service::Node;
use mavlink_link::signing::{Stamp, sign};

use crate::config::Config;
use crate::link::signing::{Admission, Refusal, Setup, Signing};
use crate::vehicle::state::{Outgoing, Vehicle};

/// Counters of one link.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct LinkCounters {
    /// Frames sent.
    pub sent: u64,
    /// Of these, signed.
    pub sent_signed: u64,
    /// Frames accepted with a valid signature.
    pub verified: u64,
    /// Frames accepted without a signature.
    pub unsigned: u64,
    /// Frames with a bad signature, accepted because they are of the four messages that need none.
    pub badly_signed: u64,
    /// Bytes that are not a frame: bad checksum, unknown flag, MAVLink 1, unknown message.
    pub not_frames: u64,
    /// Dropped: [`Refusal::Unsigned`].
    pub dropped_unsigned: u64,
    /// Dropped: [`Refusal::BadSignature`].
    pub dropped_bad_signature: u64,
    /// Dropped: [`Refusal::OldStamp`].
    pub dropped_old_stamp: u64,
    /// Dropped: [`Refusal::OldStream`].
    pub dropped_old_stream: u64,
    /// Dropped: [`Refusal::TooManyStreams`].
    pub dropped_too_many_streams: u64,
    /// Datagrams from other senders than the partner; PX4 acts on them.
    pub from_strangers: u64,
}

impl LinkCounters {
    /// All frames that were dropped for their signature.
    pub fn refused(&self) -> u64 {
        self.dropped_unsigned
            + self.dropped_bad_signature
            + self.dropped_old_stamp
            + self.dropped_old_stream
            + self.dropped_too_many_streams
    }

    fn count(&mut self, refusal: Refusal) {
        *match refusal {
            Refusal::Unsigned => &mut self.dropped_unsigned,
            Refusal::BadSignature => &mut self.dropped_bad_signature,
            Refusal::OldStamp => &mut self.dropped_old_stamp,
            Refusal::OldStream => &mut self.dropped_old_stream,
            Refusal::TooManyStreams => &mut self.dropped_too_many_streams,
        } += 1;
    }
}

/// One MAVLink instance of PX4. `A` is the type of a peer's address.
#[derive(Debug)]
struct Port<A> {
    parser: Parser,
    /// The number of the next frame, for each component.
    sequences: BTreeMap<u8, u8>,
    /// This link's signing clock.
    clock: u64,
    remote: Option<A>,
    /// The first sender, kept as long as the process lives.
    partner: Option<A>,
    counters: LinkCounters,
}

/// A frame to put on a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Transmit<A> {
    /// Which link, from 0.
    pub link: usize,
    /// The destination.
    pub to: A,
    /// Bytes used in the buffer.
    pub len: usize,
}

/// A PX4 behind its links. Link 0 is the ground station's; a link's number is its signing link id.
#[derive(Debug)]
pub struct Autopilot<A> {
    vehicle: Vehicle,
    signing: Signing,
    ports: Vec<Port<A>>,
    outgoing: Option<(Outgoing, usize)>,
}

impl<A: Clone + PartialEq> Autopilot<A> {
    /// Switches the vehicle on. `remotes` are the links: the address to which each one sends before it has received
    /// anything. A link without one sends nothing until then.
    pub fn new(config: Config, signing: Signing, remotes: Vec<Option<A>>) -> Self {
        let clock = signing.stored_stamp();
        let ports = remotes
            .into_iter()
            .map(|remote| Port {
                parser: Parser::new(),
                sequences: BTreeMap::new(),
                clock,
                remote,
                partner: None,
                counters: LinkCounters::default(),
            })
            .collect();
        Self {
            vehicle: Vehicle::new(config),
            signing,
            ports,
            outgoing: None,
        }
    }

    /// Switches it off and on again: the vehicle is at home again, the streams are forgotten, every signing clock is
    /// reset to the value in the key file, and the next sender becomes the partner.
    pub fn restart(&mut self) {
        // The card keeps its contents.
        let files = self.vehicle.files().clone();
        let config = self.vehicle.config.clone();
        self.vehicle = Vehicle::new(Config { files, ..config });
        self.signing.restart();
        self.outgoing = None;
        for port in &mut self.ports {
            port.parser = Parser::new();
            port.sequences.clear();
            port.clock = self.signing.stored_stamp();
            port.partner = None;
        }
    }

    /// The vehicle.
    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// The vehicle, for changes that come over no link: another station, a failing sensor.
    pub fn vehicle_mut(&mut self) -> &mut Vehicle {
        &mut self.vehicle
    }

    /// The counters of a link.
    pub fn counters(&self, link: usize) -> LinkCounters {
        self.ports.get(link).map(|p| p.counters).unwrap_or_default()
    }

    /// The timestamp of the link's next packet, in units of 10 us.
    pub fn signing_clock(&self, link: usize) -> Option<u64> {
        self.ports.get(link).map(|p| p.clock)
    }

    /// Key and first timestamp, as in use and on disk.
    pub fn signing(&self) -> &Signing {
        &self.signing
    }

    /// True while frames are signed.
    pub fn is_signing(&self) -> bool {
        self.signing.key().is_some()
    }

    /// Advances the time.
    pub fn step(&mut self, dt: Duration) {
        self.vehicle.step(dt);
    }

    /// Handles a datagram. The first sender becomes the partner; frames of any sender are acted on.
    pub fn handle_datagram(&mut self, link: usize, from: A, bytes: &[u8]) {
        let Some(port) = self.ports.get_mut(link) else {
            return;
        };
        // PX4 answers the first sender as long as the process lives, even when that one has gone, and still obeys all
        // others. So a bridge must keep its port over restarts.
        match &port.partner {
            None => port.partner = Some(from),
            Some(partner) if *partner != from => port.counters.from_strangers += 1,
            Some(_) => {}
        }
        let (taken, rekeyed) = port.take(bytes, &mut self.signing, &mut self.vehicle);
        // All links share the key file, so every other link restarts from its timestamp too.
        if rekeyed {
            let clock = self.signing.stored_stamp();
            for (i, other) in self.ports.iter_mut().enumerate() {
                if i != link {
                    other.clock = clock;
                }
            }
        }
        for Taken { from, id, content } in taken {
            match content {
                Ok(message) => self.vehicle.handle_message(from, &message),
                Err(payload) => self.vehicle.handle_raw(from, id, &payload),
            }
        }
    }

    /// Writes the next frame into `out`. Every message is sent on every link that has an address, one frame in each
    /// datagram.
    pub fn poll_transmit(&mut self, out: &mut [u8; MAX_FRAME]) -> Option<Transmit<A>> {
        loop {
            let (message, link) = match self.outgoing.take() {
                Some(pending) => pending,
                None => (self.vehicle.poll_transmit()?, 0),
            };
            let Some(port) = self.ports.get_mut(link) else {
                continue;
            };
            let node = self.vehicle.node();
            let len = port.frame(node, link as u8, &self.signing, &message, out);
            let to = port.partner.clone().or_else(|| port.remote.clone());
            self.outgoing = Some((message, link + 1));
            if let (Some(to), Some(len)) = (to, len) {
                return Some(Transmit { link, to, len });
            }
        }
    }
}

/// An accepted message: the dialect's struct, or the raw payload where the struct cannot hold it.
struct Taken {
    from: Node,
    id: u32,
    content: Result<MavMessage, Vec<u8>>,
}

impl<A> Port<A> {
    /// The accepted messages of a datagram, and whether the key has changed.
    fn take(
        &mut self,
        bytes: &[u8],
        signing: &mut Signing,
        vehicle: &mut Vehicle,
    ) -> (Vec<Taken>, bool) {
        let (mut taken, mut rekeyed) = (Vec::new(), false);
        let mut frames = self.parser.feed(bytes);
        while let Some(found) = frames.next() {
            let Ok(view) = found else {
                self.counters.not_frames += 1;
                continue;
            };
            let header = view.header();
            match signing.admit(&view, &mut self.clock) {
                Err(refusal) => {
                    self.counters.count(refusal);
                    continue;
                }
                Ok(Admission::Verified) => self.counters.verified += 1,
                Ok(Admission::Unsigned) => self.counters.unsigned += 1,
                Ok(Admission::BadlySigned) => self.counters.badly_signed += 1,
            }
            let from = Node::new(header.system_id, header.component_id);
            let content = view.message().map_err(|_| view.payload().to_vec());
            // The key must take effect before the next frame of the same datagram is checked.
            if let Ok(MavMessage::SETUP_SIGNING(setup)) = &content {
                let result = signing.setup(setup, view.is_signed(), vehicle.commander.is_armed());
                if matches!(result, Setup::Accepted | Setup::Disabled) {
                    self.clock = signing.stored_stamp();
                    rekeyed = true;
                }
                report_setup(vehicle, result);
            } else if view.is_checked() {
                taken.push(Taken {
                    from,
                    id: header.message_id,
                    content,
                });
            } else {
                frames.accept_unchecked();
            }
        }
        (taken, rekeyed)
    }

    fn frame(
        &mut self,
        node: Node,
        link_id: u8,
        signing: &Signing,
        message: &Outgoing,
        out: &mut [u8; MAX_FRAME],
    ) -> Option<usize> {
        let component = match message {
            Outgoing::Component(component, _) => *component,
            _ => node.component,
        };
        // Each component has its own sequence numbers.
        let sequence = self.sequences.entry(component).or_default();
        let header = Header {
            seq: *sequence,
            system_id: node.system,
            component_id: component,
            message_id: 0,
            incompat: if signing.key().is_some() {
                INCOMPAT_SIGNED
            } else {
                0
            },
            compat: 0,
        };
        let len = match message {
            Outgoing::Message(message) | Outgoing::Component(_, message) => {
                frame::encode(message, header, out)
            }
            Outgoing::Raw { id, payload } => frame::encode_raw(
                Header {
                    message_id: *id,
                    ..header
                },
                payload,
                out,
            )
            .ok()?,
        };
        *sequence = sequence.wrapping_add(1);
        self.counters.sent += 1;
        let Some(key) = signing.key() else {
            return Some(len);
        };
        // One more for each packet, independent of time: only a verified frame on this link raises the clock further.
        let stamp = Stamp::new(self.clock);
        self.clock += 1;
        self.counters.sent_signed += 1;
        sign(key, link_id, stamp, out, len).ok()
    }
}

/// STATUSTEXT is PX4's only answer to SETUP_SIGNING; there is never a COMMAND_ACK.
fn report_setup(vehicle: &mut Vehicle, result: Setup) {
    let (severity, text) = match result {
        Setup::Accepted => (
            MavSeverity::MAV_SEVERITY_INFO,
            "MAVLink signing key accepted",
        ),
        Setup::Disabled => (MavSeverity::MAV_SEVERITY_INFO, "MAVLink signing disabled"),
        Setup::Armed => (
            MavSeverity::MAV_SEVERITY_CRITICAL,
            "MAVLink signing: rejected while armed",
        ),
        Setup::Ignored => return,
    };
    vehicle.texts.queue(severity, text);
}
