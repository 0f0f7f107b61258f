//! Plans: 13000 to 13004, 13006.

use stanag_msgs::enums::{
    LimitType, LoiterDirection, LoiterDurationUnits, LoiterType, MissionPlanMode, SpeedType,
    WaypointType,
};
use stanag_msgs::messages::{
    MissionTransferCommand, UaLoiterWaypoint, UaPositionWaypoint, VehicleSpecificWaypoint,
};
use stanag_msgs::{Scaled, Text};

use super::messages::{look_aside, look_there, waypoint_2};
use super::payload::{control as control_of_payloads, two_payloads};
use super::scenes::{
    as_loiter, as_payload_action, as_route, as_waypoint, control, one, plane, then_5_s, vtol,
    with_two_routes, with_two_routes_loaded,
};
use crate::scene::Trial;
use kit::bridge::orders;

pub(super) fn routes() -> Vec<Trial> {
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
            with_two_routes_loaded,
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
        trial!(
            one,
            control,
            as_loiter,
            UaLoiterWaypoint {
                waypoint_number: Some(1),
                loiter_direction: Some(LoiterDirection::Clockwise),
                loiter_speed: Some(Scaled::saturating_from_si(5.0)),
                speed_type: Some(SpeedType::Ground),
                ..UaLoiterWaypoint::default()
            },
            [
                "Loiter Direction" = "3",
                "Loiter Direction" = "9",
                "Speed Type" = "9",
            ]
        ),
        trial!(
            two_payloads,
            control_of_payloads,
            as_payload_action,
            look_aside(),
            [
                "Waypoint Number" = "2",
                "Station Number (1-16)" = "3" refused "one station",
                "Set Sensor 1 Mode" = "0" refused "off and standby are refused",
                "Set Sensor 2 Mode" = "2" refused "off and standby are refused",
                "Set Sensor Pointing Mode" = "0",
                "Set Sensor Pointing Mode" = "6" refused "the others are refused",
                "Payload Az (wrt UA)" = "-7000",
                "Payload El (wrt UA)" = "-7000",
                "Payload El (wrt UA)" = "11000" refused "beyond the gimbal's range it is refused",
                "Payload Sensor Rotation Angle" = "2000" refused "others are refused",
            ]
        ),
        trial!(
            two_payloads,
            control_of_payloads,
            as_payload_action,
            look_there(),
            [
                "Sensor Output" = "1",
                "Sensor Output" = "3" refused "both is refused",
                "Starepoint Latitude" = "+3000",
                "Starepoint Longitude" = "+3000",
                "Starepoint Altitude" = "+250",
                "Starepoint Altitude Type" = "1",
            ]
        ),
        trial!(
            vtol,
            control,
            as_loiter,
            VehicleSpecificWaypoint {
                waypoint_number: Some(1),
                tag_type: Some(0),
                tag_data: Some(Text::new("TRANSITION HOVER")),
                ..VehicleSpecificWaypoint::default()
            },
            [
                "Waypoint Number" = "2",
                "Tag Type" = "1" refused "others are refused",
                "Tag/Data" = "\"TRANSITION WINGS\"",
            ]
        ),
    ]
}
