//! Manual flight and steering: what the vehicle does with sticks, what becomes of it when they stop, and that set
//! points never starve.

use kit::bridge::{Faults, Rig, Setup, orders};
use px4_sim::Mode as Px4;
use stanag_msgs::enums::{
    AckType, AltitudeCommandType, AltitudeType, CommandedEngineState,
    FlightPathControlMode as Mode, HeadingCommandType, LightsBitmap,
};
use stanag_msgs::messages::{
    EngineCommand, UaStickCommand, UnmannedAircraftLights, VehicleOperatingModeCommand,
};
use stanag_msgs::{Bam16, Bam32, Scaled};

fn sticks(forward: i8, right: i8, throttle: u8) -> UaStickCommand {
    UaStickCommand {
        longitudinal_stick: Some(forward),
        lateral_stick: Some(right),
        rotational_stick_rudder: Some(0),
        throttle_stick_engine_1: Some(throttle),
        ..UaStickCommand::default()
    }
}

/// Sends these sticks ten times a second for so long.
fn fly(rig: &mut Rig, seconds: f64, held: &UaStickCommand) {
    for _ in 0..(seconds * 10.0) as u32 {
        rig.send_once(held.clone());
        rig.run(0.1);
    }
}

/// Sends a command while sticks keep coming, and gives how it ended.
fn command_while(
    rig: &mut Rig,
    held: &UaStickCommand,
    command: VehicleOperatingModeCommand,
) -> Option<AckType> {
    let ticket = rig.send(command);
    for _ in 0..150 {
        fly(rig, 0.1, held);
        if let Some(end) = rig.station().end(ticket) {
            return Some(end);
        }
    }
    None
}

fn steer() -> VehicleOperatingModeCommand {
    orders::mode(Mode::Autopilot)
}

#[test]
fn sticks_fly_and_their_loss_is_the_vehicles_own_to_treat() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    // Without sticks the mode is not entered: nothing is sent to the vehicle for it.
    assert_eq!(
        rig.carry_out(orders::mode(Mode::FlightDirector)),
        Some(AckType::Refused)
    );
    assert!(rig.station().has_alert("no sticks"));
    assert_ne!(rig.truth().mode, Px4::PosCtl);

    let centred = sticks(0, 0, 50);
    fly(&mut rig, 0.5, &centred);
    let entered = command_while(&mut rig, &centred, orders::mode(Mode::FlightDirector));
    assert_eq!(
        entered,
        Some(AckType::CarriedOut),
        "{:?}",
        rig.station().alerts()
    );
    assert_eq!(rig.truth().mode, Px4::PosCtl);
    let start = rig.truth().position;
    fly(&mut rig, 4.0, &sticks(100, 0, 50));
    let north = rig.truth().position.n - start.n;
    assert!(
        north > 8.0,
        "forward is the way the nose points, north: {north}"
    );
    fly(&mut rig, 4.0, &sticks(0, 100, 50));
    let east = rig.truth().position.e - start.e;
    assert!(east > 5.0, "right: {east}");
    fly(&mut rig, 4.0, &sticks(0, 0, 100));
    let up = start.d - rig.truth().position.d;
    assert!(up > 4.0, "throttle up: {up}");

    // They stop: the vehicle sees the loss as it is.
    assert!(rig.until(10.0, |rig| rig.truth().mode != Px4::PosCtl));
    assert!(rig.station().has_alert("have stopped"));
    let mode = rig.truth().mode;
    fly(&mut rig, 2.0, &sticks(100, 0, 50));
    assert_eq!(rig.truth().mode, mode, "sticks alone take nothing back");
}

#[test]
fn a_mission_is_not_interrupted_by_sticks_that_nobody_requested() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    fly(&mut rig, 3.0, &sticks(100, 100, 100));
    assert_eq!(rig.truth().mode, Px4::Mission);
    let wild = sticks(101, 0, 50);
    assert_eq!(rig.carry_out(wild), Some(AckType::Refused));
}

/// The vehicle holds already while the last HEARTBEAT still shows the steering before: steering is entered again, not only
/// acknowledged.
#[test]
fn steering_right_after_a_hold_is_entered() {
    for wait_s in [0.0, 0.05, 0.1, 0.2, 0.4, 0.8, 1.2] {
        let mut rig = Rig::ready();
        rig.take_off(30.0);
        let mut east = steer();
        east.heading_command_type = Some(HeadingCommandType::Course);
        east.commanded_course = Some(Bam16::from_degrees(90.0));
        east.commanded_speed = Some(Scaled::saturating_from_si(4.0));
        rig.done(east.clone());
        rig.run(3.0);
        rig.send(orders::mode(Mode::Loiter));
        assert!(rig.until(5.0, |rig| rig.truth().mode == Px4::Loiter));
        rig.run(wait_s);
        assert_eq!(
            rig.carry_out(east),
            Some(AckType::CarriedOut),
            "{wait_s} s: {:?}",
            rig.station().alerts()
        );
        rig.run(8.0);
        let truth = rig.truth();
        assert_eq!(truth.mode, Px4::Offboard, "{wait_s} s");
        assert!(
            (truth.velocity.e - 4.0).abs() < 0.5,
            "{wait_s} s: {truth:?}"
        );
    }
}

/// A hold that carries a speed, commanded before the route that was just accepted is shown: the hold is flown, not only its
/// speed.
#[test]
fn a_hold_with_a_speed_right_after_a_route_is_a_hold() {
    for wait_s in [0.0, 0.05, 0.1, 0.3] {
        let mut rig = Rig::ready();
        rig.send_plan(orders::square());
        rig.done(orders::load());
        rig.take_off(20.0);
        rig.send(orders::mode(Mode::Waypoint));
        assert!(rig.until(5.0, |rig| rig.truth().mode == Px4::Mission));
        rig.run(wait_s);
        let mut hold = orders::mode(Mode::Loiter);
        hold.commanded_speed = Some(Scaled::saturating_from_si(5.0));
        assert_eq!(rig.carry_out(hold), Some(AckType::CarriedOut), "{wait_s} s");
        rig.run(3.0);
        assert_eq!(rig.truth().mode, Px4::Loiter, "{wait_s} s");
    }
}

/// As above, for a route and for sticks.
#[test]
fn a_route_and_manual_flight_right_after_a_hold_are_entered() {
    for wait_s in [0.0, 0.1, 0.4, 0.8] {
        let mut rig = Rig::ready();
        rig.send_plan(orders::square());
        rig.done(orders::load());
        rig.take_off(20.0);
        let route = || orders::mode(Mode::Waypoint);
        rig.done(route());
        rig.run(2.0);
        rig.send(orders::mode(Mode::Loiter));
        assert!(rig.until(5.0, |rig| rig.truth().mode == Px4::Loiter));
        rig.run(wait_s);
        rig.done(route());
        rig.run(2.0);
        assert_eq!(rig.truth().mode, Px4::Mission, "{wait_s} s");

        let centred = sticks(0, 0, 50);
        let by_hand = || orders::mode(Mode::FlightDirector);
        fly(&mut rig, 0.5, &centred);
        let entered = command_while(&mut rig, &centred, by_hand());
        assert_eq!(entered, Some(AckType::CarriedOut));
        rig.send(orders::mode(Mode::Loiter));
        assert!(rig.until(5.0, |rig| rig.truth().mode == Px4::Loiter));
        rig.run(wait_s);
        fly(&mut rig, 0.2, &centred);
        let entered = command_while(&mut rig, &centred, by_hand());
        assert_eq!(entered, Some(AckType::CarriedOut), "{wait_s} s");
        fly(&mut rig, 3.0, &sticks(100, 0, 50));
        assert_eq!(rig.truth().mode, Px4::PosCtl, "{wait_s} s");
        assert!(!rig.station().has_alert("have stopped"), "{wait_s} s");
    }
}

/// Flown forward by hand, 20 m up, with a route aboard.
fn by_hand() -> Rig {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    let forward = sticks(60, 0, 50);
    fly(&mut rig, 0.5, &forward);
    let entered = command_while(&mut rig, &forward, orders::mode(Mode::FlightDirector));
    assert_eq!(entered, Some(AckType::CarriedOut));
    fly(&mut rig, 2.0, &forward);
    rig
}

/// PX4 misses sticks that have come once in every mode, and returns for want of them.
#[test]
fn a_mode_that_ends_the_sticks_is_still_flown_when_the_vehicle_has_missed_them() {
    let (latitude, longitude) = orders::place(40.0, 0.0);
    let there = VehicleOperatingModeCommand {
        loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
        loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
        ..orders::mode(Mode::Loiter)
    };
    let slowly = VehicleOperatingModeCommand {
        commanded_speed: Some(Scaled::saturating_from_si(2.0)),
        ..steer()
    };
    for (command, flown) in [
        (orders::mode(Mode::Loiter), Px4::Loiter),
        (there, Px4::Loiter),
        (orders::mode(Mode::Waypoint), Px4::Mission),
        (slowly, Px4::Offboard),
    ] {
        for they_continue in [true, false] {
            let mut rig = by_hand();
            let held = sticks(60, 0, 50);
            let end = if they_continue {
                command_while(&mut rig, &held, command.clone())
            } else {
                rig.carry_out(command.clone())
            };
            let alerts = rig.station().alerts();
            assert_eq!(end, Some(AckType::CarriedOut), "{alerts:?}");
            let seconds = if they_continue { 12.0 } else { 0.0 };
            fly(&mut rig, seconds, &held);
            rig.run(12.0 - seconds);
            let alerts = rig.station().alerts();
            assert_eq!(rig.truth().mode, flown, "{they_continue}: {alerts:?}");
        }
    }
}

/// It is no failsafe in a landing. The climb out of it would be one.
#[test]
fn a_mode_after_a_landing_that_ended_the_sticks_is_flown_too() {
    let mut rig = by_hand();
    rig.done(orders::mode(Mode::ContingencyB));
    rig.run(3.0);
    assert_eq!(rig.truth().mode, Px4::Land);
    rig.done(orders::mode(Mode::AutolandWaveOff));
    rig.run(8.0);
    let alerts = rig.station().alerts();
    assert_eq!(rig.truth().mode, Px4::Loiter, "{alerts:?}");
    // From then on no mode waits for that.
    let begun = rig.clock.elapsed();
    rig.done(orders::mode(Mode::ContingencyB));
    assert!((rig.clock.elapsed() - begun).as_secs_f64() < 0.9);
}

/// A pilot lets go of the sticks as they command a hold, and PX4 takes sticks that move for a pilot who wants the vehicle.
#[test]
fn sticks_that_move_as_another_mode_is_commanded_do_not_take_the_vehicle_back() {
    // From full forward to full backward within a second, and a fifth of it.
    for every_s in [0.1, 0.02] {
        let mut rig = by_hand();
        let mut hold = None;
        for (step, forward) in (-5..=5_i8).rev().enumerate() {
            if step == 5 {
                hold = Some(rig.send(orders::mode(Mode::Loiter)));
            }
            rig.send_once(sticks(20 * forward, 0, 50));
            rig.run(every_s);
        }
        let end = rig.end(hold.expect("commanded"));
        assert_eq!(end, Some(AckType::CarriedOut));
        rig.run(8.0);
        let alerts = rig.station().alerts();
        assert_eq!(rig.truth().mode, Px4::Loiter, "{every_s}: {alerts:?}");
        assert!(!rig.station().has_alert("took over"), "{alerts:?}");
    }
}

/// A hold at the fence is not left for the loss of sticks that still come.
#[test]
fn a_failsafe_that_takes_the_vehicle_from_the_sticks_keeps_it_while_they_come() {
    for they_continue in [true, false] {
        let mut rig = Rig::ready_with(Setup {
            vehicles: vec![px4_sim::Config {
                params: vec![(px4_sim::Param::GF_MAX_HOR_DIST, 40.0)],
                ..px4_sim::Config::default()
            }],
            ..Setup::default()
        });
        rig.take_off(20.0);
        let centred = sticks(0, 0, 50);
        fly(&mut rig, 0.5, &centred);
        let entered = command_while(&mut rig, &centred, orders::mode(Mode::FlightDirector));
        assert_eq!(entered, Some(AckType::CarriedOut));
        fly(&mut rig, 12.0, &sticks(100, 0, 50));
        assert_eq!(rig.truth().mode, Px4::Loiter);
        let alerts = rig.station().alerts();
        let steers = "the sticks (2010) do not steer";
        let named = alerts.iter().filter(|alert| alert.contains(steers));
        assert_eq!(named.count(), 1, "{alerts:?}");
        if they_continue {
            // Whatever they are.
            for forward in [100, 50, 0, -50, -100] {
                fly(&mut rig, 2.0, &sticks(forward, 0, 50));
            }
            assert_eq!(rig.truth().mode, Px4::Loiter);
            assert!(!rig.station().has_alert("took over"), "{alerts:?}");
            // The operator's mode is flown, and no loss follows it.
            let forward = sticks(100, 0, 50);
            let held = command_while(&mut rig, &forward, orders::mode(Mode::Loiter));
            assert_eq!(held, Some(AckType::CarriedOut));
            fly(&mut rig, 12.0, &forward);
            assert_eq!(rig.truth().mode, Px4::Loiter);
        } else {
            assert!(rig.until(10.0, |rig| rig.truth().mode == Px4::Rtl));
            assert!(rig.station().has_alert("have stopped"));
        }
    }
}

/// A hold at the fence is not left for the loss of set points, of which PX4 keeps the mode. Where it holds for want of them too it gets none.
#[test]
fn a_failsafe_that_takes_a_steered_vehicle_keeps_it() {
    for (without, come) in [(0.0, true), (3.0, true), (5.0, false)] {
        let mut rig = Rig::ready_with(Setup {
            vehicles: vec![px4_sim::Config {
                params: vec![
                    (px4_sim::Param::GF_MAX_HOR_DIST, 40.0),
                    (px4_sim::Param::COM_OBL_RC_ACT, without),
                ],
                ..px4_sim::Config::default()
            }],
            ..Setup::default()
        });
        rig.take_off(20.0);
        let to = |degrees| VehicleOperatingModeCommand {
            heading_command_type: Some(HeadingCommandType::Course),
            commanded_course: Some(Bam16::from_degrees(degrees)),
            commanded_speed: Some(Scaled::saturating_from_si(4.0)),
            ..steer()
        };
        rig.done(to(90.0));
        assert!(rig.until(30.0, |rig| rig.truth().mode == Px4::Loiter));
        for _ in 0..60 {
            rig.run(1.0);
            assert_eq!(rig.truth().mode, Px4::Loiter, "{without}");
        }
        assert_eq!(rig.station().has_alert("set points stand still"), come);
        rig.done(to(270.0));
        assert_eq!(rig.truth().mode, Px4::Offboard);
        rig.run(8.0);
        assert!(rig.truth().position.e < 30.0, "{:?}", rig.truth());
        assert!(!rig.station().has_alert("in OFFBOARD again"));
    }
}

/// PX4 arms when the left stick is in its lower right corner for a second.
#[test]
fn sticks_start_no_motors() {
    let mut rig = Rig::ready();
    let corner = UaStickCommand {
        rotational_stick_rudder: Some(100),
        ..sticks(0, 0, 0)
    };
    fly(&mut rig, 0.5, &corner);
    let entered = command_while(&mut rig, &corner, orders::mode(Mode::FlightDirector));
    assert_eq!(entered, Some(AckType::CarriedOut));
    for _ in 0..30 {
        fly(&mut rig, 0.1, &corner);
        assert!(!rig.truth().armed);
    }
}

#[test]
fn manual_flight_is_refused_where_its_end_would_be_that_of_the_flight() {
    let mut rig = Rig::ready_with(Setup {
        vehicles: vec![px4_sim::Config {
            params: vec![(px4_sim::Param::NAV_RCL_ACT, 5.0)],
            ..px4_sim::Config::default()
        }],
        ..Setup::default()
    });
    rig.take_off(20.0);
    let centred = sticks(0, 0, 50);
    fly(&mut rig, 0.5, &centred);
    let refused = command_while(&mut rig, &centred, orders::mode(Mode::FlightDirector));
    assert_eq!(refused, Some(AckType::Refused));
    assert!(rig.station().has_alert("NAV_RCL_ACT is 5 (terminate)"));
    fly(&mut rig, 2.0, &centred);
    rig.run(2.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
}

/// PX4 has left the mode for want of set points, and new ones would lead it back.
#[test]
fn steering_that_a_stop_of_the_bridge_has_ended_is_not_resumed() {
    for timers_first in [true, false] {
        let mut rig = Rig::ready();
        rig.take_off(30.0);
        let mut east = steer();
        east.heading_command_type = Some(HeadingCommandType::Course);
        east.commanded_course = Some(Bam16::from_degrees(90.0));
        rig.done(east.clone());
        rig.run(3.0);
        rig.suspend_bridge(3.0, timers_first);
        assert_ne!(rig.truth().mode, Px4::Offboard);
        // Within the first second the vehicle shows its mode by something that has not waited. After five it is no repetition.
        assert!(!rig.until(5.0, |rig| rig.truth().mode == Px4::Offboard));
        let entered = rig.carry_out(east);
        let alerts = rig.station().alerts();
        assert_eq!(entered, Some(AckType::CarriedOut), "{alerts:?}");
    }
}

#[test]
fn steering_holds_course_speed_altitude_and_turns() {
    let mut rig = Rig::ready();
    rig.take_off(30.0);
    let mut east = steer();
    east.heading_command_type = Some(HeadingCommandType::Course);
    east.commanded_course = Some(Bam16::from_degrees(90.0));
    east.commanded_speed = Some(Scaled::saturating_from_si(4.0));
    rig.done(east);
    assert_eq!(rig.truth().mode, Px4::Offboard);
    rig.run(15.0);
    let truth = rig.truth();
    assert!((truth.velocity.e - 4.0).abs() < 0.3, "{truth:?}");
    assert!(truth.velocity.n.abs() < 0.3, "{truth:?}");
    assert!((-truth.position.d - 30.0).abs() < 1.5, "{truth:?}");

    // An altitude alone: course and speed stay.
    let mut climb = steer();
    climb.altitude_command_type = Some(AltitudeCommandType::Altitude);
    climb.commanded_altitude = Some(Scaled::saturating_from_si(45.0));
    climb.altitude_type = Some(AltitudeType::Agl);
    rig.done(climb);
    rig.run(25.0);
    let truth = rig.truth();
    assert!((-truth.position.d - 45.0).abs() < 1.0, "{truth:?}");
    assert!((truth.velocity.e - 4.0).abs() < 0.3, "{truth:?}");

    // A quarter turn a bit over 5 s, clockwise: from east to south.
    let mut turn = steer();
    turn.heading_command_type = Some(HeadingCommandType::TurnRate);
    turn.commanded_turn_rate = Some(Scaled::saturating_from_si(0.3));
    rig.done(turn);
    assert!(
        rig.until(8.0, |rig| rig.truth().velocity.n < -3.0),
        "{:?}",
        rig.truth()
    );

    // Nose and track apart, and down at a rate.
    let mut apart = steer();
    apart.heading_command_type = Some(HeadingCommandType::HeadingAndCourse);
    apart.commanded_heading = Some(Bam16::from_degrees(0.0));
    apart.commanded_course = Some(Bam16::from_degrees(270.0));
    apart.altitude_command_type = Some(AltitudeCommandType::VerticalSpeed);
    apart.commanded_vertical_speed = Some(Scaled::saturating_from_si(-1.0));
    rig.done(apart);
    rig.run(14.0);
    let truth = rig.truth();
    assert!((truth.velocity.e + 4.0).abs() < 0.8, "{truth:?}");
    assert!((truth.velocity.d - 1.0).abs() < 0.3, "{truth:?}");
    assert!(
        truth.attitude[2].sin().abs() < 0.1 && truth.attitude[2].cos() > 0.0,
        "{truth:?}"
    );

    // It ends with the next mode, and no loss of set points is seen on the way.
    rig.done(orders::mode(Mode::Loiter));
    rig.run(15.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
    assert!(
        !rig.station().has_alert("Failsafe"),
        "{:?}",
        rig.station().alerts()
    );
}

#[test]
fn set_points_do_not_starve_while_the_ground_station_is_silent_or_the_link_is_bad() {
    let mut rig = Rig::ready();
    rig.take_off(30.0);
    let mut north = steer();
    north.commanded_speed = Some(Scaled::saturating_from_si(2.0));
    rig.done(north);
    rig.mav.faults = Faults::lossy(0.3);
    rig.run(60.0);
    assert_eq!(
        rig.truth().mode,
        Px4::Offboard,
        "{:?}",
        rig.station().alerts()
    );
    // The bridge gone, they end: the vehicle returns by itself.
    rig.mav.faults = Faults::NONE;
    rig.stop_bridge();
    assert!(rig.until(15.0, |rig| rig.truth().mode == Px4::Rtl));
}

#[test]
fn steering_that_cannot_be_flown_is_refused_with_the_reason() {
    let mut rig = Rig::ready();
    assert_eq!(rig.carry_out(steer()), Some(AckType::Refused));
    assert!(rig.station().has_alert("needs an airborne vehicle"));
    rig.take_off(20.0);
    let mut roll = steer();
    roll.heading_command_type = Some(HeadingCommandType::Roll);
    assert_eq!(rig.carry_out(roll), Some(AckType::Refused));
    let mut nowhere = steer();
    nowhere.heading_command_type = Some(HeadingCommandType::Course);
    assert_eq!(rig.carry_out(nowhere), Some(AckType::Refused));
    assert!(rig.station().has_alert("Commanded Course is missing"));
    assert_ne!(rig.truth().mode, Px4::Offboard);
}

#[test]
fn engines_start_and_stop_by_the_vehicles_rules() {
    let mut rig = Rig::ready_with(Setup::default());
    let engine = |wanted| EngineCommand {
        engine_command: Some(wanted),
        ..EngineCommand::default()
    };
    rig.done(engine(CommandedEngineState::Start));
    assert!(rig.truth().armed && rig.truth().landed);
    rig.done(engine(CommandedEngineState::Stop));
    assert!(!rig.truth().armed);
    rig.take_off(15.0);
    assert_eq!(
        rig.carry_out(engine(CommandedEngineState::Stop)),
        Some(AckType::Refused)
    );
    assert!(rig.truth().armed, "it flies");
    assert!(
        rig.station()
            .has_alert("disarming: the vehicle answered: temporarily rejected")
    );
    let mut fifth = engine(CommandedEngineState::Start);
    fifth.engine_number = Some(5);
    assert_eq!(rig.carry_out(fifth), Some(AckType::Refused));

    let lights = UnmannedAircraftLights {
        set_lights: Some(LightsBitmap::NAV),
        ..UnmannedAircraftLights::default()
    };
    assert_eq!(rig.carry_out(lights), Some(AckType::Refused));
    assert!(rig.station().has_alert("no command for lights"));
}
