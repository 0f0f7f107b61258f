//! File formats: what is written can be read again, and what cannot be kept is refused.

use serde_json::Value;
use stanag_msgs::Message;

use crate::{Files, ROUTE};

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
fn the_output_is_named_either_way_by_every_command_that_writes_one() {
    let command = curve_plan::command();
    let writing: Vec<_> = command
        .get_subcommands()
        .filter(|one| one.get_arguments().any(|a| a.get_long() == Some("output")))
        .map(|one| one.get_name().to_owned())
        .collect();
    assert_eq!(writing, ["densify", "fit", "plot", "convert", "rally"]);
    let files = Files::new();
    // `rally` reads a fence file: exchange.rs has its outputs.
    for name in writing.iter().filter(|name| *name != "rally") {
        let (input, ending) = match name.as_str() {
            // A fit is made of a track.
            "fit" => ("track.csv", "toml"),
            "plot" => ("route.toml", "svg"),
            _ => ("route.toml", "csv"),
        };
        if input == "track.csv" {
            files.done(&["convert", "route.toml", input]);
        }
        let out = |form: &str| format!("{name}-{form}.{ending}");
        files.done(&[name, input, &out("bare")]);
        files.done(&[name, input, "-o", &out("short")]);
        files.done(&[name, input, "--output", &out("long")]);
        assert_eq!(files.get(&out("bare")), files.get(&out("short")), "{name}");
        assert_eq!(files.get(&out("bare")), files.get(&out("long")), "{name}");
        let (status, printed) = files.refused(&[name, input, "a.svg", "-o", "b.svg"]);
        assert_eq!(status, 2, "{printed}");
    }
    for name in ["plot", "convert"] {
        let (status, printed) = files.refused(&[name, "route.toml"]);
        assert!(status == 2 && printed.contains("OUTPUT"), "{printed}");
    }
}

#[test]
fn heights_above_home_are_kept_where_the_format_has_them() {
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
    let (status, printed) = files.refused(&["densify", "low.toml", "-o", "low.gpx"]);
    assert!(
        status == 2 && printed.contains("give --home-alt"),
        "{printed}"
    );
    files.done(&["densify", "low.toml", "--home-alt", "400", "-o", "low.gpx"]);
    let altitude = files.json(&["densify", "low.gpx", "--json"])["vertices"][0]["alt_m"].as_f64();
    assert_eq!(altitude, Some(500.0));
    files.put(
        "unstated.toml",
        &ROUTE.replace("altitude_type = \"amsl\"", ""),
    );
    let (status, printed) = files.refused(&["densify", "unstated.toml", "-o", "unstated.csv"]);
    assert!(
        status == 2 && printed.contains("no altitude_type"),
        "{printed}"
    );
}

#[test]
fn the_fence_that_messages_lack_is_sent_from_the_file_that_has_it() {
    let files = Files::new();
    let fence = "\n[[area]]\nkeep = \"in\"\ncentre = [47.398, 8.547]\nradius = 500.0\n";
    files.put("fenced.toml", &format!("{ROUTE}{fence}"));
    for out in ["o.hex", "o.pcapng"] {
        let output = files.run(&["convert", "fenced.toml", out]);
        let printed = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "{printed}");
        assert!(
            printed.contains("(send it with \"cucs fence fenced.toml\")"),
            "{printed}"
        );
    }
}

#[test]
fn a_speed_that_no_waypoint_can_have_is_not_written() {
    let files = Files::new();
    for speed in ["inf", "1e9"] {
        files.put(
            "fast.waypoints",
            &format!(
                "QGC WPL 110\n0 1 0 16 0 0 0 0 47.4 8.5 500 1\n1 0 3 16 0 0 0 0 47.4 8.501 20 1\n\
                 2 0 3 178 1 {speed} -1 0 0 0 0 1\n3 0 3 16 0 0 0 0 47.4 8.502 20 1\n"
            ),
        );
        let (status, printed) = files.refused(&["convert", "fast.waypoints", "fast.toml"]);
        assert!(
            status == 2 && printed.contains("fast.toml: waypoint 20: speed: "),
            "{printed}"
        );
        assert!(!files.path("fast.toml").exists());
    }
}

#[test]
fn pressure_altitudes_are_not_those_above_sea_level() {
    let files = Files::new();
    let pressure = ROUTE.replace("amsl", "pressure");
    files.put("press.toml", &pressure);
    for ending in ["plan", "waypoints", "geojson", "kml", "csv", "gpx"] {
        let out = format!("press.{ending}");
        let (status, printed) = files.refused(&["densify", "press.toml", "-o", &out]);
        assert!(
            status == 2 && printed.contains("has pressure altitudes"),
            "{printed}"
        );
        assert!(!files.path(&out).exists());
    }
    files.done(&["convert", "press.toml", "again.toml"]);
    assert!(
        files
            .get("again.toml")
            .contains("altitude_type = \"pressure\"")
    );
    let report = files.done(&["check", "press.toml", "--home", "47.4,8.5,480"]);
    assert!(report.contains("heights: not compared"), "{report}");
    let mixed = ROUTE.replace(
        "altitude = 510.0",
        "altitude = 510.0\naltitude_type = \"pressure\"",
    );
    files.put("mixed.toml", &mixed);
    let (status, printed) = files.refused(&["densify", "mixed.toml"]);
    assert!(
        status == 2 && printed.contains("mixed.toml:13: waypoint 20: altitude_type: another"),
        "{printed}"
    );
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
    let (status, printed) = files.refused(&["densify", "route.hex"]);
    assert!(
        status == 2 && printed.contains("written, not read"),
        "{printed}"
    );
}

/// Files whose altitudes are absent, or on the ground; with the line, and the point, that is named.
const WITHOUT_ALTITUDES: [(&str, &str, &str); 12] = [
    (
        "a.kml",
        "<kml><LineString><coordinates>8,47,10 8.01,47,10</coordinates></LineString></kml>",
        "a.kml:1: point 1: its altitude is the ground's",
    ),
    (
        "b.kml",
        "<kml><LineString><coordinates>8,47,10 8.01,47,10</coordinates>\n<altitudeMode>clampToGround</altitudeMode></LineString></kml>",
        "b.kml:1: point 1: its altitude is the ground's",
    ),
    (
        "c.kml",
        "<kml><LineString><altitudeMode>absolute</altitudeMode><coordinates>\n8,47,510\n8.01,47</coordinates></LineString></kml>",
        "point 2: no altitude",
    ),
    (
        "d.kml",
        "<kml><Point><altitudeMode>absolute</altitudeMode><coordinates>8,47,510</coordinates></Point>\n<Point><coordinates>8.01,47,510</coordinates></Point></kml>",
        "d.kml:2: point 2: its altitude is the ground's",
    ),
    (
        "e.gpx",
        "<gpx><rte><rtept lat=\"47\" lon=\"8\"/><rtept lat=\"47\" lon=\"8.01\"/></rte></gpx>",
        "e.gpx:1: point 1: no altitude",
    ),
    (
        "f.gpx",
        "<gpx><rte><rtept lat=\"47\" lon=\"8\"><ele>510</ele></rtept>\n<rtept lat=\"47\" lon=\"8.01\"><ele/></rtept></rte></gpx>",
        "f.gpx:2: point 2: no altitude",
    ),
    (
        "g.geojson",
        "{\"type\":\"LineString\",\"coordinates\":[[8,47,510],\n[8.01,47]]}",
        "point 2: no altitude",
    ),
    (
        "h.csv",
        "lat,lon,alt\n47,8,\n47,8.01,510\n",
        "h.csv:2: point 1: no altitude",
    ),
    (
        "i.csv",
        "lat,lon,alt\n47,8,510\n47,8.01,\n",
        "i.csv:3: point 2: no altitude",
    ),
    (
        "j.csv",
        "lat,lon\n47,8\n47,8.01\n",
        "j.csv:2: point 1: no altitude",
    ),
    (
        "k.csv",
        "lat,lon,elevation_m\n47,8,488\n47,8.01,490\n",
        "k.csv:2: point 1: its altitude is the ground's",
    ),
    (
        "l.csv",
        "lat,lon,height_m\n47,8,\n47,8.01,30\n",
        "l.csv:2: point 1: no altitude",
    ),
];

#[test]
fn an_absent_altitude_is_never_a_number() {
    let files = Files::new();
    for (name, text, expected) in WITHOUT_ALTITUDES {
        files.put(name, text);
        for command in [
            &["densify", name] as &[&str],
            &["check", name],
            &["convert", name, "out.toml"],
            &["fit", name, "-o", "out.toml"],
            &["plot", name, "-o", "out.svg"],
            &["send", name, "--vsm", "127.0.0.1:9"],
        ] {
            let (status, printed) = files.refused(command);
            assert!(
                status == 2 && printed.contains(expected),
                "{command:?}: {printed}"
            );
            assert!(printed.contains("--altitude or --height"), "{printed}");
            assert!(!files.path("out.toml").exists() && !files.path("out.svg").exists());
        }
        for (option, kind) in [("--altitude", "amsl"), ("--height", "agl")] {
            files.done(&["convert", name, "level.toml", option, "520"]);
            let written = files.get("level.toml");
            assert_eq!(written.matches("520").count(), 2, "{written}");
            assert!(
                !written.contains("510") && written.contains(kind),
                "{written}"
            );
        }
        // Without altitudes a track on the ground lacks nothing.
        files.done(&["fit", name]);
    }
    let (status, printed) = files.refused(&["densify", "route.toml", "--altitude", "520"]);
    assert!(
        status == 2 && printed.contains("has altitudes"),
        "{printed}"
    );
}

#[test]
fn items_relative_to_a_home_that_the_file_does_not_give_are_refused() {
    let files = Files::new();
    files.put(
        "m.waypoints",
        "QGC WPL 110\n1 0 3 16 0 0 0 0 47.001 8 20 1\n2 0 0 16 0 0 0 0 47.002 8 530 1\n",
    );
    let (status, printed) = files.refused(&["densify", "m.waypoints"]);
    assert!(
        status == 2 && printed.contains("no row of home"),
        "{printed}"
    );
    files.put(
        "m.plan",
        r#"{"fileType":"Plan","mission":{"items":[
            {"type":"SimpleItem","command":16,"frame":3,"params":[0,0,0,0,47.0,8.0,20]},
            {"type":"SimpleItem","command":16,"frame":0,"params":[0,0,0,0,47.0,8.01,530]}]}}"#,
    );
    let (status, printed) = files.refused(&["densify", "m.plan"]);
    assert!(
        status == 2 && printed.contains("plannedHomePosition[2]"),
        "{printed}"
    );
}
