//! Commands of the flight vehicle: 2000 to 2999.

use super::HEARD_STAMP;
use crate::support::MessageSupport;

pub(super) static ROWS: &[MessageSupport] = &[
    MessageSupport {
        id: 2008,
        taken: "arms and disarms, which all motors do together; needs LOI 5",
        sends: "",
        honoured: &[
            ("Time Stamp", HEARD_STAMP),
            ("Engine Number", "refused above the number that there are"),
            ("Engine Command", "0 stops (disarms), 1 and 2 start (arm)"),
            ("Reverse Thrust Power", "1 is refused"),
            ("Reverse Thrust", "0 and 3; others are refused"),
            ("Ignition Switch Power", "1 is refused"),
            ("Ignition Switch Activation", "1 is refused"),
        ],
        sent: &[],
    },
    MessageSupport {
        id: 2010,
        taken: "sticks for mode 2, sent on as MANUAL_CONTROL",
        sends: "",
        honoured: &[
            ("Time Stamp", "one that has been overtaken changes nothing"),
            ("Lateral Stick", "y"),
            ("Longitudinal Stick", "x"),
            ("Rotational Stick (Rudder)", "r"),
            ("Throttle Stick - Engine 1", "z; half where absent"),
        ],
        sent: &[],
    },
    MessageSupport {
        id: 2016,
        taken: "a mode, and what goes with it; answered by what the vehicle then does",
        sends: "",
        honoured: &[
            ("Time Stamp", HEARD_STAMP),
            (
                "Select Flight Path Control Mode",
                "2, 11, 12, 15, 19, 20 while it lands, 21, 23, 24; others are refused; absent or 0: the present mode",
            ),
            (
                "Altitude Command Type",
                "1 altitude, 0 none: the altitude is not flown; 2 and 3 in 15, elsewhere refused",
            ),
            (
                "Commanded Altitude",
                "12, 15: flown to; 21: taken off to; refused in 11",
            ),
            (
                "Commanded Vertical Speed",
                "15: flown, or the limit of the way to an altitude; elsewhere 16000 says that it is not heeded",
            ),
            (
                "Heading Command Type",
                "15: 1 heading, 2 course, 3 both, 5 turn rate; 4 is refused; elsewhere 0 alone",
            ),
            ("Heading Reference", "15: 0 true; magnetic is refused"),
            ("Commanded Heading", "15: where the nose points"),
            ("Commanded Course", "15: where it flies"),
            ("Commanded Turn Rate", "15: how fast it turns"),
            (
                "Commanded Speed",
                "DO_CHANGE_SPEED in 11 and 12 (a multicopter's circle: DO_ORBIT), flown in 15; refused beyond the range that 41003 tells; 0: none",
            ),
            (
                "Speed Type",
                "0, 1 and 2 alike: over ground by a multicopter, through the air by a fixed wing; others are refused",
            ),
            (
                "Commanded Waypoint Number",
                "11, and routes flown by 19, 23, 24: the flight starts at it; 0: none; elsewhere 16000 says that it is not heeded",
            ),
            (
                "Altimeter Setting",
                "of pressure altitudes, from now on; 0: none",
            ),
            (
                "Altitude Type",
                "datum of the altitude: 0 and 1 by the altimeter setting, 2 above home, 3 ellipsoid",
            ),
            ("Loiter Position Latitude", "12: flown to; 0, 0: none"),
            ("Loiter Position Longitude", "12: flown to; 0, 0: none"),
        ],
        sent: &[],
    },
    MessageSupport {
        id: 2017,
        taken: "kept, field by field, for the loiters that 2016 commands",
        sends: "",
        honoured: &[
            ("Time Stamp", HEARD_STAMP),
            (
                "Loiter Type",
                "4 hover (not of a fixed wing), 1 circle; others are refused",
            ),
            (
                "Loiter Radius",
                "of the circle; 0: none; above 1000 m it is refused",
            ),
            (
                "Loiter Direction",
                "2 counter-clockwise, 0 and 1 clockwise; others are refused",
            ),
        ],
        sent: &[],
    },
];
