//! 4001 and the texts report what the vehicle does: where it has been, where it goes, what comes then, before the route,
//! on it, after a jump, around a loop and at the end; and what happens to it when another plan is loaded.

use kit::bridge::{Rig, orders, vehicle_id};
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, LimitType, WaypointType};
use stanag_msgs::messages::{UaPositionWaypoint, VehicleOperatingModeCommand};
use stanag_msgs::{Bam32, Message, Scaled, Text};

const DONE: Option<AckType> = Some(AckType::CarriedOut);

/// From, To and Next of the last 4001.
fn along(rig: &Rig) -> [u16; 3] {
    let numbers = rig
        .station()
        .last(vehicle_id(0), 4001, |message| match message {
            Message::FromToNextWaypointStates(s) => Some([
                s.from_waypoint_number?,
                s.to_waypoint_number?,
                s.next_waypoint_number?,
            ]),
            _ => None,
        });
    numbers.unwrap_or_default()
}

fn is_along(rig: &mut Rig, limit_s: f64, wanted: [u16; 3]) {
    let so = rig.until(limit_s, |rig| along(rig) == wanted);
    assert!(so, "{wanted:?}, and it is {:?}", along(rig));
}

/// In the air with a route loaded.
fn ready(plan: Vec<Message>) -> Rig {
    let mut rig = Rig::ready();
    rig.send_plan(plan);
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.run(2.0);
    rig
}

fn go_to(number: u16) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        commanded_waypoint_number: Some(number),
        ..orders::mode(Mode::Waypoint)
    }
}

fn loop_end(times: u16) -> UaPositionWaypoint {
    UaPositionWaypoint {
        waypoint_type: Some(WaypointType::EndOfLoop),
        limit_type: Some(LimitType::Count),
        loop_limit: Some(times),
        ..orders::waypoint(3, 1, 0.0, 40.0, 20.0)
    }
}

#[test]
fn along_a_route_the_waypoints_are_those_that_it_leads_to() {
    let mut rig = ready(orders::square());
    assert_eq!(along(&rig), [0, 101, 102], "before the route");
    rig.done(orders::mode(Mode::Waypoint));
    for wanted in [
        [0, 101, 102],
        [101, 102, 103],
        [102, 103, 104],
        [103, 104, 0],
        [104, 0, 0],
    ] {
        is_along(&mut rig, 60.0, wanted);
    }
    rig.run(3.0);
    assert_eq!(along(&rig), [104, 0, 0], "after the route");
    // Flown again from its start, which is reported.
    rig.done(orders::mode(Mode::Waypoint));
    assert!(rig.station().has_alert("flying it again from its start"));
    is_along(&mut rig, 5.0, [0, 101, 102]);
}

/// A waypoint with the speed of its leg, for which PX4 has an item of its own.
fn with_speed(speed_m_s: f64, waypoint: UaPositionWaypoint) -> Message {
    UaPositionWaypoint {
        waypoint_to_speed: Some(Scaled::saturating_from_si(speed_m_s)),
        ..waypoint
    }
    .into()
}

#[test]
fn a_waypoint_is_passed_where_the_speed_of_the_next_leg_is_reported_in_its_place() {
    let mut rig = ready(vec![
        orders::route(1).into(),
        with_speed(3.0, orders::waypoint(1, 2, 40.0, 0.0, 20.0)),
        with_speed(4.0, orders::waypoint(2, 3, 40.0, 40.0, 20.0)),
        with_speed(5.0, orders::waypoint(3, 0, 0.0, 40.0, 20.0)),
    ]);
    rig.done(orders::mode(Mode::Waypoint));
    for wanted in [[0, 1, 2], [1, 2, 3], [2, 3, 0], [3, 0, 0]] {
        is_along(&mut rig, 60.0, wanted);
    }
    // The speed of the leg is executed after a jump too, where no waypoint was passed.
    rig.done(go_to(2));
    is_along(&mut rig, 5.0, [0, 2, 3]);
    rig.run(3.0);
    assert_eq!(along(&rig), [0, 2, 3]);
}

#[test]
fn a_landing_behind_the_route_flies_to_none_of_its_waypoints() {
    let mut rig = ready(orders::square());
    rig.done(orders::mode(Mode::Waypoint));
    is_along(&mut rig, 120.0, [104, 0, 0]);
    rig.done(orders::mode(Mode::Loiter));
    rig.run(2.0);
    rig.done(orders::mode(Mode::AutolandEngage));
    for _ in 0..600 {
        rig.run(0.1);
        assert_eq!(along(&rig), [104, 0, 0], "{:?}", rig.truth().mode);
    }
    assert!(!rig.truth().armed);
}

/// PX4 v1.18 calls the mission active again in AUTO.LAND, with the last waypoint as the current item; a VSM that was started again
/// there has its end on disk.
#[test]
fn a_route_that_has_ended_begins_again_after_a_landing_that_was_aborted() {
    for restarted in [false, true] {
        let mut rig = ready(orders::square());
        rig.done(orders::mode(Mode::Waypoint));
        is_along(&mut rig, 120.0, [104, 0, 0]);
        rig.done(orders::mode(Mode::AutolandEngage));
        rig.run(2.0);
        if restarted {
            rig.restart_bridge();
            rig.run(3.0);
        }
        rig.done(orders::mode(Mode::AutolandWaveOff));
        rig.run(2.0);
        assert_eq!(along(&rig), [104, 0, 0]);
        rig.done(orders::mode(Mode::Waypoint));
        let again = "the route was flown to its end, flying it again from its start";
        let alerts = rig.station().alerts();
        let named = alerts.iter().filter(|text| text.contains(again)).count();
        assert_eq!(named, 1, "{restarted}: {alerts:?}");
        for wanted in [[0, 101, 102], [101, 102, 103]] {
            is_along(&mut rig, 60.0, wanted);
        }
    }
}

/// PX4 v1.18 calls the mission complete after each landing and each take-off, at whatever item it was left.
#[test]
fn a_route_that_a_landing_has_broken_off_continues_where_it_was() {
    let mut rig = ready(orders::square());
    rig.done(orders::mode(Mode::Waypoint));
    is_along(&mut rig, 60.0, [102, 103, 104]);
    rig.done(orders::mode(Mode::AutolandEngage));
    assert!(rig.until(60.0, |rig| !rig.truth().armed));
    rig.run(2.0);
    assert_eq!(along(&rig)[0], 102, "on the ground");
    rig.take_off(20.0);
    rig.run(2.0);
    assert_eq!(along(&rig), [102, 103, 104], "launched again");
    rig.done(orders::mode(Mode::Waypoint));
    rig.run(3.0);
    assert_eq!(along(&rig), [102, 103, 104]);
    assert!(!rig.station().has_alert("flown to its end"));
    is_along(&mut rig, 60.0, [103, 104, 0]);
}

#[test]
fn another_route_begins_at_its_first_waypoint_whatever_was_flown_before() {
    let mut rig = ready(orders::square());
    rig.done(orders::mode(Mode::Waypoint));
    is_along(&mut rig, 120.0, [104, 0, 0]);
    rig.send_plan(vec![
        orders::route(7).into(),
        orders::waypoint(7, 8, 60.0, 0.0, 20.0).into(),
        orders::waypoint(8, 0, 60.0, 60.0, 20.0).into(),
    ]);
    rig.done(orders::load());
    rig.run(2.0);
    assert_eq!(along(&rig), [0, 7, 8]);
}

#[test]
fn after_a_jump_a_waypoint_that_was_never_visited_is_not_where_it_comes_from() {
    let mut rig = ready(orders::square());
    rig.done(go_to(103));
    is_along(&mut rig, 5.0, [0, 103, 104]);
    rig.run(3.0);
    assert_eq!(along(&rig), [0, 103, 104]);
    is_along(&mut rig, 60.0, [103, 104, 0]);
    // A jump within the mission, while PX4 still repeats what was reached before.
    rig.done(go_to(102));
    is_along(&mut rig, 5.0, [0, 102, 103]);
    rig.run(3.0);
    assert_eq!(along(&rig), [0, 102, 103]);
    is_along(&mut rig, 60.0, [102, 103, 104]);
}

#[test]
fn a_hold_on_the_way_changes_nothing_and_a_restart_takes_the_waypoint_before() {
    let mut rig = ready(orders::square());
    rig.done(orders::mode(Mode::Waypoint));
    is_along(&mut rig, 60.0, [101, 102, 103]);
    rig.done(orders::mode(Mode::Loiter));
    rig.run(2.0);
    assert_eq!(along(&rig), [101, 102, 103]);
    rig.restart_bridge();
    rig.run(3.0);
    assert_eq!(along(&rig), [101, 102, 103]);
    rig.done(orders::mode(Mode::Waypoint));
    is_along(&mut rig, 60.0, [102, 103, 104]);
}

#[test]
fn a_loop_leads_back_so_often_as_it_is_flown() {
    let mut rig = ready(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 40.0, 0.0, 20.0).into(),
        orders::waypoint(2, 3, 40.0, 40.0, 20.0).into(),
        loop_end(2).into(),
    ]);
    rig.done(orders::mode(Mode::Waypoint));
    for wanted in [
        [0, 1, 2],
        [1, 2, 3],
        [2, 3, 1],
        [3, 1, 2],
        [1, 2, 3],
        [2, 3, 0],
        [3, 0, 0],
    ] {
        is_along(&mut rig, 60.0, wanted);
    }
    // Once more, and PX4 leads back no more: it has counted the loop.
    rig.done(orders::mode(Mode::Waypoint));
    assert!(rig.station().has_alert("its loop only once"));
    for wanted in [[0, 1, 2], [1, 2, 3], [2, 3, 0], [3, 0, 0]] {
        is_along(&mut rig, 60.0, wanted);
    }
}

#[test]
fn a_changed_plan_loaded_in_flight_holds_the_vehicle_and_reports_it() {
    let mut rig = ready(orders::square());
    rig.done(orders::mode(Mode::Waypoint));
    is_along(&mut rig, 60.0, [101, 102, 103]);
    let changed = orders::waypoint(103, 104, 0.0, 80.0, 30.0);
    rig.done(changed);
    rig.done(orders::load());
    rig.run(1.0);
    assert_eq!(rig.truth().mode, px4_sim::Mode::Loiter);
    for text in [
        "it is put on hold (mode 12, loiter) while another plan is uploaded",
        "the vehicle holds (mode 12, loiter): mode 11 (waypoint) flies it",
    ] {
        assert!(
            rig.station().has_alert(text),
            "{text}: {:?}",
            rig.station().alerts()
        );
    }
}

fn downloaded(rig: &mut Rig, order: stanag_msgs::messages::MissionTransferCommand) -> Vec<Message> {
    let mark = rig.station().received.len();
    rig.done(order);
    rig.run(0.5);
    let plan = rig.station().received[mark..]
        .iter()
        .map(|(_, _, m)| m.clone());
    plan.filter(|m| matches!(m.id(), 13001..=13003 | 50001 | 50002))
        .collect()
}

fn one(number: u16) -> stanag_msgs::messages::MissionTransferCommand {
    stanag_msgs::messages::MissionTransferCommand {
        waypoint_number: Some(number),
        ..orders::transfer(stanag_msgs::enums::MissionPlanMode::DownloadWaypoint)
    }
}

fn north(plan: &[Message], number: u16) -> Option<f64> {
    plan.iter().find_map(|message| match message {
        Message::UaPositionWaypoint(w) if w.waypoint_number == Some(number) => {
            let (home, _) = orders::place(0.0, 0.0);
            let latitude = w.waypoint_to_latitude_or_relative_y?.degrees();
            Some(((latitude - home) * 111_195.0).round())
        }
        _ => None,
    })
}

#[test]
fn after_a_refused_load_the_download_is_what_is_aboard() {
    let mut rig = ready(orders::square());
    let far = orders::waypoint(103, 104, 70_000.0, 80.0, 20.0);
    rig.done(far);
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::Refused));
    let all = orders::transfer(stanag_msgs::enums::MissionPlanMode::Download);
    for restarted in [false, true] {
        if restarted {
            rig.restart_bridge();
            rig.run(2.0);
        }
        let plan = downloaded(&mut rig, all.clone());
        assert_eq!(
            (plan.len(), north(&plan, 103)),
            (5, Some(0.0)),
            "restarted: {restarted}"
        );
        let single = downloaded(&mut rig, one(103));
        assert_eq!(north(&single, 103), Some(0.0));
    }
    // The correction alone is not enough: what else was sent is gone, and who sent it may not know.
    let near = orders::waypoint(103, 104, 10.0, 80.0, 20.0);
    rig.done(near.clone());
    assert_eq!(rig.carry_out(orders::load()), Some(AckType::Refused));
    rig.run(0.1);
    assert!(
        rig.station()
            .has_alert("send the whole route, with its 13001")
    );
    // Corrected, it is loaded and reported.
    rig.send_plan(orders::square());
    rig.done(near);
    rig.done(orders::load());
    let plan = downloaded(&mut rig, all);
    assert_eq!(north(&plan, 103), Some(10.0));
}

#[test]
fn of_several_flight_routes_the_loaded_one_is_reported() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    let second = stanag_msgs::messages::UaRoute {
        route_id: Some(Text::new("R2")),
        ..orders::route(103)
    };
    rig.done(second);
    rig.done(orders::load());
    rig.run(1.0);
    assert!(
        rig.station()
            .has_alert("the latest of several flight routes, \"R2\", is loaded"),
        "{:?}",
        rig.station().alerts()
    );
    assert_eq!(along(&rig), [0, 103, 104]);
}

#[test]
fn a_curve_goes_with_the_leg_that_it_describes_and_comes_with_its_waypoint() {
    let mut rig = Rig::ready();
    let plan = || {
        vec![
            orders::route(10).into(),
            orders::waypoint(10, 20, 40.0, 0.0, 20.0).into(),
            orders::waypoint(20, 30, 100.0, 0.0, 20.0).into(),
            orders::waypoint(30, 0, 100.0, 120.0, 20.0).into(),
        ]
    };
    let curve = |p4: u16| {
        let ((lat2, lon2), (lat3, lon3)) = (orders::place(160.0, 0.0), orders::place(160.0, 120.0));
        stanag_msgs::messages::CurveSegment {
            p1_waypoint_no: Some(20),
            p4_waypoint_no: Some(p4),
            p2_latitude: Some(stanag_msgs::Bam32::from_degrees(lat2)),
            p2_longitude: Some(stanag_msgs::Bam32::from_degrees(lon2)),
            p3_latitude: Some(stanag_msgs::Bam32::from_degrees(lat3)),
            p3_longitude: Some(stanag_msgs::Bam32::from_degrees(lon3)),
            ..stanag_msgs::messages::CurveSegment::default()
        }
    };
    rig.send_plan(plan());
    rig.done(curve(30));
    rig.done(orders::load());
    let single = downloaded(&mut rig, one(20));
    let types: Vec<u16> = single.iter().map(Message::id).collect();
    assert_eq!(types, [13002, 50002]);
    // Another plan in the same numbers: 20 leads to 40, straight.
    rig.send_plan(vec![
        orders::waypoint(20, 40, 100.0, 0.0, 20.0).into(),
        orders::waypoint(40, 0, 100.0, 60.0, 20.0).into(),
    ]);
    rig.done(orders::load());
    let plan = downloaded(
        &mut rig,
        orders::transfer(stanag_msgs::enums::MissionPlanMode::Download),
    );
    let types: Vec<u16> = plan.iter().map(Message::id).collect();
    assert_eq!(
        types,
        [13001, 13002, 13002, 13002],
        "nothing of the earlier plan"
    );
}

#[test]
fn mode_2_is_entered_without_a_complaint_of_the_vehicle() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let end = {
        for _ in 0..5 {
            rig.send_once(stanag_msgs::messages::UaStickCommand::default());
            rig.run(0.1);
        }
        let order = rig.send(orders::mode(Mode::FlightDirector));
        for _ in 0..30 {
            rig.send_once(stanag_msgs::messages::UaStickCommand::default());
            rig.run(0.1);
        }
        rig.end(order)
    };
    assert_eq!(end, DONE, "{:?}", rig.station().alerts());
    assert!(
        !rig.station().has_alert("not available"),
        "{:?}",
        rig.station().alerts()
    );
}

#[test]
fn a_commanded_loiter_place_is_no_waypoint_of_the_route() {
    let mut rig = ready(orders::square());
    rig.done(orders::mode(Mode::Waypoint));
    is_along(&mut rig, 60.0, [101, 102, 103]);
    let (latitude, longitude) = orders::place(-40.0, -40.0);
    let there = VehicleOperatingModeCommand {
        loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
        loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
        ..orders::mode(Mode::Loiter)
    };
    rig.done(there);
    is_along(&mut rig, 10.0, [0, 65_535, 0]);
    let place = rig
        .station()
        .last(vehicle_id(0), 4001, |message| match message {
            Message::FromToNextWaypointStates(s) => {
                s.to_waypoint_latitude.zip(s.to_waypoint_longitude)
            }
            _ => None,
        });
    let sent = (
        Bam32::from_degrees(latitude),
        Bam32::from_degrees(longitude),
    );
    assert_eq!(place, Some(sent));
    // On the route again it is one of its waypoints.
    rig.done(go_to(103));
    assert!(
        rig.until(10.0, |rig| along(rig)[1] == 103),
        "{:?}",
        along(&rig)
    );
}
