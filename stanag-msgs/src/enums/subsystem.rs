//! Values of subsystem status and alerts.

use super::EnumInfo;
use super::macros::{bitmaps, enumerations};
use crate::table::Confidence::B;

bitmaps! {
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
}
