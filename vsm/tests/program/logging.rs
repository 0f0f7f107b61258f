//! The log of `vsm run`: what becomes of each datagram, in which form, under which filter; and no key in it.

use std::fs;
use std::net::UdpSocket;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use kit::process::{Running, free_udp_port, program, write_key};
use kit::serial::Device;
use mavlink_link::dialect::{ATTITUDE_DATA, MavMessage};
use mavlink_link::frame::{Header, INCOMPAT_SIGNED, MAX_FRAME, encode};
use mavlink_link::signing::{SigningKey, Stamp, sign};
use serde_json::Value;
use stanag_msgs::enums::{LoiBitmap, RequestedAccess};
use stanag_msgs::messages::CucsAuthorisationRequest;
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, TimeStamp};

const KEY: [u8; 32] = [0x5a; 32];

/// The ports of DLI and MAVLink.
fn laid_out(folder: &Path) -> (u16, u16) {
    let (dli, link) = (free_udp_port(), free_udp_port());
    let text = format!(
        "[dli]\nvsm_id = \"1b:00:00:01\"\nlisten = \"127.0.0.1:{dli}\"\n[[cucs]]\nid = \"1b:00:00:a0\"\nloi = [2, 3, 4]\n\
         address = \"127.0.0.1\"\n[[vehicle]]\nid = \"1b:00:01:01\"\nlink = \"udpin:127.0.0.1:{link}\"\nsystem_id = 1\n\
         signing = {{ key_file = \"uav.key\" }}\n[store]\ndir = \"state\"\n"
    );
    fs::write(folder.join("vsm.toml"), text).unwrap();
    write_key(&folder.join("uav.key"), &KEY);
    (dli, link)
}

fn run(folder: &Path, words: &[&str], filter: &str) -> Command {
    let mut command = Command::new(program("vsm"));
    command.arg("run").args(words).current_dir(folder);
    command.env("RUST_LOG", filter).env_remove("NO_COLOR");
    command
}

#[test]
fn a_filter_that_cannot_be_read_is_an_error_that_names_it() {
    let folder = tempfile::tempdir().unwrap();
    laid_out(folder.path());
    for filter in ["debgu", "info,vsm=lots"] {
        let output = run(folder.path(), &[], filter).output().unwrap();
        let printed = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{printed}");
        let named = format!("vsm: RUST_LOG = \"{filter}\"");
        assert!(
            printed.contains(&named) && printed.contains("expected off, error"),
            "{printed}"
        );
    }
    let output = run(folder.path(), &["--log", "xml"], "info")
        .output()
        .unwrap();
    let printed = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.code() == Some(2) && printed.contains("text, json"),
        "{printed}"
    );
}

#[test]
fn what_becomes_of_each_datagram_is_logged_on_both_sides_and_no_key() {
    let folder = tempfile::tempdir().unwrap();
    let (dli, link) = laid_out(folder.path());
    let mut bridge = Running::spawn(&mut run(folder.path(), &[], "debug"));
    bridge.wait_for("ready", Duration::from_secs(30));

    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let own = socket.local_addr().unwrap();
    let request = |source: u32| {
        let message = Message::from(CucsAuthorisationRequest {
            time_stamp: Some(TimeStamp::from_unix_ms(1_795_219_200_000)),
            requested_handover_loi: Some(LoiBitmap::LOI2),
            requested_handover_access: Some(RequestedAccess::Request),
            ..CucsAuthorisationRequest::default()
        });
        let mut out = [0; MAX_DATAGRAM];
        let envelope = Envelope::new(Id(source), Id(0x1b00_0101)).requesting_ack();
        let length = message.encode(&envelope, &mut out).unwrap();
        out[..length].to_vec()
    };
    for bytes in [request(0x1b00_00a0), request(0x1b00_00b7), b"what".to_vec()] {
        socket.send_to(&bytes, ("127.0.0.1", dli)).unwrap();
    }
    let began = kit::clock::wall();
    let send = |key: [u8; 32], n: u64| {
        let header = Header {
            system_id: 1,
            component_id: 1,
            incompat: INCOMPAT_SIGNED,
            ..Header::default()
        };
        let mut out = [0; MAX_FRAME];
        let message = MavMessage::ATTITUDE(ATTITUDE_DATA::default());
        let length = encode(&message, header, &mut out);
        // Above the ceiling that is stored for the bridge's own stamps.
        let stamp = Stamp::from_unix(began + Duration::from_secs(600 + n));
        let length = sign(&SigningKey::new(key).unwrap(), 0, stamp, &mut out, length).unwrap();
        socket.send_to(&out[..length], ("127.0.0.1", link)).unwrap();
    };
    send([0x33; 32], 0);
    // The first is not taken before the clock's ceiling is stored.
    for n in 0..50 {
        send(KEY, n);
        std::thread::sleep(Duration::from_millis(100));
        if bridge.output().contains("; taken 1") {
            break;
        }
    }
    let name = stanag_msgs::table::message(1).unwrap().name;
    for line in [
        format!("1b:00:00:01: DLI received from {own}, "),
        format!(" bytes: 1 {name} of 1b:00:00:a0 to 1b:00:01:01, acknowledgement requested; taken"),
        format!(
            " bytes: 1 {name} of 1b:00:00:b7 to 1b:00:01:01, acknowledgement requested; unauthorised source"
        ),
        format!(
            "DLI received from {own}, 4 bytes: offset 0: 4 bytes, expected a header of 16; truncated"
        ),
        format!("DLI sent to {own}, "),
        format!("(CarriedOut, of 1 {name}) of 1b:00:01:01 to 1b:00:00:a0"),
        format!("1b:00:01:01: MAVLink received from {own}, "),
        "ATTITUDE of 1/1; taken 1".to_owned(),
        "ATTITUDE of 1/1; dropped: bad signature 1".to_owned(),
        format!("1b:00:01:01: MAVLink sent to {own}, "),
        "bytes: HEARTBEAT, signed".to_owned(),
    ] {
        bridge.wait_for(&line, Duration::from_secs(10));
    }
    bridge.terminate();
    bridge.wait(Duration::from_secs(5));
    let printed = bridge.output().to_lowercase();
    for key in ["5a5a5a5a", "90, 90, 90", "33333333"] {
        assert!(!printed.contains(key), "{printed}");
    }
}

#[test]
fn the_agent_logs_what_becomes_of_each_datagram_too() {
    let folder = tempfile::tempdir().unwrap();
    let (radio, px4) = (free_udp_port(), free_udp_port());
    let text = format!(
        "[agent]\nvehicle_id = \"1b:00:01:01\"\nvsm_id = \"1b:00:00:01\"\nkey_file = \"airside.key\"\n[radio]\n\
         link = \"udpin:127.0.0.1:{radio}\"\ntalkers = [{{ system_id = 245, component_id = 190 }}]\n[px4]\n\
         link = \"udpin:127.0.0.1:{px4}\"\nsystem_id = 1\n[store]\ndir = \"state\"\n"
    );
    fs::write(folder.path().join("airside.toml"), text).unwrap();
    write_key(&folder.path().join("airside.key"), &KEY);
    let mut command = Command::new(program("vsm"));
    command.arg("airside").current_dir(folder.path());
    command.env("RUST_LOG", "debug").env_remove("NO_COLOR");
    let mut agent = Running::spawn(&mut command);
    agent.wait_for("ready", Duration::from_secs(30));
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let own = socket.local_addr().unwrap();
    let mut out = [0; MAX_FRAME];
    let header = Header {
        system_id: 1,
        component_id: 1,
        ..Header::default()
    };
    let message = MavMessage::ATTITUDE(ATTITUDE_DATA::default());
    let length = encode(&message, header, &mut out);
    for port in [radio, px4] {
        socket.send_to(&out[..length], ("127.0.0.1", port)).unwrap();
    }
    for line in [
        format!("ground: MAVLink received from {own}, {length} bytes: ATTITUDE of 1/1; dropped:"),
        format!("PX4: MAVLink received from {own}, {length} bytes: ATTITUDE of 1/1; "),
    ] {
        agent.wait_for(&line, Duration::from_secs(10));
    }
    agent.terminate();
    agent.wait(Duration::from_secs(5));
    assert!(!agent.output().to_lowercase().contains("5a5a5a5a"));
}

#[test]
fn in_json_each_line_is_an_object_and_the_last_error_too() {
    let folder = tempfile::tempdir().unwrap();
    let (dli, _) = laid_out(folder.path());
    let mut bridge = Running::spawn(&mut run(folder.path(), &["--log", "json"], "error"));
    // Also where the filter leaves all else out.
    bridge.wait_for("ready", Duration::from_secs(30));
    bridge.terminate();
    bridge.wait(Duration::from_secs(5));
    let taken = UdpSocket::bind(("127.0.0.1", dli)).unwrap();
    let words = ["--log", "json"];
    let output = run(folder.path(), &words, "debug").output().unwrap();
    drop(taken);
    assert_eq!(output.status.code(), Some(1));
    let failed = String::from_utf8(output.stderr).unwrap();
    let lines: Vec<Value> = (bridge.output() + &failed)
        .lines()
        .map(|line| serde_json::from_str(line).unwrap_or_else(|fault| panic!("{fault}: {line}")))
        .collect();
    for line in &lines {
        for key in ["timestamp", "level", "message"] {
            assert!(line[key].is_string(), "{key}: {line}");
        }
    }
    let says = |level: &str, words: &str| {
        let mut lines = lines.iter();
        lines
            .any(|line| line["level"] == level && line["message"].as_str().unwrap().contains(words))
    };
    assert!(says("INFO", "ready: DLI on"), "{lines:?}");
    assert!(says("ERROR", "cannot listen on dli.listen"), "{lines:?}");
}

#[test]
fn a_terminal_gets_colours_unless_no_color_is_set() {
    for (value, coloured) in [("", true), ("1", false)] {
        let folder = tempfile::tempdir().unwrap();
        laid_out(folder.path());
        let mut device = Device::new();
        let terminal = fs::OpenOptions::new()
            .write(true)
            .open(&device.name)
            .unwrap();
        let mut command = run(folder.path(), &[], "debug");
        command
            .env("NO_COLOR", value)
            .stderr(terminal)
            .stdout(Stdio::null());
        let mut bridge = kit::process::KillOnDrop(command.spawn().unwrap());
        let mut shown = vec![];
        let mut bytes = [0; 4_096];
        let end = std::time::Instant::now() + Duration::from_secs(20);
        // Its own warnings are lines of the log.
        while !String::from_utf8_lossy(&shown).contains("no MAVLink at all") {
            assert!(
                std::time::Instant::now() < end,
                "{}",
                String::from_utf8_lossy(&shown)
            );
            let length = device.port.read(&mut bytes);
            shown.extend_from_slice(&bytes[..length]);
            std::thread::sleep(Duration::from_millis(20));
        }
        assert_eq!(shown.contains(&0x1b), coloured, "NO_COLOR={value}");
        let _ = bridge.0.kill();
    }
}
