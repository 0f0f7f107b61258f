//! Routes of the five types are kept apart, and each is flown by its own mode of 2016.

use kit::bridge::{Rig, orders};
use mavlink_link::dialect::MavMissionType;
use px4_sim::Mode as Px4;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, MissionPlanMode, RouteType};
use stanag_msgs::messages::{MissionTransferCommand, UaRoute, VehicleOperatingModeCommand};
use stanag_msgs::{Message, Scaled, Text};

/// A route of two waypoints, metres north, of a name and a type.
fn route(name: &str, kind: RouteType, first: u16, north: f64) -> Vec<Message> {
    vec![
        UaRoute {
            route_id: Some(Text::new(name)),
            route_type: Some(kind),
            ..orders::route(first)
        }
        .into(),
        orders::waypoint(first, first + 1, north, 0.0, 20.0).into(),
        orders::waypoint(first + 1, 0, north, 60.0, 20.0).into(),
    ]
}

/// One route of each type, the flight route loaded.
fn with_all() -> Rig {
    let mut rig = Rig::ready();
    for (name, kind, first, north) in [
        ("L", RouteType::Launch, 1, 30.0),
        ("A", RouteType::Approach, 11, -40.0),
        ("F", RouteType::Flight, 21, 80.0),
        ("CA", RouteType::ContingencyA, 31, -80.0),
        ("CB", RouteType::ContingencyB, 41, 120.0),
    ] {
        rig.send_plan(route(name, kind, first, north));
    }
    rig.done(load());
    rig
}

/// 13000 of the flight route.
fn load() -> MissionTransferCommand {
    MissionTransferCommand {
        route_id: Some(Text::new("F")),
        ..orders::load()
    }
}

fn items(rig: &Rig) -> Vec<mavlink_link::service::mission::Item> {
    let kind = MavMissionType::MAV_MISSION_TYPE_MISSION;
    rig.vehicles[0].vehicle().plan(kind).to_vec()
}

/// Flies until it is this far north.
fn reaches(rig: &mut Rig, north: f64) -> bool {
    rig.until(90.0, |rig| (rig.truth().position.n - north).abs() < 12.0)
}

#[test]
fn each_mode_flies_the_route_of_its_type() {
    let mut rig = with_all();
    let flight = items(&rig);
    rig.done(orders::launch(20.0));
    assert_eq!(rig.truth().mode, Px4::Mission);
    assert!(reaches(&mut rig, 30.0), "the launch route");
    // What 13000 has loaded comes back by itself.
    rig.done(orders::mode(Mode::Waypoint));
    assert_eq!(items(&rig), flight);
    assert!(reaches(&mut rig, 80.0), "the flight route");
    rig.done(orders::mode(Mode::ContingencyA));
    assert!(reaches(&mut rig, -80.0), "contingency A");
    rig.done(orders::mode(Mode::ContingencyB));
    assert!(reaches(&mut rig, 120.0), "contingency B");
    rig.done(orders::mode(Mode::Waypoint));
    assert_eq!(items(&rig), flight);
    rig.done(orders::mode(Mode::AutolandEngage));
    assert!(reaches(&mut rig, -40.0), "the approach");
    assert!(rig.until(90.0, |rig| rig.truth().landed));
    assert!(
        (rig.truth().position.n + 40.0).abs() < 15.0,
        "{:?}",
        rig.truth().position
    );
}

/// As out of AUTO.LAND: back to where the landing began, or to the commanded altitude.
#[test]
fn a_landing_by_the_approach_is_broken_off_with_a_climb() {
    let to_32_m = VehicleOperatingModeCommand {
        select_flight_path_control_mode: Some(Mode::AutolandWaveOff),
        ..orders::launch(32.0)
    };
    for (order, reached) in [(orders::mode(Mode::AutolandWaveOff), 20.0), (to_32_m, 32.0)] {
        let mut rig = with_all();
        rig.done(orders::launch(20.0));
        rig.run(30.0);
        rig.done(orders::mode(Mode::AutolandEngage));
        let low = |rig: &Rig| rig.truth().mode == Px4::Mission && rig.truth().position.d > -10.0;
        assert!(rig.until(120.0, low), "{:?}", rig.truth());
        rig.done(order);
        rig.run(20.0);
        let truth = rig.truth();
        assert!((-truth.position.d - reached).abs() < 2.0, "{truth:?}");
        assert_eq!(truth.mode, Px4::Loiter);
    }
}

#[test]
fn without_routes_of_their_types_launch_and_landing_are_plain() {
    let mut rig = Rig::ready();
    rig.send_plan(route("F", RouteType::Flight, 21, 80.0));
    rig.done(orders::load());
    rig.done(orders::launch(20.0));
    assert_ne!(rig.truth().mode, Px4::Mission);
    assert!(rig.until(30.0, |rig| -rig.truth().position.d > 18.0));
    rig.done(orders::mode(Mode::AutolandEngage));
    assert_eq!(rig.truth().mode, Px4::Land);
}

#[test]
fn what_was_loaded_is_known_after_a_restart_of_the_bridge() {
    let mut rig = with_all();
    let flight = items(&rig);
    rig.done(orders::launch(20.0));
    assert_ne!(items(&rig), flight);
    rig.restart_bridge();
    rig.run(6.0);
    rig.done(orders::mode(Mode::Waypoint));
    assert_eq!(items(&rig), flight);
}

#[test]
fn one_waypoint_is_sent_again_and_a_route_is_deleted() {
    let mut rig = with_all();
    // The same plan again: the vehicle is sent nothing that changes it.
    let flight = items(&rig);
    rig.send_plan(vec![orders::waypoint(22, 0, 80.0, 90.0, 25.0).into()]);
    rig.done(load());
    let changed = items(&rig);
    assert_eq!(changed.len(), flight.len());
    assert_eq!(changed[0], flight[0]);
    assert_ne!(changed[1], flight[1]);
    // Initial waypoint 0 deletes the definition alone.
    rig.send_plan(vec![
        UaRoute {
            route_id: Some(Text::new("F")),
            ..orders::route(0)
        }
        .into(),
    ]);
    assert_eq!(rig.carry_out(load()), Some(AckType::Refused));
    rig.run(0.1);
    assert!(rig.station().has_alert("route \"F\" has not been received"));
    assert_eq!(items(&rig), changed, "what is aboard stays");
}

/// The north of the place that a mission leads to.
fn leads_north(rig: &Rig) -> Vec<i32> {
    let north = |item: &mavlink_link::service::mission::Item| {
        let home = orders::place(0.0, 0.0).0;
        ((f64::from(item.x) / 1e7 - home) * 111_200.0).round() as i32
    };
    let items = items(rig);
    items
        .iter()
        .filter(|item| item.is_global())
        .map(north)
        .collect()
}

#[test]
fn a_route_that_was_corrected_after_it_was_flown_is_flown_corrected() {
    let mut rig = with_all();
    rig.done(orders::launch(20.0));
    rig.done(orders::mode(Mode::ContingencyA));
    rig.done(orders::mode(Mode::Loiter));
    let sent_before = rig.vehicles[0].vehicle().counters().plans_stored;
    // The same again: what is aboard is flown on.
    rig.done(orders::mode(Mode::ContingencyA));
    rig.done(orders::mode(Mode::Loiter));
    let sent = rig.vehicles[0].vehicle().counters().plans_stored;
    assert_eq!(sent, sent_before);
    rig.send_plan(vec![orders::waypoint(32, 0, -20.0, 60.0, 20.0).into()]);
    // Not before a 13000 has said that the correction is complete.
    rig.done(orders::mode(Mode::ContingencyA));
    assert_eq!(leads_north(&rig), [-80, -80]);
    rig.done(orders::mode(Mode::Loiter));
    rig.done(load());
    rig.done(orders::mode(Mode::ContingencyA));
    assert_eq!(leads_north(&rig), [-80, -20]);
}

#[test]
fn an_impossible_command_for_another_route_leaves_the_flight_as_it_is() {
    let mut rig = with_all();
    rig.done(orders::launch(20.0));
    rig.done(orders::mode(Mode::Waypoint));
    let flight = items(&rig);
    let too_fast = VehicleOperatingModeCommand {
        commanded_speed: Scaled::from_si(30_000.0).ok(),
        ..orders::mode(Mode::ContingencyA)
    };
    let nowhere = VehicleOperatingModeCommand {
        commanded_waypoint_number: Some(22),
        ..orders::mode(Mode::ContingencyA)
    };
    for impossible in [too_fast, nowhere] {
        assert_eq!(rig.carry_out(impossible), Some(AckType::Refused));
        rig.run(3.0);
        assert_eq!(
            rig.truth().mode,
            Px4::Mission,
            "{:?}",
            rig.station().alerts()
        );
        assert_eq!(items(&rig), flight);
    }
    assert!(rig.station().has_alert("waypoint 22 is not in the route"));
}

#[test]
fn one_route_is_cleared_and_the_others_stay() {
    let mut rig = with_all();
    rig.done(orders::launch(20.0));
    rig.done(orders::mode(Mode::Waypoint));
    let flight = items(&rig);
    let transfer = |mode, id: &str| MissionTransferCommand {
        route_id: Some(Text::new(id)),
        ..orders::transfer(mode)
    };
    // Not aboard: nothing changes for the vehicle.
    rig.done(transfer(MissionPlanMode::Clear, "CA"));
    assert_eq!((items(&rig), rig.truth().mode), (flight, Px4::Mission));
    let gone = transfer(MissionPlanMode::Download, "CA");
    assert_eq!(rig.carry_out(gone), Some(AckType::Refused));
    let unknown = transfer(MissionPlanMode::Clear, "X");
    assert_eq!(rig.carry_out(unknown), Some(AckType::Refused));
    // The one that is flown: it ends, and the rest is still known.
    rig.done(transfer(MissionPlanMode::Clear, "F"));
    assert!(items(&rig).is_empty());
    let flown = rig.carry_out(orders::mode(Mode::Waypoint));
    assert_eq!(flown, Some(AckType::Refused));
    let mark = rig.station().received.len();
    rig.done(transfer(MissionPlanMode::Download, "CB"));
    rig.run(0.5);
    let numbers: Vec<_> = rig.station().received[mark..]
        .iter()
        .filter_map(|(_, _, message)| match message {
            Message::UaPositionWaypoint(waypoint) => waypoint.waypoint_number,
            _ => None,
        })
        .collect();
    assert_eq!(numbers, [41, 42]);
    rig.done(orders::mode(Mode::ContingencyB));
    assert!(reaches(&mut rig, 120.0), "contingency B");
}

#[test]
fn a_download_of_a_waypoint_names_it() {
    let mut rig = with_all();
    let unnamed = orders::transfer(MissionPlanMode::DownloadWaypoint);
    assert_eq!(rig.carry_out(unnamed), Some(AckType::Refused));
    assert!(rig.station().has_alert("Waypoint Number is missing"));
}

#[test]
fn a_contingency_without_a_name_does_not_take_the_place_of_the_flight_route() {
    let mut rig = Rig::ready();
    for (kind, first, north) in [
        (RouteType::Flight, 21, 80.0),
        (RouteType::ContingencyA, 31, -80.0),
    ] {
        let mut plan = route("", kind, first, north);
        if let Some(Message::UaRoute(route)) = plan.first_mut() {
            route.route_id = None;
        }
        rig.send_plan(plan);
    }
    rig.done(orders::load());
    assert_eq!(leads_north(&rig), [80, 80]);
}

#[test]
fn a_plan_that_is_loaded_again_half_flown_is_reported_to_continue() {
    let mut rig = with_all();
    rig.done(orders::launch(20.0));
    rig.done(orders::mode(Mode::Waypoint));
    assert!(rig.until(60.0, |rig| rig.truth().mission_seq == 1));
    rig.done(orders::mode(Mode::Loiter));
    rig.done(load());
    assert!(
        rig.station()
            .has_alert("mode 11 (waypoint) continues to waypoint 22")
    );
}

#[test]
fn a_load_that_changes_a_contingency_route_is_named() {
    for restarts in [false, true] {
        let mut rig = with_all();
        let restart = |rig: &mut Rig| {
            if restarts {
                rig.restart_bridge();
                rig.run(6.0);
            }
        };
        let changes = |rig: &Rig| {
            let mut alerts = rig.station().alerts();
            alerts.retain(|text| text.starts_with("this load also changed"));
            alerts
        };
        restart(&mut rig);
        rig.send_plan(route("F", RouteType::Flight, 21, 80.0));
        rig.done(load());
        rig.run(1.0);
        assert!(changes(&rig).is_empty(), "{:?}: the same", changes(&rig));
        // With the numbers of contingency A.
        let other = || route("N", RouteType::Flight, 31, 60.0);
        let load_it = || MissionTransferCommand {
            route_id: Some(Text::new("N")),
            ..orders::load()
        };
        rig.send_plan(other());
        restart(&mut rig);
        assert!(changes(&rig).is_empty(), "{:?}: no load", changes(&rig));
        rig.done(load_it());
        rig.run(1.0);
        let named = changes(&rig);
        let expected = "this load also changed contingency A route CA, which uses the same waypoint numbers: 31, 32; send that route \
                        again, with numbers of its own";
        assert!(named.len() == 1 && named[0] == expected, "{named:?}");
        assert_eq!(leads_north(&rig), [60, 60]);
        restart(&mut rig);
        rig.send_plan(other());
        rig.done(load_it());
        rig.run(1.0);
        assert_eq!(changes(&rig).len(), 1, "{:?}", changes(&rig));
    }
}
