//! The configuration phase: 1200 to 1304.

use super::rows::messages;
use crate::ed25::values::{
    CONFIG_REQUEST_TYPE, ENUM_INDEX_ENABLE, FIELD_AVAILABLE, FIELD_SUPPORTED, RESOURCE_AVAILABLE,
    SENSOR_SELECT, STATION_BITMAP, SUBSYSTEM_ID_FIELD, UNIT_ANGLE, UNIT_DISTANCE, UNIT_FUEL,
    UNIT_MASS, UNIT_POSITION, UNIT_PRESSURE, UNIT_SPEED, UNIT_TEMPERATURE, VEHICLE_TYPE,
};
use crate::field::Wire::{Char, F64, I8, I32, U8, U16, U32};

messages! {
    FieldConfigurationRequest = 1200, "Field Configuration Request"
        sent(ToVsm, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.7.1", "B1-75") ed4(&[40000])
        note("starts (or aborts) the sending of #1300 to #1303 for an LOI, a data link or one parameter")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1200.01"), unit("s since 1970"), ed4(40000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1200.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1200.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("1200.04"), identification(), ed4(40000, 2);
        data_link_id: I32 = 5, "Data Link ID", uid("1200.05"), identification(), ed4(40000, 3), note("0 = N/A");
        request_type: U8 = 6, "Request Type", uid("1200.06"), values(&CONFIG_REQUEST_TYPE), ed4(40000, 4);
        requested_message: U32 = 7, "Requested Message",
            uid("1200.07"), ed4(40000, 5), note("message number; 0 = N/A");
        requested_field: U8 = 8, "Requested Field",
            uid("1200.08"), range(1.0, 255.0), ed4(40000, 6), note("field number; Amendment 1: 0..255, 0 = N/A");
        station_number: U32 = 9, "Station Number",
            uid("1200.09"), values(&STATION_BITMAP), ed4(40000, 7), note("0 = N/A");
        sensor_select: U8 = 10, "Sensor Select", uid("1200.10"), values(&SENSOR_SELECT), ed4(40000, 8);
    }

    DisplayUnitRequest = 1201, "Display Unit Request"
        sent(ToVsm, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.7.2", "B1-76") ed4(&[42000])
        note("units for remote displays; may come at any time during a connection")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1201.01"), unit("s since 1970"), ed4(42000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1201.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1201.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("1201.04"), identification(), ed4(42000, 2);
        distance: U8 = 5, "Distance", uid("1201.05"), values(&UNIT_DISTANCE), ed4(42000, 3);
        altitude: U8 = 6, "Altitude", uid("1201.06"), values(&UNIT_DISTANCE), ed4(42000, 4);
        speed: U8 = 7, "Speed", uid("1201.07"), values(&UNIT_SPEED), ed4(42000, 5);
        position: U8 = 8, "Position (Latitude, Longitude)", uid("1201.08"), values(&UNIT_POSITION), ed4(42000, 6);
        temperature: U8 = 9, "Temperature", uid("1201.09"), values(&UNIT_TEMPERATURE), ed4(42000, 7);
        mass_weight: U8 = 10, "Mass/Weight", uid("1201.10"), values(&UNIT_MASS), ed4(42000, 8);
        angles: U8 = 11, "Angles", uid("1201.11"), values(&UNIT_ANGLE), ed4(42000, 9);
        pressure_barometric: U8 = 12, "Pressure - Barometric", uid("1201.12"), values(&UNIT_PRESSURE), ed4(42000, 10);
        fuel_quantity: U8 = 13, "Fuel Quantity", uid("1201.13"), values(&UNIT_FUEL), ed4(42000, 11);
    }

    CucsResourceReport = 1202, "CUCS Resource Report"
        sent(ToVsm, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.7.3", "B1-77")
        note("authorises remote displays and says where they may appear; the VSM sends none before it")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1202.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("1202.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1202.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("1202.04"), identification(), note("0 = N/A");
        data_link_id: I32 = 5, "Data Link ID", uid("1202.05"), identification(), note("0 = N/A");
        web_browser_available: U8 = 6, "Web Browser Available",
            uid("1202.06"), values(&RESOURCE_AVAILABLE), note("due for deletion");
        java_engine_available: U8 = 7, "JAVA Engine Available",
            uid("1202.07"), values(&RESOURCE_AVAILABLE), note("due for deletion");
        spare: U8 = 8, "Spare", uid("1202.08");
        x_window_server_available: U8 = 9, "X Window Server Available",
            uid("1202.09"), values(&RESOURCE_AVAILABLE), note("due for deletion");
        display_number: I8 = 10, "(X Window) Display Number", uid("1202.10");
        screen_number: I8 = 11, "(X Window) Screen Number", uid("1202.11");
        vertical_offset_from_top_left_corner: U16 = 12, "Vertical Offset from Top Left Corner",
            uid("1202.12"), unit("px"), range(0.0, 65535.0);
        horizontal_offset_from_top_left_corner: U16 = 13, "Horizontal Offset from Top Left Corner",
            uid("1202.13"), unit("px"), range(0.0, 65535.0);
        display_window_horizontal_width: U16 = 14, "Display Window Horizontal Width",
            uid("1202.14"), unit("px"), range(0.0, 65535.0);
        display_window_vertical_height: U16 = 15, "Display Window Vertical Height",
            uid("1202.15"), unit("px"), range(0.0, 65535.0);
        cucs_ip_address: U32 = 16, "CUCS IP Address", uid("1202.16"), range(0.0, 4294967295.0), note("IPv4");
    }

    ConfigurationComplete = 1203, "Configuration Complete"
        sent(ToCucs, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.7.4", "B1-78") ed4(&[41005])
        note("ends the answer to #1200 for this VSM, vehicle, data link or station")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1203.01"), unit("s since 1970"), ed4(41005, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1203.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1203.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("1203.04"), identification(), ed4(41005, 2);
        data_link_id: I32 = 5, "Data Link ID", uid("1203.05"), identification(), ed4(41005, 3), note("0 = N/A");
        station_number: U32 = 6, "Station Number",
            uid("1203.06"), values(&STATION_BITMAP), ed4(41005, 4), note("0 = N/A");
        vehicle_type: U16 = 7, "Vehicle Type",
            uid("1203.07"), values(&VEHICLE_TYPE), ed4(41005, 7), note("Amendment 1: unit reads 'enumerated'");
        vehicle_subtype: U16 = 8, "Vehicle Subtype",
            uid("1203.08"), range(0.0, 65535.0), ed4(41005, 8),
            note("Amendment 1: range reads 'vehicle specific' (enumerated)");
    }

    FieldConfigurationIntegerResponse = 1300, "Field Configuration Integer Response"
        sent(ToCucs, Pull) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.7.5", "B1-79") ed4(&[41000])
        note("limits of an integer field; a CUCS must at least take those of configurable.integer")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1300.01"), unit("s since 1970"), ed4(41000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1300.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1300.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("1300.04"), identification(), ed4(41000, 2);
        data_link_id: I32 = 5, "Data Link ID", uid("1300.05"), identification(), ed4(41000, 3), note("0 = N/A");
        station_number: U32 = 6, "Station Number",
            uid("1300.06"), values(&STATION_BITMAP), ed4(41000, 4), note("0 = N/A");
        requested_message: U32 = 7, "Requested Message", uid("1300.07"), ed4(41000, 7), note("message number");
        requested_field: U8 = 8, "Requested Field",
            uid("1300.08"), range(1.0, 255.0), ed4(41000, 8), note("field number");
        field_supported: U8 = 9, "Field Supported", uid("1300.09"), values(&FIELD_SUPPORTED), ed4(41000, 9);
        max_value: I32 = 10, "Max Value",
            uid("1300.10"), ed4(41000, 11), note("unit of the field; range of the field");
        min_value: I32 = 11, "Min Value",
            uid("1300.11"), ed4(41000, 12), note("unit of the field; range of the field");
        max_display_value: I32 = 12, "Max Display Value",
            uid("1300.12"), ed4(41000, 13), note("unit of the field; range of the field");
        min_display_value: I32 = 13, "Min Display Value",
            uid("1300.13"), ed4(41000, 14), note("unit of the field; range of the field");
        minimum_display_resolution: I32 = 14, "Minimum Display Resolution",
            uid("1300.14"), ed4(41000, 15), note("unit of the field; range of the field");
        high_caution_limit: I32 = 15, "High Caution Limit",
            uid("1300.15"), ed4(41000, 16),
            note("unit of the field; range of the field; caution from here up; the CUCS warns, not the VSM");
        high_warning_limit: I32 = 16, "High Warning Limit",
            uid("1300.16"), ed4(41000, 17), note("unit of the field; range of the field; warning from here up");
        low_caution_limit: I32 = 17, "Low Caution Limit",
            uid("1300.17"), ed4(41000, 18), note("unit of the field; range of the field; caution from here down");
        low_warning_limit: I32 = 18, "Low Warning Limit",
            uid("1300.18"), ed4(41000, 19), note("unit of the field; range of the field; warning from here down");
        help_text: Char(80) = 19, "Help Text", uid("1300.19"), ed4(41000, 20);
        subsystem_id: U8 = 20, "Subsystem ID", uid("1300.20"), values(&SUBSYSTEM_ID_FIELD), ed4(41000, 21);
    }

    FieldConfigurationDoubleResponse = 1301, "Field Configuration Double Response"
        sent(ToCucs, Pull) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.7.6", "B1-80") ed4(&[41001])
        note("limits of a float or double field; a CUCS must at least take those of configurable.double")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1301.01"), unit("s since 1970"), ed4(41001, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1301.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1301.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("1301.04"), identification(), ed4(41001, 2);
        data_link_id: I32 = 5, "Data Link ID", uid("1301.05"), identification(), ed4(41001, 3), note("0 = N/A");
        station_number: U32 = 6, "Station Number",
            uid("1301.06"), values(&STATION_BITMAP), ed4(41001, 4), note("0 = N/A");
        requested_message: U32 = 7, "Requested Message", uid("1301.07"), ed4(41001, 7), note("message number");
        requested_field: U8 = 8, "Requested Field",
            uid("1301.08"), range(1.0, 255.0), ed4(41001, 8), note("field number");
        field_supported: U8 = 9, "Field Supported", uid("1301.09"), values(&FIELD_SUPPORTED), ed4(41001, 9);
        max_value: F64 = 10, "Max Value",
            uid("1301.10"), ed4(41001, 11), note("unit of the field; range of the field");
        min_value: F64 = 11, "Min Value",
            uid("1301.11"), ed4(41001, 12), note("unit of the field; range of the field");
        max_display_value: F64 = 12, "Max Display Value",
            uid("1301.12"), ed4(41001, 13), note("unit of the field; range of the field");
        min_display_value: F64 = 13, "Min Display Value",
            uid("1301.13"), ed4(41001, 14), note("unit of the field; range of the field");
        minimum_resolution: F64 = 14, "Minimum Resolution",
            uid("1301.14"), ed4(41001, 15), note("unit of the field; range of the field");
        high_caution_limit: F64 = 15, "High Caution Limit",
            uid("1301.15"), ed4(41001, 16), note("unit of the field; range of the field; caution from here up");
        high_warning_limit: F64 = 16, "High Warning Limit",
            uid("1301.16"), ed4(41001, 17), note("unit of the field; range of the field; warning from here up");
        low_caution_limit: F64 = 17, "Low Caution Limit",
            uid("1301.17"), ed4(41001, 18), note("unit of the field; range of the field; caution from here down");
        low_warning_limit: F64 = 18, "Low Warning Limit",
            uid("1301.18"), ed4(41001, 19), note("unit of the field; range of the field; warning from here down");
        help_text: Char(80) = 19, "Help Text", uid("1301.19"), ed4(41001, 20);
        subsystem_id: U8 = 20, "Subsystem ID", uid("1301.20"), values(&SUBSYSTEM_ID_FIELD), ed4(41001, 21);
    }

    FieldConfigurationEnumeratedResponse = 1302, "Field Configuration Enumerated Response"
        sent(ToCucs, Pull) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.7.7", "B1-81") ed4(&[41002])
        note("only when a whole enumerated or bit field is not supported, or to name the vehicle specific values; standard values cannot be changed; bit k of a bitmap is index k (0x0001 is index 0)")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1302.01"), unit("s since 1970"), ed4(41002, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1302.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1302.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("1302.04"), identification(), ed4(41002, 2);
        data_link_id: I32 = 5, "Data Link ID", uid("1302.05"), identification(), ed4(41002, 3), note("0 = N/A");
        station_number: U32 = 6, "Station Number",
            uid("1302.06"), values(&STATION_BITMAP), ed4(41002, 4), note("0 = N/A");
        requested_message: U32 = 7, "Requested Message", uid("1302.07"), ed4(41002, 7), note("message number");
        requested_field: U8 = 8, "Requested Field",
            uid("1302.08"), range(1.0, 255.0), ed4(41002, 8), note("field number");
        field_supported: U8 = 9, "Field Supported", uid("1302.09"), values(&FIELD_SUPPORTED), ed4(41002, 9);
        enumeration_count: U8 = 10, "Enumeration Count",
            uid("1302.10"), ed4(41002, 11), note("how many vehicle specific values the field has");
        enumeration_index: U8 = 11, "Enumeration Index", uid("1302.11"), ed4(41002, 12), note("the value named");
        enumeration_text: Char(16) = 12, "Enumeration Text", uid("1302.12"), ed4(41002, 13);
        help_text: Char(80) = 13, "Help Text", uid("1302.13"), ed4(41002, 14);
    }

    FieldConfigurationCommand = 1303, "Field Configuration Command"
        sent(ToCucs, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.7.8", "B1-82") ed4(&[44003])
        note("availability of a field or of one enumeration value, during configuration and whenever it changes; the unique ids do not follow the field order: VSM ID is 1303.11 at place 4")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1303.01"), unit("s since 1970"), ed4(44003, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1303.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1303.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("1303.11"), identification();
        data_link_id: I32 = 5, "Data Link ID", uid("1303.04"), identification(), note("0 = N/A");
        station_number: U32 = 6, "Station Number",
            uid("1303.05"), values(&STATION_BITMAP), ed4(44003, 2), note("0 = N/A");
        reported_message: U32 = 7, "Reported Message", uid("1303.06"), ed4(44003, 5), note("message number");
        reported_field: U8 = 8, "Reported Field",
            uid("1303.07"), range(0.0, 255.0), ed4(44003, 6), note("0 = the whole message is not supported");
        field_available: U8 = 9, "Field Available", uid("1303.08"), values(&FIELD_AVAILABLE), ed4(44003, 7);
        reported_enumerated_index: U8 = 10, "Reported Enumerated Index", uid("1303.09"), ed4(44003, 8);
        enumerated_index_enable: I8 = 11, "Enumerated Index Enable",
            uid("1303.10"), values(&ENUM_INDEX_ENABLE), ed4(44003, 9);
    }

    VsmServicesReportMessage = 1304, "VSM Services Report Message"
        sent(ToCucs, Pull) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.7.9", "B1-83") ed4(&[43000])
        note("after #1202, once the services run; with 514 octets the longest message: it fills a datagram of 548")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1304.01"), unit("s since 1970"), ed4(43000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1304.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1304.03"), identification();
        vsm_home_web_page_url: Char(249) = 4, "VSM Home Web Page URL",
            uid("1304.04"), ed4(43000, 2), note("blank if not provided; type cell reads 'Character, 249 bytes'");
        ftp_url: Char(249) = 5, "FTP URL",
            uid("1304.05"), ed4(43000, 3), note("blank if not provided; type cell reads 'Character, 249 bytes'");
    }
}
