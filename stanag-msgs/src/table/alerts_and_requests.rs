//! Subsystem status, alerts and heartbeat; acknowledgement, schedules and requests; files, weather, GPS: 15000 to 18500.

use std::f64::consts::FRAC_PI_2;

use super::codec::messages;
use crate::enums::{
    AckType, AlertPriority, AlertType, StationBitmap1To16, StationBitmap17To32, SubsystemBitmap,
    SubsystemId,
};
use crate::id::Id;
use crate::scalar::{Altitude, Bam32, Temperature, Text, TimeStamp, U24, U40, UnsizedText};

messages! {
    SubsystemStatusRequest = 15000, "Subsystem Status Request", presence bytes 1
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(1000) ed2_message("1000")
        source("E2 #1000; id 15000 by group range")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1000.01");
        subsystem_id: SubsystemBitmap = 1, "Subsystem ID", uid("1000.04");
    }

    SubsystemStatusDetailRequest = 15001, "Subsystem Status Detail Request", presence bytes 1
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(1000) ed2_message("1001")
        source("E2 #1001; id 15001 by group range")
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

    MessageAcknowledgement = 17000, "Message Acknowledgement", presence bytes 1
        sent(Both, Pull) layout(Ed4, A) latency_ms(500) ed2_message("1400")
        source("T+K agree on all 4")
        corroboration("T+K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1400.01");
        original_message_time_stamp: TimeStamp = 1, "Original Message Time Stamp", uid("1400.06");
        original_message_type: u16 = 2, "Original Message Type", uid("1400.08");
        acknowledgement_type: AckType = 3, "Acknowledgement Type", uid("17000.01");
    }

    ScheduleMessageUpdateCommand = 17001, "Schedule Message Update Command", presence bytes 1
        sent(Both, Push) layout(Ed4, B) latency_ms(2000) ed2_message("1402")
        source("K + E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1402.01");
        requested_message_type: u16 = 1, "Requested Message Type", uid("1402.04");
        frequency: u16 = 2, "Frequency",
            uid("1402.05"), unit("Hz"), note("E2 float Hz 0..100, 0 cancels; Ed4 is 16 bit, scale not found");
        activity_id: U24 = 3, "Activity ID", uid("17001.01");
    }

    GenericInformationRequestMessage = 17002, "Generic Information Request Message", presence bytes 1
        sent(Both, Push) layout(Ed4, B) latency_ms(1000) ed2_message("1403")
        source("K + E2")
        note("not for requesting field configuration responses; those are requested with 40000")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1403.01");
        station_number_1_16: StationBitmap1To16 = 1, "Station Number 1-16", uid("1403.06");
        component_number: u16 = 2, "Component Number", uid("17002.01");
        sub_component_number: u16 = 3, "Sub-Component Number", uid("17002.02");
        message_type: u16 = 4, "Message Type", uid("1403.07");
        requested_field_presence_vector: U40 = 5, "Requested Field Presence Vector",
            uid("17002.04"), note("K 64-bit holder = Unsigned 5; 5 bytes is also the widest presence vector (3007)");
        activity_id: U24 = 6, "Activity ID", uid("17002.05");
        station_number_17_32: StationBitmap17To32 = 7, "Station Number 17-32", uid("17002.03");
    }

    FileTransferNotification = 17003, "File Transfer Notification", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("17003.01");
        file_type: u8 = 1, "File Type", uid("17003.02");
        file_name: UnsizedText = 2, "File Name", uid("17003.03"), conf(C), note("length not found");
    }

    MeteorologicalTableReport = 18300, "Meteorological Table Report", presence bytes 2
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("18300.01");
        publish_time: TimeStamp = 1, "Publish Time", uid("18300.02");
        forecast_time: TimeStamp = 2, "Forecast Time", uid("18300.03");
        latitude: Bam32 = 3, "Latitude", uid("18300.04"), range(-FRAC_PI_2, FRAC_PI_2);
        longitude: Bam32 = 4, "Longitude", uid("18300.05");
        number_of_levels: u8 = 5, "Number of Levels", uid("18300.06");
        altitude: Altitude = 6, "Altitude", uid("18300.07");
        u_speed: i16 = 7, "U_Speed", uid("18300.08"), unit("m/s");
        v_speed: i16 = 8, "V_Speed", uid("18300.09"), unit("m/s");
        temperature: Temperature = 9, "Temperature", uid("18300.10"), conf(C);
        humidity: u8 = 10, "Humidity", uid("18300.11"), unit("%");
    }

    GpsStatusReport = 18500, "GPS Status Report", presence bytes 2
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
        note("mode/status values and DOP scales not found")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("18500.01");
        number_of_satellites: u8 = 1, "Number of Satellites", uid("18500.02");
        gps_mode: u8 = 2, "GPS Mode", uid("18500.03");
        gps_status: u8 = 3, "GPS Status", uid("18500.04");
        pdop: u8 = 4, "PDOP", uid("18500.05");
        hdop: u8 = 5, "HDOP", uid("18500.06");
        vdop: u8 = 6, "VDOP", uid("18500.07");
        reserved: u8 = 7, "Reserved", uid("18500.08");
        gps_time: TimeStamp = 8, "GPS Time", uid("18500.09"), conf(C), width_inferred();
    }
}
