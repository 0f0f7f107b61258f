//! Subsystem status and alerts: 1000 to 1101.

use super::rows::messages;
use crate::ed25::values::{
    ALERT_PRIORITY, ALERT_TYPE, SUBSYSTEM_BITMAP, SUBSYSTEM_ID, SUBSYSTEM_STATE,
};
use crate::field::Wire::{Char, F64, I8, I32, U8, U32};

messages! {
    SubsystemStatusRequest = 1000, "Subsystem Status Request"
        sent(ToVsm, Push) latency_ms(1000) loi(&[2, 3, 4])
        text("4.1.6.1", "B1-71") ed4(&[15000])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1000.01"), unit("s since 1970"), ed4(15000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1000.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1000.03"), identification();
        subsystem_id: U32 = 4, "Subsystem ID", uid("1000.04"), values(&SUBSYSTEM_BITMAP), ed4(15000, 2);
    }

    SubsystemStatusDetailRequest = 1001, "Subsystem Status Detail Request"
        sent(ToVsm, Push) latency_ms(1000) loi(&[2, 3, 4])
        text("4.1.6.2", "B1-72") ed4(&[15001])
        note("answered with a vehicle specific (remote) display, not with a DLI message")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1001.01"), unit("s since 1970"), ed4(15001, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1001.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1001.03"), identification();
        subsystem_state_report_reference: I32 = 4, "Subsystem State Report Reference",
            uid("1001.04"), range(-1.0, 2147483647.0), ed4(15001, 2),
            note("number given in #1100 or #1101; -1 = no more info");
    }

    SubsystemStatusAlert = 1100, "Subsystem Status Alert"
        sent(ToCucs, Push) latency_ms(1000) loi(&[2, 3, 4])
        text("4.1.6.3", "B1-73") ed4(&[16000])
        note("an alert that the operator cannot clear is cleared by sending it again with priority 0")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1100.01"), unit("s since 1970"), ed4(16000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1100.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1100.03"), identification();
        priority: U8 = 4, "Priority", uid("1100.04"), values(&ALERT_PRIORITY), ed4(16000, 3);
        subsystem_state_report_reference: I32 = 5, "Subsystem State Report Reference",
            uid("1100.05"), range(-1.0, 2147483647.0), ed4(16000, 4), note("for #1001; -1 = no more info");
        subsystem_id: U8 = 6, "Subsystem ID", uid("1100.06"), values(&SUBSYSTEM_ID), ed4(16000, 5);
        type_: U8 = 7, "Type", uid("1100.07"), values(&ALERT_TYPE), ed4(16000, 10);
        warning_id: I32 = 8, "Warning ID",
            uid("1100.08"), ed4(16000, 11),
            note("unique number of the alert: negative in the first instance, so that updates can refer to it");
        text: Char(80) = 9, "Text", uid("1100.09"), ed4(16000, 12);
        persistence: I8 = 10, "Persistence",
            uid("1100.10"), unit("s"), ed4(16000, 13),
            note("type cell reads 'Signed 1'; minimum display time from receipt: <0 not defined, 0 clear now");
    }

    SubsystemStatusReport = 1101, "Subsystem Status Report"
        sent(ToCucs, PushPull) latency_ms(1000) loi(&[2, 3, 4])
        text("4.1.6.4", "B1-74") ed4(&[16001])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1101.01"), unit("s since 1970"), ed4(16001, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1101.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1101.03"), identification();
        subsystem_id: U8 = 4, "Subsystem ID", uid("1101.04"), values(&SUBSYSTEM_ID), ed4(16001, 2);
        subsystem_state: U8 = 5, "Subsystem State", uid("1101.05"), values(&SUBSYSTEM_STATE), ed4(16001, 3);
        subsystem_state_report_reference: I32 = 6, "Subsystem State Report Reference",
            uid("1101.06"), range(-1.0, 2147483647.0), ed4(16001, 4), note("for #1001; -1 = no more info");
    }
}
