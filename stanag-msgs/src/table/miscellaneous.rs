//! Acknowledgement, schedules, requests, files, weather, GPS: 17000 to 18500.

use std::f64::consts::FRAC_PI_2;

use super::info::Confidence::{A, B, C};
use super::info::Direction::{Both, ToCucs};
use super::info::Layout::Ed4;
use super::info::Traffic::{Pull, Push};
use super::info::{FieldInfo, MessageInfo};
use super::macros::messages;
use crate::codec::{DataReader, DataWriter, DecodeError, EncodeError};
use crate::enums::{AckType, StationBitmap1To16, StationBitmap17To32};
use crate::scalar::{Altitude, Bam32, Temperature, TimeStamp, U24, U40, UnsizedText};

messages! {
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
        note("not for requesting field configuration responses; those are asked with 40000")
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
