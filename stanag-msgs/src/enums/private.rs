//! Values of this project's private messages.

use super::EnumInfo;
use super::macros::enumerations;
use crate::table::Confidence::A;

enumerations! {
    ParameterKind(u8) = "parameter_kind", A, source "this project",
        description "what a parameter of the vehicle is" {
        Integer = 0 "integer of 32 bits";
        Float = 1 "float of 32 bits";
    }

    PingTarget(u8) = "ping_target", A, source "this project",
        description "who answers a ping" {
        Vsm = 0 "the VSM";
        Vehicle = 1 "the vehicle, through the VSM";
    }

    AreaType(u8) = "area_type", A, source "this project",
        description "what an area is" {
        KeepInPolygon = 0 "polygon to stay inside";
        KeepOutPolygon = 1 "polygon to stay outside";
        KeepInCircle = 2 "circle to stay inside";
        KeepOutCircle = 3 "circle to stay outside";
    }

    AreaPlanMode(u8) = "area_plan_mode", A, source "this project",
        description "Area Transfer Command" {
        Clear = 1 "clear all areas, here and aboard";
        Load = 2 "load all areas that were sent";
        Download = 3 "send the areas back";
    }
}
