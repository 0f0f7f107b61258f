//! Data links and the handover over them: 400 to 503, 600, 700.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

use super::rows::messages;
use crate::ed25::values::{
    ANTENNA_TYPE, DL_ANTENNA_MODE, DL_ANTENNA_STATE, DL_ASSIGNMENT_REQUEST, DL_COMSEC_MODE,
    DL_COMSEC_STATE, DL_CONTROL_AVAILABILITY, DL_PRIORITY, DL_STATE, DL_TERMINAL, DL_TYPE,
    HANDOVER_STATUS, PEDESTAL_MODE, VEHICLE_TYPE,
};
use crate::field::Wire::{Char, F32, F64, I16, I32, U8, U16};

messages! {
    DataLinkSetUpMessage = 400, "Data Link Set Up Message"
        sent(ToVsm, Push) latency_ms(1000) loi(&[2, 3, 4])
        text("4.1.4.1.1", "B1-52")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0400.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0400.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0400.03"), identification();
        data_link_id: I32 = 4, "Data Link ID", uid("0400.04"), identification();
        addressed_terminal: U8 = 5, "Addressed Terminal", uid("0400.05"), values(&DL_TERMINAL);
        select_channel: U16 = 6, "Select Channel", uid("0400.06"), note("range as the link has it");
        select_primary_hop_pattern: U8 = 7, "Select Primary Hop Pattern",
            uid("0400.07"), note("range as the link has it");
        set_forward_link_carrier_frequency: F32 = 8, "Set Forward Link (FL) Carrier Frequency",
            uid("0400.08"), unit("Hz"), note("range as the link has it");
        set_return_link_carrier_frequency: F32 = 9, "Set Return Link (RL) Carrier Frequency",
            uid("0400.09"), unit("Hz"), note("range as the link has it");
        set_pn_code: U8 = 10, "Set PN Code", uid("0400.10"), note("range as the link has it");
    }

    DataLinkControlCommand = 401, "Data Link Control Command"
        sent(ToVsm, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.4.1.2", "B1-53")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0401.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0401.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0401.03"), identification();
        data_link_id: I32 = 4, "Data Link ID", uid("0401.04"), identification();
        addressed_terminal: U8 = 5, "Addressed Terminal", uid("0401.05"), values(&DL_TERMINAL);
        set_data_link_state: U8 = 6, "Set Data Link State", uid("0401.06"), values(&DL_STATE);
        set_antenna_mode: U8 = 7, "Set Antenna Mode", uid("0401.07"), values(&DL_ANTENNA_MODE);
        communication_security_mode: U8 = 8, "Communication Security Mode", uid("0401.08"), values(&DL_COMSEC_MODE);
        link_channel_priority: U8 = 9, "Link Channel Priority", uid("0401.09"), values(&DL_PRIORITY);
    }

    PedestalConfigurationMessage = 402, "Pedestal Configuration Message"
        sent(ToVsm, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.4.1.3", "B1-54")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0402.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0402.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0402.03"), identification();
        data_link_id: I32 = 4, "Data Link ID", uid("0402.04"), identification();
        set_gdt_latitude: F64 = 5, "Set GDT Latitude", uid("0402.05"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2);
        set_gdt_longitude: F64 = 6, "Set GDT Longitude", uid("0402.06"), unit("rad"), range(-PI, PI);
        set_gdt_altitude: F32 = 7, "Set GDT Altitude",
            uid("0402.07"), unit("m"), range(-1000.0, 100000.0),
            note("the lower end excluded; lower end excluded; altitude reference not stated");
    }

    PedestalControlCommand = 403, "Pedestal Control Command"
        sent(ToVsm, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.4.1.4", "B1-55")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0403.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("0403.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0403.03"), identification();
        data_link_id: I32 = 4, "Data Link ID", uid("0403.04"), identification();
        addressed_pedestal: U8 = 5, "Addressed Pedestal", uid("0403.05"), values(&DL_TERMINAL);
        set_pedestal_mode: U8 = 6, "Set Pedestal Mode", uid("0403.06"), values(&PEDESTAL_MODE);
        set_antenna_azimuth: F32 = 7, "Set Antenna Azimuth", uid("0403.07"), unit("rad"), range(0.0, TAU);
        set_antenna_elevation: F32 = 8, "Set Antenna Elevation",
            uid("0403.08"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2);
        set_azimuth_offset: F32 = 9, "Set Azimuth Offset",
            uid("0403.09"), unit("rad"), range(0.0, TAU), note("relative to field 7");
        set_elevation_offset: F32 = 10, "Set Elevation Offset",
            uid("0403.10"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), note("relative to field 8");
        set_azimuth_slew_rate: F32 = 11, "Set Azimuth Slew Rate",
            uid("0403.11"), unit("rad/s"), range(-PI, PI), note("manual rate mode");
        set_elevation_slew_rate: F32 = 12, "Set Elevation Slew Rate",
            uid("0403.12"), unit("rad/s"), range(-PI, PI), note("manual rate mode");
    }

    DataLinkAssignmentRequest = 404, "Data Link Assignment Request"
        sent(ToVsm, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.4.1.5", "B1-56") ed4(&[28000])
        note("discovers data links (data link and VSM id broadcast, vehicle id null unless for a certain vehicle, request = release) or asks for and releases one; VSM id null when the GDT has no VSM")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0404.01"), unit("s since 1970"), ed4(28000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0404.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0404.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("0404.04"), identification(), ed4(28000, 2);
        data_link_id: I32 = 5, "Data Link ID", uid("0404.05"), identification(), ed4(28000, 3);
        control_assignment_request: U8 = 6, "Control Assignment Request",
            uid("0404.06"), values(&DL_ASSIGNMENT_REQUEST), ed4(28000, 4), note("release (1) in a broadcast");
        vehicle_type: U16 = 7, "Vehicle Type",
            uid("0404.07"), values(&VEHICLE_TYPE), ed4(28000, 5), note("Amendment 1: unit reads 'enumerated'");
        vehicle_subtype: U16 = 8, "Vehicle Subtype",
            uid("0404.08"), range(0.0, 65535.0), ed4(28000, 6),
            note("Amendment 1: range reads 'vehicle specific' (enumerated)");
    }

    DataLinkConfigurationAssignmentMessage = 500, "Data Link Configuration/Assignment Message"
        sent(ToCucs, Pull) latency_ms(1000) loi(&[2, 3, 4])
        text("4.1.4.1.6", "B1-57") ed4(&[28001])
        note("answers #404, once for each data link and vehicle type/subtype; never 'granted' in answer to a broadcast; null vehicle id (and null VSM id for a bare GDT) while no vehicle is attached")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0500.01"), unit("s since 1970"), ed4(28001, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0500.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0500.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("0500.04"), identification(), ed4(28001, 2);
        data_link_id: I32 = 5, "Data Link ID", uid("0500.05"), identification();
        data_link_control_availability: U8 = 6, "Data Link Control Availability",
            uid("0500.06"), values(&DL_CONTROL_AVAILABILITY), ed4(28001, 14);
        terminal_type: U8 = 7, "Terminal Type", uid("0500.07"), values(&DL_TERMINAL), ed4(28001, 6);
        data_link_type: U8 = 8, "Data Link Type", uid("0500.08"), values(&DL_TYPE), ed4(28001, 7);
        data_link_name: Char(20) = 9, "Data Link Name", uid("0500.09"), ed4(28001, 9);
        antenna_type: U8 = 10, "Antenna Type", uid("0500.10"), values(&ANTENNA_TYPE), ed4(28001, 10);
        vehicle_type: U16 = 11, "Vehicle Type",
            uid("0500.11"), values(&VEHICLE_TYPE), ed4(28001, 12), note("Amendment 1: unit reads 'enumerated'");
        vehicle_subtype: U16 = 12, "Vehicle Subtype",
            uid("0500.12"), range(0.0, 65535.0), ed4(28001, 13),
            note("Amendment 1: range reads 'vehicle specific' (enumerated)");
    }

    DataLinkStatusReport = 501, "Data Link Status Report"
        sent(ToCucs, Pull) latency_ms(1000) loi(&[2, 3, 4])
        text("4.1.4.1.7", "B1-58") ed4(&[32005])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0501.01"), unit("s since 1970"), ed4(32005, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0501.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0501.03"), identification();
        data_link_id: I32 = 4, "Data Link ID", uid("0501.04"), identification();
        addressed_terminal: U8 = 5, "Addressed Terminal", uid("0501.05"), values(&DL_TERMINAL), ed4(32005, 2);
        data_link_state: U8 = 6, "Data Link State", uid("0501.06"), values(&DL_STATE), ed4(32005, 3);
        antenna_state: U8 = 7, "Antenna State", uid("0501.07"), values(&DL_ANTENNA_STATE), ed4(32005, 4);
        reported_channel: U16 = 8, "Reported Channel",
            uid("0501.08"), ed4(32005, 5), note("range as the link has it");
        reported_primary_hop_pattern: U8 = 9, "Reported Primary Hop Pattern",
            uid("0501.09"), ed4(32005, 6), note("range as the link has it");
        reported_forward_link_carrier_frequency: F32 = 10, "Reported Forward Link (FL) Carrier Frequency",
            uid("0501.10"), unit("Hz"), ed4(32005, 7), note("range as the link has it");
        reported_return_link_carrier_frequency: F32 = 11, "Reported Return Link (RL) Carrier Frequency",
            uid("0501.11"), unit("Hz"), ed4(32005, 8), note("range as the link has it");
        downlink_status: I16 = 12, "Downlink Status", uid("0501.12"), unit("%"), range(0.0, 100.0), ed4(32005, 9);
        communication_security_state: U8 = 13, "Communication Security State",
            uid("0501.13"), values(&DL_COMSEC_STATE), ed4(32005, 10);
        link_channel_priority_state: U8 = 14, "Link Channel Priority State",
            uid("0501.14"), values(&DL_PRIORITY), ed4(32005, 11);
    }

    DataLinkControlCommandStatus = 502, "Data Link Control Command Status"
        sent(ToCucs, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.4.1.8", "B1-59") ed4(&[32006])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0502.01"), unit("s since 1970"), ed4(32006, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0502.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0502.03"), identification();
        data_link_id: I32 = 4, "Data Link ID", uid("0502.04"), identification();
        addressed_terminal: U8 = 5, "Addressed Terminal", uid("0502.05"), values(&DL_TERMINAL), ed4(32006, 2);
        reported_demanded_data_link_state: U8 = 6, "Reported Demanded Data Link State",
            uid("0502.06"), values(&DL_STATE), ed4(32006, 3);
        reported_demanded_antenna_mode: U8 = 7, "Reported Demanded Antenna Mode",
            uid("0502.07"), values(&DL_ANTENNA_MODE), ed4(32006, 4);
        reported_demanded_communication_security_mode: U8 = 8, "Reported Demanded Communication Security Mode",
            uid("0502.08"), values(&DL_COMSEC_MODE), ed4(32006, 5);
    }

    PedestalStatusReport = 503, "Pedestal Status Report"
        sent(ToCucs, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.4.1.9", "B1-60") ed4(&[32100, 32102, 32103])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0503.01"), unit("s since 1970"), ed4(32103, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0503.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0503.03"), identification();
        data_link_id: I32 = 4, "Data Link ID", uid("0503.04"), identification();
        addressed_pedestal: U8 = 5, "Addressed Pedestal", uid("0503.05"), values(&DL_TERMINAL), ed4(32103, 2);
        pedestal_mode_state: U8 = 6, "Pedestal Mode State", uid("0503.06"), values(&PEDESTAL_MODE), ed4(32103, 3);
        reported_antenna_azimuth: F32 = 7, "Reported Antenna Azimuth",
            uid("0503.07"), unit("rad"), range(0.0, TAU), ed4(32103, 4), note("from true north");
        reported_antenna_elevation: F32 = 8, "Reported Antenna Elevation",
            uid("0503.08"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(32103, 5), note("from local horizontal");
        reported_antenna_azimuth_slew_rate: F32 = 9, "Reported Antenna Azimuth Slew Rate",
            uid("0503.09"), unit("rad/s"), range(-PI, PI), ed4(32103, 6);
        reported_antenna_elevation_slew_rate: F32 = 10, "Reported Antenna Elevation Slew Rate",
            uid("0503.10"), unit("rad/s"), range(-PI, PI), ed4(32103, 7);
        reported_gdt_latitude: F64 = 11, "Reported GDT Latitude",
            uid("0503.11"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(32103, 8), note("not for the ADT");
        reported_gdt_longitude: F64 = 12, "Reported GDT Longitude",
            uid("0503.12"), unit("rad"), range(-PI, PI), ed4(32103, 9), note("not for the ADT");
        reported_gdt_altitude: F32 = 13, "Reported GDT Altitude",
            uid("0503.13"), unit("m"), range(-1000.0, 100000.0), ed4(32103, 10), note("not for the ADT");
    }

    VehicleDataLinkTransitionCoordination = 600, "Vehicle Data Link Transition Coordination"
        sent(ToVsm, Push) latency_ms(1000) loi(&[3, 4])
        text("4.1.4.2.1", "B1-61") ed4(&[34000])
        note("tells the vehicle which terminal and radio settings to change over to, when one UCS hands over to another")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0600.01"), unit("s since 1970"), ed4(34000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0600.02"), identification();
        cucs_id: I32 = 3, "CUCS ID (Controlling)", uid("0600.03"), identification();
        data_link_id: I32 = 4, "Data Link ID (ADT)",
            uid("0600.04"), identification(), ed4(34000, 2), note("of the terminal in the vehicle");
        acquiring_cucs_id: I32 = 5, "Acquiring CUCS ID", uid("0600.05"), identification(), ed4(34000, 3);
        set_forward_link_carrier_frequency: F32 = 6, "Set Forward Link (FL) Carrier Frequency (ADT)",
            uid("0600.06"), unit("Hz"), ed4(34000, 4), note("range as the link has it");
        set_return_link_carrier_frequency: F32 = 7, "Set Return Link (RL) Carrier Frequency (ADT)",
            uid("0600.07"), unit("Hz"), ed4(34000, 5), note("range as the link has it");
        set_pn_code: U8 = 8, "Set PN Code (ADT)", uid("0600.08"), ed4(34000, 6), note("range as the link has it");
        acquiring_gdt_latitude: F64 = 9, "Acquiring GDT Latitude",
            uid("0600.09"), unit("rad"), range(-FRAC_PI_2, FRAC_PI_2), ed4(34000, 7);
        acquiring_gdt_longitude: F64 = 10, "Acquiring GDT Longitude",
            uid("0600.10"), unit("rad"), range(-PI, PI), ed4(34000, 8);
        acquiring_gdt_altitude: F32 = 11, "Acquiring GDT Altitude",
            uid("0600.11"), unit("m"), range(-1000.0, 100000.0), ed4(34000, 9);
        data_link_time_out_limit: F64 = 12, "Data Link Time-out Limit",
            uid("0600.12"), unit("s"), conf(C), ed4(34000, 10),
            note("refers to the time clause, so probably a moment (s since 1970), possibly a duration");
    }

    HandoverStatusReport = 700, "Handover Status Report"
        sent(ToCucs, Pull) latency_ms(1000) loi(&[3, 4])
        text("4.1.4.2.2", "B1-62") ed4(&[35000])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0700.01"), unit("s since 1970"), ed4(35000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0700.02"), identification();
        cucs_id: I32 = 3, "CUCS ID (relinquishing control)", uid("0700.03"), identification(), ed4(35000, 2);
        cucs_id_2: I32 = 4, "CUCS ID (acquiring control)", uid("0700.04"), identification(), ed4(35000, 3);
        status: U8 = 5, "Status", uid("0700.05"), values(&HANDOVER_STATUS), ed4(35000, 4);
        air_data_link_id: I32 = 6, "Air Data Link ID",
            uid("0700.06"), identification(), ed4(35000, 5), note("data link of the vehicle in transition");
    }
}
