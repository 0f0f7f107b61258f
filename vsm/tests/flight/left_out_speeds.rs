//! A route with more items than the vehicle stores leaves out repeated speeds: a 2016 whose speed nothing would end is refused, and
//! a jump within any route is flown at the speed that its leg is planned for.

use kit::bridge::{Rig, Setup, orders};
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode};
use stanag_msgs::messages::{UaPositionWaypoint, VehicleOperatingModeCommand};
use stanag_msgs::{Message, Scaled};

/// Six waypoints 400 m apart to the north: the first three at 2 m/s, the others at 6 m/s. 12 items, or 8 without repeated speeds.
fn two_speeds() -> Vec<Message> {
    let waypoints = (1..=6_u16).map(|number| {
        let next = if number == 6 { 0 } else { number + 1 };
        let speed_m_s = if number <= 3 { 2.0 } else { 6.0 };
        Message::from(UaPositionWaypoint {
            waypoint_to_speed: Some(Scaled::saturating_from_si(speed_m_s)),
            ..orders::waypoint(number, next, 400.0 * f64::from(number), 0.0, 20.0)
        })
    });
    std::iter::once(orders::route(1).into())
        .chain(waypoints)
        .collect()
}

fn flying(vehicle_keys: &'static str) -> Rig {
    let mut rig = Rig::ready_with(Setup {
        vehicle_keys,
        ..Setup::default()
    });
    rig.send_plan(two_speeds());
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    rig
}

fn at_speed(speed_m_s: f64) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        commanded_speed: Some(Scaled::saturating_from_si(speed_m_s)),
        ..orders::mode(Mode::Waypoint)
    }
}

fn to_waypoint(number: u16) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        commanded_waypoint_number: Some(number),
        ..orders::mode(Mode::Waypoint)
    }
}

#[track_caller]
fn assert_flown(rig: &mut Rig, expected_m_s: f64) {
    rig.run(12.0);
    let found_m_s = rig.truth().velocity.horizontal();
    assert!(
        (found_m_s - expected_m_s).abs() < 0.5,
        "{found_m_s:.2} m/s, expected {expected_m_s} m/s"
    );
}

#[track_caller]
fn assert_refused(rig: &mut Rig) {
    let before = rig.station().alerts().len();
    assert_eq!(rig.carry_out(at_speed(4.0)), Some(AckType::Refused));
    rig.run(0.5);
    let alerts = rig.station().alerts();
    let why = "repeated speeds are left out of the route, that of waypoint 2 among them";
    assert!(
        alerts[before..].iter().any(|alert| alert.contains(why)),
        "{alerts:?}"
    );
}

#[test]
fn a_speed_that_nothing_would_end_is_refused() {
    let mut rig = flying("curve = { max_items = 8 }");
    let note = "4 speeds that repeat the one before are left out, so that the route fits 8 items";
    assert!(
        rig.station().has_alert(note),
        "{:?}",
        rig.station().alerts()
    );
    assert_refused(&mut rig);
    assert_flown(&mut rig, 2.0);
    rig.restart_bridge();
    rig.run(5.0);
    assert_refused(&mut rig);
    // No leg follows the last one.
    rig.done(VehicleOperatingModeCommand {
        commanded_waypoint_number: Some(6),
        ..at_speed(4.0)
    });
    assert_flown(&mut rig, 4.0);
}

#[test]
fn a_route_that_fits_takes_a_speed_for_its_leg() {
    let mut rig = flying("curve = { max_items = 12 }");
    assert!(!rig.station().has_alert("are left out"));
    rig.done(at_speed(4.0));
    assert_flown(&mut rig, 4.0);
}

/// A leg without a speed is planned for that of the legs before, and for the vehicle's own before any.
#[test]
fn a_jump_to_a_leg_without_a_speed_is_flown_at_that_which_it_is_planned_for() {
    let waypoints = [None, None, Some(10.0), None];
    let waypoints = (1_u16..).zip(waypoints).map(|(number, speed_m_s)| {
        let next = (number + 1) % 5;
        Message::from(UaPositionWaypoint {
            waypoint_to_speed: speed_m_s.map(Scaled::saturating_from_si),
            ..orders::waypoint(number, next, 900.0 * f64::from(number), 0.0, 20.0)
        })
    });
    let mut rig = Rig::ready();
    rig.send_plan(
        std::iter::once(orders::route(1).into())
            .chain(waypoints)
            .collect(),
    );
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    assert_flown(&mut rig, 5.0);
    for (number, expected_m_s) in [(3, 10.0), (2, 5.0), (4, 10.0), (1, 5.0)] {
        rig.done(to_waypoint(number));
        // From 5 to 10 m/s it takes this long.
        rig.run(8.0);
        assert_flown(&mut rig, expected_m_s);
    }
    // A speed that is commanded for a leg ends with the jump too.
    rig.done(at_speed(8.0));
    assert_flown(&mut rig, 8.0);
    rig.done(to_waypoint(2));
    assert_flown(&mut rig, 5.0);
}

#[test]
fn a_jump_within_the_route_is_flown_at_the_speed_of_its_leg() {
    let mut rig = flying("curve = { max_items = 8 }");
    assert_flown(&mut rig, 2.0);
    // No item from there on sets a speed, and the vehicle has not passed the one that does.
    rig.done(to_waypoint(6));
    assert_flown(&mut rig, 6.0);
    rig.done(to_waypoint(3));
    assert_flown(&mut rig, 2.0);
    // The first of two jumps has not shown its mode yet, which the vehicle is in all the time.
    rig.done(to_waypoint(6));
    assert_flown(&mut rig, 6.0);
    rig.send(to_waypoint(5));
    rig.done(to_waypoint(2));
    assert_flown(&mut rig, 2.0);
}
