//! The simulator as a task and as a program: real UDP, a peer that starts late, a clean stop.

use std::io::{BufRead as _, BufReader, Write as _};
use std::net::UdpSocket;
use std::os::unix::fs::PermissionsExt as _;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::vehicle::support::heartbeat;
use mavlink::dialects::development::MavMessage;
use mavlink_link::frame::{FrameView, Header, MAX_FRAME, encode};
use mavlink_link::signing::{SigningKey, verify};
use px4_sim::{LinkAddress, Simulator, SimulatorConfig};

fn socket() -> UdpSocket {
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    socket
        .set_read_timeout(Some(Duration::from_millis(200)))
        .unwrap();
    socket
}

/// Reads until a heartbeat arrives; returns its bytes.
fn heartbeat_of(socket: &UdpSocket) -> Option<Vec<u8>> {
    let end = Instant::now() + Duration::from_secs(10);
    let mut buffer = [0; 512];
    while Instant::now() < end {
        let Ok(len) = socket.recv(&mut buffer) else {
            continue;
        };
        if FrameView::parse(&buffer[..len]).is_ok_and(|f| f.header().message_id == 0) {
            return Some(buffer[..len].to_vec());
        }
    }
    None
}

fn ours() -> Vec<u8> {
    let mut out = [0; MAX_FRAME];
    let header = Header {
        system_id: 245,
        component_id: 190,
        ..Default::default()
    };
    let len = encode(&heartbeat(), header, &mut out);
    out[..len].to_vec()
}

#[tokio::test]
async fn a_waiting_link_sends_nothing_until_something_is_received() {
    let link: LinkAddress = "udpin:127.0.0.1:0".parse().unwrap();
    let simulator = Simulator::spawn(SimulatorConfig {
        speed: 20.0,
        ..SimulatorConfig::on(link)
    })
    .await
    .unwrap();
    let address = simulator.address(0).unwrap();
    let peer = tokio::task::spawn_blocking(move || {
        let peer = socket();
        std::thread::sleep(Duration::from_millis(300));
        peer.send_to(&ours(), address).unwrap();
        let beat = heartbeat_of(&peer).unwrap();
        matches!(
            FrameView::parse(&beat).unwrap().message(),
            Ok(MavMessage::HEARTBEAT(_))
        )
    });
    assert!(peer.await.unwrap());
    tokio::time::sleep(Duration::from_millis(100)).await;
    assert!(simulator.counters().links[0].unsigned >= 1);
    assert!(
        simulator.truth().time > Duration::from_secs(5),
        "20 times faster"
    );
    assert!(!simulator.take_track().is_empty());
    simulator.restart();
    tokio::time::sleep(Duration::from_millis(50)).await;
    assert!(simulator.truth().time < Duration::from_secs(5));
    simulator.stop().await;
    // The port is free again.
    UdpSocket::bind(address).unwrap();
}

#[tokio::test]
async fn at_every_speed_time_passes_so_fast_and_only_the_first_sender_is_answered() {
    let mut before = 0.0;
    for speed in [1.0, 10.0, 50.0] {
        let link: LinkAddress = "udpin:127.0.0.1:0".parse().unwrap();
        let simulator = Simulator::spawn(SimulatorConfig {
            speed,
            ..SimulatorConfig::on(link)
        })
        .await
        .unwrap();
        let address = simulator.address(0).unwrap();
        let (begun, at) = (Instant::now(), simulator.truth().time);
        let counts = tokio::task::spawn_blocking(move || {
            let (first, second) = (socket(), socket());
            first.send_to(&ours(), address).unwrap();
            std::thread::sleep(Duration::from_millis(50));
            let mut counts = (0, 0);
            for _ in 0..20 {
                second.send_to(&ours(), address).unwrap();
                std::thread::sleep(Duration::from_millis(100));
                for (socket, counts) in [(&first, &mut counts.0), (&second, &mut counts.1)] {
                    socket.set_nonblocking(true).unwrap();
                    while socket.recv(&mut [0; 512]).is_ok() {
                        *counts += 1;
                    }
                }
            }
            counts
        });
        let counts = counts.await.unwrap();
        let passed = (simulator.truth().time - at).as_secs_f64();
        let ratio = passed / begun.elapsed().as_secs_f64();
        // A busy machine loses simulated time and never gains any; a higher speed still gives more of it.
        assert!(ratio < speed * 1.1, "{ratio} times, at {speed}");
        assert!(
            ratio > before * 1.5 && ratio > 0.5,
            "{ratio} times, at {speed}"
        );
        before = ratio;
        assert!(counts.0 > 0 && counts.1 == 0, "{counts:?} at {speed}");
        simulator.stop().await;
    }
}

#[tokio::test]
async fn a_taken_port_is_named() {
    let taken = socket();
    let link: LinkAddress = format!("udpin:{}", taken.local_addr().unwrap())
        .parse()
        .unwrap();
    let error = Simulator::spawn(SimulatorConfig::on(link))
        .await
        .unwrap_err();
    assert!(error.to_string().contains(&link.to_string()), "{error}");
}

#[test]
fn the_program_signs_survives_a_late_peer_and_stops_on_a_signal() {
    let directory = tempfile_dir("px4-sim-program");
    let key_file = directory.join("uav.key");
    std::fs::write(&key_file, format!("{}\n", "0a".repeat(32))).unwrap();
    std::fs::set_permissions(&key_file, std::fs::Permissions::from_mode(0o600)).unwrap();
    // Nobody listens yet: the first packets are returned as errors.
    let port = socket().local_addr().unwrap();
    let mut program = Command::new(env!("CARGO_BIN_EXE_px4-sim"))
        .args([
            "--link",
            &format!("udpout:{port}"),
            "--speed",
            "10",
            "--system-id",
            "7",
        ])
        .arg("--key-file")
        .arg(&key_file)
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut ready = String::new();
    BufReader::new(program.stderr.take().unwrap())
        .read_line(&mut ready)
        .unwrap();
    assert!(ready.contains("ready"), "{ready}");
    std::thread::sleep(Duration::from_millis(500));
    let peer = UdpSocket::bind(port).unwrap();
    peer.set_read_timeout(Some(Duration::from_millis(200)))
        .unwrap();
    let beat = heartbeat_of(&peer).expect("a heartbeat");
    let frame = FrameView::parse(&beat).unwrap();
    assert_eq!(frame.header().system_id, 7);
    assert!(verify(&SigningKey::new([0x0a; 32]).unwrap(), &frame).is_ok());
    let stopping = Instant::now();
    Command::new("kill")
        .args(["-TERM", &program.id().to_string()])
        .status()
        .unwrap();
    assert_eq!(program.wait().unwrap().code(), Some(0));
    assert!(stopping.elapsed() < Duration::from_secs(2));
}

#[test]
fn bad_arguments_and_key_files_are_status_2() {
    let directory = tempfile_dir("px4-sim-bad");
    let key = |name: &str, text: &str, mode: u32| {
        let path = directory.join(name);
        let mut file = std::fs::File::create(&path).unwrap();
        file.write_all(text.as_bytes()).unwrap();
        std::fs::set_permissions(&path, std::fs::Permissions::from_mode(mode)).unwrap();
        path.to_string_lossy().into_owned()
    };
    let open = key("open.key", &"0a".repeat(32), 0o640);
    let short = key("short.key", "0a0a", 0o600);
    let missing = directory.join("missing.key").to_string_lossy().into_owned();
    let hex = key("px4.hex", &"0a".repeat(32), 0o600);
    let text = key("notes.txt", "The key is in the safe.\n", 0o600);
    let long = key("long.bin", &"\0".repeat(41), 0o600);
    let nowhere = directory.join("nowhere/px4.bin");
    let nowhere = nowhere.to_string_lossy().into_owned();
    let binary = directory.join("px4.bin").to_string_lossy().into_owned();
    std::fs::write(&binary, [0xff; 40]).unwrap();
    std::fs::set_permissions(&binary, std::fs::Permissions::from_mode(0o600)).unwrap();
    let link = ["--link", "udpin:127.0.0.1:0"];
    for (arguments, expected) in [
        (vec!["--link", "tcp:1.2.3.4:5"], "udpin:HOST:PORT"),
        (vec![link[0], link[1], "--key-file", &open], "0600"),
        (vec![link[0], link[1], "--key-file", &short], "short.key"),
        (
            vec![link[0], link[1], "--key-file", &missing],
            "missing.key",
        ),
        (vec![link[0], link[1], "--system-id", "0"], "system-id"),
        (vec![link[0], link[1], "--home", "91,0,0"], "-90 to 90"),
        (vec![link[0], link[1], "--speed", "0"], "0.01 to 100"),
        (vec![], "--link"),
        // A key in hex, or another file, is none of PX4's: it would be overwritten with the first key.
        (
            vec![link[0], link[1], "--signing-file", &hex],
            "as --key-file has them, expected the 40 bytes that PX4 writes",
        ),
        (
            vec![link[0], link[1], "--signing-file", &text],
            "notes.txt: text, expected the 40 bytes",
        ),
        (
            vec![link[0], link[1], "--signing-file", &long],
            "long.bin: 41 bytes, expected the 40",
        ),
        (
            vec![link[0], link[1], "--signing-file", &nowhere],
            "nowhere: a key would be lost",
        ),
        (
            vec![link[0], link[1], "--key-file", &binary],
            "PX4's own file is for --signing-file",
        ),
        (
            vec![link[0], link[1], "--files", "/"],
            "--files: /: all files of this computer",
        ),
        (
            vec![link[0], link[1], "--files", &text],
            "notes.txt: Not a directory",
        ),
    ] {
        let output = Command::new(env!("CARGO_BIN_EXE_px4-sim"))
            .args(&arguments)
            .output()
            .unwrap();
        let text = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
        assert!(text.contains(expected), "{arguments:?}: {text}");
    }
}

#[test]
fn the_program_says_which_files_it_serves_and_starts_with_what_a_power_cut_leaves_of_a_key() {
    let directory = tempfile_dir("px4-sim-files");
    let card = directory.join("card");
    std::fs::create_dir_all(card.join("fs/microsd/log")).unwrap();
    std::fs::write(card.join("fs/microsd/log/a.ulg"), [7; 1_000]).unwrap();
    std::fs::write(card.join("readme"), "hello").unwrap();
    std::os::unix::fs::symlink("/etc/passwd", card.join("link")).unwrap();
    let cut = directory.join("px4.bin");
    let cuts: [&[u8]; 3] = [&[], &[0x80; 7], &[0; 40]];
    for left in cuts {
        std::fs::write(&cut, left).unwrap();
        let mut program = Command::new(env!("CARGO_BIN_EXE_px4-sim"))
            .args(["--link", "udpin:127.0.0.1:0", "--files"])
            .arg(&card)
            .arg("--signing-file")
            .arg(&cut)
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut ready = String::new();
        BufReader::new(program.stderr.take().unwrap())
            .read_line(&mut ready)
            .unwrap();
        program.kill().unwrap();
        program.wait().unwrap();
        let served = format!(
            "1x, serves 2 files of {}, 1005 bytes, as /fs, /readme, 1 left out: links, devices\n",
            card.display()
        );
        assert!(ready.ends_with(&served), "{ready}");
    }
}

/// A fresh directory that the next run of the same test clears.
fn tempfile_dir(name: &str) -> std::path::PathBuf {
    let path = std::path::Path::new(env!("CARGO_TARGET_TMPDIR")).join(name);
    let _ = std::fs::remove_dir_all(&path);
    std::fs::create_dir_all(&path).unwrap();
    path
}
