//! Configuration before and after connection, services, forced commands: 40000 to 44003.

use super::codec::messages;
use crate::enums::{
    ConfigRequestType, EnumIndexEnable, FieldAvailable, FieldSupported, RouteType,
    StationBitmap1To16, StationBitmap17To32, SubsystemId,
};
use crate::id::Id;
use crate::scalar::{Text, TimeStamp, UnsizedText};

messages! {
    FieldConfigurationRequest = 40000, "Field Configuration Request", presence bytes 1
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(2000) ed2_message("1200")
        source("E2 #1200 = F")
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

    DisplayUnitRequest = 42000, "Display Unit Request", presence bytes 2
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(2000) ed2_message("1201")
        source("E2 #1201; id by group start")
        note("id guessed")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1201.01");
        vsm_id: Id = 1, "VSM ID", uid("1201.04");
        distance: u8 = 2, "Distance", uid("1201.05"), note("0 m 1 ft");
        altitude: u8 = 3, "Altitude", uid("1201.06"), note("0 m 1 ft");
        speed: u8 = 4, "Speed", uid("1201.07"), note("0 m/s 1 kt 2 mph 3 km/h");
        position: u8 = 5, "Position", uid("1201.08"), note("0 deg 1 UTM 2 MGRS");
        temperature: u8 = 6, "Temperature", uid("1201.09"), note("0 C 1 F");
        mass_weight: u8 = 7, "Mass/Weight", uid("1201.10"), note("0 kg 1 lb");
        angles: u8 = 8, "Angles", uid("1201.11"), note("0 rad 1 deg");
        pressure_barometric: u8 = 9, "Pressure - Barometric",
            uid("1201.12"), note("0 mb 1 inHg 2 Pa");
        fuel_quantity: u8 = 10, "Fuel Quantity", uid("1201.13"), note("0 l 1 lb 2 kg");
    }

    ReportControllableElementMessage = 42003, "Report Controllable Element Message", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("42003.01");
        controllable_element_id: u16 = 1, "Controllable Element ID", uid("42003.02");
        name: UnsizedText = 2, "Name", uid("42003.03"), conf(C);
        input_type: u8 = 3, "Input Type", uid("42003.04");
    }

    VsmServicesReportMessage = 43000, "VSM Services Report Message", presence bytes 1
        sent(ToCucs, Pull) layout(Ed4, B) ed2_message("1304")
        source("K + E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1304.01");
        vsm_home_web_page_url: Text<249> = 1, "VSM Home Web Page URL",
            uid("1304.04"), note("E2 length");
        ftp_url: Text<249> = 2, "FTP URL", uid("1304.05"), note("E2 length");
    }

    UaRouteConfiguration = 43001, "UA Route Configuration", presence bytes 1
        sent(ToCucs, Pull) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("43001.01");
        route_type: RouteType = 1, "Route Type", uid("43001.02");
        instances: u8 = 2, "Instances", uid("43001.03");
        maximum_number_of_waypoints: u16 = 3, "Maximum Number of Waypoints", uid("43001.04");
        location_type_support: u8 = 4, "Location Type Support", uid("43001.05");
    }

    RemoteWindowsGuiDefinition = 43002, "Remote Windows GUI Definition", presence bytes 1
        sent(ToCucs, Pull) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("43002.01");
        gui_reference_id: u8 = 1, "GUI Reference ID", uid("43002.02");
        parent_gui_reference_id: u8 = 2, "Parent GUI Reference ID", uid("43002.03");
        subsystem_id: SubsystemId = 3, "Subsystem ID", uid("43002.04");
        text: UnsizedText = 4, "Text", uid("43002.05"), conf(C);
        enable: u8 = 5, "Enable", uid("43002.06");
    }

    FieldChangeIntegerCommand = 44000, "Field Change Integer Command", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("44000.01");
        requested_message: u16 = 1, "Requested Message", uid("44000.02");
        requested_field: u8 = 2, "Requested Field", uid("44000.03");
        commanded_value: i32 = 3, "Commanded Value", uid("44000.04");
    }

    FieldChangeFloatCommand = 44001, "Field Change Float Command", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("44001.01");
        requested_message: u16 = 1, "Requested Message", uid("44001.02");
        requested_field: u8 = 2, "Requested Field", uid("44001.03");
        commanded_value: f32 = 3, "Commanded Value", uid("44001.04");
    }

    FieldChangeEnumeratedCommand = 44002, "Field Change Enumerated Command", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("44002.01");
        requested_message: u16 = 1, "Requested Message", uid("44002.02");
        requested_field: u8 = 2, "Requested Field", uid("44002.03");
        commanded_enumeration_index_value: i32 = 3, "Commanded Enumeration Index Value",
            uid("44002.04"), conf(C), note("K Int32; u8 likely");
    }

    MessageParameterAvailability = 44003, "Message Parameter Availability", presence bytes 2
        sent(ToCucs, Push) layout(Ed4, B) ed2_message("1303")
        source("K + E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("1303.01");
        station_number_1_16: u16 = 1, "Station Number 1-16", uid("1303.05");
        component_number: u16 = 2, "Component Number", uid("44003.01");
        sub_component_number: u16 = 3, "Sub-Component Number", uid("44003.02");
        reported_message: u32 = 4, "Reported Message", uid("1303.06"), conf(C), width_inferred();
        reported_field: u8 = 5, "Reported Field",
            uid("1303.07"), note("0 = whole message not supported");
        field_available: FieldAvailable = 6, "Field Available", uid("1303.08");
        reported_enumerated_index: u8 = 7, "Reported Enumerated Index", uid("1303.09");
        enumerated_index_enable: EnumIndexEnable = 8, "Enumerated Index Enable", uid("1303.10");
        station_number_17_32: u16 = 9, "Station Number 17-32", uid("44003.03");
        route_type: RouteType = 10, "Route Type", uid("1303.12");
    }
}
