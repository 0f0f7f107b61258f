//! Files of QGroundControl, MAVProxy, Google Earth, receivers and spreadsheets, as those write them: what is read of
//! them, what is listed as lost, and that they can be written again.

use std::path::Path;

use serde_json::{Value, json};

use crate::Files;

/// The files of `tests/data` beside the route of the other tests.
fn files() -> Files {
    let files = Files::new();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    for entry in std::fs::read_dir(data).unwrap() {
        let from = entry.unwrap().path();
        let name = from.file_name().unwrap().to_str().unwrap();
        std::fs::copy(&from, files.path(name)).unwrap();
    }
    files
}

impl Files {
    /// Converts a file, and returns what is lost: the text on standard error and the JSON.
    fn convert(&self, from: &str, to: &str, more: &[&str]) -> (String, Value) {
        let output = self.run(&[&["convert", from, to, "--json"], more].concat());
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{from} to {to}: {error}");
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(report["written"], to);
        (error, report["losses"].clone())
    }

    fn toml(&self, name: &str) -> toml::Table {
        self.get(name).parse().unwrap()
    }
}

/// A number, which TOML may write without decimals.
fn number(value: &toml::Value) -> Option<f64> {
    value
        .as_float()
        .or_else(|| value.as_integer().map(|n| n as f64))
}

fn texts(losses: &Value) -> Vec<String> {
    let lost = losses["lost"].as_array().unwrap();
    lost.iter()
        .map(|loss| loss["what"].as_str().unwrap().to_owned())
        .collect()
}

#[test]
fn a_plan_of_qgroundcontrol_keeps_speeds_loiters_and_its_geofence() {
    let files = files();
    let (error, losses) = files.convert("qgroundcontrol.plan", "route.toml", &[]);
    assert_eq!(
        error,
        "route.toml: 3 of 7 items taken; lost: camera at item 5, return to launch at item 7, \
         take-off (flown to as a waypoint: launch first) at item 1, \
         how the loiter is left (its exit heading, its tangent) at item 4, 1 rally point\n\
         route.toml: not taken, as in every new plan: planned speeds for estimates: cruise 15 m/s, hover 5 m/s\n"
    );
    assert_eq!((&losses["items"], &losses["taken"]), (&json!(7), &json!(3)));
    assert_eq!(
        losses["lost"][1],
        json!({ "what": "return to launch", "item": 7 })
    );
    let route = files.toml("route.toml");
    let waypoints = route["waypoint"].as_array().unwrap();
    assert_eq!(waypoints.len(), 4);
    assert!(waypoints[0].get("speed").is_none());
    for waypoint in &waypoints[1..] {
        assert_eq!(number(&waypoint["speed"]), Some(6.0), "{waypoint}");
        assert_eq!(waypoint["speed_type"].as_str(), Some("ground"));
    }
    let loiter = &waypoints[2]["loiter"];
    assert_eq!(loiter["type"].as_str(), Some("circular"));
    assert_eq!(number(&loiter["radius"]), Some(50.0));
    assert_eq!(loiter["direction"].as_str(), Some("counter-clockwise"));
    assert_eq!(loiter["seconds"].as_integer(), Some(20));
    assert_eq!(waypoints[3]["loiter"]["seconds"].as_integer(), Some(10));
    assert_eq!(waypoints[3]["loiter"]["type"].as_str(), Some("hover"));
    assert_eq!(number(&waypoints[3]["altitude"]), Some(35.0));
    assert_eq!(waypoints[3]["altitude_type"].as_str(), Some("agl"));
    let areas = route["area"].as_array().unwrap();
    assert_eq!(areas[0]["keep"].as_str(), Some("in"));
    assert_eq!(areas[0]["vertices"].as_array().unwrap().len(), 4);
    assert_eq!(areas[1]["keep"].as_str(), Some("out"));
    assert_eq!(number(&areas[1]["radius"]), Some(35.5));
}

#[test]
fn a_plan_comes_back_from_each_format_with_all_that_it_can_hold() {
    let files = files();
    let original: Value = serde_json::from_str(&files.get("qgroundcontrol.plan")).unwrap();
    let (error, _) = files.convert("qgroundcontrol.plan", "same.plan", &["--strict"]);
    assert_eq!(error, "");
    let same: Value = serde_json::from_str(&files.get("same.plan")).unwrap();
    let numbers = |plan: &Value| {
        let items = plan["mission"]["items"].as_array().unwrap();
        let all = items.iter().map(|item| {
            let params = item["params"].as_array().unwrap();
            let params: Vec<_> = params.iter().map(Value::as_f64).collect();
            (item["command"].clone(), item["frame"].clone(), params)
        });
        all.collect::<Vec<_>>()
    };
    assert_eq!(numbers(&same), numbers(&original));
    assert_eq!(same["geoFence"], original["geoFence"]);
    let [a, b] = [&same, &original].map(|plan| {
        let home = plan["mission"]["plannedHomePosition"].as_array().unwrap();
        home.iter().map(Value::as_f64).collect::<Vec<_>>()
    });
    assert_eq!(a, b);
    assert_eq!(same["rallyPoints"]["points"].as_array().unwrap().len(), 1);
    let lost_always = ["camera", "return to launch"];
    for (there, lost) in [
        ("x.kml", &[][..]),
        ("x.kmz", &[]),
        ("x.geojson", &[]),
        ("x.csv", &["2 areas of the geofence", "1 rally point"]),
    ] {
        let (_, losses) = files.convert("qgroundcontrol.plan", there, &[]);
        assert_eq!(texts(&losses), [&lost_always[..], lost].concat(), "{there}");
        let (error, _) = files.convert(there, "back.plan", &["--strict"]);
        assert_eq!(error, "", "{there}");
        let back: Value = serde_json::from_str(&files.get("back.plan")).unwrap();
        let mut wanted = numbers(&original);
        wanted.retain(|(command, ..)| command != 206 && command != 20);
        assert_eq!(numbers(&back), wanted, "{there}");
        if lost.is_empty() {
            assert_eq!(back["geoFence"], original["geoFence"], "{there}");
        }
    }
    let (_, losses) = files.convert("qgroundcontrol.plan", "x.waypoints", &[]);
    assert_eq!(texts(&losses), ["2 areas of the geofence", "1 rally point"]);
    files.convert("x.waypoints", "back.plan", &["--strict"]);
    let back: Value = serde_json::from_str(&files.get("back.plan")).unwrap();
    assert_eq!(numbers(&back).len(), 7);
    assert_eq!(back["mission"]["items"][6]["command"], 20);
}

#[test]
fn strict_writes_nothing_where_something_is_lost() {
    let files = files();
    for from in [
        "qgroundcontrol.plan",
        "google-earth.kml",
        "garmin.gpx",
        "spreadsheet.csv",
    ] {
        let (status, printed) = files.refused(&["convert", from, "strict.toml", "--strict"]);
        assert_eq!(status, 1, "{printed}");
        assert!(
            printed.contains(" taken; lost: ") && printed.contains("nothing was written"),
            "{printed}"
        );
        assert!(!files.path("strict.toml").exists());
    }
    let nobody = ["--vsm", "127.0.0.1:9", "--strict"];
    let (status, printed) =
        files.refused(&[&["send", "qgroundcontrol.plan"], &nobody[..]].concat());
    assert!(
        status == 1
            && printed.contains("return to launch at item 7")
            && printed.contains("cucs fence qgroundcontrol.plan"),
        "{printed}"
    );
}

#[test]
fn planned_speeds_of_a_plan_come_back_and_are_listed_where_there_is_no_place_for_them() {
    let files = files();
    let mut plan: Value = serde_json::from_str(&files.get("qgroundcontrol.plan")).unwrap();
    plan["mission"]["cruiseSpeed"] = json!(18.0);
    plan["mission"]["hoverSpeed"] = json!(4.5);
    files.put("fast.plan", &plan.to_string());
    files.convert("fast.plan", "same.plan", &["--strict"]);
    let same: Value = serde_json::from_str(&files.get("same.plan")).unwrap();
    assert_eq!(same["mission"]["cruiseSpeed"], 18.0);
    assert_eq!(same["mission"]["hoverSpeed"], 4.5);
    for there in ["x.toml", "x.waypoints", "x.kml", "x.csv"] {
        let (error, _) = files.convert("fast.plan", there, &[]);
        let expected = "planned speeds for estimates: cruise 18 m/s, hover 4.5 m/s";
        assert!(error.contains(expected), "{there}: {error}");
        // The values that every new plan has were not chosen by anybody: they are named, and no loss.
        let (error, losses) = files.convert("qgroundcontrol.plan", there, &[]);
        let expected = "not taken, as in every new plan: planned speeds for estimates: cruise 15 m/s, hover 5 m/s";
        assert!(error.contains(expected), "{there}: {error}");
        assert_eq!(losses["notes"][0], expected, "{there}");
        assert!(
            !texts(&losses).iter().any(|lost| lost.contains("planned")),
            "{there}: {losses}"
        );
    }
    // One is reported even without the other.
    plan["mission"]
        .as_object_mut()
        .unwrap()
        .remove("cruiseSpeed");
    files.put("half.plan", &plan.to_string());
    let (error, _) = files.convert("half.plan", "x.toml", &[]);
    assert!(
        error.contains("planned speed for estimates: hover 4.5 m/s"),
        "{error}"
    );
}

#[test]
fn a_loiter_until_an_altitude_names_all_that_it_loses() {
    let files = files();
    let mut plan: Value = serde_json::from_str(&files.get("qgroundcontrol.plan")).unwrap();
    let item = &mut plan["mission"]["items"][3];
    item["command"] = json!(31);
    item["params"][0] = json!(1.0);
    item["params"][1] = json!(-60.0);
    files.put("climb.plan", &plan.to_string());
    let (_, losses) = files.convert("climb.plan", "climb.toml", &[]);
    let texts = texts(&losses);
    for what in [
        "loiter until the altitude is reached",
        "its loiter radius -60 m",
        "how the loiter is left (its exit heading, its tangent)",
    ] {
        assert!(texts.iter().any(|text| text == what), "{what}: {texts:?}");
    }
}

#[test]
fn a_strict_fit_refuses_what_it_cannot_take() {
    let files = files();
    // Items without a place cannot be part of a track; they are named.
    let (status, printed) = files.refused(&["fit", "qgroundcontrol.plan", "--strict"]);
    assert_eq!(status, 1, "{printed}");
    assert!(printed.contains(" taken; lost: "), "{printed}");
    let fitted = files.run(&["fit", "qgroundcontrol.plan"]);
    assert!(fitted.status.success());
    assert!(
        String::from_utf8(fitted.stderr)
            .unwrap()
            .contains(" taken; lost: ")
    );
}

#[test]
fn a_survey_has_its_items_within_and_a_landing_pattern_is_named() {
    let files = files();
    let (error, losses) = files.convert("survey.plan", "survey.csv", &[]);
    assert!(
        error.contains("2 of 4 items taken; lost: landing pattern at item 4, camera at item 2"),
        "{error}"
    );
    assert_eq!(losses["lost"].as_array().unwrap().len(), 2);
    assert_eq!(files.get("survey.csv").lines().count(), 3);
}

#[test]
fn missions_of_mavproxy_are_read_with_their_home_or_without() {
    let files = files();
    let (error, _) = files.convert("mavproxy.waypoints", "route.toml", &[]);
    assert_eq!(
        error,
        "route.toml: 4 of 7 items taken; lost: heading 90 degrees at item 5, return to launch at item 7, \
         take-off (flown to as a waypoint: launch first) at item 1\n"
    );
    let route = files.toml("route.toml");
    let waypoints = route["waypoint"].as_array().unwrap();
    assert_eq!(waypoints.len(), 4);
    assert_eq!(number(&waypoints[1]["speed"]), Some(7.5));
    assert_eq!(waypoints[1]["turn"].as_str(), Some("fly-over"));
    assert_eq!(waypoints[2]["loiter"]["turns"].as_integer(), Some(3));
    assert_eq!(number(&waypoints[2]["loiter"]["radius"]), Some(60.0));
    // It jumps back twice, so it is flown three times.
    assert_eq!(waypoints[3]["next"].as_integer(), Some(20));
    assert_eq!(waypoints[3]["loop"]["limit"].as_integer(), Some(3));
    // The same mission as `wp save` of MAVProxy 1.8.75 writes it.
    files.convert("mavproxy-saved.waypoints", "saved.toml", &[]);
    let saved = files.get("saved.toml");
    assert_eq!(
        saved.replace("mavproxy-saved", "mavproxy"),
        files.get("route.toml")
    );
    let (error, _) = files.convert("mavproxy-px4.txt", "px4.csv", &[]);
    assert_eq!(
        error,
        "px4.csv: 1 of 3 items taken; lost: pitch 15 degrees of the take-off at item 1, landing at item 3\n"
    );
    // The landing's 0 m is not an altitude to fly at.
    assert_eq!(
        files.get("px4.csv"),
        "lat_deg,lon_deg,height_m,take_off\n47.39774300,8.54559400,30.000,plain\n47.39900000,8.54700000,40.000,\n"
    );
}

#[test]
fn of_several_lines_one_is_taken_and_the_others_are_named() {
    let files = files();
    let mut written = Vec::new();
    for from in ["google-earth.kml", "google-earth.kmz"] {
        let (error, _) = files.convert(from, "line.csv", &[]);
        assert_eq!(
            error,
            "line.csv: 3 of 3 points taken; lost: line 2 \"Way out\" (2 points), 1 point beside the line\n"
        );
        written.push(files.get("line.csv"));
        for line in ["2", "Way out"] {
            let (error, _) = files.convert(from, "line.csv", &["--line", line]);
            assert!(
                error.contains("lost: line 1 \"Survey\" (3 points), "),
                "{error}"
            );
            assert!(
                files
                    .get("line.csv")
                    .contains("alt_m\n47.39700000,8.54500000,520.000")
            );
        }
        let (status, printed) = files.refused(&["convert", from, "no.csv", "--line", "3"]);
        assert!(
            status == 2 && printed.contains("expected one of line 1 \"Survey\" (3 points), line 2"),
            "{printed}"
        );
    }
    assert_eq!(written[0], written[1]);
    assert!(written[0].starts_with("lat_deg,lon_deg,height_m\n47.39774340,8.54559390,30.000\n"));
    let (error, _) = files.convert("garmin.gpx", "morning.csv", &[]);
    assert!(
        error.contains(
            "2 of 2 points taken; lost: line 2 \"Flown\" (3 points), 1 point beside the line"
        ),
        "{error}"
    );
    let (error, _) = files.convert("garmin.gpx", "flown.csv", &["--line", "Flown"]);
    assert!(
        error.contains("gaps between 2 segments (joined)")
            && error.contains("time of 3 points")
            && error.contains("TrackPointExtension of 1 point"),
        "{error}"
    );
    let (status, printed) = files.refused(&["convert", "route.toml", "x.csv", "--line", "1"]);
    assert!(status == 2 && printed.contains("--line needs"), "{printed}");
}

#[test]
fn a_table_of_a_spreadsheet_has_semicolons_and_decimal_commas() {
    let files = files();
    let (error, _) = files.convert("spreadsheet.csv", "route.toml", &[]);
    assert_eq!(
        error,
        "route.toml: 3 of 3 points taken; lost: column Battery\n"
    );
    let route = files.toml("route.toml");
    let waypoints = route["waypoint"].as_array().unwrap();
    assert_eq!(number(&waypoints[0]["latitude"]), Some(47.3977434));
    assert_eq!(number(&waypoints[1]["altitude"]), Some(520.25));
    assert_eq!(number(&waypoints[1]["speed"]), Some(6.5));
    assert!(waypoints[2].get("speed").is_none());
    files.put(
        "tabs.csv",
        "lat\tlon\talt\n47,5\t8,5\t500\n47,6\t8,6\t510\n",
    );
    files.convert("tabs.csv", "tabs.toml", &["--strict"]);
    files.put("point.csv", "lat;lon;alt\n47.5;8.5;1.000,5\n");
    let (status, printed) = files.refused(&["convert", "point.csv", "x.toml"]);
    assert!(
        status == 2 && printed.contains("point.csv:2: alt: \"1.000,5\", expected a number"),
        "{printed}"
    );
}

#[test]
fn what_only_a_route_file_holds_is_named_when_it_is_lost() {
    let files = files();
    let (error, losses) = files.convert("route.toml", "bend.plan", &[]);
    assert!(
        error.starts_with("bend.plan: 2 of 3 waypoints taken; lost: curve of the leg from it (")
            && error.ends_with(" straight legs instead) at waypoint 20\n"),
        "{error}"
    );
    assert_eq!(losses["lost"][0]["item"], 20);
    files.put(
        "loiter.toml",
        "type = \"contingency-a\"\n[defaults]\naltitude = 30.0\naltitude_type = \"agl\"\n\
         [[waypoint]]\nnumber = 1\nlatitude = 47.0\nlongitude = 8.0\n\
         [[waypoint]]\nnumber = 2\nlatitude = 47.001\nlongitude = 8.0\nnext = 0\n\
         loiter = { type = \"racetrack\", radius = 60.0, length = 90.0, speed = 8.0, turns = 2 }\n\
         [[waypoint]]\nnumber = 3\nlatitude = 47.002\nlongitude = 8.0\n",
    );
    let (error, _) = files.convert("loiter.toml", "loiter.plan", &[]);
    assert_eq!(
        error,
        "loiter.plan: 1 of 3 waypoints taken; lost: route type contingency-a, \
         waypoint that the route does not reach at waypoint 3, loiter pattern Racetrack (written as a circle) at waypoint 2, \
         loiter length 90 m at waypoint 2, loiter speed 8 m/s at waypoint 2\n"
    );
    // A table has a column for each of them.
    let (error, _) = files.convert("loiter.toml", "loiter.csv", &[]);
    assert!(
        error.contains("2 of 3 waypoints taken") && !error.contains("racetrack"),
        "{error}"
    );
    assert!(
        files.get("loiter.csv").contains("racetrack,60,90,8,2"),
        "{}",
        files.get("loiter.csv")
    );
}

#[test]
fn rally_points_of_a_plan_become_tables_of_the_configuration_of_a_vsm() {
    let files = Files::new();
    files.put("site.plan", include_str!("../data/qgroundcontrol.plan"));
    let tables = "[[vehicle.rally]]\nplace = [47.3965, 8.544]\nheight_m = 25.0\n";
    assert_eq!(files.done(&["rally", "site.plan"]), tables);
    for to in [&["rally.toml"][..], &["-o", "rally.toml"]] {
        let arguments = [&["rally", "site.plan"][..], to].concat();
        assert_eq!(files.done(&arguments), "", "{to:?}");
        assert_eq!(files.get("rally.toml"), tables, "{to:?}");
    }
    let (status, error) = files.refused(&["rally", "route.toml"]);
    assert_eq!(status, 2, "{error}");
    assert!(error.contains("read from a .plan"), "{error}");
}
