//! The geofence: areas from a station and from the configuration, on the vehicle, read back and compared.

use kit::bridge::{Rig, Setup, orders, vehicle_id};
use mavlink_link::dialect::{MISSION_CLEAR_ALL_DATA, MavMessage, MavMissionType};
use mavlink_link::service::Node;
use stanag_msgs::enums::{
    AckType, AreaPlanMode, AreaType, FlightPathControlMode, MissionTransferStatus,
};
use stanag_msgs::messages::{AreaTransferCommand, AreaTransferStatus, AreaVertex};
use stanag_msgs::{Bam32, Message};

/// Corners of a square about home, metres north and east.
const SQUARE: [(f64, f64); 4] = [
    (300.0, 300.0),
    (300.0, -300.0),
    (-300.0, -300.0),
    (-300.0, 300.0),
];

fn vertex(area: u16, kind: AreaType, count: u8, number: u8, at: (f64, f64)) -> AreaVertex {
    let (latitude, longitude) = orders::place(at.0, at.1);
    AreaVertex {
        area_id: Some(area),
        area_type: Some(kind),
        vertex_count: Some(count),
        vertex_number: Some(number),
        latitude: Some(Bam32::from_degrees(latitude)),
        longitude: Some(Bam32::from_degrees(longitude)),
        ..AreaVertex::default()
    }
}

fn polygon(area: u16, kind: AreaType, corners: &[(f64, f64)]) -> Vec<Message> {
    let count = corners.len() as u8;
    let corners = (1..).zip(corners);
    corners
        .map(|(number, at)| vertex(area, kind, count, number, *at).into())
        .collect()
}

fn circle(area: u16, kind: AreaType, at: (f64, f64), radius_m: f32) -> Message {
    AreaVertex {
        radius: Some(radius_m),
        ..vertex(area, kind, 1, 1, at)
    }
    .into()
}

fn order(mode: AreaPlanMode) -> AreaTransferCommand {
    AreaTransferCommand {
        area_plan_mode: Some(mode),
        ..AreaTransferCommand::default()
    }
}

fn status(rig: &Rig) -> AreaTransferStatus {
    let reported = rig
        .station()
        .last(vehicle_id(0), 50018, |message| match message {
            Message::AreaTransferStatus(status) => Some(status.clone()),
            _ => None,
        });
    reported.expect("a 50018")
}

/// Corners about home, at one distance.
fn ring(radius_m: f64, corners: u8) -> Vec<(f64, f64)> {
    let angle = |n: u8| std::f64::consts::TAU * f64::from(n) / f64::from(corners);
    let corner = |n| (radius_m * angle(n).cos(), radius_m * angle(n).sin());
    (0..corners).map(corner).collect()
}

/// Commands of the fence items that the vehicle holds.
fn aboard(rig: &Rig) -> Vec<u16> {
    let vehicle = rig.vehicles[0].vehicle();
    let items = vehicle.plan(MavMissionType::MAV_MISSION_TYPE_FENCE);
    items.iter().map(|item| item.command).collect()
}

#[test]
fn areas_go_aboard_whole_and_bound_the_routes_that_the_vehicle_takes() {
    let mut rig = Rig::ready();
    let mut areas = polygon(1, AreaType::KeepInPolygon, &SQUARE);
    areas.push(circle(2, AreaType::KeepOutCircle, (150.0, 0.0), 40.0));
    rig.send_plan(areas);
    assert!(aboard(&rig).is_empty(), "stored, not loaded");
    rig.done(order(AreaPlanMode::Load));
    assert_eq!(aboard(&rig), [5001, 5001, 5001, 5001, 5004]);
    rig.run(0.1);
    assert_eq!(status(&rig).status, Some(MissionTransferStatus::Complete));
    assert!(
        rig.station()
            .has_alert("on a breach of the fence the vehicle holds")
    );
    // A route through the circle is one that the vehicle itself refuses.
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 80.0, 0.0, 20.0).into(),
        orders::waypoint(2, 0, 150.0, 10.0, 20.0).into(),
    ]);
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::Refused));
    rig.run(0.5);
    assert!(
        rig.station().has_alert("Geofence violation"),
        "{:?}",
        rig.station().alerts()
    );
    rig.send_plan(vec![orders::waypoint(2, 0, 250.0, 10.0, 20.0).into()]);
    rig.done(orders::load());
}

/// PX4 compares only the waypoints, and breaks the route off at the area.
#[test]
fn a_leg_across_an_area_is_an_alert_with_both_until_another_route_is_loaded() {
    let mut rig = Rig::ready();
    let keep_out = AreaType::KeepOutCircle;
    rig.send_plan(vec![circle(2, keep_out, (150.0, 0.0), 40.0)]);
    rig.done(order(AreaPlanMode::Load));
    let across = "the leg from waypoint 1 to waypoint 2 enters area 2, to stay outside of";
    let none = "no leg of the route aboard crosses an area of the fence any more";
    let mut load = |(north, east)| {
        rig.send_plan(vec![
            orders::route(1).into(),
            orders::waypoint(1, 2, 80.0, 0.0, 20.0).into(),
            orders::waypoint(2, 0, north, east, 20.0).into(),
        ]);
        rig.done(orders::load());
        rig.run(1.0);
        [across, none].map(|text| rig.station().has_alert(text))
    };
    assert_eq!(load((90.0, 250.0)), [false, false]);
    assert_eq!(load((250.0, 0.0)), [true, false]);
    assert_eq!(load((90.0, 250.0)), [true, true]);
    let alerts = rig.station().alerts();
    assert!(
        !alerts.iter().any(|alert| alert.contains("  ")),
        "{alerts:?}"
    );
}

/// The vehicle reads its fence for some seconds, and until then reports the mission as what it was within the former one.
#[test]
fn a_route_aboard_that_is_loaded_again_under_a_tighter_fence_is_refused() {
    let mut rig = Rig::ready();
    let route: Vec<Message> = vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 80.0, 0.0, 20.0).into(),
        orders::waypoint(2, 0, 250.0, 0.0, 20.0).into(),
    ];
    rig.send_plan(polygon(1, AreaType::KeepInPolygon, &ring(500.0, 40)));
    rig.done(order(AreaPlanMode::Load));
    rig.send_plan(route.clone());
    rig.done(orders::load());
    rig.send_plan(polygon(1, AreaType::KeepInPolygon, &ring(200.0, 40)));
    rig.done(order(AreaPlanMode::Load));
    rig.send_plan(route);
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::Refused));
    rig.run(0.5);
    assert!(rig.station().has_alert("the vehicle finds the route"));
}

#[test]
fn a_route_aboard_that_a_tighter_fence_makes_infeasible_is_an_alert_until_it_is_none() {
    let mut rig = Rig::ready();
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 80.0, 0.0, 20.0).into(),
        orders::waypoint(2, 0, 250.0, 0.0, 20.0).into(),
    ]);
    rig.done(orders::load());
    let fence = |rig: &mut Rig, radius_m| {
        rig.send_plan(vec![circle(
            1,
            AreaType::KeepInCircle,
            (0.0, 0.0),
            radius_m,
        )]);
        rig.done(order(AreaPlanMode::Load));
        rig.run(5.0);
    };
    let infeasible = "finds the route aboard infeasible within its fence";
    fence(&mut rig, 500.0);
    assert!(!rig.station().has_alert(infeasible));
    fence(&mut rig, 200.0);
    assert!(rig.station().has_alert(infeasible));
    // PX4 enters AUTO.MISSION on the ground, and flies no route after the launch.
    let mode_11 = orders::mode(FlightPathControlMode::Waypoint);
    assert_eq!(rig.carry_out(mode_11), Some(AckType::Refused));
    rig.run(0.5);
    let why = "mode 11 (waypoint): the vehicle finds the route aboard infeasible within its fence (waypoint 2 breaches it)";
    assert!(rig.station().has_alert(why), "{:?}", rig.station().alerts());
    fence(&mut rig, 500.0);
    assert!(
        rig.station()
            .has_alert("finds no route aboard infeasible any more")
    );
}

#[test]
fn what_makes_no_fence_is_refused_with_the_vertex_and_nothing_goes_aboard() {
    let mut rig = Rig::ready();
    let mut areas = polygon(7, AreaType::KeepInPolygon, &SQUARE);
    areas.remove(2);
    rig.send_plan(areas);
    assert_eq!(
        rig.carry_out(order(AreaPlanMode::Load)),
        Some(AckType::Refused)
    );
    rig.run(0.1);
    let reported = status(&rig);
    assert_eq!(
        (reported.area_id, reported.vertex_number),
        (Some(7), Some(3))
    );
    assert_eq!(reported.status, Some(MissionTransferStatus::Aborted));
    assert!(
        rig.station()
            .has_alert("area 7 vertex 3: it has not been received")
    );
    rig.done(order(AreaPlanMode::Clear));
    // The vehicle stands within it.
    rig.send_plan(vec![circle(8, AreaType::KeepOutCircle, (0.0, 0.0), 50.0)]);
    assert_eq!(
        rig.carry_out(order(AreaPlanMode::Load)),
        Some(AckType::Refused)
    );
    rig.run(0.1);
    assert!(
        rig.station()
            .has_alert("area 8: the vehicle is currently inside it")
    );
    assert!(aboard(&rig).is_empty());
    // By itself no corner of anything.
    let none = vertex(9, AreaType::KeepInPolygon, 2, 1, (0.0, 0.0));
    assert_eq!(rig.carry_out(none), Some(AckType::Refused));
    assert_eq!(
        rig.carry_out(order(AreaPlanMode::Unknown(9))),
        Some(AckType::Refused)
    );
}

#[test]
fn sixty_four_vertices_go_aboard_and_one_more_does_not() {
    let mut rig = Rig::ready();
    rig.send_plan(polygon(1, AreaType::KeepInPolygon, &ring(500.0, 63)));
    rig.send_plan(vec![circle(2, AreaType::KeepOutCircle, (200.0, 0.0), 20.0)]);
    rig.done(order(AreaPlanMode::Load));
    assert_eq!(aboard(&rig).len(), 64);
    let more = circle(3, AreaType::KeepOutCircle, (-200.0, 0.0), 20.0);
    assert_eq!(rig.carry_out(more), Some(AckType::Refused));
    rig.run(0.1);
    assert!(
        rig.station().has_alert("65 vertices"),
        "{:?}",
        rig.station().alerts()
    );
    assert_eq!(aboard(&rig).len(), 64);
}

/// The alert of a download while the vehicle reports another fence.
const NOT_REPORTED: &str = "the vehicle does not report the areas of this download as its fence";

/// The areas that a download sends.
fn downloaded(rig: &mut Rig) -> Vec<AreaVertex> {
    let mark = rig.station().received.len();
    rig.done(order(AreaPlanMode::Download));
    rig.station().received[mark..]
        .iter()
        .filter_map(|(_, _, message)| match message {
            Message::AreaVertex(vertex) => Some(vertex.clone()),
            _ => None,
        })
        .collect()
}

/// Whether a download sends the circle with this radius, and nothing else.
fn downloads_circle(rig: &mut Rig, radius_m: f32) -> bool {
    let came = downloaded(rig);
    matches!(&came[..], [circle] if circle.radius == Some(radius_m))
}

#[test]
fn a_download_shows_the_areas_that_were_loaded_and_not_those_sent_since() {
    let not_loaded = "areas were sent (50016) and not loaded";
    let mut rig = Rig::ready();
    rig.send_plan(vec![circle(1, AreaType::KeepInCircle, (0.0, 0.0), 800.0)]);
    assert_eq!(
        rig.carry_out(order(AreaPlanMode::Download)),
        Some(AckType::Refused)
    );
    rig.run(0.1);
    assert!(rig.station().has_alert("no areas are loaded"));
    assert_eq!(status(&rig).status, Some(MissionTransferStatus::Aborted));
    rig.done(order(AreaPlanMode::Load));
    assert!(downloads_circle(&mut rig, 800.0));
    rig.run(0.1);
    assert!(!rig.station().has_alert(not_loaded));
    assert!(!rig.station().has_alert(NOT_REPORTED));
    rig.send_plan(vec![circle(1, AreaType::KeepInCircle, (0.0, 0.0), 300.0)]);
    assert!(downloads_circle(&mut rig, 800.0));
    rig.run(0.1);
    assert!(rig.station().has_alert(not_loaded));
    // Nor those of a load that is cut off.
    let load = rig.send(order(AreaPlanMode::Load));
    rig.run(0.05);
    assert_eq!(rig.station().end(load), None, "too late for this test");
    rig.restart_bridge();
    assert_eq!(rig.end(load), Some(AckType::Refused));
    assert!(downloads_circle(&mut rig, 800.0));
}

#[test]
fn areas_come_back_as_they_were_sent_and_survive_a_restart() {
    let mut rig = Rig::ready();
    let sent = polygon(3, AreaType::KeepInPolygon, &SQUARE);
    rig.send_plan(sent.clone());
    rig.done(order(AreaPlanMode::Load));
    rig.restart_bridge();
    rig.run(8.0);
    let came = downloaded(&mut rig);
    assert_eq!(came.len(), 4);
    for (came, sent) in came.iter().zip(&sent) {
        let Message::AreaVertex(sent) = sent else {
            unreachable!()
        };
        let unstamped = AreaVertex {
            time_stamp: None,
            ..came.clone()
        };
        assert_eq!(unstamped, *sent);
    }
    rig.done(order(AreaPlanMode::Clear));
    assert!(aboard(&rig).is_empty());
    assert_eq!(
        rig.carry_out(order(AreaPlanMode::Download)),
        Some(AckType::Refused)
    );
}

#[test]
fn a_load_of_areas_that_a_restart_interrupts_is_reported_as_aborted() {
    let mut rig = Rig::ready();
    rig.send_plan(polygon(1, AreaType::KeepInPolygon, &SQUARE));
    let load = rig.send(order(AreaPlanMode::Load));
    rig.run(0.05);
    assert_eq!(rig.station().end(load), None, "too late for this test");
    rig.restart_bridge();
    assert_eq!(rig.end(load), Some(AckType::Refused));
    let reported = status(&rig);
    assert_eq!(reported.area_plan_mode, Some(AreaPlanMode::Load));
    assert_eq!(reported.status, Some(MissionTransferStatus::Aborted));
}

fn configured() -> Setup {
    // 0.01 degrees of latitude are 1.1 km.
    Setup {
        vehicle_keys: "[[vehicle.area]]\nkeep = \"in\"\ncentre = [47.3977434, 8.5455939]\nradius_m = 900.0\n",
        ..Setup::default()
    }
}

/// Whether the vehicle takes a route that ends so far north of home, in metres; it refuses none for another reason than its fence.
fn takes_route_to(rig: &mut Rig, north: f64) -> bool {
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 80.0, 0.0, 20.0).into(),
        orders::waypoint(2, 0, north, 0.0, 20.0).into(),
    ]);
    let is_taken = rig.carry_out(orders::load()) == Some(AckType::CarriedOut);
    rig.run(0.5);
    let alerts = rig.station().alerts();
    assert!(
        is_taken || rig.station().has_alert("Geofence violation"),
        "{alerts:?}"
    );
    is_taken
}

#[test]
fn areas_of_the_configuration_are_uploaded_before_any_request_and_stay() {
    let mut rig = Rig::ready_with(configured());
    assert!(rig.until(10.0, |rig| aboard(rig) == [5003]));
    rig.send_plan(vec![circle(1, AreaType::KeepOutCircle, (200.0, 0.0), 20.0)]);
    rig.done(order(AreaPlanMode::Load));
    assert_eq!(aboard(&rig), [5003, 5004]);
    // A station narrows them; it neither widens them nor takes them away.
    for (radius_m, north, is_within) in [
        (9_000.0, 1_000.0, false),
        (500.0, 600.0, false),
        (300.0, 250.0, true),
    ] {
        rig.send_plan(vec![circle(
            2,
            AreaType::KeepInCircle,
            (0.0, 0.0),
            radius_m,
        )]);
        rig.done(order(AreaPlanMode::Load));
        assert_eq!(aboard(&rig), [5003, 5004, 5003]);
        assert_eq!(takes_route_to(&mut rig, north), is_within, "{radius_m}");
    }
    rig.done(order(AreaPlanMode::Clear));
    assert_eq!(aboard(&rig), [5003]);
}

/// As a route is, which would be flown without the fence too.
#[test]
fn a_launch_is_refused_while_the_fence_of_the_file_cannot_go_aboard() {
    let mut rig = Rig::ready_with(Setup {
        vehicle_keys: "[[vehicle.area]]\nkeep = \"in\"\ncentre = [47.5, 8.5455939]\nradius_m = 900.0\n",
        ..Setup::default()
    });
    let why = "the fence is not uploaded: area 1 of the";
    assert!(rig.until(30.0, |rig| rig.station().has_alert(why)));
    let launch = || orders::launch(20.0);
    assert_eq!(rig.carry_out(launch()), Some(AckType::Refused));
    rig.run(0.5);
    let why = "mode 21 (launch): the vehicle is not known to hold its fence: area 1 of the";
    assert!(rig.station().has_alert(why), "{:?}", rig.station().alerts());
    let about_home = rig.text.replacen("[47.5, ", "[47.3977434, ", 1);
    rig.reload(&about_home).expect("applied");
    assert!(rig.until(10.0, |rig| aboard(rig) == [5003]));
    rig.run(5.0);
    rig.done(launch());
}

/// PX4 reads a polygon after a circle as many, each with corners of what follows.
#[test]
fn circles_go_aboard_after_the_polygons_and_every_area_binds() {
    let mut rig = Rig::ready();
    let mut areas = vec![circle(1, AreaType::KeepOutCircle, (150.0, 0.0), 40.0)];
    areas.extend(polygon(2, AreaType::KeepInPolygon, &SQUARE));
    rig.send_plan(areas);
    rig.done(order(AreaPlanMode::Load));
    assert_eq!(aboard(&rig), [5001, 5001, 5001, 5001, 5004]);
    for (north, is_within) in [(250.0, true), (150.0, false), (350.0, false)] {
        assert_eq!(takes_route_to(&mut rig, north), is_within, "{north}");
    }
    let alerts = rig.station().alerts();
    assert!(!rig.station().has_alert("Geofence invalid"), "{alerts:?}");
}

#[test]
fn a_fence_that_is_aboard_is_not_sent_again() {
    let mut rig = Rig::ready_with(configured());
    assert!(rig.until(10.0, |rig| aboard(rig) == [5003]));
    let stored = rig.vehicles[0].vehicle().counters().plans_stored;
    rig.restart_bridge();
    rig.run(15.0);
    assert_eq!(rig.vehicles[0].vehicle().counters().plans_stored, stored);
}

#[test]
fn a_fence_that_another_station_takes_away_is_warned_of_until_it_is_back() {
    let mut rig = Rig::ready();
    rig.send_plan(polygon(1, AreaType::KeepInPolygon, &SQUARE));
    rig.done(order(AreaPlanMode::Load));
    rig.run(5.0);
    assert!(!rig.station().has_alert("is not the loaded one"));
    let clear = MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
        target_system: 1,
        target_component: 1,
        mission_type: MavMissionType::MAV_MISSION_TYPE_FENCE,
    });
    rig.vehicles[0]
        .vehicle_mut()
        .handle_message(Node::new(255, 190), &clear);
    assert!(rig.until(5.0, |rig| {
        rig.station().has_alert("is not the loaded one")
    }));
    downloaded(&mut rig);
    rig.run(0.1);
    assert!(rig.station().has_alert(NOT_REPORTED));
    rig.done(order(AreaPlanMode::Load));
    assert!(rig.until(5.0, |rig| rig.station().has_alert("the fence is uploaded")));
}

#[test]
fn areas_that_leave_the_file_by_a_restart_while_they_are_uploaded_are_cleared() {
    let mut rig = Rig::ready();
    let (before, key) = (rig.text.clone(), "signing = { key_file = \"uav.key\" }\n");
    let keys = "area = [{ keep = \"in\", centre = [47.3977434, 8.5455939], radius_m = 900 }]\n";
    rig.reload(&before.replacen(key, &format!("{key}{keys}"), 1))
        .expect("applied");
    // The vehicle holds it, and it is not read back yet.
    assert!(rig.until(10.0, |rig| aboard(rig) == [5003]));
    rig.restart_with(&before);
    assert!(rig.until(15.0, |rig| aboard(rig).is_empty()));
}

/// Within the areas that it holds at the request, the vehicle would take it.
#[test]
fn a_route_that_is_loaded_before_the_areas_of_the_file_are_aboard_is_judged_within_them() {
    let mut rig = Rig::ready();
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 80.0, 0.0, 20.0).into(),
        orders::waypoint(2, 0, 250.0, 0.0, 20.0).into(),
    ]);
    let (before, key) = (rig.text.clone(), "signing = { key_file = \"uav.key\" }\n");
    let keys = "area = [{ keep = \"in\", centre = [47.3977434, 8.5455939], radius_m = 150 }]\n";
    rig.reload(&before.replacen(key, &format!("{key}{keys}"), 1))
        .expect("applied");
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::Refused));
    assert_eq!(aboard(&rig), [5003]);
    rig.run(0.5);
    let reasons = ["Geofence violation", "finds the route"];
    let alerts = rig.station().alerts();
    let named = reasons.iter().any(|reason| rig.station().has_alert(reason));
    assert!(named, "{alerts:?}");
}
