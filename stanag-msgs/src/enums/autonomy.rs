//! Values of held commands, which are private messages of this project.

use super::macros::enumerations;

enumerations! {
    HoldCondition(u8) = "hold_condition", A, source "this project",
        description "what a held command waits for" {
        Time = 1 "a time";
        WaypointPassed = 2 "a waypoint has been passed";
        AreaEntered = 3 "an area is entered, from outside";
        AreaLeft = 4 "an area is left, from inside";
        BatteryBelow = 5 "less energy is left than this";
        LinkLost = 6 "the CUCS that gave it is lost";
        CommandDone = 7 "another held command of its CUCS is carried out";
    }

    HoldKind(u8) = "hold_kind", A, source "this project",
        description "what the loss of control means for a held command" {
        Command = 0 "cancelled with it";
        Contingency = 1 "kept while nobody controls the vehicle";
    }

    HeldState(u8) = "held_state", A, source "this project",
        description "what has become of a held command" {
        Waiting = 1 "waits for its condition";
        BeingCarriedOut = 2 "is being carried out";
        CarriedOut = 3 "carried out";
        Refused = 4 "refused when it was to be carried out";
        Expired = 5 "expired";
        Cancelled = 6 "cancelled";
    }
}
