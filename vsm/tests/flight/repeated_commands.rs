//! A station that sends its 2016 again and again, each time with a new Time Stamp: it is one command, which is carried out once.

use kit::bridge::{Rig, Setup, orders};
use px4_sim::{Airframe, Config, Mode as Px4};
use stanag_msgs::Scaled;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, LoiterType};
use stanag_msgs::messages::{LoiterConfiguration, VehicleOperatingModeCommand};

/// Repeats a command until it is so; returns false after so many seconds.
fn repeat_until(
    rig: &mut Rig,
    every_s: f64,
    limit_s: f64,
    command: &VehicleOperatingModeCommand,
    so: impl Fn(&Rig) -> bool,
) -> bool {
    let times = (limit_s / every_s) as u32;
    (0..times).any(|_| {
        rig.send_once(command.clone());
        rig.run(every_s);
        so(rig)
    })
}

/// In the air, 20 m above home, with a route loaded.
fn ready() -> Rig {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.run(2.0);
    rig
}

fn at_its_end(rig: &Rig) -> bool {
    let truth = rig.truth();
    truth.mode == Px4::Loiter && truth.mission_seq == 3
}

#[test]
fn a_route_is_flown_once_however_often_it_is_commanded() {
    for every_s in [1.0, 0.1] {
        let mut rig = ready();
        let fly = orders::mode(Mode::Waypoint);
        assert!(
            repeat_until(&mut rig, every_s, 300.0, &fly, at_its_end),
            "{:?}",
            rig.truth()
        );
        // Its last waypoint is above home.
        let leaves = |rig: &Rig| rig.truth().position.horizontal() > 20.0;
        let left = repeat_until(&mut rig, every_s, 30.0, &fly, leaves);
        assert!(!left, "{every_s} s: {:?}", rig.truth());
        assert!(
            rig.station().has_alert("the route was flown to its end"),
            "{:?}",
            rig.station().alerts()
        );
        // After a pause it is a command of its own.
        rig.run(6.0);
        rig.done(fly);
        assert_eq!(rig.truth().mode, Px4::Mission);
    }
}

#[test]
fn a_waypoint_that_is_commanded_again_and_again_is_passed() {
    for every_s in [1.0, 0.2] {
        let mut rig = ready();
        let to_second = VehicleOperatingModeCommand {
            commanded_waypoint_number: Some(102),
            ..orders::mode(Mode::Waypoint)
        };
        assert!(
            repeat_until(&mut rig, every_s, 300.0, &to_second, at_its_end),
            "{every_s} s: {:?}",
            rig.truth()
        );
        let continues = "the route continues to waypoint 103";
        let alerts = rig.station().alerts();
        assert!(rig.station().has_alert(continues), "{alerts:?}");
        // Another one is flown to at once.
        rig.done(VehicleOperatingModeCommand {
            commanded_waypoint_number: Some(101),
            ..orders::mode(Mode::Waypoint)
        });
        assert_eq!(rig.truth().mode, Px4::Mission);
    }
}

/// The command that is begun again ends the one before, and that stops the motors that it has started.
#[test]
fn a_launch_that_is_commanded_again_keeps_its_motors() {
    let mut rig = Rig::ready();
    let first = rig.send(orders::launch(20.0));
    let mut armed = false;
    for _ in 0..40 {
        for _ in 0..5 {
            rig.run(0.1);
            let truth = rig.truth();
            assert!(truth.armed || !armed, "the motors were stopped: {truth:?}");
            armed = truth.armed;
        }
        rig.send_once(orders::launch(20.0));
    }
    assert!(rig.until(30.0, |rig| -rig.truth().position.d > 19.0));
    assert_eq!(rig.end(first), Some(AckType::CarriedOut));
}

#[test]
fn a_wing_closes_its_circle_though_its_hold_is_commanded_again_and_again() {
    let mut rig = Rig::ready_with(Setup {
        vehicles: vec![Config {
            airframe: Airframe::Plane,
            ..Config::default()
        }],
        vehicle_keys: "landing = { course_deg = 90.0, height_m = 40.0 }",
        ..Setup::default()
    });
    rig.take_off(50.0);
    assert!(rig.until(200.0, |rig| rig.truth().mode == Px4::Loiter));
    rig.run(10.0);
    rig.done(LoiterConfiguration {
        loiter_type: Some(LoiterType::Circular),
        loiter_radius: Some(Scaled::saturating_from_si(120.0)),
        ..LoiterConfiguration::default()
    });
    let hold = orders::mode(Mode::Loiter);
    repeat_until(&mut rig, 1.0, 5.0, &hold, |_| false);
    let here = rig.truth().position;
    let leaves = |rig: &Rig| {
        let at = rig.truth().position;
        (at.n - here.n).hypot(at.e - here.e) > 400.0
    };
    let left = repeat_until(&mut rig, 1.0, 90.0, &hold, leaves);
    assert!(!left, "{:?}", rig.truth());
}
