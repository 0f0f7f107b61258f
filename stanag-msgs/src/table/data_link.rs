//! Data links: discovery, status and transition, 28000 to 35000.

use std::f64::consts::FRAC_PI_2;

use super::codec::messages;
use crate::enums::{
    AccessGranted, AltitudeType, DlAntennaState, DlComsecMode, DlComsecState,
    DlControlAvailability, DlPriority, DlState, DlTerminal, DlType, HandoverStatus, PedestalMode,
};
use crate::id::Id;
use crate::scalar::{Altitude, Bam16, Bam32, Text, TimeStamp, UnsizedBytes, Velocity};

messages! {
    DataLinkControlRequest = 28000, "Data Link Control Request", presence bytes 1
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(2000) ed2_message("404")
        source("E2 #404 (Data Link Assignment Request); name/id Korean paper; uid 28000.07 = Data Link Control Availability proves 28000 has at least 7 own fields")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0404.01");
        vsm_id: Id = 1, "VSM ID", uid("0404.04");
        data_link_id: Id = 2, "Data Link ID", uid("0404.05");
        control_assignment_request: u8 = 3, "Control Assignment Request",
            uid("0404.06"), note("0 request, 1 release, 2 override (Ed2)");
        vehicle_type: u16 = 4, "Vehicle Type", uid("0404.07");
        vehicle_subtype: u16 = 5, "Vehicle Subtype", uid("0404.08");
    }

    DataLinkConfigurationAssignmentMessage = 28001, "Data Link Configuration / Assignment Message", presence bytes 2
        sent(ToCucs, Pull) layout(Ed4, B) latency_ms(1000) ed2_message("500")
        source("K + E2 #500")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0500.01");
        vsm_vehicle_id: Id = 1, "VSM/Vehicle ID", uid("28001.06");
        access_authorized: u8 = 2, "Access Authorized", uid("28001.01");
        access_granted: AccessGranted = 3, "Access Granted", uid("28001.02");
        access_requested: u8 = 4, "Access Requested", uid("28001.03");
        terminal_type: DlTerminal = 5, "Terminal Type", uid("0500.07");
        data_link_type: DlType = 6, "Data Link Type", uid("0500.08");
        data_link_subtype: u16 = 7, "Data Link Subtype", uid("28001.05");
        data_link_name: Text<20> = 8, "Data Link Name", uid("0500.09");
        antenna_type: u8 = 9, "Antenna Type", uid("0500.10"), note("bitmap 1 omni, 2 directional");
        pedestal_index: u8 = 10, "Pedestal Index", uid("28001.04");
        vehicle_type: u16 = 11, "Vehicle Type", uid("0500.11");
        vehicle_subtype: u16 = 12, "Vehicle Subtype", uid("0500.12");
        data_link_control_availability: DlControlAvailability = 13, "Data Link Control Availability",
            uid("28000.07");
    }

    DlToVehicleIdReport = 32000, "DL to Vehicle ID Report", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32000.01");
        communication_vehicle_id_uplink: Id = 1, "Communication Vehicle ID - Uplink",
            uid("32000.02");
        uplink_communication_state: u8 = 2, "Uplink Communication State", uid("32000.03");
        communication_vehicle_id_downlink: Id = 3, "Communication Vehicle ID - Downlink",
            uid("32000.04");
        downlink_communication_state: u8 = 4, "Downlink Communication State", uid("32000.05");
    }

    DlControlStatusReport = 32003, "DL Control Status Report", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32003.01");
        transmitter_state: u8 = 1, "Transmitter State", uid("32003.02");
        transmit_attenuation_state: u8 = 2, "Transmit Attenuation State", uid("32003.03");
        receiver_state: u8 = 3, "Receiver State", uid("32003.04");
        active_antenna_pedestal_index: u8 = 4, "Active Antenna Pedestal Index", uid("32003.05");
        communication_security_state: DlComsecState = 5, "Communication Security State",
            uid("0501.13");
        communication_security_key_index: u8 = 6, "Communication Security Key Index",
            uid("32003.07");
    }

    RfCommandProcessingStatusReport = 32004, "RF Command Processing Status Report", presence bytes 1
        sent(ToCucs, Pull) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32004.01");
        commands_from_rf: u8 = 1, "Commands from RF", uid("32004.02");
    }

    LegacyDlStatusReport = 32005, "Legacy DL Status Report", presence bytes 2
        sent(ToCucs, Push) layout(Ed4, B) ed2_message("501")
        source("K + E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32005.01");
        addressed_terminal: DlTerminal = 1, "Addressed Terminal", uid("0501.05");
        data_link_state: DlState = 2, "Data Link State", uid("0501.06");
        antenna_state: DlAntennaState = 3, "Antenna State", uid("0501.07");
        reported_channel: u16 = 4, "Reported Channel", uid("0501.08");
        reported_primary_hop_pattern: u8 = 5, "Reported Primary Hop Pattern", uid("0501.09");
        reported_forward_link_carrier_frequency: f32 = 6, "Reported Forward Link Carrier Frequency",
            uid("0501.10"), unit("Hz");
        reported_return_link_carrier_frequency: f32 = 7, "Reported Return Link Carrier Frequency",
            uid("0501.11"), unit("Hz");
        downlink_status: i16 = 8, "Downlink Status",
            uid("0501.12"), unit("%"), range(0.0, 100.0), note("0..100");
        communication_security_state: DlComsecState = 9, "Communication Security State",
            uid("0501.13");
        link_channel_priority_state: DlPriority = 10, "Link Channel Priority State", uid("0501.14");
    }

    LegacyDlControlCommandStatus = 32006, "Legacy DL Control Command Status", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B) ed2_message("502")
        source("K + E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32006.01");
        addressed_terminal: DlTerminal = 1, "Addressed Terminal", uid("0502.05");
        reported_demanded_data_link_state: DlState = 2, "Reported Demanded Data Link State",
            uid("0502.06");
        reported_demanded_antenna_mode: DlAntennaState = 3, "Reported Demanded Antenna Mode",
            uid("0502.07");
        reported_demanded_communication_security_mode: DlComsecMode = 4, "Reported Demanded Communication Security Mode",
            uid("0502.08");
    }

    AntennaPedestalLocationStatusReport = 32100, "Antenna Pedestal Location Status Report", presence bytes 2
        sent(ToCucs, Push) layout(Ed4, B) ed2_message("503")
        source("K + E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32100.01");
        pedestal_index: u8 = 1, "Pedestal Index", uid("32100.10"), note("K SByte");
        antenna_pedestal_latitude: Bam32 = 2, "Antenna Pedestal Latitude",
            uid("0503.11"), range(-FRAC_PI_2, FRAC_PI_2);
        antenna_pedestal_longitude: Bam32 = 3, "Antenna Pedestal Longitude", uid("0503.12");
        antenna_pedestal_altitude: Altitude = 4, "Antenna Pedestal Altitude", uid("0503.13");
        altitude_type: AltitudeType = 5, "Altitude Type", uid("32100.11");
        antenna_pedestal_ground_speed: u16 = 6, "Antenna Pedestal Ground Speed",
            uid("32100.05"), unit("m/s");
        antenna_pedestal_vertical_speed: Velocity = 7, "Antenna Pedestal Vertical Speed",
            uid("32100.06");
        antenna_pedestal_course: Bam16 = 8, "Antenna Pedestal Course", uid("32100.07");
        antenna_pedestal_heading: Bam16 = 9, "Antenna Pedestal Heading", uid("32100.12");
        antenna_pedestal_pitch: Bam16 = 10, "Antenna Pedestal Pitch", uid("32100.08");
        antenna_pedestal_roll: Bam16 = 11, "Antenna Pedestal Roll", uid("32100.09");
    }

    AntennaControlStatusReport = 32101, "Antenna Control Status Report", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32101.01");
        pedestal_index: u8 = 1, "Pedestal Index", uid("32101.02");
        pedestal_state: PedestalMode = 2, "Pedestal State", uid("32101.03");
        antenna_pointing_mode: u8 = 3, "Antenna Pointing Mode", uid("32101.04");
        antenna_type_mode: u8 = 4, "Antenna Type Mode", uid("32101.07");
        antenna_type: u8 = 5, "Antenna Type", uid("32101.05");
        pedestal_location_source: u8 = 6, "Pedestal Location Source", uid("32101.06");
    }

    AntennaPositionReport = 32102, "Antenna Position Report", presence bytes 2
        sent(ToCucs, Push) layout(Ed4, B) ed2_message("503")
        source("K + E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32102.01");
        pedestal_index: u8 = 1, "Pedestal Index", uid("32102.02");
        reported_antenna_azimuth: Bam16 = 2, "Reported Antenna Azimuth", uid("0503.07");
        reported_antenna_elevation: Bam16 = 3, "Reported Antenna Elevation", uid("0503.08");
        reported_azimuth_slew_rate: i16 = 4, "Reported Azimuth Slew Rate",
            uid("0503.09"), unit("rad/s");
        reported_elevation_slew_rate: i16 = 5, "Reported Elevation Slew Rate",
            uid("0503.10"), unit("rad/s");
        reported_remote_antenna_latitude: Bam32 = 6, "Reported Remote Antenna Latitude",
            uid("32102.07"), range(-FRAC_PI_2, FRAC_PI_2);
        reported_remote_antenna_longitude: Bam32 = 7, "Reported Remote Antenna Longitude",
            uid("32102.08");
        reported_remote_antenna_altitude: Altitude = 8, "Reported Remote Antenna Altitude",
            uid("32102.09");
        altitude_type: AltitudeType = 9, "Altitude Type", uid("32102.13");
        reported_remote_antenna_ground_speed: u16 = 10, "Reported Remote Antenna Ground Speed",
            uid("32102.10"), unit("m/s");
        reported_remote_antenna_course: Bam16 = 11, "Reported Remote Antenna Course",
            uid("32102.11");
        reported_remote_antenna_vertical_speed: Velocity = 12, "Reported Remote Antenna Vertical Speed",
            uid("32102.12");
    }

    LegacyPedestalStatusReport = 32103, "Legacy Pedestal Status Report", presence bytes 2
        sent(ToCucs, Push) layout(Ed4, B) ed2_message("503")
        source("K + E2")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32103.01");
        addressed_pedestal: DlTerminal = 1, "Addressed Pedestal", uid("0503.05");
        pedestal_mode_state: PedestalMode = 2, "Pedestal Mode State", uid("0503.06");
        reported_antenna_azimuth: f32 = 3, "Reported Antenna Azimuth", uid("0503.07"), unit("rad");
        reported_antenna_elevation: f32 = 4, "Reported Antenna Elevation",
            uid("0503.08"), unit("rad");
        reported_antenna_azimuth_slew_rate: f32 = 5, "Reported Antenna Azimuth Slew Rate",
            uid("0503.09"), unit("rad/s");
        reported_antenna_elevation_slew_rate: f32 = 6, "Reported Antenna Elevation Slew Rate",
            uid("0503.10"), unit("rad/s");
        reported_cdt_latitude: f32 = 7, "Reported CDT Latitude",
            uid("0503.11"), unit("rad"), note("K float; E2 double");
        reported_cdt_longitude: f32 = 8, "Reported CDT Longitude", uid("0503.12"), unit("rad");
        reported_cdt_altitude: f32 = 9, "Reported CDT Altitude", uid("0503.13"), unit("m");
    }

    LinkHealthStatus = 32200, "Link Health Status", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32200.01");
        bit_mode_status: u8 = 1, "BIT Mode Status", uid("32200.02");
    }

    DlFallbackStatus = 32201, "DL Fallback Status", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32201.01");
        fallback_status: u8 = 1, "Fallback Status", uid("32201.02");
    }

    DataLinkUdpCount = 32300, "Data Link UDP Count", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32300.01");
        udp_message_count: u8 = 1, "UDP Message Count",
            uid("32300.02"), note("T also names this message");
    }

    UaIpDisclosureMessage = 32301, "UA IP Disclosure Message", presence bytes 2
        sent(ToCucs, PushPull) layout(Ed4, B)
        source("K")
        note("T's report calls 32301 'Universal Multicast Address Announcement': name disagreement")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32301.01");
        controlled_station_1_16: u16 = 1, "Controlled Station 1-16", uid("32301.02");
        component_number: u16 = 2, "Component Number", uid("32301.03");
        sub_component_number: u16 = 3, "Sub-Component Number", uid("32301.04");
        stream_id: u8 = 4, "Stream ID", uid("32301.05");
        stream_n_type: u8 = 5, "Stream N Type", uid("32301.06");
        length_of_uri: u8 = 6, "Length of URI", uid("32301.07");
        uniform_resource_identifier: UnsizedBytes = 7, "Uniform Resource Identifier",
            uid("32301.08"), note("the only variable-length field found");
        controlled_station_17_32: u16 = 8, "Controlled Station 17-32", uid("32301.09");
    }

    DlInControlReport = 32302, "DL in Control Report", presence bytes 1
        sent(ToCucs, Push) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32302.01");
        data_link_id: Id = 1, "Data Link ID", uid("32302.02");
        in_control_cucs_id: Id = 2, "In Control CUCS ID", uid("32302.03");
        controlling_link: u8 = 3, "Controlling Link", uid("32302.04");
        controlled_station_1_16: u16 = 4, "Controlled Station 1-16", uid("32302.05");
        controlled_component_number: u16 = 5, "Controlled Component Number", uid("32302.06");
        controlled_sub_component_number: u16 = 6, "Controlled Sub-Component Number",
            uid("32302.07");
        controlled_station_17_32: u16 = 7, "Controlled Station 17-32", uid("32302.08");
    }

    LostLinkDelayTimerReport = 32400, "Lost Link Delay Timer Report", presence bytes 1
        sent(ToCucs, PushPull) layout(Ed4, B)
        source("K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("32400.01");
        lost_link_delay_timer_status: u8 = 1, "Lost Link Delay Timer Status", uid("32400.02");
        current_delay_time: u8 = 2, "Current Delay Time", uid("32400.03"), unit("s?");
    }

    VehicleDataLinkTransitionCoordination = 34000, "Vehicle Data Link Transition Coordination", presence bytes 2
        sent(ToVsm, Push) layout(Ed2Derived, C) latency_ms(1000) ed2_message("600")
        source("E2 #600")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0600.01");
        data_link_id_adt: Id = 1, "Data Link ID (ADT)", uid("0600.04");
        acquiring_cucs_id: Id = 2, "Acquiring CUCS ID", uid("0600.05");
        set_forward_link_carrier_frequency_adt: f32 = 3, "Set Forward Link Carrier Frequency (ADT)",
            uid("0600.06"), unit("Hz");
        set_return_link_carrier_frequency_adt: f32 = 4, "Set Return Link Carrier Frequency (ADT)",
            uid("0600.07"), unit("Hz");
        set_pn_code_adt: u8 = 5, "Set PN Code (ADT)", uid("0600.08");
        acquiring_gdt_latitude: Bam32 = 6, "Acquiring GDT Latitude",
            uid("0600.09"), range(-FRAC_PI_2, FRAC_PI_2);
        acquiring_gdt_longitude: Bam32 = 7, "Acquiring GDT Longitude", uid("0600.10");
        acquiring_gdt_altitude: Altitude = 8, "Acquiring GDT Altitude", uid("0600.11");
        data_link_time_out_limit: TimeStamp = 9, "Data Link Time-out Limit", uid("0600.12");
    }

    HandoverStatusReport = 35000, "Handover Status Report", presence bytes 1
        sent(ToCucs, Pull) layout(Ed2Derived, C) latency_ms(1000) ed2_message("700")
        source("E2 #700")
        note("Ed4 moved vehicle/CUCS ids to the wrapper in general; whether both CUCS ids stay is not known")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0700.01");
        cucs_id_relinquishing_control: Id = 1, "CUCS ID (relinquishing control)", uid("0700.03");
        cucs_id_acquiring_control: Id = 2, "CUCS ID (acquiring control)", uid("0700.04");
        status: HandoverStatus = 3, "Status", uid("0700.05");
        air_data_link_id: Id = 4, "Air Data Link ID", uid("0700.06");
    }
}
