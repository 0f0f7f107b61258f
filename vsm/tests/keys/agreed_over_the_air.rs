//! `vsm run` agrees about a key with an agent on its link, continues under the old one meanwhile, and is under the new one
//! with the vehicle's first frame under it; the legacy exchange brings a first key where it is switched on.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use kit::clock::wall;
use mavlink_link::dialect::{HEARTBEAT_DATA, MavAutopilot, MavMessage};
use mavlink_link::exchange::{
    Agreed, Identity, Inbound, Legacy, Node, Parties, PinnedPeer, Responder, ResponderConfig,
    ResponderMemory, ResponderStore, StoreError, Wanted,
};
use mavlink_link::frame::{
    FrameView, Header, INCOMPAT_SIGNED, KEY_EXCHANGE_ID, MAX_FRAME, encode, encode_raw,
};
use mavlink_link::signing::{SigningKey, Stamp, sign};
use tokio::net::UdpSocket;
use vsm::config::Config;
use vsm::key_exchange::{ExchangeRecord, identity};
use vsm::session::Status;
use vsm::shell::disk::FileDisk;
use vsm::shell::key_file;
use vsm::shell::key_file::system_random;
use vsm::shell::server::Server;

const GROUND: Node = Node {
    system: 245,
    component: 190,
};
const AIR: Node = Node {
    system: 1,
    component: 191,
};

fn config(folder: &Path, exchange: &str) -> Config {
    let text = format!(
        "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:0\"\n[[vehicle]]\nid = \"1b:00:01:01\"\n\
         link = \"udpin:127.0.0.1:0\"\nsystem_id = 1\nsigning = {{ key_file = \"uav1.key\", exchange = \"{exchange}\" }}\n\
         [store]\ndir = \"state\"\n"
    );
    Config::parse(&text, folder).expect("good")
}

/// The agent and the vehicle behind it, on one socket.
struct Vehicle {
    socket: UdpSocket,
    key: Option<SigningKey>,
    units: u64,
    seq: u8,
}

impl Vehicle {
    async fn towards(server: &Server) -> Vehicle {
        let socket = UdpSocket::bind("127.0.0.1:0").await.unwrap();
        let address = server.vehicle_address(0).unwrap();
        socket.connect(address).await.unwrap();
        Vehicle {
            socket,
            key: None,
            units: Stamp::from_unix(wall()).get(),
            seq: 0,
        }
    }

    fn header(&mut self, component_id: u8, message_id: u32, incompat: u8) -> Header {
        self.seq = self.seq.wrapping_add(1);
        Header {
            seq: self.seq,
            system_id: 1,
            component_id,
            message_id,
            incompat,
            compat: 0,
        }
    }

    async fn heartbeat(&mut self) {
        let Some(key) = self.key.as_ref().map(SigningKey::duplicate) else {
            return;
        };
        let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            autopilot: MavAutopilot::MAV_AUTOPILOT_PX4,
            ..HEARTBEAT_DATA::default()
        });
        let mut out = [0; MAX_FRAME];
        let len = encode(&message, self.header(1, 0, INCOMPAT_SIGNED), &mut out);
        // A vehicle raises its stamp to those it receives; this one is a little ahead of the ground. Of this computer's clock,
        // and not more with each frame: the many frames of the first seconds would lead it an hour ahead, where none counts.
        let ahead = Stamp::from_unix(wall() + Duration::from_secs(10));
        self.units = (self.units + 1).max(ahead.get());
        let len = sign(&key, 0, Stamp::new(self.units), &mut out, len).unwrap();
        self.socket.send(&out[..len]).await.unwrap();
    }

    async fn exchange(&mut self, payload: &[u8]) {
        let mut out = [0; MAX_FRAME];
        let header = self.header(AIR.component, KEY_EXCHANGE_ID, 0);
        let len = encode_raw(header, payload, &mut out).unwrap();
        self.socket.send(&out[..len]).await.unwrap();
    }

    /// The payload of a KEY_EXCHANGE frame of the ground, and whether it was signed; gives up after a while.
    async fn receive(&mut self) -> Option<(Vec<u8>, bool)> {
        let mut bytes = [0; 512];
        let received =
            tokio::time::timeout(Duration::from_millis(50), self.socket.recv(&mut bytes));
        let len = received.await.ok()?.ok()?;
        let frame = FrameView::parse(&bytes[..len]).ok()?;
        let header = frame.header();
        assert_eq!(header.system_id, GROUND.system);
        (header.message_id == KEY_EXCHANGE_ID)
            .then(|| (frame.payload().to_vec(), frame.is_signed()))
    }
}

#[derive(Default)]
struct Disk(Option<SigningKey>);

impl ResponderStore for Disk {
    fn withdraw_next(&mut self) -> Result<(), StoreError> {
        Ok(())
    }

    fn store_agreed(&mut self, _: &PinnedPeer, agreed: &Agreed) -> Result<(), StoreError> {
        self.0 = Some(agreed.key.duplicate());
        Ok(())
    }
}

/// The bridge beside a script; its last status, once the script is through.
async fn beside(server: Server, script: impl Future<Output = ()>) -> Status {
    let (done, stopped) = tokio::sync::oneshot::channel::<()>();
    let script = async {
        script.await;
        let _ = done.send(());
    };
    let serving = server.serve(async {
        let _ = stopped.await;
    });
    let (status, ()) = tokio::join!(serving, script);
    status.unwrap()
}

#[tokio::test]
async fn a_key_that_is_too_old_is_replaced_in_flight() {
    let folder = tempfile::tempdir().unwrap();
    let config = config(folder.path(), "on");
    let key_path = folder.path().join("uav1.key");
    key_file::generate(&key_path).unwrap();
    let old = key_file::read(&key_path).unwrap();
    let (old_id, air) = (old.id(), Identity::new([3; 32]));
    let ground = {
        let mut store = FileDisk::open(&config.store.dir).unwrap();
        let mut record = ExchangeRecord {
            peer: Some(*air.public().bytes()),
            ..ExchangeRecord::default()
        };
        // In use since 1970.
        record.note_key(old_id, 0);
        let vehicle = config.vehicles().next().unwrap().id;
        record.save(&mut store, vehicle).unwrap();
        identity(&mut store, &mut system_random).unwrap().public()
    };
    let server = Server::open(&config).unwrap();
    let mut vehicle = Vehicle::towards(&server).await;
    vehicle.key = Some(old);
    let responder = ResponderConfig {
        parties: Parties::new(GROUND, AIR, 0x1b00_0001, 0x1b00_0101),
        identity: air,
        wanted: Wanted {
            signing: true,
            confidential: false,
        },
    };
    let memory = ResponderMemory {
        peer: Some(PinnedPeer {
            key: ground,
            counter: 0,
        }),
        ..ResponderMemory::default()
    };
    let begun = Instant::now();
    let mut responder = Responder::new(responder, memory, Duration::ZERO);
    let mut disk = Disk::default();
    let next_path = folder.path().join("uav1.key.next");
    let status = beside(server, async {
        let mut agreed_at = None;
        while begun.elapsed() < Duration::from_secs(30) {
            vehicle.heartbeat().await;
            if let Some((payload, signed)) = vehicle.receive().await {
                assert!(signed, "under the current key");
                let inbound = Inbound {
                    from: (),
                    source: GROUND,
                    verified: signed,
                    payload: &payload,
                };
                let now = begun.elapsed();
                responder
                    .handle(now, inbound, &mut system_random, &mut disk)
                    .unwrap();
                while let Some(answer) = responder.poll_transmit() {
                    vehicle.exchange(&answer.message.to_payload()).await;
                }
            }
            if agreed_at.is_none() && disk.0.is_some() {
                assert!(next_path.exists(), "on disk here before it is there");
                agreed_at = Some(begun.elapsed());
            }
            // The vehicle flies on under the old key for a second, then it is given the new one.
            if agreed_at.is_some_and(|at| begun.elapsed() > at + Duration::from_secs(1))
                && let Some(new) = disk.0.take()
            {
                assert_eq!(key_file::read(&key_path).unwrap().id(), old_id);
                vehicle.key = Some(new);
            }
            let new_id = vehicle.key.as_ref().map(SigningKey::id);
            if new_id != Some(old_id) && !next_path.exists() {
                // A few more frames, which must count.
                for _ in 0..5 {
                    vehicle.heartbeat().await;
                    vehicle.receive().await;
                }
                return;
            }
        }
        panic!("the ground does not come under the new key");
    })
    .await;
    let new_id = vehicle.key.unwrap().id();
    assert_eq!(key_file::read(&key_path).unwrap().id(), new_id);
    let link = &status.vehicles[0].link;
    assert_eq!(link.key_id, Some(new_id.to_string()));
    assert_eq!(link.state, "live");
    let exchange = link.exchange.as_ref().unwrap();
    assert_eq!((exchange.mode, exchange.taken), ("on", 2));
    assert_eq!(
        exchange.state, "idle",
        "what was reported on the way is over"
    );
    assert!(exchange.peer.is_some());
}

#[tokio::test]
async fn the_legacy_exchange_brings_a_first_key_and_is_reported() {
    let folder = tempfile::tempdir().unwrap();
    let config = config(folder.path(), "legacy");
    let server = Server::open(&config).unwrap();
    let mut vehicle = Vehicle::towards(&server).await;
    let key_path = folder.path().join("uav1.key");
    let placeholder = key_file::read(&key_path).unwrap().id();
    let mut legacy = Legacy::new(Identity::new([4; 32]), GROUND, Duration::ZERO);
    let begun = Instant::now();
    let status = beside(server, async {
        while begun.elapsed() < Duration::from_secs(30) {
            if let Some(payload) = legacy.poll_transmit(begun.elapsed()) {
                vehicle.exchange(&payload[..32]).await;
            }
            vehicle.heartbeat().await;
            if let Some((payload, _)) = vehicle.receive().await {
                assert_eq!(payload.len(), 32, "the public key alone");
                if let Ok(key) = legacy.handle(GROUND, &payload) {
                    vehicle.key = Some(key);
                }
            }
            let agreed = vehicle.key.as_ref().map(SigningKey::id);
            if agreed.is_some() && key_file::read(&key_path).ok().map(|key| key.id()) == agreed {
                for _ in 0..5 {
                    vehicle.heartbeat().await;
                    vehicle.receive().await;
                }
                return;
            }
        }
        panic!("no key comes of it");
    })
    .await;
    let link = &status.vehicles[0].link;
    let agreed = vehicle.key.unwrap().id();
    assert_ne!(agreed, placeholder);
    assert_eq!(link.key_id, Some(agreed.to_string()));
    assert_eq!(link.state, "live");
    assert_eq!(link.exchange.as_ref().unwrap().mode, "legacy");
}

#[tokio::test]
async fn without_the_exchange_its_frames_are_counted_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let config = config(folder.path(), "off");
    let key_path = folder.path().join("uav1.key");
    key_file::generate(&key_path).unwrap();
    let before = fs::read(&key_path).unwrap();
    let server = Server::open(&config).unwrap();
    let mut vehicle = Vehicle::towards(&server).await;
    let status = beside(server, async {
        for _ in 0..5 {
            vehicle.exchange(&[9; 32]).await;
            assert_eq!(vehicle.receive().await, None);
        }
    })
    .await;
    assert_eq!(fs::read(&key_path).unwrap(), before);
    assert!(status.vehicles[0].link.exchange.is_none());
    assert_eq!(status.vehicles[0].link.frames["key_exchange"], 5);
}
