//! Configuration before connection: 40000 to 41005.

use super::info::Confidence::{B, C};
use super::info::Direction::{ToCucs, ToVsm};
use super::info::Layout::{Ed2Derived, Ed4};
use super::info::Traffic::{Push, PushPull};
use super::info::{FieldInfo, MessageInfo};
use super::macros::messages;
use crate::codec::{DataReader, DataWriter, DecodeError, EncodeError};
use crate::enums::{
    ConfigRequestType, FieldSupported, RouteType, StationBitmap1To16, StationBitmap17To32,
    SubsystemId,
};
use crate::id::Id;
use crate::scalar::{Text, TimeStamp};

messages! {
    FieldConfigurationRequest = 40000, "Field Configuration Request", presence bytes 1
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(2000) ed2_message("1200")
        source("E2 #1200 = F")
        corroboration("not applicable")
        note("by analogy with 41000 expect Station 1-16, Component, Sub-Component, Route Type, Station 17-32 in Ed4")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1200.01");
        vsm_id: Id = 1, "VSM ID", uid("1200.04");
        data_link_id: Id = 2, "Data Link ID", uid("1200.05"), note("0 = N/A");
        request_type: ConfigRequestType = 3, "Request Type", uid("1200.06");
        requested_message: u32 = 4, "Requested Message",
            uid("1200.07"), conf(C), note("0 = N/A; u16 in the 44000 family");
        requested_field: u8 = 5, "Requested Field", uid("1200.08"), note("field number");
        station_number_1_16: StationBitmap1To16 = 6, "Station Number 1-16", uid("1200.09");
        sensor_select: u8 = 7, "Sensor Select",
            uid("1200.10"), note("0 N/A, 1..3 sensor; may be replaced by Component Number");
    }

    FieldConfigurationIntegerResponse = 41000, "Field Configuration Integer Response", presence bytes 4
        sent(ToCucs, PushPull) layout(Ed4, B) ed2_message("1300")
        source("K + E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1300.01");
        vsm_id: Id = 1, "VSM ID", uid("1300.04");
        data_link_id: Id = 2, "Data Link ID", uid("1300.05"), note("0 = N/A");
        station_number_1_16: StationBitmap1To16 = 3, "Station Number 1-16", uid("1300.06");
        component_number: u16 = 4, "Component Number", uid("41000.01");
        sub_component_number: u16 = 5, "Sub-Component Number", uid("41000.02");
        requested_message: u32 = 6, "Requested Message",
            uid("1300.07"), conf(C), width_inferred(), note("K 32-bit holder (Unsigned 4 in E2)");
        requested_field: u8 = 7, "Requested Field", uid("1300.08");
        field_supported: FieldSupported = 8, "Field Supported", uid("1300.09");
        default_value: i32 = 9, "Default Value";
        max_value: i32 = 10, "Max Value";
        min_value: i32 = 11, "Min Value";
        max_display_value: i32 = 12, "Max Display Value";
        min_display_value: i32 = 13, "Min Display Value";
        minimum_display_resolution: i32 = 14, "Minimum Display Resolution";
        high_caution_limit: i32 = 15, "High Caution Limit";
        high_warning_limit: i32 = 16, "High Warning Limit";
        low_caution_limit: i32 = 17, "Low Caution Limit";
        low_warning_limit: i32 = 18, "Low Warning Limit";
        help_text: Text<80> = 19, "Help Text", uid("1300.19");
        subsystem_id: SubsystemId = 20, "Subsystem ID", uid("1300.20");
        route_type: RouteType = 21, "Route Type", uid("1300.21");
        station_number_17_32: StationBitmap17To32 = 22, "Station Number 17-32";
        warning_and_caution_limits_usage: u8 = 23, "Warning and Caution Limits Usage";
        disable_alert_caution: u8 = 24, "Disable Alert/Caution";
    }

    FieldConfigurationFloatResponse = 41001, "Field Configuration Float Response", presence bytes 4
        sent(ToCucs, PushPull) layout(Ed4, B) ed2_message("1301")
        source("K + E2")
        note("Ed2 used doubles; K float")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1301.01");
        vsm_id: Id = 1, "VSM ID", uid("1301.04");
        data_link_id: Id = 2, "Data Link ID", uid("1301.05"), note("0 = N/A");
        station_number_1_16: StationBitmap1To16 = 3, "Station Number 1-16", uid("1301.06");
        component_number: u16 = 4, "Component Number", uid("41001.01");
        sub_component_number: u16 = 5, "Sub-Component Number", uid("41001.02");
        requested_message: u32 = 6, "Requested Message",
            uid("1301.07"), conf(C), width_inferred(), note("K 32-bit holder (Unsigned 4 in E2)");
        requested_field: u8 = 7, "Requested Field", uid("1301.08");
        field_supported: FieldSupported = 8, "Field Supported", uid("1301.09");
        default_value: f32 = 9, "Default Value";
        max_value: f32 = 10, "Max Value";
        min_value: f32 = 11, "Min Value";
        max_display_value: f32 = 12, "Max Display Value";
        min_display_value: f32 = 13, "Min Display Value";
        minimum_display_resolution: f32 = 14, "Minimum Display Resolution";
        high_caution_limit: f32 = 15, "High Caution Limit";
        high_warning_limit: f32 = 16, "High Warning Limit";
        low_caution_limit: f32 = 17, "Low Caution Limit";
        low_warning_limit: f32 = 18, "Low Warning Limit";
        help_text: Text<80> = 19, "Help Text", uid("1301.19");
        subsystem_id: SubsystemId = 20, "Subsystem ID", uid("1301.20");
        route_type: RouteType = 21, "Route Type", uid("1301.21");
        station_number_17_32: StationBitmap17To32 = 22, "Station Number 17-32";
        warning_and_caution_limits_usage: u8 = 23, "Warning and Caution Limits Usage";
        disable_alert_caution: u8 = 24, "Disable Alert/Caution";
    }

    FieldConfigurationEnumeratedResponse = 41002, "Field Configuration Enumerated Response", presence bytes 3
        sent(ToCucs, PushPull) layout(Ed4, B) ed2_message("1302")
        source("K + E2")
        note("for bit fields the right-most bit is enumeration index 0 (E2)")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1302.01");
        vsm_id: Id = 1, "VSM ID", uid("1302.04");
        data_link_id: Id = 2, "Data Link ID", uid("1302.05");
        station_number_1_16: u16 = 3, "Station Number 1-16", uid("1302.06");
        component_number: u16 = 4, "Component Number", uid("41002.01");
        sub_component_number: u16 = 5, "Sub-Component Number", uid("41002.02");
        requested_message: u32 = 6, "Requested Message", uid("1302.07"), conf(C), width_inferred();
        requested_field: u8 = 7, "Requested Field", uid("1302.08");
        field_supported: FieldSupported = 8, "Field Supported", uid("1302.09");
        default_value: u8 = 9, "Default Value", uid("41002.03");
        vehicle_specific_enumeration_count: u8 = 10, "Vehicle Specific Enumeration Count",
            uid("1302.10");
        vehicle_specific_enumeration_index: u8 = 11, "Vehicle Specific Enumeration Index",
            uid("1302.11");
        vehicle_specific_enumeration_text: Text<16> = 12, "Vehicle Specific Enumeration Text",
            uid("1302.12");
        vehicle_specific_help_text: Text<80> = 13, "Vehicle Specific Help Text", uid("1302.13");
        remove_enumerated_index: u8 = 14, "Remove Enumerated Index", uid("41002.05");
        route_type: RouteType = 15, "Route Type", uid("1302.14");
        station_number_17_32: u16 = 16, "Station Number 17-32", uid("41002.04");
    }

    FieldConfigurationUnsignedResponse = 41003, "Field Configuration Unsigned Response", presence bytes 4
        sent(ToCucs, PushPull) layout(Ed4, B)
        source("K")
        note("uids differ: .05 time, .06 VSM, .07 DL, .08 stn, .09 msg, .10 field, .11 supported, .24 default, .12-.20 limits, .21 help, .25 subsystem, .03 route, .04 stn17-32, .22, .23")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("41003.01");
        vsm_id: Id = 1, "VSM ID", uid("41003.04");
        data_link_id: Id = 2, "Data Link ID", uid("41003.05"), note("0 = N/A");
        station_number_1_16: StationBitmap1To16 = 3, "Station Number 1-16", uid("41003.06");
        component_number: u16 = 4, "Component Number", uid("41003.01");
        sub_component_number: u16 = 5, "Sub-Component Number", uid("41003.02");
        requested_message: u32 = 6, "Requested Message",
            uid("41003.07"), conf(C), width_inferred(), note("K 32-bit holder (Unsigned 4 in E2)");
        requested_field: u8 = 7, "Requested Field", uid("41003.08");
        field_supported: FieldSupported = 8, "Field Supported", uid("41003.09");
        default_value: u32 = 9, "Default Value";
        max_value: u32 = 10, "Max Value";
        min_value: u32 = 11, "Min Value";
        max_display_value: u32 = 12, "Max Display Value";
        min_display_value: u32 = 13, "Min Display Value";
        minimum_display_resolution: u32 = 14, "Minimum Display Resolution";
        high_caution_limit: u32 = 15, "High Caution Limit";
        high_warning_limit: u32 = 16, "High Warning Limit";
        low_caution_limit: u32 = 17, "Low Caution Limit";
        low_warning_limit: u32 = 18, "Low Warning Limit";
        help_text: Text<80> = 19, "Help Text", uid("41003.19");
        subsystem_id: SubsystemId = 20, "Subsystem ID", uid("41003.20");
        route_type: RouteType = 21, "Route Type", uid("41003.21");
        station_number_17_32: StationBitmap17To32 = 22, "Station Number 17-32";
        warning_and_caution_limits_usage: u8 = 23, "Warning and Caution Limits Usage";
        disable_alert_caution: u8 = 24, "Disable Alert/Caution";
    }

    FieldConfigurationCharacterResponse = 41004, "Field Configuration Character Response", presence bytes 2
        sent(ToCucs, PushPull) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("41004.05");
        vsm_id: Id = 1, "VSM ID", uid("41004.06");
        data_link_id: Id = 2, "Data Link ID", uid("41004.07");
        station_number_1_16: u16 = 3, "Station Number 1-16", uid("41004.08");
        component_number: u16 = 4, "Component Number", uid("41004.01");
        sub_component_number: u16 = 5, "Sub-Component Number", uid("41004.02");
        requested_message: u32 = 6, "Requested Message", uid("41004.09"), conf(C), width_inferred();
        requested_field: u8 = 7, "Requested Field", uid("41004.10");
        field_supported: FieldSupported = 8, "Field Supported", uid("41004.11");
        help_text: Text<80> = 9, "Help Text", uid("41004.12");
        subsystem_id: SubsystemId = 10, "Subsystem ID", uid("41004.13");
        route_type: RouteType = 11, "Route Type", uid("41004.03");
        station_number_17_32: u16 = 12, "Station Number 17-32", uid("41004.04");
    }

    ConfigurationComplete = 41005, "Configuration Complete", presence bytes 2
        sent(ToCucs, Push) layout(Ed4, B) ed2_message("1203")
        source("K + E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1203.01");
        vsm_id: Id = 1, "VSM ID", uid("1203.04");
        data_link_id: Id = 2, "Data Link ID", uid("1203.05");
        station_number_1_16: u16 = 3, "Station Number 1-16", uid("1203.06");
        component_number: u16 = 4, "Component Number", uid("41005.01");
        sub_component_number: u16 = 5, "Sub-Component Number", uid("41005.02");
        vehicle_type: u16 = 6, "Vehicle Type", uid("1203.07");
        vehicle_subtype: u16 = 7, "Vehicle Subtype", uid("1203.08");
        station_number_17_32: u16 = 8, "Station Number 17-32", uid("41005.03");
    }
}
