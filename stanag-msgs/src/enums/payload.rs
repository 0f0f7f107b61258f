//! Values of payloads, identification friend or foe, data links and handover.

use super::macros::{bitmaps, enumerations};

bitmaps! {
    AddressedSensor(u8) = "addressed_sensor", B, source "E2 + F" {
        EO = 0x1 "EO";
        IR = 0x2 "IR";
        PAYLOAD_SPECIFIC = 0x4 "payload specific";
    }
}

enumerations! {
    EoirPointingMode(u8) = "eoir_pointing_mode", B, source "E2 0201.10 + F" {
        NoValue = 0 "no value";
        AngleToUa = 1 "angle relative to UA";
        SlewRateToUa = 2 "slew rate relative to UA";
        SlewRateInertial = 3 "slew rate relative to inertial";
        LatLongSlaved = 4 "lat-long slaved";
        TargetSlaved = 5 "target slaved (track)";
        .. "6-9" "reserved";
        .. "10-255" "payload specific";
    }

    EoirSystemMode(u8) = "eoir_system_mode", B, source "E2 0201.06 + F",
        description "command; the state message uses the past tense" {
        Stow = 0 "stow";
        Off = 1 "off";
        Cage = 2 "cage";
        Initialise = 3 "initialise";
        Standby = 4 "standby";
        Active = 5 "active";
        Calibrate = 6 "calibrate";
        .. "7-9" "reserved";
        .. "10-255" "payload specific";
    }

    EoMode(u8) = "eo_mode", B, source "E2 + F" {
        BlackWhite = 0 "black/white";
        Colour = 1 "colour";
    }

    IrPolarity(u8) = "ir_polarity", B, source "E2 + F" {
        BlackHot = 0 "black hot";
        WhiteHot = 1 "white hot";
    }

    VideoStreamType(u8) = "video_stream_type", A, source "this project, as MAVLink's VIDEO_STREAM_TYPE",
        description "how a video stream is received" {
        Rtsp = 0 "RTSP";
        RtpUdp = 1 "RTP over UDP";
        TcpMpeg = 2 "MPEG over TCP";
        MpegTs = 3 "MPEG transport stream over UDP";
        Whep = 4 "WHEP";
    }

    VideoEncoding(u8) = "video_encoding", A, source "this project, as MAVLink's VIDEO_STREAM_ENCODING",
        description "how the pictures of a video stream are encoded" {
        NotReported = 0 "not reported";
        H264 = 1 "H.264";
        H265 = 2 "H.265";
    }

    ImageOutput(u8) = "image_output", B, source "E2 + F" {
        None = 0 "none";
        Eo = 1 "EO";
        Ir = 2 "IR";
        Both = 3 "both";
        PayloadSpecific = 4 "payload specific";
    }

    LaserPointerCmd(u8) = "laser_pointer_cmd", B, source "F",
        description "F splits pointer and rangefinder; E2 has one field with bit patterns 0x00 off, 0x33 on not firing, 0x55 one pulse, 0xEE fire" {
        Off = 0 "off";
        Arm = 51 "arm";
        OnSafe = 68 "on, safe";
        Fire = 238 "fire";
    }

    LaserRfCmd(u8) = "laser_rf_cmd", B, source "F" {
        Off = 0 "off";
        Arm = 51 "arm";
        OnSafe = 68 "on, safe";
        FireOnePulse = 85 "fire one pulse";
        FireMultiplePulses = 238 "fire multiple pulses";
    }

    LaserDesignatorCmd(u8) = "laser_designator_cmd", B, source "F",
        description "E2: 0x00 off, 0x33 on, 0x44 deactivate, 0x55 activate" {
        Off = 0 "off";
        Arm = 51 "arm";
        OnSafe = 68 "on, safe";
        Fire = 85 "fire";
    }

    FirstLastPulse(u8) = "first_last_pulse", B, source "E2+F" {
        First = 1 "first";
        Last = 2 "last";
    }

    PreplanMode(u8) = "preplan_mode", C, source "E2",
        description "E2: 0/1; F's state message uses 1/2" {
        OperatePreplanned = 0 "operate preplanned";
        OperateManual = 1 "operate manual";
    }

    SetZoom(u8) = "set_zoom", B, source "E2 0200.17 + F" {
        UseFieldsOfView = 0 "use the commanded fields of view";
        NoChange = 1 "no change / stop zoom";
        ZoomIn = 2 "zoom in";
        ZoomOut = 3 "zoom out";
    }

    SetFocus(u8) = "set_focus", B, source "E2 + F" {
        NoChange = 0 "no change";
        FocusCloser = 1 "focus closer";
        FocusFarther = 2 "focus farther";
    }

    FocusType(u8) = "focus_type", B, source "E2 + F" {
        Auto = 0 "auto";
        Manual = 1 "manual";
    }

    PayloadType(u8) = "payload_type", B, source "E2 0300.07 + F",
        description "E2 ends at 7; F adds 8-11" {
        NotSpecified = 0 "not specified";
        Eo = 1 "EO";
        Ir = 2 "IR";
        EoIr = 3 "EO/IR";
        Sar = 4 "SAR";
        FixedCamera = 5 "fixed camera";
        CommsRelay = 6 "comms relay";
        DispensablePayload = 7 "dispensable payload";
        Recorder = 8 "recorder (F)";
        PayloadBayDoor = 9 "payload bay door (F)";
        Cbrn = 10 "CBRN (F)";
        StoresManagementSystem = 11 "stores management system (F)";
        .. "12-50" "reserved";
        .. "51-255" "VSM specific";
    }

    IffOnoff(u8) = "iff_onoff", C, source "E2" {
        Off = 0 "off";
        On = 1 "on";
    }

    IffMode(u8) = "iff_mode", C, source "E2 1500.15" {
        Off = 0 "off";
        Standby = 1 "standby";
        Normal = 2 "normal";
        Emergency = 3 "emergency";
    }

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
