//! Recorded vehicles in front of the bridge: a player sends what a real PX4 sent, at its times, and what the bridge then
//! sends on the DLI is compared with golden files, message for message.
//!
//! `VSM_BLESS=1 cargo nextest run -p vsm --test flight captures_as_vehicles` writes `tests/data/golden` again; `gunzip -c` shows
//! one, a JSON object a line.

use std::io::Write as _;
use std::path::Path;
use std::time::Duration;

use kit::bridge::{Station, VSM, cucs, orders, station_address, vehicle_id};
use kit::captures;
use mavlink_link::signing::SigningKey;
use mavlink_link::store::MemoryDisk;
use mavlink_link::{Now, frame::FrameView};
use stanag_msgs::json;
use stanag_msgs::messages::CucsAuthorisationRequest;
use stanag_msgs::{enums::LoiBitmap, frames};
use vsm::config::Config;
use vsm::session::{Bridge, Destination, LinkEnd, Peer};

#[test]
fn a_flight_of_px4_v1_18() {
    let play = Play {
        captures: &[
            "03-arm-takeoff-mission-landa",
            "03-arm-takeoff-mission-landb",
        ],
        system_id: 1,
        key: None,
    };
    play.compare("03-flight");
}

#[test]
fn a_flight_of_px4_v1_17() {
    let play = Play {
        captures: &["20-px4-v1.17.0-flight"],
        system_id: 6,
        key: None,
    };
    play.compare("20-flight");
}

#[test]
fn a_signed_vehicle_whose_key_is_changed_by_another() {
    let play = Play {
        captures: &["04-signing-gcs-linka", "04-signing-gcs-linkb"],
        system_id: 4,
        key: Some(core::array::from_fn(|i| i as u8 + 1)),
    };
    play.compare("04-signing");
}

/// A recorded vehicle, and its configuration in the bridge.
struct Play {
    captures: &'static [&'static str],
    system_id: u8,
    key: Option<[u8; 32]>,
}

impl Play {
    /// What a station receives that holds LOI 2 from the start: one JSON object a message, with its time in ms.
    fn run(&self) -> Vec<String> {
        let datagrams = datagrams(self.captures);
        let begun = datagrams[0].at;
        let signing = self.key.map_or("\"off\"", |_| "{ key_file = \"uav.key\" }");
        let text = format!(
            "[dli]\nvsm_id = \"{VSM}\"\nlisten = \"127.0.0.1:4586\"\nlease_s = 3600\n[[cucs]]\nid = \"{}\"\nloi = [2]\naddress = \"127.0.0.1\"\n\
             [[vehicle]]\nid = \"{}\"\nlink = \"udpin:127.0.0.1:14550\"\nsystem_id = {}\nsigning = {signing}\n\
             [store]\ndir = \"state\"\n",
            cucs(0),
            vehicle_id(0),
            self.system_id
        );
        let config = Config::parse(&text, Path::new("/nowhere")).expect("a good configuration");
        let key = self.key.map(|key| SigningKey::new(key).expect("a key"));
        let ends = vec![LinkEnd { key, peer: None }];
        let mut store = MemoryDisk::default();
        let wall = |mono: Duration| begun + mono;
        let now = |mono: Duration| Now {
            mono,
            wall: wall(mono),
        };
        let start = now(Duration::ZERO);
        let not_before = Duration::from_secs(1_767_225_600);
        let mut bridge =
            Bridge::new(&config, ends, start, not_before, &mut store).expect("a bridge");
        let mut station = Station::new(cucs(0), station_address(0));
        let listen = CucsAuthorisationRequest {
            requested_handover_loi: Some(LoiBitmap::LOI2),
            ..orders::request_control()
        };
        station.send(start, vehicle_id(0), listen.into());

        let mut lines = Vec::new();
        let mut played = datagrams.iter().peekable();
        let last = datagrams[datagrams.len() - 1].at - begun;
        let vehicle = Peer::Udp(kit::bridge::vehicle_address(0));
        let mut clock = Duration::ZERO;
        while clock < last + Duration::from_secs(5) {
            clock += Duration::from_millis(10);
            let at = now(clock);
            for bytes in station.advance(at) {
                bridge.handle_dli(at, station.address, &bytes, &mut store);
            }
            while let Some(datagram) = played.next_if(|datagram| datagram.at - begun <= clock) {
                bridge.handle_vehicle(at, 0, vehicle, &datagram.bytes, &mut store, &mut |_, _| {});
            }
            if bridge.poll_timeout(clock) <= clock {
                bridge.handle_timeout(at, &mut store);
            }
            while let Some((_, frame)) = bridge.poll_vehicle() {
                // A recording receives nothing; what the bridge sends to it is well formed all the same.
                assert!(FrameView::parse(frame.bytes()).is_ok());
            }
            while bridge.poll_log().is_some() {}
            while let Some(datagram) = bridge.poll_dli() {
                assert_eq!(datagram.to, Destination::Unicast(station.address));
                station.receive(at, datagram.bytes());
                for frame in frames(datagram.bytes()) {
                    let frame = frame.expect("a frame of the bridge");
                    let mut value = json::frame(&frame, false).expect("a message of the bridge");
                    if let Some(message) = value.as_object_mut() {
                        // As with every message: the whole wrapper is the same each time.
                        for name in ["source", "destination", "idd", "checksum", "ack"] {
                            message.shift_remove(name);
                        }
                    }
                    lines.push(format!("{} {value}", clock.as_millis()));
                }
            }
        }
        lines
    }

    fn compare(&self, name: &str) {
        let lines = self.run();
        assert!(lines.len() > 100, "{} messages", lines.len());
        if std::env::var_os("VSM_BLESS").is_some() {
            let path = kit::workspace().join("tests/data").join(golden(name));
            let file = std::fs::File::create(path).expect("the golden file can be written");
            // No time and no name within: the same messages are the same file.
            let mut file = flate2::GzBuilder::new().write(file, flate2::Compression::best());
            for line in &lines {
                writeln!(file, "{line}").expect("it is written");
            }
            file.finish().expect("it is written");
            return;
        }
        let text = String::from_utf8(captures::unpack(&golden(name))).expect("text");
        for (number, (now, before)) in lines.iter().zip(text.lines()).enumerate() {
            assert_eq!(
                now, before,
                "message {number} of {name}; VSM_BLESS=1 rewrites it"
            );
        }
        assert_eq!(lines.len(), text.lines().count(), "messages of {name}");
    }
}

/// The golden file below `tests/data`.
fn golden(name: &str) -> String {
    format!("golden/{name}.jsonl.gz")
}

/// What the vehicle sent.
fn datagrams(names: &[&str]) -> Vec<captures::Datagram> {
    let recorded = names.iter().flat_map(|name| captures::read(name));
    recorded.filter(|one| one.from_autopilot).collect()
}
