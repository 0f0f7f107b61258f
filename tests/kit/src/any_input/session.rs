//! The whole bridge: a sequence of datagrams of both sides, of time that passes and of restarts, read from the bytes.
//!
//! A step is an operation, a length and that many bytes. Nothing panics; what the bridge sends is well formed, goes
//! only to parties that may receive it, and is bounded; timeouts end.

use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::frame::{FrameView, Header, MAX_FRAME, encode_raw};
use mavlink_link::signing::SigningKey;
use mavlink_link::store::MemoryDisk;
use stanag_msgs::wrapper::frames;
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Profile};
use vsm::config::Config;
use vsm::session::{Bridge, Destination, LinkEnd, Peer};

/// Bytes from a station's address, unchanged.
pub const DATAGRAM: u8 = 0;
/// A message of a station: its type, then its data; the wrapper is added.
pub const MESSAGE: u8 = 1;
/// Bytes from the unsigned vehicle, unchanged.
pub const BYTES: u8 = 2;
/// A message of the unsigned vehicle: its id, then its payload; the frame is added.
pub const FRAME: u8 = 3;
/// Bytes from the signed vehicle, unchanged.
pub const SIGNED: u8 = 4;
/// Time passes: as many times 20 ms as the input has bytes.
pub const TIME: u8 = 5;
/// The bridge is restarted from its store.
pub const RESTART: u8 = 6;
/// Number of operations.
pub const OPERATIONS: u8 = 7;

/// Carries out the steps, 200 at most.
pub fn run(bytes: &[u8]) {
    let mut world = World::new();
    let mut rest = bytes;
    for _ in 0..200 {
        let [operation, length, following @ ..] = rest else {
            return;
        };
        let length_of_data = match operation % OPERATIONS {
            TIME | RESTART => 0,
            _ => usize::from(*length).min(following.len()),
        };
        let (data, next) = following.split_at(length_of_data);
        rest = next;
        world.step(operation % OPERATIONS, *length, data);
    }
}

struct World {
    config: Config,
    bridge: Bridge,
    store: MemoryDisk,
    clock: Duration,
    /// Sequence number of the last message of a station: stamps are part of the data, and need not rise.
    sequence: u8,
}

impl World {
    fn new() -> World {
        let config = Config::parse(CONFIGURATION, Path::new("/nowhere")).expect("it is good");
        let mut store = MemoryDisk::default();
        let bridge = start(&config, Duration::ZERO, &mut store);
        World {
            config,
            bridge,
            store,
            clock: Duration::ZERO,
            sequence: 0,
        }
    }

    fn step(&mut self, operation: u8, length: u8, data: &[u8]) {
        let now = at(self.clock);
        match operation {
            DATAGRAM => self
                .bridge
                .handle_dli(now, station(), data, &mut self.store),
            MESSAGE => {
                let [high, low, fields @ ..] = data else {
                    return;
                };
                let bytes = wrapped(u16::from_be_bytes([*high, *low]), fields);
                self.bridge
                    .handle_dli(now, station(), &bytes, &mut self.store);
            }
            BYTES => self.vehicle(0, data),
            FRAME => {
                let [low, middle, payload @ ..] = data else {
                    return;
                };
                self.sequence = self.sequence.wrapping_add(1);
                let header = Header {
                    system_id: 1,
                    component_id: 1,
                    seq: self.sequence,
                    message_id: u32::from(u16::from_le_bytes([*low, *middle])),
                    ..Header::default()
                };
                let mut out = [0; MAX_FRAME];
                if let Ok(length) = encode_raw(header, payload, &mut out) {
                    self.vehicle(0, &out[..length]);
                }
            }
            SIGNED => self.vehicle(1, data),
            TIME => {
                for _ in 0..length {
                    self.clock += Duration::from_millis(20);
                    self.time();
                }
            }
            _ => self.bridge = start(&self.config, self.clock, &mut self.store),
        }
        self.drain();
    }

    fn vehicle(&mut self, index: usize, bytes: &[u8]) {
        let peer = Peer::Udp(SocketAddr::from(([127, 0, 0, 1], 18_570 + index as u16)));
        let now = at(self.clock);
        self.bridge
            .handle_vehicle(now, index, peer, bytes, &mut self.store, &mut |_, _| {});
    }

    fn time(&mut self) {
        let now = at(self.clock);
        let mut rounds = 0;
        while self.bridge.poll_timeout(self.clock) <= self.clock && rounds < 8 {
            self.bridge.handle_timeout(now, &mut self.store);
            rounds += 1;
        }
        self.drain();
    }

    fn drain(&mut self) {
        let mut count = 0;
        while let Some(datagram) = self.bridge.poll_dli() {
            assert_eq!(datagram.to, Destination::Unicast(station()));
            for frame in frames(datagram.bytes()) {
                let frame = frame.expect("our own wrapper");
                assert_eq!(frame.header.destination, STATION);
                let message = Profile::default().decode(frame.header.message_type, frame.data);
                assert!(message.is_ok(), "{message:?}");
            }
            count += 1;
        }
        while let Some((_, frame)) = self.bridge.poll_vehicle() {
            let view = FrameView::parse(frame.bytes()).expect("our own frame");
            assert_eq!(view.header().system_id, 245);
            count += 1;
        }
        while self.bridge.poll_log().is_some() {
            count += 1;
        }
        assert!(count < 20_000, "{count} outputs of one step");
    }
}

fn start(config: &Config, clock: Duration, store: &mut MemoryDisk) -> Bridge {
    let key = SigningKey::new([0x41; 32]).expect("a key");
    let ends = vec![
        LinkEnd {
            key: None,
            peer: None,
        },
        LinkEnd {
            key: Some(key),
            peer: None,
        },
    ];
    Bridge::new(config, ends, at(clock), EPOCH, store).expect("it starts from its own store")
}

fn wrapped(message_type: u16, fields: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0; 16];
    let envelope = Envelope::new(STATION, VEHICLE).requesting_ack();
    // A valid message gives the wrapper; type, length and data are replaced.
    let mut out = [0; MAX_DATAGRAM];
    let beat = stanag_msgs::Message::from(stanag_msgs::messages::Heartbeat::default());
    if beat.encode(&envelope, &mut out).is_ok() {
        bytes.copy_from_slice(&out[..16]);
    }
    let length = u16::try_from(fields.len()).unwrap_or(u16::MAX);
    bytes[2..4].copy_from_slice(&length.to_be_bytes());
    bytes[12..14].copy_from_slice(&message_type.to_be_bytes());
    bytes.extend(fields);
    bytes
}

fn at(clock: Duration) -> Now {
    Now {
        mono: clock,
        wall: EPOCH + clock,
    }
}

fn station() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 40_000))
}

const STATION: Id = Id(0x1b00_00a0);
const VEHICLE: Id = Id(0x1b00_0101);
/// 2026-01-01.
const EPOCH: Duration = Duration::from_secs(1_767_225_600);
const CONFIGURATION: &str = r#"
[dli]
vsm_id = "1b:00:00:01"
listen = "127.0.0.1:4586"
provisional = "all"
[[cucs]]
id = "1b:00:00:a0"
loi = [2, 3, 4, 5]
[[vehicle]]
id = "1b:00:01:01"
link = "udpin:127.0.0.1:14550"
system_id = 1
signing = "off"
[[vehicle]]
id = "1b:00:01:02"
link = "udpin:127.0.0.1:14551"
system_id = 2
signing = { key_file = "uav.key" }
[store]
dir = "state"
"#;
