//! Commands that are held until a condition: carried out when it is met, once, by who may; over restarts, silence, loss of
//! control, pilots and failsafes.

use std::time::Duration;

use kit::bridge::{Rig, Setup, Ticket, cucs, orders, vehicle_id};
use px4_sim::{HealthFaults, Mode as Px4, Param};
use stanag_msgs::enums::{
    AckType, FlightPathControlMode as Mode, FtState, HeldState, HoldCondition, HoldKind, LoiBitmap,
    RequestedAccess, RouteType,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, FlightTerminationCommand, GenericInformationRequestMessage,
    HeldCommandCancel, HeldCommandState, HoldCommand, UaRoute, UaStickCommand, ZeroizeCommand,
};
use stanag_msgs::{Bam32, MAX_DATAGRAM, Message, Text, TimeStamp};

const DONE: Option<AckType> = Some(AckType::CarriedOut);
const REFUSED: Option<AckType> = Some(AckType::Refused);

/// A 50020 without its condition, which expires in a minute.
fn hold(number: u16, condition: HoldCondition, command: impl Into<Message>) -> HoldCommand {
    let command = command.into();
    let mut data = [0; MAX_DATAGRAM];
    let length = command.encode_data(&mut data).expect("it is encoded");
    let hex: String = data[..length]
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect();
    HoldCommand {
        held_command_number: Some(number),
        held_message_type: Some(command.id()),
        held_message_data: Some(Text::new(&hex)),
        hold_condition: Some(condition),
        valid_for: Some(60),
        ..HoldCommand::default()
    }
}

/// In so many seconds.
fn at_time(rig: &Rig, seconds: f64, mut command: HoldCommand) -> HoldCommand {
    let at = rig.station_now().wall.as_secs_f64() + seconds;
    command.condition_time = Some(TimeStamp::from_unix_ms((at * 1e3) as u64));
    command
}

fn contingency(command: HoldCommand) -> HoldCommand {
    HoldCommand {
        hold_kind: Some(HoldKind::Contingency),
        ..command
    }
}

/// The vehicle lands in so many seconds.
fn landing(rig: &Rig, number: u16, seconds: f64) -> HoldCommand {
    let land = orders::mode(Mode::AutolandEngage);
    at_time(rig, seconds, hold(number, HoldCondition::Time, land))
}

/// Sends a 50020 that is taken.
fn held(rig: &mut Rig, command: HoldCommand) -> Ticket {
    let ticket = rig.send(command);
    rig.run(0.3);
    assert_eq!(
        rig.station().answers(ticket).first(),
        Some(&AckType::Received),
        "{:?}",
        rig.station().alerts()
    );
    assert_eq!(rig.station().end(ticket), None);
    // Who has been answered does not repeat it.
    rig.stations[0].give_up(ticket);
    ticket
}

/// The states that 50022 has shown of a held command of station 0, repetitions left out.
fn states(rig: &Rig, station: usize, number: u16) -> Vec<HeldState> {
    let mut states: Vec<HeldState> = Vec::new();
    for (_, _, message) in &rig.stations[station].received {
        if let Message::HeldCommandState(state) = message
            && state.held_command_number == Some(number)
            && state.owner_id == Some(cucs(0))
            && let Some(state) = state.held_state
            && states.last() != Some(&state)
        {
            states.push(state);
        }
    }
    states
}

fn flying() -> Rig {
    flying_with(Setup::default())
}

fn flying_with(setup: Setup) -> Rig {
    let mut rig = Rig::ready_with(setup);
    rig.take_off(20.0);
    rig.run(3.0);
    rig
}

fn two_stations() -> Setup {
    Setup {
        stations: 2,
        ..Setup::default()
    }
}

fn request(access: RequestedAccess, levels: LoiBitmap) -> CucsAuthorisationRequest {
    CucsAuthorisationRequest {
        requested_handover_access: Some(access),
        requested_handover_loi: Some(levels),
        ..CucsAuthorisationRequest::default()
    }
}

#[test]
fn a_landing_is_carried_out_at_its_time_and_answered_when_the_vehicle_shows_it() {
    let mut rig = flying();
    let land = landing(&rig, 1, 5.0);
    let ticket = held(&mut rig, land);
    rig.run(4.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
    assert_eq!(states(&rig, 0, 1), [HeldState::Waiting]);
    assert!(rig.until(3.0, |rig| rig.truth().mode == Px4::Land));
    rig.run(2.0);
    assert_eq!(rig.station().end(ticket), DONE);
    let expected = [
        HeldState::Waiting,
        HeldState::BeingCarriedOut,
        HeldState::CarriedOut,
    ];
    assert_eq!(states(&rig, 0, 1), expected);
}

/// Two orders of the moment command it: one that was held would be neither fresh nor meant.
#[test]
fn an_order_of_a_flight_termination_or_of_a_zeroize_is_never_held() {
    let mut rig = flying_with(Setup {
        dli_keys: "provisional = \"all\"",
        vehicle_keys: "termination = { action = \"land\" }",
        ..Setup::default()
    });
    for state in [FtState::Arm, FtState::Execute, FtState::Reset] {
        let order = FlightTerminationCommand {
            commanded_flight_termination_state: Some(state),
            ..FlightTerminationCommand::default()
        };
        let order = at_time(&rig, 1.0, hold(1, HoldCondition::Time, order));
        assert_eq!(rig.carry_out(order), REFUSED, "{state:?}");
        let zeroize = ZeroizeCommand {
            commanded_zeroize_state: Some(state),
            ..ZeroizeCommand::default()
        };
        let order = at_time(&rig, 1.0, hold(1, HoldCondition::Time, zeroize));
        assert_eq!(rig.carry_out(order), REFUSED, "{state:?}");
    }
    assert!(
        rig.station()
            .has_alert("a flight termination is never held")
    );
    rig.run(3.0);
    assert_eq!(
        (rig.truth().mode, states(&rig, 0, 1)),
        (Px4::Loiter, vec![])
    );
}

#[test]
fn a_hold_is_carried_out_when_a_waypoint_has_been_passed() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    let mut command = hold(2, HoldCondition::WaypointPassed, orders::mode(Mode::Loiter));
    (command.condition_number, command.valid_for) = (Some(102), Some(300));
    let ticket = held(&mut rig, command);
    rig.done(orders::mode(Mode::Waypoint));
    assert_eq!(rig.end(ticket), DONE, "{:?}", rig.station().alerts());
    rig.run(5.0);
    let at = rig.truth().position;
    assert_eq!(rig.truth().mode, Px4::Loiter);
    assert!((at.n - 80.0).abs() < 20.0 && at.e > 60.0, "{at:?}");
}

#[test]
fn a_circle_is_entered_and_an_area_left_only_by_a_change() {
    let mut rig = Rig::ready();
    rig.send_plan(orders::square());
    rig.done(orders::load());
    rig.take_off(20.0);
    // It hovers outside of the first, and inside of the second.
    let (latitude, longitude) = orders::place(80.0, 40.0);
    let mut enters = hold(3, HoldCondition::AreaEntered, orders::mode(Mode::Loiter));
    enters.condition_latitude = Some(Bam32::from_degrees(latitude));
    enters.condition_longitude = Some(Bam32::from_degrees(longitude));
    enters.condition_radius = Some(15.0);
    let enters = held(&mut rig, enters);
    let mut inside = hold(
        4,
        HoldCondition::AreaEntered,
        orders::mode(Mode::AutolandEngage),
    );
    let (latitude, longitude) = orders::place(0.0, 0.0);
    inside.condition_latitude = Some(Bam32::from_degrees(latitude));
    inside.condition_longitude = Some(Bam32::from_degrees(longitude));
    inside.condition_radius = Some(10.0);
    let inside = held(&mut rig, inside);
    rig.done(orders::mode(Mode::Waypoint));
    assert_eq!(rig.end(enters), DONE, "{:?}", rig.station().alerts());
    rig.run(3.0);
    let at = rig.truth().position;
    assert!(
        (at.e - 40.0).abs() < 25.0 && (at.n - 80.0).abs() < 20.0,
        "{at:?}"
    );
    assert_eq!(
        rig.station().end(inside),
        None,
        "it was inside of it when it was given"
    );
}

#[test]
fn a_return_is_carried_out_when_less_energy_is_left_and_its_successor_after_it() {
    let mut rig = flying();
    let mut low = hold(
        5,
        HoldCondition::BatteryBelow,
        orders::mode(Mode::AutolandEngage),
    );
    low.condition_percent = Some(40);
    let low = held(&mut rig, low);
    let mut after = hold(6, HoldCondition::CommandDone, orders::mode(Mode::Loiter));
    after.condition_number = Some(5);
    let after = held(&mut rig, after);
    let battery = |rig: &mut Rig, percent| {
        rig.vehicles[0]
            .vehicle_mut()
            .set_health_faults(HealthFaults {
                battery: Some(percent),
                ..HealthFaults::default()
            });
    };
    battery(&mut rig, 41);
    rig.run(5.0);
    assert_eq!(rig.station().end(low), None);
    battery(&mut rig, 39);
    assert_eq!(rig.end(low), DONE, "{:?}", rig.station().alerts());
    // It lands, as a pilot or failsafe might have it: what was planned before does not take it from them.
    assert_eq!(rig.end(after), REFUSED);
    rig.run(0.3);
    assert!(rig.station().has_alert(
        "held command 6: 2016 (Vehicle Operating Mode Command) refused: the vehicle is in"
    ));
    assert_eq!(rig.truth().mode, Px4::Land);
}

#[test]
fn what_it_waits_for_is_not_carried_out_and_so_it_is_cancelled() {
    let mut rig = flying();
    let first = landing(&rig, 1, 30.0);
    let first = held(&mut rig, first);
    let mut after = hold(2, HoldCondition::CommandDone, orders::mode(Mode::Loiter));
    after.condition_number = Some(1);
    let after = held(&mut rig, after);
    let cancel = HeldCommandCancel {
        held_command_number: Some(1),
        ..HeldCommandCancel::default()
    };
    rig.done(cancel);
    assert_eq!(rig.end(first), REFUSED);
    assert_eq!(rig.end(after), REFUSED);
    rig.run(0.3);
    assert!(
        rig.station()
            .has_alert("held command 1 is cancelled: cancelled by")
    );
    assert!(
        rig.station()
            .has_alert("held command 1, which it waits for, was not carried out")
    );
    rig.run(35.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
}

#[test]
fn it_expires() {
    let mut rig = flying();
    let mut low = hold(
        7,
        HoldCondition::BatteryBelow,
        orders::mode(Mode::AutolandEngage),
    );
    (low.condition_percent, low.valid_for) = (Some(40), Some(5));
    let low = held(&mut rig, low);
    assert_eq!(rig.end(low), REFUSED);
    rig.run(0.3);
    assert!(rig.station().has_alert("held command 7 has expired"));
    assert_eq!(states(&rig, 0, 7), [HeldState::Waiting, HeldState::Expired]);
    rig.vehicles[0]
        .vehicle_mut()
        .set_health_faults(HealthFaults {
            battery: Some(10),
            ..HealthFaults::default()
        });
    rig.run(5.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
}

#[test]
fn it_survives_the_end_of_the_vsm_and_is_carried_out_once() {
    let mut rig = flying();
    let land = landing(&rig, 1, 10.0);
    let ticket = held(&mut rig, land);
    rig.restart_bridge();
    rig.run(2.0);
    // Its repetition is answered as before, and holds nothing more.
    let before = rig.station().answers(ticket).len();
    rig.stations[0].repeat(ticket);
    rig.run(1.0);
    let again = &rig.station().answers(ticket)[before..];
    assert!(
        !again.is_empty() && again.iter().all(|one| *one == AckType::Received),
        "{again:?}"
    );
    assert!(rig.until(12.0, |rig| rig.truth().mode == Px4::Land));
    assert_eq!(rig.end(ticket), DONE);
    rig.done(orders::mode(Mode::Loiter));
    for _ in 0..2 {
        rig.restart_bridge();
        rig.run(3.0);
        rig.stations[0].repeat(ticket);
        rig.run(2.0);
    }
    assert_eq!(rig.truth().mode, Px4::Loiter);
    assert_eq!(
        rig.station().answers(ticket).last(),
        Some(&AckType::CarriedOut)
    );
}

/// The time since boot counts a sleep, which the time of the process does not.
#[test]
fn a_computer_that_slept_changes_no_time_of_what_is_held_over_a_restart_of_the_vsm() {
    let mut rig = flying();
    rig.sleep_computer(Duration::from_secs(3_600));
    let land = landing(&rig, 1, 10.0);
    held(&mut rig, land);
    rig.restart_bridge();
    rig.run(5.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
    assert!(rig.until(10.0, |rig| rig.truth().mode == Px4::Land));
}

#[test]
fn what_was_cancelled_or_has_expired_does_not_come_back_with_a_restart() {
    let mut rig = flying();
    let cancelled = landing(&rig, 1, 12.0);
    let cancelled = held(&mut rig, cancelled);
    let mut expires = landing(&rig, 2, 6.0);
    expires.valid_for = Some(8);
    let expires = held(&mut rig, expires);
    rig.done(HeldCommandCancel {
        held_command_number: Some(1),
        ..HeldCommandCancel::default()
    });
    rig.run(3.0);
    rig.stop_bridge();
    rig.run(6.0);
    rig.start_bridge();
    rig.run(10.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
    assert_eq!(rig.station().end(cancelled), REFUSED);
    assert_eq!(rig.station().end(expires), REFUSED);
}

#[test]
fn one_that_a_restart_cuts_off_is_reported_and_not_carried_out_again() {
    let mut rig = Rig::ready();
    let launch = at_time(
        &rig,
        3.0,
        hold(1, HoldCondition::Time, orders::launch(20.0)),
    );
    let launch = held(&mut rig, launch);
    assert!(rig.until(10.0, |rig| rig.truth().armed));
    rig.restart_bridge();
    assert!(
        rig.until(5.0, |rig| !rig.truth().armed),
        "no running motors are left"
    );
    assert_eq!(rig.end(launch), REFUSED);
    rig.run(0.3);
    assert!(
        rig.station()
            .has_alert("the VSM restarted while it was carried out")
    );
    rig.run(10.0);
    assert!(rig.truth().landed && !rig.truth().armed);
}

#[test]
fn it_waits_while_the_vehicle_is_silent() {
    let mut rig = flying();
    let land = landing(&rig, 1, 6.0);
    let in_time = held(&mut rig, land);
    rig.mav.faults.loss = 1.0;
    rig.run(10.0);
    assert_eq!(rig.station().end(in_time), None);
    assert_eq!(states(&rig, 0, 1), [HeldState::Waiting]);
    rig.mav.faults.loss = 0.0;
    assert_eq!(rig.end(in_time), DONE, "{:?}", rig.station().alerts());
    assert_eq!(rig.truth().mode, Px4::Land);
}

#[test]
fn a_failsafe_is_not_taken_from_the_vehicle() {
    let mut rig = flying_with(Setup {
        vehicles: vec![px4_sim::Config {
            params: vec![(Param::NAV_DLL_ACT, 2.0)],
            ..px4_sim::Config::default()
        }],
        ..Setup::default()
    });
    let hold = at_time(
        &rig,
        4.0,
        hold(1, HoldCondition::Time, orders::mode(Mode::Loiter)),
    );
    let ticket = held(&mut rig, hold);
    rig.mav.faults.loss = 1.0;
    assert!(rig.until(40.0, |rig| rig.truth().mode == Px4::Rtl));
    rig.mav.faults.loss = 0.0;
    assert_eq!(rig.end(ticket), REFUSED);
    rig.run(0.3);
    assert!(
        rig.station().has_alert(
            "held command 1: 2016 (Vehicle Operating Mode Command) refused: the vehicle"
        )
    );
    assert_ne!(rig.truth().mode, Px4::Loiter);
}

#[test]
fn it_ends_with_the_control_of_its_sender_and_a_contingency_with_the_next_controller() {
    let mut rig = flying_with(two_stations());
    let command = landing(&rig, 1, 40.0);
    let command = held(&mut rig, command);
    let kept = landing(&rig, 2, 50.0);
    let kept = held(&mut rig, contingency(kept));
    let release = request(
        RequestedAccess::Relinquish,
        LoiBitmap::LOI4.union(LoiBitmap::LOI5),
    );
    rig.done(release);
    assert_eq!(rig.end(command), REFUSED);
    rig.run(1.0);
    assert!(
        rig.station()
            .has_alert("no longer controls the vehicle, nobody does")
    );
    assert_eq!(rig.station().end(kept), None);
    let levels = LoiBitmap::LOI4.union(LoiBitmap::LOI5);
    let taken = rig.send_as(1, 0, request(RequestedAccess::Request, levels));
    assert_eq!(rig.end_as(1, taken), DONE);
    assert_eq!(rig.end(kept), REFUSED);
    rig.run(0.5);
    for station in [0, 1] {
        let alerts = rig.stations[station].alerts();
        assert!(
            rig.stations[station].has_alert("controls the vehicle now"),
            "{station}: {alerts:?}"
        );
    }
    rig.run(50.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
}

#[test]
fn a_contingency_is_flown_for_a_cucs_that_is_lost() {
    let mut rig = flying_with(Setup {
        tables: "[authority]\non_loss = \"continue\"\n",
        ..two_stations()
    });
    let listen = request(RequestedAccess::Request, LoiBitmap::LOI2);
    let listens = rig.send_as(1, 0, listen);
    assert_eq!(rig.end_as(1, listens), DONE);
    rig.stations[0].heartbeats = true;
    rig.run(2.0);
    let lost = hold(1, HoldCondition::LinkLost, orders::mode(Mode::ContingencyA));
    assert_eq!(rig.carry_out(lost.clone()), REFUSED);
    rig.run(0.3);
    assert!(rig.station().has_alert("it needs Hold Kind 1"));
    held(&mut rig, contingency(lost));
    rig.stations[0].heartbeats = false;
    assert!(
        rig.until(60.0, |rig| rig.truth().mode == Px4::Rtl),
        "{:?}",
        rig.stations[1].alerts()
    );
    rig.run(2.0);
    assert_eq!(states(&rig, 1, 1).last(), Some(&HeldState::CarriedOut));
}

/// In flight on its route, by a station whose loss has a contingency route that is stored and not aboard; station 1 listens.
fn on_a_route_with_another_for_the_loss() -> Rig {
    let mut rig = Rig::ready_with(Setup {
        tables: "[authority]\non_loss = \"continue\"\n",
        ..two_stations()
    });
    let listen = request(RequestedAccess::Request, LoiBitmap::LOI2);
    let listens = rig.send_as(1, 0, listen);
    assert_eq!(rig.end_as(1, listens), DONE);
    rig.send_plan(orders::square());
    let route = UaRoute {
        route_id: Some(Text::new("CA")),
        route_type: Some(RouteType::ContingencyA),
        ..orders::route(7)
    };
    rig.send_plan(vec![
        route.into(),
        orders::waypoint(7, 8, 60.0, 0.0, 30.0).into(),
        orders::waypoint(8, 0, 60.0, 50.0, 30.0).into(),
    ]);
    rig.done(orders::load());
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Waypoint));
    rig.stations[0].heartbeats = true;
    rig.run(2.0);
    let lost = hold(1, HoldCondition::LinkLost, orders::mode(Mode::ContingencyA));
    held(&mut rig, contingency(lost));
    rig
}

/// The loss may be seen first when a datagram of the vehicle arrives, or when a timer is due.
#[test]
fn a_contingency_whose_route_is_uploaded_first_is_flown_for_a_cucs_that_is_lost() {
    for by_timer in [false, true] {
        let mut rig = on_a_route_with_another_for_the_loss();
        rig.stations[0].heartbeats = false;
        let offered = "another may take control";
        assert!(rig.until(20.0, |rig| rig.stations[1].has_alert(offered)));
        rig.run(4.0);
        rig.mav.faults.loss = if by_timer { 1.0 } else { 0.0 };
        assert!(rig.until(5.0, |rig| rig.stations[1].has_alert("is lost")));
        rig.mav.faults.loss = 0.0;
        let carried_out = |rig: &Rig| states(rig, 1, 1).last() == Some(&HeldState::CarriedOut);
        let alerts = |rig: &Rig| rig.stations[1].alerts();
        assert!(rig.until(30.0, carried_out), "{:?}", alerts(&rig));
        let expected = [
            HeldState::Waiting,
            HeldState::BeingCarriedOut,
            HeldState::CarriedOut,
        ];
        assert_eq!(states(&rig, 1, 1), expected);
        assert_eq!(rig.truth().mode, Px4::Mission);
        let announced = "nobody controls the vehicle: held command 1 is carried out";
        assert!(rig.stations[1].has_alert(announced), "{:?}", alerts(&rig));
    }
}

#[test]
fn only_its_owner_and_the_controller_cancel_it_and_17002_lists_what_is_held() {
    let mut rig = flying_with(two_stations());
    let listen = request(RequestedAccess::Request, LoiBitmap::LOI2);
    let listens = rig.send_as(1, 0, listen);
    assert_eq!(rig.end_as(1, listens), DONE);
    let land = landing(&rig, 9, 40.0);
    let ticket = held(&mut rig, land);
    let of_another = HeldCommandCancel {
        owner_id: Some(cucs(0)),
        ..HeldCommandCancel::default()
    };
    let refused = rig.send_as(1, 0, of_another.clone());
    assert_eq!(rig.end_as(1, refused), REFUSED);
    rig.stations[1].received.clear();
    let list = rig.send_as(
        1,
        0,
        GenericInformationRequestMessage {
            message_type: Some(HeldCommandState::ID),
            ..GenericInformationRequestMessage::default()
        },
    );
    assert_eq!(rig.end_as(1, list), DONE);
    rig.run(0.2);
    let listed = rig.stations[1].last(
        vehicle_id(0),
        HeldCommandState::ID,
        |message| match message {
            Message::HeldCommandState(state) => Some(state.clone()),
            _ => None,
        },
    );
    let listed = listed.expect("a 50022");
    assert_eq!(listed.held_state, Some(HeldState::Waiting));
    assert_eq!(listed.held_message_type, Some(2016));
    assert_eq!(rig.station().end(ticket), None);
    rig.done(of_another);
    assert_eq!(rig.end(ticket), REFUSED);
}

#[test]
fn what_cannot_be_held_is_refused_with_the_reason() {
    let mut rig = Rig::ready();
    let land = orders::mode(Mode::AutolandEngage);
    let time = |rig: &Rig, command: HoldCommand| {
        let valid_for = Some(300);
        at_time(
            rig,
            200.0,
            HoldCommand {
                valid_for,
                ..command
            },
        )
    };
    let good = time(&rig, hold(1, HoldCondition::Time, land.clone()));
    let late = time(&rig, hold(1, HoldCondition::Time, land.clone()));
    let cases = [
        (
            HoldCommand {
                held_command_number: None,
                ..good.clone()
            },
            "Held Command Number is missing",
        ),
        (
            HoldCommand {
                valid_for: None,
                ..good.clone()
            },
            "Valid For is missing",
        ),
        (
            HoldCommand {
                valid_for: Some(90_000),
                ..good.clone()
            },
            "Valid For 90000 s, expected 1 to 86400",
        ),
        (
            HoldCommand {
                valid_for: Some(2),
                ..late
            },
            "Valid For ends before",
        ),
        (
            HoldCommand {
                condition_time: None,
                ..good.clone()
            },
            "Condition Time is missing",
        ),
        (
            HoldCommand {
                condition_time: Some(TimeStamp(1)),
                ..good.clone()
            },
            "Condition Time is before Time Stamp",
        ),
        (
            HoldCommand {
                hold_condition: None,
                ..good.clone()
            },
            "Hold Condition is missing",
        ),
        (
            HoldCommand {
                hold_condition: Some(HoldCondition::Unknown(9)),
                ..good.clone()
            },
            "Hold Condition 9, expected 1 to 7",
        ),
        (
            HoldCommand {
                hold_kind: Some(HoldKind::Unknown(7)),
                ..good.clone()
            },
            "Hold Kind 7, expected 0 or 1",
        ),
        (
            HoldCommand {
                held_message_data: Some(Text::new("0x")),
                ..good.clone()
            },
            "is not hexadecimal",
        ),
        (
            HoldCommand {
                held_message_data: Some(Text::new("ff")),
                ..good.clone()
            },
            "Held Message Data: ",
        ),
        (
            hold(1, HoldCondition::BatteryBelow, land.clone()),
            "Condition Percent is missing",
        ),
        (
            HoldCommand {
                condition_percent: Some(101),
                ..hold(1, HoldCondition::BatteryBelow, land.clone())
            },
            "Condition Percent 101, expected 1 to 100",
        ),
        (
            hold(1, HoldCondition::WaypointPassed, land.clone()),
            "Condition Number is missing",
        ),
        (
            HoldCommand {
                condition_number: Some(8),
                ..hold(1, HoldCondition::AreaLeft, land.clone())
            },
            "no area 8 has been received",
        ),
        (
            HoldCommand {
                condition_number: Some(8),
                ..hold(1, HoldCondition::CommandDone, land.clone())
            },
            "no held command 8 of this CUCS",
        ),
        (
            HoldCommand {
                condition_radius: Some(5.0),
                ..hold(1, HoldCondition::AreaEntered, land.clone())
            },
            "a circle needs Condition Latitude, Longitude and Radius",
        ),
        (
            time(
                &rig,
                hold(1, HoldCondition::Time, UaStickCommand::default()),
            ),
            "cannot be held",
        ),
        (
            time(
                &rig,
                hold(1, HoldCondition::Time, orders::request_control()),
            ),
            "cannot be held",
        ),
        (
            time(&rig, hold(1, HoldCondition::Time, good)),
            "cannot be held",
        ),
    ];
    for (command, why) in cases {
        assert_eq!(
            rig.carry_out(command.clone()),
            REFUSED,
            "{why}: {command:?}"
        );
        rig.run(0.3);
        assert!(
            rig.station().has_alert(why),
            "{why}: {:?}",
            rig.station().alerts()
        );
        // Their reasons are sent a few a second.
        rig.run(1.0);
    }
    assert!(states(&rig, 0, 1).is_empty());
}

#[test]
fn the_loss_action_of_the_vsm_is_not_fought_by_a_held_command() {
    let mut rig = Rig::ready_with(Setup {
        tables: "[authority]\non_loss = \"rtl\"\n",
        ..Setup::default()
    });
    let lost = contingency(hold(1, HoldCondition::LinkLost, orders::mode(Mode::Loiter)));
    assert_eq!(rig.carry_out(lost), REFUSED);
    rig.run(0.3);
    assert!(
        rig.station()
            .has_alert("authority.on_loss is flown when its CUCS is lost")
    );
}

#[test]
fn no_more_are_held_than_there_is_room_for_and_a_number_is_held_once() {
    let mut rig = Rig::ready();
    for number in 1..=16 {
        let command = landing(&rig, number, 50.0);
        held(&mut rig, command);
    }
    let again = landing(&rig, 3, 50.0);
    assert_eq!(rig.carry_out(again), REFUSED);
    let more = landing(&rig, 17, 50.0);
    assert_eq!(rig.carry_out(more), REFUSED);
    rig.run(0.3);
    for why in [
        "number 3 is held already",
        "16 commands of this CUCS are held",
    ] {
        assert!(rig.station().has_alert(why), "{:?}", rig.station().alerts());
    }
    rig.done(HeldCommandCancel::default());
    let next = landing(&rig, 3, 50.0);
    held(&mut rig, next);
}

#[test]
fn one_without_the_right_for_the_command_in_it_holds_nothing() {
    let mut rig = Rig::new(Setup::default());
    rig.run(9.0);
    let levels = LoiBitmap::LOI2.union(LoiBitmap::LOI4);
    rig.done(request(RequestedAccess::Request, levels));
    // A launch needs LOI 5.
    let launch = at_time(
        &rig,
        3.0,
        hold(1, HoldCondition::Time, orders::launch(20.0)),
    );
    assert_eq!(rig.carry_out(launch), REFUSED);
    rig.run(5.0);
    assert!(!rig.truth().armed);
    let loiter = at_time(
        &rig,
        3.0,
        hold(1, HoldCondition::Time, orders::mode(Mode::Loiter)),
    );
    held(&mut rig, loiter);
}

#[test]
fn a_full_disk_holds_nothing_and_carries_out_nothing_that_it_could_do_twice() {
    let mut rig = flying();
    let land = landing(&rig, 1, 5.0);
    let first = held(&mut rig, land);
    rig.store.full = Some("held");
    let second = landing(&rig, 2, 5.0);
    assert_eq!(rig.carry_out(second), REFUSED);
    rig.run(8.0);
    assert_eq!(rig.station().end(first), REFUSED);
    assert_eq!(rig.truth().mode, Px4::Loiter);
    assert!(rig.station().has_alert("held commands cannot be stored"));
    rig.store.full = None;
    rig.run(3.0);
    assert!(rig.station().has_alert("held commands are stored again"));
}
