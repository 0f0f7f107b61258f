//! Values of subsystem status and of alerts.

use super::values;

values! {
    SUBSYSTEM_BITMAP = "subsystem_bitmap", Bitmap, "" {
        0x0001 ENGINE "engine";
        0x0002 MECHANICAL "mechanical";
        0x0004 ELECTRICAL "electrical";
        0x0008 COMMS "comms";
        0x0010 PROPULSION_ENERGY "propulsion energy";
        0x0020 NAVIGATION "navigation";
        0x0040 PAYLOAD "payload";
        0x0080 RECOVERY_SYSTEM "recovery system";
        0x0100 ENVIRONMENTAL_CONTROL_SYSTEM "environmental control system";
        0x0200 VSM_STATUS "VSM status";
        0x0400 ADT "ADT";
        0x0800 GDT "GDT";
        .. "0x1000..0x80000" "reserved";
        .. "0x100000..0x80000000" "VSM specific";
    }

    SUBSYSTEM_ID = "subsystem_id", Enumeration, "the bit number of subsystem_bitmap" {
        0 Engine "engine";
        1 Mechanical "mechanical";
        2 Electrical "electrical";
        3 Comms "comms";
        4 PropulsionEnergy "propulsion energy";
        5 Navigation "navigation";
        6 Payload "payload";
        7 RecoverySystem "recovery system";
        8 EnvironmentalControlSystem "environmental control system";
        9 VSMStatus "VSM status";
        10 ADT "ADT";
        11 GDT "GDT";
        .. "12-19" "reserved";
        .. "20-31" "VSM specific";
    }

    ALERT_PRIORITY = "alert_priority", Enumeration, "" {
        0 Cleared "cleared";
        1 Nominal "nominal";
        2 Caution "caution";
        3 Warning "warning";
        4 Emergency "emergency";
        5 Failed "failed";
    }

    ALERT_TYPE = "alert_type", Enumeration, "" {
        0 Clear "clear";
        1 NotClearableByTheOperator "not clearable by the operator";
        2 ClearableByTheOperator "clearable by the operator";
        3 DisplayForAFixedTimeThenClear "display for a fixed time, then clear";
    }

    SUBSYSTEM_STATE = "subsystem_state", Enumeration, "" {
        0 NoStatus "no status";
        1 Nominal "nominal";
        2 Caution "caution";
        3 Warning "warning";
        4 Emergency "emergency";
        5 Failed "failed";
    }
}
