//! `curve-plan` as its users meet it: contract, files, errors, exit statuses.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use serde_json::Value;
use stanag_msgs::Message;
use tempfile::TempDir;

const ROUTE: &str = r#"id = "bend & climb"

[defaults]
altitude_type = "amsl"

[[waypoint]]
number = 10
latitude = 47.3977434
longitude = 8.5455939
altitude = 500.0

[[waypoint]]
number = 20
latitude = 47.3990
longitude = 8.5470
altitude = 510.0

[[waypoint]]
number = 30
latitude = 47.3975
longitude = 8.5490
altitude = 540.0

[[curve]]
from = 20
to = 30
p2 = [47.4000, 8.5482, 515.0]
p3 = [47.3985, 8.5510, 560.0]
altitude_type = "amsl"
"#;

struct Files(TempDir);

impl Files {
    fn new() -> Self {
        let files = Self(TempDir::new().unwrap());
        files.put("route.toml", ROUTE);
        files
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn put(&self, name: &str, text: &str) -> PathBuf {
        std::fs::write(self.path(name), text).unwrap();
        self.path(name)
    }

    fn get(&self, name: &str) -> String {
        std::fs::read_to_string(self.path(name)).unwrap()
    }

    fn run(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_curve-plan"))
            .args(arguments)
            .current_dir(self.0.path())
            .output()
            .unwrap()
    }

    fn done(&self, arguments: &[&str]) -> String {
        let output = self.run(arguments);
        assert!(
            output.status.success(),
            "{arguments:?}: {}",
            String::from_utf8_lossy(&output.stderr)
        );
        String::from_utf8(output.stdout).unwrap()
    }

    fn json(&self, arguments: &[&str]) -> Value {
        serde_json::from_str(&self.done(arguments)).unwrap()
    }

    /// The exit status and what was said on standard error.
    fn refused(&self, arguments: &[&str]) -> (i32, String) {
        let output = self.run(arguments);
        assert!(
            output.stdout.is_empty(),
            "{}",
            String::from_utf8_lossy(&output.stdout)
        );
        (
            output.status.code().unwrap(),
            String::from_utf8(output.stderr).unwrap(),
        )
    }
}

fn everland(files: &Files) {
    let packed =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/data/curves/everland-laps.csv.gz");
    let mut text = String::new();
    flate2::read::GzDecoder::new(std::fs::File::open(packed).unwrap())
        .read_to_string(&mut text)
        .unwrap();
    files.put("laps.csv", &text);
}

#[test]
fn compare_prints_the_figures_and_the_legs() {
    let files = Files::new();
    everland(&files);
    let track = [
        "compare",
        "laps.csv",
        "--lap",
        "1",
        "--every",
        "2",
        "--closed",
        "--tolerance",
        "10",
    ];
    let rows = files.json(&[&track[..], &["--json"]].concat());
    let row = &rows[0];
    let keys: Vec<_> = row
        .as_object()
        .unwrap()
        .keys()
        .map(String::as_str)
        .collect();
    assert_eq!(
        keys,
        [
            "tolerance_m",
            "straight",
            "cubic",
            "octets_straight",
            "octets_cubic",
            "deviation_m",
            "legs"
        ]
    );
    assert_eq!(row["straight"], 32);
    let cubic = row["cubic"].as_u64().unwrap();
    assert!(cubic <= 8);
    assert!(row["deviation_m"].as_f64().unwrap() <= 10.0);
    let legs = row["legs"].as_array().unwrap();
    assert_eq!(legs.len() as u64, cubic);
    for (k, leg) in legs.iter().enumerate() {
        assert_eq!(leg.as_array().unwrap().len(), 4);
        assert_eq!(leg[3], legs[(k + 1) % legs.len()][0]);
    }
    assert_eq!(row["octets_straight"], 32 * 59);
    assert_eq!(row["octets_cubic"].as_u64().unwrap(), cubic * (59 + 53));
    assert!(files.done(&track).contains("items flown"));
}

#[test]
fn every_format_brings_the_vertices_back() {
    let files = Files::new();
    let wanted = files.json(&["densify", "route.toml", "--json"]);
    let vertices = wanted["vertices"].as_array().unwrap();
    assert!(vertices.len() > 10);
    for ending in ["plan", "waypoints", "geojson", "kml", "gpx", "csv"] {
        let name = format!("out.{ending}");
        files.done(&["densify", "route.toml", "-o", &name]);
        let read = files.json(&["densify", &name, "--json"]);
        let found = read["vertices"].as_array().unwrap();
        assert_eq!(found.len(), vertices.len(), "{ending}");
        for (a, b) in vertices.iter().zip(found) {
            let off = |key: &str| (a[key].as_f64().unwrap() - b[key].as_f64().unwrap()).abs();
            assert!(
                off("lat_deg") < 6e-8 && off("lon_deg") < 6e-8 && off("alt_m") < 6e-4,
                "{ending} {a} {b}"
            );
        }
    }
}

#[test]
fn the_route_file_keeps_curves() {
    let files = Files::new();
    files.done(&["convert", "route.toml", "again.toml"]);
    files.done(&["convert", "again.toml", "third.toml"]);
    assert_eq!(files.get("again.toml"), files.get("third.toml"));
    assert_eq!(
        files.json(&["densify", "again.toml", "--json"]),
        files.json(&["densify", "route.toml", "--json"])
    );
}

#[test]
fn a_budget_and_free_vertices_save_items() {
    let files = Files::new();
    let items = |more: &[&str]| {
        let report = files.json(&[&["densify", "route.toml", "--json"], more].concat());
        assert!(report["bound_m"].as_f64().unwrap() <= report["tolerance_m"].as_f64().unwrap());
        report["items"].as_u64().unwrap()
    };
    let plain = items(&[]);
    assert!(items(&["--free"]) < plain);
    assert!(items(&["--max-items", "7"]) <= 7);
    let (status, said) = files.refused(&["densify", "route.toml", "--max-items", "2"]);
    assert_eq!(status, 1);
    assert!(said.contains("the ends of the legs alone are 3"), "{said}");
}

#[test]
fn errors_name_the_file_the_line_and_the_field() {
    let files = Files::new();
    let says = |name: &str, text: &str, expected: &str| {
        files.put(name, text);
        let (status, said) = files.refused(&["densify", name]);
        assert_eq!(status, 2, "{said}");
        assert!(said.contains(expected), "{said:?}, expected {expected:?}");
    };
    says(
        "a.toml",
        &ROUTE.replace("latitude = 47.3990", "latitude = \"x\""),
        "a.toml:14: latitude: ",
    );
    says(
        "b.toml",
        &ROUTE.replace("latitude = 47.3990", "lat = 47.3990"),
        "unknown field `lat`",
    );
    says(
        "c.toml",
        &ROUTE.replace("latitude = 47.3990", "latitude = nan"),
        "c.toml:14: waypoint 20: latitude: NaN, expected -90",
    );
    says(
        "d.toml",
        &ROUTE.replace("p2 = [47.4000", "p2 = [48.4"),
        "d.toml:13: leg from waypoint 20: P2 is 1",
    );
    says(
        "n.toml",
        &ROUTE.replace("to = 30", "to = 10"),
        "n.toml:25: curve: no leg leads from 20 to 10",
    );
    says(
        "o.toml",
        &ROUTE.replacen("altitude = 510.0", "altitude = 510.0\nnext = 40", 1),
        "o.toml:13: waypoint 20: next: 40, expected the number",
    );
    says(
        "p.toml",
        &ROUTE.replace(
            "altitude = 510.0",
            "altitude = 51.0\naltitude_type = \"agl\"",
        ),
        "p.toml:13: waypoint 20: altitude_type",
    );
    says(
        "e.csv",
        "lat,lon\n47.0,8.0\n47.1,abc\n",
        "e.csv:3: lon: \"abc\", expected a number",
    );
    says("f.csv", "x,y\n1,2\n", "f.csv:1: lat_deg: no such column");
    says(
        "g.waypoints",
        "QGC WPL 110\n0 1 0 16 0 0 0 0 47 8 500 1\n1 0 11 16 0 0 0 0 47 8 5 1\n",
        "g.waypoints:3: frame: 11",
    );
    says(
        "h.gpx",
        "<gpx>\n<rte>\n<rtept lat=\"47\" lon=\"?\"/>\n</rte></gpx>",
        "h.gpx:3: rtept lon",
    );
    says(
        "i.kml",
        "<kml><LineString>\n<coordinates>8,47,1 8</coordinates></LineString></kml>",
        "i.kml:2: coordinates: \"8\"",
    );
    says(
        "j.geojson",
        "{\"type\":\"LineString\",\"coordinates\":[[8,47],\n[8,\"b\"]]}",
        "j.geojson:2: .coordinates[1]: ",
    );
    says(
        "k.plan",
        "{\"fileType\":\"Plan\",\"mission\":{\"items\":[\n{\n\"type\":\"ComplexItem\"}]}}",
        "k.plan:3: mission.items[0].type: \"ComplexItem\", expected",
    );
    says("l.plan", "{\"fileType\":\n\"Plan\",", "l.plan:2");
    says("m.txt", "", "unknown ending");
    let (status, said) = files.refused(&["densify", "missing.toml"]);
    assert!(status == 2 && said.contains("missing.toml"), "{said}");
}

#[test]
fn relative_items_among_others_get_the_home_altitude_and_items_without_a_place_are_left_out() {
    let files = Files::new();
    files.put(
        "m.waypoints",
        "QGC WPL 110\n0 1 0 16 0 0 0 0 47 8 500 1\n1 0 3 16 0 0 0 0 47.001 8 20 1\n2 0 3 178 0 5 0 0 0 0 0 1\n3 0 0 16 0 0 0 0 47.002 8 530 1\n",
    );
    let report = files.json(&["densify", "m.waypoints", "--json"]);
    let altitudes: Vec<_> = report["vertices"]
        .as_array()
        .unwrap()
        .iter()
        .map(|v| v["alt_m"].clone())
        .collect();
    assert_eq!(altitudes, [520.0, 530.0]);
    assert!(
        files
            .done(&["convert", "m.waypoints", "m.csv"])
            .starts_with("1 items")
    );
}

#[test]
fn check_finds_the_tight_place_and_refuses_when_told_to() {
    let files = Files::new();
    let report = files.json(&[
        "check",
        "route.toml",
        "--speed",
        "30",
        "--airframe",
        "plane",
        "--slowest",
        "5",
        "--json",
    ]);
    let fastest = report["fastest_mps"].as_f64().unwrap();
    assert!(
        fastest < 30.0 && !report["changes"].as_array().unwrap().is_empty(),
        "{report}"
    );
    assert_eq!(report["tight"][0]["leg"], 1);
    let (status, said) = files.refused(&[
        "check",
        "route.toml",
        "--speed",
        "30",
        "--airframe",
        "plane",
        "--policy",
        "refuse",
    ]);
    assert_eq!(status, 1);
    assert!(
        said.contains("leg 1 at t = ") && said.contains("at most"),
        "{said}"
    );
    assert!(
        files
            .done(&["check", "route.toml"])
            .contains("predicted and not promised")
    );
    assert_eq!(files.refused(&["check", "route.toml", "--bank", "90"]).0, 2);
}

#[test]
fn fit_writes_a_route_that_can_be_flown() {
    let files = Files::new();
    files.done(&[
        "densify",
        "route.toml",
        "--tolerance",
        "0.2",
        "-o",
        "track.csv",
    ]);
    let report = files.json(&[
        "fit",
        "track.csv",
        "--tolerance",
        "1",
        "--g1",
        "-o",
        "fit.toml",
        "--json",
    ]);
    assert!(report["deviation_m"].as_f64().unwrap() <= 1.0);
    assert!(
        report["legs"].as_array().unwrap().len() <= 3,
        "{}",
        report["legs"]
    );
    assert!(
        files
            .done(&["densify", "fit.toml"])
            .contains("proven within")
    );
}

#[test]
fn pictures_are_well_formed_and_fetch_nothing() {
    let files = Files::new();
    for (name, elements) in [("a.svg", 50), ("a.html", 50)] {
        files.done(&["plot", "route.toml", "-o", name]);
        let text = files.get(name);
        assert!(text.contains("bend &amp; climb") && text.contains("altitude, m"));
        assert!(!text.contains("src=") && !text.contains("href=") && !text.contains("url("));
        let start = text.find("<svg").unwrap();
        let end = text.find("</svg>").unwrap() + 6;
        let mut reader = quick_xml::Reader::from_str(&text[start..end]);
        let mut found = 0;
        loop {
            match reader.read_event().unwrap() {
                quick_xml::events::Event::Eof => break,
                quick_xml::events::Event::Empty(_) => found += 1,
                _ => {}
            }
        }
        assert!(found > elements, "{found}");
        assert!(!text.contains("NaN") && !text.contains("inf"), "{name}");
    }
    assert_eq!(files.refused(&["plot", "route.toml", "-o", "a.bmp"]).0, 2);
}

#[test]
fn heights_above_home_stay_so_where_the_format_can_say_it() {
    let files = Files::new();
    let low = ROUTE
        .replace("amsl", "agl")
        .replace("= 5", "= 1")
        .replace(", 5", ", 1");
    files.put("low.toml", &low);
    let wanted = files.json(&["densify", "low.toml", "--json"]);
    for ending in ["toml", "plan", "waypoints", "geojson", "kml", "csv"] {
        let (there, back) = (format!("low.out.{ending}"), format!("{ending}.back.toml"));
        files.done(&["densify", "low.toml", "-o", &there]);
        files.done(&["convert", &there, &back]);
        assert!(
            files.get(&back).contains("altitude_type = \"agl\""),
            "{ending}"
        );
        let found = files.json(&["densify", &back, "--json"]);
        let last = |report: &Value| {
            report["vertices"].as_array().unwrap().last().unwrap()["alt_m"].as_f64()
        };
        assert_eq!(last(&found), last(&wanted), "{ending}");
    }
    let (status, said) = files.refused(&["densify", "low.toml", "-o", "low.gpx"]);
    assert!(status == 2 && said.contains("give --home-alt"), "{said}");
    files.done(&["densify", "low.toml", "--home-alt", "400", "-o", "low.gpx"]);
    let altitude = files.json(&["densify", "low.gpx", "--json"])["vertices"][0]["alt_m"].as_f64();
    assert_eq!(altitude, Some(500.0));
    files.put(
        "unsaid.toml",
        &ROUTE.replace("altitude_type = \"amsl\"", ""),
    );
    let (status, said) = files.refused(&["densify", "unsaid.toml", "-o", "unsaid.csv"]);
    assert!(status == 2 && said.contains("no altitude_type"), "{said}");
}

#[test]
fn a_closed_fit_comes_back_to_its_first_waypoint() {
    let files = Files::new();
    let mut track = String::from("lat,lon,height_m\n");
    for k in 0..72 {
        let (s, c) = (f64::from(k) * 5.0).to_radians().sin_cos();
        track += &format!("{},{},30\n", 47.0 + 0.001 * c, 8.0 + 0.0015 * s);
    }
    files.put("circle.csv", &track);
    files.done(&["fit", "circle.csv", "--closed", "-o", "circle.toml"]);
    let report = files.json(&["densify", "circle.toml", "--json"]);
    let vertices = report["vertices"].as_array().unwrap();
    let (first, last) = (&vertices[0], vertices.last().unwrap());
    assert_eq!(
        (&first["lat_deg"], &first["lon_deg"]),
        (&last["lat_deg"], &last["lon_deg"])
    );
    assert!(report["legs"].as_u64().unwrap() >= 2);
}

#[test]
fn a_loop_leads_back_once() {
    let files = Files::new();
    let round = ROUTE.replace(
        "altitude = 540.0",
        "altitude = 540.0\nnext = 20\nloop = { limit = 3 }",
    );
    files.put("round.toml", &round);
    let report = files.json(&["densify", "round.toml", "--json"]);
    assert_eq!(report["legs"], 3);
    let last = report["vertices"].as_array().unwrap().last().unwrap();
    assert_eq!(last["lat_deg"], 47.399);
}

#[test]
fn the_messages_are_those_that_a_ground_station_sends() {
    let files = Files::new();
    files.done(&[
        "convert",
        "route.toml",
        "route.hex",
        "--vehicle",
        "1b:00:01:02",
    ]);
    let text = files.get("route.hex");
    let mut kinds = Vec::new();
    let mut stamp = 0;
    for line in text.lines() {
        let digits: Vec<u8> = line.bytes().collect();
        let bytes: Vec<u8> = digits
            .chunks(2)
            .map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap())
            .collect();
        let frame = stanag_msgs::frames(&bytes).next().unwrap().unwrap();
        let header = frame.header;
        assert_eq!(
            (header.source.to_string(), header.destination.to_string()),
            ("1b:00:00:a0".into(), "1b:00:01:02".into())
        );
        assert!(header.ack_requested);
        match Message::decode(header.message_type, frame.data).unwrap() {
            Message::UaPositionWaypoint(w) => {
                kinds.push(format!(
                    "13002 {} to {}",
                    w.waypoint_number.unwrap(),
                    w.next_waypoint.unwrap()
                ));
                assert!(w.time_stamp.unwrap().0 > stamp);
                stamp = w.time_stamp.unwrap().0;
            }
            Message::CurveSegment(c) => {
                kinds.push(format!(
                    "50002 {} to {}",
                    c.p1_waypoint_no.unwrap(),
                    c.p4_waypoint_no.unwrap()
                ));
                assert_eq!(c.p3_altitude.map(|m| m.si()), Some(560.0));
                assert!((c.p2_latitude.unwrap().degrees() - 47.4).abs() < 1e-7);
            }
            other => kinds.push(other.id().to_string()),
        }
    }
    let wanted = [
        "13001",
        "13002 10 to 20",
        "13002 20 to 30",
        "13002 30 to 0",
        "50002 20 to 30",
        "13000",
    ];
    assert_eq!(kinds, wanted);
    files.done(&["convert", "route.toml", "route.pcapng"]);
    let capture = std::fs::read(files.path("route.pcapng")).unwrap();
    assert_eq!(&capture[..4], [0x0a, 0x0d, 0x0d, 0x0a]);
    let (status, said) = files.refused(&["densify", "route.hex"]);
    assert!(status == 2 && said.contains("written, not read"), "{said}");
}

#[test]
fn a_png_shows_the_curve_and_its_letters() {
    let files = Files::new();
    files.done(&["plot", "route.toml", "-o", "a.png", "--width", "600"]);
    let file = std::fs::File::open(files.path("a.png")).unwrap();
    let mut reader = png::Decoder::new(std::io::BufReader::new(file))
        .read_info()
        .unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut pixels).unwrap();
    assert_eq!(info.width, 600);
    let dark = |rows: std::ops::Range<usize>| {
        let row = info.width as usize * 4;
        pixels[rows.start * row..rows.end * row]
            .chunks(4)
            .filter(|p| p[0] < 120)
            .count()
    };
    // The title's letters, in the first 18 rows at this scale.
    assert!(dark(0..18) > 60, "{}", dark(0..18));
    assert!(dark(60..300) > 500);
}

/// A .tlog record of a MAVLink 1 GLOBAL_POSITION_INT.
fn record(lat_deg: f64, lon_deg: f64, alt_m: f64) -> Vec<u8> {
    let mut frame = vec![0xfe, 28, 0, 1, 1, 33];
    let numbers = [1_000.0, lat_deg * 1e7, lon_deg * 1e7, alt_m * 1e3];
    frame.extend(numbers.map(|x| (x.round() as i32).to_le_bytes()).concat());
    frame.resize(6 + 28, 0);
    let crc = frame[1..].iter().chain([&104]).fold(0xffff_u16, |crc, &b| {
        let mut t = b ^ (crc & 0xff) as u8;
        t ^= t << 4;
        let t = u16::from(t);
        (crc >> 8) ^ (t << 8) ^ (t << 3) ^ (t >> 4)
    });
    frame.extend(crc.to_le_bytes());
    [vec![0; 8], frame].concat()
}

#[test]
fn check_measures_a_recorded_flight() {
    let files = Files::new();
    let flat = ROUTE.replace("510.0", "500.0").replace("540.0", "500.0");
    files.put(
        "flat.toml",
        &flat.replace(", 515.0", "").replace(", 560.0", ""),
    );
    let fine = files.json(&[
        "densify",
        "flat.toml",
        "--tolerance",
        "0.05",
        "--min-chord",
        "0",
        "--json",
    ]);
    let mut log = Vec::new();
    for v in fine["vertices"].as_array().unwrap() {
        // 0.7 m to the north of it, and its height above another datum.
        let lat = v["lat_deg"].as_f64().unwrap() + 0.7 / 111_180.0;
        log.extend(record(lat, v["lon_deg"].as_f64().unwrap(), 12.0));
    }
    std::fs::write(files.path("flight.tlog"), &log).unwrap();
    let report = files.json(&["check", "flat.toml", "--flown", "flight.tlog", "--json"]);
    let off = report["flown"]["deviation_m"].as_f64().unwrap();
    assert!((0.6..0.76).contains(&off), "{report}");
    assert_eq!(report["flown"]["passed"], report["flown"]["points"]);
    assert!(
        files
            .done(&["check", "flat.toml", "--flown", "flight.tlog"])
            .contains("passed within 3 m")
    );
    std::fs::write(files.path("half.tlog"), &log[..log.len() / 2]).unwrap();
    assert_eq!(
        files
            .refused(&["check", "flat.toml", "--flown", "half.tlog"])
            .0,
        1
    );
    files.put("empty.tlog", "");
    assert_eq!(
        files
            .refused(&["check", "flat.toml", "--flown", "empty.tlog"])
            .0,
        2
    );
}
