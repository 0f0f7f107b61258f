//! The bridge's recording of the DLI is a pcapng that tshark opens with our dissector, message for message; strangers
//! and keys are not in it.

use std::fs;
use std::net::UdpSocket;
use std::process::Command;
use std::time::Duration;

use stanag_msgs::enums::{LoiBitmap, RequestedAccess};
use stanag_msgs::messages::{CucsAuthorisationRequest, Heartbeat};
use stanag_msgs::{Envelope, Id, MAX_DATAGRAM, Message, TimeStamp};
use vsm_tests::ground::Ground;
use vsm_tests::here;

#[test]
fn tshark_opens_the_recording_of_the_dli() {
    if !kit::tools::is_installed("tshark") {
        return;
    }
    let ground = Ground::new();
    let config = ground.path("vsm.toml");
    let text = fs::read_to_string(&config).expect("the configuration");
    fs::write(&config, text + "[record]\ndir = \"records\"\n").expect("the configuration");
    let mut bridge = ground.bridge();

    let station = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    station
        .set_read_timeout(Some(Duration::from_secs(5)))
        .expect("a time-out");
    let stranger = Id(0x1b00_00ee);
    for (source, message) in [
        (STATION, Message::from(request(1_000))),
        (stranger, request(2_000).into()),
        (STATION, beat(3_000).into()),
    ] {
        let mut bytes = [0; MAX_DATAGRAM];
        let envelope = Envelope::new(source, VEHICLE);
        let length = message.encode(&envelope, &mut bytes).expect("it fits");
        station
            .send_to(&bytes[..length], ground.dli())
            .expect("it is sent");
    }
    // The answer has come: what it answers is recorded.
    station.recv(&mut [0; 2048]).expect("an answer");
    std::thread::sleep(Duration::from_millis(500));
    bridge.terminate();
    assert!(bridge.wait(Duration::from_secs(2)).is_some());

    let recording = fs::read_dir(ground.path("records"))
        .expect("the folder")
        .map(|entry| entry.expect("an entry").path())
        .find(|path| path.extension().is_some_and(|e| e == "pcapng"))
        .expect("a recording of the DLI");
    let script = here().join("../packaging/wireshark/stanag4586.lua");
    let dli = ground.dli();
    let port = dli.rsplit(':').next().expect("a port");
    let output = Command::new("tshark")
        .arg("-X")
        .arg(format!("lua_script:{}", script.display()))
        .arg("-d")
        .arg(format!("udp.port=={port},stanag4586"))
        .arg("-r")
        .arg(&recording)
        .args(["-o", "ip.check_checksum:TRUE", "-T", "fields"])
        .args([
            "-e",
            "stanag4586.type",
            "-e",
            "stanag4586.source",
            "-e",
            "udp.dstport",
        ])
        .args(["-e", "ip.checksum.status"])
        .env("HOME", ground.path(""))
        .env("XDG_CONFIG_HOME", ground.path(""))
        .output()
        .expect("tshark");
    let printed = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{printed}");
    let shown = String::from_utf8_lossy(&output.stdout).into_owned();
    let rows: Vec<Vec<&str>> = shown
        .lines()
        .map(|line| line.split('\t').collect())
        .collect();
    let types = |to_bridge: bool| -> Vec<&str> {
        let rows = rows.iter().filter(|row| (row[2] == port) == to_bridge);
        rows.map(|row| row[0]).collect()
    };
    assert_eq!(types(true), ["1", "16002"], "{shown}");
    assert!(types(false).contains(&"2"), "{shown}");
    let number = |text: &str| {
        text.strip_prefix("0x").map_or_else(
            || text.parse().ok(),
            |hex| u32::from_str_radix(hex, 16).ok(),
        )
    };
    assert!(
        rows.iter().all(|row| number(row[1]) != Some(stranger.0)),
        "{shown}"
    );
    assert!(
        rows.iter().all(|row| row[3] == "1" || row[3] == "Good"),
        "checksums: {shown}"
    );

    let key = fs::read_to_string(ground.path("uav1.key")).expect("the key");
    let key = kit::process::from_hex(&key);
    let bytes = fs::read(&recording).expect("the recording");
    assert!(!bytes.windows(32).any(|window| window == key));
}

fn request(stamp: u64) -> CucsAuthorisationRequest {
    CucsAuthorisationRequest {
        time_stamp: Some(TimeStamp(stamp)),
        requested_handover_loi: Some(LoiBitmap::LOI2),
        requested_handover_access: Some(RequestedAccess::Request),
        ..CucsAuthorisationRequest::default()
    }
}

fn beat(stamp: u64) -> Heartbeat {
    Heartbeat {
        time_stamp: Some(TimeStamp(stamp)),
    }
}

const STATION: Id = Id(0x1b00_00a0);
const VEHICLE: Id = Id(0x1b00_0101);
