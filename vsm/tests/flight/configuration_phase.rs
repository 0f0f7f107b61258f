//! A ground station asks what the vehicle is, and builds its commands of the answers alone.

use std::collections::BTreeMap;

use kit::bridge::{Rig, Setup, VSM, orders, vehicle_id};
use serde_json::{Map, Value, json};
use stanag_msgs::enums::{
    AckType, ConfigRequestType, EnumIndexEnable, FlightPathControlMode as Mode, LoiterType,
};
use stanag_msgs::json::encode_line;
use stanag_msgs::messages::{
    FieldConfigurationRequest, Heartbeat, LoiterConfiguration, MessageParameterAvailability,
    ParameterSetCommand, UaStickCommand, VehicleOperatingModeCommand,
};
use stanag_msgs::{Message, Scaled, Text, table};

/// What the answers report of one field, in steps on the wire.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Reported {
    default: Option<i64>,
    low: Option<i64>,
    high: Option<i64>,
}

/// All that a station has received: by message and field, from 1.
type Screen = BTreeMap<(u32, u8), Reported>;

fn ask(kind: ConfigRequestType) -> FieldConfigurationRequest {
    FieldConfigurationRequest {
        vsm_id: Some(VSM),
        request_type: Some(kind),
        ..FieldConfigurationRequest::default()
    }
}

fn screen(rig: &Rig) -> Screen {
    let mut screen = Screen::new();
    for (_, _, message) in &rig.station().received {
        let (place, reported) = match message {
            Message::FieldConfigurationIntegerResponse(m) => (
                (m.requested_message, m.requested_field),
                Reported {
                    default: m.default_value.map(i64::from),
                    low: m.min_value.map(i64::from),
                    high: m.max_value.map(i64::from),
                },
            ),
            Message::FieldConfigurationUnsignedResponse(m) => (
                (m.requested_message, m.requested_field),
                Reported {
                    default: m.default_value.map(i64::from),
                    low: m.min_value.map(i64::from),
                    high: m.max_value.map(i64::from),
                },
            ),
            Message::FieldConfigurationEnumeratedResponse(m) => (
                (m.requested_message, m.requested_field),
                Reported {
                    default: m.default_value.map(i64::from),
                    ..Reported::default()
                },
            ),
            _ => continue,
        };
        if let (Some(message), Some(field)) = place {
            screen.insert((message, field), reported);
        }
    }
    screen
}

/// A message of nothing but what the screen shows, with `pick` of each field, and then `own` values.
fn build(
    screen: &Screen,
    message: u16,
    pick: impl Fn(&Reported) -> Option<i64>,
    own: &[(&str, i64)],
) -> Message {
    let info = table::message(message).expect("a message of the table");
    let mut fields = Map::new();
    for field in info.fields {
        let reported = screen.get(&(message.into(), field.bit + 1));
        if let Some(value) = reported.and_then(&pick) {
            fields.insert(field.name.to_owned(), Value::from(value));
        }
    }
    for (name, value) in own {
        fields.insert((*name).to_owned(), Value::from(*value));
    }
    let line = json!({ "id": message, "source": 0, "destination": 0, "fields": fields });
    let hex = encode_line(&line.to_string(), true).expect("values within their fields");
    let bytes: Vec<u8> = (0..hex.len())
        .step_by(2)
        .map(|at| u8::from_str_radix(&hex[at..at + 2], 16).expect("hexadecimal"))
        .collect();
    let frame = stanag_msgs::frames(&bytes).next().expect("a message");
    Message::decode(message, frame.expect("a sound one").data).expect("of the table")
}

fn configured() -> (Rig, Screen) {
    let mut rig = Rig::ready();
    rig.done(ask(ConfigRequestType::Loi4));
    let screen = screen(&rig);
    (rig, screen)
}

#[test]
fn a_launch_a_loiter_and_a_route_are_built_from_the_answers_alone() {
    let (mut rig, screen) = configured();
    let start = |reported: &Reported| reported.default;
    let launch = build(
        &screen,
        2016,
        start,
        &[("Select Flight Path Control Mode", 21)],
    );
    rig.done(launch);
    assert!(rig.until(30.0, |rig| rig.truth().position.d < -1.0));
    let loiter = build(&screen, 2016, start, &[]);
    rig.done(loiter);
    for message in [13001, 13002, 13000] {
        let end = rig.carry_out(build(&screen, message, start, &[]));
        assert_eq!(
            end,
            Some(AckType::CarriedOut),
            "{message}: {:?}",
            rig.station().alerts()
        );
    }
}

#[test]
fn the_ends_of_all_ranges_are_flown_and_a_step_beyond_is_refused() {
    let (mut rig, screen) = configured();
    let bounded: Vec<(u8, Reported)> = screen
        .iter()
        .filter(|((message, field), reported)| {
            // Numbers of waypoints make no route of one point.
            *message == 13002 && reported.high.is_some() && ![2, 11].contains(field)
        })
        .map(|((_, field), reported)| (*field, *reported))
        .collect();
    assert!(bounded.len() >= 4, "{bounded:?}");
    let mut load = |route: Message| {
        for message in [
            build(&screen, 13001, |reported| reported.default, &[]),
            route,
        ] {
            rig.done(message);
        }
        rig.carry_out(build(&screen, 13000, |reported| reported.default, &[]))
    };
    let numbers = [("Waypoint Number", 1), ("Next Waypoint", 0)];
    for pick in [
        |reported: &Reported| reported.high.or(reported.default),
        |reported: &Reported| reported.low.or(reported.default),
    ] {
        let route = build(&screen, 13002, pick, &numbers);
        assert_eq!(load(route), Some(AckType::CarriedOut));
    }
    let info = table::message(13002).expect("a message of the table");
    for (field, reported) in bounded {
        let name = info.fields[usize::from(field) - 1].name;
        // A square within the circle of the limits: its corner is not its edge.
        if name.contains("tude or Relative") {
            continue;
        }
        let beyond = [(name, reported.high.expect("bounded") + 1)];
        let route = build(&screen, 13002, |reported| reported.default, &beyond);
        assert_eq!(
            load(route),
            Some(AckType::Refused),
            "{name} beyond {reported:?}"
        );
    }
}

#[test]
fn the_answers_are_of_this_vehicle() {
    let (_, screen) = configured();
    // MPC_XY_VEL_MAX 12 m/s and MPC_XY_CRUISE 5 m/s in steps of 0.5.
    let speed = screen[&(2016, 13)];
    assert_eq!((speed.default, speed.high), (Some(10), Some(24)));
    // NAV_LOITER_RAD 80 m in steps of 1.5.
    assert_eq!(screen[&(2017, 3)].default, Some(53));
}

#[test]
fn modes_that_come_and_go_are_reported_to_those_that_requested_them() {
    let (mut rig, _) = configured();
    // Steering, a wave-off and a launch.
    const CHANGING: [u8; 3] = [15, 20, 21];
    let shows = |rig: &mut Rig, within_s, expected: &[u8]| {
        let so = rig.until(within_s, |rig| available(rig, &CHANGING) == expected);
        assert!(so, "{:?} {expected:?}", available(rig, &CHANGING));
    };
    // What is reported as unavailable is refused.
    let refused = |rig: &mut Rig, mode| {
        assert_eq!(rig.carry_out(orders::mode(mode)), Some(AckType::Refused));
    };
    shows(&mut rig, 1.0, &[21]);
    refused(&mut rig, Mode::Autopilot);
    refused(&mut rig, Mode::AutolandWaveOff);
    rig.done(orders::launch(10.0));
    shows(&mut rig, 10.0, &[15]);
    refused(&mut rig, Mode::AutolandWaveOff);
    rig.done(orders::mode(Mode::AutolandEngage));
    shows(&mut rig, 3.0, &[15, 20]);
    shows(&mut rig, 60.0, &[21]);
}

/// Those of these modes whose last 44003 has reported them as available.
fn available(rig: &Rig, modes: &[u8]) -> Vec<u8> {
    let enable = |mode: u8| {
        let mut latest = rig.station().received.iter().rev();
        latest.find_map(|(_, _, message)| match message {
            Message::MessageParameterAvailability(MessageParameterAvailability {
                reported_message: Some(2016),
                reported_enumerated_index: Some(index),
                enumerated_index_enable,
                ..
            }) if *index == mode => *enumerated_index_enable,
            _ => None,
        })
    };
    let modes = modes.iter().copied();
    modes
        .filter(|mode| enable(*mode) == Some(EnumIndexEnable::Available))
        .collect()
}

#[test]
fn a_wing_on_the_ground_is_offered_no_route_before_its_launch() {
    let mut rig = Rig::ready_with(Setup {
        vehicles: vec![px4_sim::Config {
            airframe: px4_sim::Airframe::Plane,
            ..px4_sim::Config::default()
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
    rig.done(ask(ConfigRequestType::Loi4));
    rig.run(2.0);
    assert_eq!(available(&rig, &[11, 21]), [21]);
    let early = rig.carry_out(orders::mode(Mode::Waypoint));
    assert_eq!(early, Some(AckType::Refused));
    rig.take_off(50.0);
    assert_eq!(available(&rig, &[11, 21]), [11]);
}

#[test]
fn manual_flight_is_offered_only_where_the_vehicle_takes_sticks() {
    let mut rig = Rig::ready_with(Setup {
        vehicles: vec![px4_sim::Config {
            // A remote control only.
            params: vec![(px4_sim::Param::COM_RC_IN_MODE, 0.0)],
            ..px4_sim::Config::default()
        }],
        ..Setup::default()
    });
    rig.done(ask(ConfigRequestType::Loi4));
    rig.run(1.0);
    assert!(available(&rig, &[2]).is_empty());
    rig.send_once(UaStickCommand::default());
    let by_hand = rig.carry_out(orders::mode(Mode::FlightDirector));
    assert_eq!(by_hand, Some(AckType::Refused));
    assert!(rig.station().has_alert("COM_RC_IN_MODE is 0"));
    // Whoever sets it, here the station itself.
    rig.done(ParameterSetCommand {
        parameter_name: Some(Text::new("COM_RC_IN_MODE")),
        commanded_value: Some(1.0),
        ..ParameterSetCommand::default()
    });
    assert!(rig.until(2.0, |rig| available(rig, &[2]) == [2]));
}

#[test]
fn no_grant_is_needed_and_every_level_ends_with_41005() {
    let mut rig = Rig::new(Setup::default());
    // It proves its address first.
    rig.send_once(Heartbeat::default());
    rig.run(9.0);
    use ConfigRequestType as T;
    for kind in [T::Loi2, T::Loi3, T::Loi4, T::Loi5, T::DataLink] {
        let before = rig.station().received.len();
        rig.done(ask(kind));
        rig.run(0.1);
        let complete = |message: &Message| matches!(message, Message::ConfigurationComplete(_));
        let received = &rig.station().received[before..];
        assert_eq!(received.iter().filter(|(_, _, m)| complete(m)).count(), 1);
        assert!(received.iter().all(|(_, from, _)| *from == vehicle_id(0)));
    }
    let none = FieldConfigurationRequest::default();
    assert_eq!(rig.carry_out(none), Some(AckType::Refused));
}

#[test]
fn a_silent_vehicle_is_answered_for_from_the_configuration() {
    let mut rig = Rig::new(Setup {
        mav: kit::bridge::Faults {
            loss: 1.0,
            ..kit::bridge::Faults::NONE
        },
        ..Setup::default()
    });
    rig.run(5.0);
    rig.done(ask(ConfigRequestType::Loi4));
    let speed = screen(&rig)[&(2016, 13)];
    assert_eq!((speed.default, speed.high), (None, Some(200)));
}

#[test]
fn nothing_is_answered_where_provisional_layouts_are_off() {
    let mut rig = Rig::new(Setup {
        dli_keys: "provisional = \"off\"",
        ..Setup::default()
    });
    rig.send_once(Heartbeat::default());
    rig.run(5.0);
    let end = rig.carry_out(ask(ConfigRequestType::Loi4));
    assert_eq!(end, Some(AckType::Refused));
    assert!(rig.station().has_alert("dli.provisional is off"));
}

/// The 44000 and 44002 that a station has received since: message, field, value.
fn forced(rig: &Rig, station: usize, mark: usize) -> Vec<(u16, u8, i32)> {
    let received = rig.stations[station].received[mark..].iter();
    received
        .filter_map(|(_, _, message)| match message {
            Message::FieldChangeIntegerCommand(m) => {
                Some((m.requested_message?, m.requested_field?, m.commanded_value?))
            }
            Message::FieldChangeEnumeratedCommand(m) => Some((
                m.requested_message?,
                m.requested_field?,
                m.commanded_enumeration_index_value?,
            )),
            _ => None,
        })
        .collect()
}

#[test]
fn what_another_station_or_the_vehicle_sets_is_reported_to_those_that_requested_it() {
    let mut rig = Rig::ready_with(Setup {
        stations: 3,
        ..Setup::default()
    });
    for station in [0, 1] {
        let ticket = rig.send_as(station, 0, ask(ConfigRequestType::Loi4));
        assert_eq!(rig.end_as(station, ticket), Some(AckType::CarriedOut));
    }
    rig.run(1.0);
    let marks: Vec<usize> = rig.stations.iter().map(|one| one.received.len()).collect();
    let circle = LoiterConfiguration {
        loiter_type: Some(LoiterType::Circular),
        loiter_radius: Some(Scaled::saturating_from_si(60.0)),
        ..LoiterConfiguration::default()
    };
    rig.done(circle);
    let setting = VehicleOperatingModeCommand {
        altimeter_setting: Some(Scaled::saturating_from_si(101_820.0)),
        ..orders::mode(Mode::Loiter)
    };
    rig.done(setting);
    rig.run(1.0);
    // Of its own command the station knows; who has not requested it receives nothing.
    let values = [(2017, 2, 1), (2017, 3, 40), (2016, 16, 10_182)];
    assert_eq!(forced(&rig, 1, marks[1]), values);
    assert_eq!(forced(&rig, 0, marks[0]), []);
    assert_eq!(forced(&rig, 2, marks[2]), []);
    // The same once more is no change.
    let mark = rig.stations[1].received.len();
    let setting = VehicleOperatingModeCommand {
        altimeter_setting: Some(Scaled::saturating_from_si(101_820.0)),
        ..orders::mode(Mode::Loiter)
    };
    rig.done(setting);
    assert_eq!(forced(&rig, 1, mark), []);
    // A mode that the vehicle enters: 21, and then 12 by itself.
    rig.done(orders::launch(10.0));
    rig.run(20.0);
    let modes = forced(&rig, 1, mark);
    assert_eq!(modes, [(2016, 2, 21), (2016, 2, 12)]);
}

#[test]
fn a_radius_is_bounded_as_it_is_taken() {
    let (mut rig, screen) = configured();
    let reported = screen[&(2017, 3)].high.expect("a widest circle");
    let radius = |steps: i64| LoiterConfiguration {
        loiter_radius: Some(Scaled::from_raw(u16::try_from(steps).expect("it fits"))),
        ..LoiterConfiguration::default()
    };
    rig.done(radius(reported));
    assert_eq!(rig.carry_out(radius(reported + 1)), Some(AckType::Refused));
    assert_eq!(screen[&(13003, 4)].high, Some(reported));
}
