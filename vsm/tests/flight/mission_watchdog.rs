//! A mission that gets no nearer to its waypoint, or sinks below its altitudes, ends in a hold that is reported; honest
//! flight never does.

use kit::bridge::{Faults, Rig, Setup, orders};
use px4_sim::{Airframe, Config, HealthFaults, Mode as Px4, Param};
use stanag_msgs::enums::{
    FlightPathControlMode as Mode, LimitType, LoiterDurationUnits, LoiterType, TurnType,
    WaypointType,
};
use stanag_msgs::messages::{UaLoiterWaypoint, UaPositionWaypoint};
use stanag_msgs::{Message, Scaled};

/// The text that both forms of the alert have.
const HELD: &str = "commanding hold";

/// A bend of 150 m in short legs, from waypoint 101 on.
fn bend() -> Vec<Message> {
    let p = [(30.0, 0.0), (90.0, 0.0), (120.0, 40.0), (120.0, 100.0)];
    let mut plan = vec![orders::route(101).into()];
    for k in 0..=14u16 {
        let t = f64::from(k) / 14.0;
        let u = 1.0 - t;
        let w = [u * u * u, 3.0 * u * u * t, 3.0 * u * t * t, t * t * t];
        let sum =
            |pick: fn(&(f64, f64)) -> f64| w.iter().zip(&p).map(|(w, p)| w * pick(p)).sum::<f64>();
        let next = if k == 14 { 0 } else { 102 + k };
        let at = orders::waypoint(101 + k, next, sum(|p| p.0), sum(|p| p.1), 20.0);
        plan.push(at.into());
    }
    plan
}

/// Loads a plan in the air and flies it.
fn under_way(setup: Setup, plan: Vec<Message>) -> Rig {
    let mut rig = Rig::ready_with(setup);
    rig.send_plan(plan);
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    rig
}

fn quad(seed: u64, params: &[(Param, f64)]) -> Setup {
    Setup {
        seed,
        vehicles: vec![Config {
            params: params.to_vec(),
            ..Config::default()
        }],
        ..Setup::default()
    }
}

#[test]
fn a_waypoint_that_is_missed_for_good_ends_in_a_hold_with_its_number() {
    let (mut missed, mut flown) = (0, 0);
    for seed in 1..=6 {
        // An acceptance radius that a real PX4 misses too, and then flies on without a word.
        let mut rig = under_way(quad(seed, &[(Param::NAV_ACC_RAD, 0.5)]), bend());
        let ended = rig.until(400.0, |rig| rig.truth().mode == Px4::Loiter);
        assert!(ended, "seed {seed}: {:?}", rig.truth());
        let seq = rig.truth().mission_seq;
        if !rig.station().has_alert(HELD) {
            assert_eq!(seq, 14, "seed {seed}: the route was not flown");
            flown += 1;
            continue;
        }
        missed += 1;
        let waypoint = format!("waypoint {}: ", 101 + seq);
        assert!(
            rig.station().has_alert(&waypoint),
            "{seq} {:?}",
            rig.station().alerts()
        );
        assert!(
            rig.truth().position.horizontal() < 300.0,
            "{:?}",
            rig.truth()
        );
        // It stays held, and the operator can fly on.
        rig.run(5.0);
        assert_eq!(rig.truth().mode, Px4::Loiter);
        let mut on = orders::mode(Mode::Waypoint);
        on.commanded_waypoint_number = Some(115);
        rig.done(on);
    }
    assert!(missed > 0, "no waypoint was missed: nothing was tried");
    assert!(missed + flown == 6);
}

#[test]
fn without_the_watch_it_flies_away() {
    let gone = (1..=6).any(|seed| {
        let setup = Setup {
            vehicle_keys: "stall_s = 0",
            ..quad(seed, &[(Param::NAV_ACC_RAD, 0.5)])
        };
        let mut rig = under_way(setup, bend());
        rig.run(240.0);
        assert!(!rig.station().has_alert(HELD));
        rig.truth().mode == Px4::Mission
    });
    assert!(gone, "every waypoint was taken: nothing was tried");
}

fn at_speed(mut waypoint: UaPositionWaypoint, speed_m_s: f64) -> UaPositionWaypoint {
    waypoint.waypoint_to_speed = Some(Scaled::saturating_from_si(speed_m_s));
    waypoint
}

fn loiter(waypoint: u16, seconds: Option<u16>) -> Message {
    UaLoiterWaypoint {
        waypoint_number: Some(waypoint),
        waypoint_loiter_type: Some(LoiterType::Circular),
        loiter_radius: Some(Scaled::saturating_from_si(60.0)),
        loiter_duration: seconds,
        loiter_duration_units: Some(LoiterDurationUnits::Seconds),
        ..UaLoiterWaypoint::default()
    }
    .into()
}

/// Everything that is no stall: there and back at full speed, a climb and a descent on the spot, a crawl, a loop, a
/// fly-over, a hover of a minute, a hover for ever.
fn honest(fast_m_s: f64, slow_m_s: f64) -> Vec<Message> {
    let over = UaPositionWaypoint {
        turn_type: Some(TurnType::FlyOver),
        ..at_speed(orders::waypoint(2, 3, 0.0, 30.0, 20.0), fast_m_s)
    };
    let mut plan: Vec<Message> = vec![
        orders::route(1).into(),
        at_speed(orders::waypoint(1, 2, 200.0, 0.0, 20.0), fast_m_s).into(),
        over.into(),
        at_speed(orders::waypoint(3, 4, 200.0, 20.0, 20.0), fast_m_s).into(),
        orders::waypoint(4, 5, 200.0, 20.0, 130.0).into(),
        at_speed(orders::waypoint(5, 6, 200.0, 60.0, 40.0), fast_m_s).into(),
        at_speed(orders::waypoint(6, 7, 200.0, 90.0, 40.0), slow_m_s).into(),
        at_speed(orders::waypoint(7, 8, 100.0, 90.0, 40.0), fast_m_s).into(),
    ];
    let end_of_loop = UaPositionWaypoint {
        waypoint_type: Some(WaypointType::EndOfLoop),
        limit_type: Some(LimitType::Count),
        loop_limit: Some(3),
        ..orders::waypoint(8, 7, 200.0, 90.0, 40.0)
    };
    plan.push(end_of_loop.into());
    plan.push(loiter(5, Some(70)));
    plan
}

#[test]
fn honest_flight_of_a_multicopter_is_never_held() {
    for (seed, wind) in [(1, [0.0, 0.0]), (2, [8.0, -3.0]), (3, [-6.0, 6.0])] {
        let mut setup = quad(seed, &[]);
        setup.vehicles[0].wind_ne_ms = wind;
        setup.vehicle_keys = "stall_s = 10";
        let mut rig = under_way(setup, honest(12.0, 0.4));
        let end = rig.until(900.0, |rig| rig.truth().mode != Px4::Mission);
        assert!(end, "seed {seed}: {:?}", rig.truth());
        assert!(
            !rig.station().has_alert(HELD),
            "seed {seed}: {:?}",
            rig.station().alerts()
        );
    }
}

#[test]
fn honest_flight_over_a_bad_link_is_never_held() {
    let bad = Faults {
        loss: 0.3,
        ..Faults::NONE
    };
    let mut setup = quad(9, &[]);
    setup.mav = bad;
    let mut rig = under_way(setup, orders::square());
    assert!(rig.until(300.0, |rig| rig.truth().mode != Px4::Mission));
    assert!(
        !rig.station().has_alert(HELD),
        "{:?}",
        rig.station().alerts()
    );
}

#[test]
fn a_loiter_without_end_is_never_held() {
    let mut plan = orders::square();
    plan.push(loiter(102, None));
    let mut rig = under_way(quad(4, &[]), plan);
    rig.run(400.0);
    assert_eq!(rig.truth().mode, Px4::Mission);
    assert!(
        !rig.station().has_alert(HELD),
        "{:?}",
        rig.station().alerts()
    );
}

#[test]
fn honest_flight_on_wings_is_never_held() {
    for (seed, wind) in [(1, [0.0, 0.0]), (2, [5.0, -5.0])] {
        let plane = Config {
            airframe: Airframe::Plane,
            // No landing is what this is about.
            params: vec![(Param::MIS_TKO_LAND_REQ, 0.0)],
            wind_ne_ms: wind,
            ..Config::default()
        };
        let setup = Setup {
            seed,
            vehicles: vec![plane],
            ..Setup::default()
        };
        let mut rig = Rig::ready_with(setup);
        let plan = vec![
            orders::route(1).into(),
            orders::waypoint(1, 2, 500.0, 0.0, 80.0).into(),
            // Back, to a place within the turn, and far below.
            orders::waypoint(2, 3, 380.0, 60.0, 120.0).into(),
            orders::waypoint(3, 4, 900.0, 60.0, 60.0).into(),
            orders::waypoint(4, 5, 900.0, 800.0, 60.0).into(),
            orders::waypoint(5, 0, 0.0, 0.0, 80.0).into(),
            loiter(4, Some(120)),
        ];
        rig.send_plan(plan);
        rig.done(orders::load());
        rig.take_off(60.0);
        rig.done(orders::mode(Mode::Waypoint));
        let end = rig.until(900.0, |rig| rig.truth().mode != Px4::Mission);
        assert!(
            !rig.station().has_alert(HELD),
            "seed {seed}: {:?}",
            rig.station().alerts()
        );
        assert!(end, "seed {seed}: {:?}", rig.truth());
    }
}

/// From now on it flies this much too low in its mission.
fn fly_low(rig: &mut Rig, low_m: u16) {
    rig.vehicles[0]
        .vehicle_mut()
        .set_health_faults(HealthFaults {
            low_m,
            ..HealthFaults::default()
        });
}

#[test]
fn a_vehicle_that_sinks_in_its_mission_is_held_above_the_ground() {
    // Also where no watch of the progress is configured.
    let setup = Setup {
        vehicle_keys: "stall_s = 0",
        ..quad(5, &[])
    };
    let mut rig = under_way(setup, orders::square());
    rig.run(2.0);
    fly_low(&mut rig, 40);
    let ended = rig.until(60.0, |rig| rig.truth().mode == Px4::Loiter);
    let alerts = rig.station().alerts();
    assert!(ended, "{:?} {alerts:?}", rig.truth());
    assert!(
        alerts
            .iter()
            .any(|text| text.contains("sinks in its mission: 1") && text.contains(HELD)),
        "{alerts:?}"
    );
    rig.run(10.0);
    let truth = rig.truth();
    assert_eq!(truth.mode, Px4::Loiter);
    assert!(-truth.position.d > 8.0, "{truth:?}");
    // The operator flies on, and the alert is cleared.
    fly_low(&mut rig, 0);
    rig.done(orders::mode(Mode::Waypoint));
    assert!(rig.until(30.0, |rig| {
        rig.station().has_alert("heights of its mission again")
    }));
}

#[test]
fn wings_that_dive_in_their_mission_are_held_above_the_ground() {
    let plane = Config {
        airframe: Airframe::Plane,
        params: vec![(Param::MIS_TKO_LAND_REQ, 0.0)],
        ..Config::default()
    };
    let mut rig = Rig::ready_with(Setup {
        vehicles: vec![plane],
        ..Setup::default()
    });
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 600.0, 0.0, 80.0).into(),
        orders::waypoint(2, 0, 1_500.0, 0.0, 80.0).into(),
    ]);
    rig.done(orders::load());
    rig.take_off(80.0);
    rig.done(orders::mode(Mode::Waypoint));
    rig.run(3.0);
    fly_low(&mut rig, 200);
    let held = rig.until(90.0, |rig| rig.truth().mode == Px4::Loiter);
    assert!(held, "{:?}", rig.truth());
    assert!(
        rig.station().has_alert("sinks in its mission"),
        "{:?}",
        rig.station().alerts()
    );
    assert!(-rig.truth().position.d > 30.0, "{:?}", rig.truth());
}
