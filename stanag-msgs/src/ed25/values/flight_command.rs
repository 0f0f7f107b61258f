//! Values of flight commands and status.

use super::values;

values! {
    FLIGHT_PATH_CONTROL_MODE = "flight_path_control_mode", Enumeration, "1-10 manual, 11-31 automatic modes" {
        0 NoMode "no mode";
        1 Reserved "reserved";
        2 FlightDirectorManualWith43AutopilotOff "flight director (manual with #43, autopilot off)";
        11 WaypointAltitudeOfTheFirstLegFrom43 "waypoint (altitude of the first leg from #43)";
        12 Loiter41 "loiter (#41)";
        15 AutopilotOn43Overrides "autopilot (on, #43 overrides)";
        16 TerrainAvoidanceClearanceIn43Field5 "terrain avoidance (clearance in #43 field 5)";
        17 NavaidSlavedNavigation "navaid slaved navigation";
        19 AutolandEngage "autoland engage";
        20 AutolandWaveOff "autoland wave-off";
        21 Launch "launch";
        22 SlaveToSensor "slave to sensor";
        .. "3-10" "reserved";
        .. "13-14" "reserved";
        .. "18" "reserved";
        .. "23-31" "reserved";
        .. "32-255" "vehicle specific";
    }

    MODE_PREFERENCE = "mode_preference", Enumeration, "" {
        0 Configuration41802 "configuration (#41, #802)";
        1 ManualUntilTheWaypointOrLoiterPointThen0 "manual until the waypoint or loiter point, then 0";
        2 Manual43 "manual (#43)";
    }

    ALTITUDE_TYPE = "altitude_type", Enumeration, "" {
        0 PressureAltitude "pressure altitude";
        1 BarometricAltitude "barometric altitude";
        2 AboveGround "above ground";
        3 WGS84 "WGS-84";
    }

    SPEED_TYPE = "speed_type", Enumeration, "" {
        0 IndicatedAirspeed "indicated airspeed";
        1 TrueAirspeed "true airspeed";
        2 GroundSpeed "ground speed";
    }

    ALTITUDE_COMMAND_TYPE = "altitude_command_type", Enumeration, "" {
        0 NoValidAltitudeCommand "no valid altitude command";
        1 Altitude "altitude";
        2 VerticalSpeed "vertical speed";
        3 RateLimitedAltitude "rate-limited altitude";
    }

    HEADING_COMMAND_TYPE = "heading_command_type", Enumeration, "" {
        0 NoValidHeadingCommand "no valid heading command";
        1 Heading "heading";
        2 Course "course";
        3 HeadingAndCourse "heading and course";
        4 Roll "roll";
        5 HeadingRate "heading rate";
    }

    LOITER_TYPE = "loiter_type", Enumeration, "" {
        1 Circular "circular";
        2 Racetrack "racetrack";
        3 Figure8 "figure 8";
        4 Hover "hover";
    }

    LOITER_DIRECTION = "loiter_direction", Enumeration, "" {
        0 VehicleDependent "vehicle dependent";
        1 Clockwise "clockwise";
        2 CounterClockwise "counter-clockwise";
        3 IntoTheWind "into the wind";
    }

    LIGHTS_BITMAP = "lights_bitmap", Bitmap, "" {
        0x0001 NAVIGATION "navigation";
        0x0002 NAVIGATION_IR "navigation IR";
        0x0004 STROBE "strobe";
        0x0008 STROBE_IR "strobe IR";
        0x0010 NVD "NVD";
        0x0020 RESERVED "reserved";
        0x0040 LANDING "landing";
        0x0080 LANDING_IR "landing IR";
    }

    ENGINE_COMMAND = "engine_command", Enumeration, "" {
        0 Stop "stop";
        1 Start "start";
        2 EnableRun "enable/run";
        .. "3-9" "reserved";
        .. "10-255" "vehicle specific";
    }

    ENGINE_STATUS = "engine_status", Enumeration, "" {
        0 Stopped "stopped";
        1 Started "started";
        2 EnabledRunning "enabled/running";
        .. "3-9" "reserved";
        .. "10-255" "vehicle specific";
    }

    GAUGE_STATUS = "gauge_status", Enumeration, "" {
        0 NoStatus "no status";
        1 LowRed "low red";
        2 LowYellow "low yellow";
        3 LowGreen "low green";
        4 NormalGreen "normal green";
        5 HighGreen "high green";
        6 HighYellow "high yellow";
        7 HighRed "high red";
    }

    LANDING_GEAR_STATE = "landing_gear_state", Enumeration, "" {
        0 NoValue "no value";
        1 Stowed "stowed";
        2 Cycling "cycling";
        3 Down "down";
        4 Inoperative "inoperative";
    }

    FT_STATE = "ft_state", Enumeration, "" {
        0 Reset "reset";
        1 Arm "arm";
        2 Execute "execute";
    }

    FT_MODE = "ft_mode", Enumeration, "" {
        0 NotSpecified "not specified";
        .. "1-255" "VSM specific";
    }
}
