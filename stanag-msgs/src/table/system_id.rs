//! System identification and authorisation: 1 to 5.

use super::codec::messages;
use crate::enums::{
    AccessGranted, FlightPathControlMode, LoiBitmap, PayloadType, PresenceVectorSupport,
    RequestedAccess, StationBitmap1To16, StationBitmap17To32, WaitTransition,
};
use crate::id::Id;
use crate::scalar::{Text, TimeStamp};

messages! {
    CucsAuthorisationRequest = 1, "CUCS Authorisation Request", presence bytes 3
        sent(ToVsm, Push) layout(Ed4, A) latency_ms(1000) table("4-34") ed2_message("1")
        source("T+K (K omits nothing); M partial")
        corroboration("T and K agree on field order; K's integer holders for the 1-byte fields are 32 bit, so widths rest on T")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0001.01");
        vsm_id: Id = 1, "VSM ID", uid("0001.04");
        data_link_id: Id = 2, "Data Link ID", uid("0001.05");
        vehicle_type: u16 = 3, "Vehicle Type", uid("0001.06");
        vehicle_subtype: u16 = 4, "Vehicle Subtype", uid("0001.07");
        requested_handover_loi: LoiBitmap = 5, "Requested/Handover LOI", uid("0001.08");
        requested_handover_access: RequestedAccess = 6, "Requested/Handover Access",
            uid("0001.10?");
        requested_flight_mode: FlightPathControlMode = 7, "Requested Flight Mode";
        controlled_station_1_16: StationBitmap1To16 = 8, "Controlled Station 1-16", uid("0001.09?");
        component_number: u16 = 9, "Component Number";
        sub_component_number: u16 = 10, "Sub-Component Number";
        payload_type: PayloadType = 11, "Payload Type";
        asset_mode: u8 = 12, "Asset Mode";
        wait_for_vehicle_data_link_transition_coordination_message: WaitTransition = 13, "Wait for Vehicle Data Link Transition Coordination Message",
            uid("0001.11");
        cucs_type: u8 = 14, "CUCS Type";
        cucs_subtype: u16 = 15, "CUCS Subtype";
        presence_vector_support: PresenceVectorSupport = 16, "Presence Vector Support";
        controlled_station_17_32: StationBitmap17To32 = 17, "Controlled Station 17-32";
    }

    VsmAuthorisationResponse = 2, "VSM Authorisation Response", presence bytes 3
        sent(ToCucs, PushPull) layout(Ed4, A) latency_ms(1000) table("4-38") ed2_message("21")
        source("T; K confirms first 8 (uids 0021.01/.04/.05/.13/.09/.06/.07/.16)")
        corroboration("T and K agree on the first 8 fields; the rest T only")
        note("T's first version had Flight Modes Granted as u32 bitmap and CUCS Subtype u8; corrected in its 'aligned' commit and K has Byte")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0021.01");
        vsm_id: Id = 1, "VSM ID", uid("0021.04");
        data_link_id: Id = 2, "Data Link ID", uid("0021.05");
        access_authorized: u8 = 3, "Access Authorized", uid("0021.13");
        access_granted: AccessGranted = 4, "Access Granted", uid("0021.09");
        loi_authorized: LoiBitmap = 5, "LOI Authorized", uid("0021.06");
        loi_granted: LoiBitmap = 6, "LOI Granted", uid("0021.07");
        flight_modes_granted: FlightPathControlMode = 7, "Flight Modes Granted", uid("0021.16");
        controlled_station_1_16: StationBitmap1To16 = 8, "Controlled Station 1-16", uid("0021.08?");
        component_number: u16 = 9, "Component Number";
        sub_component_number: u16 = 10, "Sub-Component Number";
        payload_type: PayloadType = 11, "Payload Type";
        access_requested: u8 = 12, "Access Requested", note("T marks it bitmapped");
        vehicle_type: u16 = 13, "Vehicle Type", uid("0021.10");
        vehicle_subtype: u16 = 14, "Vehicle Subtype", uid("0021.11");
        cucs_type: u8 = 15, "CUCS Type";
        cucs_subtype: u16 = 16, "CUCS Subtype";
        presence_vector_support: PresenceVectorSupport = 17, "Presence Vector Support";
        controlled_station_17_32: StationBitmap17To32 = 18, "Controlled Station 17-32";
    }

    VehicleId = 3, "Vehicle ID", presence bytes 2
        sent(ToCucs, PushPull) layout(Ed4, A) latency_ms(1000) table("4-39") ed2_message("20")
        source("T+K")
        corroboration("T+K")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", uid("0020.01");
        vsm_id: Id = 1, "VSM ID", uid("0020.04");
        vehicle_id_update: Id = 2, "Vehicle ID Update", uid("0020.05");
        vehicle_type: u16 = 3, "Vehicle Type", uid("0020.06");
        vehicle_subtype: u16 = 4, "Vehicle Subtype", uid("0020.07");
        owning_id: u8 = 5, "Owning ID",
            uid("0020.08"), note("owner code (country table), was Owning Country Code");
        tail_number: Text<16> = 6, "Tail Number", uid("0020.09");
        mission_id: Text<20> = 7, "Mission ID", uid("0020.10");
        atc_call_sign: Text<32> = 8, "ATC Call Sign", uid("0020.11");
        configuration_checksum: u16 = 9, "Configuration Checksum", uid("0020.12");
    }

    PositiveHandoverAuthorisationRequest = 4, "Positive Handover Authorisation Request", presence bytes 2
        sent(ToVsm, Push) layout(Ed4, A) latency_ms(1000) table("4-40")
        source("T only")
        note("new in Ed4 (Ed3 group System ID has 3 messages)")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        vsm_id: Id = 1, "VSM ID";
        data_link_id: Id = 2, "Data Link ID";
        vehicle_type: u16 = 3, "Vehicle Type";
        vehicle_subtype: u16 = 4, "Vehicle Subtype";
        requested_handover_loi: LoiBitmap = 5, "Requested/Handover LOI";
        flight_mode_offset: u8 = 6, "Flight Mode Offset",
            note("first flight-mode value that bit 0 of the next field stands for (inferred)");
        requested_flight_mode: u32 = 7, "Requested Flight Mode", note("bitmap");
        controlled_station_1_16: StationBitmap1To16 = 8, "Controlled Station 1-16";
        component_number: u16 = 9, "Component Number";
        sub_component_number: u16 = 10, "Sub-Component Number";
        requesting_cucs_type: u8 = 11, "Requesting CUCS Type";
        requesting_cucs_subtype: u16 = 12, "Requesting CUCS Subtype";
        requesting_cucs_id: Id = 13, "Requesting CUCS ID";
        presence_vector_support: PresenceVectorSupport = 14, "Presence Vector Support";
        controlled_station_17_32: StationBitmap17To32 = 15, "Controlled Station 17-32";
    }

    PositiveHandoverAuthorisationGranted = 5, "Positive Handover Authorisation Granted", presence bytes 2
        sent(ToCucs, Pull) layout(Ed4, A) latency_ms(1000) table("4-41")
        source("T only")
        note("ANOMALY: T states a 3-byte presence vector for 16 fields; the ceil(n/8) rule gives 2. Either the table has an odd width or a 17th field is missing.")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        vsm_id: Id = 1, "VSM ID";
        data_link_id: Id = 2, "Data Link ID";
        loi_authorized: LoiBitmap = 3, "LOI Authorized";
        flight_mode_offset: u8 = 4, "Flight Mode Offset";
        flight_modes_authorized: u32 = 5, "Flight Modes Authorized", note("bitmap");
        controlled_station_1_16_authorized: StationBitmap1To16 = 6, "Controlled Station 1-16 Authorized";
        component_number_authorized: u16 = 7, "Component Number Authorized";
        sub_component_number_authorized: u16 = 8, "Sub-Component Number Authorized";
        vehicle_type: u16 = 9, "Vehicle Type";
        vehicle_subtype: u16 = 10, "Vehicle Subtype";
        requesting_cucs_type: u8 = 11, "Requesting CUCS Type";
        requesting_cucs_subtype: u16 = 12, "Requesting CUCS Subtype";
        requesting_cucs_id: Id = 13, "Requesting CUCS ID";
        presence_vector_support: PresenceVectorSupport = 14, "Presence Vector Support";
        controlled_station_17_32_authorized: StationBitmap17To32 = 15, "Controlled Station 17-32 Authorized";
    }
}
