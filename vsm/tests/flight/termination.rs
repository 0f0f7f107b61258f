//! Flight termination (2005): two orders end a flight, and nothing else does. What an attacker can do to them is refused,
//! 3005 and the alerts are true at every moment, and nothing leaves before its entry of the audit log.

use std::time::Duration;

use kit::bridge::{Rig, Setup, cucs, orders, vehicle_id};
use mavlink_link::dialect::MavCmd;
use mavlink_link::service::{Node, command};
use px4_sim::Mode as Px4;
use stanag_msgs::enums::{
    AckType, FlightPathControlMode as Mode, FtMode, FtState, LoiBitmap, RequestedAccess,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, FlightTerminationCommand, PositiveHandoverAuthorisationRequest,
    UaStickCommand,
};
use stanag_msgs::{Envelope, MAX_DATAGRAM, Message, TimeStamp};

const DONE: Option<AckType> = Some(AckType::CarriedOut);
const NO: Option<AckType> = Some(AckType::Refused);
/// MAVLink COMMAND_LONG.
const COMMAND_LONG: u32 = 76;

fn setup(keys: &'static str) -> Setup {
    Setup {
        dli_keys: "provisional = \"all\"",
        vehicle_keys: keys,
        stations: 2,
        ..Setup::default()
    }
}

/// Airborne, by stations that send heartbeats.
fn airborne(keys: &'static str) -> Rig {
    airborne_with(setup(keys))
}

fn airborne_with(setup: Setup) -> Rig {
    let mut rig = Rig::ready_with(setup);
    for station in &mut rig.stations {
        station.heartbeats = true;
    }
    rig.take_off(20.0);
    rig.run(5.0);
    rig
}

const TERMINATE: &str = "termination = { action = \"terminate\" }";
const LAND: &str = "termination = { action = \"land\" }";

fn order(state: FtState) -> FlightTerminationCommand {
    FlightTerminationCommand {
        commanded_flight_termination_state: Some(state),
        flight_termination_mode: Some(FtMode::NotSpecified),
        ..FlightTerminationCommand::default()
    }
}

/// The bytes of an order made so long ago, with an answer requested.
fn recorded(rig: &Rig, state: FtState, ago: Duration) -> Vec<u8> {
    let wall = rig.station_now().wall - ago;
    let message = FlightTerminationCommand {
        time_stamp: Some(TimeStamp::from_unix_ms(wall.as_millis() as u64)),
        ..order(state)
    };
    encoded(rig, message.into())
}

fn encoded(rig: &Rig, message: Message) -> Vec<u8> {
    let envelope = Envelope::new(rig.station().id, vehicle_id(0)).requesting_ack();
    let mut bytes = [0; MAX_DATAGRAM];
    let length = message.encode(&envelope, &mut bytes).expect("it fits");
    bytes[..length].to_vec()
}

/// Reported Flight Termination State of the latest 3005.
fn reported(rig: &Rig, station: usize) -> Option<FtState> {
    rig.stations[station].last(vehicle_id(0), 3005, |message| match message {
        Message::FlightTerminationModeReport(report) => report.reported_flight_termination_state,
        _ => None,
    })
}

fn audited(rig: &Rig) -> String {
    let name = format!("audit-{:08x}.log", vehicle_id(0).0);
    String::from_utf8_lossy(&rig.store.records[&name]).into_owned()
}

/// It flies on, as if nothing had been ordered.
fn flies_on(rig: &mut Rig) {
    rig.run(3.0);
    let truth = rig.truth();
    let modes = [Px4::Termination, Px4::Land, Px4::Rtl];
    assert!(
        truth.armed && !truth.landed && !modes.contains(&truth.mode),
        "{:?}\n{:?}",
        truth.mode,
        rig.station().alerts()
    );
}

#[test]
fn two_orders_end_the_flight_and_every_station_knows_at_every_moment() {
    let mut rig = airborne(TERMINATE);
    // The other station listens.
    let listen = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::LOI2),
        ..orders::request_control()
    };
    let ticket = rig.send_as(1, 0, listen);
    assert_eq!(rig.end_as(1, ticket), DONE);
    rig.run(4.0);
    assert_eq!(reported(&rig, 1), Some(FtState::Reset));

    rig.done(order(FtState::Arm));
    rig.run(0.2);
    assert_eq!(
        [reported(&rig, 0), reported(&rig, 1)],
        [Some(FtState::Arm); 2]
    );
    let count = |rig: &Rig| {
        let reports = rig.stations[1].received.iter();
        reports
            .filter(|(_, _, message)| message.id() == 3005)
            .count()
    };
    let before = count(&rig);
    rig.run(2.0);
    assert!(
        (3..=5).contains(&(count(&rig) - before)),
        "2 Hz while armed"
    );
    assert!(rig.stations[1].has_alert("FLIGHT TERMINATION ARMED by 1b:00:00:a0"));
    assert!(audited(&rig).contains("termination armed"));
    flies_on(&mut rig);

    let ticket = rig.send(order(FtState::Execute));
    rig.run(0.3);
    // It is not reported as executed before the vehicle has shown it.
    if rig.truth().mode != Px4::Termination {
        assert_eq!(reported(&rig, 1), Some(FtState::Arm));
    }
    assert_eq!(rig.end(ticket), DONE);
    assert_eq!(rig.truth().mode, Px4::Termination);
    rig.run(1.0);
    assert_eq!(
        [reported(&rig, 0), reported(&rig, 1)],
        [Some(FtState::Execute); 2]
    );
    for station in &rig.stations {
        assert!(station.has_alert("FLIGHT TERMINATION COMMANDED"));
        assert!(station.has_alert("FLIGHT TERMINATION EXECUTED by 1b:00:00:a0"));
    }
    let log = audited(&rig);
    let place = |what: &str| {
        log.find(what)
            .unwrap_or_else(|| panic!("no {what} in {log}"))
    };
    assert!(place("termination armed") < place("termination commanded"));
    assert!(place("termination commanded") < place("termination confirmed"));

    // PX4 does not leave it: neither by a reset, nor by a mode, nor on the ground.
    assert_eq!(rig.carry_out(order(FtState::Reset)), NO);
    assert!(rig.station().has_alert("final in PX4"));
    assert_eq!(rig.carry_out(orders::mode(Mode::Loiter)), NO);
    rig.run(20.0);
    assert_eq!(rig.truth().mode, Px4::Termination);
    assert_eq!(reported(&rig, 0), Some(FtState::Execute));
    // A restart of the autopilot on the ground does.
    rig.vehicles[0].restart();
    assert!(rig.until(30.0, |rig| reported(rig, 0) == Some(FtState::Reset)));
    assert!(rig.station().has_alert("no longer shows TERMINATION"));
}

#[test]
fn one_step_the_reverse_a_timeout_and_a_cancel_end_no_flight() {
    let mut rig = airborne(TERMINATE);
    assert_eq!(rig.carry_out(order(FtState::Execute)), NO);
    assert!(rig.station().has_alert("it is not armed"));
    flies_on(&mut rig);
    // Reversed: what was executed before is not done by the arming after it.
    rig.done(order(FtState::Arm));
    flies_on(&mut rig);
    rig.done(order(FtState::Reset));
    assert_eq!(rig.carry_out(order(FtState::Execute)), NO);
    flies_on(&mut rig);
    assert!(
        rig.station()
            .has_alert("flight termination disarmed by 1b:00:00:a0")
    );
    assert_eq!(reported(&rig, 0), Some(FtState::Reset));
    // Armed for too long.
    rig.done(order(FtState::Arm));
    rig.run(31.0);
    assert!(rig.station().has_alert("did not execute it within 30 s"));
    assert_eq!(rig.carry_out(order(FtState::Execute)), NO);
    flies_on(&mut rig);
    assert_eq!(reported(&rig, 0), Some(FtState::Reset));
    assert!(!audited(&rig).contains("termination commanded"));
}

#[test]
fn replays_duplicates_old_orders_and_strangers_end_no_flight() {
    let mut rig = airborne(TERMINATE);
    // A recording of a whole exercise that was cancelled.
    let arm = recorded(&rig, FtState::Arm, Duration::ZERO);
    rig.deliver_from_station(&arm);
    rig.run(1.0);
    assert_eq!(reported(&rig, 0), Some(FtState::Arm));
    // The duplicate of an order to arm, and of one to execute that was refused, is none of the two steps.
    rig.deliver_from_station(&arm);
    flies_on(&mut rig);
    rig.done(order(FtState::Reset));
    let execute = recorded(&rig, FtState::Execute, Duration::ZERO);
    rig.deliver_from_station(&execute);
    rig.run(1.0);
    for bytes in [&arm, &execute, &arm, &execute] {
        rig.deliver_from_station(bytes);
        flies_on(&mut rig);
    }
    assert_eq!(reported(&rig, 0), Some(FtState::Reset));
    // Held back for longer than 2 s, on the first delivery.
    let old = recorded(&rig, FtState::Arm, Duration::from_millis(2_300));
    rig.deliver_from_station(&old);
    rig.run(1.0);
    assert_eq!(reported(&rig, 0), Some(FtState::Reset));
    assert!(rig.station().has_alert("by this station's own clock"));
    rig.done(order(FtState::Arm));
    rig.run(3.0);
    let late = recorded(&rig, FtState::Execute, Duration::from_millis(2_300));
    rig.deliver_from_station(&late);
    flies_on(&mut rig);
    assert_eq!(reported(&rig, 0), Some(FtState::Arm), "still armed");
    // From an address that is not proven, and without a Time Stamp.
    let fresh = recorded(&rig, FtState::Execute, Duration::ZERO);
    rig.deliver_from("127.0.0.9:49000".parse().expect("an address"), &fresh);
    flies_on(&mut rig);
    let stampless = encoded(&rig, order(FtState::Execute).into());
    rig.deliver_from_station(&stampless);
    flies_on(&mut rig);
    // After a restart neither the recordings count nor is anything armed.
    rig.restart_bridge();
    rig.run(6.0);
    assert_eq!(reported(&rig, 0), Some(FtState::Reset));
    for bytes in [&arm, &execute, &fresh] {
        rig.deliver_from_station(bytes);
        flies_on(&mut rig);
    }
    assert!(!audited(&rig).contains("termination commanded"));
}

#[test]
fn a_link_that_holds_everything_back_makes_no_old_order_fresh() {
    let mut rig = airborne(TERMINATE);
    rig.done(order(FtState::Arm));
    // Everything of the station waits for 5 s, the order to execute among it, and comes at once.
    let mut held = Vec::new();
    rig.stations[0].heartbeats = false;
    for second in 0..5 {
        if second == 2 {
            held.push(recorded(&rig, FtState::Execute, Duration::ZERO));
        }
        let beat = stanag_msgs::messages::Heartbeat {
            time_stamp: Some(TimeStamp::from_unix_ms(
                rig.station_now().wall.as_millis() as u64
            )),
        };
        held.insert(0, encoded(&rig, beat.into()));
        rig.run(1.0);
    }
    for bytes in &held {
        rig.deliver_from_station(bytes);
    }
    flies_on(&mut rig);
    assert!(
        rig.station()
            .has_alert("on its way by this station's own clock")
    );
}

#[test]
fn a_station_whose_clock_is_not_measured_is_refused_until_it_is() {
    let mut rig = Rig::ready_with(setup(TERMINATE));
    rig.take_off(20.0);
    // Silence for longer than a minute: nothing is known of its clock.
    rig.run(70.0);
    assert_eq!(rig.carry_out(order(FtState::Arm)), NO);
    assert!(rig.station().has_alert("not measured yet"));
    rig.stations[0].heartbeats = true;
    rig.run(4.0);
    rig.done(order(FtState::Arm));
}

#[test]
fn another_cucs_and_a_handover_end_no_flight() {
    let mut rig = airborne(TERMINATE);
    rig.done(order(FtState::Arm));
    // Without the right.
    let ticket = rig.send_as(1, 0, order(FtState::Execute));
    assert_eq!(rig.end_as(1, ticket), NO);
    flies_on(&mut rig);
    // While its holder hands control over, neither of the two commands it.
    let offer = rig.send(handover(LoiBitmap::LOI4.union(LoiBitmap::LOI5)));
    rig.run(0.5);
    assert_eq!(rig.carry_out(order(FtState::Execute)), NO);
    assert!(
        rig.station()
            .has_alert("control is being handed over to another CUCS")
    );
    flies_on(&mut rig);
    assert_eq!(
        reported(&rig, 0),
        Some(FtState::Arm),
        "its time is not over"
    );
    // Handed over, it is armed for neither of them.
    let ticket = rig.send_as(1, 0, handover(LoiBitmap::LOI4.union(LoiBitmap::LOI5)));
    assert_eq!((rig.end(offer), rig.end_as(1, ticket)), (DONE, DONE));
    rig.run(1.0);
    assert!(rig.stations[1].has_alert("no longer controls the vehicle"));
    assert_eq!(reported(&rig, 1), Some(FtState::Reset));
    assert_eq!(rig.carry_out(order(FtState::Execute)), NO);
    let ticket = rig.send_as(1, 0, order(FtState::Execute));
    assert_eq!(rig.end_as(1, ticket), NO);
    flies_on(&mut rig);
    assert!(!audited(&rig).contains("termination commanded"));
}

/// Message 4 about control for station 1.
fn handover(levels: LoiBitmap) -> PositiveHandoverAuthorisationRequest {
    PositiveHandoverAuthorisationRequest {
        requested_handover_loi: Some(levels),
        requesting_cucs_id: Some(cucs(1)),
        ..PositiveHandoverAuthorisationRequest::default()
    }
}

#[test]
fn who_only_asks_for_control_keeps_its_holder_from_nothing() {
    let mut rig = airborne(TERMINATE);
    rig.send_as(1, 0, handover(LoiBitmap::LOI4.union(LoiBitmap::LOI5)));
    rig.run(0.5);
    rig.done(order(FtState::Arm));
    rig.done(order(FtState::Execute));
    assert_eq!(rig.truth().mode, Px4::Termination);
}

/// The loss is reported once: it is not forgotten because nothing else was flown then.
#[test]
fn a_controller_that_is_lost_meanwhile_is_made_up_for_once_nothing_is_commanded_any_more() {
    let mut rig = airborne_with(Setup {
        tables: "[authority]\non_loss = \"rtl\"\n",
        ..setup("termination = { action = \"land\", confirm_s = 60.0 }")
    });
    rig.done(order(FtState::Arm));
    rig.mav.faults.loss = 1.0;
    rig.send_once(order(FtState::Execute));
    rig.run(0.5);
    // Nothing comes of it: no repetition, and no acknowledgement.
    let station = &mut rig.stations[0];
    (station.heartbeats, station.acknowledges) = (false, false);
    let controls = |rig: &Rig| {
        let bridge = rig.bridge.as_ref().expect("it runs");
        let status = bridge.status(String::new(), rig.now().mono);
        status.vehicles[0].controller.is_some()
    };
    assert!(
        rig.until(40.0, |rig| !controls(rig)),
        "{:?}",
        rig.station().alerts()
    );
    assert_eq!(rig.truth().mode, Px4::Loiter);
    rig.run(61.0);
    assert!(audited(&rig).contains("termination not confirmed"));
    rig.mav.faults.loss = 0.0;
    assert!(
        rig.until(20.0, |rig| rig.truth().mode == Px4::Rtl),
        "{:?}",
        rig.truth().mode
    );
}

/// Sends centred sticks for so long.
fn fly(rig: &mut Rig, seconds: f64) {
    let sticks = UaStickCommand {
        longitudinal_stick: Some(0),
        throttle_stick_engine_1: Some(50),
        ..UaStickCommand::default()
    };
    for _ in 0..(seconds * 10.0) as u32 {
        rig.send_once(sticks.clone());
        rig.run(0.1);
    }
}

/// Flown by sticks, with a landing armed.
fn armed_by_hand(setup: Setup) -> Rig {
    let mut rig = airborne_with(setup);
    fly(&mut rig, 0.5);
    rig.send(orders::mode(Mode::FlightDirector));
    fly(&mut rig, 3.0);
    assert_eq!(rig.truth().mode, Px4::PosCtl);
    rig.send(order(FtState::Arm));
    fly(&mut rig, 1.0);
    rig
}

/// NAV_RCL_ACT hold and land: PX4 holds, in a landing too, once it misses the sticks.
#[test]
fn a_landing_that_has_ended_the_sticks_is_not_left_for_the_hold_of_their_loss() {
    for on_loss in [1.0, 3.0] {
        let mut rig = armed_by_hand(Setup {
            vehicles: vec![px4_sim::Config {
                params: vec![(px4_sim::Param::NAV_RCL_ACT, on_loss)],
                ..px4_sim::Config::default()
            }],
            ..setup(LAND)
        });
        rig.send(order(FtState::Execute));
        assert!(rig.until(5.0, |rig| rig.truth().mode == Px4::Land));
        assert!(rig.until(5.0, |rig| rig.truth().mode == Px4::Loiter));
        let ended = rig.until(90.0, |rig| rig.truth().landed && !rig.truth().armed);
        let alerts = rig.station().alerts();
        assert!(ended, "{on_loss}: {alerts:?}");
        assert!(!rig.station().has_alert("TERMINATION LEFT"), "{alerts:?}");
    }
}

#[test]
fn it_takes_over_from_sticks_and_nothing_is_polled_in_vain() {
    let mut rig = armed_by_hand(setup(LAND));
    let overdue = |rig: &mut Rig| {
        let mut overdue = 0;
        for _ in 0..100 {
            rig.run(0.01);
            let now = rig.now().mono;
            let bridge = rig.bridge.as_mut().expect("it runs");
            overdue += u32::from(bridge.poll_timeout(now) <= now);
        }
        overdue
    };
    // Commanded, and not shown; then executing.
    rig.mav.faults.loss = 1.0;
    rig.send(order(FtState::Execute));
    rig.run(0.5);
    assert_eq!(reported(&rig, 0), Some(FtState::Arm));
    assert_eq!(overdue(&mut rig), 0, "commanded");
    rig.mav.faults.loss = 0.0;
    assert!(rig.until(5.0, |rig| rig.truth().mode == Px4::Land));
    rig.run(1.0);
    assert_eq!(reported(&rig, 0), Some(FtState::Execute));
    assert_eq!(overdue(&mut rig), 0, "executing");
    assert_eq!(rig.truth().mode, Px4::Land);
}

/// It could neither reset it nor command anything else before the vehicle has landed.
#[test]
fn a_successor_that_may_not_use_the_layout_is_obeyed() {
    let mut rig = airborne("termination = { action = \"return\" }");
    let id = format!("id = \"{}\"\n", cucs(1));
    let text = rig
        .text
        .replacen(&id, &format!("{id}provisional = \"status\"\n"), 1);
    assert!(text.len() > rig.text.len());
    rig.reload(&text).expect("a good configuration");
    rig.done(order(FtState::Arm));
    rig.done(order(FtState::Execute));
    assert_eq!(rig.truth().mode, Px4::Rtl);
    let release = CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::NONE),
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..CucsAuthorisationRequest::default()
    };
    rig.done(release);
    let ticket = rig.send_as(1, 0, orders::request_control());
    assert_eq!(rig.end_as(1, ticket), DONE);
    rig.run(1.0);
    assert!(rig.stations[1].has_alert("flight termination released"));
    let ticket = rig.send_as(1, 0, orders::mode(Mode::Loiter));
    assert_eq!(rig.end_as(1, ticket), DONE);
    assert_eq!(rig.truth().mode, Px4::Loiter);
}

#[test]
fn it_is_off_unless_it_is_planned_and_the_layout_may_be_used() {
    let mut rig = airborne("");
    assert_eq!(rig.carry_out(order(FtState::Arm)), NO);
    assert!(rig.station().has_alert("flight termination is off"));
    flies_on(&mut rig);

    let mut rig = Rig::ready_with(Setup {
        vehicle_keys: TERMINATE,
        ..Setup::default()
    });
    rig.stations[0].heartbeats = true;
    rig.take_off(20.0);
    rig.run(4.0);
    assert_eq!(rig.carry_out(order(FtState::Arm)), NO);
    assert!(rig.station().has_alert("derived from Edition 2"));
    flies_on(&mut rig);
}

#[test]
fn a_landing_as_termination_yields_to_no_other_command_until_it_is_reset() {
    let mut rig = airborne(LAND);
    rig.send_plan(orders::square());
    rig.done(orders::load());
    let flown = rig.send(orders::mode(Mode::Waypoint));
    rig.run(1.0);
    rig.done(order(FtState::Arm));
    rig.done(order(FtState::Execute));
    assert_eq!(rig.truth().mode, Px4::Land);
    let _ = flown;
    assert_eq!(rig.carry_out(orders::mode(Mode::Loiter)), NO);
    assert!(rig.station().has_alert("a flight termination is commanded"));
    assert_eq!(rig.carry_out(orders::load()), NO);
    assert_eq!(rig.truth().mode, Px4::Land);
    // Released, it obeys again.
    rig.done(order(FtState::Reset));
    rig.done(orders::mode(Mode::Loiter));
    assert_eq!(rig.truth().mode, Px4::Loiter);
    // To its end.
    rig.done(order(FtState::Arm));
    rig.done(order(FtState::Execute));
    assert!(rig.until(90.0, |rig| rig.truth().landed && !rig.truth().armed));
    rig.run(2.0);
    assert_eq!(reported(&rig, 0), Some(FtState::Reset));
    assert!(rig.station().has_alert("flight termination ended"));
    assert_eq!(rig.carry_out(order(FtState::Arm)), NO);
    assert!(rig.station().has_alert("there is no flight to end"));
}

#[test]
fn the_command_leaves_after_its_entry_of_the_audit_log_and_no_disk_can_hold_it_up_for_good() {
    let mut rig = airborne(TERMINATE);
    rig.done(order(FtState::Arm));
    rig.store.queues = true;
    rig.sync = Duration::from_millis(600);
    let before = rig.arrived.get(&COMMAND_LONG).copied().unwrap_or_default();
    let ticket = rig.send(order(FtState::Execute));
    rig.run(0.4);
    assert!(
        audited(&rig).contains("termination commanded"),
        "it is queued"
    );
    let after = rig.arrived.get(&COMMAND_LONG).copied().unwrap_or_default();
    assert_eq!(
        (after, rig.truth().mode == Px4::Termination),
        (before, false)
    );
    assert_eq!(rig.end(ticket), DONE);
    assert_eq!(rig.truth().mode, Px4::Termination);

    // A disk that takes nothing holds it up for a second.
    let mut rig = airborne(TERMINATE);
    rig.done(order(FtState::Arm));
    rig.store.full = Some("audit");
    rig.send(order(FtState::Execute));
    assert!(rig.until(3.0, |rig| rig.truth().mode == Px4::Termination));
    assert!(rig.station().has_alert("the audit log has no entry"));
}

#[test]
fn a_vehicle_that_is_not_received_is_commanded_for_a_while_and_reported_as_not_confirmed() {
    let mut rig = airborne("termination = { action = \"terminate\", confirm_s = 15.0 }");
    rig.mav.faults.loss = 1.0;
    rig.run(8.0);
    assert!(rig.station().has_alert("no data from the vehicle"));
    // A link whose way down has failed is a reason to end a flight.
    rig.done(order(FtState::Arm));
    assert_eq!(rig.carry_out(order(FtState::Execute)), NO);
    assert!(rig.station().has_alert("NOT CONFIRMED"));
    // Given up: a vehicle that comes back later is not sent it.
    rig.mav.faults.loss = 0.0;
    flies_on(&mut rig);

    // One that comes back in time is.
    rig.done(order(FtState::Arm));
    rig.mav.faults.loss = 1.0;
    let ticket = rig.send(order(FtState::Execute));
    rig.run(8.0);
    rig.mav.faults.loss = 0.5;
    assert_eq!(rig.end(ticket), DONE);
    assert_eq!(rig.truth().mode, Px4::Termination);
}

/// Executed, and shown by the vehicle.
fn landing() -> Rig {
    let mut rig = airborne(LAND);
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.done(order(FtState::Arm));
    rig.done(order(FtState::Execute));
    assert_eq!(rig.truth().mode, Px4::Land);
    rig
}

#[test]
fn a_restart_of_the_bridge_does_not_end_it() {
    let mut rig = landing();
    rig.restart_bridge();
    rig.run(2.0);
    let alerts = rig.station().alerts();
    assert_eq!(reported(&rig, 0), Some(FtState::Execute), "{alerts:?}");
    assert!(rig.station().has_alert("executed before a restart"));
    for refused in [Mode::Waypoint, Mode::Loiter] {
        let ticket = rig.send(orders::mode(refused));
        assert_eq!(rig.end(ticket), NO);
        assert_eq!(rig.truth().mode, Px4::Land, "{refused:?}");
    }
    assert!(audited(&rig).contains("termination resumed"));
    assert!(rig.until(60.0, |rig| !rig.truth().armed));
    assert!(rig.until(5.0, |rig| reported(rig, 0) == Some(FtState::Reset)));
    // Once it is over, nothing of it is left for the next start.
    rig.restart_bridge();
    rig.run(2.0);
    assert_eq!(reported(&rig, 0), Some(FtState::Reset));
}

#[test]
fn it_can_be_reset_after_a_restart() {
    let mut rig = landing();
    rig.restart_bridge();
    rig.run(2.0);
    rig.done(order(FtState::Reset));
    rig.done(orders::mode(Mode::Loiter));
    assert_eq!(rig.truth().mode, Px4::Loiter);
}

#[test]
fn what_the_vehicle_does_not_show_after_a_restart_is_reported_and_not_commanded_again() {
    let mut rig = landing();
    let to = Node::new(1, 1);
    let hold = command::long(to, MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 4.0, 3.0]);
    rig.restart_bridge();
    // A pilot has taken it meanwhile.
    let by = Node::new(255, 190);
    rig.vehicles[0].vehicle_mut().handle_message(by, &hold);
    let said = rig.until(10.0, |rig| {
        rig.station()
            .has_alert("FLIGHT TERMINATION NOT SHOWN: commanded by")
    });
    assert!(said, "{:?}", rig.station().alerts());
    assert_eq!(reported(&rig, 0), Some(FtState::Reset));
    flies_on(&mut rig);
    rig.done(orders::mode(Mode::Waypoint));
}

#[test]
fn one_of_before_a_restart_of_the_computer_is_named_and_seizes_no_later_flight() {
    let mut rig = landing();
    rig.boot += 1;
    rig.restart_bridge();
    rig.run(3.0);
    let alerts = rig.station().alerts();
    assert!(rig.station().has_alert("it is not taken up"), "{alerts:?}");
    assert_eq!(reported(&rig, 0), Some(FtState::Reset), "{alerts:?}");
    rig.done(orders::mode(Mode::Loiter));
    assert_eq!(rig.truth().mode, Px4::Loiter);
}
