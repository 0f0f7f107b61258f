//! Values of data links.

use super::values;

values! {
    DL_TERMINAL = "dl_terminal", Enumeration, "" {
        0 GDT "GDT";
        1 ADT "ADT";
    }

    DL_STATE = "dl_state", Enumeration, "" {
        0 Off "off";
        1 ReceiveOnly "receive only";
        2 TransmitAndReceive "transmit and receive";
        3 TransmitHighPowerAndReceive "transmit high power and receive";
    }

    DL_ANTENNA_MODE = "dl_antenna_mode", Enumeration, "" {
        0 Omni "omni";
        1 Directional "directional";
        2 Auto "auto";
    }

    DL_ANTENNA_STATE = "dl_antenna_state", Enumeration, "" {
        0 Omni "omni";
        1 Directional "directional";
    }

    DL_COMSEC_MODE = "dl_comsec_mode", Enumeration, "" {
        0 Normal "normal";
        1 Zeroize "zeroize";
    }

    DL_COMSEC_STATE = "dl_comsec_state", Enumeration, "" {
        0 NotInstalled "not installed";
        1 NotKeyed "not keyed";
        2 Keyed "keyed";
        3 Zeroized "zeroized";
        4 Bypass "bypass";
    }

    DL_PRIORITY = "dl_priority", Enumeration, "" {
        0 Primary "primary";
        1 Secondary "secondary";
        2 Tertiary "tertiary";
        255 Last "last";
        .. "3-254" "in between";
    }

    DL_ASSIGNMENT_REQUEST = "dl_assignment_request", Enumeration, "" {
        0 RequestControl "request control";
        1 ReleaseControl "release control";
        2 OverrideControl "override control";
    }

    DL_CONTROL_AVAILABILITY = "dl_control_availability", Enumeration, "" {
        0 AvailableForControl "available for control";
        1 UnavailableForControl "unavailable for control";
        2 RequestGranted "request granted";
    }

    DL_TYPE = "dl_type", Enumeration, "" {
        0 STANAG7085 "STANAG 7085";
        .. "1-7" "reserved";
        .. "8-255" "VSM specific";
    }

    ANTENNA_TYPE = "antenna_type", Bitmap, "" {
        0x01 OMNI "omni";
        0x02 DIRECTIONAL "directional";
    }

    PEDESTAL_MODE = "pedestal_mode", Enumeration, "" {
        0 TurnOff "turn off";
        1 TurnOn "turn on";
        2 GoToStandby "go to standby";
        3 Deploy "deploy";
        4 Stow "stow";
        5 ManualPosition "manual position";
        6 ManualRate "manual rate";
        7 AcquireSearch "acquire (search)";
        8 TrackAuto "track (auto)";
    }

    HANDOVER_STATUS = "handover_status", Enumeration, "" {
        0 NotRequested "not requested";
        1 InProgress "in progress";
        2 Successful "successful";
        3 Failed "failed";
    }
}
