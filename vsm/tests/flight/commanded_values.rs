//! 3002 and 3004 report what the vehicle was commanded in the mode that it is in, and nothing of before; a speed on a
//! circle is flown before it is acknowledged.

use kit::bridge::{Rig, orders, vehicle_id};
use stanag_msgs::enums::{
    AckType, AltitudeCommandType, AltitudeType, FlightPathControlMode as Mode, HeadingCommandType,
    LoiterDirection, LoiterType, SpeedType,
};
use stanag_msgs::messages::{
    LoiterConfiguration, UaPositionWaypoint, VehicleOperatingModeCommand, VehicleOperatingStates,
};
use stanag_msgs::{Bam16, Bam32, Message, Scaled};

fn states(rig: &mut Rig) -> VehicleOperatingStates {
    rig.run(0.6);
    let states = rig
        .station()
        .last(vehicle_id(0), 3002, |message| match message {
            Message::VehicleOperatingStates(states) => Some(states.clone()),
            _ => None,
        });
    states.expect("a 3002")
}

fn speed(rig: &mut Rig) -> Option<f64> {
    states(rig).commanded_speed.map(|speed| speed.si())
}

fn at_speed(mode: Mode, speed_m_s: f64) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        commanded_speed: Some(Scaled::saturating_from_si(speed_m_s)),
        speed_type: Some(SpeedType::Ground),
        ..orders::mode(mode)
    }
}

fn there(north: f64, east: f64) -> VehicleOperatingModeCommand {
    let (latitude, longitude) = orders::place(north, east);
    VehicleOperatingModeCommand {
        loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
        loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
        ..orders::mode(Mode::Loiter)
    }
}

#[test]
fn a_speed_ends_with_the_mode_that_it_was_commanded_in() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.run(3.0);
    let states = states(&mut rig);
    assert!(
        states.commanded_altitude.is_some(),
        "where it has taken off to"
    );
    rig.done(at_speed(Mode::Loiter, 3.0));
    assert_eq!(speed(&mut rig), Some(3.0));
    rig.done(orders::mode(Mode::Waypoint));
    assert_eq!(speed(&mut rig), None);
    rig.done(at_speed(Mode::Waypoint, 4.0));
    assert_eq!(speed(&mut rig), Some(4.0));
    // The route is over: the vehicle holds by itself.
    assert!(rig.until(200.0, |rig| rig.truth().mode == px4_sim::Mode::Loiter));
    rig.run(1.5);
    assert_eq!(speed(&mut rig), None);
    rig.done(at_speed(Mode::Loiter, 3.0));
    rig.done(orders::mode(Mode::AutolandEngage));
    let landing = self::states(&mut rig);
    assert_eq!(landing.commanded_speed, None);
    assert_eq!(landing.commanded_altitude, None);
}

#[test]
fn a_speed_of_the_route_takes_the_place_of_one_commanded_before_it() {
    let mut rig = Rig::ready();
    let slow = UaPositionWaypoint {
        waypoint_to_speed: Some(Scaled::saturating_from_si(2.0)),
        ..orders::waypoint(3, 0, 40.0, 60.0, 20.0)
    };
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 40.0, 0.0, 20.0).into(),
        orders::waypoint(2, 3, 40.0, 30.0, 20.0).into(),
        slow.into(),
    ]);
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.done(at_speed(Mode::Waypoint, 6.0));
    assert_eq!(speed(&mut rig), Some(6.0));
    let to = |rig: &Rig| {
        rig.station()
            .last(vehicle_id(0), 3002, |message| match message {
                Message::VehicleOperatingStates(states) => states.commanded_waypoint_number,
                _ => None,
            })
    };
    assert!(rig.until(90.0, |rig| to(rig) == Some(3)));
    assert_eq!(speed(&mut rig), Some(2.0));
}

#[test]
fn a_speed_on_a_circle_is_flown_before_it_is_acknowledged() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    rig.done(LoiterConfiguration {
        loiter_type: Some(LoiterType::Circular),
        loiter_radius: Some(Scaled::saturating_from_si(30.0)),
        loiter_direction: Some(LoiterDirection::CounterClockwise),
        ..LoiterConfiguration::default()
    });
    let circle = VehicleOperatingModeCommand {
        commanded_speed: Some(Scaled::saturating_from_si(4.0)),
        ..there(40.0, 0.0)
    };
    rig.done(circle);
    assert_eq!(rig.truth().mode, px4_sim::Mode::Orbit);
    rig.run(40.0);
    let flown = |rig: &Rig| {
        let velocity = rig.truth().velocity;
        velocity.n.hypot(velocity.e)
    };
    assert!((flown(&rig) - 4.0).abs() < 0.5, "{}", flown(&rig));
    let before = states(&mut rig);
    assert!(before.commanded_loiter_position_latitude.is_some());
    for wanted in [2.0, 5.0_f64] {
        rig.done(at_speed(Mode::Loiter, wanted));
        let slack = (0.25 * wanted).max(0.5) + 0.1;
        assert!((flown(&rig) - wanted).abs() < slack, "{}", flown(&rig));
        let after = states(&mut rig);
        assert_eq!(after.commanded_speed.map(|it| it.si()), Some(wanted));
        // The circle is the same.
        assert_eq!(
            after.commanded_loiter_position_latitude,
            before.commanded_loiter_position_latitude
        );
        assert_eq!(after.commanded_altitude, before.commanded_altitude);
        assert_eq!(rig.truth().mode, px4_sim::Mode::Orbit);
    }
    // The same circle at another altitude; on the way there another speed keeps that altitude.
    rig.done(VehicleOperatingModeCommand {
        altitude_command_type: Some(AltitudeCommandType::Altitude),
        commanded_altitude: Some(Scaled::saturating_from_si(50.0)),
        altitude_type: Some(AltitudeType::Agl),
        ..there(40.0, 0.0)
    });
    let height = |rig: &Rig| -rig.truth().position.d;
    assert!(height(&rig) < 45.0, "on the way: {}", height(&rig));
    rig.done(at_speed(Mode::Loiter, 3.0));
    assert!(rig.until(60.0, |rig| (height(rig) - 50.0).abs() < 1.0));
    rig.run(5.0);
    assert!((height(&rig) - 50.0).abs() < 1.0, "{}", height(&rig));
    // PX4 would fly no faster than the circle allows.
    let end = rig.carry_out(at_speed(Mode::Loiter, 8.0));
    assert_eq!(end, Some(AckType::Refused));
    assert!(
        rig.station()
            .has_alert("speed 8.0 m/s on a circle of 30 m, at most 7.7")
    );
}

#[test]
fn a_loiter_that_was_configured_before_a_restart_of_the_bridge_is_not_flown_without_a_word() {
    const NONE: &str = "hovers: no 2017 since the start of this VSM";
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    rig.done(LoiterConfiguration {
        loiter_type: Some(LoiterType::Circular),
        loiter_radius: Some(Scaled::saturating_from_si(20.0)),
        ..LoiterConfiguration::default()
    });
    rig.done(there(40.0, 0.0));
    assert_eq!(rig.truth().mode, px4_sim::Mode::Orbit);
    assert!(!rig.station().has_alert(NONE));
    rig.restart_bridge();
    rig.run(5.0);
    rig.done(there(0.0, 0.0));
    assert_eq!(rig.truth().mode, px4_sim::Mode::Loiter);
    assert!(rig.station().has_alert(NONE));
}

#[test]
fn an_altitude_alone_leaves_a_circle_as_it_is() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let configured = |radius_m| LoiterConfiguration {
        loiter_type: Some(LoiterType::Circular),
        loiter_radius: Some(Scaled::saturating_from_si(radius_m)),
        loiter_direction: Some(LoiterDirection::CounterClockwise),
        ..LoiterConfiguration::default()
    };
    rig.done(configured(20.0));
    rig.done(VehicleOperatingModeCommand {
        commanded_speed: Some(Scaled::saturating_from_si(3.0)),
        ..there(40.0, 0.0)
    });
    rig.run(40.0);
    // The next circle; the present one stays.
    rig.done(configured(60.0));
    let before = states(&mut rig);
    for above_home_m in [30.0, 15.0] {
        rig.done(VehicleOperatingModeCommand {
            altitude_command_type: Some(AltitudeCommandType::Altitude),
            commanded_altitude: Some(Scaled::saturating_from_si(above_home_m)),
            altitude_type: Some(AltitudeType::Agl),
            ..VehicleOperatingModeCommand::default()
        });
        let height = |rig: &Rig| -rig.truth().position.d;
        assert!(rig.until(60.0, |rig| (height(rig) - above_home_m).abs() < 1.0));
        rig.run(10.0);
        let truth = rig.truth();
        assert_eq!(truth.mode, px4_sim::Mode::Orbit);
        let from_centre_m = (truth.position.n - 40.0).hypot(truth.position.e);
        assert!((from_centre_m - 20.0).abs() < 5.0, "{from_centre_m}");
        let flown_m_s = truth.velocity.n.hypot(truth.velocity.e);
        assert!((flown_m_s - 3.0).abs() < 1.0, "{flown_m_s}");
        let after = states(&mut rig);
        assert_eq!(
            after.commanded_loiter_position_latitude,
            before.commanded_loiter_position_latitude
        );
        assert_eq!(after.commanded_speed, before.commanded_speed);
        assert_ne!(after.commanded_altitude, before.commanded_altitude);
    }
    // The mode without a place stops the vehicle, and its station learns that no circle is flown.
    rig.done(orders::mode(Mode::Loiter));
    assert_eq!(rig.truth().mode, px4_sim::Mode::Loiter);
    assert!(
        rig.station().has_alert(
            "without a loiter position hovers here; the circle of 2017 needs a position"
        )
    );
}

#[test]
fn nothing_in_flight_commands_an_altitude_below_home() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let home_m = px4_sim::Config::default().home.altitude_m;
    for (mode, altitude_m, kind) in [
        (Mode::Loiter, home_m - 3.0, AltitudeType::Barometric),
        (Mode::Loiter, -3.0, AltitudeType::Agl),
        (Mode::Autopilot, home_m - 3.0, AltitudeType::Barometric),
        (Mode::Autopilot, -3.0, AltitudeType::Agl),
    ] {
        let end = rig.carry_out(VehicleOperatingModeCommand {
            altitude_command_type: Some(AltitudeCommandType::Altitude),
            commanded_altitude: Some(Scaled::saturating_from_si(altitude_m)),
            altitude_type: Some(kind),
            ..orders::mode(mode)
        });
        let alerts = rig.station().alerts();
        assert_eq!(end, Some(AckType::Refused), "{mode:?} {kind:?} {alerts:?}");
        let why = alerts.last().expect("a reason");
        assert!(why.contains("m below home (48"), "{mode:?} {kind:?} {why}");
    }
}

#[test]
fn a_direction_is_reported_as_it_was_commanded_and_ends_with_mode_15() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let turn = |kind| VehicleOperatingModeCommand {
        heading_command_type: Some(kind),
        commanded_turn_rate: Some(Scaled::from_raw(500)),
        commanded_heading: Some(Bam16::from_degrees(90.0)),
        ..orders::mode(Mode::Autopilot)
    };
    rig.done(turn(HeadingCommandType::TurnRate));
    let turning = states(&mut rig);
    assert_eq!(turning.commanded_turn_rate, Some(Scaled::from_raw(500)));
    assert_eq!(turning.commanded_heading, None);
    let kind = |states: &VehicleOperatingStates| states.heading_command_type;
    assert_eq!(kind(&turning), Some(HeadingCommandType::TurnRate));
    // A speed alone turns nothing.
    rig.done(at_speed(Mode::Autopilot, 3.0));
    let turning = states(&mut rig);
    assert_eq!(turning.commanded_turn_rate, Some(Scaled::from_raw(500)));
    rig.done(turn(HeadingCommandType::Heading));
    let steady = states(&mut rig);
    assert_eq!(steady.commanded_turn_rate, None);
    assert_eq!(steady.commanded_heading, Some(Bam16::from_degrees(90.0)));
    assert_eq!(steady.commanded_course, None);
    assert_eq!(kind(&steady), Some(HeadingCommandType::Heading));
    rig.done(VehicleOperatingModeCommand {
        commanded_course: Some(Bam16::from_degrees(180.0)),
        ..turn(HeadingCommandType::HeadingAndCourse)
    });
    let both = states(&mut rig);
    assert_eq!(kind(&both), Some(HeadingCommandType::HeadingAndCourse));
    rig.done(orders::mode(Mode::Loiter));
    let held = states(&mut rig);
    assert_eq!((held.commanded_heading, kind(&held)), (None, None));
}

/// Altitude Command Type: with the altitude of the present mode, and absent without one.
#[test]
fn an_altitude_is_reported_as_commanded_in_the_mode_that_flies_it() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let to = |mode, above_home_m| VehicleOperatingModeCommand {
        altitude_command_type: Some(AltitudeCommandType::Altitude),
        commanded_altitude: Some(Scaled::saturating_from_si(above_home_m)),
        altitude_type: Some(AltitudeType::Agl),
        ..orders::mode(mode)
    };
    let reported = |rig: &mut Rig| {
        let states = states(rig);
        let altitude_m = states.commanded_altitude.map(|altitude| altitude.si());
        (altitude_m.is_some(), states.altitude_command_type)
    };
    let commanded = (true, Some(AltitudeCommandType::Altitude));
    rig.done(to(Mode::Loiter, 30.0));
    assert_eq!(reported(&mut rig), commanded);
    // On entry to mode 15 the vehicle keeps the altitude that it has: that of mode 12 is not flown.
    rig.done(at_speed(Mode::Autopilot, 3.0));
    assert_eq!(reported(&mut rig), (false, None));
    rig.done(to(Mode::Autopilot, 25.0));
    assert_eq!(reported(&mut rig), commanded);
    rig.done(VehicleOperatingModeCommand {
        altitude_command_type: Some(AltitudeCommandType::VerticalSpeed),
        commanded_vertical_speed: Some(Scaled::saturating_from_si(1.0)),
        ..orders::mode(Mode::Autopilot)
    });
    assert_eq!(reported(&mut rig), (false, None));
    rig.done(orders::mode(Mode::Loiter));
    assert_eq!(reported(&mut rig), (false, None));
}
