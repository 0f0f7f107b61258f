//! Handover and autonomy: 34000 to 39999.

use crate::support::row::{NULL_LINK, RECEIVED_STAMP, STAMP, facts};

facts! {
    34000 taken "dli.provisional = all: control is handed over or requested; else refused" {
        "Time Stamp": RECEIVED_STAMP;
        "Acquiring CUCS ID": "who acquires; needed";
        "Set Forward Link Carrier Frequency (ADT)": "0; others are refused";
        "Set Return Link Carrier Frequency (ADT)": "0; others are refused";
        "Set PN Code (ADT)": "0; others are refused";
    }
    35000 sends "when a handover begins or ends, and on 17002, unless dli.provisional is off" {
        "Time Stamp": STAMP;
        "CUCS ID (relinquishing control)": "the holder, or null";
        "CUCS ID (acquiring control)": "the successor, or null";
        "Status": "how far it is";
        "Air Data Link ID": NULL_LINK;
    }
}
