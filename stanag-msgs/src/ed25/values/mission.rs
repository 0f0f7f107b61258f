//! Values of missions.

use super::values;

values! {
    WAYPOINT_SPEED_TYPE = "waypoint_speed_type", Enumeration, "" {
        0 IndicatedAirspeed "indicated airspeed";
        1 TrueAirspeed "true airspeed";
        2 GroundSpeed "ground speed";
        3 ArrivalTime "arrival time";
    }

    MISSION_PLAN_MODE = "mission_plan_mode", Enumeration, "" {
        1 ClearMission "clear mission";
        2 LoadMission "load mission";
        3 DownloadMission "download mission";
        4 DownloadSingleWaypoint "download single waypoint";
        5 CancelUploadOrDownload "cancel upload or download";
    }

    ROUTE_TYPE = "route_type", Enumeration, "" {
        0 Launch "launch";
        1 Approach "approach";
        2 Flight "flight";
        3 ContingencyA "contingency A";
        4 ContingencyB "contingency B";
    }

    LOCATION_TYPE = "location_type", Enumeration, "" {
        0 Absolute "absolute";
        1 Relative47 "relative (#47)";
    }

    TURN_TYPE = "turn_type", Enumeration, "" {
        0 ShortTurn "short turn";
        1 FlyOver "fly over";
    }

    SENSOR_MODE_CMD = "sensor_mode_cmd", Enumeration, "" {
        0 TurnOff "turn off";
        1 TurnOn "turn on";
        2 GoToStandby "go to standby";
    }

    SENSOR_OUTPUT = "sensor_output", Enumeration, "" {
        0 None "none";
        1 Sensor1 "sensor 1";
        2 Sensor2 "sensor 2";
        3 Both "both";
    }

    POINTING_MODE_WP = "pointing_mode_wp", Enumeration, "" {
        0 Nil "nil";
        1 AngleRelativeToTheVehicle "angle relative to the vehicle";
        2 SlewRateRelativeToTheVehicle "slew rate relative to the vehicle";
        3 SlewRateRelativeToInertial "slew rate relative to inertial";
        4 SlavedToAPosition "slaved to a position";
        5 SlavedToATarget "slaved to a target";
        6 Stow "stow";
        7 LineSearchStart "line search start";
        8 LineSearchEnd "line search end";
    }

    AIRFRAME_FUNCTION = "airframe_function", Enumeration, "" {
        1 NavigationLights "navigation lights";
        2 StrobeLights "strobe lights";
        3 PrimaryDataLink "primary data link";
        4 SecondaryDataLink "secondary data link";
        5 NavigationIRLights "navigation IR lights";
        6 StrobeIRLights "strobe IR lights";
        7 NVDCompatible "NVD compatible";
        8 Landing "landing";
        9 LandingIR "landing IR";
        10 Reserved "reserved";
        .. "11-255" "vehicle specific";
    }

    AIRFRAME_STATE = "airframe_state", Enumeration, "" {
        0 TurnOff "turn off";
        1 TurnOn "turn on";
        2 GoToStandby "go to standby";
        3 ReceiveOnly "receive only";
        4 TransmitOnly "transmit only";
    }

    TAG_TYPE = "tag_type", Enumeration, "" {
        0 None "none";
        1 StartTag "start tag";
        2 StopTag "stop tag";
    }

    MISSION_TRANSFER_STATUS = "mission_transfer_status", Enumeration, "" {
        0 InProgress "in progress";
        1 Complete "complete";
        2 AbortedOrRejected "aborted or rejected";
    }
}
