//! Our end of a signed link, and pymavlink as the other.

use std::time::Duration;

use mavlink_link::Now;
use mavlink_link::clock::Origin;
use mavlink_link::dialect::{MISSION_ITEM_INT_DATA, MavCmd, MavMessage, STATUSTEXT_DATA};
use mavlink_link::frame::{FrameView, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::link::{Auth, Endpoint, Link, LinkConfig, Security};
use mavlink_link::receiver::KeyState;
use mavlink_link::service::{Node, command};
use mavlink_link::signing::{SigningKey, Stamp};
use mavlink_link::store::MemoryDisk;
use serde_json::Value;

use kit::clock::wall;
use kit::process::{filter, from_hex, hex};
use vsm_tests::{here, peers_python, seed_from_clock};

pub(crate) const KEY: [u8; 32] = [0x5a; 32];
pub(crate) const OTHER_KEY: [u8; 32] = [0xa5; 32];

/// Our end of a link, with its key and clock.
pub(crate) struct End {
    pub(crate) link: Link<u16>,
    pub(crate) key: KeyState,
    pub(crate) store: MemoryDisk,
    pub(crate) now: Now,
}

impl End {
    pub(crate) fn new(key: [u8; 32]) -> Self {
        let mut store = MemoryDisk::default();
        let now = Now {
            mono: Duration::ZERO,
            wall: wall(),
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
    pub(crate) fn frames(&mut self) -> Vec<Vec<u8>> {
        let messages = [
            command::long(
                Node::new(1, 1),
                MavCmd::MAV_CMD_NAV_TAKEOFF,
                [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 518.25],
            ),
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

    /// How many messages it believes of a datagram, each with its signature verified.
    pub(crate) fn receive(&mut self, datagram: &[u8]) -> usize {
        self.deliver(datagram, true)
    }

    /// The same, of messages that come without a signature.
    pub(crate) fn receive_unsigned(&mut self, datagram: &[u8]) -> usize {
        self.deliver(datagram, false)
    }

    fn deliver(&mut self, datagram: &[u8], verified: bool) -> usize {
        let mut delivered = 0;
        let auth = Auth::Signed {
            key: &mut self.key,
            store: &mut self.store,
        };
        self.link
            .handle_datagram(self.now, 14_580, datagram, auth, &mut |delivery| {
                assert_eq!(delivery.verified, verified);
                delivered += 1;
            });
        delivered
    }
}

/// What pymavlink makes of each frame, with its clock at `stamp` or a little ahead of a key that has just been read.
pub(crate) fn pymavlink_verifies(
    key: [u8; 32],
    stamp: Option<u64>,
    frames: &[Vec<u8>],
) -> Vec<Value> {
    let verdicts = answers(
        &["verify"],
        key,
        stamp,
        frames.iter().map(|frame| hex(frame)),
    );
    let verdicts: Vec<Value> = verdicts
        .iter()
        .map(|line| serde_json::from_str(line).expect("a verdict"))
        .collect();
    assert_eq!(verdicts.len(), frames.len(), "a verdict for a frame");
    verdicts
}

/// Frames that pymavlink signs, of a new seed each time.
pub(crate) fn pymavlink_signs(key: [u8; 32], count: usize) -> Vec<Vec<u8>> {
    let (seed, count_text) = (seed_from_clock().to_string(), count.to_string());
    let arguments = ["sign", "--seed", &seed, "--count", &count_text];
    let frames = answers(&arguments, key, None, std::iter::empty());
    assert_eq!(frames.len(), count);
    frames.iter().map(|line| from_hex(line)).collect()
}

/// A frame of pymavlink for each wish: see `signing_peer.py`.
pub(crate) fn pymavlink_forges(key: [u8; 32], wishes: &[Value]) -> Vec<Vec<u8>> {
    let frames = answers(&["forge"], key, None, wishes.iter().map(Value::to_string));
    assert_eq!(frames.len(), wishes.len(), "a frame for a wish");
    frames.iter().map(|line| from_hex(line)).collect()
}

/// The stamp of pymavlink's clock: a little ahead of a key that has just been read from its file.
pub(crate) fn peer_stamp() -> u64 {
    Stamp::from_unix(wall() + Duration::from_secs(2)).get()
}

/// Runs pymavlink once: a line for each line.
fn answers(
    arguments: &[&str],
    key: [u8; 32],
    stamp: Option<u64>,
    lines: impl Iterator<Item = String>,
) -> Vec<String> {
    let script = here().join("interop/signing_peer.py");
    let mut all = vec![script.to_string_lossy().into_owned()];
    all.extend(arguments.iter().map(ToString::to_string));
    all.extend([
        "--key".into(),
        hex(&key),
        "--stamp".into(),
        stamp.unwrap_or_else(peer_stamp).to_string(),
    ]);
    let input: String = lines.map(|line| line + "\n").collect();
    let output = filter(&peers_python(), all, input);
    output.lines().map(ToOwned::to_owned).collect()
}

/// The same frame without its signature: flag cleared, checksum made again.
pub(crate) fn unsigned(frame: &[u8]) -> Vec<u8> {
    let view = FrameView::parse(frame).expect("a frame");
    let mut header = view.header();
    header.incompat &= !INCOMPAT_SIGNED;
    let mut out = [0; MAX_FRAME];
    let len = encode(&view.message().expect("a message"), header, &mut out);
    out[..len].to_vec()
}
