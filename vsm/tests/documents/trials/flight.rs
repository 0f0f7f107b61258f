//! Messages that fly the vehicle: engine, sticks, modes and loiters.

use stanag_msgs::enums::{
    AltitudeType, CommandedEngineState, FlightPathControlMode as Mode, FtState, HeadingCommandType,
    LoiterDirection, LoiterType, SpeedType,
};
use stanag_msgs::messages::{
    EngineCommand, FlightTerminationCommand, LoiterConfiguration, VehicleOperatingModeCommand,
};
use stanag_msgs::{Bam16, Scaled};

use super::messages::{loiter_there, steering, sticks};
use super::scenes::{
    airborne, airborne_and_beating, airborne_with_route, control, one, plane, stream, termination,
    then_5_s, then_20_s, then_loiter,
};
use crate::scene::Trial;
use kit::bridge::orders;

pub(super) fn flight() -> Vec<Trial> {
    vec![
        trial!(
            termination,
            airborne_and_beating,
            then_5_s,
            FlightTerminationCommand {
                commanded_flight_termination_state: Some(FtState::Arm),
                ..FlightTerminationCommand::default()
            },
            [
                "Commanded Flight Termination State" = "0",
                "Flight Termination Mode" = "1" refused "others are refused",
            ]
        ),
        trial!(
            one,
            control,
            then_5_s,
            EngineCommand {
                engine_command: Some(CommandedEngineState::Start),
                ..EngineCommand::default()
            },
            [
                "Engine Number" = "9" refused "refused above the number that there are",
                "Engine Command" = "0",
                "Reverse Thrust Power" = "1" refused "1 is refused",
                "Reverse Thrust" = "1" refused "others are refused",
                "Ignition Switch Power" = "1" refused "1 is refused",
                "Ignition Switch Activation" = "1" refused "1 is refused",
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
                "Select Flight Path Control Mode" = "12" refused "refused on the ground",
                "Altitude Command Type" = "2" refused "2 and 3 in 15, elsewhere refused",
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
                "Speed Type" = "3" refused "others are refused",
                "Heading Command Type" = "1" refused "elsewhere 0 alone",
            ]
        ),
        trial!(
            one,
            airborne,
            then_5_s,
            steering(HeadingCommandType::HeadingAndCourse),
            [
                "Commanded Vertical Speed" = "-10",
                "Commanded Altitude" = "-500" refused "below home",
                "Heading Command Type" = "1",
                "Heading Reference" = "1" refused "magnetic is refused",
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
        trial!(
            plane,
            airborne,
            then_loiter,
            LoiterConfiguration {
                loiter_type: Some(LoiterType::Figure8),
                loiter_radius: Some(Scaled::saturating_from_si(60.0)),
                loiter_length: Some(Scaled::saturating_from_si(300.0)),
                loiter_bearing: Some(Bam16::from_radians(0.0)),
                ..LoiterConfiguration::default()
            },
            ["Loiter Length" = "400", "Loiter Bearing" = "8192"]
        ),
    ]
}
