//! The trials, in the order of the messages. Places are metres north and east of home; 11930 steps of an angle are
//! about 110 m of latitude.

use sim::px4::Airframe;
use stanag_msgs::enums::{
    AltitudeCommandType, AltitudeType, AreaPlanMode, AreaType, CommandedEngineState,
    ConfigRequestType, FlightPathControlMode as Mode, HeadingCommandType, LimitType,
    LoiterDirection, LoiterDurationUnits, LoiterType, MissionPlanMode, PingTarget, RequestedAccess,
    SpeedType, WaypointSpeedType, WaypointType,
};
use stanag_msgs::messages::{
    AreaTransferCommand, AreaVertex, CucsAuthorisationRequest, CurveSegment, CurveSegmentPaper,
    EngineCommand, FieldConfigurationRequest, GenericInformationRequestMessage, Heartbeat,
    LoiterConfiguration, MissionTransferCommand, ParameterRequest, ParameterSetCommand,
    PingRequest, PositiveHandoverAuthorisationRequest, ScheduleMessageUpdateCommand,
    SubsystemStatusDetailRequest, SubsystemStatusRequest, UaLoiterWaypoint, UaPositionWaypoint,
    UaStickCommand, VehicleDataLinkTransitionCoordination, VehicleOperatingModeCommand,
};
use stanag_msgs::{Bam16, Bam32, Message, Scaled, Text};

use super::scene::{Trial, done, tell};
use super::support::{Rig, Setup, VSM, cucs, orders, vehicle_id};

/// All trials of a message.
pub(super) fn trials_of(id: u16) -> impl Iterator<Item = Trial> {
    trials()
        .into_iter()
        .filter(move |trial| (trial.base)().id() == id)
}

fn one() -> Setup {
    Setup::default()
}

fn two_stations() -> Setup {
    Setup {
        stations: 2,
        ..Setup::default()
    }
}

fn transitions() -> Setup {
    Setup {
        stations: 2,
        dli_keys: "provisional = \"all\"",
        ..Setup::default()
    }
}

fn plane() -> Setup {
    Setup {
        vehicles: vec![sim::px4::Config {
            airframe: Airframe::Plane,
            ..sim::px4::Config::default()
        }],
        ..Setup::default()
    }
}

fn nothing(_: &mut Rig) {}

fn control(rig: &mut Rig) {
    done(rig, orders::request_control());
    rig.run(1.0);
}

fn with_a_failing_compass(rig: &mut Rig) {
    control(rig);
    rig.vehicles[0].vehicle_mut().ail(sim::px4::Ailments {
        unhealthy: 0x4,
        ..sim::px4::Ailments::default()
    });
    rig.run(5.0);
}

fn control_with_stations(rig: &mut Rig) {
    done(
        rig,
        CucsAuthorisationRequest {
            controlled_station_1_16: Some(stations_1_16(3)),
            controlled_station_17_32: Some(stations_17_32(3)),
            ..orders::request_control()
        },
    );
}

fn stations_1_16(bits: u16) -> stanag_msgs::enums::StationBitmap1To16 {
    stanag_msgs::enums::StationBitmap1To16::from_raw(bits)
}

fn stations_17_32(bits: u16) -> stanag_msgs::enums::StationBitmap17To32 {
    stanag_msgs::enums::StationBitmap17To32::from_raw(bits)
}

fn other_controls(rig: &mut Rig) {
    let ticket = rig.tell_as(1, 0, orders::request_control());
    rig.until(5.0, |rig| rig.stations[1].end(ticket).is_some());
}

fn airborne(rig: &mut Rig) {
    control(rig);
    rig.take_off(20.0);
    rig.run(2.0);
}

fn airborne_with_route(rig: &mut Rig) {
    control(rig);
    rig.send_plan(orders::square());
    done(rig, orders::load());
    rig.take_off(20.0);
}

fn with_two_routes(rig: &mut Rig) {
    control(rig);
    rig.send_plan(orders::square());
    rig.send_plan(vec![
        stanag_msgs::messages::UaRoute {
            route_id: Some(Text::new("R2")),
            ..orders::route(201)
        }
        .into(),
        orders::waypoint(201, 0, 40.0, 40.0, 15.0).into(),
    ]);
}

fn then_5_s(rig: &mut Rig, message: &Message) {
    tell(rig, message);
    rig.run(5.0);
}

fn then_20_s(rig: &mut Rig, message: &Message) {
    tell(rig, message);
    rig.run(20.0);
}

/// Sticks are a stream; mode 2 is entered with the first.
fn stream(rig: &mut Rig, message: &Message) {
    for round in 0..40 {
        rig.say(message.clone());
        if round == 2 {
            let _ = rig.tell(orders::mode(Mode::FlightDirector));
        }
        rig.run(0.1);
    }
}

fn then_loiter(rig: &mut Rig, message: &Message) {
    tell(rig, message);
    done(rig, loiter_there(60.0, 0.0));
    rig.run(30.0);
}

fn loiter_there(north: f64, east: f64) -> VehicleOperatingModeCommand {
    let (latitude, longitude) = orders::place(north, east);
    VehicleOperatingModeCommand {
        loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
        loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
        ..orders::mode(Mode::Loiter)
    }
}

/// 13001 under trial, then the rest of its plan, and a flight of route R1.
fn as_route(rig: &mut Rig, message: &Message) {
    tell(rig, message);
    rig.send_plan(orders::square().into_iter().skip(1).collect());
    let load = MissionTransferCommand {
        route_id: Some(Text::new("R1")),
        ..orders::load()
    };
    tell(rig, &load.into());
    rig.take_off(20.0);
    tell(rig, &orders::mode(Mode::Waypoint).into());
    rig.run(5.0);
}

/// 13002 under trial as the second waypoint of three.
fn as_waypoint(rig: &mut Rig, message: &Message) {
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 60.0, 0.0, 20.0).into(),
        orders::waypoint(3, 0, 60.0, 90.0, 20.0).into(),
    ]);
    tell(rig, message);
    tell(rig, &orders::load().into());
}

/// 13003 under trial at the first of two waypoints.
fn as_loiter(rig: &mut Rig, message: &Message) {
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 300.0, 0.0, 80.0).into(),
        orders::waypoint(2, 0, 600.0, 600.0, 80.0).into(),
    ]);
    tell(rig, message);
    tell(rig, &orders::load().into());
}

/// A curve under trial between two waypoints. 50001 has a stamp of its own kind, which 17000 cannot return.
fn as_curve(rig: &mut Rig, message: &Message) {
    rig.send_plan(vec![
        orders::route(1).into(),
        orders::waypoint(1, 2, 50.0, 0.0, 20.0).into(),
        orders::waypoint(2, 0, 50.0, 200.0, 20.0).into(),
    ]);
    rig.say(message.clone());
    rig.run(0.5);
    tell(rig, &orders::load().into());
}

/// 50016 under trial as the third corner of a triangle.
fn as_corner(rig: &mut Rig, message: &Message) {
    let corners = [(300.0, 0.0), (-300.0, 300.0)];
    for (number, at) in (1..).zip(corners) {
        done(rig, corner(number, at));
    }
    tell(rig, message);
    tell(rig, &areas(AreaPlanMode::Load).into());
}

fn then_load_areas(rig: &mut Rig, message: &Message) {
    tell(rig, message);
    tell(rig, &areas(AreaPlanMode::Load).into());
}

fn with_areas(rig: &mut Rig) {
    control(rig);
    done(rig, circle());
}

pub(super) fn corner(number: u8, at: (f64, f64)) -> AreaVertex {
    let (latitude, longitude) = orders::place(at.0, at.1);
    AreaVertex {
        area_id: Some(1),
        area_type: Some(AreaType::KeepInPolygon),
        vertex_count: Some(3),
        vertex_number: Some(number),
        latitude: Some(Bam32::from_degrees(latitude)),
        longitude: Some(Bam32::from_degrees(longitude)),
        ..AreaVertex::default()
    }
}

pub(super) fn circle() -> AreaVertex {
    AreaVertex {
        area_type: Some(AreaType::KeepOutCircle),
        vertex_count: Some(1),
        radius: Some(30.0),
        ..corner(1, (200.0, 0.0))
    }
}

pub(super) fn areas(mode: AreaPlanMode) -> AreaTransferCommand {
    AreaTransferCommand {
        area_plan_mode: Some(mode),
        ..AreaTransferCommand::default()
    }
}

/// 2010: a little to the right.
pub(super) fn sticks() -> UaStickCommand {
    UaStickCommand {
        lateral_stick: Some(20),
        longitudinal_stick: Some(0),
        rotational_stick_rudder: Some(0),
        throttle_stick_engine_1: Some(50),
        ..UaStickCommand::default()
    }
}

fn steering(kind: HeadingCommandType) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        altitude_command_type: Some(AltitudeCommandType::RateLimitedAltitude),
        commanded_altitude: Some(Scaled::saturating_from_si(60.0)),
        altitude_type: Some(AltitudeType::Agl),
        commanded_vertical_speed: Some(Scaled::saturating_from_si(1.0)),
        heading_command_type: Some(kind),
        commanded_heading: Some(Bam16::from_radians(0.5)),
        commanded_course: Some(Bam16::from_radians(1.0)),
        commanded_turn_rate: Some(Scaled::saturating_from_si(0.1)),
        commanded_speed: Some(Scaled::saturating_from_si(3.0)),
        ..orders::mode(Mode::Autopilot)
    }
}

fn waypoint_2() -> UaPositionWaypoint {
    UaPositionWaypoint {
        waypoint_to_speed: Some(Scaled::saturating_from_si(5.0)),
        waypoint_speed_type: Some(WaypointSpeedType::Ground),
        ..orders::waypoint(2, 3, 90.0, 60.0, 25.0)
    }
}

pub(super) fn curve() -> CurveSegment {
    let (p2, p3) = (orders::place(120.0, 50.0), orders::place(120.0, 150.0));
    CurveSegment {
        p1_waypoint_no: Some(1),
        p4_waypoint_no: Some(2),
        p2_latitude: Some(Bam32::from_degrees(p2.0)),
        p2_longitude: Some(Bam32::from_degrees(p2.1)),
        p2_altitude: Some(Scaled::saturating_from_si(25.0)),
        p3_latitude: Some(Bam32::from_degrees(p3.0)),
        p3_longitude: Some(Bam32::from_degrees(p3.1)),
        p3_altitude: Some(Scaled::saturating_from_si(30.0)),
        altitude_type: Some(AltitudeType::Agl),
        ..CurveSegment::default()
    }
}

pub(super) fn paper_curve() -> CurveSegmentPaper {
    let (p2, p3) = (orders::place(120.0, 50.0), orders::place(120.0, 150.0));
    CurveSegmentPaper {
        time_stamp: Some(1.0),
        vehicle_id: Some(vehicle_id(0)),
        cucs_id: Some(cucs(0)),
        p1_waypoint_no: Some(1),
        p4_waypoint_no: Some(2),
        p2_latitude: Some(p2.0.to_radians()),
        p2_longitude: Some(p2.1.to_radians()),
        p3_latitude: Some(p3.0.to_radians()),
        p3_longitude: Some(p3.1.to_radians()),
    }
}

macro_rules! trial {
    ($setup:ident, $before:ident, $act:ident, $base:expr, [$($field:literal = $change:literal),* $(,)?]) => {
        Trial {
            setup: $setup,
            before: $before,
            base: || $base.into(),
            act: $act,
            changes: &[$(($field, $change)),*],
        }
    };
}

/// All of them.
pub(super) fn trials() -> Vec<Trial> {
    let mut all = rights();
    all.extend(flight());
    all.extend(routes());
    all.extend(requests());
    all.extend(private());
    all
}

fn rights() -> Vec<Trial> {
    vec![
        trial!(
            two_stations,
            nothing,
            then_5_s,
            orders::request_control(),
            [
                "VSM ID" = "5",
                "Requested/Handover LOI" = "1",
                "Requested/Handover Access" = "0",
                "Controlled Station 1-16" = "1",
                "Controlled Station 17-32" = "1",
                "CUCS Type" = "3",
                "CUCS Subtype" = "3",
            ]
        ),
        trial!(
            two_stations,
            other_controls,
            ask_for_control,
            CucsAuthorisationRequest {
                requested_handover_access: Some(RequestedAccess::Request),
                ..orders::request_control()
            },
            ["Wait for Vehicle Data Link Transition Coordination Message" = "1"]
        ),
        trial!(
            two_stations,
            control_with_stations,
            then_5_s,
            PositiveHandoverAuthorisationRequest {
                requested_handover_loi: orders::request_control().requested_handover_loi,
                requesting_cucs_id: Some(cucs(1)),
                ..PositiveHandoverAuthorisationRequest::default()
            },
            [
                "Requested/Handover LOI" = "2",
                "Controlled Station 1-16" = "1",
                "Controlled Station 17-32" = "1",
                "Requesting CUCS ID" = "null",
            ]
        ),
    ]
}

/// A request that waits has no end yet.
fn ask_for_control(rig: &mut Rig, message: &Message) {
    let _ = rig.tell(message.clone());
    rig.run(5.0);
}

fn flight() -> Vec<Trial> {
    vec![
        trial!(
            one,
            control,
            then_5_s,
            EngineCommand {
                engine_command: Some(CommandedEngineState::Start),
                ..EngineCommand::default()
            },
            [
                "Engine Number" = "9",
                "Engine Command" = "0",
                "Reverse Thrust Power" = "1",
                "Reverse Thrust" = "1",
                "Ignition Switch Power" = "1",
                "Ignition Switch Activation" = "1",
            ]
        ),
        trial!(
            one,
            airborne,
            stream,
            sticks(),
            [
                "Lateral Stick" = "60",
                "Longitudinal Stick" = "40",
                "Rotational Stick (Rudder)" = "50",
                "Throttle Stick - Engine 1" = "80",
            ]
        ),
        trial!(
            one,
            control,
            then_20_s,
            orders::launch(20.0),
            [
                "Select Flight Path Control Mode" = "12",
                "Altitude Command Type" = "2",
                "Commanded Altitude" = "+500",
            ]
        ),
        trial!(
            one,
            control,
            then_20_s,
            VehicleOperatingModeCommand {
                altitude_type: Some(AltitudeType::Wgs84),
                ..orders::launch(560.0)
            },
            ["Altitude Type" = "1"]
        ),
        trial!(
            one,
            control,
            then_20_s,
            VehicleOperatingModeCommand {
                altitude_type: Some(AltitudeType::Pressure),
                altimeter_setting: Some(Scaled::saturating_from_si(101_325.0)),
                ..orders::launch(520.0)
            },
            ["Altimeter Setting" = "10150"]
        ),
        trial!(
            one,
            airborne,
            then_20_s,
            VehicleOperatingModeCommand {
                commanded_speed: Some(Scaled::saturating_from_si(5.0)),
                speed_type: Some(SpeedType::Ground),
                ..loiter_there(60.0, 0.0)
            },
            [
                "Loiter Position Latitude" = "+3000",
                "Loiter Position Longitude" = "+3000",
                "Commanded Speed" = "4",
                "Speed Type" = "3",
                "Heading Command Type" = "1",
            ]
        ),
        trial!(
            one,
            airborne,
            then_5_s,
            steering(HeadingCommandType::HeadingAndCourse),
            [
                "Commanded Vertical Speed" = "-10",
                "Commanded Altitude" = "-500",
                "Heading Command Type" = "1",
                "Heading Reference" = "1",
                "Commanded Heading" = "9000",
                "Commanded Course" = "-9000",
            ]
        ),
        trial!(
            one,
            airborne,
            then_5_s,
            steering(HeadingCommandType::TurnRate),
            ["Commanded Turn Rate" = "+2000",]
        ),
        trial!(
            one,
            airborne_with_route,
            then_5_s,
            orders::mode(Mode::Waypoint),
            ["Commanded Waypoint Number" = "103",]
        ),
        trial!(
            one,
            airborne,
            then_loiter,
            LoiterConfiguration {
                loiter_type: Some(LoiterType::Circular),
                loiter_radius: Some(Scaled::saturating_from_si(30.0)),
                loiter_direction: Some(LoiterDirection::Clockwise),
                ..LoiterConfiguration::default()
            },
            [
                "Loiter Type" = "4",
                "Loiter Radius" = "40",
                "Loiter Direction" = "2"
            ]
        ),
    ]
}

fn routes() -> Vec<Trial> {
    vec![
        trial!(
            one,
            with_two_routes,
            then_5_s,
            orders::load(),
            [
                "Mission ID" = "\"M2\"",
                "Mission Plan Mode" = "1",
                "Route ID" = "\"R1\"",
            ]
        ),
        trial!(
            one,
            with_two_routes,
            then_5_s,
            MissionTransferCommand {
                waypoint_number: Some(101),
                ..orders::transfer(MissionPlanMode::DownloadWaypoint)
            },
            ["Waypoint Number" = "102"]
        ),
        trial!(
            one,
            control,
            as_route,
            orders::route(101),
            [
                "Initial Waypoint Number" = "102",
                "Route ID" = "\"R9\"",
                "Route Type" = "3",
            ]
        ),
        trial!(
            one,
            control,
            as_waypoint,
            waypoint_2(),
            [
                "Waypoint Number" = "9",
                "Waypoint to Latitude or Relative Y" = "+3000",
                "Waypoint to Longitude or Relative X" = "+3000",
                "Location Type" = "1",
                "Waypoint to Altitude" = "+250",
                "Waypoint Altitude Type" = "1",
                "Waypoint to Speed" = "12",
                "Waypoint Speed Type" = "3",
                "Next Waypoint" = "0",
                "Turn Type" = "1",
            ]
        ),
        trial!(
            one,
            control,
            as_waypoint,
            UaPositionWaypoint {
                next_waypoint: Some(1),
                waypoint_type: Some(WaypointType::EndOfLoop),
                limit_type: Some(LimitType::Count),
                loop_limit: Some(3),
                ..waypoint_2()
            },
            [
                "Waypoint Type" = "0",
                "Limit Type" = "0",
                "Loop Limit" = "5"
            ]
        ),
        trial!(
            plane,
            control,
            as_loiter,
            UaLoiterWaypoint {
                waypoint_number: Some(1),
                waypoint_loiter_type: Some(LoiterType::Circular),
                loiter_radius: Some(Scaled::saturating_from_si(60.0)),
                loiter_direction: Some(LoiterDirection::Clockwise),
                loiter_speed: Some(Scaled::saturating_from_si(15.0)),
                speed_type: Some(SpeedType::Ground),
                loiter_duration: Some(60),
                loiter_duration_units: Some(LoiterDurationUnits::Seconds),
                ..UaLoiterWaypoint::default()
            },
            [
                "Waypoint Number" = "2",
                "Waypoint Loiter Type" = "4",
                "Loiter Radius" = "60",
                "Loiter Direction" = "2",
                "Loiter Speed" = "36",
                "Speed Type" = "9",
                "Loiter Duration" = "90",
                "Loiter Duration Units" = "1",
            ]
        ),
    ]
}

fn requests() -> Vec<Trial> {
    vec![
        trial!(
            one,
            control,
            then_5_s,
            SubsystemStatusRequest::default(),
            ["Subsystem ID" = "8"]
        ),
        trial!(
            one,
            with_a_failing_compass,
            then_5_s,
            SubsystemStatusDetailRequest {
                subsystem_state_report_reference: Some(6),
                ..SubsystemStatusDetailRequest::default()
            },
            ["Subsystem State Report Reference" = "1"]
        ),
        trial!(one, control, then_5_s, Heartbeat::default(), []),
        trial!(
            one,
            control,
            then_5_s,
            ScheduleMessageUpdateCommand {
                requested_message_type: Some(3009),
                frequency: Some(4),
                ..ScheduleMessageUpdateCommand::default()
            },
            ["Requested Message Type" = "12101", "Frequency" = "2"]
        ),
        trial!(
            one,
            control,
            then_5_s,
            GenericInformationRequestMessage {
                message_type: Some(3009),
                ..GenericInformationRequestMessage::default()
            },
            [
                "Message Type" = "12101",
                "Requested Field Presence Vector" = "64"
            ]
        ),
        trial!(
            transitions,
            control,
            then_5_s,
            VehicleDataLinkTransitionCoordination {
                acquiring_cucs_id: Some(cucs(1)),
                ..VehicleDataLinkTransitionCoordination::default()
            },
            [
                "Acquiring CUCS ID" = "null",
                "Set Forward Link Carrier Frequency (ADT)" = "1",
                "Set Return Link Carrier Frequency (ADT)" = "1",
                "Set PN Code (ADT)" = "1",
            ]
        ),
        trial!(
            one,
            nothing,
            then_5_s,
            FieldConfigurationRequest {
                vsm_id: Some(VSM),
                request_type: Some(ConfigRequestType::SingleParameter),
                requested_message: Some(2016),
                requested_field: Some(13),
                ..FieldConfigurationRequest::default()
            },
            [
                "VSM ID" = "5",
                "Request Type" = "4",
                "Requested Message" = "13002",
                "Requested Field" = "15",
            ]
        ),
    ]
}

fn private() -> Vec<Trial> {
    vec![
        trial!(
            one,
            control,
            as_curve,
            paper_curve(),
            [
                "Vehicle ID" = "5",
                "CUCS ID" = "5",
                "P1 Waypoint No" = "9",
                "P4 Waypoint No" = "9",
                "P2 Latitude" = "+0.000005",
                "P2 Longitude" = "+0.000005",
                "P3 Latitude" = "+0.000005",
                "P3 Longitude" = "+0.000005",
            ]
        ),
        trial!(
            one,
            control,
            as_curve,
            curve(),
            [
                "P1 Waypoint No" = "9",
                "P4 Waypoint No" = "9",
                "P2 Latitude" = "+3000",
                "P2 Longitude" = "+3000",
                "P2 Altitude" = "+250",
                "P3 Latitude" = "+3000",
                "P3 Longitude" = "+3000",
                "P3 Altitude" = "+250",
                "Altitude Type" = "1",
            ]
        ),
        trial!(
            one,
            control,
            then_5_s,
            ParameterRequest {
                parameter_name: Some(Text::new("NAV_DLL_ACT")),
                ..ParameterRequest::default()
            },
            ["Parameter Name" = "\"COM_DL_LOSS_T\""]
        ),
        trial!(
            one,
            control,
            then_5_s,
            ParameterSetCommand {
                parameter_name: Some(Text::new("MPC_XY_CRUISE")),
                commanded_value: Some(6.0),
                ..ParameterSetCommand::default()
            },
            [
                "Parameter Name" = "\"MPC_XY_VEL_MAX\"",
                "Commanded Value" = "7.0"
            ]
        ),
        trial!(
            one,
            control,
            then_5_s,
            PingRequest {
                ping_number: Some(1),
                ping_target: Some(PingTarget::Vsm),
                ..PingRequest::default()
            },
            ["Ping Number" = "2", "Ping Target" = "1"]
        ),
        trial!(
            one,
            control,
            as_corner,
            corner(3, (-300.0, -300.0)),
            [
                "Area ID" = "2",
                "Area Type" = "1",
                "Vertex Count" = "4",
                "Vertex Number" = "2",
                "Latitude" = "+3000",
                "Longitude" = "+3000",
            ]
        ),
        trial!(one, control, then_load_areas, circle(), ["Radius" = "50.0"]),
        trial!(
            one,
            with_areas,
            then_5_s,
            areas(AreaPlanMode::Load),
            ["Area Plan Mode" = "1"]
        ),
    ]
}
