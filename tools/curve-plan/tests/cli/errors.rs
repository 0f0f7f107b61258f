//! Errors name the file, the line and the field.

use crate::{Files, ROUTE};

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
