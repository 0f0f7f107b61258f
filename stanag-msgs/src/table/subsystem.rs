//! Subsystem status, alerts and the heartbeat: 15000 to 16002.

use super::info::Confidence::{B, C};
use super::info::Direction::{Both, ToCucs, ToVsm};
use super::info::Layout::{Ed2Derived, Ed4};
use super::info::Traffic::{Push, PushPull};
use super::info::{FieldInfo, MessageInfo};
use super::macros::messages;
use crate::codec::{DataReader, DataWriter, DecodeError, EncodeError};
use crate::enums::{
    AlertPriority, AlertType, StationBitmap1To16, StationBitmap17To32, SubsystemBitmap, SubsystemId,
};
use crate::id::Id;
use crate::scalar::{Text, TimeStamp};

messages! {
    SubsystemStatusRequest = 15000, "Subsystem Status Request", presence bytes 1
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(1000) ed2_message("1000")
        source("E2 #1000; id 15000 by group range")
        corroboration("not applicable")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1000.01");
        subsystem_id: SubsystemBitmap = 1, "Subsystem ID", uid("1000.04");
    }

    SubsystemStatusDetailRequest = 15001, "Subsystem Status Detail Request", presence bytes 1
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(1000) ed2_message("1001")
        source("E2 #1001; id 15001 by group range")
        corroboration("not applicable")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1001.01");
        subsystem_state_report_reference: i32 = 1, "Subsystem State Report Reference",
            uid("1001.04"), note("-1 = none");
    }

    SubsystemStatusAlert = 16000, "Subsystem Status Alert", presence bytes 3
        sent(ToCucs, Push) layout(Ed4, B) latency_ms(1000) ed2_message("1100")
        source("K + E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1100.01");
        data_link_id: Id = 1, "Data Link ID", uid("1100.11");
        priority: AlertPriority = 2, "Priority", uid("1100.04");
        subsystem_state_report_reference: i32 = 3, "Subsystem State Report Reference",
            uid("1100.05"), note("-1 = no more info");
        subsystem_id: SubsystemId = 4, "Subsystem ID", uid("1100.06");
        alert_group: u8 = 5, "Alert Group", uid("16000.01");
        controlled_station_1_16: StationBitmap1To16 = 6, "Controlled Station 1-16", uid("16000.02");
        component_number: u16 = 7, "Component Number", uid("16000.03");
        sub_component_number: u16 = 8, "Sub-Component Number", uid("16000.04");
        alert_type: AlertType = 9, "Type", uid("1100.07");
        alert_warning_id: i32 = 10, "Alert (Warning) ID",
            uid("1100.08"), note("VSM-unique; the first instance is sent negative, updates use the positive value");
        text: Text<80> = 11, "Text", uid("1100.09"), note("E2 length");
        persistence: i8 = 12, "Persistence",
            uid("1100.10"), unit("s"), note("<0 undefined, 0 clear now, >0 minimum display time");
        controlled_station_17_32: StationBitmap17To32 = 13, "Controlled Station 17-32",
            uid("16000.05");
        message_type: u8 = 14, "Message Type",
            uid("1100.12"), note("values not found (part of the append mechanism)");
        append_order: u8 = 15, "Append Order", uid("1100.13");
        append_total_number: u8 = 16, "Append Total Number", uid("1100.14");
    }

    SubsystemStatusReport = 16001, "Subsystem Status Report", presence bytes 2
        sent(ToCucs, PushPull) layout(Ed4, B) latency_ms(1000) ed2_message("1101")
        source("K + E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp",
            uid("1101.01"), note("K types it UInt32: programmer slip, u40 as everywhere");
        subsystem_id: SubsystemId = 1, "Subsystem ID", uid("1101.04");
        subsystem_state: AlertPriority = 2, "Subsystem State", uid("1101.05");
        subsystem_state_report_reference: i32 = 3, "Subsystem State Report Reference",
            uid("1101.06");
        report_text_type: u8 = 4, "Report Text Type", uid("16001.01");
        report_text_reference: Text<80> = 5, "Report Text Reference",
            uid("16001.02"), conf(C), width_inferred(), note("length not found");
        controlled_station_1_16: StationBitmap1To16 = 6, "Controlled Station 1-16", uid("16001.03");
        controlled_station_17_32: StationBitmap17To32 = 7, "Controlled Station 17-32",
            uid("16001.04");
        component_number: u16 = 8, "Component Number", uid("16001.05");
        sub_component_number: u16 = 9, "Sub-Component Number", uid("16001.06");
    }

    Heartbeat = 16002, "Heartbeat", presence bytes 1
        sent(Both, Push) layout(Ed4, C) latency_ms(1000)
        source("T only; its table reference (4-49) cannot be right")
        note("T: 1-byte presence vector and the time stamp only, 1 Hz. K does not list it. Treat id as unconfirmed.")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
    }
}
