//! Values of authorisation (LOI, access, stations), configuration, subsystem status, and this project's private messages.

use super::macros::{bitmaps, enumerations};

bitmaps! {
    LoiBitmap(u8) = "loi_bitmap", C, source "E2 + F; piotrmaslanka disagrees (NA=1, LOI2=2, LOI3=4, LOI4=8, LOI5=16)",
        description "LOI bits" {
        NONE = 0x0 "unspecified (request) / not authorised (authorised field) / N/A (granted)";
        LOI2 = 0x1 "LOI 2";
        LOI3 = 0x2 "LOI 3";
        LOI4 = 0x4 "LOI 4";
        LOI5 = 0x8 "LOI 5";
    }

    StationBitmap1To16(u16) = "station_bitmap_1_16", B, source "E2 (u32 in Ed2, split 1-16 / 17-32 in Ed3/4)",
        description "payload stations, bit k = station k+1; 0 = the vehicle itself (no station)" {
        NONE = 0x0 "no station / vehicle";
        STATION_1 = 0x1 "station 1";
        STATION_2 = 0x2 "station 2";
        STATION_3 = 0x4 "station 3";
        STATION_4 = 0x8 "station 4";
        .. "0x10..0x8000" "station 5..16";
    }

    StationBitmap17To32(u16) = "station_bitmap_17_32", B, source "K/T naming",
        description "bit k = station 17+k" {
    }

    SubsystemBitmap(u32) = "subsystem_bitmap", B, source "E2 1000.04",
        description "Subsystem Status Request" {
        ENGINE = 0x1 "engine";
        MECHANICAL = 0x2 "mechanical";
        ELECTRICAL = 0x4 "electrical";
        COMMS = 0x8 "comms";
        PROPULSION_ENERGY = 0x10 "propulsion energy";
        NAVIGATION = 0x20 "navigation";
        PAYLOAD = 0x40 "payload";
        RECOVERY_SYSTEM = 0x80 "recovery system";
        ENVIRONMENTAL_CONTROL = 0x100 "environmental control";
        VSM_STATUS = 0x200 "VSM status";
        ADT = 0x400 "ADT";
        GDT = 0x800 "GDT";
        .. "0x1000..0x80000" "reserved";
        .. "0x100000..0x80000000" "VSM specific";
    }
}

enumerations! {
    RequestedAccess(u8) = "requested_access", C, source "E2; Ed4 value set may be larger",
        description "#1 Requested/Handover Access, Ed2 'Controlled Station Mode' 0001.10" {
        Relinquish = 0 "relinquish / hand off control";
        Request = 1 "request control";
        Override = 2 "override control";
    }

    AccessGranted(u8) = "access_granted", C, source "E2 + K(uid)",
        description "#2 Access Granted keeps unique id 0021.09 = Ed2 Controlled Station Mode" {
        NotInControl = 0 "not in control";
        InControl = 1 "in control";
    }

    WaitTransition(u8) = "wait_transition", C, source "E2 0001.11",
        description "#1 wait for Vehicle Data Link Transition Coordination (#34000)" {
        DoNotWait = 0 "do not wait";
        Wait = 1 "wait for the message";
    }

    FieldSupported(u8) = "field_supported", B, source "E2" {
        NotSupported = 0 "field not supported";
        Supported = 1 "field supported";
    }

    ConfigRequestType(u8) = "config_request_type", C, source "E2 1200.06",
        description "Field Configuration Request" {
        SingleParameter = 0 "single parameter";
        Loi2 = 1 "LOI 2";
        Loi3 = 2 "LOI 3";
        Loi4 = 3 "LOI 4";
        Loi5 = 4 "LOI 5";
        DataLink = 5 "data link";
        Abort = 6 "abort configuration";
    }

    FieldAvailable(u8) = "field_available", B, source "E2 1303.08" {
        NotAvailable = 0 "not available for selection";
        Available = 1 "available for selection";
    }

    EnumIndexEnable(i8) = "enum_index_enable", B, source "E2 1303.10",
        description "signed" {
        NotImplemented = -2 "not implemented (index not supported)";
        Unavailable = -1 "unavailable for selection";
        Available = 0 "available for selection";
    }

    SubsystemId(u8) = "subsystem_id", B, source "E2 1100.06/1101.04",
        description "single subsystem (alert/report/config)" {
        Engine = 0 "engine";
        Mechanical = 1 "mechanical";
        Electrical = 2 "electrical";
        Comms = 3 "comms";
        PropulsionEnergy = 4 "propulsion energy";
        Navigation = 5 "navigation";
        Payload = 6 "payload";
        RecoverySystem = 7 "recovery system";
        EnvironmentalControl = 8 "environmental control";
        VsmStatus = 9 "VSM status";
        Adt = 10 "ADT";
        Gdt = 11 "GDT (CDT)";
        NotAssigned = 19 "not assigned (in field configuration messages)";
        .. "12-18" "reserved";
        .. "20-31" "VSM specific";
    }

    AlertPriority(u8) = "alert_priority", B, source "E2 1100.04/1101.05",
        description "also Subsystem State in the report (0 = no status there)" {
        Cleared = 0 "cleared (alert) / no status (report)";
        Nominal = 1 "nominal";
        Caution = 2 "caution";
        Warning = 3 "warning";
        Emergency = 4 "emergency";
        Failed = 5 "failed";
    }

    AlertType(u8) = "alert_type", B, source "E2 1100.07" {
        Clear = 0 "clear";
        NotClearable = 1 "not clearable by operator";
        Clearable = 2 "clearable by operator";
        Timed = 3 "display for a fixed time then clear";
    }

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
