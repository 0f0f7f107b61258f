//! A route that cannot be flown is refused whole, with the waypoint's number and the reason; the vehicle keeps what
//! it has.

use kit::bridge::{Faults, Rig, Setup, orders, vehicle_id};
use px4_sim::{Airframe, Config, Param};
use stanag_msgs::Message;
use stanag_msgs::enums::{
    AckType, AltitudeType, FlightPathControlMode as Mode, LimitType, LocationType,
    LoiterDurationUnits, MissionTransferStatus, WaypointType,
};
use stanag_msgs::messages::{CurveSegment, UaLoiterWaypoint, UaPositionWaypoint};
use stanag_msgs::{Bam32, Scaled};

/// Loads a plan that must be refused; the number in 14000, and the text of 16000.
fn refused(rig: &mut Rig, plan: Vec<Message>) -> (Option<u16>, String) {
    let cleared = rig.station().received.len();
    rig.send_plan(plan);
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::Refused));
    rig.run(0.5);
    let received = &rig.station().received[cleared..];
    let number = received
        .iter()
        .rev()
        .find_map(|(_, _, message)| match message {
            Message::MissionUploadDownloadStatus(status)
                if status.status == Some(MissionTransferStatus::Aborted) =>
            {
                Some(status.waypoint_request)
            }
            _ => None,
        });
    let why = received
        .iter()
        .rev()
        .find_map(|(_, from, message)| match message {
            Message::SubsystemStatusAlert(_) => {
                assert_eq!(*from, vehicle_id(0));
                Some(rig.station().alerts().pop().unwrap_or_default())
            }
            _ => None,
        });
    (
        number.expect("a 14000 with status 2"),
        why.unwrap_or_default(),
    )
}

fn first(change: impl FnOnce(&mut UaPositionWaypoint)) -> Vec<Message> {
    let mut waypoint = orders::waypoint(7, 8, 50.0, 0.0, 20.0);
    change(&mut waypoint);
    vec![
        orders::route(7).into(),
        waypoint.into(),
        orders::waypoint(8, 0, 50.0, 50.0, 20.0).into(),
    ]
}

#[test]
fn every_fault_is_named_with_its_waypoint_and_the_vehicle_keeps_its_mission() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    let stored = rig.vehicles[0].vehicle().counters().plans_stored;

    let cases: Vec<(Vec<Message>, u16, &str)> = vec![
        (first(|w| w.next_waypoint = Some(99)), 99, "not received"),
        (vec![orders::route(77).into()], 77, "not received"),
        (
            vec![
                orders::route(7).into(),
                orders::waypoint(7, 8, 50.0, 0.0, 20.0).into(),
                orders::waypoint(8, 7, 50.0, 50.0, 20.0).into(),
            ],
            7,
            "Waypoint Type 1",
        ),
        (
            first(|w| w.waypoint_altitude_type = None),
            7,
            "without its type",
        ),
        (
            first(|w| w.waypoint_to_altitude = None),
            7,
            "Altitude is missing",
        ),
        (
            first(|w| w.waypoint_to_altitude = Some(Scaled::saturating_from_si(9_000.0))),
            7,
            "9000 m above home",
        ),
        (
            first(|w| w.waypoint_altitude_type = Some(AltitudeType::from_raw(9))),
            7,
            "altitude type 9",
        ),
        (
            first(|w| {
                w.waypoint_to_latitude_or_relative_y = Some(Bam32::from_degrees(48.5));
            }),
            7,
            "m from home, at most 5000",
        ),
        (
            first(|w| {
                w.waypoint_to_latitude_or_relative_y = Some(Bam32::from_degrees(120.0));
            }),
            7,
            "latitude 120",
        ),
        (
            first(|w| w.location_type = Some(LocationType::Relative)),
            7,
            "relative coordinates",
        ),
        (
            first(|w| w.waypoint_to_speed = Some(Scaled::saturating_from_si(30.0))),
            7,
            "speed 30.0",
        ),
        (
            first(|w| w.waypoint_type = Some(WaypointType::EndOfLoop)),
            7,
            "leads to 8, expected a waypoint flown before",
        ),
    ];
    for (plan, number, why) in cases {
        let (named, text) = refused(&mut rig, plan);
        assert_eq!(named, Some(number), "{why}: {text}");
        assert!(text.contains(why), "{why}: {text}");
    }
    assert_eq!(rig.vehicles[0].vehicle().counters().plans_stored, stored);
}

/// A plan whose second waypoint is reached at this speed.
fn at_speed(speed_m_s: f64) -> Vec<Message> {
    let mut plan = first(|w| w.next_waypoint = Some(9));
    let mut fast = orders::waypoint(9, 0, 50.0, 50.0, 20.0);
    fast.waypoint_to_speed = Some(Scaled::saturating_from_si(speed_m_s));
    plan.push(fast.into());
    plan
}

fn with(airframe: Airframe, params: &[(Param, f64)]) -> Setup {
    let vehicle = Config {
        airframe,
        params: params.to_vec(),
        ..Config::default()
    };
    Setup {
        vehicles: vec![vehicle],
        ..Setup::default()
    }
}

#[test]
fn a_speed_that_the_vehicle_does_not_fly_is_refused_with_waypoint_value_and_range() {
    use Airframe::{Plane, Quad};
    let faster = [(Param::MPC_XY_VEL_MAX, 15.0)];
    let anywhere = [(Param::MIS_TKO_LAND_REQ, 0.0)];
    for (airframe, params, beyond_m_s, fine_m_s, range) in [
        (Quad, &[][..], 12.5, 12.0, "0.5 to 12.0"),
        (Quad, &faster[..], 15.5, 15.0, "0.5 to 15.0"),
        (Plane, &anywhere[..], 20.5, 20.0, "10.0 to 20.0"),
        (Plane, &anywhere[..], 9.5, 10.0, "10.0 to 20.0"),
    ] {
        let mut rig = Rig::ready_with(with(airframe, params));
        let (named, text) = refused(&mut rig, at_speed(beyond_m_s));
        assert_eq!(named, Some(9), "{text}");
        let why = format!("waypoint 9: speed {beyond_m_s:.1} m/s, expected {range}");
        assert!(text.contains(&why), "{why}: {text}");
        rig.send_plan(at_speed(fine_m_s));
        let end = rig.carry_out(orders::load());
        assert_eq!(end, Some(AckType::CarriedOut), "{airframe:?} {fine_m_s}");
    }
}

#[test]
fn a_load_waits_for_the_parameters_that_bound_it() {
    // Home and parameters are asked for at once: where packets are lost either may come first.
    let mut too_fast = 0;
    for seed in 1..=20 {
        let mut rig = Rig::new(Setup {
            seed,
            mav: Faults {
                loss: 0.25,
                ..Faults::NONE
            },
            ..Setup::default()
        });
        rig.done(orders::request_control());
        let live = |rig: &Rig| {
            let bridge = rig.bridge.as_ref().expect("it runs");
            bridge.status(String::new(), rig.now().mono).vehicles[0].live
        };
        assert!(rig.until(20.0, live), "the link is live");
        let (_, text) = refused(&mut rig, at_speed(20.0));
        let why = "waypoint 9: speed 20.0 m/s, expected 0.5 to 12.0";
        too_fast += u32::from(text.contains(why));
        let homeless = text.contains("has not reported its home position");
        assert!(text.contains(why) || homeless, "{seed}: {text}");
    }
    assert!(too_fast > 10, "{too_fast} of 20");
}

fn lap(limit: LimitType, times: Option<u16>) -> Vec<Message> {
    let mut end = orders::waypoint(43, 42, 0.0, 60.0, 20.0);
    end.waypoint_type = Some(WaypointType::EndOfLoop);
    end.limit_type = Some(limit);
    end.loop_limit = times;
    vec![
        orders::route(41).into(),
        orders::waypoint(41, 42, 30.0, 0.0, 20.0).into(),
        orders::waypoint(42, 43, 60.0, 60.0, 20.0).into(),
        end.into(),
    ]
}

#[test]
fn loops_that_px4_cannot_fly_are_refused() {
    let mut rig = Rig::ready();
    for (limit, times, why) in [
        (LimitType::Time, Some(60), "by count only"),
        (LimitType::Count, Some(0), "Loop Limit 0"),
        (LimitType::Count, None, "Loop Limit is missing"),
        (LimitType::from_raw(7), Some(1), "Limit Type 7"),
    ] {
        let (named, text) = refused(&mut rig, lap(limit, times));
        assert_eq!(named, Some(43), "{text}");
        assert!(text.contains(why), "{why}: {text}");
    }
}

#[test]
fn a_loop_is_flown_as_often_as_its_limit() {
    let mut rig = Rig::ready();
    rig.send_plan(lap(LimitType::Count, Some(3)));
    rig.done(orders::load());
    rig.take_off(20.0);
    let waypoint = orders::mode(stanag_msgs::enums::FlightPathControlMode::Waypoint);
    rig.done(waypoint);
    let (mut passes, mut before) = (0, None);
    for _ in 0..3_000 {
        rig.run(0.1);
        let to = rig
            .station()
            .last(vehicle_id(0), 4001, |message| match message {
                Message::FromToNextWaypointStates(states) => states.to_waypoint_number,
                _ => None,
            });
        passes += u32::from(to == Some(42) && before != Some(42));
        before = to;
        if to == Some(0) {
            break;
        }
    }
    assert_eq!((passes, before), (3, Some(0)));
}

#[test]
fn turns_are_refused_on_a_multicopter_and_times_are_not() {
    let mut rig = Rig::ready();
    let plan = |units| {
        let mut plan = first(|_| {});
        plan.push(
            UaLoiterWaypoint {
                waypoint_number: Some(8),
                loiter_duration: Some(4),
                loiter_duration_units: Some(units),
                ..UaLoiterWaypoint::default()
            }
            .into(),
        );
        plan
    };
    let (named, text) = refused(&mut rig, plan(LoiterDurationUnits::Turns));
    assert_eq!(named, Some(8));
    assert!(text.contains("turns"), "{text}");
    rig.send_plan(plan(LoiterDurationUnits::Seconds));
    rig.done(orders::load());
}

/// Two waypoints, of which the second is at this altitude.
fn second_at(altitude_m: f64, kind: AltitudeType) -> Vec<Message> {
    let mut second = orders::waypoint(8, 0, 50.0, 50.0, 20.0);
    second.waypoint_to_altitude = Some(Scaled::saturating_from_si(altitude_m));
    second.waypoint_altitude_type = Some(kind);
    vec![
        orders::route(7).into(),
        orders::waypoint(7, 8, 50.0, 0.0, 20.0).into(),
        second.into(),
    ]
}

#[test]
fn a_route_below_home_is_refused_whatever_its_altitudes_are_above_unless_it_is_allowed() {
    let home_m = Config::default().home.altitude_m;
    let geoid_m = Config::default().geoid_separation_m;
    let low = [
        (home_m - 8.0, AltitudeType::Barometric),
        (home_m - 8.0, AltitudeType::Pressure),
        (-8.0, AltitudeType::Agl),
        (home_m + geoid_m - 8.0, AltitudeType::Wgs84),
    ];
    let mut rig = Rig::ready();
    for (altitude_m, kind) in low {
        let (named, text) = refused(&mut rig, second_at(altitude_m, kind));
        assert_eq!(named, Some(8), "{kind:?} {text}");
        for part in [
            "waypoint 8: 4",
            "m AMSL is ",
            "m below home (48",
            "vehicle.limits.below_home",
        ] {
            assert!(text.contains(part), "{kind:?}: {part}: {text}");
        }
    }
    // What an importer that takes an absent altitude for 0 would send.
    let (named, _) = refused(&mut rig, second_at(0.0, AltitudeType::Barometric));
    assert_eq!(named, Some(8));
    let mut rig = Rig::ready_with(Setup {
        vehicle_keys: "limits = { below_home = true }",
        ..Setup::default()
    });
    for (altitude_m, kind) in low {
        rig.send_plan(second_at(altitude_m, kind));
        let end = rig.carry_out(orders::load());
        assert_eq!(
            end,
            Some(AckType::CarriedOut),
            "{kind:?} {:?}",
            rig.station().alerts()
        );
    }
    let (named, text) = refused(&mut rig, second_at(-600.0, AltitudeType::Agl));
    assert_eq!(named, Some(8));
    assert!(text.contains("expected -500 to 5000"), "{text}");
}

/// A curve from waypoint 7 to 8 by its control points, metres north and east of home.
fn curve(p2: (f64, f64), p3: (f64, f64)) -> CurveSegment {
    let degrees = |(north, east): (f64, f64)| {
        let (latitude, longitude) = orders::place(north, east);
        (
            Some(Bam32::from_degrees(latitude)),
            Some(Bam32::from_degrees(longitude)),
        )
    };
    let (p2, p3) = (degrees(p2), degrees(p3));
    CurveSegment {
        p1_waypoint_no: Some(7),
        p4_waypoint_no: Some(8),
        p2_latitude: p2.0,
        p2_longitude: p2.1,
        p3_latitude: p3.0,
        p3_longitude: p3.1,
        ..CurveSegment::default()
    }
}

/// Its route: both ends 30 m above home.
fn curved(curve: CurveSegment) -> Vec<Message> {
    vec![
        orders::route(7).into(),
        orders::waypoint(7, 8, 50.0, -80.0, 30.0).into(),
        orders::waypoint(8, 0, 50.0, 80.0, 30.0).into(),
        curve.into(),
    ]
}

#[test]
fn a_curve_that_dips_below_home_between_waypoints_above_it_is_refused() {
    let mut rig = Rig::ready();
    let low = Some(Scaled::saturating_from_si(-20.0));
    let dip = CurveSegment {
        p2_altitude: low,
        p3_altitude: low,
        altitude_type: Some(AltitudeType::Agl),
        ..curve((50.0, -30.0), (50.0, 30.0))
    };
    let (named, text) = refused(&mut rig, curved(dip));
    assert_eq!(named, Some(7), "{text}");
    for part in [
        "waypoint 7: its curved leg to 8: at 47.",
        "m below home (48",
        "vehicle.limits.below_home",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    // It is that the curve dips: without it the same route is flown.
    let mut level = curved(curve((50.0, -30.0), (50.0, 30.0)));
    level.truncate(3);
    rig.send_plan(level);
    rig.done(orders::load());
}

/// A folder with one elevation file: the ground at home's height, and a ridge of 60 m across, 100 m to 160 m north of home.
fn ridge() -> tempfile::TempDir {
    let home = Config::default().home;
    let (step, rows, columns) = (0.0002, 40_u32, 40_u32);
    let mut text = format!(
        "ncols {columns}\nnrows {rows}\nxllcenter {}\nyllcenter {}\ncellsize {step}\n",
        home.longitude_deg - 0.004,
        home.latitude_deg - 0.004
    );
    for row in (0..rows).rev() {
        let north_m = (f64::from(row) * step - 0.004) * 111_195.0;
        let ridge_m = if (100.0..160.0).contains(&north_m) {
            60.0
        } else {
            0.0
        };
        let height = format!("{:.1} ", home.altitude_m + ridge_m);
        text += &height.repeat(columns as usize);
        text.push('\n');
    }
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("ridge.asc"), text).expect("it can be written");
    folder
}

#[test]
fn a_route_through_a_ridge_is_refused_between_its_waypoints_and_on_its_curves() {
    let ground = ridge();
    let keys =
        |more: &str| -> &'static str { format!("terrain = {:?}\n{more}", ground.path()).leak() };
    // Each waypoint is 30 m above the ground below it.
    let over = |height_m| -> Vec<Message> {
        vec![
            orders::route(7).into(),
            orders::waypoint(7, 8, 50.0, 0.0, height_m).into(),
            orders::waypoint(8, 0, 250.0, 0.0, height_m).into(),
        ]
    };
    let mut rig = Rig::ready_with(Setup {
        vehicle_keys: keys(""),
        ..Setup::default()
    });
    let (named, text) = refused(&mut rig, over(30.0));
    assert_eq!(named, Some(8), "{text}");
    for part in [
        "m below the terrain (548.0 m)",
        "m AMSL is 30.",
        "vehicle.limits.above_terrain_m",
    ] {
        assert!(text.contains(part), "{part}: {text}");
    }
    // A curve that bulges into the ridge, between waypoints that are both south of it.
    let bulge = curve((180.0, -60.0), (180.0, 60.0));
    let (named, text) = refused(&mut rig, curved(bulge));
    assert_eq!(named, Some(8), "{text}");
    assert!(text.contains("m below the terrain ("), "{text}");
    // Above it both are flown, and where the files end a note says so.
    rig.send_plan(over(70.0));
    rig.done(orders::load());
    rig.send_plan(vec![
        orders::route(7).into(),
        orders::waypoint(7, 8, 250.0, 0.0, 70.0).into(),
        orders::waypoint(8, 0, 900.0, 0.0, 70.0).into(),
    ]);
    rig.done(orders::load());
    let notes = rig.station().alerts().join("; ");
    assert!(notes.contains("vehicle.terrain does not cover"), "{notes}");
    // Closer than configured, and below the ground where that is allowed.
    for (more, height_m, expected) in [
        ("limits = { above_terrain_m = 20 }", 70.0, false),
        ("limits = { above_terrain_m = -40 }", 30.0, true),
    ] {
        let mut rig = Rig::ready_with(Setup {
            vehicle_keys: keys(more),
            ..Setup::default()
        });
        rig.send_plan(over(height_m));
        let done = rig.carry_out(orders::load()) == Some(AckType::CarriedOut);
        assert_eq!(done, expected, "{more} {:?}", rig.station().alerts());
    }
}

#[test]
fn the_way_to_the_route_is_compared_with_the_terrain_where_it_is_flown() {
    let ground = ridge();
    let terrain = format!("terrain = {:?}\n", ground.path());
    let mut rig = Rig::ready_with(Setup {
        vehicle_keys: terrain.leak(),
        ..Setup::default()
    });
    // The route itself is beyond the ridge, and above the ground there.
    let beyond = |height_m| -> Vec<Message> {
        vec![
            orders::route(7).into(),
            orders::waypoint(7, 8, 250.0, 0.0, height_m).into(),
            orders::waypoint(8, 0, 300.0, 0.0, height_m).into(),
        ]
    };
    rig.send_plan(beyond(30.0));
    rig.done(orders::load());
    rig.take_off(20.0);
    assert_eq!(
        rig.carry_out(orders::mode(Mode::Waypoint)),
        Some(AckType::Refused)
    );
    let text = rig.station().alerts().join("; ");
    assert!(
        text.contains("from where the vehicle is, waypoint 7: on the way to it, at ")
            && text.contains("m below the terrain (548.0 m)"),
        "{text}"
    );
    // PX4 climbs to the altitude of the waypoint before it flies there.
    rig.send_plan(beyond(70.0));
    rig.done(orders::load());
    rig.done(orders::mode(Mode::Waypoint));
}

#[test]
fn latitude_and_longitude_that_are_exchanged_are_named_as_that() {
    let mut rig = Rig::ready();
    let mut first = orders::waypoint(7, 0, 50.0, 0.0, 30.0);
    std::mem::swap(
        &mut first.waypoint_to_latitude_or_relative_y,
        &mut first.waypoint_to_longitude_or_relative_x,
    );
    let (named, text) = refused(&mut rig, vec![orders::route(7).into(), first.into()]);
    assert_eq!(named, Some(7));
    assert!(
        text.contains("m from home, at most 5000 (with latitude and longitude exchanged"),
        "{text}"
    );
    let far = orders::waypoint(7, 0, 9_000.0, 0.0, 30.0);
    let (_, text) = refused(&mut rig, vec![orders::route(7).into(), far.into()]);
    assert!(
        text.contains("from home, at most 5000") && !text.contains("exchanged"),
        "{text}"
    );
}
