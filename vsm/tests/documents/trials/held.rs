//! Held commands: what they wait for, and what is carried out then.

use kit::bridge::{Rig, orders};
use kit::clock::START;
use px4_sim::HealthFaults;
use stanag_msgs::enums::{
    ContingencyAction, ContingencyCause, FlightPathControlMode as Mode, HoldCondition,
};
use stanag_msgs::messages::{Contingency, HeldCommandCancel, HoldCommand, ParameterSetCommand};
use stanag_msgs::{Bam32, MAX_DATAGRAM, Message, Text, TimeStamp};

use super::messages::loiter_there;
use super::scenes::{airborne, airborne_with_route, control, one};
use crate::scene::{Trial, send};

pub(super) fn held() -> Vec<Trial> {
    vec![
        trial!(
            one,
            control,
            send,
            at_a_time(),
            [
                "Held Command Number" = "2",
                "Held Message Type" = "50010" refused "refused where its data are none of this type",
                // MPC_XY_CRUISE = 7.
                "Held Message Data" = "\"064d50435f58595f43525549534500000000401c000000000000\"",
                "Hold Condition" = "9" refused "1 to 7",
                "Hold Kind" = "1",
                "Valid For" = "5" refused "refused where Condition Time is later",
                "Condition Time" = "+5000",
            ]
        ),
        trial!(
            one,
            airborne_with_route,
            then_fly,
            hold(1, HoldCondition::WaypointPassed, |hold| {
                hold.condition_number = Some(101);
            }),
            ["Condition Number" = "103"]
        ),
        trial!(
            one,
            with_half_a_battery,
            then_wait,
            hold(1, HoldCondition::BatteryBelow, |hold| {
                hold.condition_percent = Some(40);
            }),
            ["Condition Percent" = "60"]
        ),
        trial!(
            one,
            airborne,
            then_go_there,
            circle(),
            [
                "Condition Latitude" = "+20000",
                "Condition Longitude" = "+20000",
                "Condition Radius" = "200.0",
            ]
        ),
        trial!(
            one,
            control,
            send,
            contingency(None),
            [
                "Contingency Cause" = "4",
                "Contingency Action" = "9" refused "1 to 5",
            ]
        ),
        trial!(
            one,
            control,
            send,
            contingency(Some(30)),
            ["Contingency Percent" = "40"]
        ),
        trial!(
            one,
            with_two_held,
            send,
            HeldCommandCancel {
                held_command_number: Some(1),
                ..HeldCommandCancel::default()
            },
            [
                "Held Command Number" = "2",
                "Owner ID" = "5" refused "refused where none waits",
            ]
        ),
    ]
}

/// A 50020 that sets a parameter.
fn hold(number: u16, condition: HoldCondition, with: fn(&mut HoldCommand)) -> HoldCommand {
    let command: Message = ParameterSetCommand {
        parameter_name: Some(Text::new("MPC_XY_CRUISE")),
        commanded_value: Some(6.0),
        ..ParameterSetCommand::default()
    }
    .into();
    let mut data = [0; MAX_DATAGRAM];
    let length = command.encode_data(&mut data).expect("it is encoded");
    let hex: String = (data[..length].iter())
        .map(|byte| format!("{byte:02x}"))
        .collect();
    let mut hold = HoldCommand {
        held_command_number: Some(number),
        held_message_type: Some(command.id()),
        held_message_data: Some(Text::new(&hex)),
        hold_condition: Some(condition),
        valid_for: Some(120),
        ..HoldCommand::default()
    };
    with(&mut hold);
    hold
}

fn at_a_time() -> HoldCommand {
    hold(1, HoldCondition::Time, |hold| {
        // The scene is ready before that.
        let at_s = START.as_secs() + 25;
        hold.condition_time = Some(TimeStamp::from_unix_ms(at_s * 1_000));
    })
}

fn circle() -> HoldCommand {
    hold(1, HoldCondition::AreaEntered, |hold| {
        let (latitude, longitude) = orders::place(60.0, 0.0);
        hold.condition_latitude = Some(Bam32::from_degrees(latitude));
        hold.condition_longitude = Some(Bam32::from_degrees(longitude));
        hold.condition_radius = Some(20.0);
    })
}

fn contingency(percent: Option<u8>) -> Contingency {
    Contingency {
        contingency_cause: Some(ContingencyCause::Battery),
        contingency_action: Some(ContingencyAction::Return),
        contingency_percent: percent,
        ..Contingency::default()
    }
}

fn with_half_a_battery(rig: &mut Rig) {
    control(rig);
    rig.vehicles[0]
        .vehicle_mut()
        .set_health_faults(HealthFaults {
            battery: Some(50),
            ..HealthFaults::default()
        });
    rig.run(3.0);
}

fn with_two_held(rig: &mut Rig) {
    control(rig);
    for number in [1, 2] {
        let low = hold(number, HoldCondition::BatteryBelow, |hold| {
            hold.condition_percent = Some(1);
        });
        let ticket = rig.send(low);
        rig.run(0.3);
        rig.stations[0].give_up(ticket);
    }
}

fn then_wait(rig: &mut Rig, message: &Message) {
    let _ = rig.send(message.clone());
    rig.run(5.0);
}

fn then_fly(rig: &mut Rig, message: &Message) {
    then_wait(rig, message);
    send(rig, &orders::mode(Mode::Waypoint).into());
    rig.run(20.0);
}

fn then_go_there(rig: &mut Rig, message: &Message) {
    then_wait(rig, message);
    send(rig, &loiter_there(60.0, 0.0).into());
    rig.run(20.0);
}
