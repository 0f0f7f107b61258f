//! Messages of a ground station, for tests: places are metres north and east of the simulated home.

use px4_sim::{Config, LocalFrame, Ned};
use stanag_msgs::enums::{
    AltitudeCommandType, AltitudeType, FlightPathControlMode as Mode, LoiBitmap, MissionPlanMode,
    RequestedAccess, RouteType,
};
use stanag_msgs::messages::{
    CucsAuthorisationRequest, MissionTransferCommand, UaPositionWaypoint, UaRoute,
    VehicleOperatingModeCommand,
};
use stanag_msgs::{Bam32, Message, Scaled, Text};

/// Message 1: all of LOI 2 to 5.
pub fn request_control() -> CucsAuthorisationRequest {
    CucsAuthorisationRequest {
        requested_handover_loi: Some(LoiBitmap::from_raw(0x0f)),
        requested_handover_access: Some(RequestedAccess::Request),
        ..CucsAuthorisationRequest::default()
    }
}

/// 2016 with a mode alone.
pub fn mode(mode: Mode) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        select_flight_path_control_mode: Some(mode),
        ..VehicleOperatingModeCommand::default()
    }
}

/// 2016 mode 21 to metres above home.
pub fn launch(height_m: f64) -> VehicleOperatingModeCommand {
    VehicleOperatingModeCommand {
        altitude_command_type: Some(AltitudeCommandType::Altitude),
        commanded_altitude: Some(Scaled::saturating_from_si(height_m)),
        altitude_type: Some(AltitudeType::Agl),
        ..mode(Mode::Launch)
    }
}

/// 13001 of a flight route from this waypoint.
pub fn route(initial: u16) -> UaRoute {
    UaRoute {
        initial_waypoint_number: Some(initial),
        route_id: Some(Text::new("R1")),
        route_type: Some(RouteType::Flight),
        ..UaRoute::default()
    }
}

/// 13002: metres north and east of home, metres above it; 0 as `next` ends the route.
pub fn waypoint(number: u16, next: u16, north: f64, east: f64, up: f64) -> UaPositionWaypoint {
    let (latitude, longitude) = place(north, east);
    UaPositionWaypoint {
        waypoint_number: Some(number),
        waypoint_to_latitude_or_relative_y: Some(Bam32::from_degrees(latitude)),
        waypoint_to_longitude_or_relative_x: Some(Bam32::from_degrees(longitude)),
        waypoint_to_altitude: Some(Scaled::saturating_from_si(up)),
        waypoint_altitude_type: Some(AltitudeType::Agl),
        next_waypoint: Some(next),
        ..UaPositionWaypoint::default()
    }
}

/// 13000 mode 2.
pub fn load() -> MissionTransferCommand {
    transfer(MissionPlanMode::Load)
}

/// 13000.
pub fn transfer(mode: MissionPlanMode) -> MissionTransferCommand {
    MissionTransferCommand {
        mission_id: Some(Text::new("M1")),
        mission_plan_mode: Some(mode),
        ..MissionTransferCommand::default()
    }
}

/// A square of 80 m, 20 m up, waypoints 101 to 104: the messages of its plan.
pub fn square() -> Vec<Message> {
    vec![
        route(101).into(),
        waypoint(101, 102, 80.0, 0.0, 20.0).into(),
        waypoint(102, 103, 80.0, 80.0, 20.0).into(),
        waypoint(103, 104, 0.0, 80.0, 20.0).into(),
        waypoint(104, 0, 0.0, 0.0, 20.0).into(),
    ]
}

/// Latitude and longitude in degrees of a place that is given in metres north and east of the simulated home.
pub fn place(north: f64, east: f64) -> (f64, f64) {
    let at = LocalFrame::new(Config::default().home).to_global(Ned::new(north, east, 0.0));
    (at.latitude_deg, at.longitude_deg)
}
