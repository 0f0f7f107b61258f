//! The altitude band: what would leave it is refused, and a vehicle that leaves it is reported, and held where that is configured.

use kit::bridge::{Rig, Setup, orders};
use mavlink_link::dialect::MavCmd;
use mavlink_link::service::{Node, command};
use px4_sim::Mode as Px4;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode};

fn banded(outside: &'static str) -> Rig {
    Rig::ready_with(Setup {
        vehicle_keys: outside,
        ..Setup::default()
    })
}

const ALERTED: &str = "[vehicle.limits]\nlowest_m = 10.0\nhighest_m = 40.0\n";
const HELD: &str = "[vehicle.limits]\nlowest_m = 10.0\nhighest_m = 40.0\noutside = \"hold\"\n";

/// Another ground station changes the altitude, in whatever mode.
fn elsewhere(rig: &mut Rig, north: f64, up: f64) {
    let (latitude, longitude) = orders::place(north, 0.0);
    let home_m = 488.0;
    let [latitude, longitude, height_m] =
        [latitude, longitude, home_m + up].map(|value| value as f32);
    let params = [-1.0, 1.0, 0.0, f32::NAN, latitude, longitude, height_m];
    let reposition = command::long(Node::new(1, 1), MavCmd::MAV_CMD_DO_REPOSITION, params);
    rig.vehicles[0]
        .vehicle_mut()
        .handle_message(Node::new(255, 190), &reposition);
}

fn outside(rig: &Rig) -> bool {
    let bridge = rig.bridge.as_ref().expect("it runs");
    let status = bridge.status(String::new(), rig.now().mono);
    status.vehicles[0].altitude_band.outside
}

#[test]
fn routes_and_commands_that_leave_the_band_are_refused_and_the_vehicle_that_does_is_reported() {
    let mut rig = banded(ALERTED);
    rig.take_off(20.0);
    for (up, limit) in [(60.0, "60 m"), (5.0, "5 m")] {
        rig.send_plan(vec![
            orders::route(1).into(),
            orders::waypoint(1, 0, 80.0, 0.0, up).into(),
        ]);
        assert_eq!(rig.carry_out(orders::load()), Some(AckType::Refused));
        rig.run(0.2);
        let text = format!("waypoint 1: {limit} above home, expected 10 to 40");
        assert!(
            rig.station().has_alert(&text),
            "{:?}",
            rig.station().alerts()
        );
        let hold = kit::bridge::flight::hold_at(up);
        assert_eq!(rig.carry_out(hold), Some(AckType::Refused));
    }
    rig.run(2.0);
    assert!(!outside(&rig));
    elsewhere(&mut rig, 0.0, 50.0);
    assert!(
        rig.until(30.0, |rig| rig
            .station()
            .has_alert("left its altitude band of 10 to 40 m above home")),
        "{:?}",
        rig.station().alerts()
    );
    assert!(outside(&rig));
    elsewhere(&mut rig, 0.0, 30.0);
    assert!(rig.until(60.0, |rig| {
        rig.station().has_alert("within its altitude band again")
    }));
    elsewhere(&mut rig, 0.0, 4.0);
    assert!(rig.until(60.0, outside));
    // A landing is no way out.
    elsewhere(&mut rig, 0.0, 20.0);
    assert!(rig.until(60.0, |rig| !outside(rig)));
    rig.done(orders::mode(Mode::ContingencyA));
    assert!(rig.until(120.0, |rig| outside(rig) || !rig.truth().armed));
    assert!(!outside(&rig));
}

#[test]
fn a_mission_that_is_outside_after_a_reload_is_held() {
    let mut rig = banded(HELD);
    rig.take_off(20.0);
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 0, 400.0, 0.0, 38.0).into(),
    ]);
    rig.done(orders::load());
    rig.carry_out(orders::mode(Mode::Waypoint));
    assert!(rig.until(60.0, |rig| -rig.truth().position.d > 36.0));
    assert_eq!(rig.truth().mode, Px4::Mission);
    let text = rig.text.replacen("highest_m = 40.0", "highest_m = 25.0", 1);
    rig.reload(&text).expect("applied");
    assert!(
        rig.until(10.0, |rig| rig.station().has_alert("commanding hold")),
        "{:?}",
        rig.station().alerts()
    );
    assert!(rig.until(10.0, |rig| rig.truth().mode == Px4::Loiter));
}
