//! Values of data links and handover.

use super::EnumInfo;
use super::macros::enumerations;
use crate::table::Confidence::{B, C};

enumerations! {
    DlTerminal(u8) = "dl_terminal", B, source "E2" {
        Gdt = 0 "GDT (CDT)";
        Adt = 1 "ADT (VDT)";
    }

    DlControlAvailability(u8) = "dl_control_availability", B, source "E2 0500.06" {
        Available = 0 "available for control";
        Unavailable = 1 "unavailable";
        RequestGranted = 2 "request granted";
    }

    DlState(u8) = "dl_state", B, source "E2 0501.06" {
        Off = 0 "off";
        RxOnly = 1 "rx only";
        TxRx = 2 "tx/rx";
        TxHighPower = 3 "tx high power / rx";
    }

    DlAntennaState(u8) = "dl_antenna_state", B, source "E2" {
        Omni = 0 "omni";
        Directional = 1 "directional";
        Auto = 2 "auto (commands only)";
    }

    DlComsecState(u8) = "dl_comsec_state", B, source "E2 0501.13" {
        NotInstalled = 0 "not installed";
        NotKeyed = 1 "not keyed";
        Keyed = 2 "keyed";
        Zeroized = 3 "zeroized";
        Bypass = 4 "bypass";
    }

    DlComsecMode(u8) = "dl_comsec_mode", B, source "E2" {
        Normal = 0 "normal";
        Zeroize = 1 "zeroize";
    }

    DlPriority(u8) = "dl_priority", B, source "E2" {
        Primary = 0 "primary";
        Secondary = 1 "secondary";
        Tertiary = 2 "tertiary";
        .. "3-254" "further";
        .. "255" "last";
    }

    DlType(u8) = "dl_type", B, source "E2 0500.08" {
        Stanag7085 = 0 "STANAG 7085";
        .. "1-7" "reserved";
        .. "8-255" "VSM specific";
    }

    PedestalMode(u8) = "pedestal_mode", B, source "E2 0403.06/0503.06" {
        Off = 0 "off";
        On = 1 "on";
        Standby = 2 "standby";
        Deploy = 3 "deploy";
        Stow = 4 "stow";
        ManualPosition = 5 "manual position";
        ManualRate = 6 "manual rate";
        Acquire = 7 "acquire (search)";
        Track = 8 "track (auto)";
    }

    HandoverStatus(u8) = "handover_status", C, source "E2 0700.05" {
        NotRequested = 0 "handover not requested";
        InProgress = 1 "in progress";
        Successful = 2 "successful";
        Failed = 3 "failed";
    }
}
