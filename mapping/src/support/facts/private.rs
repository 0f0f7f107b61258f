//! Private messages: 50000 and up.

use super::{AS_RECEIVED, HEARD_STAMP, STAMP};
use crate::support::MessageSupport;

pub(super) static ROWS: &[MessageSupport] = &[
    MessageSupport {
        id: 50001,
        taken: "stored as a curved leg of the plan, flown as chords after 13000",
        sends: "on download",
        honoured: &[
            ("Vehicle ID", "refused unless the wrapper's"),
            ("CUCS ID", "refused unless the wrapper's"),
            ("P1 Waypoint No", "where the leg starts"),
            ("P4 Waypoint No", "where it ends"),
            ("P2 Latitude", "a control point"),
            ("P2 Longitude", "a control point"),
            ("P3 Latitude", "a control point"),
            ("P3 Longitude", "a control point"),
        ],
        sent: &[
            ("Time Stamp", STAMP),
            ("Vehicle ID", "the wrapper's"),
            ("CUCS ID", "the wrapper's"),
            ("P1 Waypoint No", AS_RECEIVED),
            ("P4 Waypoint No", AS_RECEIVED),
            ("P2 Latitude", AS_RECEIVED),
            ("P2 Longitude", AS_RECEIVED),
            ("P3 Latitude", AS_RECEIVED),
            ("P3 Longitude", AS_RECEIVED),
        ],
    },
    MessageSupport {
        id: 50002,
        taken: "stored as a curved leg of the plan, flown as chords after 13000",
        sends: "on download",
        honoured: &[
            ("Time Stamp", HEARD_STAMP),
            ("P1 Waypoint No", "where the leg starts"),
            ("P4 Waypoint No", "where it ends"),
            ("P2 Latitude", "a control point"),
            ("P2 Longitude", "a control point"),
            ("P2 Altitude", "its altitude; absent: the leg climbs evenly"),
            ("P3 Latitude", "a control point"),
            ("P3 Longitude", "a control point"),
            ("P3 Altitude", "its altitude; absent: the leg climbs evenly"),
            ("Altitude Type", "datum of both altitudes"),
        ],
        sent: &[
            ("Time Stamp", STAMP),
            ("P1 Waypoint No", AS_RECEIVED),
            ("P4 Waypoint No", AS_RECEIVED),
            ("P2 Latitude", AS_RECEIVED),
            ("P2 Longitude", AS_RECEIVED),
            ("P2 Altitude", AS_RECEIVED),
            ("P3 Latitude", AS_RECEIVED),
            ("P3 Longitude", AS_RECEIVED),
            ("P3 Altitude", AS_RECEIVED),
            ("Altitude Type", AS_RECEIVED),
            ("Activity ID", AS_RECEIVED),
        ],
    },
];
