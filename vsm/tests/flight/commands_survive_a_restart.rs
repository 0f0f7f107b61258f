//! What was commanded before `kill -9` is known after it: a repetition is answered and not carried out again, and what
//! was cut off is reported, and not resumed.

use kit::bridge::{Rig, Setup, orders, vehicle_id};
use stanag_msgs::enums::{
    AckType, FlightPathControlMode as Mode, MissionPlanMode, MissionTransferStatus, RequestedAccess,
};
use stanag_msgs::messages::CucsAuthorisationRequest;
use stanag_msgs::{Message, Text};

const DONE: Option<AckType> = Some(AckType::CarriedOut);

/// The answers to the very bytes of a message, sent once more.
fn answers_again(rig: &mut Rig, ticket: kit::bridge::Ticket) -> Vec<AckType> {
    let before = rig.station().answers(ticket).len();
    rig.stations[0].repeat(ticket);
    rig.run(3.0);
    rig.station().answers(ticket)[before..].to_vec()
}

#[test]
fn a_mode_replayed_after_a_restart_is_answered_and_not_flown() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    let hold = rig.send(orders::mode(Mode::Loiter));
    assert_eq!(rig.end(hold), DONE);
    rig.done(orders::mode(Mode::Waypoint));
    rig.restart_bridge();
    rig.run(2.0);
    assert_eq!(answers_again(&mut rig, hold), [AckType::CarriedOut]);
    assert_eq!(rig.truth().mode, px4_sim::Mode::Mission, "it flies on");
}

#[test]
fn a_refused_command_and_a_clear_replayed_after_a_restart_do_nothing() {
    let mut rig = Rig::ready();
    let early = rig.send(orders::mode(Mode::Waypoint));
    assert_eq!(rig.end(early), Some(AckType::Refused));
    let clear = rig.send(orders::transfer(MissionPlanMode::Clear));
    assert_eq!(rig.end(clear), DONE);
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.restart_bridge();
    rig.run(2.0);
    let plans = rig.vehicles[0].vehicle().counters().plans_stored;
    assert_eq!(answers_again(&mut rig, early), [AckType::Refused]);
    assert_eq!(answers_again(&mut rig, clear), [AckType::CarriedOut]);
    assert_ne!(rig.truth().mode, px4_sim::Mode::Mission);
    assert_eq!(rig.vehicles[0].vehicle().counters().plans_stored, plans);
    rig.done(orders::mode(Mode::Waypoint));
}

#[test]
fn a_release_and_a_request_replayed_after_a_restart_move_no_right() {
    let mut rig = Rig::ready();
    let release = CucsAuthorisationRequest {
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..orders::request_control()
    };
    let release = rig.send(release);
    assert_eq!(rig.end(release), DONE);
    rig.done(orders::request_control());
    rig.restart_bridge();
    rig.run(2.0);
    answers_again(&mut rig, release);
    rig.done(orders::mode(Mode::Loiter));
}

#[test]
fn a_launch_that_a_restart_interrupts_is_reported_and_leaves_no_running_motors() {
    let mut rig = Rig::ready();
    let launch = rig.send(orders::launch(20.0));
    assert!(rig.until(3.0, |rig| rig.truth().armed));
    rig.stations[0].give_up(launch);
    rig.restart_bridge();
    assert!(
        rig.until(5.0, |rig| !rig.truth().armed),
        "{:?}",
        rig.station().alerts()
    );
    rig.run(0.5);
    assert_eq!(rig.station().end(launch), Some(AckType::Refused));
    for text in [
        "the VSM restarted while",
        "left the vehicle armed on the ground",
    ] {
        assert!(
            rig.station().has_alert(text),
            "{text}: {:?}",
            rig.station().alerts()
        );
    }
    // It is not resumed, nor does a repetition launch.
    assert_eq!(answers_again(&mut rig, launch), [AckType::Refused]);
    assert!(rig.truth().landed && !rig.truth().armed);
    rig.take_off(20.0);
}

#[test]
fn a_launch_that_took_the_vehicle_up_before_the_restart_is_reported_and_continues() {
    let mut rig = Rig::ready();
    let launch = rig.send(orders::launch(20.0));
    // Off the ground, and the VSM does not know it yet.
    assert!(rig.until(20.0, |rig| !rig.truth().landed));
    assert_eq!(rig.station().end(launch), None, "too late for this test");
    rig.stations[0].give_up(launch);
    rig.restart_bridge();
    assert!(
        rig.until(8.0, |rig| rig
            .station()
            .has_alert("has taken the vehicle up")),
        "{:?}",
        rig.station().alerts()
    );
    assert!(rig.until(30.0, |rig| -rig.truth().position.d > 19.0));
    assert!(rig.truth().armed);
}

#[test]
fn an_upload_that_a_restart_interrupts_is_reported_and_can_be_repeated() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    let load = rig.send(orders::load());
    rig.run(0.05);
    assert_eq!(rig.station().end(load), None, "too late for this test");
    rig.restart_bridge();
    assert_eq!(rig.end(load), Some(AckType::Refused));
    assert!(
        rig.station()
            .has_alert("13000 (Mission Transfer Command) refused: the VSM restarted")
    );
    assert_load_aborted(&rig);
    // PX4 waits 5 s for the rest of the one that was cut off.
    rig.run(6.0);
    rig.done(orders::load());
}

/// The last 14000 names the load, and that it is aborted.
fn assert_load_aborted(rig: &Rig) {
    let last = rig
        .station()
        .last(vehicle_id(0), 14000, |message| match message {
            Message::MissionUploadDownloadStatus(report) => Some(report.clone()),
            _ => None,
        });
    let last = last.expect("a 14000");
    assert_eq!(last.status, Some(MissionTransferStatus::Aborted));
    assert_eq!(last.mission_plan_mode, Some(MissionPlanMode::Load));
    assert_eq!(last.mission_id, Some(Text::new("M1")));
}

/// A station that acknowledges nothing has proved no address, so after the restart none is known before its next message.
#[test]
fn an_upload_that_a_restart_interrupts_is_reported_to_a_station_that_comes_later() {
    let mut rig = Rig::new(Setup::default());
    rig.stations[0].acknowledges = false;
    rig.run(9.0);
    rig.done(orders::request_control());
    rig.send_plan(orders::square());
    let load = rig.send(orders::load());
    rig.run(0.05);
    assert_eq!(rig.station().end(load), None, "too late for this test");
    rig.restart_bridge();
    assert_eq!(rig.end(load), Some(AckType::Refused));
    rig.run(0.1);
    assert_load_aborted(&rig);
}

/// What was sent to its proved address from before the restart has reached nobody.
#[test]
fn an_upload_that_a_restart_interrupts_is_reported_to_a_station_that_returns_on_another_port() {
    let mut rig = Rig::ready();
    rig.stations[0].heartbeats = true;
    rig.send_plan(orders::square());
    let load = rig.send(orders::load());
    rig.run(0.05);
    assert_eq!(rig.station().end(load), None, "too late for this test");
    rig.stop_bridge();
    rig.stations[0].address.set_port(41_234);
    rig.start_bridge();
    rig.run(5.0);
    assert_eq!(rig.station().end(load), Some(AckType::Refused));
    assert!(
        rig.station()
            .has_alert("13000 (Mission Transfer Command) refused: the VSM restarted")
    );
    assert_load_aborted(&rig);
}

#[test]
fn a_command_that_cannot_be_logged_is_carried_out_and_that_is_reported() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    rig.store.full = Some("commands");
    rig.done(orders::mode(Mode::Loiter));
    assert!(rig.station().has_alert("commands cannot be logged"));
    rig.store.full = None;
    rig.done(orders::mode(Mode::Loiter));
    rig.run(0.5);
    assert!(rig.station().has_alert("commands are logged again"));
}

#[test]
fn the_record_of_commands_is_bounded_and_sticks_take_no_room_in_it() {
    let mut rig = Rig::ready();
    let hold = rig.send(orders::mode(Mode::AutolandWaveOff));
    assert_eq!(rig.end(hold), Some(AckType::Refused));
    // More sticks than are remembered of one kind of message, and some commands.
    for n in 0..1_500 {
        let sticks = stanag_msgs::messages::UaStickCommand::default();
        rig.send_once(Message::from(sticks));
        if n % 10 == 0 {
            rig.send_once(orders::waypoint(200, 0, f64::from(n), 0.0, 20.0));
        }
        rig.run(0.01);
    }
    let command_log = &rig.store.records["commands-1b0000a0.log"];
    assert!(command_log.len() < 4_096 * 90, "{}", command_log.len());
    rig.restart_bridge();
    rig.run(2.0);
    assert_eq!(answers_again(&mut rig, hold), [AckType::Refused]);
}
