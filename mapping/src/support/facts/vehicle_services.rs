//! Private messages 50010 to 50018: parameters, software versions, ping, areas.

use super::{AS_RECEIVED, HEARD_STAMP, STAMP};
use crate::support::MessageSupport;

pub(super) static ROWS: &[MessageSupport] = &[
    MessageSupport {
        id: 50010,
        taken: "one parameter of the vehicle, or all, is read and told by 50012; needs LOI 2",
        sends: "",
        honoured: &[
            ("Time Stamp", HEARD_STAMP),
            ("Parameter Name", "which; absent or empty: all"),
        ],
        sent: &[],
    },
    MessageSupport {
        id: 50011,
        taken: "a parameter of the vehicle is written; needs LOI 4",
        sends: "",
        honoured: &[
            ("Time Stamp", HEARD_STAMP),
            (
                "Parameter Name",
                "which; refused where its range is not known",
            ),
            ("Commanded Value", "refused out of its range"),
        ],
        sent: &[],
    },
    MessageSupport {
        id: 50012,
        taken: "",
        sends: "in answer to 50010 and 50011, and on a later change to those that have asked",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("Parameter Name", "PARAM_VALUE.param_id"),
            ("Parameter Kind", "PARAM_VALUE.param_type"),
            ("Value", "PARAM_VALUE.param_value"),
            ("Minimum", "the table of PX4 v1.18"),
            ("Maximum", "the table of PX4 v1.18"),
            ("Parameter Index", "where all are told"),
            ("Parameter Count", "where all are told"),
        ],
    },
    MessageSupport {
        id: 50013,
        taken: "",
        sends: "on 17002",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("VSM Version", "its own"),
            ("Autopilot Version", "AUTOPILOT_VERSION.flight_sw_version"),
            (
                "Autopilot Source",
                "AUTOPILOT_VERSION.flight_custom_version",
            ),
            ("Board Version", "AUTOPILOT_VERSION.board_version"),
            ("Hardware ID", "AUTOPILOT_VERSION.uid"),
        ],
    },
    MessageSupport {
        id: 50014,
        taken: "answered by 50015; needs LOI 2",
        sends: "",
        honoured: &[
            ("Time Stamp", "returned in 50015"),
            ("Ping Number", "returned in 50015"),
            ("Ping Target", "0 the VSM, 1 the vehicle (PING)"),
        ],
        sent: &[],
    },
    MessageSupport {
        id: 50015,
        taken: "",
        sends: "in answer to 50014",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("Ping Number", "of the 50014"),
            ("Ping Target", "who has answered"),
            ("Request Time Stamp", "of the 50014"),
            ("Vehicle Round Trip", "from PING to its return"),
        ],
    },
    MessageSupport {
        id: 50016,
        taken: "stored; part of the geofence after 50017",
        sends: "on download",
        honoured: &[
            ("Time Stamp", HEARD_STAMP),
            ("Area ID", "1 to 65535"),
            ("Area Type", "polygon or circle, to stay inside or outside"),
            (
                "Vertex Count",
                "3 to 64 of a polygon, 1 of a circle; another count begins the area anew",
            ),
            ("Vertex Number", "1 to Vertex Count"),
            ("Latitude", "where it lies"),
            ("Longitude", "where it lies"),
            ("Radius", "of a circle"),
        ],
        sent: &[
            ("Time Stamp", STAMP),
            ("Area ID", AS_RECEIVED),
            ("Area Type", AS_RECEIVED),
            ("Vertex Count", AS_RECEIVED),
            ("Vertex Number", AS_RECEIVED),
            ("Latitude", AS_RECEIVED),
            ("Longitude", AS_RECEIVED),
            ("Radius", AS_RECEIVED),
        ],
    },
    MessageSupport {
        id: 50017,
        taken: "loads, clears or downloads the areas; answered by 50018; needs LOI 4",
        sends: "",
        honoured: &[("Time Stamp", HEARD_STAMP), ("Area Plan Mode", "1 to 3")],
        sent: &[],
    },
    MessageSupport {
        id: 50018,
        taken: "",
        sends: "during and after what 50017 has asked",
        honoured: &[],
        sent: &[
            ("Time Stamp", STAMP),
            ("Area Plan Mode", "of the 50017"),
            (
                "Status",
                "complete once the vehicle holds the fence, read back",
            ),
            (
                "Area ID",
                "what a refusal is about; 0: an area of the configuration, or none",
            ),
            ("Vertex Number", "what a refusal is about; 0: no one vertex"),
        ],
    },
];
