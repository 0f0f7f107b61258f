//! The Wireshark dissector shows what the codec reads: every message, field by field, through tshark.
//!
//! Without tshark the tests are left out; with `CI` set they fail.

use std::collections::BTreeMap;
use std::net::Ipv4Addr;
use std::path::PathBuf;
use std::process::Command;

use kit::process::from_hex;
use kit::{Random, tools};
use serde_json::{Map, Value, json};
use stanag_msgs::enums::{FlightPathControlMode, LoiBitmap};
use stanag_msgs::json::{decode_line, encode_line};
use stanag_msgs::table::{FieldInfo, MESSAGES, MessageInfo, Wire};
use stanag_msgs::{Bam32, ChecksumStyle, Envelope, Id, Message, TimeStamp, ed25, messages};

#[test]
fn every_field_of_every_message_is_shown_as_the_codec_reads_it() {
    let Some(tshark) = Tshark::find() else { return };
    let mut random = Random::with_seed(0x4586);
    let mut lines = Vec::new();
    for message in MESSAGES {
        for (round, checksum) in [(0, 0), (1, 1), (2, 2), (3, 3)] {
            lines.push(random_message(message, round == 0, checksum, &mut random));
        }
    }
    let datagrams: Vec<Vec<u8>> = lines.iter().map(|line| from_hex(line)).collect();
    let shown = tshark.dissect("fields", PORT, &datagrams, &[]);
    assert_eq!(shown.len(), lines.len());

    let mut compared = 0;
    for (line, shown) in lines.iter().zip(&shown) {
        let raw = only(decode_line(line, true));
        let scaled = only(decode_line(line, false));
        let message = stanag_msgs::table::message(raw["id"].as_u64().unwrap() as u16).unwrap();
        let number = |name: &str| shown.number(&format!("stanag4586.{name}"));
        for (ours, theirs) in [
            ("id", "type"),
            ("source", "source"),
            ("destination", "destination"),
            ("idd", "idd"),
            ("checksum", "checksum_style"),
        ] {
            assert_eq!(raw[ours].as_f64(), Some(number(theirs)), "{ours} of {line}");
        }
        assert_eq!(raw["ack"], Value::Bool(number("ack") != 0.0));
        let fields = raw["fields"].as_object().unwrap();
        for field in message.fields {
            let key = format!("stanag4586.{}.{}", snake(message.rust), field.rust);
            let Some(ours) = fields.get(field.name) else {
                assert!(!shown.has(&key), "{key} is shown and absent: {line}");
                continue;
            };
            compare(field, &key, ours, &scaled["fields"][field.name], shown);
            compared += 1;
        }
        let complaints = shown.complaints();
        let complaints: Vec<_> = complaints
            .iter()
            .filter(|complaint| *complaint != "out_of_range")
            .collect();
        assert!(complaints.is_empty(), "{complaints:?}: {line}");
    }
    let fields: usize = MESSAGES.iter().map(|message| message.fields.len()).sum();
    assert!(compared > fields, "{compared} values of {fields} fields");
}

#[test]
fn every_field_of_edition_2_5_is_shown_as_the_codec_reads_it() {
    let Some(tshark) = Tshark::find() else { return };
    let mut random = Random::with_seed(0x25);
    let mut lines = Vec::new();
    for (message, idd) in ed25::messages().zip(["2.5", "7", "8", "9"].into_iter().cycle()) {
        let version = ed25::Version::from_text(idd).unwrap();
        let message = ed25::message(message.id.into(), version).unwrap();
        let line = json!({
            "id": message.id,
            "idd": idd,
            "instance": random.u32(..),
            "fields": random_fields(message, true, &mut random),
        });
        lines.push((message, encode_line(&line.to_string(), true).unwrap()));
    }
    let datagrams: Vec<Vec<u8>> = lines.iter().map(|(_, line)| from_hex(line)).collect();
    // On another port: found by what they carry.
    for port in [PORT, 40_001] {
        let shown = tshark.dissect("ed25", port, &datagrams, &[]);
        assert_eq!(shown.len(), lines.len());
        for ((message, line), shown) in lines.iter().zip(&shown) {
            let raw = only(decode_line(line, true));
            let scaled = only(decode_line(line, false));
            assert_eq!(raw["idd"].as_str(), shown.text("stanag4586.version"));
            for (ours, theirs) in [("id", "ed25.type"), ("instance", "instance")] {
                let theirs = shown.number(&format!("stanag4586.{theirs}"));
                assert_eq!(raw[ours].as_f64(), Some(theirs), "{ours} of {line}");
            }
            for field in message.fields {
                let key = format!("stanag4586.ed25.{}.{}", snake(message.rust), field.rust);
                compare(
                    field,
                    &key,
                    &raw["fields"][field.name],
                    &scaled["fields"][field.name],
                    shown,
                );
            }
            let complaints = shown.complaints();
            assert!(
                complaints
                    .iter()
                    .all(|complaint| complaint == "out_of_range"),
                "{complaints:?}"
            );
        }
    }
}

#[test]
fn faults_of_edition_2_5_are_expert_warnings_too() {
    let Some(tshark) = Tshark::find() else { return };
    let line = json!({"id": 42, "idd": "2.5", "fields": {"Vehicle ID": 1}}).to_string();
    let good = from_hex(&encode_line(&line, true).unwrap());
    let edited = |at: usize, value: u8| {
        let mut bytes = good.clone();
        bytes[at] = value;
        bytes
    };
    let cases = [
        ("bad_checksum", edited(40, 0xEE)),
        ("bad_length", edited(20, 0xFF)),
        ("short", edited(21, 200)),
        ("short", good[..20].to_vec()),
        ("unknown_idd", edited(2, b'6')),
        ("unknown_type", edited(16, 9)),
        ("short_field", edited(17, 1)),
        ("oversized", [good.clone(), vec![0; 600]].concat()),
    ];
    let datagrams: Vec<Vec<u8>> = cases.iter().map(|(_, bytes)| bytes.clone()).collect();
    let shown = tshark.dissect("faults25", PORT, &datagrams, &[]);
    for ((fault, _), shown) in cases.iter().zip(&shown) {
        let complaints = shown.complaints();
        assert!(
            complaints.iter().any(|c| c == fault),
            "{fault}: {complaints:?}"
        );
    }
}

#[test]
fn several_messages_of_a_datagram_are_each_shown() {
    let Some(tshark) = Tshark::find() else { return };
    let mut datagram = encode(&beat(1), ChecksumStyle::Crc32);
    datagram.extend(encode(&position(), ChecksumStyle::Sum16));
    datagram.extend(encode(&beat(2), ChecksumStyle::None));
    let shown = tshark.dissect("several", PORT, &[datagram], &[]);
    assert_eq!(
        shown[0].texts("stanag4586.type"),
        ["16002", "4000", "16002"]
    );
    assert_eq!(
        shown[0].texts("stanag4586.heartbeat.time_stamp"),
        ["1", "2"]
    );
    assert_eq!(shown[0].complaints(), [""; 0]);
}

#[test]
fn the_info_column_has_mode_waypoint_and_levels_by_name() {
    let Some(tshark) = Tshark::find() else { return };
    let both = LoiBitmap::LOI4 | LoiBitmap::LOI5;
    let cases = [
        (
            Message::from(messages::VehicleOperatingModeCommand {
                select_flight_path_control_mode: Some(FlightPathControlMode::Waypoint),
                commanded_waypoint_number: Some(20),
                ..Default::default()
            }),
            "(mode waypoint, to waypoint 20)",
        ),
        (
            messages::VehicleOperatingModeReport {
                select_flight_path_control_mode: Some(FlightPathControlMode::Loiter),
                ..Default::default()
            }
            .into(),
            "(mode loiter)",
        ),
        (
            messages::UaPositionWaypoint {
                waypoint_number: Some(40),
                ..Default::default()
            }
            .into(),
            "(waypoint 40)",
        ),
        (
            messages::CucsAuthorisationRequest {
                requested_handover_loi: Some(both),
                ..Default::default()
            }
            .into(),
            "(LOI 4 control 5 launch)",
        ),
        (
            messages::VsmAuthorisationResponse {
                loi_granted: Some(LoiBitmap::NONE),
                ..Default::default()
            }
            .into(),
            "(LOI granted none)",
        ),
        (beat(1), "16002 Heartbeat"),
    ];
    let datagrams = cases
        .each_ref()
        .map(|(message, _)| encode(message, ChecksumStyle::None));
    let printed = tshark.run("info", PORT, &datagrams, &[]);
    let lines: Vec<&str> = printed.lines().collect();
    assert_eq!(lines.len(), cases.len(), "{printed}");
    for (line, (_, info)) in lines.iter().zip(&cases) {
        assert!(line.contains(info), "{info}: {line}");
    }
}

#[test]
fn faults_are_expert_warnings_and_never_a_failure_of_the_script() {
    let Some(tshark) = Tshark::find() else { return };
    let good = encode(&position(), ChecksumStyle::Sum16);
    let bare = encode(&position(), ChecksumStyle::None);
    let edited = |bytes: &[u8], at: usize, value: u8| {
        let mut bytes = bytes.to_vec();
        bytes[at] = value;
        bytes
    };
    let mut trailing = bare.clone();
    trailing.extend([0; 2]);
    trailing[3] += 2;
    let cases = [
        ("bad_checksum", edited(&good, 20, 0xEE)),
        ("bad_length", edited(&bare, 2, 0xFF)),
        ("bad_length", edited(&edited(&bare, 2, 0), 3, 0)),
        ("short", edited(&bare, 3, bare[3] + 40)),
        ("short", bare[..9].to_vec()),
        ("unknown_idd", edited(&bare, 14, 12)),
        ("bad_checksum_style", crc_in_edition_3()),
        ("unknown_type", edited(&edited(&bare, 12, 0x1F), 13, 0x40)),
        ("bad_presence", edited(&bare, 16, 0x80)),
        ("short_field", edited(&bare, 18, bare[18] | 0x20)),
        ("trailing_bytes", trailing),
        ("unknown_length", unsized_field()),
        ("oversized", [bare.clone(), vec![0; 600]].concat()),
        ("out_of_range", beyond_the_pole()),
    ];
    let datagrams: Vec<Vec<u8>> = cases.iter().map(|(_, bytes)| bytes.clone()).collect();
    let shown = tshark.dissect("faults", PORT, &datagrams, &[]);
    for ((fault, _), shown) in cases.iter().zip(&shown) {
        let complaints = shown.complaints();
        assert!(
            complaints.iter().any(|c| c == fault),
            "{fault}: {complaints:?}"
        );
    }
    // Any bytes at all: cut, flipped and random.
    let mut random = Random::with_seed(7);
    let noise: Vec<Vec<u8>> = (0..600)
        .map(|round| match round % 3 {
            0 => good[..random.usize(..good.len()) + 1].to_vec(),
            1 => {
                let at = random.usize(..good.len());
                edited(&good, at, random.u8(..))
            }
            _ => (0..random.u64(..80) + 1).map(|_| random.u8(..)).collect(),
        })
        .collect();
    let shown = tshark.dissect("noise", PORT, &noise, &[]);
    assert_eq!(shown.len(), noise.len());
}

#[test]
fn other_ports_are_found_by_what_they_carry_and_nothing_else_is_taken() {
    let Some(tshark) = Tshark::find() else { return };
    let dli = encode(&position(), ChecksumStyle::Crc32);
    let mut wrong = dli.clone();
    wrong[20] ^= 1;
    let datagrams = [dli, wrong, vec![0x55; 40], b"no message at all".to_vec()];
    let shown = tshark.dissect("heuristic", 40_001, &datagrams, &[]);
    let taken: Vec<bool> = shown
        .iter()
        .map(|shown| shown.has("stanag4586.type"))
        .collect();
    assert_eq!(taken, [true, false, false, false]);
    let by_port = ["-o", "stanag4586.ports:40001"];
    let shown = tshark.dissect("preference", 40_001, &datagrams[1..2], &by_port);
    assert_eq!(shown[0].complaints(), ["bad_checksum"]);
}

fn compare(field: &FieldInfo, key: &str, raw: &Value, scaled: &Value, shown: &Shown) {
    match field.wire {
        Wire::Char(_) => assert_eq!(raw.as_str(), shown.text(key), "{key}"),
        Wire::F32 | Wire::F64 => close(key, raw.as_f64().unwrap(), shown.number(key)),
        _ if field.identification => {
            let id = raw.as_i64().unwrap() as u32;
            assert_eq!(f64::from(id), shown.number(key), "{key}");
        }
        _ if field.step() != 1.0 => {
            assert_eq!(raw.as_f64(), Some(shown.number(&format!("{key}.raw"))));
            close(key, scaled.as_f64().unwrap(), shown.number(key));
        }
        wire => {
            // Wireshark shows the wire form of what is printed in hexadecimal.
            let ours = raw.as_i64().unwrap() as f64;
            let theirs = shown.number(key);
            let period = 256_f64.powi(wire.bytes().unwrap() as i32);
            assert!(
                ours == theirs || ours + period == theirs,
                "{key}: {theirs}, expected {ours}"
            );
        }
    }
}

fn close(key: &str, ours: f64, theirs: f64) {
    let tolerance = ours.abs().max(1e-300) * 1e-12;
    assert!(
        (ours - theirs).abs() <= tolerance,
        "{key}: {theirs:?}, expected {ours:?}"
    );
}

/// Raw values of all fields of known length, or of a random choice of them.
fn random_fields(message: &MessageInfo, full: bool, random: &mut Random) -> Map<String, Value> {
    let mut fields = Map::new();
    for field in message.fields {
        if field.wire.bytes().is_none() || !(full || random.bool()) {
            continue;
        }
        let value = match field.wire {
            Wire::F32 => json!(f64::from((random.f64() * 2e6 - 1e6) as f32)),
            Wire::F64 => json!(random.f64() * 2e6 - 1e6),
            Wire::Char(bytes) => {
                let length = random.u64(..u64::from(bytes)) as usize;
                let letter = |_| char::from(b'!' + random.u64(..90) as u8);
                Value::from((0..length).map(letter).collect::<String>())
            }
            wire => {
                let (low, high) = wire.integers().unwrap();
                let span = (high - low) as u64 + 1;
                json!(low + random.u64(..span) as i64)
            }
        };
        fields.insert(field.name.to_owned(), value);
    }
    fields
}

/// A message in hexadecimal.
fn random_message(message: &MessageInfo, full: bool, checksum: u8, random: &mut Random) -> String {
    let line = json!({
        "id": message.id,
        "source": random.u32(..),
        "destination": random.u32(..),
        "ack": random.bool(),
        "idd": if checksum == 3 { 32 } else { 30 + random.u64(..3) },
        "checksum": checksum,
        "fields": random_fields(message, full, random),
    });
    encode_line(&line.to_string(), true).unwrap()
}

fn only(mut values: Vec<Value>) -> Value {
    assert_eq!(values.len(), 1);
    values.remove(0)
}

fn encode(message: &Message, checksum: ChecksumStyle) -> Vec<u8> {
    let envelope = Envelope::new(Id(0x1b00_0101), Id(0x1b00_00a0)).summed(checksum);
    let mut out = [0; stanag_msgs::MAX_DATAGRAM];
    let length = message.encode(&envelope, &mut out).unwrap();
    out[..length].to_vec()
}

fn beat(stamp: u64) -> Message {
    Message::from(messages::Heartbeat {
        time_stamp: Some(TimeStamp(stamp)),
    })
}

fn position() -> Message {
    Message::from(messages::InertialStates {
        time_stamp: Some(TimeStamp(848_000_000_123)),
        latitude: Some(Bam32::from_degrees(47.397_743_4)),
        longitude: Some(Bam32::from_degrees(8.545_593_9)),
        ..Default::default()
    })
}

fn beyond_the_pole() -> Vec<u8> {
    let message = Message::from(messages::InertialStates {
        latitude: Some(Bam32::from_degrees(91.0)),
        ..Default::default()
    });
    encode(&message, ChecksumStyle::None)
}

fn crc_in_edition_3() -> Vec<u8> {
    let mut bytes = encode(&beat(1), ChecksumStyle::Crc32);
    bytes[14] = 30;
    bytes
}

/// 42003 with its Name, whose length no source gives.
fn unsized_field() -> Vec<u8> {
    let message = Message::from(messages::ReportControllableElementMessage {
        controllable_element_id: Some(1),
        ..Default::default()
    });
    let mut bytes = encode(&message, ChecksumStyle::None);
    bytes[16] |= 0b100;
    bytes.push(b'x');
    bytes[3] += 1;
    bytes
}

/// As the dissector names a message.
fn snake(name: &str) -> String {
    let mut snake = String::new();
    for character in name.chars() {
        if character.is_uppercase() && !snake.is_empty() {
            snake.push('_');
        }
        snake.extend(character.to_lowercase());
    }
    snake
}

/// What tshark shows of one packet: the values of each field, in order.
struct Shown(BTreeMap<String, Vec<String>>);

impl Shown {
    fn gather(&mut self, value: &Value) {
        match value {
            Value::Object(object) => {
                for (key, value) in object {
                    match value {
                        Value::Array(all) => all.iter().for_each(|one| self.take(key, one)),
                        one => self.take(key, one),
                    }
                }
            }
            Value::Array(all) => all.iter().for_each(|one| self.gather(one)),
            _ => {}
        }
    }

    fn take(&mut self, key: &str, value: &Value) {
        match value {
            Value::String(text) => {
                self.0.entry(key.to_owned()).or_default().push(text.clone());
            }
            other => {
                // An item that stands for nothing but its expert information.
                self.0.entry(key.to_owned()).or_default();
                self.gather(other);
            }
        }
    }

    fn has(&self, key: &str) -> bool {
        self.0.contains_key(key)
    }

    fn texts(&self, key: &str) -> Vec<&str> {
        let found = self.0.get(key).map(Vec::as_slice).unwrap_or_default();
        found.iter().map(String::as_str).collect()
    }

    fn text(&self, key: &str) -> Option<&str> {
        self.texts(key).first().copied()
    }

    fn number(&self, key: &str) -> f64 {
        let text = self
            .text(key)
            .unwrap_or_else(|| panic!("{key} is not shown: {:?}", self.0));
        let number = match text.strip_prefix("0x") {
            Some(hex) => u64::from_str_radix(hex, 16)
                .ok()
                .map(|number| number as f64),
            None => text.parse().ok(),
        };
        number.unwrap_or_else(|| panic!("{key}: {text:?} is no number"))
    }

    /// The expert warnings of this protocol.
    fn complaints(&self) -> Vec<String> {
        FAULTS
            .iter()
            .filter(|fault| self.has(&format!("stanag4586.{fault}")))
            .map(|fault| (*fault).to_owned())
            .collect()
    }
}

const FAULTS: &[&str] = &[
    "oversized",
    "short",
    "bad_length",
    "unknown_idd",
    "bad_checksum_style",
    "bad_checksum",
    "unknown_type",
    "bad_presence",
    "short_field",
    "unknown_length",
    "trailing_bytes",
    "out_of_range",
];

struct Tshark {
    script: PathBuf,
    folder: tempfile::TempDir,
}

impl Tshark {
    /// `None` where tshark is missing.
    fn find() -> Option<Tshark> {
        if !tools::is_installed("tshark") {
            return None;
        }
        Some(Tshark {
            script: kit::workspace().join("packaging/wireshark/stanag4586.lua"),
            folder: tempfile::tempdir().unwrap(),
        })
    }

    /// What is shown of each datagram, sent to this UDP port. The script must not have failed.
    fn dissect(
        &self,
        name: &str,
        port: u16,
        datagrams: &[Vec<u8>],
        options: &[&str],
    ) -> Vec<Shown> {
        let json = ["-T", "json", "--no-duplicate-keys"];
        let text = self.run(name, port, datagrams, &[&json, options].concat());
        let packets: Value = serde_json::from_str(&text).unwrap();
        packets
            .as_array()
            .unwrap()
            .iter()
            .map(|packet| {
                let mut shown = Shown(BTreeMap::new());
                shown.gather(&packet["_source"]["layers"]);
                shown
            })
            .collect()
    }
}

impl Tshark {
    /// What tshark prints of datagrams sent to this UDP port. The script must not have failed.
    fn run(&self, name: &str, port: u16, datagrams: &[Vec<u8>], options: &[&str]) -> String {
        let capture = self.folder.path().join(format!("{name}.pcap"));
        std::fs::write(&capture, pcap(port, datagrams)).unwrap();
        let output = Command::new("tshark")
            .arg("-X")
            .arg(format!("lua_script:{}", self.script.display()))
            .arg("-r")
            .arg(&capture)
            .args(options)
            // Neither profile nor plugins of whoever runs this.
            .env("HOME", self.folder.path())
            .env("XDG_CONFIG_HOME", self.folder.path())
            .output()
            .unwrap();
        let printed = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{printed}");
        let text = String::from_utf8(output.stdout).unwrap();
        for failure in [
            "Lua Error",
            "Malformed Packet",
            "_ws.malformed",
            "_ws.lua.error",
        ] {
            assert!(
                !text.contains(failure) && !printed.contains(failure),
                "{printed}\n{text}"
            );
        }
        text
    }
}

/// A capture of UDP datagrams over IPv4, one a millisecond.
fn pcap(port: u16, datagrams: &[Vec<u8>]) -> Vec<u8> {
    const LINK_IPV4: u32 = 228;
    let mut file = Vec::new();
    for word in [0xa1b2_c3d4, 0x0002_0004, 0, 0, 65_535, LINK_IPV4] {
        file.extend(u32::to_be_bytes(word));
    }
    for (number, data) in (0u32..).zip(datagrams) {
        let length = 28 + data.len() as u32;
        for word in [number / 1000, number % 1000 * 1000, length, length] {
            file.extend(word.to_be_bytes());
        }
        file.extend([0x45, 0]);
        file.extend((length as u16).to_be_bytes());
        file.extend([0, 0, 0x40, 0, 64, 17, 0, 0]);
        file.extend(Ipv4Addr::new(127, 0, 0, 1).octets());
        file.extend(Ipv4Addr::new(127, 0, 0, 1).octets());
        for word in [50_000, port, length as u16 - 20, 0] {
            file.extend(word.to_be_bytes());
        }
        file.extend(data);
    }
    file
}

const PORT: u16 = 4586;
