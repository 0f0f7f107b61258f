//! One end of an encrypted link: the machine of mavlink-link beside the socket that carries it, where it found the other
//! end, which is kept for the next start, what is logged of it, and what a status shows.

use std::net::SocketAddr;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::encrypted::{
    Carrier, Dropped, EncryptedConfig, EncryptedEvent, EncryptedLink, MAX_WIRE, Role,
    bytes_on_radio,
};
use mavlink_link::exchange::{Identity, Parties, PublicKey};
use mavlink_link::store::{Disk, Durability, Record, Store as _, StoreError};

use super::key_file::system_random;
use crate::config::LinkAddress;
use crate::session::{EncryptedArrivals, EncryptionStatus, LogLevel, Peer};

/// One end.
#[derive(Debug)]
pub(super) struct Encryption {
    pub(super) address: LinkAddress,
    link: EncryptedLink<Peer>,
    out: Box<[u8; MAX_WIRE]>,
    vehicle: u32,
    /// Where the store has the other end, and when to try again to store another place.
    stored: Option<Peer>,
    store_at: Duration,
    faults: Faults,
    /// What had arrived at the last call of [`Encryption::poll_arrivals`].
    arrived: EncryptedArrivals,
}

/// What an end is: which, whose, and with whom.
pub(super) struct EncryptionEnd {
    pub(super) role: Role,
    pub(super) parties: Parties,
    pub(super) identity: Identity,
    /// Pinned by a pairing; without one nothing passes but a pairing.
    pub(super) peer: Option<PublicKey>,
    /// The fixed address of the other end, where there is one.
    pub(super) at: Option<Peer>,
}

impl Encryption {
    /// Begins on the link with this address.
    ///
    /// # Errors
    /// Its record cannot be read.
    pub(super) fn open(
        address: &LinkAddress,
        end: EncryptionEnd,
        now: Now,
        disk: &dyn Disk,
    ) -> Result<Encryption, StoreError> {
        let EncryptionEnd {
            role,
            parties,
            identity,
            peer,
            at,
        } = end;
        let vehicle = parties.vehicle_id;
        // What cannot be read is learned again.
        let stored = disk.load::<FarEnd>(&vehicle).ok().flatten();
        let stored = stored.and_then(|FarEnd(found)| found.map(Peer::Udp));
        let config = EncryptedConfig {
            role,
            parties,
            identity,
            peer,
            before: stored,
            carrier: match address {
                LinkAddress::Serial { .. } => Carrier::Stream,
                LinkAddress::UdpIn(_) | LinkAddress::UdpOut(_) => Carrier::Datagrams,
            },
            at,
            // Commands wait for nothing; telemetry may, so that more of it is in a packet.
            linger: match role {
                Role::Ground => Duration::ZERO,
                Role::Air => linger(address),
            },
        };
        Ok(Encryption {
            address: address.clone(),
            link: EncryptedLink::open(config, now.mono, disk)?.by_host(Peer::host),
            out: Box::new([0; MAX_WIRE]),
            vehicle,
            stored,
            store_at: now.mono,
            faults: Faults::default(),
            arrived: EncryptedArrivals::default(),
        })
    }

    /// Takes what arrived, and gives the frames that the other end has sent, with its address.
    pub(super) fn handle(
        &mut self,
        now: Now,
        from: Peer,
        bytes: &[u8],
        disk: &mut dyn Disk,
    ) -> (Peer, &[u8]) {
        self.link.handle(now, from, bytes, &mut system_random, disk);
        self.store_far_end(self.link.found_at(), now.mono, disk);
        (self.link.sender(from), self.link.received())
    }

    /// Keeps where the other end of a listening link was found, for the next start: without keys it can prove nothing, and
    /// anybody can send what looks like its packets.
    pub(super) fn store_far_end(
        &mut self,
        found: Option<Peer>,
        now: Duration,
        disk: &mut dyn Disk,
    ) {
        if found == self.stored || now < self.store_at {
            return;
        }
        if let (LinkAddress::UdpIn(_), Some(Peer::Udp(address))) = (&self.address, found) {
            self.store_at = now.saturating_add(STORE_EVERY);
            if disk.save(&self.vehicle, &FarEnd(Some(address))).is_ok() {
                self.stored = found;
            }
        }
    }

    /// Sends one frame, once it is polled.
    pub(super) fn send(&mut self, now: Duration, to: Peer, frame: &[u8]) {
        self.link.send(now, to, frame);
    }

    /// The next bytes for the socket.
    pub(super) fn poll_transmit(
        &mut self,
        now: Duration,
        disk: &mut dyn Disk,
    ) -> Option<(Peer, &[u8])> {
        let (to, len) = self.link.poll_transmit(now, disk, &mut self.out)?;
        Some((to, self.out.get(..len)?))
    }

    /// Does what is due.
    pub(super) fn handle_timeout(&mut self, now: Now, disk: &mut dyn Disk) {
        self.link.handle_timeout(now, &mut system_random, disk);
        // Nothing here speaks to the radio itself; what it sends is counted.
        while self.link.poll_radio().is_some() {}
    }

    /// When that is next needed.
    pub(super) fn poll_timeout(&self) -> Duration {
        self.link.poll_timeout().unwrap_or(Duration::MAX)
    }

    /// A pairing has pinned the other end.
    pub(super) fn set_peer(&mut self, peer: PublicKey, now: Duration, disk: &mut dyn Disk) {
        self.link.set_peer(peer, now, disk);
    }

    /// The next thing for the log; a warning is one for operators too.
    pub(super) fn poll_notice(&mut self, now: Duration) -> Option<(LogLevel, String)> {
        while let Some(event) = self.link.poll_event() {
            match event {
                EncryptedEvent::Keys { epoch } => {
                    self.faults.end();
                    let text = format!("the link is encrypted under new keys (epoch {epoch})");
                    return Some((LogLevel::Info, text));
                }
                EncryptedEvent::UnderAttack => {
                    let text =
                        "encrypted link: many recent packets were modified, replayed or forged";
                    return Some((LogLevel::Warning, text.to_owned()));
                }
                EncryptedEvent::Copied => {
                    let text = "encrypted link: somebody on the way copies the other end's packets and delivers them first";
                    return Some((LogLevel::Warning, text.to_owned()));
                }
                EncryptedEvent::Fault(cause) if self.faults.are_due(now) => {
                    let text =
                        format!("encrypted link: no session keys could be agreed on: {cause}");
                    return Some((LogLevel::Warning, text));
                }
                EncryptedEvent::Fault(_) => {}
            }
        }
        None
    }

    /// What has arrived so far, where that is more than at the last call.
    pub(super) fn poll_arrivals(&mut self) -> Option<EncryptedArrivals> {
        let stats = self.link.stats();
        let count = |all: &[Dropped]| all.iter().map(|why| stats.count_of(*why)).sum::<u64>();
        let arrived = EncryptedArrivals {
            opened: stats.opened,
            refused: count(&[
                Dropped::NoKey,
                Dropped::Station,
                Dropped::Replayed,
                Dropped::Forged,
                Dropped::Retired,
            ]),
            plain: count(&[Dropped::Plaintext, Dropped::NotExchange]),
            noise: count(&[
                Dropped::Escape,
                Dropped::Length,
                Dropped::Truncated,
                Dropped::Kind,
            ]),
        };
        let before = std::mem::replace(&mut self.arrived, arrived);
        (before != arrived).then_some(arrived)
    }

    /// How it stands.
    pub(super) fn status(&self, now: Duration) -> EncryptionStatus {
        EncryptionStatus {
            state: self.link.state(now).name(),
            epoch: self.link.epoch(),
            packets: self.link.stats().iter().filter(|one| one.1 > 0).collect(),
        }
    }
}

/// The address at which the other end of a listening link was found; `None` if the record could not be decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct FarEnd(Option<SocketAddr>);

impl Record for FarEnd {
    /// The vehicle's identification number.
    type Key = u32;
    // Nothing follows from it: the thread that flies does not wait for it to be written.
    const DURABILITY: Durability = Durability::Answered;

    fn name(vehicle: &u32) -> String {
        format!("far-end-{vehicle:08x}")
    }

    fn encode(&self) -> Vec<u8> {
        self.0
            .map_or_else(Vec::new, |at| format!("{at}\n").into_bytes())
    }

    fn decode(bytes: &[u8]) -> Result<FarEnd, String> {
        let text = std::str::from_utf8(bytes).ok();
        Ok(FarEnd(text.and_then(|text| text.trim().parse().ok())))
    }
}

/// Faults that come again with each try, several a second while a disk is full: the first is logged, then one a minute until keys
/// are agreed on.
#[derive(Debug, Default)]
struct Faults {
    logged_at: Option<Duration>,
}

impl Faults {
    fn are_due(&mut self, now: Duration) -> bool {
        let due = self
            .logged_at
            .is_none_or(|at| now.saturating_sub(at) >= FAULT_AGAIN);
        if due {
            self.logged_at = Some(now);
        }
        due
    }

    fn end(&mut self) {
        self.logged_at = None;
    }
}

/// How long telemetry waits for a packet to be full: on a serial line as long as that takes to send one, since the next would wait for
/// the line anyway, and half-full packets are what fills a slow radio.
fn linger(address: &LinkAddress) -> Duration {
    let LinkAddress::Serial { baud, .. } = address else {
        return MIN_LINGER;
    };
    // Ten bits a byte.
    let bits = bytes_on_radio(1) as f64 * 10.0;
    let packet = Duration::from_secs_f64(bits / f64::from((*baud).max(1)));
    packet.clamp(MIN_LINGER, MAX_LINGER)
}

/// How often another place of the other end is stored: somebody on the way who copies its packets can have it move.
const STORE_EVERY: Duration = Duration::from_secs(10);
const FAULT_AGAIN: Duration = Duration::from_secs(60);
/// A third of what a radio of 57,600 baud needs for one packet.
const MIN_LINGER: Duration = Duration::from_millis(5);
/// An answer to a command waits for as long at the most.
const MAX_LINGER: Duration = Duration::from_millis(100);

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use mavlink_link::exchange::Node;
    use mavlink_link::store::MemoryDisk;
    use tokio::sync::Notify;

    use super::*;
    use crate::shell::disk::FileDisk;
    use crate::shell::queued_disk::QueuedDisk;

    const GROUND: SocketAddr =
        SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 14_550);
    const AGENT: SocketAddr =
        SocketAddr::new(std::net::IpAddr::V4(std::net::Ipv4Addr::LOCALHOST), 2_001);

    fn at(ms: u64) -> Now {
        Now {
            mono: Duration::from_millis(ms),
            wall: Duration::from_secs(1_800_000_000) + Duration::from_millis(ms),
        }
    }

    /// A ground that listens, or its agent.
    fn open(role: Role, now: Now, disk: &MemoryDisk) -> Encryption {
        let node = |system, component| Node { system, component };
        let identities = [Identity::new([1; 32]), Identity::new([2; 32])];
        let public = identities.each_ref().map(Identity::public);
        let [of_ground, of_agent] = identities;
        let (address, identity, peer, at) = match role {
            Role::Ground => (LinkAddress::UdpIn(GROUND), of_ground, public[1], None),
            Role::Air => (
                LinkAddress::UdpOut(GROUND.to_string()),
                of_agent,
                public[0],
                Some(Peer::Udp(GROUND)),
            ),
        };
        let end = EncryptionEnd {
            role,
            parties: Parties::new(node(245, 190), node(1, 191), 0x1b00_0001, 0x1b00_0101),
            identity,
            peer: Some(peer),
            at,
        };
        Encryption::open(&address, end, now, disk).unwrap()
    }

    #[test]
    fn a_ground_that_has_started_again_asks_where_its_agent_was_whoever_speaks_first() {
        let mut disks = [MemoryDisk::default(), MemoryDisk::default()];
        let mut ground = open(Role::Ground, at(0), &disks[0]);
        let mut agent = open(Role::Air, at(0), &disks[1]);
        for ms in (0..3_000).step_by(20) {
            let now = at(ms);
            ground.handle_timeout(now, &mut disks[0]);
            agent.handle_timeout(now, &mut disks[1]);
            while let Some((to, bytes)) = agent.poll_transmit(now.mono, &mut disks[1]) {
                assert_eq!(to, Peer::Udp(GROUND));
                ground.handle(now, Peer::Udp(AGENT), bytes, &mut disks[0]);
            }
            while let Some((to, bytes)) = ground.poll_transmit(now.mono, &mut disks[0]) {
                assert_eq!(to, Peer::Udp(AGENT));
                agent.handle(now, Peer::Udp(GROUND), bytes, &mut disks[1]);
            }
        }
        assert!(ground.status(at(3_000).mono).epoch.is_some());

        let mut ground = open(Role::Ground, at(4_000), &disks[0]);
        ground.handle_timeout(at(4_000), &mut disks[0]);
        let sent = ground.poll_transmit(at(4_000).mono, &mut disks[0]);
        assert_eq!(sent.map(|(to, _)| to), Some(Peer::Udp(AGENT)));
        // An unreadable record is one that is not there.
        assert_eq!(FarEnd::decode(b"127.0.0.1"), Ok(FarEnd(None)));
    }

    #[test]
    fn a_thread_writes_where_the_other_end_was_found() {
        let folder = tempfile::tempdir().unwrap();
        let disk = FileDisk::open(&folder.path().join("state")).unwrap();
        let mut disk = QueuedDisk::new(disk, Arc::new(Notify::new())).unwrap();
        let mut ground = open(Role::Ground, at(0), &MemoryDisk::default());
        let before = disk.queued();
        ground.store_far_end(Some(Peer::Udp(AGENT)), at(0).mono, &mut disk);
        assert_eq!(disk.queued(), before + 1);
        assert!(disk.wait(Duration::from_secs(20)));
        let stored = disk.load::<FarEnd>(&ground.vehicle);
        assert_eq!(stored, Ok(Some(FarEnd(Some(AGENT)))));
    }

    #[test]
    fn telemetry_waits_for_as_long_as_its_line_takes_for_a_packet() {
        let serial = |baud| LinkAddress::Serial {
            device: "/dev/ttyS1".to_owned(),
            baud,
        };
        let udp = LinkAddress::UdpOut("ground:14550".to_owned());
        for (address, millis) in [
            (udp, 5),
            (serial(921_600), 5),
            (serial(57_600), 17),
            (serial(19_200), 52),
            (serial(9_600), 100),
            (serial(0), 100),
        ] {
            assert_eq!(linger(&address).as_millis(), millis, "{address:?}");
        }
    }

    #[test]
    fn a_fault_that_lasts_is_logged_when_it_begins_and_once_a_minute() {
        let mut faults = Faults::default();
        let tried = (0..2_400).map(|tries| Duration::from_millis(400 * tries));
        let logged: Vec<u64> = tried
            .filter(|now| faults.are_due(*now))
            .map(|now| now.as_secs())
            .collect();
        let minutes: Vec<u64> = (0..16).map(|minute| 60 * minute).collect();
        assert_eq!(logged, minutes);
        // Keys were agreed on, and the disk is full again.
        faults.end();
        let again = Duration::from_secs(961);
        assert!(faults.are_due(again) && !faults.are_due(again));
    }
}
