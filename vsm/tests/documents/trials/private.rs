//! Private messages: curves, parameters, ping, areas.

use stanag_msgs::Text;
use stanag_msgs::enums::{AreaPlanMode, PingTarget};
use stanag_msgs::messages::{ParameterRequest, ParameterSetCommand, PingRequest};

use super::messages::{areas, circle, corner, curve, paper_curve};
use super::scenes::{as_corner, as_curve, control, one, then_5_s, then_load_areas, with_areas};
use crate::scene::Trial;

pub(super) fn private() -> Vec<Trial> {
    vec![
        trial!(
            one,
            control,
            as_curve,
            paper_curve(),
            [
                "Vehicle ID" = "5" refused "refused unless the wrapper's",
                "CUCS ID" = "5" refused "refused unless the wrapper's",
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
