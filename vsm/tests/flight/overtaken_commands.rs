//! Of two orders about the same thing the one that was given later counts, in whatever order they arrive, and what
//! names no mode ends none that is being entered.

use std::time::Duration;

use kit::bridge::flight::hold_at;
use kit::bridge::{Rig, orders, vehicle_id};
use px4_sim::Mode as Px4;
use stanag_msgs::enums::{
    AckType, FlightPathControlMode as Mode, MissionPlanMode, RouteType, SpeedType,
};
use stanag_msgs::messages::{UaPositionWaypoint, UaRoute, VehicleOperatingModeCommand};
use stanag_msgs::{Message, Scaled, Text, TimeStamp};

const DONE: Option<AckType> = Some(AckType::CarriedOut);
const NO: Option<AckType> = Some(AckType::Refused);

/// The stamp of a message made so many seconds ago.
fn stamp(rig: &Rig, ago_s: f64) -> Option<TimeStamp> {
    let at = rig.now().wall - Duration::from_secs_f64(ago_s);
    Some(TimeStamp::from_unix_ms(at.as_millis() as u64))
}

/// Hold at metres above home, as it was ordered so many seconds ago.
fn late_hold(rig: &mut Rig, height_m: f64, ago_s: f64) {
    let late = VehicleOperatingModeCommand {
        time_stamp: stamp(rig, ago_s),
        ..hold_at(height_m)
    };
    rig.stations[0].send_as_is(vehicle_id(0), &late.into());
    rig.run(15.0);
}

fn height(rig: &Rig) -> f64 {
    -rig.truth().position.d
}

#[test]
fn a_mode_command_that_was_overtaken_is_refused() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    rig.run(12.0);
    rig.done(hold_at(35.0));
    late_hold(&mut rig, 15.0, 3.0);
    assert!(height(&rig) > 33.0, "{}", height(&rig));
}

#[test]
fn a_sender_whose_clock_was_set_back_is_accepted() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    rig.done(hold_at(35.0));
    rig.run(12.0);
    // A little, and some time later.
    late_hold(&mut rig, 15.0, 14.0);
    assert!(height(&rig) < 17.0, "{}", height(&rig));
    rig.done(hold_at(35.0));
    rig.run(12.0);
    // Far: once its traffic has shown for seconds that this is its clock, and no command held back.
    late_hold(&mut rig, 15.0, 3_600.0);
    assert!(height(&rig) > 33.0, "{}", height(&rig));
    assert!(rig.station().has_alert("behind the clock of its CUCS"));
    late_hold(&mut rig, 15.0, 3_600.0);
    assert!(height(&rig) < 17.0, "{}", height(&rig));
}

#[test]
fn what_was_refused_overtakes_nothing() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    rig.run(12.0);
    assert_eq!(rig.carry_out(hold_at(9_000.0)), NO);
    late_hold(&mut rig, 30.0, 1.0);
    assert!(height(&rig) > 28.0, "{}", height(&rig));
}

#[test]
fn an_overtaken_waypoint_leaves_the_later_one_and_others_may_come_in_any_order() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.run(12.0);
    let moved = orders::waypoint(102, 103, 80.0, 80.0, 60.0);
    rig.done(moved);
    for (number, up) in [(102, 25.0), (103, 45.0)] {
        let late = UaPositionWaypoint {
            time_stamp: stamp(&rig, 2.0),
            ..orders::waypoint(number, number + 1, 80.0, 80.0, up)
        };
        rig.stations[0].send_as_is(vehicle_id(0), &late.into());
        rig.run(0.5);
    }
    rig.done(orders::load());
    let mark = rig.station().received.len();
    rig.done(orders::transfer(MissionPlanMode::Download));
    rig.run(0.5);
    let heights: Vec<_> = rig.station().received[mark..]
        .iter()
        .filter_map(|(_, _, message)| match message {
            Message::UaPositionWaypoint(one) => one.waypoint_to_altitude.map(|up| up.si()),
            _ => None,
        })
        .collect();
    assert_eq!(heights, [20.0, 60.0, 45.0, 20.0]);
}

fn altimeter() -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        altimeter_setting: Scaled::from_si(100_000.0).ok(),
        ..VehicleOperatingModeCommand::default()
    }
}

#[test]
fn an_altimeter_setting_does_not_break_off_a_launch() {
    let mut rig = Rig::ready();
    let launch = rig.send(orders::launch(20.0));
    assert!(rig.until(20.0, |rig| rig.truth().armed));
    rig.done(altimeter());
    assert_eq!(rig.end(launch), DONE, "{:?}", rig.station().alerts());
    assert!(rig.until(30.0, |rig| height(rig) > 18.0));
}

#[test]
fn what_names_no_mode_does_not_take_the_place_of_a_contingency_that_is_on_its_way() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    let contingency = UaRoute {
        route_id: Some(Text::new("CA")),
        route_type: Some(RouteType::ContingencyA),
        ..orders::route(7)
    };
    rig.send_plan(vec![
        contingency.into(),
        orders::waypoint(7, 8, -60.0, 0.0, 30.0).into(),
        orders::waypoint(8, 0, -60.0, 50.0, 30.0).into(),
    ]);
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    let away = rig.send(orders::mode(Mode::ContingencyA));
    rig.run(0.03);
    let slower = VehicleOperatingModeCommand {
        commanded_speed: Scaled::from_si(3.0).ok(),
        speed_type: Some(SpeedType::Ground),
        ..VehicleOperatingModeCommand::default()
    };
    let slower = rig.send(slower);
    rig.done(altimeter());
    assert_eq!(rig.end(away), DONE, "{:?}", rig.station().alerts());
    assert_eq!(rig.end(slower), NO);
    assert!(rig.station().has_alert("another is being entered"));
    assert_eq!(rig.truth().mode, Px4::Mission);
    assert!(rig.until(60.0, |rig| rig.truth().position.n < -45.0));
}
