//! The speeds of a route (13002) are flown wherever the route is entered, though an item sets one only where it changes.

use kit::bridge::{Rig, orders};
use stanag_msgs::enums::FlightPathControlMode as Mode;
use stanag_msgs::messages::{UaPositionWaypoint, VehicleOperatingModeCommand};
use stanag_msgs::{Message, Scaled};

/// Six waypoints 200 m apart to the north: the first three at 2 m/s, the others at 6 m/s.
fn two_speeds() -> Vec<Message> {
    let waypoints = (1..=6_u16).map(|number| {
        let next = if number == 6 { 0 } else { number + 1 };
        let speed_m_s = if number <= 3 { 2.0 } else { 6.0 };
        Message::from(UaPositionWaypoint {
            waypoint_to_speed: Some(Scaled::saturating_from_si(speed_m_s)),
            ..orders::waypoint(number, next, 200.0 * f64::from(number), 0.0, 20.0)
        })
    });
    std::iter::once(orders::route(1).into())
        .chain(waypoints)
        .collect()
}

fn to_waypoint(number: u16) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        commanded_waypoint_number: Some(number),
        ..orders::mode(Mode::Waypoint)
    }
}

fn flying() -> Rig {
    let mut rig = Rig::ready();
    rig.send_plan(two_speeds());
    rig.done(orders::load());
    rig.take_off(20.0);
    rig
}

/// The speed over ground once it has settled, m/s.
fn settled_m_s(rig: &mut Rig) -> f64 {
    rig.run(8.0);
    rig.truth().velocity.horizontal()
}

#[track_caller]
fn assert_flown(rig: &mut Rig, expected_m_s: f64) {
    let found_m_s = settled_m_s(rig);
    assert!(
        (found_m_s - expected_m_s).abs() < 0.5,
        "{found_m_s:.2} m/s, expected {expected_m_s} m/s"
    );
}

#[test]
fn a_jump_within_the_route_is_flown_at_the_speed_of_its_leg() {
    let mut rig = flying();
    rig.done(orders::mode(Mode::Waypoint));
    assert_flown(&mut rig, 2.0);
    // Its leg has no speed of its own in the mission, and the vehicle has not passed the item that sets it.
    rig.done(to_waypoint(6));
    assert_flown(&mut rig, 6.0);
    rig.done(to_waypoint(3));
    assert_flown(&mut rig, 2.0);
}

#[test]
fn a_route_is_entered_anywhere_at_the_speed_of_its_leg() {
    let mut rig = flying();
    rig.done(to_waypoint(6));
    assert_flown(&mut rig, 6.0);
    rig.done(orders::mode(Mode::Loiter));
    rig.done(to_waypoint(3));
    assert_flown(&mut rig, 2.0);
    rig.done(orders::mode(Mode::Loiter));
    rig.run(2.0);
    rig.done(orders::mode(Mode::Waypoint));
    assert_flown(&mut rig, 2.0);
}
