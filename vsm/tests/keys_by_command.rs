//! The key commands and what the status page says of keys, on the program itself with a simulated vehicle.

mod program_support;

use std::fs;
use std::io::{Read as _, Write as _};
use std::net::{TcpStream, UdpSocket};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use mavlink_link::dialect::{HEARTBEAT_DATA, MavMessage, STATUSTEXT_DATA};
use mavlink_link::frame::{
    FrameView, Header, INCOMPAT_SIGNED, KEY_EXCHANGE_ID, MAX_FRAME, encode, encode_raw,
};
use mavlink_link::signing::{SigningKey, Stamp, sign};
use program_support::{Running, VSM, free_port, run};
use serde_json::Value;
use sim::px4::{LinkAddress, Simulator, SimulatorConfig};

const FIRST: [u8; 32] = [0x11; 32];
const SECOND: [u8; 32] = [0x22; 32];

/// A folder with a configuration: the bridge waits for the vehicle at `link`, and serves its page at `http`.
struct Ground {
    folder: tempfile::TempDir,
    link: u16,
    http: u16,
}

impl Ground {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (dli, link, http) = (free_port(), free_port(), free_port());
        let config = format!(
            "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:{dli}\"\n[[vehicle]]\nid = \"1b:00:01:01\"\n\
             link = \"udpin:127.0.0.1:{link}\"\nsystem_id = 1\nsigning = {{ key_file = \"uav1.key\" }}\n\
             [store]\ndir = \"state\"\n[http]\nlisten = \"127.0.0.1:{http}\"\n"
        );
        fs::write(folder.path().join("vsm.toml"), config).unwrap();
        Self { folder, link, http }
    }

    fn path(&self) -> &Path {
        self.folder.path()
    }

    fn write_key(&self, name: &str, key: [u8; 32]) {
        let hex: String = key.iter().map(|octet| format!("{octet:02x}")).collect();
        let mut file = fs::OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(self.path().join(name))
            .unwrap();
        writeln!(file, "{hex}").unwrap();
    }

    fn key(&self, name: &str) -> SigningKey {
        let text = fs::read_to_string(self.path().join(name)).unwrap();
        SigningKey::from_hex(text.trim()).unwrap()
    }

    fn has(&self, name: &str) -> bool {
        self.path().join(name).exists()
    }

    /// Runs a command to its end, off the runtime that the vehicle lives on.
    async fn command(&self, arguments: &'static [&'static str]) -> (bool, String) {
        let folder = self.path().to_owned();
        let (done, said) = tokio::task::spawn_blocking(move || run(&folder, arguments))
            .await
            .unwrap();
        (done, String::from_utf8_lossy(&said).into_owned())
    }

    fn start_bridge(&self) -> Running {
        let bridge = Command::new(VSM)
            .args(["run", "--config", "vsm.toml"])
            .current_dir(self.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Running(bridge)
    }

    /// The first vehicle's link in /status.json, once it says what is waited for.
    async fn link_status(&self, what: &str, good: impl Fn(&Value) -> bool) -> Value {
        let end = Instant::now() + Duration::from_secs(20);
        let mut last = Value::Null;
        loop {
            if let Some(status) = self.status_json() {
                let link = status["vehicles"][0]["link"].clone();
                if good(&link) {
                    return link;
                }
                last = link;
            }
            assert!(Instant::now() < end, "{what}: {last:#}");
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
    }

    fn status_json(&self) -> Option<Value> {
        let mut stream = TcpStream::connect(("127.0.0.1", self.http)).ok()?;
        stream
            .write_all(b"GET /status.json HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n")
            .ok()?;
        let mut answer = String::new();
        stream.read_to_string(&mut answer).ok()?;
        let (head, body) = answer.split_once("\r\n\r\n")?;
        assert!(head.starts_with("HTTP/1.1 200"), "{head}");
        serde_json::from_str(body).ok()
    }

    /// A vehicle that calls here; it signs where it has a key.
    async fn vehicle(&self, key: Option<[u8; 32]>, first: u64) -> Simulator {
        let link: LinkAddress = format!("udpout:127.0.0.1:{}", self.link).parse().unwrap();
        Simulator::spawn(SimulatorConfig {
            key: key.map(|key| SigningKey::new(key).unwrap()),
            initial_timestamp: first,
            ..SimulatorConfig::on(link)
        })
        .await
        .unwrap()
    }
}

fn key(octets: [u8; 32]) -> SigningKey {
    SigningKey::new(octets).unwrap()
}

fn id(octets: [u8; 32]) -> String {
    key(octets).id().to_string()
}

fn is_live_under(link: &Value, key_id: &str) -> bool {
    link["state"] == "live" && link["signed"] == true && link["key_id"] == key_id
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_key_file_for_a_simulated_px4_brings_up_a_signed_link() {
    let ground = Ground::new();
    let (done, said) = ground
        .command(&[
            "key",
            "provision",
            "--sitl-file",
            "rootfs/mavlink-signing-key.bin",
        ])
        .await;
    assert!(!done, "a folder that is not there: {said}");
    fs::create_dir(ground.path().join("rootfs")).unwrap();
    let (done, said) = ground
        .command(&[
            "key",
            "provision",
            "--sitl-file",
            "rootfs/mavlink-signing-key.bin",
        ])
        .await;
    assert!(done, "{said}");

    // PX4's own format: the key, and the first stamp.
    let file = fs::read(ground.path().join("rootfs/mavlink-signing-key.bin")).unwrap();
    assert_eq!(file.len(), 40);
    let key: [u8; 32] = file[..32].try_into().unwrap();
    let first = u64::from_le_bytes(file[32..].try_into().unwrap());
    assert!(
        ground
            .key("uav1.key")
            .same_as(&SigningKey::new(key).unwrap())
    );
    assert!(said.contains(&id(key)), "{said}");

    let _vehicle = ground.vehicle(Some(key), first).await;
    let _bridge = ground.start_bridge();
    let link = ground
        .link_status("a signed link", |link| is_live_under(link, &id(key)))
        .await;
    assert!(link["live_s"].as_f64().unwrap() >= 0.0, "{link:#}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_revoked_key_is_gone_at_both_ends() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    let _vehicle = ground.vehicle(Some(FIRST), 0).await;
    let (done, said) = ground.command(&["key", "revoke", "--wait-s", "60"]).await;
    assert!(done, "{said}");
    assert!(said.contains("the old key is deleted"), "{said}");
    let key = ground.key("uav1.key");
    assert!(!key.same_as(&SigningKey::new(FIRST).unwrap()));
    assert!(!ground.has("uav1.key.previous") && !ground.has("uav1.key.next"));
    let (_, listed) = ground.command(&["key", "list"]).await;
    assert!(listed.contains(&key.id().to_string()), "{listed}");
    assert!(!listed.contains(&id(FIRST)), "{listed}");

    let _bridge = ground.start_bridge();
    let new_id = key.id().to_string();
    ground
        .link_status("a link under the new key", |link| {
            is_live_under(link, &new_id)
        })
        .await;
}

/// An earlier process was ended with a handover open: the vehicle has the new key.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_bridge_finds_out_that_the_vehicle_has_the_next_key() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    ground.write_key("uav1.key.next", SECOND);
    let _vehicle = ground.vehicle(Some(SECOND), 0).await;
    let _bridge = ground.start_bridge();
    ground
        .link_status("the next key", |link| is_live_under(link, &id(SECOND)))
        .await;
    assert!(ground.key("uav1.key").same_as(&key(SECOND)));
    assert!(ground.key("uav1.key.previous").same_as(&key(FIRST)));
    assert!(!ground.has("uav1.key.next"));
}

/// The same, and the vehicle has the old key: only half a minute of nothing else throws the new one away.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_bridge_finds_out_that_the_vehicle_has_kept_its_key() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    ground.write_key("uav1.key.next", SECOND);
    let _vehicle = ground.vehicle(Some(FIRST), 0).await;
    let _bridge = ground.start_bridge();
    let link = ground
        .link_status("settling", |link| link["state"] == "settling")
        .await;
    assert_eq!(link["key_id"], Value::Null, "{link:#}");
    tokio::time::sleep(Duration::from_secs(20)).await;
    assert!(ground.has("uav1.key.next"), "nothing is thrown away early");
    ground
        .link_status("the old key", |link| is_live_under(link, &id(FIRST)))
        .await;
    assert!(ground.key("uav1.key").same_as(&key(FIRST)));
    assert!(!ground.has("uav1.key.next"));
}

/// What a stranger can say in the vehicle's name: unsigned, or a replay from long ago.
fn strangers(key: Option<[u8; 32]>) -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let text = MavMessage::STATUSTEXT(STATUSTEXT_DATA::default());
    let header = Header {
        system_id: 1,
        component_id: 1,
        incompat: if key.is_some() { INCOMPAT_SIGNED } else { 0 },
        ..Header::default()
    };
    let mut len = encode(&text, header, &mut out);
    if let Some(octets) = key {
        len = sign(&self::key(octets), 0, Stamp::new(7), &mut out, len).unwrap();
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

/// The key was changed long ago, and a power cut brings PX4's old file back.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_vehicle_that_fell_back_to_the_key_before_is_given_the_key_again() {
    let ground = Ground::new();
    ground.write_key("uav1.key", SECOND);
    ground.write_key("uav1.key.previous", FIRST);
    let _vehicle = ground.vehicle(Some(FIRST), 0).await;
    let (done, said) = ground.command(&["key", "rotate", "--wait-s", "15"]).await;
    assert!(done, "{said}");
    assert!(said.contains("has the key in force again"), "{said}");
    let new = ground.key("uav1.key");
    assert!(!new.same_as(&key(FIRST)) && !new.same_as(&key(SECOND)));
    assert!(ground.key("uav1.key.previous").same_as(&key(SECOND)));
}

/// The vehicle lost its key: who does not sign is believed only where the operator vouches for it.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_vehicle_that_lost_its_key_is_given_another_one_on_the_operators_word() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    let _vehicle = ground.vehicle(None, 0).await;
    let (done, said) = ground.command(&["key", "rotate", "--wait-s", "4"]).await;
    assert!(!done && said.contains("--vehicle-is-unsigned"), "{said}");
    let (done, said) = ground
        .command(&["key", "rotate", "--vehicle-is-unsigned", "--wait-s", "60"])
        .await;
    assert!(done, "{said}");
    assert!(!ground.key("uav1.key").same_as(&key(FIRST)));
}

/// A holder of the key has signed in the VSM's own name, a day ahead: the vehicle keeps that as our last stamp.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_thief_on_our_own_stream_is_told_and_shaken_off_by_a_restart_of_the_vehicle() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    let vehicle = ground.vehicle(Some(FIRST), 0).await;
    let header = Header {
        system_id: 245,
        component_id: 190,
        incompat: INCOMPAT_SIGNED,
        ..Header::default()
    };
    let wall = SystemTime::now().duration_since(UNIX_EPOCH).unwrap();
    let ahead = Stamp::from_unix(wall + Duration::from_secs(86_400));
    let mut out = [0; MAX_FRAME];
    let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    let length = encode(&beat, header, &mut out);
    let length = sign(&key(FIRST), 0, ahead, &mut out, length).unwrap();
    let thief = UdpSocket::bind("127.0.0.1:0").unwrap();
    let to = vehicle.address(0).unwrap();
    {
        // The vehicle answers whom it has heard first.
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

    let (done, said) = ground.command(&["key", "revoke", "--wait-s", "25"]).await;
    assert!(!done && said.contains("on our own stream"), "{said}");
    assert!(ground.key("uav1.key").same_as(&key(FIRST)) && ground.has("uav1.key.next"));
    vehicle.restart();
    let (done, said) = ground.command(&["key", "revoke", "--wait-s", "60"]).await;
    assert!(done, "{said}");
    assert!(!ground.key("uav1.key").same_as(&key(FIRST)));
    assert!(!ground.has("uav1.key.previous"), "{said}");
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
    let (done, said) = ground.command(&["status"]).await;
    assert!(
        done && said.contains("signed with key") && said.contains("signature does not fit"),
        "{said}"
    );
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_wall_clock_far_ahead_is_believed_only_when_a_person_vouches_for_it() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    let (done, said) = ground.command(&["key", "clock"]).await;
    assert!(done && said.contains("has not been used yet"), "{said}");
    let (done, said) = ground.command(&["key", "clock", "--accept"]).await;
    assert!(
        done && said.contains("the wall clock is accepted"),
        "{said}"
    );
    let (done, said) = ground.command(&["key", "clock"]).await;
    assert!(done && said.contains("nothing is stamped beyond"), "{said}");
    let days: f64 = said
        .split("the wall clock is ")
        .nth(1)
        .and_then(|rest| rest.split(' ').next())
        .and_then(|days| days.parse().ok())
        .unwrap_or_else(|| panic!("{said}"));
    assert!((0.0..0.01).contains(&days), "{said}");
    // While a bridge runs the clock is its own.
    let bridge = ground.start_bridge();
    ground
        .link_status("the bridge", |link| link["signed"] == true)
        .await;
    let (done, said) = ground.command(&["key", "clock", "--accept"]).await;
    assert!(!done, "the store is in use: {said}");
    drop(bridge);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn two_vehicles_with_one_key_are_refused_by_name() {
    let ground = Ground::new();
    let (file, link) = (ground.path().join("vsm.toml"), free_port());
    let other = format!(
        "[[vehicle]]\nid = \"1b:00:01:02\"\nlink = \"udpin:127.0.0.1:{link}\"\nsystem_id = 2\n\
         signing = {{ key_file = \"uav2.key\" }}\n[store]"
    );
    let config = fs::read_to_string(&file).unwrap();
    fs::write(&file, config.replace("[store]", &other)).unwrap();
    ground.write_key("uav1.key", FIRST);
    ground.write_key("uav2.key", FIRST);
    let (good, said) = ground.command(&["check-config", "vsm.toml"]).await;
    assert!(
        !good && said.contains("1b:00:01:01 and 1b:00:01:02"),
        "{said}"
    );
    let mut bridge = ground.start_bridge();
    let end = Instant::now() + Duration::from_secs(20);
    let status = loop {
        if let Some(status) = bridge.0.try_wait().unwrap() {
            break status;
        }
        assert!(Instant::now() < end, "it serves two vehicles under one key");
        tokio::time::sleep(Duration::from_millis(50)).await;
    };
    assert_eq!(status.code(), Some(2));
}

/// "A random one that nobody else holds": not the one that an earlier command left half-way.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_revocation_after_an_unfinished_handover_ends_with_a_key_of_its_own() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    ground.write_key("uav1.key.next", SECOND);
    let _vehicle = ground.vehicle(Some(FIRST), 0).await;
    let (done, said) = ground.command(&["key", "revoke", "--wait-s", "60"]).await;
    assert!(done, "{said}");
    let now = ground.key("uav1.key");
    assert!(
        !now.same_as(&key(FIRST)) && !now.same_as(&key(SECOND)),
        "{said}"
    );
    for part in ["previous", "next", "revoked"] {
        assert!(!ground.has(&format!("uav1.key.{part}")), "{part}: {said}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_key_from_a_file_is_the_one_that_the_vehicle_has_in_the_end() {
    let ground = Ground::new();
    ground.write_key("uav1.key.next", FIRST);
    ground.write_key("wanted.key", SECOND);
    let _vehicle = ground.vehicle(None, 0).await;
    let wanted = &["key", "provision", "--from", "wanted.key", "--wait-s", "60"];
    let (done, said) = ground.command(wanted).await;
    assert!(done, "{said}");
    assert!(ground.key("uav1.key").same_as(&key(SECOND)), "{said}");
}

/// The command was ended after the key had been sent.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_bridge_deletes_a_revoked_key_too() {
    let ground = Ground::new();
    ground.write_key("uav1.key", FIRST);
    ground.write_key("uav1.key.next", SECOND);
    fs::write(ground.path().join("uav1.key.revoked"), id(FIRST)).unwrap();
    let _vehicle = ground.vehicle(Some(SECOND), 0).await;
    let _bridge = ground.start_bridge();
    ground
        .link_status("the next key", |link| is_live_under(link, &id(SECOND)))
        .await;
    assert!(ground.key("uav1.key").same_as(&key(SECOND)));
    assert!(!ground.has("uav1.key.previous") && !ground.has("uav1.key.revoked"));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_first_key_that_was_never_sent_is_not_taken_for_one_that_the_vehicle_has() {
    let ground = Ground::new();
    let (done, said) = ground.command(&["key", "provision", "--wait-s", "1"]).await;
    assert!(!done && said.contains("nothing was sent"), "{said}");
    assert!(
        !ground.has("uav1.key") && !ground.has("uav1.key.next"),
        "{said}"
    );
    // Killed before it could send: the bridge does not begin to live under that key.
    ground.write_key("uav1.key.next", FIRST);
    let (done, said) = ground.command(&["run", "--config", "vsm.toml"]).await;
    assert!(!done && said.contains("vsm key provision"), "{said}");
    assert!(!ground.has("uav1.key"));
}

/// A bare public key in the agent's name, as anybody can send one.
fn public_key(octet: u8) -> Vec<u8> {
    let header = Header {
        system_id: 1,
        component_id: 191,
        message_id: KEY_EXCHANGE_ID,
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let len = encode_raw(header, &[octet; 32], &mut out).unwrap();
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
    assert!(!ground.has("uav1.key.next"), "by what the store says");
}

/// A named pipe as key file: the command waits there, about to read a key.
#[test]
fn core_files_are_off_before_any_command_reads_a_key() {
    let ground = Ground::new();
    let pipe = ground.path().join("uav1.key");
    let made = Command::new("mkfifo")
        .args(["-m", "600"])
        .arg(&pipe)
        .status();
    assert!(made.unwrap().success());
    for arguments in [
        &["key", "list"][..],
        &["key", "clock"],
        &["key", "provision", "--from", "uav1.key"],
        &["check-config", "vsm.toml"],
    ] {
        let mut command = Command::new(VSM);
        command.args(arguments).current_dir(ground.path());
        let command = command.stdout(Stdio::null()).stderr(Stdio::null());
        let running = Running(command.spawn().unwrap());
        let limits = format!("/proc/{}/limits", running.0.id());
        let end = Instant::now() + Duration::from_secs(10);
        loop {
            let text = fs::read_to_string(&limits).unwrap_or_default();
            let core = text
                .lines()
                .find(|line| line.starts_with("Max core file size"));
            let soft = core.and_then(|line| line.split_whitespace().nth(4));
            if soft == Some("0") {
                break;
            }
            assert!(Instant::now() < end, "{arguments:?}: {core:?}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

/// Whether a KEY_EXCHANGE frame comes to this socket within 5 s.
fn is_asked(socket: &UdpSocket) -> bool {
    let end = Instant::now() + Duration::from_secs(5);
    let mut octets = [0; 2_048];
    while Instant::now() < end {
        if let Ok(length) = socket.recv(&mut octets)
            && FrameView::parse(&octets[..length])
                .is_ok_and(|frame| frame.header().message_id == KEY_EXCHANGE_ID)
        {
            return true;
        }
    }
    false
}

#[test]
fn a_pairing_goes_on_with_the_agent_whoever_has_spoken_before_it() {
    let ground = Ground::new();
    let mut command = Command::new(VSM);
    command
        .args(["pair", "--wait-s", "40"])
        .current_dir(ground.path());
    let command = command.stdout(Stdio::null()).stderr(Stdio::null());
    let _pairing = Running(command.spawn().unwrap());
    let socket = || {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(("127.0.0.1", ground.link)).unwrap();
        let wait = Some(Duration::from_millis(100));
        socket.set_read_timeout(wait).unwrap();
        socket
    };
    let (stranger, agent) = (socket(), socket());
    let header = Header {
        system_id: 1,
        component_id: 1,
        ..Header::default()
    };
    let mut beat = [0; MAX_FRAME];
    let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    let length = encode(&message, header, &mut beat);
    let beat = &beat[..length];
    // Until the command listens, and has taken the stranger for the vehicle.
    let end = Instant::now() + Duration::from_secs(20);
    loop {
        let _ = stranger.send(beat);
        let mut octets = [0; 2_048];
        if stranger.recv(&mut octets).is_ok() {
            break;
        }
        assert!(Instant::now() < end, "nobody is asked");
    }
    // Step 0 of suite 2, to the VSM.
    let mut please = [0; 42];
    please[32] = 7;
    (please[36], please[38], please[40], please[41]) = (1, 2, 245, 190);
    let header = Header {
        system_id: 1,
        component_id: 191,
        message_id: KEY_EXCHANGE_ID,
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let length = encode_raw(header, &please, &mut out).unwrap();
    agent.send(&out[..length]).unwrap();
    // The stranger goes on speaking.
    std::thread::sleep(Duration::from_millis(100));
    stranger.send(beat).unwrap();
    assert!(is_asked(&agent));
}
