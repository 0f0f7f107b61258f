//! Alerts, acknowledgements, requests: 15000 to 18999.

use crate::support::row::{MEASURED, NULL_LINK, RECEIVED_STAMP, STAMP, facts};

facts! {
    15000 taken "answered by 16001, unless dli.provisional is off; needs LOI 2" {
        "Time Stamp": RECEIVED_STAMP;
        "Subsystem ID": "which; absent or 0: all that are known";
    }
    15001 taken "answered by 16001 with the texts of the active alerts, unless dli.provisional is off; needs LOI 2" {
        "Time Stamp": RECEIVED_STAMP;
        "Subsystem State Report Reference": "of the 16001 that reported it; others are refused";
    }
    16000 sends "when something happens (STATUSTEXT, EVENT, SYS_STATUS, ESTIMATOR_STATUS, BATTERY_STATUS, GPS_RAW_INT, HEARTBEAT), changes or is over; of a refusal with its reason (COMMAND_ACK, PARAM_ERROR), cleared 15 s later" {
        "Time Stamp": STAMP;
        "Data Link ID": NULL_LINK;
        "Priority": "STATUSTEXT.severity, EVENT.log_levels, or this VSM's own";
        "Subsystem State Report Reference": "-1: there is no more to request";
        "Subsystem ID": "what it is about; 20 is the autopilot";
        "Type": "1 while its cause lasts, 2 of what has happened, 0 when it is over";
        "Alert (Warning) ID": "negative the first time";
        "Text": "for the operator";
        "Persistence": "-1, undefined; 0 when it is over";
        "Append Order": "where the text needs several";
        "Append Total Number": "where the text needs several";
    }
    16001 sends "by 17001, on 17002, 15000 and 15001, one a subsystem" {
        "Time Stamp": STAMP;
        "Subsystem ID": "0 engine, 3 comms, 4 propulsion energy, 5 navigation";
        "Subsystem State": "SYS_STATUS, ESTIMATOR_STATUS, battery, heartbeat";
        "Subsystem State Report Reference": "what 15001 requests with where alerts are active; -1: there is no more";
        "Report Text Reference": "on 15001: the alert's text";
    }
    16002 taken "the CUCS is connected; once sent, its loss is detected" {
        "Time Stamp": RECEIVED_STAMP;
    } sends "each second from LOI 2 on, by 17001, on 17002" {
        "Time Stamp": STAMP;
    }
    17000 taken "ignored: this VSM requests no acknowledgement" {
    } sends "for every message that requests it: received, then carried out or refused" {
        "Time Stamp": STAMP;
        "Original Message Time Stamp": "of the message";
        "Original Message Type": "of the message";
        "Acknowledgement Type": "1 received, 2 carried out (shown by the vehicle, not by COMMAND_ACK alone), 3 refused";
    }
    17001 taken "a report is sent at this rate, its sources requested by SET_MESSAGE_INTERVAL" {
        "Time Stamp": RECEIVED_STAMP;
        "Requested Message Type": "3, 3000 to 3002, 3004 to 3007, 3009 to 3011, 3016, 4000, 4001, 12001, 12101, 16001, 16002, 18300, 18500, 21000, 21100, 21101, 28001, 32000, 32003, 32005, 32006, 32200, 32302, 32400, 50025; others are refused";
        "Frequency": "1 to 100 Hz; 0: stop; forgotten when LOI 2 ends";
    }
    17002 taken "a report is sent once" {
        "Time Stamp": RECEIVED_STAMP;
        "Station Number 1-16": "of 21000, 21100 and 21101: the stations; none: all";
        "Message Type": "2, 35000, 50013, 50022, 50023 and those of 17001; others are refused";
        "Requested Field Presence Vector": "the fields to send, beside the stamp; 0: all";
    }
    18300 sends "by 17001, on 17002; never of a silent vehicle, or before wind or temperature are known" {
        "Time Stamp": MEASURED;
        "Publish Time": "when it is sent";
        "Forecast Time": "as the stamp: it is measured";
        "Latitude": "GLOBAL_POSITION_INT: where the vehicle is";
        "Longitude": "GLOBAL_POSITION_INT";
        "Number of Levels": "1";
        "Altitude": "GLOBAL_POSITION_INT and the geoid separation";
        "U_Speed": "WIND_COV, north, where the air goes; steps of 0.05 m/s: no source gives one";
        "V_Speed": "WIND_COV, east; steps of 0.05 m/s";
        "Temperature": "HIGHRES_IMU, else SCALED_PRESSURE, which is that of the barometer";
    }
    18500 sends "by 17001, on 17002; never of a silent vehicle" {
        "Time Stamp": STAMP;
        "Number of Satellites": "GPS_RAW_INT";
        "GPS Mode": "GPS_RAW_INT.fix_type: no source gives the values";
        "GPS Status": "1 with a position in three dimensions, else 0: no source gives the values";
        "PDOP": "of the two others; steps of 0.1: no source gives one";
        "HDOP": "GPS_RAW_INT; steps of 0.1";
        "VDOP": "GPS_RAW_INT; steps of 0.1";
        "GPS Time": "GPS_RAW_INT.time_usec, UTC, once the receiver has it";
    }
}
