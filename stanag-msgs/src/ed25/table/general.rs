//! Acknowledgements, schedules and requests, 1400 to 1403; IFF, 1500 to 1600.

use super::rows::messages;
use crate::ed25::values::{
    IFF_HOLD, IFF_IDENT, IFF_MODE, IFF_MODE4_AB, IFF_ONOFF, IFF_ZEROIZE, STATION_BITMAP,
};
use crate::field::Wire::{F32, F64, I8, I16, I32, U8, U16, U32};

messages! {
    MessageAcknowledgement = 1400, "Message Acknowledgement"
        sent(Both, Pull) latency_ms(1000) loi(&[2, 3, 4])
        text("4.1.8.1", "B1-84") ed4(&[17000])
        note("acknowledges a message that #1401 made subject to it; ids that do not apply are null")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1400.01"), unit("s since 1970"), ed4(17000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1400.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1400.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("1400.04"), identification();
        data_link_id: I32 = 5, "Data Link ID", uid("1400.05"), identification();
        original_message_time_stamp: F64 = 6, "Original Message Time Stamp",
            uid("1400.06"), unit("s since 1970"), ed4(17000, 2);
        original_message_instance_id: U32 = 7, "Original Message Instance ID",
            uid("1400.07"), range(0.0, 4294967295.0), note("instance id of the wrapper acknowledged");
        original_message_type: U32 = 8, "Original Message Type",
            uid("1400.08"), range(0.0, 4294967295.0), ed4(17000, 3);
    }

    MessageAcknowledgeConfiguration = 1401, "Message Acknowledge Configuration"
        sent(Both, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.8.2", "B1-85")
        note("makes a message type subject to #1400; before a connection only for configuration messages (after #1200); lapses on abort of #1200, on relinquish (#21) or on loss of the connection; ids that do not apply are null")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1401.01"), unit("s since 1970");
        vehicle_id: I32 = 2, "Vehicle ID", uid("1401.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1401.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("1401.04"), identification();
        data_link_id: I32 = 5, "Data Link ID", uid("1401.05"), identification();
        message_type: U32 = 6, "Message Type", uid("1401.06"), note("message number");
    }

    ScheduleMessageUpdateCommand = 1402, "Schedule Message Update Command"
        sent(Both, Push) latency_ms(2000) loi(&[2, 3, 4])
        text("4.1.8.3", "B1-86") ed4(&[17001])
        note("turns a message into a periodic push")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1402.01"), unit("s since 1970"), ed4(17001, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1402.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1402.03"), identification();
        requested_message_type: U32 = 4, "Requested Message Type",
            uid("1402.04"), ed4(17001, 2), note("message number");
        frequency: F32 = 5, "Frequency",
            uid("1402.05"), unit("Hz"), range(0.0, 100.0), ed4(17001, 3), note("0 cancels");
    }

    GenericInformationRequestMessage = 1403, "Generic Information Request Message"
        sent(Both, Push) latency_ms(1000) loi(&[2, 3, 4])
        text("4.1.8.4", "B1-87") ed4(&[17002])
        note("asks once for a message, not for #1300 to #1303; ids that do not apply are null")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1403.01"), unit("s since 1970"), ed4(17002, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1403.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1403.03"), identification();
        vsm_id: I32 = 4, "VSM ID", uid("1403.04"), identification();
        data_link_id: I32 = 5, "Data Link ID", uid("1403.05"), identification();
        station_number: U32 = 6, "Station Number",
            uid("1403.06"), values(&STATION_BITMAP), ed4(17002, 2), note("0 = N/A");
        message_type: U32 = 7, "Message Type", uid("1403.07"), ed4(17002, 5), note("message number");
    }

    IffCodeCommand = 1500, "IFF Code Command"
        sent(ToVsm, Push) latency_ms(1000) loi(&[4])
        text("4.1.9.1", "B1-88") ed4(&[5000])
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1500.01"), unit("s since 1970"), ed4(5000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1500.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1500.03"), identification();
        mode_1_code: I8 = 4, "Mode 1 Code",
            uid("1500.04"), conf(C), ed4(5000, 2),
            note("two digits, 0..7 and 0..3, 'transmitted as decimal': whether octal 73 goes as 73 or 59 is not said");
        mode_1_enable: U8 = 5, "Mode 1 Enable", uid("1500.05"), values(&IFF_ONOFF), ed4(5000, 3);
        mode_2_code: I16 = 6, "Mode 2 Code",
            uid("1500.06"), conf(C), ed4(5000, 4), note("octal 0000..7777 'transmitted as decimal' (7777 or 4095?)");
        mode_2_enable: U8 = 7, "Mode 2 Enable", uid("1500.07"), values(&IFF_ONOFF), ed4(5000, 5);
        mode_3_a_code: I16 = 8, "Mode 3/A Code",
            uid("1500.08"), conf(C), ed4(5000, 6), note("octal 0000..7777 'transmitted as decimal' (7777 or 4095?)");
        mode_3_a_enable: U8 = 9, "Mode 3/A Enable", uid("1500.09"), values(&IFF_ONOFF), ed4(5000, 7);
        mode_c_enable: U8 = 10, "Mode C Enable", uid("1500.10"), values(&IFF_ONOFF), ed4(5000, 8);
        mode_4_enable: U8 = 11, "Mode 4 Enable", uid("1500.11"), values(&IFF_ONOFF), ed4(5000, 9);
        mode_4_a_b: U8 = 12, "Mode 4 A/B", uid("1500.12"), values(&IFF_MODE4_AB), ed4(5000, 10);
        mode_4_hold: U8 = 13, "Mode 4 Hold", uid("1500.13"), values(&IFF_HOLD), ed4(5000, 11);
        mode_4_zeroize: U8 = 14, "Mode 4 Zeroize", uid("1500.14"), values(&IFF_ZEROIZE), ed4(5000, 12);
        mode: U8 = 15, "Mode", uid("1500.15"), values(&IFF_MODE), ed4(5000, 13);
    }

    IffIdentSquawkCommand = 1501, "IFF Ident (Squawk) Command"
        sent(ToVsm, Push) latency_ms(1000) loi(&[4])
        text("4.1.9.2", "B1-89") ed4(&[5001])
        note("ident for a while, then standby again; #1500 ends it early")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1501.01"), unit("s since 1970"), ed4(5001, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1501.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1501.03"), identification();
        mode_3_a_ident: U8 = 4, "Mode 3/A Ident", uid("1501.04"), values(&IFF_IDENT), ed4(5001, 2);
        ident_enable_duration: U16 = 5, "Ident Enable Duration",
            uid("1501.05"), unit("s"), range(1.0, 65535.0), ed4(5001, 3), note("0 = indefinite; Amendment 1: absent");
    }

    IffStatusReport = 1600, "IFF Status Report"
        sent(ToCucs, PushPull) latency_ms(1000) loi(&[4])
        text("4.1.9.3", "B1-90") ed4(&[6000])
        note("reports no Mode 2 code and no Mode 4 zeroize")
    {
        time_stamp: F64 = 1, "Time Stamp", uid("1600.01"), unit("s since 1970"), ed4(6000, 1);
        vehicle_id: I32 = 2, "Vehicle ID", uid("1600.02"), identification();
        cucs_id: I32 = 3, "CUCS ID", uid("1600.03"), identification();
        mode_1_code: I8 = 4, "Mode 1 Code", uid("1600.04"), conf(C), ed4(6000, 2), note("coded as in #1500");
        mode_1_enabled: U8 = 5, "Mode 1 Enabled", uid("1600.05"), values(&IFF_ONOFF), ed4(6000, 3);
        mode_2_enabled: U8 = 6, "Mode 2 Enabled", uid("1600.06"), values(&IFF_ONOFF), ed4(6000, 4);
        mode_3_a_code: I16 = 7, "Mode 3/A Code", uid("1600.07"), conf(C), ed4(6000, 5), note("coded as in #1500");
        mode_3_a_enabled: U8 = 8, "Mode 3/A Enabled", uid("1600.08"), values(&IFF_ONOFF), ed4(6000, 6);
        mode_c_enabled: U8 = 9, "Mode C Enabled", uid("1600.09"), values(&IFF_ONOFF), ed4(6000, 7);
        mode_4_enable: U8 = 10, "Mode 4 Enable", uid("1600.10"), values(&IFF_ONOFF), ed4(6000, 8);
        mode_4_a_b: U8 = 11, "Mode 4 A/B", uid("1600.11"), values(&IFF_MODE4_AB), ed4(6000, 9);
        mode_4_hold: U8 = 12, "Mode 4 Hold", uid("1600.12"), values(&IFF_HOLD), ed4(6000, 10);
        mode: U8 = 13, "Mode", uid("1600.13"), values(&IFF_MODE), ed4(6000, 11);
    }
}
