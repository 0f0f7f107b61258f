//! `vsm doctor`: each fault that it knows is made between real sockets, and its line is seen; a bridge without a fault has none.

use std::fs;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener, UdpSocket};
use std::os::unix::fs::PermissionsExt as _;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use kit::clock::wall;
use kit::process::{Running, free_tcp_port, free_udp_port, program, write_key};
use kit::tools;
use mavlink_link::dialect::{ATTITUDE_DATA, MavMessage};
use mavlink_link::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::signing::{SigningKey, Stamp, sign};
use serde_json::{Value, json};
use stanag_msgs::messages::Heartbeat;
use stanag_msgs::wrapper::ChecksumStyle;
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, TimeStamp, json as dli_json};
use tempfile::TempDir;
use vsm::shell::disk::FileDisk;

const VSM: Id = Id(0x1b00_0001);

/// A folder with a configuration, and the bridge that runs on it.
struct Place {
    folder: TempDir,
    dli: u16,
    bridge: Option<Running>,
}

impl Place {
    /// `dli`: further keys of `[dli]`; `rest`: other tables.
    fn new(dli: &str, rest: &str) -> Place {
        let place = Place {
            folder: tempfile::tempdir().unwrap(),
            dli: free_udp_port(),
            bridge: None,
        };
        let text = format!(
            "[dli]\nvsm_id = \"{VSM}\"\nlisten = \"0.0.0.0:{}\"\n{dli}\n{rest}\n[store]\ndir = \"state\"\n",
            place.dli
        );
        fs::write(place.path("vsm.toml"), text).unwrap();
        place
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn start(&mut self) {
        let config = self.path("vsm.toml");
        let mut bridge = Running::start(&program("vsm"), ["run".as_ref(), config.as_os_str()]);
        bridge.wait_for("ready", Duration::from_secs(30));
        self.bridge = Some(bridge);
    }

    fn printed(&self) -> String {
        self.bridge
            .as_ref()
            .map_or_else(String::new, Running::output)
    }

    fn command(&self, words: &[&str]) -> (Option<i32>, String) {
        let output = Command::new(program("vsm"))
            .args(words)
            .current_dir(self.folder.path())
            .output()
            .unwrap();
        let printed = [output.stdout, output.stderr].concat();
        (
            output.status.code(),
            String::from_utf8_lossy(&printed).into_owned(),
        )
    }

    /// The findings as (code, line), once these codes are all among them.
    fn findings(&self, expected: &[&str]) -> Vec<(String, String)> {
        let end = Instant::now() + Duration::from_secs(45);
        loop {
            let output = Command::new(program("vsm"))
                .args(["doctor", "--json", "vsm.toml"])
                .current_dir(self.folder.path())
                .output()
                .unwrap();
            let report: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|fault| {
                panic!("{fault}: {}", String::from_utf8_lossy(&output.stderr))
            });
            let text = |one: &Value, key: &str| one[key].as_str().unwrap().to_owned();
            let found = report["findings"].as_array().unwrap().iter();
            let found: Vec<_> = found
                .map(|one| {
                    let line = format!("{}; {}", text(one, "cause"), text(one, "cure"));
                    (text(one, "code"), line)
                })
                .collect();
            assert_eq!(
                output.status.code(),
                Some(i32::from(!found.is_empty())),
                "{report:#}"
            );
            let there = |code: &&str| found.iter().any(|(known, _)| known == *code);
            if expected.iter().all(there) {
                return found;
            }
            assert!(
                Instant::now() < end,
                "expected {expected:?}: {found:#?}\n{}",
                self.printed()
            );
        }
    }
}

/// Does the same again and again until it is dropped.
struct Repeated(Arc<AtomicBool>, Option<JoinHandle<()>>);

impl Repeated {
    fn start(mut all: Vec<Box<dyn FnMut(u64) + Send>>) -> Repeated {
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let thread = thread::spawn(move || {
            let mut n = 0;
            while !stopped.load(Ordering::Relaxed) {
                all.iter_mut().for_each(|one| one(n));
                n += 1;
                thread::sleep(Duration::from_millis(300));
            }
        });
        Repeated(stop, Some(thread))
    }
}

impl Drop for Repeated {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
        let _ = self.1.take().map(JoinHandle::join);
    }
}

/// A frame of an autopilot, signed where there is a key.
fn frame(system_id: u8, signed: Option<([u8; 32], Stamp)>) -> Vec<u8> {
    let header = Header {
        system_id,
        component_id: 1,
        incompat: if signed.is_some() { INCOMPAT_SIGNED } else { 0 },
        ..Header::default()
    };
    let mut out = [0; MAX_FRAME];
    let message = MavMessage::ATTITUDE(ATTITUDE_DATA::default());
    let mut length = encode(&message, header, &mut out);
    if let Some((key, stamp)) = signed {
        length = sign(&SigningKey::new(key).unwrap(), 0, stamp, &mut out, length).unwrap();
    }
    out[..length].to_vec()
}

/// A MAVLink 1 heartbeat of an autopilot, as pymavlink packs it.
const MAVLINK_1: [u8; 17] = [0xfe, 9, 0, 1, 1, 0, 0, 0, 0, 0, 2, 12, 81, 4, 3, 0x81, 0xb7];

/// One vehicle with a link of its own for each of these keys of `[[vehicle]]`.
fn vehicles(keys: &[&str]) -> (String, Vec<u16>) {
    let ports: Vec<u16> = keys.iter().map(|_| free_udp_port()).collect();
    let mut text = String::new();
    for ((keys, port), n) in keys.iter().zip(&ports).zip(1..) {
        let link = format!("link = \"udpin:127.0.0.1:{port}\"\n");
        let link = if keys.contains("link =") { "" } else { &link };
        let signing = format!("signing = {{ key_file = \"{n}.key\" }}\n");
        let signing = if keys.contains("signing") {
            ""
        } else {
            &signing
        };
        let system = if keys.contains("system_id") {
            ""
        } else {
            "system_id = 1\n"
        };
        text += &format!("[[vehicle]]\nid = \"1b:00:01:0{n:x}\"\n{link}{signing}{system}{keys}\n");
    }
    (text, ports)
}

#[test]
fn each_fault_of_a_vehicles_link_has_its_line() {
    let away = UdpSocket::bind("127.0.0.1:0").unwrap();
    away.set_nonblocking(true).unwrap();
    let to_away = format!(
        "link = \"udpout:{}\"\nsigning = \"off\"",
        away.local_addr().unwrap()
    );
    let (text, ports) = vehicles(&[
        "", // signs with another key
        "", // does not sign
        "system_id = 7",
        "", // nothing arrives
        "", // MAVLink 1
        "", // noise
        "", // stale
        "", // ahead
        "vehicle_link_id = 5",
        "", // answers nothing
        &to_away,
    ]);
    let mut place = Place::new("", &text);
    for n in 1..=10 {
        write_key(&place.path(&format!("{n}.key")), &[n; 32]);
    }
    place.start();

    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let send = move |to: u16, bytes: &[u8]| drop(socket.send_to(bytes, ("127.0.0.1", to)));
    let began = wall();
    let other = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut bridge = None;
    let _faults = Repeated::start(vec![
        Box::new(move |n| {
            let now = Stamp::from_unix(wall());
            send(ports[0], &frame(1, Some(([0x77; 32], now))));
            send(ports[1], &frame(1, None));
            send(ports[2], &frame(1, Some(([3; 32], now))));
            send(ports[4], &MAVLINK_1);
            send(ports[5], b"$GPGGA,123519,4807.038,N");
            send(ports[6], &frame(1, Some(([7; 32], Stamp::new(7 + n)))));
            let tomorrow = Stamp::from_unix(wall() + Duration::from_secs(86_400));
            send(ports[7], &frame(1, Some(([8; 32], tomorrow))));
            send(ports[8], &frame(1, Some(([9; 32], now))));
            // Rising, but not with the stamps that the bridge sends: it accepts them, and sees that none of its own arrives.
            let soon = began + Duration::from_secs(600) + Duration::from_micros(10 * n);
            send(
                ports[9],
                &frame(1, Some(([10; 32], Stamp::from_unix(soon)))),
            );
        }),
        Box::new(move |_| {
            if let Ok((_, from)) = away.recv_from(&mut [0; 512]) {
                bridge = Some(from);
            }
            if let Some(bridge) = bridge {
                other.send_to(&frame(1, None), bridge).unwrap();
            }
        }),
    ]);

    let expected = [
        (
            "mavlink-other-key",
            "vehicle 1b:00:01:01: MAVLink system 1 signs with another key than",
        ),
        (
            "mavlink-unsigned",
            "vehicle 1b:00:01:02: MAVLink system 1 sends unsigned",
        ),
        (
            "mavlink-other-system",
            "system_id = 1 for this vehicle, or MAV_SYS_ID = 7",
        ),
        (
            "mavlink-none",
            "vehicle 1b:00:01:04: no MAVLink at all arrives",
        ),
        ("mavlink-version", "MAV_PROTO_VER = 2"),
        ("mavlink-unreadable", "vehicle 1b:00:01:06: bytes arrive"),
        (
            "mavlink-stale",
            "vehicle 1b:00:01:07: frames of MAVLink system 1 verify",
        ),
        ("mavlink-ahead", "stamped over an hour ahead"),
        (
            "mavlink-link-id",
            "vehicle 1b:00:01:09: MAVLink system 1 signs with another link id",
        ),
        (
            "mavlink-unanswered",
            "is received, but has received nothing",
        ),
        (
            "mavlink-two-senders",
            "vehicle 1b:00:01:0b: frames of MAVLink system 1 arrive from another address",
        ),
    ];
    let codes = expected.map(|(code, _)| code);
    let found = place.findings(&codes);
    assert_eq!(found.len(), expected.len(), "{found:#?}");
    let printed = place.printed();
    for (code, words) in expected {
        let (_, line) = found.iter().find(|(known, _)| known == code).unwrap();
        assert!(line.contains(words), "{code}: {line}");
        // Once in the log, as a warning.
        let logged: Vec<_> = printed
            .lines()
            .filter(|logged| logged.contains(line.trim_start_matches("vehicle ")))
            .collect();
        assert_eq!(logged.len(), 1, "{code}: {line}\n{printed}");
        assert!(logged[0].contains("WARN"), "{}", logged[0]);
    }

    // The status shows what was verified, and not what is configured.
    let (_, status) = place.command(&["status"]);
    let of = |id: &str| {
        let rest = status.split(id).last().unwrap();
        rest.split("\nvehicle").next().unwrap().to_owned()
    };
    assert!(
        of("vehicle 1b:00:01:01").contains("NOT VERIFIED"),
        "{status}"
    );
    let arrives = "no frame has verified yet; what arrives: signed with another key";
    assert!(of("vehicle 1b:00:01:01").contains(arrives), "{status}");
    assert!(
        of("vehicle 1b:00:01:02").contains("what arrives: not signed"),
        "{status}"
    );
    assert!(
        of("vehicle 1b:00:01:04").contains("what arrives: nothing"),
        "{status}"
    );
    assert!(
        of("vehicle 1b:00:01:0a").contains("last verified frame 0."),
        "{status}"
    );
    // Of the eleven only the tenth.
    assert_eq!(status.matches("signed with key").count(), 1, "{status}");
    assert!(
        of("vehicle 1b:00:01:0a").contains("signed with key"),
        "{status}"
    );
    let (_, json) = place.command(&["status", "--json"]);
    let json: Value = serde_json::from_str(json.trim()).unwrap();
    let link = &json["vehicles"][0]["link"];
    assert_eq!(link["frames"]["good_frames"], 0, "{link:#}");
    assert!(
        link["frames"]["bad_signature"].as_u64() > Some(10),
        "{link:#}"
    );
    assert_eq!(link["verified_s"], Value::Null, "{link:#}");
}

/// A heartbeat of a CUCS.
fn heartbeat(source: Id, to: Id, checksum: ChecksumStyle, ahead: i64) -> Vec<u8> {
    let stamp = TimeStamp::from_unix_ms((wall().as_millis() as i64 + ahead) as u64);
    let message = Message::from(Heartbeat {
        time_stamp: Some(stamp),
    });
    let mut out = [0; MAX_DATAGRAM];
    let envelope = Envelope::new(source, to).summed(checksum);
    let length = message.encode(&envelope, &mut out).unwrap();
    out[..length].to_vec()
}

/// The question of a CUCS of Edition 2.5 who is there.
fn question_25(source: Id) -> Vec<u8> {
    let fields = json!({
        "Time Stamp": wall().as_secs_f64(), "Vehicle ID": -1, "CUCS ID": source.0 as i32, "VSM ID": -1,
    });
    let message = json!({ "id": 1, "idd": "2.5", "instance": 1, "fields": fields });
    dli_json::encode(&message, true).unwrap()
}

#[test]
fn each_fault_of_the_dli_has_its_line() {
    let listed =
        |id: &str, address: &str| format!("[[cucs]]\nid = \"{id}\"\nloi = [2]\n{address}\n");
    let rest = [
        listed("1b:00:00:a1", "address = \"127.0.0.99\""),
        listed("1b:00:00:a2", ""),
        listed("1b:00:00:a3", "address = \"127.0.0.5\""),
        listed("1b:00:00:a4", "address = \"127.0.0.11\""),
        listed("1b:00:00:a5", "edition = \"4\""),
    ]
    .concat();
    let mut place = Place::new("", &rest);
    place.start();
    let to = SocketAddr::from(([127, 0, 0, 1], place.dli));
    let (stranger, elsewhere, lost, slow, garbled) = (
        Id(0x1b00_00b7),
        Id(0x1b00_00a1),
        Id(0x1b00_00a2),
        Id(0x1b00_00a3),
        Id(0x1b00_00a4),
    );
    let plain = move |source, at, ahead| heartbeat(source, at, ChecksumStyle::None, ahead);
    // Each from an address of its own.
    let faults: [Box<dyn Fn() -> Vec<u8> + Send>; 12] = [
        Box::new(move || plain(stranger, VSM, 0)),
        Box::new(move || plain(elsewhere, VSM, 0)),
        Box::new(move || plain(lost, Id(0x1b00_0199), 0)),
        Box::new(move || plain(slow, VSM, -7_200_000)),
        Box::new(move || {
            let mut bytes = heartbeat(lost, VSM, ChecksumStyle::Crc32, 0);
            let at = bytes.len() - 4;
            bytes[at..].reverse();
            bytes
        }),
        Box::new(move || {
            let mut bytes = plain(lost, VSM, 0);
            bytes[14] = 20;
            bytes
        }),
        Box::new(|| [&b"2.5\0\0\0\0\0\0\0"[..], &[0; 40]].concat()),
        Box::new(move || {
            let mut bytes = plain(lost, VSM, 0);
            for (at, length) in [(2, 2), (4, 4), (8, 4), (12, 2), (14, 2)] {
                bytes[at..at + length].reverse();
            }
            bytes
        }),
        Box::new(|| frame(1, None)),
        Box::new(move || {
            let mut bytes = plain(garbled, VSM, 0);
            bytes[16] = 0xff;
            bytes
        }),
        Box::new(|| question_25(Id(0x1b00_00b8))),
        Box::new(|| question_25(Id(0x1b00_00a5))),
    ];
    let mut senders: Vec<Box<dyn FnMut(u64) + Send>> = vec![];
    for (fault, n) in faults.into_iter().zip(2..) {
        let socket = UdpSocket::bind((Ipv4Addr::new(127, 0, 0, n), 0)).unwrap();
        senders.push(Box::new(move |_| drop(socket.send_to(&fault(), to))));
    }
    let _faults = Repeated::start(senders);
    let expected = [
        (
            "cucs-not-listed",
            "CUCS 1b:00:00:b7 sends from 127.0.0.2, but is not listed",
        ),
        (
            "cucs-address",
            "CUCS 1b:00:00:a1 sends from 127.0.0.3, but its address is configured as 127.0.0.99",
        ),
        ("cucs-misaddressed", "CUCS 1b:00:00:a2 sends to 1b:00:01:99"),
        ("cucs-clock", "CUCS 1b:00:00:a3 are over 2 h behind"),
        (
            "dli-checksum",
            "from 127.0.0.6 have a wrong checksum of style 3: its bytes are in reverse order",
        ),
        ("dli-edition", "from 127.0.0.7 are of IDD version 20"),
        (
            "dli-edition",
            "from 127.0.0.8 have the wrapper of Edition 2.5",
        ),
        (
            "dli-byte-order",
            "from 127.0.0.9 are in little-endian byte order",
        ),
        ("dli-unreadable", "from 127.0.0.10 are MAVLink"),
        (
            "dli-undecodable",
            "CUCS 1b:00:00:a4 sends message 16002 (Heartbeat) from 127.0.0.11, and it is dropped: message 16002: presence vector 0xff has \
             bits beyond 0x1",
        ),
        (
            "cucs-not-listed",
            "CUCS 1b:00:00:b8 sends from 127.0.0.12, but is not listed; to let it in, add [[cucs]] with id = \"1b:00:00:b8\" and the \
             LOI that it may have, such as loi = [2]; as it speaks now, edition = \"2.5\" would fit, and needs no line",
        ),
        (
            "dli-edition",
            "CUCS 1b:00:00:a5 sends in Edition 2.5 from 127.0.0.13, but is configured with edition = \"4\"; if it speaks that, set \
             edition = \"2.5\" in its [[cucs]], or leave the key out",
        ),
    ];
    let codes = expected.map(|(code, _)| code);
    let found = place.findings(&codes);
    for (code, words) in expected {
        let one = found
            .iter()
            .find(|(known, line)| known == code && line.contains(words));
        assert!(one.is_some(), "{code} {words}: {found:#?}");
    }
    assert_eq!(found.len(), expected.len(), "{found:#?}");
    let printed = place.printed();
    let knocks = printed.lines().filter(|line| line.contains("1b:00:00:b7"));
    let knocks: Vec<_> = knocks.collect();
    assert!(knocks.len() == 1 && knocks[0].contains("WARN"), "{printed}");
    // It listens beyond loopback and nobody is guarded: said at the start, and in the status for who has not seen that.
    let unguarded = "CUCSs are not authenticated without a guard";
    let warned = |line: &str| line.contains("WARN") && line.contains(unguarded);
    assert!(printed.lines().any(warned), "{printed}");
    let (_, status) = place.command(&["status", "vsm.toml"]);
    assert!(status.contains(unguarded), "{status}");
}

#[test]
fn a_healthy_bridge_has_no_finding_and_nothing_reads_refused() {
    let (vehicle, ports) = vehicles(&[""]);
    let cucs = "[[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2, 3, 4, 5]\naddress = \"127.0.0.1\"\n";
    let mut place = Place::new("", &[&vehicle, cucs].concat());
    write_key(&place.path("1.key"), &[1; 32]);
    place.start();
    let link = format!("udpout:127.0.0.1:{}", ports[0]);
    let key = place.path("1.key").display().to_string();
    let px4 = program("px4-sim");
    let _vehicle = Running::start(&px4, ["--link", &link, "--key-file", &key]);
    let station = UdpSocket::bind("127.0.0.1:0").unwrap();
    let to = SocketAddr::from(([127, 0, 0, 1], place.dli));
    let _station = Repeated::start(vec![Box::new(move |_| {
        let beat = heartbeat(Id(0x1b00_00a0), VSM, ChecksumStyle::None, 0);
        drop(station.send_to(&beat, to));
    })]);
    // From the first moment on.
    let end = Instant::now() + Duration::from_secs(15);
    let mut verified = false;
    while Instant::now() < end {
        let (_, status) = place.command(&["status"]);
        assert!(!status.contains("refused"), "{status}");
        assert!(!status.contains("FINDING"), "{status}");
        verified |= status.contains("last verified frame 0.") && status.contains("signed with key");
        thread::sleep(Duration::from_millis(500));
    }
    assert!(verified, "{}", place.command(&["status"]).1);
    let (code, printed) = place.command(&["doctor"]);
    assert!(
        code == Some(0) && printed.contains("nothing found"),
        "{printed}"
    );
    // It flies on without its key file, and could not start again.
    fs::remove_file(place.path("1.key")).unwrap();
    let (code, printed) = place.command(&["doctor"]);
    let named = printed.contains("vehicle 1b:00:01:01: ") && printed.contains("a key is lost");
    assert!(code == Some(1) && named, "{printed}");
}

/// The bridge works on with the keys that it has in memory: it has to look at the files, as doctor does.
#[test]
fn a_running_bridge_names_a_key_file_that_is_gone_until_it_is_back() {
    let (vehicles, _) = vehicles(&["", ""]);
    let mut place = Place::new("", &vehicles);
    for n in 1..=2 {
        write_key(&place.path(&format!("{n}.key")), &[n; 32]);
    }
    place.start();
    fs::remove_file(place.path("2.key")).unwrap();
    let words = "vehicle 1b:00:01:02: there is no key file";
    let bridge = place.bridge.as_mut().unwrap();
    bridge.wait_for(words, Duration::from_secs(40));
    let printed = place.printed();
    let logged: Vec<_> = printed
        .lines()
        .filter(|line| line.contains(words))
        .collect();
    assert!(logged.len() == 1 && logged[0].contains("WARN"), "{printed}");
    let finding = format!("FINDING: {words}");
    let (_, status) = place.command(&["status"]);
    assert!(status.contains(&finding), "{status}");
    assert!(
        !status.contains("1b:00:01:01: there is no key file"),
        "{status}"
    );

    write_key(&place.path("2.key"), &[2; 32]);
    let bridge = place.bridge.as_mut().unwrap();
    bridge.wait_for(&format!("cleared: {words}"), Duration::from_secs(40));
    let (_, status) = place.command(&["status"]);
    assert!(!status.contains(&finding), "{status}");
}

/// What a person asks right after it: two looks, ten seconds apart, found it.
#[test]
fn a_guard_key_that_was_revoked_is_named_within_seconds() {
    let guarded = "[[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2]\nguard = { key_file = \"a0.key\" }\n";
    let mut place = Place::new("", guarded);
    write_key(&place.path("a0.key"), &[7; 32]);
    place.start();
    let (code, printed) = place.command(&["guard", "revoke", "a0.key"]);
    assert_eq!(code, Some(0), "{printed}");
    let revoked = Instant::now();
    let words = "which is not in force here: it was rotated or revoked since";
    loop {
        let (_, status) = place.command(&["status"]);
        if status.contains(words) {
            break;
        }
        assert!(revoked.elapsed() < Duration::from_secs(9), "{status}");
        thread::sleep(Duration::from_millis(100));
    }
}

/// The log has named a silence, or bytes that are no frame: doctor must not find nothing then, whenever it is asked.
#[test]
fn doctor_agrees_with_the_log() {
    let (vehicles, ports) = vehicles(&["", ""]);
    let mut place = Place::new("", &vehicles);
    for n in 1..=2 {
        write_key(&place.path(&format!("{n}.key")), &[n; 32]);
    }
    place.start();
    let link = format!("udpout:127.0.0.1:{}", ports[0]);
    let key = place.path("1.key").display().to_string();
    let px4 = program("px4-sim");
    let mut vehicle = Running::start(&px4, ["--link", &link, "--key-file", &key]);
    let second = UdpSocket::bind("127.0.0.1:0").unwrap();
    let bridge = place.bridge.as_mut().unwrap();
    bridge.wait_for("the link is live", Duration::from_secs(20));
    // It has not waited long enough to miss anything before that.
    thread::sleep(Duration::from_secs(12));

    vehicle.kill();
    for _ in 0..3 {
        second
            .send_to(b"$GPGGA,123519", ("127.0.0.1", ports[1]))
            .unwrap();
        thread::sleep(Duration::from_millis(300));
    }
    let bridge = place.bridge.as_mut().unwrap();
    bridge.wait_for("bytes arrive on", Duration::from_secs(10));
    bridge.wait_for(
        "no data from the vehicle: state unknown",
        Duration::from_secs(10),
    );
    let end = Instant::now() + Duration::from_secs(12);
    while Instant::now() < end {
        let (code, printed) = place.command(&["doctor"]);
        assert_eq!(code, Some(1), "{printed}");
        for id in ["1b:00:01:01", "1b:00:01:02"] {
            let named = printed
                .lines()
                .any(|line| line.starts_with(&format!("vehicle {id}: ")));
            assert!(named, "{id}: {printed}\n{}", place.printed());
        }
        assert!(printed.contains("bytes arrive on"), "{printed}");
        thread::sleep(Duration::from_millis(400));
    }
}

#[test]
fn before_a_start_it_looks_at_ports_keys_store_and_interface() {
    let (vehicle, ports) = vehicles(&[""]);
    let page = free_tcp_port();
    let http = format!("[http]\nlisten = \"127.0.0.1:{page}\"\n");
    let group = "multicast = \"225.200.77.2:51772\"\ninterface = \"203.0.113.9\"";
    let place = Place::new(group, &[&vehicle, &http[..]].concat());
    write_key(&place.path("1.key"), &[1; 32]);
    let open = fs::Permissions::from_mode(0o644);
    fs::set_permissions(place.path("1.key"), open).unwrap();
    let _link = UdpSocket::bind(("127.0.0.1", ports[0])).unwrap();
    let _page = TcpListener::bind(("127.0.0.1", page)).unwrap();
    let _dli = UdpSocket::bind(("0.0.0.0", place.dli)).unwrap();
    let found = place.findings(&["interface", "key-file", "port"]);
    let lines: Vec<_> = found.iter().map(|(_, line)| &line[..]).collect();
    for words in [
        "dli.interface = \"203.0.113.9\" is no interface of this computer; set it to one of lo (127.0.0.1)",
        "can be read by others",
        "dli.listen = ",
        "http.listen = ",
        "vehicle.link = \"udpin:127.0.0.1",
    ] {
        assert!(
            lines.iter().any(|line| line.contains(words)),
            "{words}: {lines:#?}"
        );
    }
    assert_eq!(found.len(), 5, "{found:#?}");
    let (code, printed) = place.command(&["doctor"]);
    assert_eq!(code, Some(1), "{printed}");
    assert!(
        printed.contains("no bridge answers") && printed.contains("5 faults"),
        "{printed}"
    );
    assert!(
        !place.path("state").exists(),
        "looking leaves nothing behind"
    );
}

/// What a start ends with.
struct Ended {
    name: &'static str,
    /// Further tables of the configuration.
    tables: String,
    /// What is done before.
    before: fn(&Place),
    /// The code of its finding.
    code: &'static str,
    /// What both doctor and the start print.
    words: &'static [&'static str],
}

fn ended(
    name: &'static str,
    tables: String,
    before: fn(&Place),
    code: &'static str,
    words: &'static [&'static str],
) -> Ended {
    Ended {
        name,
        tables,
        before,
        code,
        words,
    }
}

/// Doctor must not find nothing where `vsm run` does not start.
#[test]
fn what_ends_a_start_is_found_before_it() {
    let nothing: fn(&Place) = |_| {};
    let vehicle = |keys: &str| vehicles(&[keys]).0;
    let access = "[access]\nlist = \"access.list\"\nkey_file = \"access.key\"\n";
    let guarded = "[[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2]\nguard = { key_file = \"a0.key\" }\n";
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let taken = socket.local_addr().unwrap();
    let page = format!("[http]\nlisten = \"127.0.0.1:{}\"\n", free_tcp_port());
    let all = [
        ended(
            "a zeroized store",
            String::new(),
            |place| {
                let (code, printed) = place.command(&["zeroize", "--yes", "vsm.toml"]);
                assert_eq!(code, Some(0), "{printed}");
            },
            "zeroized",
            &["zeroize"],
        ),
        ended(
            "the port of a ground station",
            format!("[[forward]]\nname = \"qgc\"\nlink = \"udpin:{taken}\"\n"),
            nothing,
            "port",
            &["forward.link"],
        ),
        ended(
            "a device that is no serial line",
            vehicle("link = \"serial:/dev/null:57600\"\nsigning = \"off\""),
            nothing,
            "port",
            &["vehicle.link", "/dev/null"],
        ),
        ended(
            "a device that is not there",
            vehicle("link = \"serial:/dev/no-such-line:57600\"\nsigning = \"off\""),
            nothing,
            "port",
            &["vehicle.link", "/dev/no-such-line"],
        ),
        ended(
            "a file in the place of the recordings",
            "[record]\ndir = \"records\"\n".to_owned(),
            |place| fs::write(place.path("records"), "").unwrap(),
            "file",
            &["[record] dir"],
        ),
        ended(
            "a record that cannot be read",
            String::new(),
            |place| {
                drop(FileDisk::open(&place.path("state")).unwrap());
                fs::write(place.path("state/audit.key"), "no key").unwrap();
            },
            "start",
            &["audit.key"],
        ),
        ended(
            "a folder in the way of a record",
            String::new(),
            |place| {
                drop(FileDisk::open(&place.path("state")).unwrap());
                fs::create_dir(place.path("state/authority-1b000101.json.new")).unwrap();
            },
            "store",
            &[
                "authority-1b000101.json.new is a folder",
                "remove the folder",
            ],
        ),
        ended(
            "a folder in the way of a key",
            vehicle(""),
            |place| {
                write_key(&place.path("1.key"), &[1; 32]);
                fs::create_dir(place.path("1.key.next.new")).unwrap();
            },
            "key-file",
            &["1.key.next.new is a folder", "remove the folder"],
        ),
        ended(
            "a path that is too long for a socket",
            String::new(),
            |place| {
                let text = fs::read_to_string(place.path("vsm.toml")).unwrap();
                let long = format!("dir = \"{}\"", "s".repeat(120));
                fs::write(
                    place.path("vsm.toml"),
                    text.replace("dir = \"state\"", &long),
                )
                .unwrap();
            },
            "start",
            &["status socket"],
        ),
        ended(
            "no access list",
            access.to_owned(),
            |place| write_key(&place.path("access.key"), &[1; 32]),
            "access-list",
            &["access.list"],
        ),
        ended(
            "a guard key that is a vehicle's",
            vehicle("") + guarded,
            |place| {
                for name in ["1.key", "a0.key"] {
                    write_key(&place.path(name), &[1; 32]);
                }
            },
            "key-file",
            &["has the guard key"],
        ),
        ended(
            "a folder of keys that everybody may write",
            vehicle("signing = { key_file = \"keys/1.key\" }"),
            |place| {
                fs::create_dir(place.path("keys")).unwrap();
                write_key(&place.path("keys/1.key"), &[1; 32]);
                let open = fs::Permissions::from_mode(0o777);
                fs::set_permissions(place.path("keys"), open).unwrap();
            },
            "key-file",
            &["written by others"],
        ),
        ended(
            "a pipe in the place of a key",
            vehicle(""),
            |place| {
                let mut made = Command::new("mkfifo");
                let made = made.args(["-m", "600"]).arg(place.path("1.key")).status();
                assert!(made.unwrap().success());
            },
            "key-file",
            &["not a regular file"],
        ),
        ended(
            "an address of another computer",
            String::new(),
            |place| {
                let text = fs::read_to_string(place.path("vsm.toml")).unwrap();
                fs::write(
                    place.path("vsm.toml"),
                    text.replace("0.0.0.0", "203.0.113.9"),
                )
                .unwrap();
            },
            "port",
            &["dli.listen", "203.0.113.9"],
        ),
        ended(
            "no file of the map's pictures",
            page + "[web]\ntiles = \"map.pmtiles\"\n",
            nothing,
            "file",
            &["map.pmtiles"],
        ),
    ];
    for one in all {
        let Ended {
            name,
            tables,
            before,
            code,
            words,
        } = one;
        let place = Place::new("", &tables);
        before(&place);
        let found = place.findings(&[code]);
        assert_eq!(found.len(), 1, "{name}: {found:#?}");
        let mut run = Command::new("timeout");
        let run = run.arg("60").arg(program("vsm")).args(["run", "vsm.toml"]);
        let output = run.current_dir(place.folder.path()).output().unwrap();
        let ended = String::from_utf8_lossy(&output.stderr).into_owned();
        let status = output.status.code();
        assert!(matches!(status, Some(1..=3)), "{name}: {status:?}: {ended}");
        for words in words {
            let both = ended.contains(words) && found[0].1.contains(words);
            assert!(both, "{name}: {words}: {found:#?}\n{ended}");
        }
    }
}

#[test]
fn a_folder_in_the_way_of_a_file_is_named_by_check_config_too() {
    let (vehicles, _) = vehicles(&[""]);
    for (folder, key) in [
        ("state/authority-1b000101.json.new", "store.dir"),
        ("1.key.next.new", "vehicle.signing.key_file"),
    ] {
        let place = Place::new("", &vehicles);
        write_key(&place.path("1.key"), &[1; 32]);
        drop(FileDisk::open(&place.path("state")).unwrap());
        let (code, printed) = place.command(&["check-config", "vsm.toml"]);
        assert_eq!(code, Some(0), "{printed}");
        fs::create_dir(place.path(folder)).unwrap();
        let (code, printed) = place.command(&["check-config", "vsm.toml"]);
        assert_eq!(code, Some(2), "{printed}");
        for words in [key, folder, "is a folder", "remove the folder"] {
            assert!(printed.contains(words), "{words}: {printed}");
        }
    }
}

#[test]
fn an_address_of_another_computer_has_a_cure_that_fits() {
    let place = Place::new("", "");
    let text = fs::read_to_string(place.path("vsm.toml")).unwrap();
    fs::write(
        place.path("vsm.toml"),
        text.replace("0.0.0.0", "203.0.113.9"),
    )
    .unwrap();
    let (code, printed) = place.command(&["doctor"]);
    assert_eq!(code, Some(1), "{printed}");
    assert!(
        printed.contains("name an address of this computer") && printed.contains("[port]"),
        "{printed}"
    );
    assert!(!printed.contains("stop the program"), "{printed}");
}

/// In a network of its own without any route: this test starts itself there.
#[test]
fn a_group_without_a_route_is_found_before_a_start() {
    const INSIDE: &str = "VSM_TEST_NO_ROUTE";
    if std::env::var_os(INSIDE).is_none() {
        let mut probe = Command::new("unshare");
        probe.args(["-rn", "sh", "-c", "ip link set lo up"]);
        if !tools::works("a network namespace (unshare -rn)", &mut probe) {
            return;
        }
        let test = std::env::current_exe().unwrap();
        let script = format!(
            "ip link set lo up && exec '{}' a_group_without_a_route_is_found --nocapture",
            test.display()
        );
        let output = Command::new("unshare")
            .args(["-rn", "sh", "-c", &script])
            .env(INSIDE, "1")
            .output()
            .unwrap();
        let printed = String::from_utf8_lossy(&output.stdout).into_owned();
        let faults = String::from_utf8_lossy(&output.stderr);
        assert!(
            output.status.success() && printed.contains("1 passed"),
            "{printed}{faults}"
        );
        return;
    }
    let place = Place::new("multicast = \"225.200.77.4:51774\"", "");
    let found = place.findings(&["port"]);
    assert!(
        found.len() == 1
            && found[0]
                .1
                .contains("dli.multicast = \"225.200.77.4:51774\""),
        "{found:#?}"
    );
}

#[test]
fn another_process_on_the_store_is_named() {
    let place = Place::new("", "");
    let held = FileDisk::open(&place.path("state")).unwrap();
    let found = place.findings(&["store-in-use"]);
    assert_eq!(found.len(), 1, "{found:#?}");
    drop(held);
    assert_eq!(place.findings(&[]), []);

    // A bridge that was started from another file answers.
    let mut place = place;
    place.start();
    let text = fs::read_to_string(place.path("vsm.toml")).unwrap();
    fs::write(
        place.path("vsm.toml"),
        text.replace("1b:00:00:01", "1b:00:00:02"),
    )
    .unwrap();
    let found = place.findings(&["other-vsm"]);
    assert!(
        found[0]
            .1
            .contains("VSM 1b:00:00:01 answers, and 1b:00:00:02 is configured"),
        "{found:#?}"
    );
}

/// In a network of its own, with two interfaces: this test starts itself there.
#[test]
fn a_group_that_was_joined_on_the_wrong_interface_is_named() {
    const INSIDE: &str = "VSM_TEST_TWO_INTERFACES";
    if std::env::var_os(INSIDE).is_none() {
        let set_up = "ip link set lo up multicast on && ip link add other type veth peer name far && ip link set far up && \
                      ip addr add 10.77.0.1/24 dev other && ip link set other up multicast on";
        let mut probe = Command::new("unshare");
        probe.args(["-rn", "sh", "-c", set_up]);
        if !tools::works(
            "a network namespace (unshare -rn) with a pair of interfaces (veth)",
            &mut probe,
        ) {
            return;
        }
        let test = std::env::current_exe().unwrap();
        let script = format!(
            "{set_up} && exec '{}' a_group_that_was_joined_on_the_wrong_interface --nocapture",
            test.display()
        );
        let output = Command::new("unshare")
            .args(["-rn", "sh", "-c", &script])
            .env(INSIDE, "1")
            .output()
            .unwrap();
        let printed = String::from_utf8_lossy(&output.stdout).into_owned();
        let faults = String::from_utf8_lossy(&output.stderr);
        assert!(
            output.status.success() && printed.contains("1 passed"),
            "{printed}{faults}"
        );
        return;
    }
    let group = SocketAddr::from(([225, 200, 77, 3], 51_773));
    let keys = format!("multicast = \"{group}\"\ninterface = \"10.77.0.1\"");
    let mut place = Place::new(&keys, "");
    place.start();
    let socket = socket2::Socket::new(socket2::Domain::IPV4, socket2::Type::DGRAM, None).unwrap();
    socket
        .bind(&SocketAddr::from(([127, 0, 0, 1], 0)).into())
        .unwrap();
    socket.set_multicast_if_v4(&Ipv4Addr::LOCALHOST).unwrap();
    let _station = Repeated::start(vec![Box::new(move |_| {
        let beat = heartbeat(Id(0x1b00_00a0), VSM, ChecksumStyle::None, 0);
        socket.send_to(&beat, &group.into()).unwrap();
    })]);
    let expected =
        "on the interface 127.0.0.1, which has not joined it; set dli.interface = \"127.0.0.1\"";
    let found = place.findings(&["group-interface"]);
    assert!(
        found.len() == 1 && found[0].1.contains(expected),
        "{found:#?}"
    );
    // The bridge has seen it by itself, and what arrives there is not taken for the group's.
    let end = Instant::now() + Duration::from_secs(10);
    while !place.printed().contains(expected) {
        assert!(Instant::now() < end, "{}", place.printed());
        thread::sleep(Duration::from_millis(100));
    }
    let (_, status) = place.command(&["status", "--json"]);
    let status: Value = serde_json::from_str(status.trim()).unwrap();
    assert_eq!(status["refused"], serde_json::json!({}), "{status:#}");
    drop(place);

    let right = IpAddr::from(Ipv4Addr::LOCALHOST);
    let keys = format!("multicast = \"{group}\"\ninterface = \"{right}\"");
    let station = "[[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2]\naddress = \"127.0.0.1\"\n";
    let mut place = Place::new(&keys, station);
    place.start();
    assert_eq!(place.findings(&[]), []);
}
