//! Commands whose answers never arrive, and a vehicle that has not reported which mission it holds: what the vehicle shows
//! decides, and where it shows nothing the refusal says so. Seen on PX4 v1.18 over a link that lost and reordered packets.

use kit::bridge::flight::hold_at;
use kit::bridge::{Rig, Setup, orders};
use px4_sim::{Airframe, Config, Mode as Px4};
use stanag_msgs::Scaled;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode};
use stanag_msgs::messages::VehicleOperatingModeCommand;

/// MAVLink ids.
const HEARTBEAT: u32 = 0;
const PING: u32 = 4;
const COMMAND_INT: u32 = 75;
const COMMAND_LONG: u32 = 76;
const COMMAND_ACK: u32 = 77;
const POSITION_TARGET_GLOBAL_INT: u32 = 87;
const TIMESYNC: u32 = 111;
const MISSION_CURRENT: u32 = 42;

#[test]
fn what_the_vehicle_shows_is_carried_out_though_every_answer_is_lost() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.lost = vec![COMMAND_ACK];
    rig.done(orders::launch(20.0));
    assert!(rig.until(60.0, |rig| rig.truth().mode == Px4::Loiter));
    rig.done(orders::mode(Mode::Waypoint));
    assert_eq!(rig.truth().mode, Px4::Mission);
    // A load puts a vehicle on hold that flies its mission.
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.done(hold_at(30.0));
    rig.done(orders::mode(Mode::AutolandEngage));
    assert_eq!(rig.truth().mode, Px4::Land);
}

#[test]
fn what_the_vehicle_does_not_show_is_refused_where_every_answer_is_lost() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Loiter));
    rig.lost = vec![COMMAND_ACK];
    // Of a speed no message of PX4 shows anything but the flight itself.
    let faster = VehicleOperatingModeCommand {
        select_flight_path_control_mode: None,
        commanded_speed: Scaled::from_si(6.0).ok(),
        ..orders::mode(Mode::Loiter)
    };
    assert_eq!(rig.carry_out(faster), Some(AckType::Refused));
    let alerts = rig.station().alerts();
    assert!(
        rig.station().has_alert("no answer from the vehicle"),
        "{alerts:?}"
    );
}

/// What waited in the bridge's socket shows armed motors, as they were a minute ago.
#[test]
fn a_launch_is_not_continued_after_a_long_stop_of_the_bridge() {
    for timers_first in [true, false] {
        let mut rig = Rig::ready();
        let launch = rig.send(orders::launch(20.0));
        assert!(rig.until(20.0, |rig| rig.truth().armed));
        rig.suspend_bridge(70.0, timers_first);
        assert_eq!(rig.end(launch), Some(AckType::Refused));
        let alerts = rig.station().alerts();
        assert!(
            rig.station().has_alert("did not run for over a minute"),
            "{alerts:?}"
        );
        rig.run(15.0);
        let truth = rig.truth();
        assert!(!truth.armed && -truth.position.d < 1.0);
    }
}

#[test]
fn a_command_that_does_not_arrive_is_refused_in_the_mode_that_it_would_lead_to() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Loiter));
    // The altitude is flown in the AUTO.LOITER that the vehicle is in already.
    rig.lost_to_vehicles = vec![COMMAND_INT];
    assert_eq!(rig.carry_out(hold_at(40.0)), Some(AckType::Refused));
    let alerts = rig.station().alerts();
    assert!(
        rig.station().has_alert(
            "reposition: no answer from the vehicle after 6 attempts, and the vehicle does not show"
        ),
        "{alerts:?}"
    );
}

/// The vehicle has taken the command, and then the link is cut.
#[test]
fn a_refusal_that_nothing_of_the_vehicle_shows_says_that_the_command_may_have_been_carried_out() {
    let target = POSITION_TARGET_GLOBAL_INT;
    for lost in [vec![COMMAND_ACK, target], vec![target]] {
        let mut rig = Rig::ready();
        rig.take_off(20.0);
        rig.done(orders::mode(Mode::Loiter));
        rig.lost = lost;
        rig.arrived.clear();
        let ticket = rig.send(hold_at(40.0));
        assert!(rig.until(5.0, |rig| rig.arrived.contains_key(&COMMAND_INT)));
        rig.run(0.5);
        rig.mav.faults.loss = 1.0;
        assert_eq!(rig.end(ticket), Some(AckType::Refused));
        rig.mav.faults.loss = 0.0;
        let alerts = rig.station().alerts().join(" ");
        assert!(alerts.contains("may have been carried out"), "{alerts}");
        assert!(
            rig.until(60.0, |rig| rig.truth().position.d < -25.0),
            "it flies it"
        );
    }
}

#[test]
fn a_mission_that_is_not_reported_yet_is_not_called_another() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    silence(&mut rig);
    assert_eq!(
        rig.carry_out(orders::mode(Mode::Waypoint)),
        Some(AckType::Refused)
    );
    let alerts = rig.station().alerts();
    assert!(
        rig.station()
            .has_alert("has not reported yet which mission it holds"),
        "{alerts:?}"
    );
    assert!(!rig.station().has_alert("no longer holds the loaded route"));
    rig.lost.clear();
    rig.run(1.5);
    rig.done(orders::mode(Mode::Waypoint));
}

#[test]
fn wings_whose_mission_is_not_reported_yet_do_not_land_where_they_are() {
    for airframe in [Airframe::Plane, Airframe::Vtol] {
        let mut rig = Rig::ready_with(Setup {
            vehicles: vec![Config {
                airframe,
                ..Config::default()
            }],
            vehicle_keys: "landing = { course_deg = 90.0, height_m = 40.0 }",
            ..Setup::default()
        });
        rig.send_plan(vec![
            orders::route(1).into(),
            orders::waypoint(1, 2, 300.0, 0.0, 60.0).into(),
            orders::waypoint(2, 0, 600.0, 300.0, 60.0).into(),
        ]);
        rig.done(orders::load());
        rig.take_off(50.0);
        assert!(rig.until(200.0, |rig| rig.truth().mode == Px4::Loiter
            && !rig.truth().landed));
        rig.done(orders::mode(Mode::Waypoint));
        silence(&mut rig);
        for (mode, name) in [
            (Mode::AutolandEngage, "mode 19 (land)"),
            (Mode::AutolandWaveOff, "mode 20 (wave-off)"),
        ] {
            assert_eq!(rig.carry_out(orders::mode(mode)), Some(AckType::Refused));
            let alerts = rig.station().alerts();
            assert!(
                rig.station().has_alert(name)
                    && rig
                        .station()
                        .has_alert("has not reported yet which mission it holds"),
                "{airframe:?}: {alerts:?}"
            );
        }
        assert_eq!(rig.truth().mode, Px4::Mission, "{airframe:?}");
        rig.lost.clear();
        rig.run(1.5);
        rig.done(orders::mode(Mode::AutolandEngage));
        assert_eq!(rig.truth().mode, Px4::Mission, "{airframe:?}: its pattern");
    }
}

/// The link is lost and comes back, and the vehicle has not reported its mission since.
fn silence(rig: &mut Rig) {
    let ups = |rig: &Rig| {
        let alerts = rig.station().alerts();
        let is_up = |alert: &&String| alert.contains("link to the vehicle is up");
        alerts.iter().filter(is_up).count()
    };
    let before = ups(rig);
    rig.mav.faults.loss = 1.0;
    rig.run(5.0);
    rig.lost = vec![MISSION_CURRENT];
    rig.mav.faults.loss = 0.0;
    assert!(rig.until(10.0, |rig| ups(rig) > before));
}

/// Seen on PX4 v1.18: 9.5 s after the link was cut both ways operators read that the vehicle is received.
#[test]
fn a_link_that_is_cut_both_ways_is_silent_and_not_called_received() {
    let received = "is received but receives nothing from us";
    let mut rig = Rig::ready();
    rig.mav.faults.loss = 1.0;
    rig.run(30.0);
    assert!(rig.station().has_alert("no data from the vehicle"));
    assert!(
        !rig.station().has_alert(received),
        "{:?}",
        rig.station().alerts()
    );
    rig.mav.faults.loss = 0.0;
    rig.run(10.0);
    let alerts = rig.station().alerts();
    assert!(!rig.station().has_alert(received), "back: {alerts:?}");
    // One way only, it is.
    rig.lost_to_vehicles = vec![HEARTBEAT, PING, COMMAND_LONG, COMMAND_INT, TIMESYNC];
    rig.run(20.0);
    assert!(
        rig.station().has_alert(received),
        "{:?}",
        rig.station().alerts()
    );
}
