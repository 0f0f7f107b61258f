//! A key that was agreed over the air is taken up by a frame that the vehicle signs with it, not by a recording of one.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::dialect::{HEARTBEAT_DATA, MavMessage};
use mavlink_link::frame::{FrameView, Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::signing::{SigningKey, Stamp, sign, verify};
use mavlink_link::store::{Disk as _, Durability};
use vsm::config::Config;
use vsm::session::{Bridge, KeyChange, LinkEnd, Peer};
use vsm::shell::disk::FileDisk;

const NOT_BEFORE: Duration = Duration::from_secs(1_767_225_600);
const VEHICLE: u16 = 14_580;
const STRANGER: u16 = 6_666;

fn at(ms: u64) -> Now {
    Now {
        mono: Duration::from_millis(ms),
        wall: Duration::from_secs(1_795_219_200) + Duration::from_millis(ms),
    }
}

fn key(byte: u8) -> SigningKey {
    SigningKey::new([byte; 32]).unwrap()
}

fn peer(port: u16) -> Peer {
    Peer::Udp(([127, 0, 0, 1], port).into())
}

struct Ground {
    bridge: Bridge,
    store: FileDisk,
    _folder: tempfile::TempDir,
}

impl Ground {
    /// KeySlot key 1, with key 2 agreed; of key 2 everything up to `seen` has been in use before.
    fn new(seen: Option<Stamp>) -> Ground {
        let folder = tempfile::tempdir().unwrap();
        let text = "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:0\"\n[[vehicle]]\nid = \"1b:00:01:01\"\n\
                    link = \"udpin:127.0.0.1:0\"\nsystem_id = 1\nsigning = { key_file = \"1.key\" }\n\
                    [store]\ndir = \"state\"\n";
        let config = Config::parse(text, folder.path()).unwrap();
        let mut store = FileDisk::open(&folder.path().join("state")).unwrap();
        if let Some(seen) = seen {
            let name = format!("clock-{}", key(2).id());
            let text = seen.get().to_string();
            store
                .replace(&name, text.as_bytes(), Durability::Power)
                .unwrap();
        }
        let end = LinkEnd {
            key: Some(key(1)),
            peer: None,
        };
        let mut bridge = Bridge::new(&config, vec![end], at(0), NOT_BEFORE, &mut store).unwrap();
        bridge
            .offer_next_key(0, key(2), at(0), NOT_BEFORE, &mut store)
            .unwrap();
        Ground {
            bridge,
            store,
            _folder: folder,
        }
    }

    fn receives(&mut self, now: Now, from: u16, stamp: Stamp) -> Option<KeyChange> {
        let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
        let header = Header {
            system_id: 1,
            component_id: 1,
            incompat: INCOMPAT_SIGNED,
            ..Header::default()
        };
        let mut out = [0; MAX_FRAME];
        let len = encode(&message, header, &mut out);
        let len = sign(&key(2), 0, stamp, &mut out, len).unwrap();
        self.bridge.handle_vehicle(
            now,
            0,
            peer(from),
            &out[..len],
            &mut self.store,
            &mut |_, _| {},
        );
        self.bridge.poll_key_change().map(|(_, change)| change)
    }

    /// The stamps of what went to that port, signed with key 2.
    fn lifted(&mut self, port: u16) -> Vec<Stamp> {
        let mut stamps = vec![];
        while let Some((_, frame)) = self.bridge.poll_vehicle() {
            let view = FrameView::parse(frame.bytes()).unwrap();
            if frame.to == peer(port) && verify(&key(2), &view).is_ok() {
                stamps.push(view.signature().unwrap().stamp);
            }
        }
        stamps
    }
}

#[test]
fn the_first_frame_under_a_fresh_key_is_the_proof_whatever_the_two_clocks_are() {
    let mut ground = Ground::new(None);
    let behind = Stamp::from_unix(at(0).wall - Duration::from_secs(86_400));
    assert_eq!(
        ground.receives(at(10), VEHICLE, behind),
        Some(KeyChange::Commit)
    );
}

#[test]
fn a_recording_changes_no_key_and_the_vehicle_itself_is_lifted_until_it_can_prove_it() {
    let seen = Stamp::from_unix(at(60_000).wall);
    let mut ground = Ground::new(Some(seen));
    assert_eq!(
        ground.receives(at(10), STRANGER, Stamp::new(seen.get() - 7)),
        None
    );
    assert!(ground.lifted(STRANGER).iter().all(|stamp| *stamp > seen));
    // The vehicle has restarted, so its stamps are old too. A heartbeat under that key lifts them.
    assert_eq!(ground.receives(at(1_000), VEHICLE, Stamp::new(1)), None);
    let lifted = ground.lifted(VEHICLE);
    let answer = lifted.last().unwrap().next().unwrap();
    assert_eq!(
        ground.receives(at(1_050), VEHICLE, answer),
        Some(KeyChange::Commit)
    );
}
