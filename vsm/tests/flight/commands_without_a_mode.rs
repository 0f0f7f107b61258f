//! A 2016 that names no mode changes what it names, and nothing else: no mode is entered by it.

use kit::bridge::{Rig, orders};
use px4_sim::Mode as Px4;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, LoiterType, SpeedType};
use stanag_msgs::messages::{LoiterConfiguration, VehicleOperatingModeCommand};
use stanag_msgs::{Bam32, Scaled};

const NO: Option<AckType> = Some(AckType::Refused);

fn speed(metres_per_second: f64) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        commanded_speed: Scaled::from_si(metres_per_second).ok(),
        speed_type: Some(SpeedType::Ground),
        ..VehicleOperatingModeCommand::default()
    }
}

fn altimeter() -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        altimeter_setting: Scaled::from_si(100_000.0).ok(),
        ..VehicleOperatingModeCommand::default()
    }
}

fn kept(rig: &Rig) -> bool {
    let mut names = rig.store.records.keys();
    names.any(|name| name.starts_with("altimeter"))
}

#[test]
fn an_altimeter_setting_alone_leaves_an_orbit_as_it_is() {
    let mut rig = Rig::ready();
    rig.take_off(30.0);
    let circle = LoiterConfiguration {
        loiter_type: Some(LoiterType::Circular),
        loiter_radius: Scaled::from_si(40.0).ok(),
        ..LoiterConfiguration::default()
    };
    rig.done(circle);
    let (latitude, longitude) = orders::place(30.0, 0.0);
    let orbit = VehicleOperatingModeCommand {
        loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
        loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
        ..orders::mode(Mode::Loiter)
    };
    rig.done(orbit);
    assert_eq!(rig.truth().mode, Px4::Orbit);
    let commands = rig.vehicles[0].vehicle().counters().commands_accepted;
    rig.done(altimeter());
    rig.run(3.0);
    assert!(kept(&rig));
    assert_eq!(rig.truth().mode, Px4::Orbit);
    let after = rig.vehicles[0].vehicle().counters().commands_accepted;
    assert_eq!(after, commands, "nothing is asked of the vehicle");
}

#[test]
fn a_speed_alone_does_not_fly_a_finished_route_again() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    assert!(rig.until(300.0, |rig| {
        let truth = rig.truth();
        truth.mission_seq >= 3 && truth.velocity.n.hypot(truth.velocity.e) < 0.2
    }));
    rig.run(10.0);
    let place = rig.truth().position;
    rig.carry_out(speed(7.0));
    rig.run(10.0);
    let now = rig.truth().position;
    assert!(
        (now.n - place.n).hypot(now.e - place.e) < 2.0,
        "{place:?} {now:?}"
    );
    // With the mode it is flown again, as it is commanded.
    let mut again = speed(7.0);
    again.select_flight_path_control_mode = Some(Mode::Waypoint);
    rig.done(again);
    rig.run(10.0);
    let now = rig.truth().position;
    assert!(
        (now.n - place.n).hypot(now.e - place.e) > 10.0,
        "{place:?} {now:?}"
    );
}

#[test]
fn what_the_present_mode_cannot_change_is_refused() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::AutolandEngage));
    assert_eq!(rig.carry_out(speed(3.0)), NO);
    assert!(rig.station().has_alert("no mode is commanded"));
    assert_eq!(rig.truth().mode, Px4::Land);
    rig.done(altimeter());
    assert_eq!(rig.truth().mode, Px4::Land);
}
