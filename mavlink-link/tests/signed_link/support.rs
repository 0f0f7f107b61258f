//! What the tests share: a virtual clock, a store in memory, and a vehicle that signs as PX4 does.

use std::collections::HashMap;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::Origin;
use mavlink_link::dialect::{COMMAND_ACK_DATA, HEARTBEAT_DATA, MavMessage};
use mavlink_link::frame::{FrameView, Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::link::{Auth, Delivery, Endpoint, Link, LinkConfig, Security, Sent};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{SigningKey, Stamp, sign, verify};
pub(crate) use mavlink_link::store::MemoryDisk;

/// An address in the tests: a number.
pub(crate) type Addr = u16;

/// 2026-11-21 00:00 UTC.
pub(crate) const WALL: Duration = Duration::from_secs(1_795_219_200);
pub(crate) const DAY: Duration = Duration::from_secs(86_400);
pub(crate) const VEHICLE: Addr = 14_580;
pub(crate) const STRANGER: Addr = 6_666;
/// No build of this project is older than this.
pub(crate) const BUILD: Stamp = Stamp::from_unix(Duration::from_secs(1_793_491_200));

pub(crate) const fn ms(ms: u64) -> Duration {
    Duration::from_millis(ms)
}

/// Both clocks right, some time after the start of the test.
pub(crate) fn at(ms: u64) -> Now {
    Now {
        mono: Duration::from_millis(ms),
        wall: WALL + Duration::from_millis(ms),
    }
}

pub(crate) fn key() -> SigningKey {
    SigningKey::new(core::array::from_fn(|i| i as u8 + 1)).unwrap()
}

pub(crate) fn other_key() -> SigningKey {
    SigningKey::new([0xa5; 32]).unwrap()
}

/// Our side: a link, its key and its disk.
pub(crate) struct Station {
    pub(crate) link: Link<Addr>,
    pub(crate) keys: KeyState,
    pub(crate) store: MemoryDisk,
}

/// What a delivery was, owned.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Got {
    pub(crate) id: u32,
    pub(crate) frame: Vec<u8>,
    pub(crate) verified: bool,
    pub(crate) stamp: Option<Stamp>,
    pub(crate) late: bool,
}

impl Got {
    pub(crate) fn of(delivery: &Delivery<'_>) -> Self {
        Self {
            id: delivery.header.message_id,
            frame: delivery.frame.as_bytes().to_vec(),
            verified: delivery.verified,
            stamp: delivery.stamp,
            late: delivery.age.is_late(),
        }
    }
}

impl Station {
    pub(crate) fn new(endpoint: Endpoint<Addr>, now: Now) -> Self {
        Self::with_store(endpoint, now, MemoryDisk::default())
    }

    pub(crate) fn with_store(endpoint: Endpoint<Addr>, now: Now, mut store: MemoryDisk) -> Self {
        let keys = KeyState::start(key(), Origin::KeyFile, BUILD, now, &mut store).unwrap();
        let link = Link::new(LinkConfig::new(1, Security::Signed, endpoint));
        Self { link, keys, store }
    }

    /// The process dies and starts again: only the disk is left.
    pub(crate) fn restart(self, now: Now) -> Self {
        Self::with_store(self.link.config().endpoint, now, self.store)
    }

    pub(crate) fn auth<'a>(keys: &'a mut KeyState, store: &'a mut MemoryDisk) -> Auth<'a> {
        Auth::Signed { key: keys, store }
    }

    pub(crate) fn receive(&mut self, now: Now, from: Addr, bytes: &[u8]) -> Vec<Got> {
        let mut got = Vec::new();
        let auth = Self::auth(&mut self.keys, &mut self.store);
        self.link
            .handle_datagram(now, from, bytes, auth, &mut |d| got.push(Got::of(&d)));
        got
    }

    /// What the link wants to send by itself now.
    pub(crate) fn heartbeats(&mut self, now: Now) -> Vec<(Addr, Vec<u8>)> {
        let mut sent = Vec::new();
        let mut out = [0; MAX_FRAME];
        while let Some(Sent { to, len, .. }) =
            self.link
                .poll_transmit(now, Self::auth(&mut self.keys, &mut self.store), &mut out)
        {
            sent.push((to, out[..len].to_vec()));
        }
        sent
    }

    /// As [`heartbeats`](Self::heartbeats), after the time-outs that are due.
    pub(crate) fn tick(&mut self, now: Now) -> Vec<(Addr, Vec<u8>)> {
        self.link.handle_timeout(now);
        self.heartbeats(now)
    }

    pub(crate) fn send(&mut self, now: Now, msg: &MavMessage) -> (Vec<u8>, Sent<Addr>) {
        let mut out = [0; MAX_FRAME];
        let auth = Self::auth(&mut self.keys, &mut self.store);
        let sent = self.link.send(now, auth, msg, &mut out).unwrap();
        (out[..sent.len].to_vec(), sent)
    }
}

/// Signs and judges as PX4 v1.18 was seen to do: its stamps are no wall clock, they rise by one a
/// packet, are lifted by a verified packet, and fall back when it restarts.
pub(crate) struct Vehicle {
    pub(crate) key: SigningKey,
    pub(crate) system: u8,
    pub(crate) component: u8,
    pub(crate) link_id: u8,
    pub(crate) stamp: Stamp,
    pub(crate) initial: Stamp,
    pub(crate) streams: HashMap<(u8, u8, u8), Stamp>,
    pub(crate) seq: u8,
}

impl Vehicle {
    pub(crate) fn new(initial: Stamp) -> Self {
        Self {
            key: key(),
            system: 1,
            component: 1,
            link_id: 0,
            stamp: initial,
            initial,
            streams: HashMap::new(),
            seq: 0,
        }
    }

    pub(crate) fn restart(&mut self) {
        self.stamp = self.initial;
        self.streams.clear();
    }

    /// Whether it takes this frame as genuine.
    pub(crate) fn receive(&mut self, bytes: &[u8]) -> bool {
        let Ok(frame) = FrameView::parse(bytes) else {
            return false;
        };
        let Some(signature) = frame.signature() else {
            return false;
        };
        if verify(&self.key, &frame).is_err() {
            return false;
        }
        let header = frame.header();
        let name = (header.system_id, header.component_id, signature.link_id);
        match self.streams.get(&name) {
            Some(&last) if signature.stamp <= last => return false,
            None if self.streams.len() == 16 => return false,
            None if signature.stamp.plus(Duration::from_secs(60)) < self.stamp => return false,
            _ => {}
        }
        self.streams.insert(name, signature.stamp);
        self.stamp = self.stamp.max(signature.stamp);
        true
    }

    pub(crate) fn send(&mut self, msg: &MavMessage) -> Vec<u8> {
        let stamp = self.stamp;
        self.stamp = stamp.next().unwrap();
        self.send_stamped(msg, stamp)
    }

    pub(crate) fn heartbeat(&mut self) -> Vec<u8> {
        self.send(&heartbeat())
    }

    pub(crate) fn send_stamped(&mut self, msg: &MavMessage, stamp: Stamp) -> Vec<u8> {
        let mut out = [0; MAX_FRAME];
        let len = encode(msg, self.header(INCOMPAT_SIGNED), &mut out);
        let len = sign(&self.key, self.link_id, stamp, &mut out, len).unwrap();
        out[..len].to_vec()
    }

    pub(crate) fn send_unsigned(&mut self, msg: &MavMessage) -> Vec<u8> {
        let mut out = [0; MAX_FRAME];
        let len = encode(msg, self.header(0), &mut out);
        out[..len].to_vec()
    }

    fn header(&mut self, incompat: u8) -> Header {
        let seq = self.seq;
        self.seq = seq.wrapping_add(1);
        Header {
            seq,
            system_id: self.system,
            component_id: self.component,
            incompat,
            ..Header::default()
        }
    }
}

pub(crate) fn heartbeat() -> MavMessage {
    MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0x0304_0000,
        ..HEARTBEAT_DATA::default()
    })
}

pub(crate) fn ack() -> MavMessage {
    MavMessage::COMMAND_ACK(COMMAND_ACK_DATA::default())
}

/// A station and a vehicle whose stamps it accepts, after one exchange of heartbeats.
pub(crate) fn live_pair(endpoint: Endpoint<Addr>) -> (Station, Vehicle) {
    let mut station = Station::new(endpoint, at(0));
    let mut vehicle = Vehicle::new(Stamp::new(1));
    // The vehicle talks first, far behind, and is lifted.
    assert!(
        station
            .receive(at(0), VEHICLE, &vehicle.heartbeat())
            .is_empty()
    );
    for (to, frame) in station.tick(at(1)) {
        assert_eq!(to, VEHICLE);
        assert!(vehicle.receive(&frame));
    }
    assert_eq!(
        station.receive(at(2), VEHICLE, &vehicle.heartbeat()).len(),
        1
    );
    while station.link.poll_event().is_some() {}
    (station, vehicle)
}
