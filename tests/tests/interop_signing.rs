//! Frames signed here verify in pymavlink, and those signed by pymavlink verify here; each side refuses
//! the wrong key, the replayed and the unsigned.

mod interop_support;

use std::fmt::Write as _;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use mavlink_link::Now;
use mavlink_link::clock::{CeilingStore, Origin, StoreError};
use mavlink_link::dialect::{
    COMMAND_LONG_DATA, MISSION_ITEM_INT_DATA, MavCmd, MavMessage, STATUSTEXT_DATA,
};
use mavlink_link::frame::{FrameView, INCOMPAT_SIGNED, MAX_FRAME, SIGNATURE_LEN, encode};
use mavlink_link::link::{Auth, Endpoint, Link, LinkConfig, Security};
use mavlink_link::receiver::KeyState;
use mavlink_link::signing::{KeyId, SigningKey, Stamp};
use serde_json::Value;

use interop_support::{filter, here, peers_python, seed_from_clock};

const KEY: [u8; 32] = [0x5a; 32];
const OTHER_KEY: [u8; 32] = [0xa5; 32];

#[test]
fn pymavlink_verifies_our_frames() {
    let mut ours = End::new(KEY);
    let frames = ours.frames();
    let verdicts = pymavlink_verifies(KEY, &frames);
    for (verdict, frame) in verdicts.iter().zip(&frames) {
        assert_eq!(verdict["accepted"], true, "{verdict} for {}", hex(frame));
    }
    let names: Vec<_> = verdicts
        .iter()
        .filter_map(|v| v["message"].as_str())
        .collect();
    assert_eq!(
        names,
        [
            "HEARTBEAT",
            "COMMAND_LONG",
            "MISSION_ITEM_INT",
            "STATUSTEXT"
        ]
    );
    assert_eq!(verdicts[1]["fields"]["param7"], 518.25);
    assert_eq!(verdicts[2]["fields"]["x"], 473_977_434);
    assert_eq!(verdicts[3]["fields"]["text"], "a text, with its end");
}

#[test]
fn pymavlink_refuses_the_wrong_key_the_replayed_and_the_unsigned() {
    let frames = End::new(KEY).frames();
    let verdicts = pymavlink_verifies(OTHER_KEY, &frames);
    assert!(verdicts.iter().all(|v| v["accepted"] == false));
    assert_eq!(verdicts.len(), frames.len());

    let twice: Vec<_> = frames.iter().chain(&frames).cloned().collect();
    let verdicts = pymavlink_verifies(KEY, &twice);
    let (first, again) = verdicts.split_at(frames.len());
    assert!(first.iter().all(|v| v["accepted"] == true), "{first:?}");
    assert!(again.iter().all(|v| v["accepted"] == false), "{again:?}");

    let bare: Vec<_> = frames.iter().map(|frame| unsigned(frame)).collect();
    let verdicts = pymavlink_verifies(KEY, &bare);
    assert!(
        verdicts.iter().all(|v| v["accepted"] == false),
        "{verdicts:?}"
    );
}

#[test]
fn we_verify_the_frames_of_pymavlink() {
    let frames = pymavlink_signs(KEY, 200);
    let mut ours = End::new(KEY);
    for frame in &frames {
        assert_eq!(ours.receive(frame), 1, "{}", hex(frame));
        // What the frame says is read as it was meant: packed again, it is the same octets.
        let view = FrameView::parse(frame).expect("a frame");
        let message = view.message().expect("a message of the dialect");
        let mut out = [0; MAX_FRAME];
        let len = encode(&message, view.header(), &mut out);
        assert_eq!(hex(&out[..len]), hex(&frame[..frame.len() - SIGNATURE_LEN]));
    }
    let stats = ours.link.stats();
    assert_eq!(
        (stats.good_frames, stats.bad_crc, stats.delivered_verified),
        (200, 0, 200)
    );
}

#[test]
fn we_refuse_the_wrong_key_the_replayed_and_the_unsigned_of_pymavlink() {
    let frames = pymavlink_signs(KEY, 20);

    let mut strange = End::new(OTHER_KEY);
    assert!(frames.iter().all(|frame| strange.receive(frame) == 0));
    assert_eq!(strange.link.stats().bad_signature, 20);

    let mut ours = End::new(KEY);
    assert!(frames.iter().all(|frame| ours.receive(frame) == 1));
    assert!(frames.iter().all(|frame| ours.receive(frame) == 0));
    assert_eq!(ours.link.stats().stale, 20);

    let mut ours = End::new(KEY);
    assert!(
        frames
            .iter()
            .all(|frame| ours.receive(&unsigned(frame)) == 0)
    );
    assert_eq!(ours.link.stats().unsigned_vehicle, 20);

    // Any one bit of a signature counts.
    let mut ours = End::new(KEY);
    let mut bent = frames[0].clone();
    *bent.last_mut().expect("octets") ^= 1;
    assert_eq!(ours.receive(&bent), 0);
    assert_eq!(ours.receive(&frames[0]), 1, "a forged frame deafens nobody");
}

/// Our end of a link, with its key and clock.
struct End {
    link: Link<u16>,
    key: KeyState,
    store: Nowhere,
    now: Now,
}

impl End {
    fn new(key: [u8; 32]) -> Self {
        let mut store = Nowhere;
        let now = Now {
            mono: Duration::ZERO,
            wall: SystemTime::now()
                .duration_since(UNIX_EPOCH)
                .expect("after 1970"),
        };
        let key = SigningKey::new(key).expect("a key");
        let key = KeyState::start(key, Origin::KeyFile, Stamp::ZERO, now, &mut store)
            .expect("the key's state");
        let link = Link::new(LinkConfig::new(
            1,
            Security::Signed,
            Endpoint::Fixed(14_580),
        ));
        Self {
            link,
            key,
            store,
            // Stamps must be above those that a key file may have seen before.
            now: now.after(Duration::from_secs(1)),
        }
    }

    /// A heartbeat by itself, and three messages that were asked for.
    fn frames(&mut self) -> Vec<Vec<u8>> {
        let messages = [
            MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
                param7: 518.25,
                command: MavCmd::MAV_CMD_NAV_TAKEOFF,
                target_system: 1,
                target_component: 1,
                ..Default::default()
            }),
            MavMessage::MISSION_ITEM_INT(MISSION_ITEM_INT_DATA {
                x: 473_977_434,
                y: 85_455_939,
                z: 30.0,
                seq: 3,
                target_system: 1,
                target_component: 1,
                ..Default::default()
            }),
            MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                text: "a text, with its end".into(),
                ..Default::default()
            }),
        ];
        self.link.handle_timeout(self.now);
        let mut out = [0; MAX_FRAME];
        let auth = Auth::Signed {
            key: &mut self.key,
            store: &mut self.store,
        };
        let sent = self
            .link
            .poll_transmit(self.now, auth, &mut out)
            .expect("a heartbeat is due");
        let mut frames = vec![out[..sent.len].to_vec()];
        for message in &messages {
            let auth = Auth::Signed {
                key: &mut self.key,
                store: &mut self.store,
            };
            let sent = self
                .link
                .send(self.now, auth, message, &mut out)
                .expect("a frame");
            frames.push(out[..sent.len].to_vec());
        }
        frames
    }

    /// How many messages it believes of a datagram.
    fn receive(&mut self, datagram: &[u8]) -> usize {
        let mut delivered = 0;
        let auth = Auth::Signed {
            key: &mut self.key,
            store: &mut self.store,
        };
        self.link
            .handle_datagram(self.now, 14_580, datagram, auth, &mut |delivery| {
                assert!(delivery.verified);
                delivered += 1;
            });
        delivered
    }
}

/// A store for a key that lives as long as the test.
struct Nowhere;

impl CeilingStore for Nowhere {
    fn load(&mut self, _key: &KeyId) -> Result<Option<Stamp>, StoreError> {
        Ok(None)
    }

    fn store(&mut self, _key: &KeyId, _ceiling: Stamp) -> Result<(), StoreError> {
        Ok(())
    }
}

fn pymavlink_verifies(key: [u8; 32], frames: &[Vec<u8>]) -> Vec<Value> {
    let mut input = String::new();
    for frame in frames {
        let _ = writeln!(input, "{}", hex(frame));
    }
    let output = peer(&["verify"], key, input);
    let verdicts: Vec<Value> = output
        .lines()
        .map(|line| serde_json::from_str(line).expect("a verdict"))
        .collect();
    assert_eq!(verdicts.len(), frames.len(), "a verdict for a frame");
    verdicts
}

fn pymavlink_signs(key: [u8; 32], count: usize) -> Vec<Vec<u8>> {
    let (seed, count_text) = (seed_from_clock().to_string(), count.to_string());
    let arguments = ["sign", "--seed", &seed, "--count", &count_text];
    let frames: Vec<_> = peer(&arguments, key, String::new())
        .lines()
        .map(octets)
        .collect();
    assert_eq!(frames.len(), count);
    frames
}

/// Runs pymavlink with a clock a little ahead of a key that has just been read from its file.
fn peer(arguments: &[&str], key: [u8; 32], input: String) -> String {
    let wall = SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .expect("after 1970");
    let stamp = Stamp::from_unix(wall + Duration::from_secs(2)).get();
    let script = here().join("interop/signing_peer.py");
    let mut all = vec![script.to_string_lossy().into_owned()];
    all.extend(arguments.iter().map(ToString::to_string));
    all.extend([
        "--key".into(),
        hex(&key),
        "--stamp".into(),
        stamp.to_string(),
    ]);
    filter(&peers_python(), all, input)
}

/// The same frame without its signature: flag cleared, checksum made anew.
fn unsigned(frame: &[u8]) -> Vec<u8> {
    let view = FrameView::parse(frame).expect("a frame");
    let mut header = view.header();
    header.incompat &= !INCOMPAT_SIGNED;
    let mut out = [0; MAX_FRAME];
    let len = encode(&view.message().expect("a message"), header, &mut out);
    out[..len].to_vec()
}

fn hex(octets: &[u8]) -> String {
    octets.iter().fold(String::new(), |mut hex, octet| {
        let _ = write!(hex, "{octet:02x}");
        hex
    })
}

fn octets(hex: &str) -> Vec<u8> {
    (0..hex.len() / 2)
        .map(|at| u8::from_str_radix(&hex[2 * at..2 * at + 2], 16).expect("hex"))
        .collect()
}
