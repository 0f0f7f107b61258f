//! What a multicopter could miss for good, or a ground station could not match: seen first on a real PX4.

use kit::bridge::{Rig, Setup, cucs, orders, vehicle_id};
use px4_sim::{Config, Param};
use stanag_msgs::enums::{
    AckType, FlightPathControlMode as Mode, LimitType, TurnType, WaypointType,
};
use stanag_msgs::messages::{CurveSegmentPaper, UaPositionWaypoint, VehicleOperatingModeCommand};
use stanag_msgs::{Message, Scaled};

/// Waypoints to the north, 25 m apart, each to be flown over at 5 m/s, `climb_m` above the one before.
fn stairs(climb_m: f64) -> Vec<Message> {
    let mut plan: Vec<Message> = vec![orders::route(1).into()];
    for number in 1..=5_u16 {
        let next = if number == 5 { 0 } else { number + 1 };
        let steps = f64::from(number);
        let mut waypoint = orders::waypoint(
            number,
            next,
            5.0 + 25.0 * steps,
            0.0,
            20.0 + climb_m * steps,
        );
        waypoint.turn_type = Some(TurnType::FlyOver);
        waypoint.waypoint_to_speed = Scaled::from_si(5.0).ok();
        plan.push(waypoint.into());
    }
    plan
}

#[test]
fn fly_over_points_are_flown_over_in_climb_descent_and_level() {
    for climb_m in [1.5, 5.0, -1.5, 0.0] {
        let mut rig = Rig::ready();
        rig.send_plan(stairs(climb_m));
        rig.done(orders::load());
        rig.take_off(12.0);
        rig.done(orders::mode(Mode::Waypoint));
        let last_north = 130.0;
        let mut furthest = f64::MIN;
        let arrived = rig.until(150.0, |rig| {
            let at = rig.truth().position;
            let last_up = 20.0 + 5.0 * climb_m;
            (at.n - last_north).abs() < 1.0 && (at.d + last_up).abs() < 1.0
        });
        for _ in 0..50 {
            furthest = furthest.max(rig.truth().position.n);
            rig.run(0.2);
        }
        assert!(arrived, "{climb_m} m: it is at {:?}", rig.truth().position);
        assert!(
            furthest < last_north + 5.0,
            "{climb_m} m: it flew on to {furthest} m"
        );
        let reported = rig.station().has_alert("the vehicle stops at each point");
        assert_eq!(
            reported,
            climb_m != 0.0,
            "{climb_m} m: {:?}",
            rig.station().alerts()
        );
    }
}

/// Five waypoints 100 m apart to the north, without a speed of their own, `climb_m` above the one before.
fn slope(climb_m: f64) -> Vec<Message> {
    let waypoints = (1..=5_u16).map(|number| {
        let steps = f64::from(number);
        let next = if number == 5 { 0 } else { number + 1 };
        let up = 20.0 + climb_m * (steps - 1.0);
        orders::waypoint(number, next, 100.0 * steps, 0.0, up).into()
    });
    std::iter::once(orders::route(1).into())
        .chain(waypoints)
        .collect()
}

fn fly_at(speed_m_s: f64) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        commanded_speed: Scaled::from_si(speed_m_s).ok(),
        ..orders::mode(Mode::Waypoint)
    }
}

#[test]
fn a_speed_at_which_a_waypoint_of_the_climb_would_be_missed_is_refused() {
    let mut rig = Rig::ready();
    rig.send_plan(slope(5.0));
    rig.done(orders::load());
    rig.take_off(20.0);
    assert_eq!(rig.carry_out(fly_at(10.0)), Some(AckType::Refused));
    assert!(rig.station().has_alert("could miss waypoint 1"));
    rig.done(fly_at(5.0));
    assert!(rig.until(200.0, |rig| rig.truth().position.n > 495.0));
}

/// PX4 keeps the speed of the last leg over the jump, and would climb with it where nothing was planned for it.
#[test]
fn a_climb_without_a_speed_has_that_of_the_first_lap_on_each() {
    let mut rig = Rig::ready();
    let end = UaPositionWaypoint {
        waypoint_to_speed: Scaled::from_si(12.0).ok(),
        waypoint_type: Some(WaypointType::EndOfLoop),
        limit_type: Some(LimitType::Count),
        loop_limit: Some(3),
        ..orders::waypoint(3, 1, 200.0, 150.0, 30.0)
    };
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 100.0, 0.0, 20.0).into(),
        orders::waypoint(2, 3, 200.0, 0.0, 30.0).into(),
        end.into(),
    ]);
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    // The items: waypoint 1, the climb to 2, a speed, the fast leg to 3, the speed of the first lap, the jump.
    let climb = 1;
    let (mut laps, mut before, mut fastest) = (0, 0, [0.0_f64; 4]);
    for _ in 0..6_000 {
        rig.run(0.1);
        let at = rig.truth();
        if at.mode != px4_sim::Mode::Mission {
            break;
        }
        laps += u32::from(at.mission_seq == climb && before != climb);
        before = at.mission_seq;
        if let Some(fastest) = fastest.get_mut(usize::from(before)) {
            *fastest = fastest.max(at.velocity.horizontal());
        }
    }
    assert_ne!(rig.truth().mode, px4_sim::Mode::Mission, "it ends");
    assert_eq!(laps, 3);
    let [_, climbing_m_s, _, fast_m_s] = fastest;
    assert!(fast_m_s > 9.0, "{fast_m_s} m/s on the leg to 3");
    assert!(climbing_m_s < 5.5, "{climbing_m_s} m/s on the climb");
}

#[test]
fn a_level_route_is_flown_as_fast_as_is_commanded() {
    let mut rig = Rig::ready();
    rig.send_plan(slope(0.0));
    rig.done(orders::load());
    rig.take_off(12.0);
    rig.done(fly_at(10.0));
    assert!(rig.until(90.0, |rig| rig.truth().position.n > 250.0));
    // A speed for the route that is flown already is honoured, and nothing else is reported.
    rig.done(fly_at(4.0));
    assert!(rig.until(10.0, |rig| (rig.truth().velocity.n - 4.0).abs() < 0.3));
    assert!(
        !rig.station().has_alert("ignored"),
        "{:?}",
        rig.station().alerts()
    );
    assert!(rig.until(90.0, |rig| rig.truth().position.n > 495.0));
}

/// Whoever sets NAV_ACC_RAD lower has waypoints that a climb can miss: they are braked for, as fly-over points are.
#[test]
fn the_vehicles_own_radius_is_read_and_braked_for_where_it_is_small() {
    for (radius_m, stops, warns) in [(10.0, false, false), (3.0, true, false), (1.0, true, true)] {
        let vehicle = Config {
            params: vec![(Param::NAV_ACC_RAD, radius_m)],
            ..Config::default()
        };
        let mut rig = Rig::ready_with(Setup {
            vehicles: vec![vehicle],
            ..Setup::default()
        });
        let mut plan = vec![orders::route(1).into()];
        for number in 1..=4_u16 {
            let next = (number + 1) % 5;
            let (north, up) = (100.0 * f64::from(number), 20.0 + 5.0 * f64::from(number));
            plan.push(orders::waypoint(number, next, north, 0.0, up).into());
        }
        rig.send_plan(plan);
        rig.done(orders::load());
        let has_alert = |text| rig.station().has_alert(text);
        assert_eq!(
            (
                has_alert("the vehicle stops at each point"),
                has_alert("NAV_ACC_RAD is")
            ),
            (stops, warns),
            "{radius_m} m: {:?}",
            rig.station().alerts()
        );
        rig.take_off(20.0);
        rig.done(orders::mode(Mode::Waypoint));
        let arrived = rig.until(200.0, |rig| {
            let at = rig.truth().position;
            (at.n - 400.0).abs() < radius_m && (at.d + 40.0).abs() < 1.0
        });
        assert!(arrived, "{radius_m} m: {:?}", rig.truth().position);
    }
}

#[test]
fn a_landing_is_broken_off_with_a_climb() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let wave_off = || orders::mode(Mode::AutolandWaveOff);
    let height = |rig: &Rig| -rig.truth().position.d;
    assert_eq!(rig.carry_out(wave_off()), Some(AckType::Refused));
    assert!(rig.station().has_alert("nothing to abort"));
    // Back to where the landing began, or to the commanded altitude, and never down.
    let commanded = |up: f64| VehicleOperatingModeCommand {
        select_flight_path_control_mode: Some(Mode::AutolandWaveOff),
        ..orders::launch(up)
    };
    for (order, reached) in [(wave_off(), 20.0), (commanded(32.0), 32.0)] {
        rig.done(orders::mode(Mode::AutolandEngage));
        rig.run(5.0);
        let low = height(&rig);
        assert!((5.0..reached - 3.0).contains(&low), "{low} m");
        assert_eq!(rig.carry_out(commanded(4.0)), Some(AckType::Refused));
        assert!(rig.station().has_alert("mode 20 (wave-off) climbs"));
        rig.done(order);
        rig.run(20.0);
        assert!((height(&rig) - reached).abs() < 2.0, "{} m", height(&rig));
        assert_eq!(rig.truth().mode, px4_sim::Mode::Loiter);
    }
}

/// 50001 carries its Time Stamp as a float; the acknowledgement names it as that of any other message.
#[test]
fn the_papers_curve_is_acknowledged_by_its_stamp() {
    let mut rig = Rig::ready();
    let (p2, p3) = (orders::place(120.0, 50.0), orders::place(120.0, 150.0));
    let curve = CurveSegmentPaper {
        vehicle_id: Some(vehicle_id(0)),
        cucs_id: Some(cucs(0)),
        p1_waypoint_no: Some(1),
        p4_waypoint_no: Some(2),
        p2_latitude: Some(p2.0.to_radians()),
        p2_longitude: Some(p2.1.to_radians()),
        p3_latitude: Some(p3.0.to_radians()),
        p3_longitude: Some(p3.1.to_radians()),
        ..CurveSegmentPaper::default()
    };
    rig.done(curve);
}
