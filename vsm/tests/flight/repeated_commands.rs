//! A station that sends its 2016 again and again, each time with a new Time Stamp: it is one command, which is carried out once, and
//! does not take the vehicle back from a pilot or a failsafe.

use kit::bridge::{Rig, Setup, orders};
use mavlink_link::dialect::MavCmd;
use mavlink_link::service::{Node, command};
use px4_sim::{Airframe, Config, Mode as Px4};
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, HeadingCommandType, LoiterType};
use stanag_msgs::messages::{LoiterConfiguration, VehicleOperatingModeCommand};
use stanag_msgs::{Bam16, Scaled};

use super::loss_action::radio;

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

/// The hold of a station that sends it once a second, and the steering of one that sends another heading ten times a second.
fn streams(tenth: u32, steers: bool) -> Option<VehicleOperatingModeCommand> {
    if steers {
        return Some(VehicleOperatingModeCommand {
            heading_command_type: Some(HeadingCommandType::Heading),
            commanded_heading: Some(Bam16::from_degrees(f64::from(tenth))),
            ..orders::mode(Mode::Autopilot)
        });
    }
    tenth.is_multiple_of(10).then(|| orders::mode(Mode::Loiter))
}

/// A command while a pilot has sticks, and how it ends.
fn command_beside_a_pilot(rig: &mut Rig, command: VehicleOperatingModeCommand) -> Option<AckType> {
    let ticket = rig.send(command);
    for _ in 0..100 {
        radio(rig, false);
        rig.run(0.1);
        if let Some(end) = rig.station().end(ticket) {
            return Some(end);
        }
    }
    None
}

#[test]
fn a_pilot_keeps_the_vehicle_from_a_station_that_repeats_its_mode() {
    for (steers, flown) in [(false, Px4::Loiter), (true, Px4::Offboard)] {
        for paused in [true, false] {
            let mut rig = ready();
            let mut tenths = 0..;
            let mut send = |rig: &mut Rig| {
                let tenth = tenths.next().expect("without end");
                if let Some(command) = streams(tenth, steers) {
                    rig.send_once(command);
                }
            };
            for _ in 0..50 {
                send(&mut rig);
                rig.run(0.1);
            }
            assert_eq!(rig.truth().mode, flown);
            // The pilot's switch comes at some moment between two of them.
            for step in 0..103 {
                send(&mut rig);
                radio(&mut rig, step == 7);
                rig.run(0.1);
                if step >= 7 {
                    let alerts = rig.station().alerts();
                    assert_eq!(rig.truth().mode, Px4::PosCtl, "{step}: {alerts:?}");
                }
            }
            let why = "the vehicle is in POSCTL, by its pilot or a failsafe, and this only continues or repeats an earlier command";
            let alerts = rig.station().alerts();
            assert!(rig.station().has_alert(why), "{alerts:?}");
            let again = streams(0, steers).expect("a command");
            let end = command_beside_a_pilot(&mut rig, again.clone());
            assert_eq!(end, Some(AckType::Refused));
            // The operator decides.
            let (decided, flown) = if paused {
                for _ in 0..55 {
                    radio(&mut rig, false);
                    rig.run(0.1);
                }
                (again, flown)
            } else {
                (orders::mode(Mode::ContingencyA), Px4::Rtl)
            };
            let end = command_beside_a_pilot(&mut rig, decided);
            let alerts = rig.station().alerts();
            assert_eq!(
                end,
                Some(AckType::CarriedOut),
                "{steers} {paused} {alerts:?}"
            );
            assert_eq!(rig.truth().mode, flown);
        }
    }
}

/// The radio control of a safety pilot is lost: PX4 holds, and then returns.
#[test]
fn a_failsafe_is_not_ended_by_a_station_that_repeats_its_mode() {
    for paused in [true, false] {
        let mut rig = ready();
        let fly = orders::mode(Mode::Waypoint);
        repeat_until(&mut rig, 1.0, 3.0, &fly, |_| false);
        assert_eq!(rig.truth().mode, Px4::Mission);
        for _ in 0..5 {
            radio(&mut rig, false);
            rig.run(0.1);
        }
        let returns = |rig: &Rig| rig.truth().mode == Px4::Rtl;
        let alerts = |rig: &Rig| rig.station().alerts();
        let returned = repeat_until(&mut rig, 1.0, 15.0, &fly, returns);
        assert!(returned, "{:?} {:?}", rig.truth(), alerts(&rig));
        let left = repeat_until(&mut rig, 1.0, 8.0, &fly, |rig| !returns(rig));
        assert!(!left, "{:?}", alerts(&rig));
        let why = "as its failsafe, and this only continues or repeats an earlier command";
        assert!(rig.station().has_alert(why), "{:?}", alerts(&rig));
        let (decided, flown) = if paused {
            rig.run(5.5);
            (fly, Px4::Mission)
        } else {
            (orders::mode(Mode::Loiter), Px4::Loiter)
        };
        rig.done(decided);
        assert_eq!(rig.truth().mode, flown);
    }
}

/// A pilot lands beside the launch site.
#[test]
fn a_launch_that_is_commanded_again_and_again_starts_no_motors_after_the_landing() {
    let mut rig = Rig::ready();
    let launch = orders::launch(10.0);
    let flies = |rig: &Rig| -rig.truth().position.d > 9.0;
    assert!(repeat_until(&mut rig, 1.0, 60.0, &launch, flies));
    chosen_by_others(&mut rig, LAND);
    let stands = |rig: &Rig| !rig.truth().armed;
    assert!(repeat_until(&mut rig, 1.0, 90.0, &launch, stands));
    let starts = |rig: &Rig| rig.truth().armed;
    assert!(!repeat_until(&mut rig, 1.0, 15.0, &launch, starts));
    let alerts = rig.station().alerts();
    let why = "the vehicle has landed since, and this only continues or repeats";
    assert!(rig.station().has_alert(why), "{alerts:?}");
    // Its station does not know of a restart.
    rig.restart_bridge();
    assert!(!repeat_until(&mut rig, 0.5, 15.0, &launch, starts));
    rig.run(5.5);
    rig.done(launch);
}

/// Sub mode of AUTO.LAND.
const LAND: f32 = 6.0;

/// Another ground station, or a pilot's switch, has chosen a mode of AUTO.
fn chosen_by_others(rig: &mut Rig, sub: f32) {
    let to = Node::new(1, 1);
    let mode = command::long(to, MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 4.0, sub]);
    let by = Node::new(255, 190);
    rig.vehicles[0].vehicle_mut().handle_message(by, &mode);
}

#[test]
fn what_others_have_chosen_stays_though_the_bridge_is_restarted_under_a_stream() {
    for (sub, chosen) in [(LAND, Px4::Land), (5.0, Px4::Rtl), (3.0, Px4::Loiter)] {
        let mut rig = ready();
        let fly = orders::mode(Mode::Waypoint);
        repeat_until(&mut rig, 0.5, 3.0, &fly, |_| false);
        assert_eq!(rig.truth().mode, Px4::Mission);
        chosen_by_others(&mut rig, sub);
        let left = |rig: &Rig| rig.truth().mode != chosen;
        let alerts = |rig: &Rig| rig.station().alerts();
        assert!(!repeat_until(&mut rig, 0.5, 3.0, &fly, left));
        rig.restart_bridge();
        let ended = repeat_until(&mut rig, 0.5, 10.0, &fly, left);
        assert!(!ended, "{chosen:?} {:?}", alerts(&rig));
        let why = "this only continues or repeats an earlier command";
        assert!(rig.station().has_alert(why), "{:?}", alerts(&rig));
        rig.run(5.5);
        rig.done(fly);
        assert_eq!(rig.truth().mode, Px4::Mission);
    }
}

#[test]
fn a_stream_that_nobody_has_ended_flies_on_over_a_restart() {
    let mut rig = ready();
    let fly = orders::mode(Mode::Waypoint);
    let passed = |rig: &Rig| rig.truth().mission_seq >= 2;
    assert!(repeat_until(&mut rig, 0.5, 120.0, &fly, passed));
    rig.restart_bridge();
    let back = |rig: &Rig| rig.truth().mode != Px4::Mission || rig.truth().mission_seq < 2;
    assert!(!repeat_until(&mut rig, 0.5, 10.0, &fly, back));
    // Another mode is an operator's decision, in whatever moment.
    rig.restart_bridge();
    rig.run(1.0);
    rig.done(orders::mode(Mode::Loiter));
}

#[test]
fn a_stream_that_had_ended_before_a_restart_refuses_nothing() {
    let mut rig = ready();
    let fly = orders::mode(Mode::Waypoint);
    rig.done(fly.clone());
    chosen_by_others(&mut rig, 3.0);
    rig.run(10.0);
    rig.restart_bridge();
    rig.run(1.0);
    rig.done(fly);
    assert_eq!(rig.truth().mode, Px4::Mission);
}
