//! Which commands are answered, how, and which are not.

use crate::vehicle::support::*;
use mavlink::dialects::development as mav;
use mavlink::dialects::development::MavMessage;
use mavlink_link::service::{Node, command};

#[test]
fn unused_parameters_must_be_unset() {
    let mut flight = Flight::ready();
    assert_eq!(
        flight.command(
            22,
            &[15.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, f32::NAN]
        ),
        Some(2)
    );
    assert_eq!(
        flight.command(400, &[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0]),
        Some(2)
    );
    assert_eq!(
        flight.command(176, &[1.0, 4.0, 3.0, 0.0, 0.0, 0.0, 1.0]),
        Some(2)
    );
    assert_eq!(
        flight.command(176, &[1.0, 4.0, 3.0, f32::NAN, 0.0, f32::NAN, 0.0]),
        Some(0)
    );
    assert!(!flight.vehicle.truth().armed);
}

#[test]
fn what_px4_does_not_have_is_unsupported_and_a_missing_device_is_silent() {
    let mut flight = Flight::ready();
    for command in [193, 224, 519, 520, 115, 183, 252, 2000, 31_999, 65_000] {
        assert_eq!(flight.command(command, &[]), Some(3), "{command}");
    }
    for command in [203, 205, 1000] {
        assert_eq!(flight.command(command, &[]), None, "{command}");
    }
    assert_eq!(flight.command(246, &[1.0]), Some(2));
    assert_eq!(flight.command(246, &[0.0]), Some(0));
}

#[test]
fn a_command_for_somebody_else_is_not_answered() {
    let mut flight = Flight::ready();
    let ask = |system, component| {
        let to = Node::new(system, component);
        command::long(to, mav::MavCmd::MAV_CMD_REQUEST_MESSAGE, [148.0])
    };
    for ((system, component), answered) in [
        ((7, 1), false),
        ((1, 55), false),
        ((0, 0), true),
        ((1, 0), true),
        ((1, 1), true),
    ] {
        let mark = flight.received.len();
        flight.send(&ask(system, component));
        flight.run(0.05);
        let acks = flight.received[mark..]
            .iter()
            .filter(
                |(_, m)| matches!(m, MavMessage::COMMAND_ACK(a) if a.target_system == GCS.system),
            )
            .count();
        assert_eq!(acks, usize::from(answered), "{system}/{component}");
    }
    // Its own command, reflected, would come from its own ids: ignored.
    let mark = flight.received.len();
    flight.vehicle.handle_message(Node::new(1, 1), &ask(1, 1));
    flight.run(0.05);
    assert!(
        !flight.received[mark..]
            .iter()
            .any(|(_, m)| matches!(m, MavMessage::COMMAND_ACK(_)))
    );
}

#[test]
fn a_flood_of_commands_loses_most_answers_and_a_slow_sender_none() {
    let mut flight = Flight::ready();
    let ask = command::long(
        Node::new(1, 1),
        mav::MavCmd::MAV_CMD_REQUEST_MESSAGE,
        [148.0],
    );
    let acks = |flight: &Flight, mark: usize| {
        flight.received[mark..]
            .iter()
            .filter(|(_, m)| matches!(m, MavMessage::COMMAND_ACK(_)))
            .count()
    };
    let mark = flight.received.len();
    for _ in 0..200 {
        flight.send(&ask);
    }
    flight.run(1.0);
    let got = acks(&flight, mark);
    assert!((4..=40).contains(&got), "{got}");
    let mark = flight.received.len();
    for _ in 0..200 {
        flight.send(&ask);
        flight.run(0.02);
    }
    flight.run(0.1);
    assert_eq!(acks(&flight, mark), 200);
}

#[test]
fn messages_are_given_on_request() {
    let mut flight = Flight::ready();
    assert_eq!(flight.command(512, &[148.0]), Some(0));
    let version = flight.last(|m| match m {
        MavMessage::AUTOPILOT_VERSION(v) => Some(v.clone()),
        _ => None,
    });
    let version = version.unwrap();
    assert_eq!(version.flight_sw_version, 0x0112_0080);
    assert_eq!(version.capabilities.bits(), 0xe8ff);
    assert_eq!(flight.command(512, &[300.0]), Some(0));
    assert_eq!(flight.command(512, &[99_999.0]), Some(2));
}

#[test]
fn message_intervals_are_changed_and_reported() {
    let mut flight = Flight::ready();
    let rate = |flight: &mut Flight| {
        let mark = flight.received.len();
        flight.run(4.0);
        flight.received[mark..]
            .iter()
            .filter(|(_, m)| matches!(m, MavMessage::ATTITUDE(_)))
            .count()
    };
    assert!((198..=202).contains(&rate(&mut flight)));
    assert_eq!(flight.command(511, &[30.0, 500_000.0]), Some(0));
    assert!((7..=9).contains(&rate(&mut flight)));
    assert_eq!(flight.command(511, &[30.0, -1.0]), Some(0));
    assert_eq!(rate(&mut flight), 0);
    assert_eq!(flight.command(511, &[12_345.0, 100_000.0]), Some(4));
    assert_eq!(flight.command(510, &[33.0]), Some(0));
    let interval = flight.last(|m| match m {
        MavMessage::MESSAGE_INTERVAL(i) => Some((i.message_id, i.interval_us)),
        _ => None,
    });
    assert_eq!(interval, Some((33, 20_000)));
}

#[test]
fn parameters_are_stored_as_they_come() {
    let mut flight = Flight::ready();
    let set = |name: &str, value: f32, kind| {
        MavMessage::PARAM_SET(mav::PARAM_SET_DATA {
            param_value: value,
            target_system: 1,
            target_component: 1,
            param_id: name.into(),
            param_type: kind,
        })
    };
    use mav::MavParamType::{MAV_PARAM_TYPE_INT32 as INT, MAV_PARAM_TYPE_REAL32 as REAL};
    flight.send(&set("NAV_DLL_ACT", f32::from_bits(99), INT));
    flight.send(&set("NAV_DLL_ACT", 1.0, REAL));
    flight.send(&set("NO_SUCH_PARAM", 1.0, REAL));
    let errors: Vec<_> = flight
        .received
        .iter()
        .filter_map(|(_, m)| match m {
            MavMessage::PARAM_ERROR(e) => Some(e.error as u32),
            _ => None,
        })
        .collect();
    assert_eq!(errors, [7, 1]);
    assert_eq!(flight.vehicle.params().int(px4_sim::Param::NAV_DLL_ACT), 99);
}
