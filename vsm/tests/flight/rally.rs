//! Rally points of the configuration: uploaded, read back, watched, and returned to.

use kit::bridge::{Rig, Setup, orders};
use mavlink_link::dialect::{MISSION_CLEAR_ALL_DATA, MavMessage, MavMissionType};
use mavlink_link::service::Node;
use px4_sim::Mode as Px4;
use stanag_msgs::Text;
use stanag_msgs::enums::FlightPathControlMode as Mode;
use stanag_msgs::messages::ParameterSetCommand;

/// 280 m north and 380 m north of home.
const TWO: &str = "[[vehicle.rally]]\nplace = [47.4002634, 8.5455939]\nheight_m = 2.0\n\
                   [[vehicle.rally]]\nplace = [47.4011634, 8.5455939]\naltitude_m = 490.0\n";
const RALLY: MavMissionType = MavMissionType::MAV_MISSION_TYPE_RALLY;

fn with_points() -> Setup {
    Setup {
        vehicle_keys: TWO,
        ..Setup::default()
    }
}

/// What the vehicle holds: command, frame and height.
fn held(rig: &Rig) -> Vec<(u16, u8, f32)> {
    let items = rig.vehicles[0].vehicle().plan(RALLY).iter();
    items.map(|i| (i.command, i.frame, i.z)).collect()
}

/// How many the status has, and whether they are aboard.
fn shown(rig: &Rig) -> Option<(usize, bool)> {
    let bridge = rig.bridge.as_ref().expect("it runs");
    let status = bridge.status(String::new(), rig.now().mono);
    let points = status.vehicles[0].rally_points;
    points.map(|points| (points.count, points.aboard))
}

fn set_rtl_type(rig: &mut Rig, value: f64) {
    let command = ParameterSetCommand {
        parameter_name: Some(Text::new("RTL_TYPE")),
        commanded_value: Some(value),
        ..ParameterSetCommand::default()
    };
    rig.done(command);
}

#[test]
fn the_vehicle_returns_to_the_nearest_of_home_and_its_rally_points() {
    let mut rig = Rig::ready_with(with_points());
    assert!(rig.until(10.0, |rig| shown(rig) == Some((2, true))));
    assert_eq!(held(&rig), [(5100, 3, 2.0), (5100, 0, 490.0)]);
    // Some 180 m north of home, so 100 m from the first point.
    rig.take_off(20.0);
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 0, 190.0, 0.0, 20.0).into(),
    ]);
    rig.done(orders::load());
    rig.carry_out(orders::mode(Mode::Waypoint));
    assert!(rig.until(90.0, |rig| rig.truth().position.n > 170.0));
    // Without a contingency route, it is RTL.
    rig.carry_out(orders::mode(Mode::ContingencyA));
    assert_eq!(rig.truth().mode, Px4::Rtl);
    assert!(rig.until(200.0, |rig| !rig.truth().armed));
    let end = rig.truth().position;
    assert!((end.n - 280.2).abs() < 3.0 && end.e.abs() < 3.0, "{end:?}");
}

#[test]
fn a_return_type_that_ignores_them_is_warned_of() {
    let mut rig = Rig::ready_with(with_points());
    assert!(rig.until(10.0, |rig| shown(rig) == Some((2, true))));
    assert!(!rig.station().has_alert("ignores its rally points"));
    set_rtl_type(&mut rig, 2.0);
    assert!(
        rig.until(5.0, |rig| rig.station().has_alert(
            "ignores its rally points where it returns: RTL_TYPE 2, expected 0, 1, 3 or 5"
        )),
        "{:?}",
        rig.station().alerts()
    );
    set_rtl_type(&mut rig, 3.0);
    assert!(rig.until(5.0, |rig| {
        rig.station().has_alert("RTL_TYPE uses the rally points")
    }));
}

#[test]
fn points_that_another_station_takes_away_are_warned_of_and_those_of_a_restart_sent_once() {
    let mut rig = Rig::ready_with(with_points());
    assert!(rig.until(10.0, |rig| shown(rig) == Some((2, true))));
    let stored = rig.vehicles[0].vehicle().counters().plans_stored;
    rig.restart_bridge();
    rig.run(12.0);
    assert_eq!(rig.vehicles[0].vehicle().counters().plans_stored, stored);
    assert_eq!(shown(&rig), Some((2, true)));
    let clear = MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
        target_system: 1,
        target_component: 1,
        mission_type: RALLY,
    });
    rig.vehicles[0]
        .vehicle_mut()
        .handle_message(Node::new(255, 190), &clear);
    assert!(rig.until(5.0, |rig| {
        rig.station().has_alert("not those of the configuration")
    }));
    assert_eq!(shown(&rig), Some((2, false)));
}

#[test]
fn a_reload_brings_and_clears_them_beside_a_fence() {
    let mut rig = Rig::ready();
    let key = "signing = { key_file = \"uav.key\" }\n";
    let keys = "area = [{ keep = \"in\", centre = [47.3977434, 8.5455939], radius_m = 900 }]\n\
                rally = [{ place = [47.4002634, 8.5455939], height_m = 0 }]\n";
    let before = rig.text.clone();
    let with = before.replacen(key, &format!("{key}{keys}"), 1);
    let report = rig.reload(&with).expect("applied");
    assert_eq!(report.applied, ["vehicle 1b:00:01:01: area, rally"]);
    assert!(rig.until(10.0, |rig| shown(rig) == Some((1, true))));
    assert!(rig.until(1.0, |rig| {
        rig.station().has_alert("1 rally point is aboard")
    }));
    let fence = MavMissionType::MAV_MISSION_TYPE_FENCE;
    assert_eq!(rig.vehicles[0].vehicle().plan(fence).len(), 1);
    rig.reload(&before).expect("applied");
    assert!(rig.until(10.0, |rig| held(rig).is_empty()));
    assert_eq!(shown(&rig), None);
    assert!(rig.until(1.0, |rig| rig.station().has_alert("returns to home")));
}

#[test]
fn points_removed_from_the_file_are_cleared_after_a_restart_once() {
    let mut rig = Rig::ready();
    let (before, key) = (rig.text.clone(), "signing = { key_file = \"uav.key\" }\n");
    let keys = "rally = [{ place = [47.4002634, 8.5455939], height_m = 0 }]\n";
    let with = before.replacen(key, &format!("{key}{keys}"), 1);
    rig.reload(&with).expect("applied");
    assert!(rig.until(10.0, |rig| shown(rig) == Some((1, true))));
    rig.restart_with(&before);
    assert!(rig.until(15.0, |rig| held(rig).is_empty()));
    let text = "the rally points are cleared: the vehicle returns to home";
    let cleared = |rig: &Rig| {
        let alerts = rig.station().alerts();
        alerts.iter().filter(|alert| alert.contains(text)).count()
    };
    assert!(rig.until(1.0, |rig| cleared(rig) == 1));
    rig.run(8.0);
    let unknown = "holds rally points that the configuration does not have";
    assert!(!rig.station().has_alert(unknown));
    rig.restart_bridge();
    rig.run(12.0);
    assert_eq!(cleared(&rig), 1);
}

#[test]
fn points_that_cannot_be_used_are_refused_with_line_and_value() {
    let refused = |keys: &str| {
        let rig = Rig::ready().text;
        let key = "signing = { key_file = \"uav.key\" }\n";
        let text = rig.replacen(key, &format!("{key}{keys}"), 1);
        let parsed = vsm::config::Config::parse(&text, std::path::Path::new("/nowhere"));
        parsed.expect_err("it is refused").to_string()
    };
    for (keys, expected) in [
        (
            "rally = [{ place = [47.4, 8.5] }]",
            "either height_m or altitude_m",
        ),
        (
            "rally = [{ place = [0.0, 0.0], height_m = 1 }]",
            "other than 0 and 0",
        ),
        (
            "rally = [{ place = [47.4, 8.5], height_m = 9000 }]",
            "-500 to 5000 (metres)",
        ),
        (
            "area = [{ keep = \"in\", centre = [47.3977434, 8.5455939], radius_m = 90 }]\nrally = [{ place = [47.4, 8.5], height_m = 0 }]",
            "a place that the areas of the vehicle",
        ),
    ] {
        let text = refused(&format!("{keys}\n"));
        assert!(text.contains(expected), "{text}");
    }
}
