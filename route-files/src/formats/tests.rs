//! Whatever a format can hold is read again as it was written.

use curve_paths::Position;
use proptest::prelude::*;
use stanag_msgs::enums::{LimitType, LoiterDirection, LoiterType, TurnType, WaypointSpeedType};

use super::*;
use crate::fence::{Keep, Shape};
use crate::route::model::{Loiter, LoiterSpan};

/// A multiple of a step: what the decimals of a file hold.
fn steps(low: i64, high: i64, step: f64) -> impl Strategy<Value = f64> {
    (low..=high).prop_map(move |n| n as f64 * step)
}

fn place() -> impl Strategy<Value = [f64; 2]> {
    // Not 0, 0, which mission items take for no place.
    let lat = (1_i64..=899_999_999).prop_map(|n| n as f64 / 1e7);
    let lon = (-1_799_999_999_i64..=-1).prop_map(|n| n as f64 / 1e7);
    (lat, lon).prop_map(|(lat, lon)| [lat, lon])
}

fn position() -> impl Strategy<Value = Position> {
    let alt = (-400_000_i64..=5_000_000).prop_map(|n| n as f64 / 1e3);
    (place(), alt).prop_map(|([lat, lon], alt)| Position::new(lat, lon, alt))
}

fn area() -> impl Strategy<Value = Area> {
    let polygon = prop::collection::vec(place(), 3..6).prop_map(Shape::Polygon);
    let circle = (place(), steps(1, 4_000, 0.5))
        .prop_map(|(centre, radius_m)| Shape::Circle { centre, radius_m });
    (any::<bool>(), prop_oneof![polygon, circle]).prop_map(|(inside, shape)| Area {
        keep: Keep::inside(inside),
        shape,
    })
}

fn span() -> impl Strategy<Value = Option<LoiterSpan>> {
    prop_oneof![
        Just(None),
        (1_u16..9_999).prop_map(|s| Some(LoiterSpan::Seconds(s))),
        (1_u16..99).prop_map(|n| Some(LoiterSpan::Turns(n))),
    ]
}

/// A loiter that a mission item says, as it says it.
fn plain_loiter() -> impl Strategy<Value = Loiter> {
    let circle = (steps(1, 999, 1.5), any::<bool>(), span()).prop_map(|(radius_m, cw, span)| {
        let direction = if cw {
            LoiterDirection::Clockwise
        } else {
            LoiterDirection::CounterClockwise
        };
        Loiter {
            pattern: Some(LoiterType::Circular),
            radius_m: Some(radius_m),
            direction: Some(direction),
            span,
            ..Loiter::default()
        }
    });
    let own = span().prop_map(|span| Loiter {
        span,
        ..Loiter::default()
    });
    let hover = (1_u16..9_999).prop_map(|s| Loiter {
        pattern: Some(LoiterType::Hover),
        span: Some(LoiterSpan::Seconds(s)),
        ..Loiter::default()
    });
    prop_oneof![circle, own, hover]
}

/// Any loiter that a route file has words for.
fn loiter() -> impl Strategy<Value = Loiter> {
    let pattern = prop::option::of(prop::sample::select(vec![
        LoiterType::Circular,
        LoiterType::Racetrack,
        LoiterType::Figure8,
        LoiterType::Hover,
    ]));
    let direction = prop::option::of(prop::sample::select(vec![
        LoiterDirection::Clockwise,
        LoiterDirection::IntoWind,
        LoiterDirection::VehicleDependent,
    ]));
    let metres = || prop::option::of(steps(1, 999, 1.5));
    let bearing = prop::option::of(steps(0, 359, 1.0));
    let speed = prop::option::of(steps(1, 99, 0.5));
    (
        pattern,
        direction,
        metres(),
        metres(),
        bearing,
        speed,
        span(),
    )
        .prop_map(
            |(pattern, direction, radius_m, length_m, bearing_deg, speed_m_s, span)| Loiter {
                pattern,
                radius_m,
                length_m,
                bearing_deg,
                direction,
                speed_m_s,
                span,
            },
        )
}

/// What is done at a point. `plain`: as mission items say it.
fn conduct(plain: bool) -> impl Strategy<Value = Conduct> {
    let speed = prop::option::of((steps(1, 99, 0.5), any::<bool>()));
    let there = if plain {
        plain_loiter().boxed()
    } else {
        loiter().boxed()
    };
    (speed, any::<bool>(), prop::option::of(there)).prop_map(move |(speed, over, loiter)| {
        let kind = |ground| {
            if ground {
                WaypointSpeedType::Ground
            } else {
                WaypointSpeedType::Indicated
            }
        };
        Conduct {
            speed_m_s: speed.map(|(speed, _)| speed),
            speed_type: speed.map(|(_, ground)| kind(ground)),
            turn: (over && !(plain && loiter.is_some())).then_some(TurnType::FlyOver),
            loiter,
            ..Conduct::default()
        }
    })
}

prop_compose! {
    fn draft(plain: bool)(
        mut points in prop::collection::vec((position(), conduct(plain)), 2..7),
        above_home in any::<bool>(),
        areas in prop::collection::vec(area(), 0..3),
        rally in prop::collection::vec(position(), 0..3),
        take_off in any::<bool>(),
        repeat in prop::option::of((any::<prop::sample::Index>(), 2_u16..9)),
        home in position(),
    ) -> Draft {
        let last = points.len() - 1;
        points[last].1.repeat = repeat.map(|(to, limit)| Repeat {
            to: to.index(last),
            limit_type: if limit == 8 { LimitType::None } else { LimitType::Count },
            limit: if limit == 8 { 0 } else { limit },
        });
        if take_off {
            let conduct = &mut points[0].1;
            *conduct = Conduct { take_off: Some(TakeOff::Plain), speed_m_s: conduct.speed_m_s,
                                 speed_type: conduct.speed_type, ..Conduct::default() };
        }
        let mut speed = (None, None);
        for (_, conduct) in &mut points {
            // A mission goes on with the speed that was set last.
            if plain && conduct.speed_m_s.is_none() {
                (conduct.speed_m_s, conduct.speed_type) = speed;
            }
            speed = (conduct.speed_m_s, conduct.speed_type);
        }
        Draft {
            name: "there & back".into(),
            points: points
                .into_iter()
                .map(|(position, conduct)| Point { conduct, ..Point::straight(position, None) })
                .collect(),
            datum: Datum::above_home(above_home),
            areas,
            rally,
            home: Some(home),
            ..Draft::default()
        }
        .numbered()
    }
}

/// Writes a draft and reads it again.
fn again(draft: &Draft, ending: &str) -> Result<(Draft, Losses), FormatError> {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join(format!("route.{ending}"));
    let (bytes, losses) = write(&file, draft)?;
    std::fs::write(&file, bytes).expect("written");
    Ok((read_track(&file, &Selection::default())?, losses))
}

fn near(a: f64, b: f64) -> bool {
    (a - b).abs() < 1e-7
}

fn same_areas(a: &[Area], b: &[Area]) -> bool {
    let close = |[a, b]: &[f64; 2], [c, d]: &[f64; 2]| near(*a, *c) && near(*b, *d);
    let same = |(a, b): (&Area, &Area)| {
        a.keep == b.keep
            && match (&a.shape, &b.shape) {
                (Shape::Polygon(a), Shape::Polygon(b)) => {
                    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| close(a, b))
                }
                (
                    Shape::Circle { centre, radius_m },
                    Shape::Circle {
                        centre: other,
                        radius_m: radius,
                    },
                ) => close(centre, other) && near(*radius_m, *radius),
                _ => false,
            }
    };
    a.len() == b.len() && a.iter().zip(b).all(same)
}

fn compare(
    ending: &str,
    read: &Draft,
    wanted: &Draft,
    altitude_m: f64,
) -> Result<(), TestCaseError> {
    prop_assert_eq!(read.points.len(), wanted.points.len(), "{}", ending);
    prop_assert_eq!(read.datum, wanted.datum, "{}", ending);
    for (a, b) in read.points.iter().zip(&wanted.points) {
        let (p, q) = (a.position, b.position);
        prop_assert!(
            near(p.lat_deg, q.lat_deg) && near(p.lon_deg, q.lon_deg),
            "{}",
            ending
        );
        prop_assert!(
            (p.alt_m - q.alt_m).abs() <= altitude_m,
            "{} {:?} {:?}",
            ending,
            p,
            q
        );
        prop_assert_eq!(a.conduct, b.conduct, "{}", ending);
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn a_mission_is_read_as_it_was_written(draft in draft(true)) {
        let mut draft = draft;
        draft.extras.push(Extra { after: 1, item: 9, command: 206, frame: 2, params: [25.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0] });
        draft.extras.push(Extra { after: draft.points.len(), item: 10, command: 20, frame: 2, params: [0.0; 7] });
        // Polygons and circles are two lists of a .plan.
        draft.areas.sort_by_key(|area| matches!(area.shape, Shape::Circle { .. }));
        for ending in ["plan", "waypoints", "txt"] {
            let (read, losses) = again(&draft, ending)?;
            compare(ending, &read, &draft, 6e-4)?;
            let kept = |draft: &Draft| -> Vec<_> {
                draft.extras.iter().map(|e| (e.after, e.command, e.frame, e.params)).collect()
            };
            prop_assert_eq!(kept(&read), kept(&draft));
            let (a, b) = (read.home.unwrap(), draft.home.unwrap());
            prop_assert!(near(a.lat_deg, b.lat_deg) && near(a.alt_m, b.alt_m));
            if ending == "plan" {
                prop_assert_eq!(losses.lost, []);
                prop_assert_eq!(&read.areas, &draft.areas);
                prop_assert_eq!(&read.rally, &draft.rally);
            } else {
                let whole = usize::from(!draft.areas.is_empty()) + usize::from(!draft.rally.is_empty());
                prop_assert_eq!(losses.lost.len(), whole);
            }
        }
    }

    #[test]
    fn what_is_done_at_a_point_is_carried_by_each_format(draft in draft(false)) {
        for ending in ["kml", "kmz", "geojson", "csv", "gpx"] {
            let mut draft = draft.clone();
            if ending == "gpx" {
                draft.datum = Datum::SeaLevel;
            }
            let (read, losses) = again(&draft, ending)?;
            compare(ending, &read, &draft, 6e-4)?;
            if ["csv", "gpx"].contains(&ending) {
                let whole = usize::from(!draft.areas.is_empty()) + usize::from(!draft.rally.is_empty());
                prop_assert_eq!(losses.lost.len(), whole);
            } else {
                prop_assert_eq!(losses.lost, []);
                prop_assert!(same_areas(&read.areas, &draft.areas), "{}", ending);
                prop_assert_eq!(read.rally.len(), draft.rally.len());
            }
        }
    }

    #[test]
    fn a_route_file_carries_all_but_take_off_and_rally_points(draft in draft(false)) {
        let mut draft = draft;
        let (read, losses) = again(&draft, "toml")?;
        let take_offs = draft.points.iter().filter(|p| p.conduct.take_off.is_some()).count();
        prop_assert_eq!(losses.lost.len(), take_offs + usize::from(!draft.rally.is_empty()));
        for point in &mut draft.points {
            point.conduct.take_off = None;
        }
        prop_assert!(same_areas(&read.areas, &draft.areas));
        // The leg of its loop back is drawn, too.
        let looped = draft.points.last().and_then(|p| p.conduct.repeat).filter(|r| r.to != 0);
        let mut read = read;
        read.points.truncate(read.points.len() - usize::from(looped.is_some()));
        compare("toml", &read, &draft, 6e-3)?;
    }

    #[test]
    fn the_fence_of_a_file_is_read_alone(draft in draft(true)) {
        let folder = tempfile::tempdir().unwrap();
        for ending in ["plan", "kml", "kmz", "geojson", "toml"] {
            let file = folder.path().join(format!("route.{ending}"));
            let mut draft = draft.clone();
            draft.areas.sort_by_key(|area| matches!(area.shape, Shape::Circle { .. }));
            std::fs::write(&file, write(&file, &draft)?.0).unwrap();
            match read_fence(&file) {
                Ok(areas) => {
                    prop_assert!(!areas.is_empty() && same_areas(&areas, &draft.areas), "{}", ending);
                }
                Err(fault) => prop_assert!(draft.areas.is_empty(), "{}", fault),
            }
        }
    }

    /// Damage to a file of each kind is an error or a route, never a panic.
    #[test]
    fn damaged_files_are_survived(draft in draft(true), at in any::<prop::sample::Index>(), byte in any::<u8>(), cut in any::<bool>()) {
        let folder = tempfile::tempdir().unwrap();
        for ending in ["plan", "waypoints", "kml", "kmz", "geojson", "csv", "gpx", "toml"] {
            let file = folder.path().join(format!("route.{ending}"));
            let mut draft = draft.clone();
            draft.datum = Datum::SeaLevel;
            let (mut bytes, _) = write(&file, &draft)?;
            let at = at.index(bytes.len());
            bytes[at] = byte;
            if cut {
                bytes.truncate(at);
            }
            std::fs::write(&file, bytes).unwrap();
            if let Ok(read) = read_track(&file, &Selection::default()) {
                let _ = read.to_send(&file);
                let _ = write(&file, &read);
            }
        }
    }
}

/// MAVProxy saves fences and rally points in files of their own, as items of a mission.
#[test]
fn a_fence_file_of_mavproxy_is_a_fence() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("fence.txt");
    let row = |k: usize, command: u16, p1: f64, lat: f64, lon: f64| {
        format!(
            "{k}\t0\t0\t{command}\t{p1:.6}\t0.000000\t0.000000\t0.000000\t{lat:.6}\t{lon:.6}\t0.000000\t1\n"
        )
    };
    let text = [
        "QGC WPL 110\n".to_owned(),
        row(0, 5001, 3.0, 47.1, 8.1),
        row(1, 5001, 3.0, 47.2, 8.1),
        row(2, 5001, 3.0, 47.2, 8.2),
        row(3, 5004, 25.0, 47.15, 8.15),
        row(4, 5100, 0.0, 47.11, 8.11),
    ];
    std::fs::write(&file, text.concat()).unwrap();
    let areas = read_fence(&file).unwrap();
    let polygon = vec![[47.1, 8.1], [47.2, 8.1], [47.2, 8.2]];
    assert_eq!(areas[0].shape, Shape::Polygon(polygon));
    assert_eq!((areas[0].keep, areas[1].keep), (Keep::In, Keep::Out));
    assert_eq!(areas.len(), 2);
    let none = folder.path().join("none.gpx");
    std::fs::write(&none, "<gpx><wpt lat=\"47\" lon=\"8\"/></gpx>").unwrap();
    let fault = read_fence(&none).unwrap_err();
    assert!(
        fault
            .to_string()
            .ends_with("no geofence, expected at least one area")
    );
    // A polygon that is not complete is named, and no fence.
    std::fs::write(
        &file,
        [
            "QGC WPL 110\n".into(),
            row(0, 5001, 3.0, 47.1, 8.1),
            row(1, 16, 0.0, 47.0, 8.0),
        ]
        .concat(),
    )
    .unwrap();
    let draft = read_track(&file, &Selection::default()).unwrap();
    assert_eq!(
        draft.losses.lost[0].what,
        "geofence polygon cut short (1 vertices)"
    );
    // A rally point has a height above home (frame 3): one above sea level (frame 0) is none that could be returned at.
    let rally = row(2, 5100, 0.0, 47.11, 8.11);
    let relative = rally.replacen("\t0\t0\t", "\t0\t3\t", 1);
    for (rally, count) in [(relative, 1), (rally, 0)] {
        let way = [(0, 47.0), (1, 47.01)].map(|(k, lat)| row(k, 16, 0.0, lat, 8.0));
        let text = format!("QGC WPL 110\n{}{rally}", way.concat());
        std::fs::write(&file, text).unwrap();
        let draft = read_track(&file, &Selection::default()).unwrap();
        assert_eq!(draft.rally.len(), count, "{rally}");
        let mut lost = draft.losses.lost.iter();
        let named = lost.any(|loss| loss.what.contains("rally point without an altitude"));
        assert_eq!(named, count == 0, "{:?}", draft.losses.lost);
    }
}

#[test]
fn a_place_that_is_none_is_refused_with_its_line_before_it_is_sent() {
    let gpx = |lat: &str| {
        format!(
            "<gpx><rte>\n<rtept lat=\"47\" lon=\"8\"><ele>9</ele></rtept>\n<rtept lat=\"{lat}\" lon=\"8\"><ele>9</ele></rtept></rte></gpx>"
        )
    };
    let kml = |place: &str| {
        format!(
            "<kml><LineString><altitudeMode>absolute</altitudeMode>\n<coordinates>8,47,9\n{place}</coordinates></LineString></kml>"
        )
    };
    for (name, text, expected) in [
        (
            "a.gpx",
            gpx("407.3981"),
            "a.gpx:3: waypoint 2: position: latitude is 407.3981, expected -90 to 90",
        ),
        (
            "a.gpx",
            gpx("NaN"),
            "a.gpx:3: waypoint 2: position: latitude is NaN, expected a finite number",
        ),
        (
            "a.kml",
            kml("-188,47,9"),
            "a.kml:3: waypoint 2: position: longitude is -188, expected -180 to 180",
        ),
        (
            "a.kml",
            kml("8,47,inf"),
            "a.kml:3: waypoint 2: position: altitude is inf, expected a finite number",
        ),
        (
            "a.csv",
            "lat,lon,alt\n407.3981,8,9\n47,8,9\n".into(),
            "a.csv:2: waypoint 1: position: latitude is 407.3981",
        ),
        (
            "a.geojson",
            "{\"type\":\"LineString\",\"coordinates\":[[8,47,9],\n[8,407.3981,9]]}".into(),
            "a.geojson:2: waypoint 2: position: latitude is 407.3981",
        ),
    ] {
        let read = content_to_send(Path::new(name), text.into_bytes(), &Import::default());
        let fault = read.expect_err(name).to_string();
        assert!(fault.starts_with(expected), "{fault}");
    }
}

/// Of a file that somebody else sends: 256 KiB, the most that a web client's frame holds, made to cost as much as it can.
#[test]
fn a_file_that_was_made_to_cost_time_or_memory_is_read_at_once_or_refused() {
    const MOST: usize = 256 << 10;
    let fill = |head: &str, part: &str, tail: &str| {
        let parts = (MOST - head.len() - tail.len()) / part.len();
        format!("{head}{}{tail}", part.repeat(parts))
    };
    let line = "{\"type\":\"LineString\",\"coordinates\":[";
    let point = "{\"type\":\"Point\",\"coordinates\":[8,47,9]},";
    let name = "n".repeat(120_000);
    let named = format!("<kml><Placemark><name>{name}</name>");
    let files = [
        (
            "survey.geojson",
            fill(line, "[8.5,47.4,488],", "[8,47,9]]}").into_bytes(),
            None,
        ),
        (
            "short.geojson",
            fill(line, "[0,0],", "[0,0]]}").into_bytes(),
            None,
        ),
        (
            "points.geojson",
            fill(
                "{\"type\":\"GeometryCollection\",\"geometries\":[",
                point,
                "{}]}",
            )
            .into_bytes(),
            None,
        ),
        (
            "items.plan",
            fill(
                "{\"fileType\":\"Plan\",\"mission\":{\"items\":[",
                "{\"type\":\"SimpleItem\",\"command\":16,\"frame\":3,\"params\":[0,0,0,0,47,8,9]},",
                "{\"type\":\"ComplexItem\"}]}}",
            )
            .into_bytes(),
            None,
        ),
        (
            "names.kml",
            fill(&named, "<LineString/>", "</Placemark></kml>").into_bytes(),
            Some("lines, expected one that is flown"),
        ),
        (
            "bomb.kmz",
            zipped(&"<a/>".repeat(4 << 20)),
            Some("is over 1048576 bytes"),
        ),
    ];
    for (name, content, refused) in files {
        let import = Import {
            most_unpacked: Some(1 << 20),
            ..Import::of(None, None, Some(50.0))
        };
        let begun = std::time::Instant::now();
        let read = content_to_send(Path::new(name), content, &import);
        let took = begun.elapsed();
        assert!(took.as_secs() < 10, "{name}: {took:?}");
        match refused {
            None => assert!(read.is_ok(), "{name}: {:?}", read.err()),
            Some(why) => {
                let fault = read.expect_err(name).to_string();
                assert!(
                    fault.contains(why) && fault.len() < 2_000,
                    "{name}: {fault:.300}"
                );
            }
        }
    }
}

/// What is looked up for each waypoint must not be looked for from the beginning of the file.
#[test]
fn a_route_file_of_many_waypoints_and_curves_is_read_at_once() {
    use std::fmt::Write as _;
    let mut text = String::from("[defaults]\naltitude = 30.0\naltitude_type = \"agl\"\n");
    let north = |n: u32| 40.0 + f64::from(n) * 1e-4;
    for n in 1..=5_000 {
        let _ = write!(
            text,
            "\n[[waypoint]]\nnumber = {n}\nlatitude = {:.6}\nlongitude = 8.5\n",
            north(n)
        );
    }
    for n in 1..5_000 {
        let (p2, p3) = (north(n) + 3e-5, north(n) + 6e-5);
        let _ = write!(
            text,
            "\n[[curve]]\nfrom = {n}\nto = {}\np2 = [{p2:.6}, 8.5]\np3 = [{p3:.6}, 8.5]\n",
            n + 1
        );
    }
    let begun = std::time::Instant::now();
    let file = Path::new("long.toml");
    let (route, _) = content_to_send(file, text.clone().into_bytes(), &Import::default()).unwrap();
    assert_eq!(route.waypoints.len(), 5_000);
    let draft = read_content(file, text.clone().into_bytes(), &Import::default()).unwrap();
    assert_eq!(draft.points.len(), 5_000);
    assert_eq!(draft.points[1].line, Some(11));
    assert!(
        draft.points[..4_999]
            .iter()
            .all(|point| point.curve.is_some())
    );
    write(file, &draft).unwrap();
    let took = begun.elapsed();
    assert!(took.as_secs() < 15, "{took:?}");
}

fn zipped(kml: &str) -> Vec<u8> {
    kml::pack(Path::new("bomb.kmz"), kml).expect("it is packed")
}
