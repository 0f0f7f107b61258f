//! Errors name the file, the line and the field.

use crate::{Files, ROUTE};

#[test]
fn errors_name_the_file_the_line_and_the_field() {
    let files = Files::new();
    let refuses_with = |name: &str, text: &str, expected: &str| {
        files.put(name, text);
        let (status, printed) = files.refused(&["densify", name]);
        assert_eq!(status, 2, "{printed}");
        assert!(
            printed.contains(expected),
            "{printed:?}, expected {expected:?}"
        );
    };
    refuses_with(
        "a.toml",
        &ROUTE.replace("latitude = 47.3990", "latitude = \"x\""),
        "a.toml:14: latitude: ",
    );
    refuses_with(
        "b.toml",
        &ROUTE.replace("latitude = 47.3990", "lat = 47.3990"),
        "unknown field `lat`",
    );
    refuses_with(
        "c.toml",
        &ROUTE.replace("latitude = 47.3990", "latitude = nan"),
        "c.toml:14: waypoint 20: latitude: NaN, expected -90",
    );
    refuses_with(
        "d.toml",
        &ROUTE.replace("p2 = [47.4000", "p2 = [48.4"),
        "d.toml:13: leg from waypoint 20: P2 is 1",
    );
    refuses_with(
        "n.toml",
        &ROUTE.replace("to = 30", "to = 10"),
        "n.toml:25: curve: no leg leads from 20 to 10",
    );
    refuses_with(
        "o.toml",
        &ROUTE.replacen("altitude = 510.0", "altitude = 510.0\nnext = 40", 1),
        "o.toml:13: waypoint 20: next: 40, expected the number",
    );
    refuses_with(
        "p.toml",
        &ROUTE.replace(
            "altitude = 510.0",
            "altitude = 51.0\naltitude_type = \"agl\"",
        ),
        "p.toml:13: waypoint 20: altitude_type",
    );
    refuses_with(
        "e.csv",
        "lat,lon\n47.0,8.0\n47.1,abc\n",
        "e.csv:3: lon: \"abc\", expected a number",
    );
    refuses_with("f.csv", "x,y\n1,2\n", "f.csv:1: lat_deg: no such column");
    refuses_with(
        "g.waypoints",
        "QGC WPL 110\n0 1 0 16 0 0 0 0 47 8 500 1\n1 0 11 16 0 0 0 0 47 8 5 1\n",
        "g.waypoints:3: frame: 11",
    );
    refuses_with(
        "h.gpx",
        "<gpx>\n<rte>\n<rtept lat=\"47\" lon=\"?\"/>\n</rte></gpx>",
        "h.gpx:3: rtept lon",
    );
    refuses_with(
        "i.kml",
        "<kml><LineString>\n<coordinates>8,47,1 8</coordinates></LineString></kml>",
        "i.kml:2: coordinates: \"8\"",
    );
    refuses_with(
        "j.geojson",
        "{\"type\":\"LineString\",\"coordinates\":[[8,47],\n[8,\"b\"]]}",
        "j.geojson:2: .coordinates[1]: ",
    );
    refuses_with(
        "k.plan",
        "{\"fileType\":\"Plan\",\"mission\":{\"items\":[\n{\n\"type\":\"Item\"}]}}",
        "k.plan:3: mission.items[0].type: \"Item\", expected",
    );
    refuses_with("l.plan", "{\"fileType\":\n\"Plan\",", "l.plan:2");
    refuses_with("m.doc", "", "unknown ending");
    refuses_with(
        "q.txt",
        "a poem",
        "q.txt:1: \"a poem\", expected \"QGC WPL 110\"",
    );
    let (status, printed) = files.refused(&["densify", "missing.toml"]);
    assert!(status == 2 && printed.contains("missing.toml"), "{printed}");
}

#[test]
fn mistakes_of_units_and_kinds_of_files_are_answered_in_words() {
    let files = Files::new();
    let refuses_with = |arguments: &[&str], expected: &str| {
        let (_, printed) = files.refused(arguments);
        assert!(
            printed.contains(expected),
            "{printed:?}, expected {expected:?}"
        );
    };
    files.put(
        "unit.toml",
        &ROUTE.replacen("altitude = 510.0", "altitude = \"510 m\"", 1),
    );
    refuses_with(
        &["densify", "unit.toml"],
        "altitude: invalid type: string \"510 m\", expected a number, without quotes and unit",
    );
    files.put("none.toml", "id = \"a\"\n");
    refuses_with(
        &["densify", "none.toml"],
        "no waypoints, expected at least one table [[waypoint]]",
    );
    for name in ["empty.toml", "empty.plan", "empty.kml", "empty.csv"] {
        files.put(name, "\r\n");
        refuses_with(
            &["densify", name],
            &format!("{name}: empty, expected a route"),
        );
    }
    files.put(
        "feet.csv",
        "lat,lon,alt_ft\n47.39,8.54,1700\n47.40,8.55,1710\n",
    );
    refuses_with(
        &["densify", "feet.csv"],
        "alt_ft: in feet, expected metres: a column alt_m",
    );
    // Sparse: it takes no room.
    let huge = std::fs::File::create(files.path("huge.kml")).unwrap();
    huge.set_len(100_000_001).unwrap();
    refuses_with(&["densify", "huge.kml"], "over 100 MB, expected a route");
    files.put("good.toml", ROUTE);
    refuses_with(
        &[
            "check",
            "good.toml",
            "--speed",
            "-5",
            "--home",
            "47.4,8.5,400",
        ],
        "'-5' for '--speed <M/S>': expected more than 0 and at most 200 m/s",
    );
}

#[test]
fn a_tolerance_or_a_speed_that_is_none_is_a_wrong_command_line() {
    let files = Files::new();
    files.done(&["densify", "route.toml", "track.csv"]);
    let cases: [(&[&str], &str, &[&str]); 4] = [
        (
            &["fit", "track.csv"],
            "--tolerance",
            &["nan", "0", "-1", "1e9"],
        ),
        (
            &["compare", "track.csv"],
            "--tolerance",
            &["nan", "0", "-1"],
        ),
        (
            &["densify", "route.toml"],
            "--tolerance",
            &["nan", "0", "-1"],
        ),
        (
            &["densify", "route.toml", "--max-items", "50"],
            "--tolerance",
            &["nan", "0"],
        ),
    ];
    for (command, option, wrong) in cases {
        for value in wrong {
            let (status, printed) = files.refused(&[command, &[option, value]].concat());
            let expected = format!("{option} is ");
            assert!(
                status == 2 && printed.contains(&expected),
                "{value}: {printed}"
            );
        }
    }
    // Before the route is looked at: one that is below its home is no answer to a speed that is none.
    for home in ["47.4,8.5,400", "47.4,8.5,4000"] {
        for value in ["nan", "0", "-5", "201", "inf", "fast"] {
            let wrong = ["check", "route.toml", "--home", home, "--speed", value];
            let (status, printed) = files.refused(&wrong);
            assert!(
                status == 2 && printed.contains("--speed <M/S>"),
                "{value}: {printed}"
            );
        }
    }
    let below = ["check", "route.toml", "--home", "47.4,8.5,4000"];
    assert_eq!(files.refused(&below).0, 1);
}
