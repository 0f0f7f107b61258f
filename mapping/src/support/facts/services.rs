//! Alerts, acknowledgements, requests, handover: 15000 to 39999.

use crate::support::row::{MessageSupport, NULL_LINK, RECEIVED_STAMP, STAMP};

pub(super) static ROWS: &[MessageSupport] = &[
    MessageSupport {
        id: 15000,
        taken: "answered by 16001, unless dli.provisional is off; needs LOI 2",
        sends: "",
        honoured: &[
            ("Time Stamp", RECEIVED_STAMP),
            ("Subsystem ID", "which; absent or 0: all that are known"),
        ],
        sent: &[],
    },
    MessageSupport {
        id: 15001,
        taken: "answered by 16001 with the texts of the active alerts, unless dli.provisional is off; needs LOI 2",
        sends: "",
        honoured: &[
            ("Time Stamp", RECEIVED_STAMP),
            (
                "Subsystem State Report Reference",
                "of the 16001 that reported it; others are refused",
            ),
        ],
        sent: &[],
    },
    MessageSupport {
        id: 16000,
        taken: "",
        sends: "when something happens (STATUSTEXT, SYS_STATUS, ESTIMATOR_STATUS, BATTERY_STATUS, GPS_RAW_INT, HEARTBEAT), changes or is over; of a refusal with its reason (COMMAND_ACK, PARAM_ERROR), cleared 15 s later",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("Data Link ID", NULL_LINK),
            ("Priority", "STATUSTEXT.severity, or this VSM's own"),
            (
                "Subsystem State Report Reference",
                "-1: there is no more to request",
            ),
            ("Subsystem ID", "what it is about; 20 is the autopilot"),
            (
                "Type",
                "1 while its cause lasts, 2 of what has happened, 0 when it is over",
            ),
            ("Alert (Warning) ID", "negative the first time"),
            ("Text", "for the operator"),
            ("Persistence", "-1, undefined; 0 when it is over"),
            ("Append Order", "where the text needs several"),
            ("Append Total Number", "where the text needs several"),
        ],
    },
    MessageSupport {
        id: 16001,
        taken: "",
        sends: "by 17001, on 17002, 15000 and 15001, one a subsystem",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            (
                "Subsystem ID",
                "0 engine, 3 comms, 4 propulsion energy, 5 navigation",
            ),
            (
                "Subsystem State",
                "SYS_STATUS, ESTIMATOR_STATUS, battery, heartbeat",
            ),
            (
                "Subsystem State Report Reference",
                "what 15001 requests with where alerts are active; -1: there is no more",
            ),
            ("Report Text Reference", "on 15001: the alert's text"),
        ],
    },
    MessageSupport {
        id: 16002,
        taken: "the CUCS is connected; once sent, its loss is detected",
        sends: "each second from LOI 2 on",
        honoured: &[("Time Stamp", RECEIVED_STAMP)],
        sent: &[("Time Stamp", STAMP)],
    },
    MessageSupport {
        id: 17000,
        taken: "ignored: this VSM requests no acknowledgement",
        sends: "for every message that requests it: received, then carried out or refused",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("Original Message Time Stamp", "of the message"),
            ("Original Message Type", "of the message"),
            (
                "Acknowledgement Type",
                "1 received, 2 carried out (shown by the vehicle, not by COMMAND_ACK alone), 3 refused",
            ),
        ],
    },
    MessageSupport {
        id: 17001,
        taken: "a report is sent at this rate, its sources requested by SET_MESSAGE_INTERVAL",
        sends: "",
        honoured: &[
            ("Time Stamp", RECEIVED_STAMP),
            (
                "Requested Message Type",
                "3, 3000 to 3002, 3004 to 3007, 3009 to 3011, 4000, 4001, 12101, 16001, 16002; others are refused",
            ),
            (
                "Frequency",
                "1 to 100 Hz; 0: stop; forgotten when LOI 2 ends",
            ),
        ],
        sent: &[],
    },
    MessageSupport {
        id: 17002,
        taken: "a report is sent once",
        sends: "",
        honoured: &[
            ("Time Stamp", RECEIVED_STAMP),
            (
                "Message Type",
                "2, 50013 and those of 17001; others are refused",
            ),
            (
                "Requested Field Presence Vector",
                "the fields to send, beside the stamp; 0: all",
            ),
        ],
        sent: &[],
    },
    MessageSupport {
        id: 34000,
        taken: "dli.provisional = all: control is handed over or requested; else refused",
        sends: "",
        honoured: &[
            ("Time Stamp", RECEIVED_STAMP),
            ("Acquiring CUCS ID", "who acquires; needed"),
            (
                "Set Forward Link Carrier Frequency (ADT)",
                "0; others are refused",
            ),
            (
                "Set Return Link Carrier Frequency (ADT)",
                "0; others are refused",
            ),
            ("Set PN Code (ADT)", "0; others are refused"),
        ],
        sent: &[],
    },
    MessageSupport {
        id: 35000,
        taken: "",
        sends: "when a handover begins or ends, unless dli.provisional is off",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("CUCS ID (relinquishing control)", "the holder, or null"),
            ("CUCS ID (acquiring control)", "the successor, or null"),
            ("Status", "how far it is"),
            ("Air Data Link ID", NULL_LINK),
        ],
    },
];
