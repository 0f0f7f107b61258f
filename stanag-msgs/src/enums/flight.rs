//! Values of flight commands and status, engines, and missions.

use super::macros::{bitmaps, enumerations};

bitmaps! {
    LightsBitmap(u16) = "lights_bitmap", B, source "E2 0044.04/0107.04",
        description "set = on" {
        NAV = 0x1 "nav";
        NAV_IR = 0x2 "nav IR";
        STROBE = 0x4 "strobe";
        STROBE_IR = 0x8 "strobe IR";
        NVD_COMPATIBLE = 0x10 "NVD compatible";
        RESERVED = 0x20 "reserved";
        LANDING = 0x40 "landing";
        LANDING_IR = 0x80 "landing IR";
    }
}

enumerations! {
    AltitudeType(u8) = "altitude_type", A, source "E3+E2+F",
        description "reference of every altitude in the message" {
        Pressure = 0 "pressure altitude";
        Barometric = 1 "baro altitude";
        Agl = 2 "AGL";
        Wgs84 = 3 "WGS-84 (text adds 'geoid': datum ambiguous)";
    }

    SpeedType(u8) = "speed_type", A, source "E3(3002)+E2",
        description "reference of every speed in the message" {
        Indicated = 0 "indicated/calibrated airspeed";
        True = 1 "true airspeed";
        Ground = 2 "ground speed";
        Thrust = 3 "thrust (E3 #3002; not in E2)";
    }

    FlightPathControlMode(u8) = "flight_path_control_mode", C, source "E2 0042.04; names 23..25 only from the Korean paper, values inferred",
        description "flight mode; 1-10 manual family, 11-31 automatic family in Ed2" {
        NoMode = 0 "no mode";
        Reserved = 1 "reserved";
        FlightDirector = 2 "flight director (manual, autopilot off)";
        Waypoint = 11 "waypoint";
        Loiter = 12 "loiter";
        Autopilot = 15 "autopilot (engaged, steering fields override)";
        TerrainAvoidance = 16 "terrain avoidance";
        NavaidSlaved = 17 "navaid-slaved navigation";
        AutolandEngage = 19 "autoland engage";
        AutolandWaveOff = 20 "autoland wave-off";
        Launch = 21 "launch";
        SlaveToSensor = 22 "slave to sensor";
        ContingencyA = 23 "? fly contingency A (value inferred)";
        ContingencyB = 24 "? fly contingency B (value inferred)";
        SlaveToLocation = 25 "? slave to location (value inferred)";
        .. "3-10" "reserved";
        .. "13-14" "reserved";
        .. "18" "reserved";
        .. "26-31" "reserved";
        .. "32-255" "vehicle (VSM) specific";
    }

    AltitudeCommandType(u8) = "altitude_command_type", B, source "E3 (1-3) + E2 (0)",
        description "how the altitude fields are used" {
        None = 0 "no valid altitude command";
        Altitude = 1 "altitude";
        VerticalSpeed = 2 "vertical speed";
        RateLimitedAltitude = 3 "rate-limited altitude (vertical speed field = limit)";
    }

    HeadingCommandType(u8) = "heading_command_type", B, source "E3 (1-5) + E2 (0)",
        description "how heading/course/roll fields are used" {
        None = 0 "no valid heading command";
        Heading = 1 "heading";
        Course = 2 "course";
        HeadingAndCourse = 3 "heading and course";
        Roll = 4 "roll";
        TurnRate = 5 "heading (turn) rate";
    }

    UaState(u8) = "ua_state", B, source "E3; Ed4 may add airborne phases",
        description "UA (AV) State 3002.01" {
        NotKnown = 0 "unknown";
        PowerUp = 1 "power up";
        PreStart = 2 "pre-start";
        PreLaunch = 3 "pre-launch";
        LaunchAbort = 4 "launch abort";
        .. "5-9" "reserved in E3";
        .. "10-255" "VSM specific in E3";
    }

    LoiterType(u8) = "loiter_type", C, source "E2 0041.04/0803.06",
        description "loiter pattern" {
        Circular = 1 "circular";
        Racetrack = 2 "racetrack";
        Figure8 = 3 "figure 8";
        Hover = 4 "hover";
    }

    LoiterDirection(u8) = "loiter_direction", C, source "E2 0041.08/0803.10",
        description "turn direction around the loiter point" {
        VehicleDependent = 0 "vehicle dependent";
        Clockwise = 1 "clockwise";
        CounterClockwise = 2 "counter-clockwise";
        IntoWind = 3 "into the wind";
    }

    FtState(u8) = "ft_state", B, source "E2 0046.04/0108.04",
        description "flight termination state" {
        Reset = 0 "reset FT system";
        Arm = 1 "arm FT system";
        Execute = 2 "execute FT sequence";
    }

    FtMode(u8) = "ft_mode", B, source "E2" {
        NotSpecified = 0 "not specified";
        .. "1-255" "VSM specific";
    }

    CommandedEngineState(u8) = "engine_command", A, source "T+E2" {
        Stop = 0 "stop";
        Start = 1 "start";
        Enable = 2 "enable/run";
        .. "3-9" "reserved";
        .. "10-255" "VSM specific";
    }

    EngineStatus(u8) = "engine_status", A, source "T+E2" {
        Stopped = 0 "stopped";
        Started = 1 "started";
        Running = 2 "enabled/running";
        .. "3-9" "reserved";
        .. "10-255" "VSM specific";
    }

    OffOnNotspec(u8) = "off_on_notspec", A, source "T (#2008)" {
        Off = 0 "off";
        On = 1 "on";
        NotSpecified = 2 "not specified";
    }

    ReverseThrust(u8) = "reverse_thrust", A, source "T (#2008)" {
        Off = 0 "off, all engines";
        On = 1 "on, all engines";
        Auto = 2 "auto, all engines";
        NotSpecified = 3 "not specified";
    }

    GaugeStatus(u8) = "gauge_status", B, source "E2 0105.09-16",
        description "status bands for temperatures, pressures, torque, fire sensor" {
        NoStatus = 0 "no status";
        LowRed = 1 "low red";
        LowYellow = 2 "low yellow";
        LowGreen = 3 "low green";
        NormalGreen = 4 "normal green";
        HighGreen = 5 "high green";
        HighYellow = 6 "high yellow";
        HighRed = 7 "high red";
    }

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
