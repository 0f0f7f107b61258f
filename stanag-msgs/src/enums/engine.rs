//! Values of engines.

use super::EnumInfo;
use super::macros::enumerations;
use crate::table::Confidence::{A, B};

enumerations! {
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
}
