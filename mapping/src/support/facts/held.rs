//! Private messages: commands that are held until a condition (50020 to 50022), and contingencies (50023).

use crate::support::row::{STAMP, facts};

facts! {
    50020 taken "the command in it is held, and carried out when its condition is met, as one that arrives then; reported by 50022; needs the right that the command needs, then too" {
        "Time Stamp": "what Condition Time and Valid For are counted from, and returned in 17000";
        "Held Command Number": "1 to 65535; refused while one of its CUCS with this number waits";
        "Held Message Type": "which command; refused where its data are none of this type; 2005, 2010 and what needs LOI 2 or no right cannot be held";
        "Held Message Data": "the command; refused where it cannot be read";
        "Hold Condition": "1 to 7";
        "Hold Kind": "1: kept while nobody controls the vehicle; else cancelled with the control of its CUCS";
        "Valid For": "expires then; 1 to 86400 s, refused where Condition Time is later";
        "Condition Time": "carried out then";
        "Condition Number": "a waypoint that the vehicle has been at (4001), an area, a held command; refused where there is no such area or command";
        "Condition Percent": "SYS_STATUS.battery_remaining is below it for 1.5 s";
        "Condition Latitude": "of a circle that GLOBAL_POSITION_INT enters or leaves";
        "Condition Longitude": "of a circle that GLOBAL_POSITION_INT enters or leaves";
        "Condition Radius": "of a circle; refused without its centre";
    }
    50021 taken "cancels held commands; needs LOI 2 for those of its sender, control of the vehicle for those of another" {
        "Time Stamp": "identifies a duplicate, and is returned in 17000";
        "Held Command Number": "which; refused where none waits; absent or 0: all";
        "Owner ID": "whose, refused where none waits; absent: its sender's";
    }
    50022 sends "when a held command is given, carried out or ended, to all that listen; in answer to 17002" {
        "Time Stamp": STAMP;
        "Owner ID": "who has given the 50020";
        "Held Command Number": "of the 50020";
        "Held Message Type": "of the 50020";
        "Hold Condition": "of the 50020";
        "Hold Kind": "of the 50020";
        "Held State": "carried out once the vehicle shows it, as 17000 of the command itself";
        "Reason": "of a refusal, an expiry or a cancellation";
    }
    50023 taken "sets what is flown for a cause, over the configuration, until the next 50023: stored, and reported by 50023 to all that listen; refused unless the vehicle reports that it is on the ground; needs LOI 4" {
        "Time Stamp": "identifies a duplicate, and is returned in 17000";
        "Contingency Cause": "1 to 4; refused where it is missing";
        "Contingency Action": "0: as the configuration has it, 1 to 5; refused for cause 2 unless 0 or 3, which needs no position";
        "Contingency Percent": "of cause 1: 1 to 90; absent: as the configuration has it; refused with another cause or with action 0";
    } sends "once it has changed, to all that listen; one of each cause in answer to 17002" {
        "Time Stamp": STAMP;
        "Contingency Cause": "each";
        "Contingency Action": "what is flown: of the last 50023, else of the configuration; 0 where there is none";
        "Contingency Percent": "of cause 1: below which it is flown";
        "Contingency State": "by what the vehicle reports, and what it has shown";
    }
}
