//! Messages 1 to 5.

use super::{ECHO, HEARD_STAMP, NULL_LINK, STAMP};
use crate::support::MessageSupport;

pub(super) static ROWS: &[MessageSupport] = &[
    MessageSupport {
        id: 1,
        taken: "to everybody or the VSM: a question; to a vehicle: request, release or override of control",
        sends: "",
        honoured: &[
            ("Time Stamp", HEARD_STAMP),
            ("VSM ID", "refused unless this VSM's, everybody's or none"),
            (
                "Requested/Handover LOI",
                "the levels asked for or released; with bits beyond LOI 2 to 5 nothing is granted",
            ),
            (
                "Requested/Handover Access",
                "0 releases, 1 asks, 2 overrides where the configuration lets it; absent or without levels: a question; others are refused",
            ),
            (
                "Controlled Station 1-16",
                "the stations of the payload that the rights are for",
            ),
            (
                "Wait for Vehicle Data Link Transition Coordination Message",
                "1: the request waits for a handover",
            ),
            ("CUCS Type", ECHO),
            ("CUCS Subtype", ECHO),
            (
                "Controlled Station 17-32",
                "the stations of the payload that the rights are for",
            ),
        ],
        sent: &[],
    },
    MessageSupport {
        id: 2,
        taken: "",
        sends: "in answer to 1 and 4, on 17002, and when control is taken from a CUCS",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("VSM ID", "dli.vsm_id"),
            ("Data Link ID", NULL_LINK),
            (
                "Access Authorized",
                "1 where the configuration gives any level, else 0",
            ),
            ("Access Granted", "whether level 3, 4 or 5 is held"),
            ("LOI Authorized", "cucs.loi"),
            ("LOI Granted", "everything that this CUCS now holds"),
            ("Controlled Station 1-16", "stations that it holds"),
            ("Access Requested", "as asked"),
            ("Vehicle Type", "HEARTBEAT.type, 0 before it is heard"),
            ("Vehicle Subtype", "0"),
            ("CUCS Type", "as asked"),
            ("CUCS Subtype", "as asked"),
            ("Presence Vector Support", "partial vectors"),
            ("Controlled Station 17-32", "stations that it holds"),
        ],
    },
    MessageSupport {
        id: 3,
        taken: "",
        sends: "at the grant of LOI 2, on 17001 and 17002",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("VSM ID", "dli.vsm_id"),
            ("Vehicle ID Update", "vehicle.id"),
            ("Vehicle Type", "HEARTBEAT.type, 0 before it is heard"),
            ("Vehicle Subtype", "0"),
            ("Owning ID", "the first byte of vehicle.id"),
            ("Tail Number", "vehicle.tail_number"),
            ("Mission ID", "of the route aboard"),
        ],
    },
    MessageSupport {
        id: 4,
        taken: "a handover is asked for, consented to or offered; settled by 2, 5 and 35000",
        sends: "a wish for control is passed on to the holder",
        honoured: &[
            ("Time Stamp", HEARD_STAMP),
            ("Requested/Handover LOI", "the levels to hand over"),
            ("Controlled Station 1-16", "stations to hand over"),
            (
                "Requesting CUCS ID",
                "who acquires; absent or null: the sender",
            ),
            ("Controlled Station 17-32", "stations to hand over"),
        ],
        sent: &[
            ("Time Stamp", STAMP),
            ("VSM ID", "dli.vsm_id"),
            ("Data Link ID", NULL_LINK),
            ("Vehicle Type", "HEARTBEAT.type, 0 before it is heard"),
            ("Vehicle Subtype", "0"),
            ("Requested/Handover LOI", "the levels wished for"),
            ("Controlled Station 1-16", "stations wished for"),
            ("Requesting CUCS ID", "who wishes for them"),
            ("Presence Vector Support", "partial vectors"),
            ("Controlled Station 17-32", "stations wished for"),
        ],
    },
    MessageSupport {
        id: 5,
        taken: "",
        sends: "control is offered to a successor, or has been handed over",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("VSM ID", "dli.vsm_id"),
            ("Data Link ID", NULL_LINK),
            ("LOI Authorized", "the levels that are handed over"),
            (
                "Controlled Station 1-16 Authorized",
                "stations that are handed over",
            ),
            ("Vehicle Type", "HEARTBEAT.type, 0 before it is heard"),
            ("Vehicle Subtype", "0"),
            ("Requesting CUCS ID", "who acquires"),
            ("Presence Vector Support", "partial vectors"),
            (
                "Controlled Station 17-32 Authorized",
                "stations that are handed over",
            ),
        ],
    },
];
