//! Mode 12 without a loiter position has the vehicle stay where it is, whatever it flies: also the flight to a commanded place or
//! altitude in that mode, which PX4 does not end where the mode is commanded once more.

use kit::bridge::flight::hold_at;
use kit::bridge::{Rig, orders};
use px4_sim::Mode as Px4;
use stanag_msgs::enums::{FlightPathControlMode as Mode, SpeedType};
use stanag_msgs::messages::VehicleOperatingModeCommand;
use stanag_msgs::{Bam32, Scaled};

/// Mode 12 at a place this far north of home.
fn there(north: f64) -> VehicleOperatingModeCommand {
    let (latitude, longitude) = orders::place(north, 0.0);
    VehicleOperatingModeCommand {
        loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
        loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
        ..orders::mode(Mode::Loiter)
    }
}

/// Mode 12 of a station that sends a speed with every command.
fn hold_with_a_speed() -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        commanded_speed: Some(Scaled::saturating_from_si(4.0)),
        speed_type: Some(SpeedType::Ground),
        ..orders::mode(Mode::Loiter)
    }
}

/// How far it moves within a while, over ground and in height, once it has had the time to brake.
fn moves(rig: &mut Rig) -> [f64; 2] {
    rig.run(8.0);
    let before = rig.truth().position;
    rig.run(20.0);
    let after = rig.truth().position;
    let ground_m = (after.n - before.n).hypot(after.e - before.e);
    [ground_m, (after.d - before.d).abs()]
}

fn stays(rig: &mut Rig, what: &str) {
    let [ground_m, height_m] = moves(rig);
    assert!(
        ground_m < 2.0 && height_m < 2.0,
        "{what}: {ground_m:.1} m over ground, {height_m:.1} m in height, {:?}",
        rig.truth()
    );
    assert_eq!(rig.truth().mode, Px4::Loiter, "{what}");
}

#[test]
fn a_hold_ends_the_flight_to_a_commanded_place_and_altitude() {
    for hold in [orders::mode(Mode::Loiter), hold_with_a_speed()] {
        let mut rig = Rig::ready();
        rig.take_off(20.0);
        rig.done(there(400.0));
        rig.run(10.0);
        rig.done(hold.clone());
        stays(&mut rig, "the way to a place");
        let north = rig.truth().position.n;
        assert!((10.0..200.0).contains(&north), "{north}");
        rig.done(hold_at(110.0));
        rig.run(6.0);
        rig.done(hold.clone());
        stays(&mut rig, "a climb");
        let up = -rig.truth().position.d;
        assert!((22.0..90.0).contains(&up), "{up}");
        // Commanded once more, it changes nothing.
        rig.done(hold);
        stays(&mut rig, "again");
    }
}

/// The vehicle has shown nothing of the place yet.
#[test]
fn a_hold_right_after_a_place_was_commanded_ends_the_flight_there() {
    for wait_s in [0.0, 0.1, 0.3] {
        let mut rig = Rig::ready();
        rig.take_off(20.0);
        rig.run(5.0);
        rig.send(there(400.0));
        rig.run(wait_s);
        rig.done(orders::mode(Mode::Loiter));
        stays(&mut rig, &format!("{wait_s} s"));
        assert!(rig.truth().position.n < 50.0, "{:?}", rig.truth());
    }
}

/// PX4 keeps the place that it flies to where it is commanded an altitude alone, be it a waypoint of its mission.
#[test]
fn an_altitude_without_a_place_is_flown_to_where_the_vehicle_is() {
    let routes: [fn(&mut Rig); 2] = [
        |rig| rig.done(orders::mode(Mode::Waypoint)),
        |rig| rig.done(there(500.0)),
    ];
    for fly in routes {
        let mut rig = Rig::ready();
        rig.send_plan(vec![
            orders::route(1).into(),
            orders::waypoint(1, 0, 500.0, 0.0, 20.0).into(),
        ]);
        rig.done(orders::load());
        rig.take_off(20.0);
        fly(&mut rig);
        rig.run(10.0);
        rig.done(hold_at(30.0));
        assert!(rig.until(20.0, |rig| -rig.truth().position.d > 29.0));
        stays(&mut rig, "an altitude");
        let north = rig.truth().position.n;
        assert!((10.0..200.0).contains(&north), "{north}");
    }
}
