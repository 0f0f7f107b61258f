//! Connection and identity: 1, 20, 21.

use super::rows::messages;
use crate::ed25::values::{
    ACCESS_GRANTED, COUNTRY_CODE, LOI_BITMAP, REQUESTED_ACCESS, STATION_BITMAP, VEHICLE_TYPE,
    WAIT_TRANSITION,
};
use crate::field::Wire::{Char, F64, I32, U8, U16, U32};

messages! {
    CucsAuthorisationRequest = 1, "CUCS Authorisation Request"
        sent(ToVsm, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.1.1", "B1-9") ed4(&[1])
        note("asks for a connection at a given LOI, or discovers what can be had (LOI 0); broadcast VSM/vehicle ids when discovering; one message for each payload station if the LOIs differ; station mode must be 0 in a broadcast")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0001.01"), unit("s since 1970"), ed4(1, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0001.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0001.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("0001.04"), identification(), ed4(1, 2), note("broadcast id when discovering");
        data_link_id: I32 = 5, "Data Link ID",
            uid("0001.05"), identification(), ed4(1, 3), note("the data link that is to handle this message");
        vehicle_type: U16 = 6, "Vehicle Type",
            uid("0001.06"), values(&VEHICLE_TYPE), ed4(1, 4), note("Amendment 1: unit reads 'enumerated'");
        vehicle_subtype: U16 = 7, "Vehicle Subtype",
            uid("0001.07"), range(0.0, 32767.0), ed4(1, 5),
            note("maker's design block number; Amendment 1: range reads 'vehicle specific' (enumerated)");
        requested_handover_loi: U8 = 8, "Requested/Handover LOI",
            uid("0001.08"), values(&LOI_BITMAP), ed4(1, 6), note("0 = unspecified (discovery)");
        controlled_station: U32 = 9, "Controlled Station",
            uid("0001.09"), values(&STATION_BITMAP), ed4(1, 9), note("0 = no change");
        controlled_station_mode: U8 = 10, "Controlled Station Mode",
            uid("0001.10"), values(&REQUESTED_ACCESS), ed4(1, 7), note("0 in a broadcast");
        wait_for_vehicle_data_link_transition_coordination_message: U8 = 11, "Wait for Vehicle Data Link Transition Coordination Message",
            uid("0001.11"), values(&WAIT_TRANSITION), ed4(1, 14), note("wait for #600 before acting");
    }

    VehicleId = 20, "Vehicle ID"
        sent(ToCucs, PushPull) latency_ms(1000) loi(&[2, 3, 4])
        text("4.1.1.2", "B1-11") ed4(&[3])
        note("sent whenever its content changes; with no vehicle attached a VSM sends a logical vehicle id and tail number zero; a vehicle without a ground VSM sends the null VSM id")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0020.01"), unit("s since 1970"), ed4(3, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0020.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0020.03"), identification();
        vsm_id: I32 = 4, "VSM ID",
            uid("0020.04"), identification(), ed4(3, 2), note("null id when the vehicle has no VSM");
        vehicle_id_update: I32 = 5, "Vehicle ID Update",
            uid("0020.05"), identification(), ed4(3, 3),
            note("the id that replaces field 2 (logical to real, or back); equal to field 2 when nothing changes");
        vehicle_type: U16 = 6, "Vehicle Type",
            uid("0020.06"), values(&VEHICLE_TYPE), ed4(3, 4), note("Amendment 1: unit reads 'enumerated'");
        vehicle_subtype: U16 = 7, "Vehicle Subtype",
            uid("0020.07"), range(0.0, 32767.0), ed4(3, 5),
            note("Amendment 1: range reads 'vehicle specific' (enumerated)");
        owning_country_code: U8 = 8, "Owning Country Code", uid("0020.08"), values(&COUNTRY_CODE), ed4(3, 6);
        tail_number: Char(16) = 9, "Tail Number",
            uid("0020.09"), ed4(3, 7), note("type cell reads 'Character, 16 bytes'");
        mission_id: Char(20) = 10, "Mission ID",
            uid("0020.10"), ed4(3, 8), note("mission and flight plan now executing");
        atc_call_sign: Char(32) = 11, "ATC Call Sign",
            uid("0020.11"), ed4(3, 9), note("type cell reads 'Character, 32 bytes'");
    }

    VsmAuthorisationResponse = 21, "VSM Authorisation Response"
        sent(ToCucs, PushPull) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.1.3", "B1-12") ed4(&[2])
        note("answers #1: once for each vehicle or payload that could be controlled (discovery), or the verdict on a directed request; also sent unasked to withdraw an offer; every CUCS may listen to all of them")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("0021.01"), unit("s since 1970"), ed4(2, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("0021.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("0021.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("0021.04"), identification(), ed4(2, 2);
        data_link_id: I32 = 5, "Data Link ID", uid("0021.05"), identification(), ed4(2, 3);
        loi_authorized: U8 = 6, "LOI Authorized",
            uid("0021.06"), values(&LOI_BITMAP), ed4(2, 6),
            note("what this CUCS may get; 0 = connection not authorised");
        loi_granted: U8 = 7, "LOI Granted",
            uid("0021.07"), values(&LOI_BITMAP), ed4(2, 7), note("what it has now; 0 = N/A");
        controlled_station: U32 = 8, "Controlled Station",
            uid("0021.08"), values(&STATION_BITMAP), ed4(2, 9), note("0 = no change");
        controlled_station_mode: U8 = 9, "Controlled Station Mode",
            uid("0021.09"), values(&ACCESS_GRANTED), ed4(2, 5), note("the prose says 'Take Control' for 1");
        vehicle_type: U16 = 10, "Vehicle Type",
            uid("0021.10"), values(&VEHICLE_TYPE), ed4(2, 14), note("Amendment 1: unit reads 'enumerated'");
        vehicle_subtype: U16 = 11, "Vehicle Subtype",
            uid("0021.11"), range(0.0, 65535.0), ed4(2, 15),
            note("#1 and #20 stop at 32767; Amendment 1: range reads 'vehicle specific' (enumerated)");
    }
}
