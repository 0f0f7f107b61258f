//! The configuration phase: 40000 to 49999.

use super::{HEARD_STAMP, NULL_LINK, STAMP};
use crate::support::MessageSupport;

/// Of 41000, 41001 and 41003.
const BOUNDED: &[(&str, &str)] = &[
    ("Time Stamp", STAMP),
    ("VSM ID", "dli.vsm_id"),
    ("Data Link ID", NULL_LINK),
    ("Requested Message", "what it is about"),
    ("Requested Field", "what it is about, from 1"),
    ("Field Supported", "whether the field is used"),
    ("Default Value", "what a command may start from"),
    (
        "Max Value",
        "the vehicle's parameters and the configured limits",
    ),
    (
        "Min Value",
        "the vehicle's parameters and the configured limits",
    ),
    ("Low Caution Limit", "the vehicle's parameters"),
    ("Low Warning Limit", "the vehicle's parameters"),
    ("Help Text", "the unit, and where the bounds are from"),
    ("Subsystem ID", "not assigned"),
];

pub(super) static ROWS: &[MessageSupport] = &[
    MessageSupport {
        id: 40000,
        taken: "answered by 41000 to 41005, 43000, 43001 and 44003, unless dli.provisional is off",
        sends: "",
        honoured: &[
            ("Time Stamp", HEARD_STAMP),
            ("VSM ID", "refused unless this VSM's, everybody's or none"),
            (
                "Request Type",
                "0 one message or field, 1 to 4 LOI 2 to 5, 5 data link, 6 no more answers",
            ),
            ("Requested Message", "of Request Type 0"),
            (
                "Requested Field",
                "of Request Type 0, from 1; absent or 0: all",
            ),
        ],
        sent: &[],
    },
    MessageSupport {
        id: 41000,
        taken: "",
        sends: "in answer to 40000, and when a parameter changes: signed integers and angles, in steps on the wire",
        honoured: &[],
        sent: BOUNDED,
    },
    MessageSupport {
        id: 41001,
        taken: "",
        sends: "in answer to 40000: floats",
        honoured: &[],
        sent: BOUNDED,
    },
    MessageSupport {
        id: 41002,
        taken: "",
        sends: "in answer to 40000: enumerations, one for each value of this VSM's own",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("VSM ID", "dli.vsm_id"),
            ("Data Link ID", NULL_LINK),
            ("Station Number 1-16", "0"),
            ("Requested Message", "what it is about"),
            ("Requested Field", "what it is about, from 1"),
            ("Field Supported", "whether the field is used"),
            ("Default Value", "what a command may start from"),
            ("Vehicle Specific Enumeration Count", "how many there are"),
            ("Vehicle Specific Enumeration Index", "the value"),
            ("Vehicle Specific Enumeration Text", "its name"),
            ("Vehicle Specific Help Text", "its name in full"),
        ],
    },
    MessageSupport {
        id: 41003,
        taken: "",
        sends: "in answer to 40000, and when a parameter changes: unsigned integers, in steps on the wire",
        honoured: &[],
        sent: BOUNDED,
    },
    MessageSupport {
        id: 41004,
        taken: "",
        sends: "in answer to 40000: texts",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("VSM ID", "dli.vsm_id"),
            ("Data Link ID", NULL_LINK),
            ("Station Number 1-16", "0"),
            ("Requested Message", "what it is about"),
            ("Requested Field", "what it is about, from 1"),
            ("Field Supported", "whether the field is used"),
            ("Help Text", "empty"),
            ("Subsystem ID", "not assigned"),
        ],
    },
    MessageSupport {
        id: 41005,
        taken: "",
        sends: "after the last answer to a 40000",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("VSM ID", "dli.vsm_id"),
            ("Data Link ID", NULL_LINK),
            ("Station Number 1-16", "0"),
            ("Vehicle Type", "HEARTBEAT.type, 0 before it is heard"),
            ("Vehicle Subtype", "0"),
        ],
    },
    MessageSupport {
        id: 43000,
        taken: "",
        sends: "in answer to 40000 for LOI 2",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("VSM Home Web Page URL", "of http.listen; empty without it"),
            ("FTP URL", "empty"),
        ],
    },
    MessageSupport {
        id: 43001,
        taken: "",
        sends: "in answer to 40000 for LOI 4, one a route type",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("Route Type", "0 to 4"),
            ("Instances", "routes that a plan holds"),
            ("Maximum Number of Waypoints", "vehicle.curve.max_items"),
            ("Location Type Support", "0: absolute only"),
        ],
    },
    MessageSupport {
        id: 44003,
        taken: "",
        sends: "in answer to 40000: what is not supported; and when a mode comes or goes",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("Station Number 1-16", "0"),
            ("Reported Message", "what it is about"),
            (
                "Reported Field",
                "what it is about, from 1; 0: the whole message",
            ),
            ("Field Available", "whether the field is used"),
            ("Reported Enumerated Index", "the value that it is about"),
            (
                "Enumerated Index Enable",
                "-2 refused always, -1 now, 0 taken",
            ),
        ],
    },
];
