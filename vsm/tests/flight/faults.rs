//! Doubled messages, restarts of bridge and vehicle, a full disk: nothing accepted is lost, nothing carried out twice.

use kit::bridge::flight::hold_at;
use kit::bridge::{Rig, orders, vehicle_id};
use stanag_msgs::Message;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, MissionPlanMode};
use stanag_msgs::messages::UaPositionWaypoint;

/// The waypoints that a download of the plan brings.
fn downloaded(rig: &mut Rig) -> Vec<UaPositionWaypoint> {
    let mark = rig.station().received.len();
    rig.done(orders::transfer(MissionPlanMode::Download));
    rig.run(0.5);
    let received = rig.station().received[mark..].iter();
    received
        .filter_map(|(_, _, message)| match message {
            Message::UaPositionWaypoint(waypoint) => Some(waypoint.clone()),
            _ => None,
        })
        .collect()
}

#[test]
fn a_repeated_command_is_acknowledged_again_and_not_carried_out_again() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let low = rig.send(hold_at(15.0));
    assert_eq!(rig.end(low), Some(AckType::CarriedOut));
    rig.done(hold_at(35.0));
    assert!(rig.until(60.0, |rig| -rig.truth().position.d > 34.0));
    let before = rig.station().answers(low).len();
    let commands = rig.vehicles[0].vehicle().counters().commands_accepted;
    for _ in 0..3 {
        rig.stations[0].repeat(low);
        rig.run(1.0);
    }
    let answers = &rig.station().answers(low)[before..];
    assert_eq!(answers, [AckType::CarriedOut; 3]);
    rig.run(10.0);
    assert!(-rig.truth().position.d > 34.0, "it went back down");
    assert_eq!(
        rig.vehicles[0].vehicle().counters().commands_accepted,
        commands
    );
}

#[test]
fn a_bridge_restarted_in_flight_knows_its_plan_its_rights_and_where_the_vehicle_flies_to() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    assert!(rig.until(60.0, |rig| rig.truth().mission_seq == 1));

    rig.stop_bridge();
    rig.run(3.0);
    let mark = rig.station().received.len();
    rig.start_bridge();
    // Status comes without being asked for: authority and the station's address were stored.
    let to = |rig: &Rig| {
        rig.station().received[mark..]
            .iter()
            .rev()
            .find_map(|(_, _, m)| match m {
                Message::FromToNextWaypointStates(states) => states.to_waypoint_number,
                _ => None,
            })
    };
    assert!(rig.until(10.0, |rig| to(rig) == Some(102)));
    let numbers: Vec<_> = downloaded(&mut rig)
        .iter()
        .filter_map(|waypoint| waypoint.waypoint_number)
        .collect();
    assert_eq!(numbers, [101, 102, 103, 104]);
    rig.done(orders::mode(Mode::AutolandEngage));
    assert!(rig.until(60.0, |rig| !rig.truth().armed));
}

#[test]
fn a_vehicle_that_restarts_is_reported_and_commanded_again() {
    let mut rig = Rig::ready();
    rig.vehicles[0].restart();
    assert!(rig.until(20.0, |rig| rig.station().has_alert("has restarted")));
    rig.run(8.0);
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(12.0);
}

#[test]
fn a_vehicle_that_restarts_elsewhere_is_not_launched_by_its_old_home() {
    let mut rig = Rig::ready();
    let mut elsewhere = px4_sim::Config::default();
    elsewhere.home.altitude_m -= 300.0;
    let vehicle = px4_sim::Config {
        seed: 31,
        ..elsewhere
    };
    *rig.vehicles[0].vehicle_mut() = px4_sim::Vehicle::new(vehicle);
    rig.vehicles[0].restart();
    assert!(rig.until(20.0, |rig| rig.station().has_alert("has restarted")));
    let mut end = None;
    for _ in 0..30 {
        end = rig.carry_out(orders::launch(20.0));
        if end == Some(AckType::CarriedOut) {
            break;
        }
        rig.run(1.0);
    }
    assert_eq!(
        end,
        Some(AckType::CarriedOut),
        "{:?}",
        rig.station().alerts()
    );
    rig.run(40.0);
    let height_m = -rig.truth().position.d;
    assert!(
        (15.0..25.0).contains(&height_m),
        "{height_m} m above the ground"
    );
}

#[test]
fn a_full_disk_accepts_nothing_and_loses_nothing() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.store.full = Some("plan");
    let moved = orders::waypoint(102, 103, 40.0, 40.0, 60.0);
    let moved = rig.send(moved);
    assert_eq!(rig.end(moved), Some(AckType::Refused));
    assert!(rig.station().has_alert("it cannot be stored"));
    assert!(rig.store.refused > 0);
    rig.restart_bridge();
    rig.run(2.0);
    rig.store.full = None;
    let plan = downloaded(&mut rig);
    let kept = plan
        .iter()
        .find(|waypoint| waypoint.waypoint_number == Some(102))
        .expect("the waypoint of before");
    let height = kept.waypoint_to_altitude.map(|altitude| altitude.si());
    assert_eq!((plan.len(), height), (4, Some(20.0)));
    // Room again: the same command is taken.
    rig.done(orders::waypoint(102, 103, 40.0, 40.0, 60.0));
}

#[test]
fn a_stepped_clock_stops_nothing() {
    let mut rig = Rig::ready();
    rig.take_off(15.0);
    for step in [3_600.0 * 5.0, -3_600.0 * 24.0] {
        rig.clock.set_wall_step(step);
        rig.run(2.0);
        assert_eq!(
            rig.carry_out(hold_at(20.0)),
            Some(AckType::CarriedOut),
            "after a step of {step} s: {:?}",
            rig.station().alerts()
        );
    }
    let fresh = rig
        .station()
        .last(vehicle_id(0), 4000, |message| match message {
            Message::InertialStates(states) => states.altitude,
            _ => None,
        });
    assert!(fresh.is_some());
}
