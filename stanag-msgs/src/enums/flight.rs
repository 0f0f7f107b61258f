//! Values of flight commands and status: modes, altitudes, speeds, headings, loiter.

use super::EnumInfo;
use super::macros::{bitmaps, enumerations};
use crate::table::Confidence::{A, B, C};

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
}
