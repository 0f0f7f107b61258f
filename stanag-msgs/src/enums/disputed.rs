//! Enumerations whose values no source gives, or only one: the values are this project's own.
//!
//! Each has an entry in [`DISPUTED`](crate::disputed::DISPUTED), by which the configuration can set a peer's values,
//! or has no values at all.

use super::macros::enumerations;

enumerations! {
    HeadingReference(u8) = "heading_reference", NotFound, source "none",
        description "new in Ed3/4; values not found" {
        True = 0 "true";
        Magnetic = 1 "magnetic";
    }

    LoiterLengthUnits(u8) = "loiter_length_units", NotFound, source "none",
        description "13003.02 / 3004.03, new in Ed3/4; values not found" {
        Distance = 0 "distance";
    }

    LoiterDurationUnits(u8) = "loiter_duration_units", NotFound, source "none",
        description "13003.06 / 3004.05, new in Ed3/4; values not found (the Korean text implies time vs turns?)" {
        Seconds = 0 "seconds";
        Turns = 1 "turns";
    }

    FlyingBehaviour(u8) = "flying_behaviour", NotFound, source "none",
        description "13003.01 / 3004.01, new in Ed3/4; values not found" {
    }

    AltitudeChangeBehaviour(u8) = "altitude_change_behaviour", NotFound, source "none",
        description "0802.20 (Ed2 Amd2) / 3004.02; values not found" {
    }

    WaypointType(u8) = "waypoint_type", NotFound, source "none",
        description "0802.17, exists since Ed2 Amd2; values not found" {
        Normal = 0 "normal";
        EndOfLoop = 1 "end of a loop";
    }

    LimitType(u8) = "limit_type", NotFound, source "none",
        description "0802.18 (what Loop Limit counts); values not found" {
        None = 0 "none";
        Count = 1 "count";
        Time = 2 "time";
    }

    PresenceVectorSupport(u8) = "presence_vector_support", NotFound, source "none",
        description "whether the sender supports partial presence vectors; values not found (0/1 assumed)" {
        FullOnly = 0 "full presence vectors only";
        Partial = 1 "partial presence vectors";
    }

    AckType(u8) = "ack_type", NotFound, source "T code",
        description "#17000 Acknowledgement Type 17000.01; only value 1 = received is used by T's code" {
        Received = 1 "received (T)";
        CarriedOut = 2 "carried out";
        Refused = 3 "refused";
    }
}
