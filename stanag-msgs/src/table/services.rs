//! Display units, services and forced commands: 42000 to 44003.

use super::info::Confidence::{B, C};
use super::info::Direction::{ToCucs, ToVsm};
use super::info::Layout::{Ed2Derived, Ed4};
use super::info::Traffic::{Pull, Push};
use super::info::{FieldInfo, MessageInfo};
use super::macros::messages;
use crate::codec::{DataReader, DataWriter, DecodeError, EncodeError};
use crate::enums::{EnumIndexEnable, FieldAvailable, RouteType, SubsystemId};
use crate::id::Id;
use crate::scalar::{Text, TimeStamp, UnsizedText};

messages! {
    DisplayUnitRequest = 42000, "Display Unit Request", presence bytes 2
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(2000) ed2_message("1201")
        source("E2 #1201; id by group start")
        corroboration("not applicable")
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
