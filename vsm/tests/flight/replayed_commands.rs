//! A recorded command is not carried out again: not after any amount of other traffic, not after a restart, and not
//! where its station's clock was set. What commands needs a Time Stamp, and comes in time.

use kit::bridge::{Rig, orders, vehicle_id};
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, RequestedAccess};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, Heartbeat, UaPositionWaypoint, UaStickCommand,
    VehicleOperatingModeCommand,
};
use stanag_msgs::{Envelope, MAX_DATAGRAM, Message, TimeStamp};

const DONE: Option<AckType> = Some(AckType::CarriedOut);
const NO: Option<AckType> = Some(AckType::Refused);

/// So many later commands: more than are remembered.
fn push_out(rig: &mut Rig, commands: u16) {
    for first in (0..commands).step_by(30) {
        let numbers = first..commands.min(first + 30);
        let waypoints =
            numbers.map(|n| orders::waypoint(n % 3_000 + 200, 0, 1.0, 0.0, 20.0).into());
        rig.send_plan(waypoints.collect());
    }
}

/// The bytes of a launch made now, with an answer requested.
fn recorded_launch(rig: &Rig) -> Vec<u8> {
    let launch = VehicleOperatingModeCommand {
        time_stamp: Some(TimeStamp::from_unix_ms(rig.now().wall.as_millis() as u64)),
        ..orders::launch(20.0)
    };
    encoded(rig, launch)
}

fn encoded(rig: &Rig, message: impl Into<Message>) -> Vec<u8> {
    let envelope = Envelope::new(rig.station().id, vehicle_id(0)).requesting_ack();
    let mut bytes = [0; MAX_DATAGRAM];
    let length = message.into().encode(&envelope, &mut bytes).unwrap();
    bytes[..length].to_vec()
}

fn fly_and_land(rig: &mut Rig) -> Vec<u8> {
    let launch = recorded_launch(rig);
    rig.deliver_from_station(&launch);
    assert!(rig.until(30.0, |rig| !rig.truth().landed));
    rig.run(15.0);
    rig.done(orders::mode(Mode::AutolandEngage));
    assert!(rig.until(90.0, |rig| rig.truth().landed && !rig.truth().armed));
    launch
}

fn replays_in_vain(rig: &mut Rig, launch: &[u8]) {
    rig.deliver_from_station(launch);
    rig.run(8.0);
    assert!(!rig.truth().armed && rig.truth().landed, "it flies again");
}

/// Lets a message without a stamp arrive.
fn deliver(rig: &mut Rig, message: impl Into<Message>) {
    let bytes = encoded(rig, message);
    rig.deliver_from_station(&bytes);
    rig.run(0.2);
}

#[test]
fn a_recorded_launch_is_refused_after_any_number_of_later_commands_and_restarts() {
    let mut rig = Rig::ready();
    let launch = fly_and_land(&mut rig);
    replays_in_vain(&mut rig, &launch);
    push_out(&mut rig, 1_100);
    replays_in_vain(&mut rig, &launch);
    // What is older than any retransmission makes room.
    rig.run(70.0);
    push_out(&mut rig, 1_100);
    replays_in_vain(&mut rig, &launch);
    assert!(rig.station().has_alert("Time Stamp already used"));
    rig.restart_bridge();
    rig.run(2.0);
    replays_in_vain(&mut rig, &launch);
    push_out(&mut rig, 1_100);
    replays_in_vain(&mut rig, &launch);
    rig.take_off(20.0);
}

#[test]
fn what_commands_and_has_no_time_stamp_is_refused_with_the_reason() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Loiter));
    let before = rig.truth().mode;
    let request = CucsAuthorisationRequest {
        requested_handover_access: Some(RequestedAccess::Override),
        ..orders::request_control()
    };
    let commands: [Message; 6] = [
        orders::mode(Mode::AutolandEngage).into(),
        orders::load().into(),
        orders::route(101).into(),
        orders::waypoint(101, 0, 80.0, 0.0, 20.0).into(),
        request.into(),
        UaStickCommand::default().into(),
    ];
    for message in commands {
        let text = format!("{} (", message.id());
        deliver(&mut rig, message);
        let alerts = rig.station().alerts();
        let named = |alert: &String| alert.contains(&text) && alert.contains("Time Stamp");
        assert!(alerts.iter().any(named), "{text}: {alerts:?}");
    }
    rig.run(2.0);
    assert_eq!(rig.truth().mode, before);
    // A question and a release are granted as ever.
    let release = CucsAuthorisationRequest {
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..orders::request_control()
    };
    deliver(&mut rig, release);
    assert_eq!(rig.carry_out(orders::mode(Mode::Loiter)), NO);
}

#[test]
fn recorded_sticks_fly_nothing() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let sticks = |rig: &Rig, ago_s: u64, forward| {
        let at = rig.now().wall - std::time::Duration::from_secs(ago_s);
        UaStickCommand {
            time_stamp: Some(TimeStamp::from_unix_ms(at.as_millis() as u64)),
            longitudinal_stick: Some(forward),
            ..UaStickCommand::default()
        }
    };
    let recorded = sticks(&rig, 0, 100);
    let send = |rig: &mut Rig, sticks: &UaStickCommand| {
        rig.stations[0].send_as_is(vehicle_id(0), &sticks.clone().into());
        rig.run(0.05);
    };
    send(&mut rig, &recorded);
    // More of them than are remembered.
    for _ in 0..1_100 {
        let centred = sticks(&rig, 0, 0);
        send(&mut rig, &centred);
    }
    let by_hand = rig.send(orders::mode(Mode::FlightDirector));
    let mut from = rig.truth().position;
    for n in 0..400 {
        let centred = sticks(&rig, 0, 0);
        send(&mut rig, &centred);
        match n {
            0..100 => from = rig.truth().position,
            100..200 => send(&mut rig, &recorded),
            200 => rig.restart_bridge(),
            _ => send(&mut rig, &recorded),
        }
    }
    assert_eq!(rig.station().answers(by_hand).last(), DONE.as_ref());
    let to = rig.truth().position;
    let moved = (to.n - from.n).hypot(to.e - from.e);
    assert!(moved < 5.0, "moved by {moved} m");
}

/// The clock of station 0, set back by so many seconds.
fn set_back(rig: &Rig, by_s: u64) -> Option<TimeStamp> {
    let at = rig.now().wall - std::time::Duration::from_secs(by_s);
    Some(TimeStamp::from_unix_ms(at.as_millis() as u64))
}

#[test]
fn sticks_of_a_clock_that_was_set_back_fly_again_in_seconds_and_their_refusal_is_raised() {
    // Within what may be late, and beyond it: both into times that were flown before.
    for back_s in [30, 80] {
        let mut rig = Rig::ready();
        rig.take_off(20.0);
        let fly = |rig: &mut Rig, seconds: u32, back_s: u64, forward| {
            for n in 0..seconds * 20 {
                let sticks = UaStickCommand {
                    time_stamp: set_back(rig, back_s),
                    longitudinal_stick: Some(forward),
                    ..UaStickCommand::default()
                };
                rig.stations[0].send_as_is(vehicle_id(0), &sticks.into());
                if n % 20 == 0 {
                    let beat = Heartbeat {
                        time_stamp: set_back(rig, back_s),
                    };
                    rig.stations[0].send_as_is(vehicle_id(0), &beat.into());
                }
                rig.run(0.05);
            }
        };
        fly(&mut rig, 100, 0, 0);
        assert!(
            !rig.station().has_alert("2010 (UA Stick Command)"),
            "before the step"
        );
        fly(&mut rig, 6, back_s, 100);
        let alerts = rig.station().alerts();
        let named = |alert: &String| {
            alert.contains("2010 (UA Stick Command)") && alert.contains("set back")
        };
        assert!(alerts.iter().any(named), "{back_s} s: {alerts:?}");
        let by_hand = VehicleOperatingModeCommand {
            time_stamp: set_back(&rig, back_s),
            ..orders::mode(Mode::FlightDirector)
        };
        rig.stations[0].send_as_is(vehicle_id(0), &by_hand.into());
        let from = rig.truth().position;
        fly(&mut rig, 6, back_s, 100);
        let to = rig.truth().position;
        let moved = (to.n - from.n).hypot(to.e - from.e);
        assert!(
            moved > 5.0,
            "{back_s} s: {moved} m, {:?}",
            rig.station().alerts()
        );
    }
}

#[test]
fn a_station_whose_stamps_do_not_rise_is_refused_with_that_reason_and_accepted_once_they_do() {
    let mut rig = Rig::ready();
    rig.take_off(20.0);
    let first = set_back(&rig, 0).unwrap();
    let hold = |rig: &mut Rig, ms: u64, name: u16| {
        // Each is another message.
        let command = orders::waypoint(name, 0, 80.0, 0.0, 20.0);
        let command = UaPositionWaypoint {
            time_stamp: Some(TimeStamp(first.0 + ms)),
            ..command
        };
        deliver(rig, command);
    };
    for n in 0..90 {
        hold(&mut rig, 0, 300 + n);
        rig.run(0.8);
    }
    let reason = "have not increased";
    assert!(
        rig.station().has_alert(reason),
        "{:?}",
        rig.station().alerts()
    );
    let wrong = |alert: &String| alert.contains("s behind the clock");
    assert!(!rig.station().alerts().iter().any(wrong));
    // From where they stood they count on, in a time long past.
    for n in 0..10 {
        hold(&mut rig, 1_000 * u64::from(n) + 1, 400 + n);
        rig.run(0.8);
    }
    let before = rig.station().alerts().len();
    hold(&mut rig, 12_000, 500);
    let alerts = rig.station().alerts().split_off(before);
    assert!(
        !alerts.iter().any(|alert| alert.contains("refused")),
        "{alerts:?}"
    );
}
