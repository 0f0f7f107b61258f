//! A vehicle that speaks operator control of MAVLink is taken by the VSM for as long as a CUCS controls it, and other
//! stations see that and are refused; one that does not is asked for nothing.

use kit::bridge::{Rig, Setup, orders};
use mavlink_link::dialect::MavCmd;
use mavlink_link::service::{Node, command};
use stanag_msgs::enums::{AckType, FlightPathControlMode as Mode, RequestedAccess};
use stanag_msgs::messages::CucsAuthorisationRequest;

const DONE: Option<AckType> = Some(AckType::CarriedOut);
/// Another ground station on the same vehicle.
const GROUND: Node = Node {
    system: 255,
    component: 190,
};

fn speaking() -> Setup {
    Setup {
        vehicles: vec![px4_sim::Config {
            operator_control: true,
            ..px4_sim::Config::default()
        }],
        ..Setup::default()
    }
}

fn command(rig: &mut Rig, command: MavCmd, params: [f32; 4]) {
    let command = command::long(Node::new(1, 1), command, params);
    rig.vehicles[0]
        .vehicle_mut()
        .handle_message(GROUND, &command);
}

/// The ground station asks for operator control.
fn ask(rig: &mut Rig) {
    command(
        rig,
        MavCmd::MAV_CMD_REQUEST_OPERATOR_CONTROL,
        [1.0, 0.0, 10.0, 255.0],
    );
}

fn owner(rig: &Rig) -> Option<u8> {
    let now = rig.now().mono;
    let status = rig.bridge.as_ref()?.status(String::new(), now);
    status.vehicles.first()?.operator_control
}

fn release(rig: &mut Rig) {
    let release = CucsAuthorisationRequest {
        requested_handover_access: Some(RequestedAccess::Relinquish),
        ..orders::request_control()
    };
    rig.done(release);
}

#[test]
fn operator_control_is_taken_with_control_and_let_go_with_it() {
    let mut rig = Rig::new(speaking());
    rig.run(9.0);
    assert_eq!(owner(&rig), Some(0), "nobody controls, nothing is taken");
    rig.done(orders::request_control());
    assert!(rig.until(3.0, |rig| owner(rig) == Some(245)));
    // Another station is refused, and the attempt is reported.
    let before = rig.vehicles[0].vehicle().counters();
    command(
        &mut rig,
        MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
        [1.0, 0.0, 0.0, 0.0],
    );
    rig.run(1.0);
    assert!(!rig.truth().armed);
    let after = rig.vehicles[0].vehicle().counters();
    assert!(after.commands_refused > before.commands_refused);
    rig.take_off(20.0);
    release(&mut rig);
    assert!(rig.until(3.0, |rig| owner(rig) == Some(0)));
}

#[test]
fn a_request_for_operator_control_is_reported_and_granted_once_control_is_released() {
    let mut rig = Rig::ready_with(speaking());
    assert!(rig.until(3.0, |rig| owner(rig) == Some(245)));
    ask(&mut rig);
    assert!(
        rig.until(3.0, |rig| rig
            .station()
            .has_alert("MAVLink system 255 requests operator control")),
        "{:?}",
        rig.station().alerts()
    );
    assert_eq!(owner(&rig), Some(245), "asking takes nothing");
    release(&mut rig);
    assert!(rig.until(3.0, |rig| owner(rig) == Some(0)));
    ask(&mut rig);
    assert!(rig.until(3.0, |rig| owner(rig) == Some(255)));
}

#[test]
fn what_another_station_owns_is_reported_and_a_command_is_refused_with_the_reason() {
    let mut rig = Rig::new(speaking());
    rig.run(9.0);
    ask(&mut rig);
    assert!(rig.until(3.0, |rig| owner(rig) == Some(255)));
    rig.done(orders::request_control());
    rig.run(1.0);
    assert!(
        rig.station()
            .has_alert("MAVLink system 255 has operator control of the vehicle"),
        "{:?}",
        rig.station().alerts()
    );
    let end = rig.carry_out(orders::mode(Mode::Loiter));
    assert_eq!(end, Some(AckType::Refused));
    assert!(rig.station().has_alert("no operator control"));
    // Its heartbeats have never come: the vehicle lets go of it, and the VSM has it.
    assert!(rig.until(15.0, |rig| owner(rig) == Some(245)));
    assert!(
        rig.station()
            .has_alert("no MAVLink system has operator control")
    );
    rig.done(orders::mode(Mode::Loiter));
}

#[test]
fn control_that_passes_on_between_stations_keeps_operator_control() {
    let mut rig = Rig::ready_with(Setup {
        stations: 2,
        ..speaking()
    });
    assert!(rig.until(3.0, |rig| owner(rig) == Some(245)));
    release(&mut rig);
    let taken = rig.send_as(1, 0, orders::request_control());
    assert_eq!(rig.end_as(1, taken), DONE);
    assert!(rig.until(4.0, |rig| owner(rig) == Some(245)));
}

#[test]
fn a_vehicle_that_does_not_report_it_gets_no_request() {
    let mut rig = Rig::ready();
    rig.run(5.0);
    assert_eq!(owner(&rig), None);
    let refused = rig.vehicles[0].vehicle().counters().commands_refused;
    assert_eq!(refused, 0, "no command that it does not know");
}

#[test]
fn a_lost_controller_leaves_operator_control_to_the_loss_action() {
    let mut rig = Rig::ready_with(Setup {
        tables: "[authority]\non_loss = \"rtl\"\n",
        ..speaking()
    });
    rig.take_off(20.0);
    rig.done(orders::mode(Mode::Loiter));
    rig.stations[0].heartbeats = true;
    rig.run(2.0);
    rig.stations[0].heartbeats = false;
    assert!(rig.until(3.0, |rig| owner(rig) == Some(245)));
    // Another system waits for the moment in which nobody has it.
    for _ in 0..3_000 {
        ask(&mut rig);
        rig.run(0.01);
        if rig.truth().mode == px4_sim::Mode::Rtl {
            break;
        }
    }
    assert_eq!(rig.truth().mode, px4_sim::Mode::Rtl, "{:?}", rig.log);
    assert!(
        !rig.station().has_alert("refused"),
        "{:?}",
        rig.station().alerts()
    );
    // Nobody controls it and nothing is commanded any more: then another may.
    assert!(rig.until(10.0, |rig| { owner(rig) == Some(0) }));
}
