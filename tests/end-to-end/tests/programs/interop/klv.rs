//! `vsm klv` beside a running bridge: its sets, read by a decoder in Python that shares no code with it and by klvdata, and its
//! transport stream, taken apart by another demultiplexer.

use std::net::UdpSocket;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use kit::process::{Running, filter, program};
use serde_json::Value;
use vsm_tests::ground::Ground;
use vsm_tests::{here, peers_python};

const STATION: &str = "[[cucs]]\nid = \"1b:00:00:c0\"\nloi = [2]\n";

/// Runs `vsm klv` with these words, in the folder of the bridge, to its end.
fn klv(ground: &Ground, words: &str) -> String {
    let mut command = Command::new(program("vsm"));
    command
        .args(["klv", "--vsm", &ground.dli()])
        .args(words.split(' '));
    command.current_dir(ground.path(""));
    let mut running = Running::spawn(&mut command);
    let status = running.wait(Duration::from_secs(30));
    let output = running.output();
    assert!(
        status.is_some_and(|status| status.success()),
        "{status:?} {output}"
    );
    output
}

fn read(files: &[&Path]) -> Value {
    let script = here().join("interop/klv_check.py");
    let arguments = [script.as_path()].into_iter().chain(files.iter().copied());
    let printed = filter(&peers_python(), arguments, String::new());
    serde_json::from_str(&printed).unwrap_or_else(|fault| panic!("{fault}: {printed}"))
}

fn number(value: &Value) -> f64 {
    value.as_f64().unwrap_or_else(|| panic!("{value}"))
}

#[test]
fn the_metadata_of_a_vehicle_is_read_by_other_decoders_alone_and_beside_a_video() {
    let ground = Ground::with_tables(STATION);
    let _bridge = ground.bridge();
    let _aircraft = ground.aircraft_with(&["--payloads", "1"]);
    let began = kit::clock::wall();
    // The vehicle boots: what it has not reported yet is not in the first sets.
    klv(&ground, "--out alone.klv --seconds 12 --platform sim");
    let report = read(&[&ground.path("alone.klv")]);
    let sets = report["sets"].as_array().expect("sets");
    assert!(sets.len() > 60, "{} sets", sets.len());
    let last = sets.last().expect("a set");
    assert!(
        (number(&last["latitude"]) - 47.397_743_4).abs() < 1e-4,
        "{last}"
    );
    assert!(
        (number(&last["longitude"]) - 8.545_593_9).abs() < 1e-4,
        "{last}"
    );
    // Home is 488 m above the sea, the geoid some 47 m above the ellipsoid.
    assert!(
        (number(&last["ellipsoid_height"]) - 535.0).abs() < 5.0,
        "{last}"
    );
    for angle in ["heading", "pitch", "roll", "azimuth", "elevation"] {
        assert!(last[angle].is_number(), "{angle}: {last}");
    }
    assert!(
        number(&last["hfov"]) > 1.0 && last["sensor"] == "EO",
        "{last}"
    );
    assert_eq!(
        (&last["tail_number"], &last["platform"]),
        (&"PX4-01".into(), &"sim".into())
    );
    assert!(last["agrees_with_klvdata"].as_u64() >= Some(14), "{last}");
    // On the ground the camera looks at no ground.
    assert!(
        last["range"].is_null() && last["centre_latitude"].is_null(),
        "{last}"
    );
    let times: Vec<u128> = sets
        .iter()
        .map(|set| set["time_us"].as_u64().expect("a time").into())
        .collect();
    assert!(
        times.is_sorted() && times[0] > began.as_micros() - 1_000_000,
        "{times:?}"
    );

    // By UDP a set is a datagram, and what other decoders read is the same.
    let socket = UdpSocket::bind("127.0.0.1:0").expect("a socket");
    let port = socket.local_addr().expect("its address").port();
    klv(&ground, &format!("--udp 127.0.0.1:{port} --seconds 5"));
    let pause = Some(Duration::from_millis(200));
    socket.set_read_timeout(pause).expect("a timeout");
    let (mut bytes, mut datagram, mut count) = (vec![], [0; 2_048], 0);
    while let Ok(length) = socket.recv(&mut datagram) {
        bytes.extend_from_slice(&datagram[..length]);
        count += 1;
    }
    std::fs::write(ground.path("udp.klv"), bytes).expect("written");
    let report = read(&[&ground.path("udp.klv")]);
    let sets = report["sets"].as_array().expect("sets");
    assert!(count == sets.len() && count > 20, "{count}, {}", sets.len());
    let last = sets.last().expect("a set");
    assert!(last["agrees_with_klvdata"].as_u64() >= Some(12), "{last}");
    assert!(number(&last["latitude"]) > 47.0, "{last}");

    let video = kit::workspace().join("tests/data/video/pattern.h264");
    let words = format!("--out both.ts --video {} --fps 25", video.display());
    let output = klv(&ground, &words);
    assert!(output.contains(", 50 pictures"), "{output}");
    let report = read(&[&ground.path("both.ts"), &video]);
    let whole = std::fs::metadata(&video).expect("the video").len();
    assert_eq!(
        (report["pictures"].as_u64(), report["video_bytes"].as_u64()),
        (Some(50), Some(whole))
    );
    let presented = |value: &Value| value["presented_90khz"].as_u64().expect("a time");
    let sets = report["sets"].as_array().expect("sets");
    assert!(sets.len() >= 12, "{} sets", sets.len());
    // What is presented together was valid at the same time: both count microseconds of Unix time.
    for set in sets {
        let time = (set["time_us"].as_u64().expect("a time") + 300_000) / 100 * 9 % (1 << 33);
        assert_eq!(presented(set), time, "{set}");
    }
    let pictures: Vec<u64> = report["presented_90khz"]
        .as_array()
        .expect("times")
        .iter()
        .filter_map(Value::as_u64)
        .collect();
    assert!(
        pictures
            .windows(2)
            .all(|pair| pair[1].abs_diff(pair[0] + 3_600) <= 9),
        "{pictures:?}"
    );
    let middle = presented(&sets[sets.len() / 2]);
    assert!(
        pictures[0] - 27_000 < middle && middle < pictures[49] + 27_000,
        "{middle} {pictures:?}"
    );
    // The clock is ahead of what is presented, by the delay.
    let clock = report["clock_27mhz"][0].as_u64().expect("a clock") / 300;
    assert!(
        pictures[0].abs_diff(clock + 27_000) <= 9,
        "{clock} {}",
        pictures[0]
    );
}
