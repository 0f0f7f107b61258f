//! Messages under trial that several scenes share.

use stanag_msgs::enums::{
    AltitudeCommandType, AltitudeType, AreaPlanMode, AreaType, FlightPathControlMode as Mode,
    HeadingCommandType, PointingModeWp, SensorModeCmd, SensorOutput, StationBitmap1To16,
    WaypointSpeedType,
};
use stanag_msgs::messages::{
    AreaTransferCommand, AreaVertex, CurveSegment, CurveSegmentPaper, PayloadActionWaypoint,
    UaPositionWaypoint, UaStickCommand, VehicleOperatingModeCommand,
};
use stanag_msgs::{Bam16, Bam32, Scaled};

use kit::bridge::{cucs, orders, vehicle_id};

pub(super) fn loiter_there(north: f64, east: f64) -> VehicleOperatingModeCommand {
    let (latitude, longitude) = orders::place(north, east);
    VehicleOperatingModeCommand {
        loiter_position_latitude: Some(Bam32::from_degrees(latitude)),
        loiter_position_longitude: Some(Bam32::from_degrees(longitude)),
        ..orders::mode(Mode::Loiter)
    }
}

pub(crate) fn corner(number: u8, at: (f64, f64)) -> AreaVertex {
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

pub(crate) fn circle() -> AreaVertex {
    AreaVertex {
        area_type: Some(AreaType::KeepOutCircle),
        vertex_count: Some(1),
        radius: Some(30.0),
        ..corner(1, (200.0, 0.0))
    }
}

pub(crate) fn areas(mode: AreaPlanMode) -> AreaTransferCommand {
    AreaTransferCommand {
        area_plan_mode: Some(mode),
        ..AreaTransferCommand::default()
    }
}

/// 2010: a little to the right.
pub(crate) fn sticks() -> UaStickCommand {
    UaStickCommand {
        lateral_stick: Some(20),
        longitudinal_stick: Some(0),
        rotational_stick_rudder: Some(0),
        throttle_stick_engine_1: Some(50),
        ..UaStickCommand::default()
    }
}

pub(super) fn steering(kind: HeadingCommandType) -> VehicleOperatingModeCommand {
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

pub(super) fn waypoint_2() -> UaPositionWaypoint {
    UaPositionWaypoint {
        waypoint_to_speed: Some(Scaled::saturating_from_si(5.0)),
        waypoint_speed_type: Some(WaypointSpeedType::Ground),
        ..orders::waypoint(2, 3, 90.0, 60.0, 25.0)
    }
}

/// 13004: the gimbal of station 1 by angles, from the leg to waypoint 1 on.
pub(super) fn look_aside() -> PayloadActionWaypoint {
    PayloadActionWaypoint {
        payload_az_wrt_ua: Some(Bam16::from_degrees(40.0)),
        payload_el_wrt_ua: Some(Bam16::from_degrees(-50.0)),
        payload_sensor_rotation_angle: Some(Bam16::from_degrees(0.0)),
        ..look(PointingModeWp::AngleToUa)
    }
}

/// 13004: at a place on the ground, through the other sensor.
pub(crate) fn look_there() -> PayloadActionWaypoint {
    let (latitude, longitude) = orders::place(230.0, 30.0);
    PayloadActionWaypoint {
        sensor_output: Some(SensorOutput::Sensor2),
        starepoint_latitude: Some(Bam32::from_degrees(latitude)),
        starepoint_longitude: Some(Bam32::from_degrees(longitude)),
        starepoint_altitude: Some(Scaled::saturating_from_si(5.0)),
        starepoint_altitude_type: Some(AltitudeType::Agl),
        ..look(PointingModeWp::LatLongSlaved)
    }
}

fn look(mode: PointingModeWp) -> PayloadActionWaypoint {
    PayloadActionWaypoint {
        waypoint_number: Some(1),
        station_number_1_16: Some(StationBitmap1To16::STATION_1),
        set_sensor_1_mode: Some(SensorModeCmd::On),
        set_sensor_2_mode: Some(SensorModeCmd::On),
        set_sensor_pointing_mode: Some(mode),
        ..PayloadActionWaypoint::default()
    }
}

pub(crate) fn curve() -> CurveSegment {
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

pub(crate) fn paper_curve() -> CurveSegmentPaper {
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
