//! Others on the link, with and without the key: what they cannot bring about, and what is reported of them.

use std::fs;
use std::net::UdpSocket;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use mavlink_link::dialect::{HEARTBEAT_DATA, MavMessage, STATUSTEXT_DATA};
use mavlink_link::exchange::{
    Agreed, Identity, Node, PairingCode, Parties, PinnedPeer, Responder, ResponderConfig,
    ResponderMemory, ResponderStore, StoreError, Wanted,
};
use mavlink_link::frame::{
    FrameView, Header, INCOMPAT_SIGNED, KEY_EXCHANGE_ID, MAX_FRAME, encode, encode_raw,
};
use mavlink_link::signing::{SigningKey, Stamp, sign};
use serde_json::Value;

use crate::ground::{FIRST, Ground, SECOND, id, is_live_under, key};
use kit::process::{KillOnDrop, program};

/// What a stranger can send in the vehicle's name: unsigned, or a replay from long ago.
fn strangers(with: Option<[u8; 32]>) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let text = MavMessage::STATUSTEXT(STATUSTEXT_DATA::default());
    let header = Header {
        system_id: 1,
        component_id: 1,
        incompat: if with.is_some() { INCOMPAT_SIGNED } else { 0 },
        ..Header::default()
    };
    let mut len = encode(&text, header, &mut out);
    if let Some(bytes) = with {
        len = sign(&key(bytes), 0, Stamp::new(7), &mut out, len).unwrap();
    }
    out[..len].to_vec()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_stranger_ends_the_search_for_the_key_or_keeps_the_vehicle_down() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    ground.write_key("uav1.key.next", SECOND);
    let _bridge = ground.start_bridge();
    ground
        .link_status("settling", |link| link["state"] == "settling")
        .await;
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    for frame in [strangers(None), strangers(None), strangers(Some(FIRST))] {
        socket.send_to(&frame, ("127.0.0.1", ground.link)).unwrap();
    }
    ground
        .link_status("the refused are counted", |link| {
            link["refused"]["not signed"] == 2
        })
        .await;
    let _vehicle = ground.vehicle(Some(SECOND), 0).await;
    ground
        .link_status("the next key", |link| is_live_under(link, &id(SECOND)))
        .await;
}

/// A holder of the key has signed in the VSM's own name, a day ahead: the vehicle keeps that as our last stamp.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_thief_on_our_own_stream_is_reported_and_shaken_off_by_a_restart_of_the_vehicle() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    let vehicle = ground.vehicle(Some(FIRST), 0).await;
    let header = Header {
        system_id: 245,
        component_id: 190,
        incompat: INCOMPAT_SIGNED,
        ..Header::default()
    };
    let ahead = Stamp::from_unix(kit::clock::wall() + Duration::from_secs(86_400));
    let mut out = [0; MAX_FRAME];
    let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    let length = encode(&beat, header, &mut out);
    let length = sign(&key(FIRST), 0, ahead, &mut out, length).unwrap();
    let thief = UdpSocket::bind("127.0.0.1:0").unwrap();
    let to = vehicle.address(0).unwrap();
    {
        // The vehicle answers the peer that sent first.
        let _bridge = ground.start_bridge();
        ground
            .link_status("a signed link", |link| is_live_under(link, &id(FIRST)))
            .await;
        thief.send_to(&out[..length], to).unwrap();
        ground
            .link_status("a dragged clock", |link| {
                link["frames"]["future"].as_u64() > Some(10)
            })
            .await;
    }

    let (done, printed) = ground.command(&["key", "revoke", "--wait-s", "25"]).await;
    assert!(!done && printed.contains("on our own stream"), "{printed}");
    assert!(ground.key("uav1.key").same_as(&key(FIRST)) && ground.has("uav1.key.next"));
    vehicle.restart();
    let (done, printed) = ground.command(&["key", "revoke", "--wait-s", "60"]).await;
    assert!(done, "{printed}");
    assert!(!ground.key("uav1.key").same_as(&key(FIRST)));
    assert!(!ground.has("uav1.key.previous"), "{printed}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_status_page_names_what_was_refused_and_the_peer_stays() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    let _vehicle = ground.vehicle(Some(FIRST), 0).await;
    let _bridge = ground.start_bridge();
    let before = ground
        .link_status("a signed link", |link| is_live_under(link, &id(FIRST)))
        .await;

    // A stranger speaks in the vehicle's name: seven unsigned texts, five signed with another key; and three heartbeats
    // of a system of its own, which a vehicle might have passed on.
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    let text = MavMessage::STATUSTEXT(STATUSTEXT_DATA::default());
    let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    let mut out = [0; MAX_FRAME];
    for _ in 0..7 {
        let len = encode(
            &text,
            Header {
                system_id: 1,
                component_id: 1,
                ..Header::default()
            },
            &mut out,
        );
        stranger
            .send_to(&out[..len], ("127.0.0.1", ground.link))
            .unwrap();
    }
    for n in 0..5 {
        let header = Header {
            system_id: 1,
            component_id: 1,
            incompat: INCOMPAT_SIGNED,
            ..Header::default()
        };
        let len = encode(&text, header, &mut out);
        let wrong = SigningKey::new(SECOND).unwrap();
        let len = sign(
            &wrong,
            0,
            Stamp::new(1 << 47).plus(Duration::from_secs(n)),
            &mut out,
            len,
        )
        .unwrap();
        stranger
            .send_to(&out[..len], ("127.0.0.1", ground.link))
            .unwrap();
    }
    for _ in 0..3 {
        let len = encode(
            &beat,
            Header {
                system_id: 77,
                component_id: 1,
                ..Header::default()
            },
            &mut out,
        );
        stranger
            .send_to(&out[..len], ("127.0.0.1", ground.link))
            .unwrap();
    }

    let after = ground
        .link_status("the refused are counted", |link| {
            let refused: u64 = link["refused"]
                .as_object()
                .map_or(0, |by| by.values().filter_map(Value::as_u64).sum());
            refused >= 12 && link["strangers"].as_u64() >= Some(3)
        })
        .await;
    assert_eq!(after["refused"]["not signed"], 7, "{after:#}");
    assert_eq!(
        after["refused"]["signature does not fit the key"], 5,
        "{after:#}"
    );
    assert_eq!(after["strangers"], 3, "{after:#}");
    assert_eq!(
        after["peer"], before["peer"],
        "the peer is the vehicle still"
    );
    assert_eq!(after["state"], "live");

    // The same in words, by the command.
    let (done, printed) = ground.command(&["status"]).await;
    assert!(
        done && printed.contains("signed with key") && printed.contains("signature does not fit"),
        "{printed}"
    );
}

/// A bare public key in the agent's name, as anybody can send one.
fn public_key(byte: u8) -> Vec<u8> {
    let header = Header {
        system_id: 1,
        component_id: 191,
        message_id: KEY_EXCHANGE_ID,
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let len = encode_raw(header, &[byte; 32], &mut out).unwrap();
    out[..len].to_vec()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_legacy_exchange_replaces_no_key_that_the_vehicle_signs_with() {
    let ground = Ground::new();
    let file = ground.path().join("vsm.toml");
    let config = fs::read_to_string(&file).unwrap();
    let legacy = config.replace("\"uav1.key\"", "\"uav1.key\", exchange = \"legacy\"");
    assert_ne!(legacy, config);
    fs::write(&file, legacy).unwrap();
    ground.write_key("uav1.key", FIRST);
    let stranger = UdpSocket::bind("127.0.0.1:0").unwrap();
    {
        let _vehicle = ground.vehicle(Some(FIRST), 0).await;
        let _bridge = ground.start_bridge();
        ground
            .link_status("a signed link", |link| is_live_under(link, &id(FIRST)))
            .await;
        // Until it is on disk that this key has been in use.
        tokio::time::sleep(Duration::from_millis(1_500)).await;
        stranger
            .send_to(&public_key(9), ("127.0.0.1", ground.link))
            .unwrap();
        tokio::time::sleep(Duration::from_millis(500)).await;
        assert!(!ground.has("uav1.key.next"), "in the same run");
    }
    let _bridge = ground.start_bridge();
    ground
        .link_status("a bridge", |link| link["state"] == "waiting")
        .await;
    stranger
        .send_to(&public_key(7), ("127.0.0.1", ground.link))
        .unwrap();
    tokio::time::sleep(Duration::from_millis(500)).await;
    assert!(!ground.has("uav1.key.next"), "by the record in the store");
}

/// Whether a KEY_EXCHANGE frame arrives at this socket within 5 s.
fn receives_key_exchange(socket: &UdpSocket) -> bool {
    let end = Instant::now() + Duration::from_secs(5);
    let mut bytes = [0; 2_048];
    while Instant::now() < end {
        if let Ok(length) = socket.recv(&mut bytes)
            && FrameView::parse(&bytes[..length])
                .is_ok_and(|frame| frame.header().message_id == KEY_EXCHANGE_ID)
        {
            return true;
        }
    }
    false
}

/// `vsm pair` with a code, for as long as this is held.
fn pair(ground: &Ground) -> KillOnDrop {
    let mut command = Command::new(program("vsm"));
    command
        .args(["pair", "--wait-s", "40", "--code", &"A".repeat(32)])
        .current_dir(ground.path());
    let command = command.stdout(Stdio::null()).stderr(Stdio::null());
    KillOnDrop(command.spawn().unwrap())
}

/// A socket that sends to the vehicle's link.
fn socket_to(ground: &Ground) -> UdpSocket {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket.connect(("127.0.0.1", ground.link)).unwrap();
    let wait = Some(Duration::from_millis(100));
    socket.set_read_timeout(wait).unwrap();
    socket
}

/// Sends this until the command listens, and has taken the sender for the vehicle.
fn until_asked(stranger: &UdpSocket, bytes: &[u8]) {
    let end = Instant::now() + Duration::from_secs(20);
    loop {
        let _ = stranger.send(bytes);
        let mut answer = [0; 2_048];
        if stranger.recv(&mut answer).is_ok() {
            return;
        }
        assert!(Instant::now() < end, "nobody is asked");
    }
}

/// Step 0 of suite 2, to the VSM: from an agent whose window is open for the same code.
fn please() -> Vec<u8> {
    let node = |system, component| Node { system, component };
    let config = ResponderConfig {
        parties: Parties::new(node(245, 190), node(1, 191), 0x1b00_0001, 0x1b00_0101),
        identity: Identity::new([3; 32]),
        wanted: Wanted {
            signing: true,
            confidential: false,
        },
    };
    let mut responder: Responder<u8> =
        Responder::new(config, ResponderMemory::default(), Duration::ZERO);
    let code = PairingCode::parse(&"A".repeat(32)).unwrap();
    responder
        .open_window(Duration::ZERO, &code, &mut Nothing)
        .unwrap();
    let please = responder.please(Duration::ZERO).unwrap().to_payload();
    let header = Header {
        system_id: 1,
        component_id: 191,
        message_id: KEY_EXCHANGE_ID,
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let length = encode_raw(header, &please, &mut out).unwrap();
    out[..length].to_vec()
}

#[test]
fn a_pairing_continues_with_the_agent_whoever_has_sent_before_it() {
    let ground = Ground::new();
    let _pairing = pair(&ground);
    let (stranger, agent) = (socket_to(&ground), socket_to(&ground));
    let header = Header {
        system_id: 1,
        component_id: 1,
        ..Header::default()
    };
    let mut beat = [0; MAX_FRAME];
    let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    let length = encode(&message, header, &mut beat);
    let beat = &beat[..length];
    until_asked(&stranger, beat);
    agent.send(&please()).unwrap();
    // The stranger continues speaking.
    std::thread::sleep(Duration::from_millis(100));
    stranger.send(beat).unwrap();
    assert!(receives_key_exchange(&agent));
}

#[test]
fn a_request_that_forty_addresses_replay_does_not_keep_a_pairing_from_the_agent() {
    let ground = Ground::new();
    let _pairing = pair(&ground);
    let (agent, please) = (socket_to(&ground), please());
    let crowd: Vec<_> = (0..40).map(|_| socket_to(&ground)).collect();
    until_asked(&crowd[0], &please);
    let over = AtomicBool::new(false);
    let received = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !over.load(Ordering::Relaxed) {
                for one in &crowd {
                    let _ = one.send(&please);
                }
                // As many as fit into the socket while its program has no processor: the agent's one must not be lost.
                std::thread::sleep(Duration::from_millis(25));
            }
        });
        std::thread::sleep(Duration::from_millis(300));
        // Once, as in ten seconds.
        agent.send(&please).unwrap();
        let received = receives_key_exchange(&agent);
        over.store(true, Ordering::Relaxed);
        received
    });
    assert!(received, "every message went to those who replay");
}

/// An agent's disk on which nothing is ever written.
struct Nothing;

impl ResponderStore for Nothing {
    fn withdraw_next(&mut self) -> Result<(), StoreError> {
        Ok(())
    }

    fn store_agreed(&mut self, _: &PinnedPeer, _: &Agreed) -> Result<(), StoreError> {
        Ok(())
    }
}
