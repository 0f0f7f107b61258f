//! What the table lists as sent, is sent, and nothing else is: every message that a station receives in all trials, and in a
//! flight that asks for everything, is held against it.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use mapping::status;
use mapping::support::{self, rows};
use mapping::telemetry::Telemetry;
use mavlink_link::dialect::{
    AUTOPILOT_VERSION_DATA, BATTERY_STATUS_DATA, GPS_RAW_INT_DATA, HIGHRES_IMU_DATA, MavMessage,
};
use px4_sim::{Airframe, HealthFaults};
use stanag_msgs::enums::{
    AckType, AreaPlanMode, CommandedEngineState, ConfigRequestType, FlightPathControlMode as Mode,
    HeadingCommandType, LoiterDirection, LoiterType, MissionPlanMode, PingTarget, RouteType,
    SpeedType, WaypointSpeedType,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, EngineCommand, FieldConfigurationRequest,
    GenericInformationRequestMessage, LoiterConfiguration, ParameterRequest, PingRequest,
    PositiveHandoverAuthorisationRequest, SubsystemStatusDetailRequest, SubsystemStatusRequest,
    UaLoiterWaypoint, UaPositionWaypoint, UaRoute, VehicleOperatingModeCommand,
    VehicleSpecificWaypoint,
};
use stanag_msgs::{Bam16, Bam32, Message, Scaled, Text, TimeStamp, table};

use super::scene::{altered, raw_fields};
use super::trials::messages::{areas, circle, corner, curve, look_there, paper_curve, sticks};
use super::trials::payload::two_payloads;
use super::trials::trials;
use kit::bridge::{Rig, Setup, VSM, cucs, orders};

#[test]
fn sent_fields_are_sent_and_no_others() {
    let mut seen: BTreeMap<u16, BTreeSet<String>> = BTreeMap::new();
    let seen = &mut seen;
    let mut keep_messages = |messages: &[Message]| {
        for message in messages {
            let fields = raw_fields(message);
            let kept = seen.entry(message.id()).or_default();
            kept.extend(fields.into_iter().map(|(name, _)| name));
        }
    };
    let received = |rig: &Rig| -> Vec<Message> {
        let received = rig.stations.iter().flat_map(|station| &station.received);
        received.map(|(_, _, message)| message.clone()).collect()
    };
    for trial in trials() {
        let mut rig = trial.prepared();
        (trial.act)(&mut rig, &(trial.base)());
        rig.run(1.0);
        keep_messages(&received(&rig));
    }
    keep_messages(&received(&everything(Airframe::Quad)));
    keep_messages(&received(&everything(Airframe::Plane)));
    keep_messages(&received(&services()));
    keep_messages(&received(&payload()));
    keep_messages(&received(&payload_at_a_waypoint()));
    keep_messages(&received(&controls()));
    keep_messages(&of_other_sensors());
    // 17000 is taken off by the stations: each of its fields is looked at there.
    let acknowledged = &table::message(17_000).expect("17000").fields;
    seen.insert(
        17_000,
        acknowledged
            .iter()
            .map(|field| field.name.to_owned())
            .collect(),
    );

    let mut faults = Vec::new();
    for (id, fields) in seen.iter() {
        let row = support::message(*id);
        for name in fields {
            let listed = row.is_some_and(|row| row.sent.iter().any(|(known, _)| known == name));
            if !listed {
                faults.push(format!("{id} {name} is sent, and not listed"));
            }
        }
    }
    for row in rows() {
        for (name, _) in row.sent {
            if !seen
                .get(&row.id)
                .is_some_and(|fields| fields.contains(*name))
            {
                faults.push(format!("{} {name} is listed, and not sent", row.id));
            }
        }
    }
    assert!(faults.is_empty(), "{faults:#?}");
}

/// A vehicle whose metadata describes its controls.
fn controls() -> Rig {
    let mut rig = Rig::ready_with(Setup {
        vehicles: vec![px4_sim::Config {
            events: true,
            ..px4_sim::Config::default()
        }],
        vehicle_keys: "[vehicle.controls]\nparameters = [\"MPC_XY_CRUISE\"]\n",
        ..Setup::default()
    });
    rig.run(10.0);
    rig.done(FieldConfigurationRequest {
        vsm_id: Some(VSM),
        request_type: Some(ConfigRequestType::Loi4),
        ..FieldConfigurationRequest::default()
    });
    rig.run(1.0);
    rig
}

/// A flight in which a station asks for all that there is.
fn everything(airframe: Airframe) -> Rig {
    let mut rig = Rig::ready_with(Setup {
        stations: 2,
        vehicles: vec![px4_sim::Config {
            airframe,
            // A landing is no part of what is asked for.
            params: vec![(px4_sim::Param::MIS_TKO_LAND_REQ, 0.0)],
            ..px4_sim::Config::default()
        }],
        ..Setup::default()
    });
    for kind in 1..=5 {
        for station in [0, 1] {
            let request = FieldConfigurationRequest {
                vsm_id: Some(VSM),
                request_type: Some(ConfigRequestType::from_raw(kind)),
                ..FieldConfigurationRequest::default()
            };
            let ticket = rig.send_as(station, 0, request);
            assert_eq!(rig.end_as(station, ticket), Some(AckType::CarriedOut));
        }
    }
    let circle = filled(
        LoiterConfiguration {
            loiter_type: Some(LoiterType::Circular),
            loiter_radius: Some(Scaled::saturating_from_si(60.0)),
            loiter_direction: Some(LoiterDirection::Clockwise),
            ..LoiterConfiguration::default()
        }
        .into(),
    );
    rig.done(circle);
    // Every field, also those that are only kept and given back.
    let waypoint = UaPositionWaypoint {
        waypoint_to_speed: Some(Scaled::saturating_from_si(11.0)),
        waypoint_speed_type: Some(WaypointSpeedType::Ground),
        ..orders::waypoint(1, 2, 150.0, 0.0, 30.0)
    };
    let loiter = UaLoiterWaypoint {
        waypoint_number: Some(2),
        waypoint_loiter_type: Some(LoiterType::Circular),
        loiter_duration: Some(5),
        speed_type: Some(SpeedType::Ground),
        loiter_speed: Some(Scaled::saturating_from_si(12.0)),
        loiter_radius: Some(Scaled::saturating_from_si(60.0)),
        ..UaLoiterWaypoint::default()
    };
    let transition = VehicleSpecificWaypoint {
        waypoint_number: Some(61),
        tag_type: Some(0),
        tag_data: Some(Text::new("TRANSITION HOVER")),
        ..VehicleSpecificWaypoint::default()
    };
    let contingency = UaRoute {
        route_id: Some(Text::new("B")),
        route_type: Some(RouteType::ContingencyB),
        ..orders::route(61)
    };
    rig.send_plan(vec![
        // Given back, and not flown.
        contingency.into(),
        orders::waypoint(61, 0, 300.0, 0.0, 30.0).into(),
        filled(transition.into()),
        filled(orders::route(1).into()),
        filled(waypoint.into()),
        orders::waypoint(2, 3, 200.0, 150.0, 30.0).into(),
        filled(loiter.into()),
        orders::waypoint(3, 0, 0.0, 150.0, 30.0).into(),
    ]);
    rig.done(orders::load());
    let named = CucsAuthorisationRequest {
        cucs_type: Some(1),
        cucs_subtype: Some(1),
        ..orders::request_control()
    };
    rig.done(named);
    for command in [CommandedEngineState::Start, CommandedEngineState::Stop] {
        let engine = EngineCommand {
            engine_command: Some(command),
            ..EngineCommand::default()
        };
        rig.done(engine);
        rig.done(request(3007));
    }
    rig.take_off(30.0);
    rig.send_once(sticks());
    // Reported only while sticks come.
    rig.done(request(3011));
    let altimeter = VehicleOperatingModeCommand {
        altimeter_setting: Some(Scaled::saturating_from_si(101_500.0)),
        ..orders::mode(Mode::Loiter)
    };
    rig.done(altimeter);
    let speed = VehicleOperatingModeCommand {
        commanded_speed: Some(Scaled::saturating_from_si(11.0)),
        ..orders::mode(Mode::Waypoint)
    };
    rig.done(speed);
    rig.run(6.0);
    for round in 0..2 {
        for row in rows().filter(|row| !row.sends.is_empty()) {
            // Those that are no report are refused.
            let _ = rig.carry_out(request(row.id));
        }
        rig.run(if round == 0 { 3.0 } else { 1.0 });
    }
    for mode in [MissionPlanMode::Download, MissionPlanMode::Load] {
        rig.done(orders::transfer(mode));
    }
    rig.done(ParameterRequest::default());
    if airframe == Airframe::Plane {
        // The one loiter that has a length and an axis.
        rig.done(LoiterConfiguration {
            loiter_type: Some(LoiterType::Figure8),
            loiter_length: Some(Scaled::saturating_from_si(300.0)),
            loiter_bearing: Some(Bam16::from_degrees(90.0)),
            ..LoiterConfiguration::default()
        });
    }
    // Places and altitudes that were commanded.
    let (latitude, longitude) = orders::place(80.0, 0.0);
    let loiter = VehicleOperatingModeCommand {
        loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
        loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
        commanded_speed: Some(Scaled::saturating_from_si(11.0)),
        ..orders::mode(Mode::Loiter)
    };
    let _ = rig.carry_out(loiter);
    rig.run(2.0);
    rig.done(request(3004));
    // Directions that were commanded.
    for kind in [
        HeadingCommandType::TurnRate,
        HeadingCommandType::HeadingAndCourse,
    ] {
        let steer = VehicleOperatingModeCommand {
            heading_command_type: Some(kind),
            commanded_turn_rate: Some(Scaled::from_raw(500)),
            commanded_heading: Some(Bam16::from_degrees(90.0)),
            commanded_course: Some(Bam16::from_degrees(90.0)),
            ..orders::mode(Mode::Autopilot)
        };
        // Wings take a course alone.
        let _ = rig.carry_out(steer);
        rig.run(1.0);
    }
    // An alert that stands, and what is behind it; a long text in parts.
    rig.vehicles[0]
        .vehicle_mut()
        .set_health_faults(HealthFaults {
            unhealthy: 0x4,
            ..HealthFaults::default()
        });
    rig.run(4.0);
    rig.done(SubsystemStatusRequest::default());
    for reference in 1..10 {
        let _ = rig.carry_out(SubsystemStatusDetailRequest {
            subsystem_state_report_reference: Some(reference),
            ..SubsystemStatusDetailRequest::default()
        });
    }
    // A plan that cannot be loaded.
    rig.send_plan(vec![orders::waypoint(3, 99, 0.0, 150.0, 30.0).into()]);
    let _ = rig.carry_out(orders::load());
    // Control is wished for by the other, and passes.
    let wish = PositiveHandoverAuthorisationRequest {
        requested_handover_loi: orders::request_control().requested_handover_loi,
        requesting_cucs_id: Some(cucs(1)),
        ..PositiveHandoverAuthorisationRequest::default()
    };
    let _ = rig.send_as(1, 0, wish.clone());
    rig.run(2.0);
    let _ = rig.send(wish);
    rig.run(5.0);
    rig
}

fn request(message: u16) -> GenericInformationRequestMessage {
    GenericInformationRequestMessage {
        message_type: Some(message),
        ..GenericInformationRequestMessage::default()
    }
}

/// Curves and areas, given back, and a ping of the vehicle.
fn services() -> Rig {
    let mut rig = Rig::ready();
    for curve in [filled(curve().into()), paper_curve().into()] {
        rig.send_plan(vec![
            orders::route(1).into(),
            orders::waypoint(1, 2, 50.0, 0.0, 20.0).into(),
            orders::waypoint(2, 0, 50.0, 200.0, 20.0).into(),
            curve,
        ]);
        rig.done(orders::load());
        rig.done(orders::transfer(MissionPlanMode::Download));
    }
    rig.done(filled(circle().into()));
    for mode in [AreaPlanMode::Load, AreaPlanMode::Download] {
        rig.done(areas(mode));
    }
    // An area of which corners are missing.
    rig.done(corner(1, (300.0, 0.0)));
    let _ = rig.carry_out(areas(AreaPlanMode::Load));
    let ping = PingRequest {
        ping_target: Some(PingTarget::Vehicle),
        ..PingRequest::default()
    };
    rig.done(filled(ping.into()));
    rig
}

/// Everything that is reported of a payload.
fn payload() -> Rig {
    let mut rig = Rig::ready_with(Setup {
        vehicles: vec![px4_sim::Config {
            payloads: 1,
            ..px4_sim::Config::default()
        }],
        ..Setup::default()
    });
    rig.take_off(20.0);
    rig.run(4.0);
    for message in [21000, 21100, 21101, 50025] {
        rig.done(request(message));
    }
    rig
}

/// What a payload does at a waypoint, given back with every field.
fn payload_at_a_waypoint() -> Rig {
    let mut rig = Rig::ready_with(two_payloads());
    rig.run(6.0);
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 0, 50.0, 0.0, 20.0).into(),
        filled(look_there().into()),
    ]);
    rig.done(orders::load());
    rig.done(orders::transfer(MissionPlanMode::Download));
    rig
}

/// Reports from telemetry of a vehicle that the simulated one does not.
fn of_other_sensors() -> Vec<Message> {
    let mut vehicle = Telemetry::default();
    let reported = [
        MavMessage::GPS_RAW_INT(GPS_RAW_INT_DATA {
            time_usec: 1_767_225_600_000_000,
            ..GPS_RAW_INT_DATA::default()
        }),
        MavMessage::HIGHRES_IMU(HIGHRES_IMU_DATA::default()),
        MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
            current_battery: 1_200,
            temperature: 2_500,
            time_remaining: 600,
            voltages: [4_000; 10],
            ..BATTERY_STATUS_DATA::default()
        }),
        MavMessage::AUTOPILOT_VERSION(AUTOPILOT_VERSION_DATA {
            flight_custom_version: *b"1a2b3c4d",
            ..AUTOPILOT_VERSION_DATA::default()
        }),
    ];
    for message in &reported {
        assert!(vehicle.update(message));
        vehicle.equipment.update(Duration::ZERO, message);
    }
    let stamp = TimeStamp(1);
    let mut electrical = mapping::equipment_reports::electrical(&vehicle, || stamp);
    let electrical = electrical.next().expect("a battery");
    let gps = mapping::equipment_reports::gps_status(&vehicle, stamp).expect("a receiver");
    vec![
        electrical.into(),
        gps.into(),
        status::body_sensed(&vehicle, stamp).into(),
        status::battery(&vehicle, stamp).into(),
        status::software("1.0.0", vehicle.software.as_ref(), stamp).into(),
    ]
}

/// A message with every field that is not set yet: 1, or 0 where 1 would ask for another flight.
fn filled(message: Message) -> Message {
    let set = raw_fields(&message);
    let fields = message.info().fields.iter();
    let open = fields.filter(|field| !set.contains_key(field.name));
    open.fold(message.clone(), |message, field| {
        let value = if AS_USUAL.contains(&field.name) {
            "0"
        } else {
            "1"
        };
        altered(&message, field.name, value)
    })
}

/// Fields whose 1 asks for something else than a leg from here to there.
const AS_USUAL: &[&str] = &[
    "Waypoint Type",
    "Limit Type",
    "Turn Type",
    "Location Type",
    "Loiter Duration Units",
];
