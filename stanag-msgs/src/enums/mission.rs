//! Values of missions: routes, waypoints, transfer.

use super::EnumInfo;
use super::macros::enumerations;
use crate::table::Confidence::C;

enumerations! {
    WaypointSpeedType(u8) = "waypoint_speed_type", C, source "E2 0802.11",
        description "speed type of a waypoint" {
        Indicated = 0 "indicated airspeed";
        True = 1 "true airspeed";
        Ground = 2 "ground speed";
        ArrivalTime = 3 "arrival time (use Arrival Time field)";
    }

    LocationType(u8) = "location_type", C, source "E2 0802.07",
        description "waypoint coordinates" {
        Absolute = 0 "absolute";
        Relative = 1 "relative (to the route's absolute reference message)";
    }

    TurnType(u8) = "turn_type", C, source "E2 0802.16",
        description "what to do at the waypoint" {
        ShortTurn = 0 "short turn (cut the corner)";
        FlyOver = 1 "fly over";
    }

    RouteType(u8) = "route_type", C, source "E2 0801.06",
        description "route role" {
        Launch = 0 "launch";
        Approach = 1 "approach";
        Flight = 2 "flight (default)";
        ContingencyA = 3 "contingency A";
        ContingencyB = 4 "contingency B";
    }

    MissionPlanMode(u8) = "mission_plan_mode", C, source "E2 0800.05",
        description "Mission Transfer Command" {
        Clear = 1 "clear mission";
        Load = 2 "load mission (all waypoints sent; VSM loads UA)";
        Download = 3 "download mission";
        DownloadWaypoint = 4 "download single waypoint";
        Cancel = 5 "cancel upload/download";
    }

    MissionTransferStatus(u8) = "mission_transfer_status", C, source "E2",
        description "0900.04" {
        InProgress = 0 "in progress";
        Complete = 1 "complete";
        Aborted = 2 "aborted / rejected";
    }

    AirframeFunction(u8) = "airframe_function", C, source "E2 0805.05",
        description "Airframe Action Waypoint" {
        NavigationLights = 1 "navigation lights";
        StrobeLights = 2 "strobe lights";
        PrimaryDataLink = 3 "primary data link";
        SecondaryDataLink = 4 "secondary data link";
        NavigationIrLights = 5 "navigation IR lights";
        StrobeIrLights = 6 "strobe IR lights";
        NvdCompatible = 7 "NVD compatible";
        LandingLights = 8 "landing lights";
        LandingIr = 9 "landing IR";
        .. "10" "reserved";
        .. "11-255" "vehicle specific";
    }

    AirframeState(u8) = "airframe_state", C, source "E2 0805.06" {
        TurnOff = 0 "turn off";
        TurnOn = 1 "turn on";
        Standby = 2 "standby";
        ReceiveOnly = 3 "receive only";
        TransmitOnly = 4 "transmit only";
    }

    SensorModeCmd(u8) = "sensor_mode_cmd", C, source "E2 0804.06" {
        Off = 0 "off";
        On = 1 "on";
        Standby = 2 "standby";
    }

    SensorOutput(u8) = "sensor_output", C, source "E2 0804.08" {
        None = 0 "none";
        Sensor1 = 1 "sensor 1";
        Sensor2 = 2 "sensor 2";
        Both = 3 "both";
    }

    PointingModeWp(u8) = "pointing_mode_wp", C, source "E2 0804.09",
        description "Payload Action Waypoint" {
        Nil = 0 "nil";
        AngleToUa = 1 "angle relative to UA";
        SlewRateToUa = 2 "slew rate relative to UA";
        SlewRateInertial = 3 "slew rate relative to inertial";
        LatLongSlaved = 4 "lat-long slaved";
        TargetSlaved = 5 "target slaved";
        Stow = 6 "stow";
        LineSearchStart = 7 "line search start";
        LineSearchEnd = 8 "line search end";
    }
}
