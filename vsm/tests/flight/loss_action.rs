//! What is configured for a lost controller is flown until the vehicle shows it, or something that brings it home.

use std::time::Duration;

use kit::bridge::{Rig, Setup, orders};
use mavlink_link::dialect::{MANUAL_CONTROL_DATA, MavCmd, MavMessage};
use mavlink_link::service::{Node, command};
use px4_sim::Mode as Px4;
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, RouteType};
use stanag_msgs::messages::UaRoute;
use stanag_msgs::{Message, Text};

/// In the air, by a station that has sent heartbeats and sends them no more; B only listens.
fn abandoned(tables: &'static str, plan: Vec<Message>) -> Rig {
    let mut rig = Rig::ready_with(Setup {
        tables,
        stations: 2,
        ..Setup::default()
    });
    let listen = stanag_msgs::messages::CucsAuthorisationRequest {
        requested_handover_loi: Some(stanag_msgs::enums::LoiBitmap::LOI2),
        ..orders::request_control()
    };
    let ticket = rig.send_as(1, 0, listen);
    rig.until(5.0, |rig| rig.stations[1].end(ticket).is_some());
    if !plan.is_empty() {
        rig.send_plan(orders::square());
        rig.send_plan(plan);
        rig.done(orders::load());
    }
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Loiter));
    rig.stations[0].heartbeats = true;
    rig.run(2.0);
    rig.stations[0].heartbeats = false;
    rig
}

fn contingency(first_north_m: f64) -> Vec<Message> {
    let route = UaRoute {
        route_id: Some(Text::new("CA")),
        route_type: Some(RouteType::ContingencyA),
        ..orders::route(7)
    };
    vec![
        route.into(),
        orders::waypoint(7, 8, first_north_m, 0.0, 30.0).into(),
        orders::waypoint(8, 0, first_north_m, 50.0, 30.0).into(),
    ]
}

fn has_alert_with(text: &'static str) -> impl Fn(&Rig) -> bool {
    move |rig| rig.stations[1].has_alert(text)
}

#[test]
fn a_contingency_route_is_flown() {
    let mut rig = abandoned(
        "[authority]\non_loss = \"contingency\"\n",
        contingency(60.0),
    );
    assert!(
        rig.until(30.0, |rig| rig.truth().mode == Px4::Mission),
        "{:?}",
        rig.stations[1].alerts()
    );
    rig.run(20.0);
    assert!(!rig.stations[1].has_alert("does not fly contingency A"));
}

#[test]
fn a_contingency_route_that_cannot_be_flown_gives_way_to_the_return() {
    // Its first point is farther from home than the limits allow.
    let mut rig = abandoned(
        "[authority]\non_loss = \"contingency\"\n",
        contingency(20_000.0),
    );
    assert!(
        rig.until(40.0, |rig| rig.truth().mode == Px4::Rtl),
        "{:?}",
        rig.stations[1].alerts()
    );
    for text in ["attempt 2", "does not fly contingency A: commanding return"] {
        assert!(
            rig.stations[1].has_alert(text),
            "{text}: {:?}",
            rig.stations[1].alerts()
        );
    }
    rig.run(2.0);
    assert!(rig.stations[1].has_alert("the vehicle carries out the loss action"));
}

/// The upload of a contingency is refused, and tried again two seconds later: in between the vehicle holds.
fn between_two_attempts() -> Rig {
    let mut rig = abandoned(
        "[authority]\non_loss = \"contingency\"\n",
        contingency(20_000.0),
    );
    assert!(rig.until(40.0, has_alert_with("is lost")));
    rig.run(1.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
    rig
}

#[test]
fn a_contingency_that_a_restart_cuts_off_is_reported_and_gives_way_to_the_return() {
    let mut rig = between_two_attempts();
    rig.restart_bridge();
    let returns = rig.until(30.0, |rig| rig.truth().mode == Px4::Rtl);
    rig.run(3.0);
    let alerts = rig.stations[1].alerts();
    assert!(returns, "{alerts:?}");
    for text in [
        "the loss action (fly contingency A) was cut off by a restart of the VSM",
        "the vehicle only holds: commanding return",
        "the vehicle carries out the loss action",
    ] {
        assert!(rig.stations[1].has_alert(text), "{text}: {alerts:?}");
    }
}

#[test]
fn what_a_restart_cuts_off_is_taken_up_by_its_true_age_and_not_by_the_wall_clock() {
    // The bridge is away for a moment, while somebody sets the clock.
    for step_s in [-3_600.0, 3_600.0] {
        let mut rig = between_two_attempts();
        rig.clock.set_wall_step(step_s);
        rig.restart_bridge();
        let returns = rig.until(40.0, |rig| rig.truth().mode == Px4::Rtl);
        assert!(returns, "{step_s}: {:?}", rig.stations[1].alerts());
    }
    // Another node of a fleet continues, which stood by when the record was written.
    let mut rig = between_two_attempts();
    rig.boot += 1;
    rig.store.written_within = Some(Duration::from_secs(3));
    rig.restart_bridge();
    let returns = rig.until(40.0, |rig| rig.truth().mode == Px4::Rtl);
    assert!(returns, "{:?}", rig.stations[1].alerts());
    // The computer was off for a day, and begins with the time at which it was switched off: somebody may have put the vehicle on
    // hold since.
    let mut rig = between_two_attempts();
    rig.boot += 1;
    rig.restart_bridge();
    assert!(!rig.until(40.0, |rig| rig.truth().mode != Px4::Loiter));
    let alerts = rig.stations[1].alerts();
    for text in [
        "the loss action (fly contingency A) was cut off by a restart of the VSM",
        "nothing is commanded: how old the action is cannot be known",
    ] {
        assert!(rig.stations[1].has_alert(text), "{text}: {alerts:?}");
    }
}

#[test]
fn a_vehicle_that_is_silent_at_the_loss_is_brought_home_when_the_link_is_back() {
    let mut rig = abandoned("[authority]\non_loss = \"rtl\"\n", Vec::new());
    rig.run(4.0);
    rig.mav.faults.loss = 1.0;
    assert!(
        rig.until(20.0, has_alert_with("is lost")),
        "{:?}",
        rig.stations[1].alerts()
    );
    rig.run(1.0);
    rig.mav.faults.loss = 0.0;
    assert!(
        rig.until(30.0, |rig| rig.truth().mode == Px4::Rtl),
        "{:?}",
        rig.stations[1].alerts()
    );
}

#[test]
fn what_is_reported_of_a_loss_is_what_is_flown() {
    let mut rig = abandoned("[authority]\non_loss = \"contingency\"\n", Vec::new());
    assert!(
        rig.until(30.0, |rig| rig.truth().mode == Px4::Rtl),
        "{:?}",
        rig.stations[1].alerts()
    );
    assert!(
        rig.stations[1].has_alert("no contingency A is stored; commanding return"),
        "{:?}",
        rig.stations[1].alerts()
    );
    for wrong in ["commanding contingency A", "control has passed on"] {
        assert!(!rig.stations[1].has_alert(wrong), "{wrong}");
    }
}

#[test]
fn a_vehicle_on_the_ground_is_reported_as_flying_nothing() {
    let mut rig = Rig::ready_with(Setup {
        tables: "[authority]\non_loss = \"contingency\"\n",
        ..Setup::default()
    });
    rig.stations[0].heartbeats = true;
    rig.run(2.0);
    rig.stations[0].heartbeats = false;
    assert!(
        rig.until(20.0, |rig| rig.station().has_alert(
            "is lost, nobody controls the vehicle: vehicle is on the ground"
        )),
        "{:?}",
        rig.station().alerts()
    );
    rig.run(5.0);
    assert!(rig.truth().landed && !rig.truth().armed);
}

#[test]
fn the_main_route_is_flown_again_after_the_contingency() {
    let mut plan = orders::square();
    plan.extend(contingency(60.0));
    plan.push(orders::load().into());
    let mut rig = abandoned("[authority]\non_loss = \"contingency\"\n", plan);
    assert!(rig.until(30.0, |rig| rig.truth().mode == Px4::Mission));
    assert!(rig.stations[1].has_alert("commanding contingency A"));
    rig.done(orders::request_control());
    rig.done(orders::mode(Mode::Waypoint));
    let to = |rig: &Rig| {
        rig.station()
            .last(kit::bridge::vehicle_id(0), 4001, |m| match m {
                Message::FromToNextWaypointStates(states) => states.to_waypoint_number,
                _ => None,
            })
    };
    assert!(rig.until(5.0, |rig| to(rig) == Some(101)));
}

#[test]
fn who_takes_control_ends_what_was_flown_for_nobody() {
    let mut rig = abandoned(
        "[authority]\non_loss = \"contingency\"\n",
        contingency(20_000.0),
    );
    assert!(rig.until(40.0, has_alert_with("is lost")));
    let taken = rig.send_as(1, 0, orders::request_control());
    assert!(rig.until(5.0, |rig| rig.stations[1].end(taken).is_some()));
    let hold = rig.send_as(1, 0, orders::mode(Mode::Loiter));
    assert!(rig.until(20.0, |rig| rig.stations[1].end(hold).is_some()));
    assert_eq!(rig.stations[1].end(hold), Some(AckType::CarriedOut));
    rig.run(20.0);
    assert_eq!(rig.truth().mode, Px4::Loiter);
}

/// A pilot's radio control: sticks in the middle, and the mode POSCTL where it is `chosen`.
pub(crate) fn radio(rig: &mut Rig, chosen: bool) {
    let (radio, vehicle) = (Node::new(255, 190), rig.vehicles[0].vehicle_mut());
    let sticks = MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
        target: 1,
        z: 500,
        ..MANUAL_CONTROL_DATA::default()
    });
    vehicle.handle_message(radio, &sticks);
    if chosen {
        let posctl = command::long(Node::new(1, 1), MavCmd::MAV_CMD_DO_SET_MODE, [1.0, 3.0]);
        vehicle.handle_message(radio, &posctl);
    }
}

/// By radio control for so long.
fn fly_by_hand(rig: &mut Rig, seconds: f64) {
    for step in 0..(seconds * 10.0) as u32 {
        radio(rig, step == 5);
        rig.run(0.1);
    }
}

#[test]
fn a_pilot_who_has_the_vehicle_when_the_controller_is_lost_keeps_it() {
    let mut rig = abandoned("[authority]\non_loss = \"rtl\"\n", Vec::new());
    fly_by_hand(&mut rig, 20.0);
    assert!(
        rig.stations[1].has_alert("is lost, nobody controls the vehicle: the vehicle is in POSCTL"),
        "{:?}",
        rig.stations[1].alerts()
    );
    assert!(rig.stations[1].has_alert("no loss action is flown"));
    assert!(!rig.stations[1].has_alert("commanding return"));
    assert_eq!(rig.truth().mode, Px4::PosCtl);
}

#[test]
fn what_the_vehicle_does_already_is_not_announced_as_commanded() {
    let mut rig = abandoned("[authority]\non_loss = \"hold\"\n", Vec::new());
    assert!(rig.until(20.0, has_alert_with("is lost")));
    let text = "vehicle is in AUTO.LOITER already, nothing is commanded";
    assert!(
        rig.stations[1].has_alert(text),
        "{:?}",
        rig.stations[1].alerts()
    );
}

#[test]
fn a_station_is_not_silent_while_the_bridge_itself_stands_still() {
    let mut rig = abandoned("[authority]\non_loss = \"rtl\"\n", vec![]);
    rig.stations[0].heartbeats = true;
    rig.run(2.0);
    // Longer than all stages of a silence together. Its timers run before anything arrives.
    rig.freeze_bridge(30.0);
    rig.run(5.0);
    for text in ["no data from the controlling CUCS", "is lost"] {
        assert!(
            !rig.stations[1].has_alert(text),
            "{:?}",
            rig.stations[1].alerts()
        );
    }
    assert_eq!(rig.truth().mode, Px4::Loiter);
    rig.done(orders::mode(Mode::AutolandEngage));
    // One that falls silent meanwhile is lost later by as long.
    rig.stations[0].heartbeats = false;
    rig.freeze_bridge(30.0);
    rig.run(2.0);
    assert!(!rig.stations[1].has_alert("is lost"));
    assert!(rig.until(15.0, has_alert_with("is lost")));
}
