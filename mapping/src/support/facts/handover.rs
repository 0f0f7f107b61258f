//! Data links, handover and autonomy: 28000 to 39999.

use crate::support::row::{NULL_LINK, RECEIVED_STAMP, STAMP, facts};

facts! {
    28000 taken "answered by 28001, unless dli.provisional is off; needs LOI 2" {
        "Time Stamp": RECEIVED_STAMP;
        "Control Assignment Request": "1, or any value to the broadcast id, asks which link there is; others are refused: it is the vehicle's only one, and no station controls it";
    }
    28001 sends "in answer to 28000, by 17001, on 17002" {
        "Time Stamp": STAMP;
        "VSM/Vehicle ID": "of the vehicle";
        "Access Authorized": "0";
        "Access Granted": "0";
        "Access Requested": "of 28000";
        "Terminal Type": "0: this end";
        "Data Link Type": "8: MAVLink";
        "Data Link Name": "MAVLink 2";
        "Vehicle Type": "from HEARTBEAT.type, MAVLink's number";
        "Vehicle Subtype": "0";
        "Data Link Control Availability": "1: unavailable";
    }
    32000 sends "by 17001, on 17002" {
        "Time Stamp": STAMP;
        "Communication Vehicle ID - Uplink": "of the vehicle";
        "Uplink Communication State": "1 where the vehicle's frames answer ours (signatures, TIMESYNC), 0 where not for 5 s: no source gives the values";
        "Communication Vehicle ID - Downlink": "of the vehicle";
        "Downlink Communication State": "1 while the vehicle is received, else 0";
    }
    32003 sends "by 17001, on 17002; without transmitter, receiver and antenna: a MAVLink link reports none" {
        "Time Stamp": STAMP;
        "Communication Security State": "as in 32005";
    }
    32005 sends "by 17001, on 17002; without channels and frequencies: a MAVLink link reports none" {
        "Time Stamp": STAMP;
        "Addressed Terminal": "0: this end";
        "Data Link State": "2 both ways, 1 where the vehicle does not answer, 0 where it is silent";
        "Downlink Status": "frames that arrived, by gaps in their numbers";
        "Communication Security State": "2 while frames verify, 1 where they must and do not, 0 where signing is off";
        "Link Channel Priority State": "0: its only one";
    }
    32006 sends "by 17001, on 17002; nothing of the link is commanded by a station" {
        "Time Stamp": STAMP;
        "Addressed Terminal": "0: this end";
        "Reported Demanded Data Link State": "2: both ways, always";
        "Reported Demanded Communication Security Mode": "0: normal, always";
    }
    32200 sends "by 17001, on 17002" {
        "Time Stamp": STAMP;
        "BIT Mode Status": "0 good; 1 over 20 % loss, over 1 s there and back (TIMESYNC), or a weak or full radio (RADIO_STATUS); 2 no data one way, or none that verify: no source gives the values";
    }
    32302 sends "by 17001, on 17002" {
        "Time Stamp": STAMP;
        "Data Link ID": NULL_LINK;
        "In Control CUCS ID": "who holds LOI 4 or 5, or null";
    }
    32400 sends "by 17001, on 17002" {
        "Time Stamp": STAMP;
        "Lost Link Delay Timer Status": "1 while the controlling CUCS is silent, 2 once it counts as lost, else 0: no source gives the values";
        "Current Delay Time": "s until then; while stopped what it would be (authority.act_s)";
    }
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
