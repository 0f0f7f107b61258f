//! A route file becomes messages and comes back the same; every error names file, line and field.

use std::path::Path;

use crate::support::*;
use cucs::{LoiterSpan, Route, Session, SessionConfig};
use stanag_msgs::Message;
use stanag_msgs::enums::{AltitudeType, LoiterType, TurnType};
use stanag_msgs::messages::UaPositionWaypoint;

const ROUTE: &str = r#"mission_id = "M-1"
id = "a route"
type = "contingency-b"
initial = 7

[defaults]
altitude = 30
altitude_type = "agl"
speed = 5.0

[[waypoint]]
number = 7
latitude = 47.3981
longitude = -8.5459
next = 3

[[waypoint]]
number = 3
latitude = -47.399
longitude = 8.5459
altitude = 535.5
altitude_type = "wgs84"
speed = 8
speed_type = "true"
turn = "fly-over"
loiter = { type = "racetrack", radius = 30, length = 60, bearing = 90, direction = "counter-clockwise", seconds = 20 }
next = 9

[[waypoint]]
number = 9
latitude = 47.4
longitude = 8.5
loop = { limit = 2, type = "count" }
next = 7

[[curve]]
from = 7
to = 3
p2 = [47.1, 8.1, 40]
p3 = [47.2, 8.2]
altitude_type = "amsl"

[[curve]]
from = 3
to = 9
p2 = [47.1, 8.1]
p3 = [47.2, 8.2]
message = 50001
"#;

fn parse(text: &str) -> Result<Route, String> {
    Route::parse(Path::new("a.route.toml"), text).map_err(|fault| fault.to_string())
}

#[test]
fn a_file_becomes_its_messages() {
    let route = parse(ROUTE).unwrap();
    let messages = route.messages(VEHICLE, CUCS).unwrap();
    let types: Vec<u16> = messages.iter().map(Message::id).collect();
    assert_eq!(types, [13001, 13002, 13002, 13003, 13002, 50002, 50001]);

    let Message::UaRoute(header) = &messages[0] else {
        panic!()
    };
    assert_eq!(header.initial_waypoint_number, Some(7));
    assert_eq!(header.route_id.unwrap().as_str(), "a route");
    assert_eq!(header.route_type.unwrap().raw(), 4);

    let Message::UaPositionWaypoint(first) = &messages[1] else {
        panic!()
    };
    assert_eq!(
        (first.waypoint_number, first.next_waypoint),
        (Some(7), Some(3))
    );
    assert_eq!(first.waypoint_altitude_type, Some(AltitudeType::Agl));
    assert_eq!(first.waypoint_to_altitude.unwrap().si(), 30.0);
    assert_eq!(first.waypoint_to_speed.unwrap().si(), 5.0);
    assert!((first.waypoint_to_longitude_or_relative_x.unwrap().degrees() + 8.5459).abs() < 1e-7);
    assert_eq!(first.turn_type, None);

    let Message::UaPositionWaypoint(second) = &messages[2] else {
        panic!()
    };
    assert_eq!(second.turn_type, Some(TurnType::FlyOver));
    assert_eq!(second.waypoint_speed_type.unwrap().raw(), 1);
    let Message::UaLoiterWaypoint(loiter) = &messages[3] else {
        panic!()
    };
    assert_eq!(loiter.waypoint_number, Some(3));
    assert_eq!(loiter.waypoint_loiter_type, Some(LoiterType::Racetrack));
    assert_eq!(loiter.loiter_duration, Some(20));
    assert_eq!(loiter.loiter_radius.unwrap().si(), 30.0);

    let Message::UaPositionWaypoint(last) = &messages[4] else {
        panic!()
    };
    assert_eq!(
        (last.waypoint_type.unwrap().raw(), last.loop_limit),
        (1, Some(2))
    );
    let Message::CurveSegmentPaper(paper) = &messages[6] else {
        panic!()
    };
    assert_eq!(
        (paper.vehicle_id, paper.cucs_id),
        (Some(VEHICLE), Some(CUCS))
    );
    assert_eq!(paper.p2_latitude, Some(47.1_f64.to_radians()));
    assert_eq!(
        route.waypoints[1].loiter.unwrap().span,
        Some(LoiterSpan::Seconds(20))
    );
}

#[test]
fn without_next_the_waypoints_follow_each_other_and_the_last_ends_the_route() {
    let text = "[[waypoint]]\nnumber = 5\nlatitude = 1\nlongitude = 2\naltitude = 3\n\
                [[waypoint]]\nnumber = 2\nlatitude = 1\nlongitude = 2\naltitude = 3\n";
    let route = parse(text).unwrap();
    let next: Vec<u16> = route.waypoints.iter().map(|point| point.next).collect();
    assert_eq!(next, [2, 0]);
    let Message::UaRoute(header) = &route.messages(VEHICLE, CUCS).unwrap()[0] else {
        panic!()
    };
    assert_eq!(header.initial_waypoint_number, Some(5));
}

#[test]
fn a_download_that_lacks_an_altitude_or_a_position_is_no_route_file() {
    type Without = fn(&mut UaPositionWaypoint);
    let cases: [(&str, Without); 3] = [
        ("altitude", |point| point.waypoint_to_altitude = None),
        ("latitude", |point| {
            point.waypoint_to_latitude_or_relative_y = None
        }),
        ("longitude", |point| {
            point.waypoint_to_longitude_or_relative_x = None
        }),
    ];
    for (field, without) in cases {
        let mut session = Session::new(SessionConfig::new(CUCS));
        for mut message in parse(ROUTE).unwrap().messages(VEHICLE, CUCS).unwrap() {
            if let Message::UaPositionWaypoint(point) = &mut message {
                without(point);
            }
            session.handle_datagram(now(0), &datagram(VEHICLE, CUCS, message));
        }
        let download = &session.vehicle(VEHICLE).unwrap().download;
        let fault = Route::from_download(download).unwrap_err().to_string();
        assert!(fault.contains(&format!("without its {field}")), "{fault}");
    }
}

#[test]
fn what_a_vehicle_sends_back_is_the_file_again() {
    let route = parse(ROUTE).unwrap();
    let mut session = Session::new(SessionConfig::new(CUCS));
    let mut messages = route.messages(VEHICLE, CUCS).unwrap();
    // In any order.
    messages.reverse();
    for message in messages {
        session.handle_datagram(now(0), &datagram(VEHICLE, CUCS, message));
    }
    let download = &session.vehicle(VEHICLE).unwrap().download;
    assert!(download.missing().is_empty());
    let [back] = &Route::from_download(download).unwrap()[..] else {
        panic!("one route")
    };
    let again = parse(&back.to_toml()).unwrap();
    assert_eq!(
        again.messages(VEHICLE, CUCS).unwrap(),
        Route {
            mission_id: None,
            ..route
        }
        .messages(VEHICLE, CUCS)
        .unwrap()
    );
}

#[test]
fn a_download_of_several_routes_is_one_file_that_sends_them_all() {
    const SEVERAL: &str = r#"id = "main"
type = "flight"
initial = 1

[[route]]
id = "home"
type = "contingency-a"
initial = 9

[[route]]
type = "contingency-b"
initial = 2

[[waypoint]]
number = 1
latitude = 47.1
longitude = 8.1
altitude = 30.0
altitude_type = "agl"
next = 2

[[waypoint]]
number = 2
latitude = 47.2
longitude = 8.1
altitude = 30.0
altitude_type = "agl"
next = 0

[[waypoint]]
number = 9
latitude = 47.3
longitude = 8.1
altitude = 30.0
altitude_type = "agl"
next = 2

[[curve]]
from = 1
to = 2
p2 = [47.11000000, 8.10000000]
p3 = [47.12000000, 8.10000000]

[[curve]]
from = 9
to = 2
p2 = [47.21000000, 8.10000000]
p3 = [47.22000000, 8.10000000]
"#;
    let sent = parse(SEVERAL).unwrap();
    let messages = sent.messages(VEHICLE, CUCS).unwrap();
    let routes = messages.iter().filter_map(|message| match message {
        Message::UaRoute(route) => Some(route.initial_waypoint_number),
        _ => None,
    });
    // The route that 13000 loads comes last.
    assert_eq!(routes.collect::<Vec<_>>(), [Some(9), Some(2), Some(1)]);
    assert_eq!(messages.len(), 3 + 3 + 2);
    let mut session = Session::new(SessionConfig::new(CUCS));
    for message in messages.clone() {
        session.handle_datagram(now(0), &datagram(VEHICLE, CUCS, message));
    }
    let download = &session.vehicle(VEHICLE).unwrap().download;
    let back = Route::from_download(download).unwrap();
    assert_eq!(back.len(), 3);
    let text = Route::joined(back).unwrap().to_toml();
    assert_eq!(
        parse(&text).unwrap().messages(VEHICLE, CUCS).unwrap(),
        messages
    );
    assert_eq!(Route::joined(Vec::new()), None);
    let fault = parse(&SEVERAL.replace("initial = 9", "initial = 0")).unwrap_err();
    assert!(fault.contains("route: initial"), "{fault}");
}

#[test]
fn missing_waypoints_of_a_download_are_named() {
    let route = parse(ROUTE).unwrap();
    let mut session = Session::new(SessionConfig::new(CUCS));
    for message in route.messages(VEHICLE, CUCS).unwrap() {
        if let Message::UaPositionWaypoint(point) = &message
            && point.waypoint_number != Some(3)
        {
            continue;
        }
        session.handle_datagram(now(0), &datagram(VEHICLE, CUCS, message));
    }
    assert_eq!(session.vehicle(VEHICLE).unwrap().download.missing(), [7, 9]);
    session.start_download(VEHICLE);
    assert!(session.vehicle(VEHICLE).unwrap().download.is_empty());
}

#[test]
fn every_error_names_file_line_and_field() {
    for (find, replace, expected) in [
        (
            "number = 3\n",
            "number = 0\n",
            "a.route.toml:18: waypoint: number: 0, expected 1 to 65534",
        ),
        (
            "number = 3\n",
            "number = 65535\n",
            "a.route.toml:18: waypoint: number: 65535, expected 1 to 65534",
        ),
        (
            "number = 3\n",
            "number = 7\n",
            "a.route.toml:18: waypoint: number: 7, expected another number than that of line 12",
        ),
        (
            "number = 3\n",
            "number = 70000\n",
            "a.route.toml:18: number: invalid value: integer `70000`, expected a whole number",
        ),
        (
            "latitude = -47.399",
            "latitude = 200",
            "a.route.toml:19: waypoint 3: latitude: 200.0, expected -90 to 90 degrees",
        ),
        (
            "longitude = -8.5459",
            "longitude = nan",
            "a.route.toml:14: waypoint 7: longitude: NaN, expected -180 to 180 degrees",
        ),
        (
            "altitude = 535.5",
            "altitude = 1e9",
            "a.route.toml:21: waypoint 3: altitude: 1000000000.0, expected -167772.16 to 167772.14 m",
        ),
        (
            "speed = 8",
            "speed = -1",
            "a.route.toml:23: waypoint 3: speed: -1.0, expected 0 to 32767.5 m/s",
        ),
        (
            "\"fly-over\"",
            "\"sharp\"",
            "a.route.toml:25: waypoint 3: turn: \"sharp\", expected one of short, fly-over",
        ),
        (
            "\"racetrack\"",
            "\"round\"",
            "a.route.toml:26: waypoint 3: loiter.type: \"round\", expected one of circular, racetrack, figure-8, hover",
        ),
        (
            "seconds = 20",
            "seconds = 20, turns = 2",
            "a.route.toml:26: waypoint 3: loiter.turns: 2, expected either seconds or turns",
        ),
        (
            "radius = 30",
            "radius = -3",
            "a.route.toml:26: waypoint 3: loiter.radius: -3.0, expected 0 to 98302.5 m",
        ),
        (
            "\"contingency-b\"",
            "\"return\"",
            "a.route.toml:3: type: \"return\", expected one of launch, approach, flight, contingency-a, contingency-b",
        ),
        (
            "speed = 5.0\n",
            "speed = 5.0\nsped = 4\n",
            "a.route.toml:10: sped: unknown field `sped`",
        ),
        (
            "longitude = 8.5459\n",
            "",
            "a.route.toml:17: longitude is missing",
        ),
        (
            "altitude = 30\n",
            "",
            "a.route.toml:11: waypoint 7: altitude: missing, expected a number, here or in [defaults]",
        ),
        (
            "latitude = -47.399",
            "latitude = \"x\"",
            "a.route.toml:19: latitude: invalid type: string \"x\", expected a number, without quotes and unit",
        ),
        (
            "p2 = [47.1, 8.1, 40]",
            "p2 = [47.1]",
            "a.route.toml:39: curve from 7: p2: [47.1], expected [latitude, longitude] or",
        ),
        (
            "p2 = [47.1, 8.1, 40]",
            "p2 = [147.1, 8.1]",
            "a.route.toml:39: curve from 7: p2: [147.1, 8.1], expected a latitude of -90 to 90",
        ),
        (
            "message = 50001",
            "message = 50003",
            "a.route.toml:48: curve from 3: message: 50003, expected 50001 or 50002",
        ),
        (
            "p3 = [47.2, 8.2]\nmessage",
            "p3 = [47.2, 8.2, 4]\nmessage",
            "a.route.toml: curve from waypoint 3: 50001 carries no altitudes, use 50002",
        ),
        (
            "\"a route\"",
            "\"a route whose name is far too long to be sent\"",
            "a.route.toml: Route ID \"a route whose",
        ),
        (
            "mission_id = \"M-1\"",
            "mission_id = \"\\u00fc\"",
            "a.route.toml: Mission ID \"ü\", expected at most 19",
        ),
        ("[[curve]]", "[[curve", "a.route.toml:36: "),
        ("", "waypoint = 3\n", "a.route.toml:"),
    ] {
        let text = ROUTE.replacen(find, replace, 1);
        assert_ne!(text, ROUTE, "{find}");
        let fault = parse(&text).unwrap_err();
        assert!(fault.starts_with(expected), "{fault}\nexpected {expected}");
    }
    assert!(
        parse("")
            .unwrap_err()
            .contains("no waypoints, expected at least one table")
    );
    assert!(
        parse("waypoint = []")
            .unwrap_err()
            .contains("the route has no waypoints")
    );
    let missing = Route::load(Path::new("no/such.toml"))
        .unwrap_err()
        .to_string();
    assert!(missing.starts_with("no/such.toml: "), "{missing}");
}

#[test]
fn the_examples_are_routes() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples");
    let mut found = 0;
    for entry in std::fs::read_dir(&folder).unwrap() {
        let path = entry.unwrap().path();
        if path.to_string_lossy().ends_with(".route.toml") {
            let route = Route::load(&path).unwrap();
            let again = Route::parse(&path, &route.to_toml()).unwrap();
            assert_eq!(again.messages(VEHICLE, CUCS), route.messages(VEHICLE, CUCS));
            found += 1;
        } else if path
            .extension()
            .is_some_and(|extension| extension == "cucs")
        {
            assert!(!cucs::Line::load(&path).unwrap().is_empty());
            found += 1;
        }
    }
    assert!(found >= 3, "{found}");
}

#[test]
fn the_commands_and_the_route_of_the_document_are_understood() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/guide/cucs.md");
    let text = std::fs::read_to_string(path).unwrap();
    let blocks: Vec<&str> = text
        .lines()
        .filter_map(|line| line.strip_prefix("    "))
        .collect();
    let commands: Vec<&str> = blocks
        .iter()
        .filter_map(|line| line.strip_prefix("cucs "))
        .collect();
    assert!(commands.len() >= 10);
    for line in commands {
        // Options of the program, which a script does not have.
        let options = [
            "--id 1b:00:00:b0 ",
            "--edition 2.5 --multicast 239.45.86.1:26001 --interface lo ",
        ];
        let line = options
            .iter()
            .find_map(|option| line.strip_prefix(option))
            .unwrap_or(line);
        assert!(cucs::parse_line(line).unwrap().is_some(), "{line}");
    }
    let file: Vec<&str> = text
        .lines()
        .skip_while(|line| !line.starts_with("    mission_id"))
        .take_while(|line| line.is_empty() || line.starts_with("    "))
        .collect();
    let route = parse(&file.join("\n")).unwrap();
    assert_eq!((route.waypoints.len(), route.curves.len()), (2, 1));
}
