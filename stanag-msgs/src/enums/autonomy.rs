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
    ContingencyCause(u8) = "contingency_cause", A, source "this project",
        description "what is wrong with a vehicle" {
        Battery = 1 "little energy is left";
        Position = 2 "its position is lost";
        Fence = 3 "it has left its fence";
        Engine = 4 "a motor has failed";
    }

    ContingencyAction(u8) = "contingency_action", A, source "this project",
        description "what the VSM flies then" {
        AsConfigured = 0 "what the configuration of the VSM has; none where it has none";
        Hold = 1 "hold";
        Return = 2 "return";
        Landing = 3 "landing";
        ContingencyA = 4 "the route of contingency A";
        ContingencyB = 5 "the route of contingency B";
    }

    ContingencyState(u8) = "contingency_state", A, source "this project",
        description "what has become of a contingency" {
        None = 0 "nothing is flown for this cause";
        Watched = 1 "watched: the vehicle reports what the cause is judged by, and nothing is flown for it now";
        Unreported = 2 "not watched: the vehicle does not report what the cause is judged by";
        Commanded = 3 "the cause is there: its action is being commanded, or waits for who has the vehicle";
        Flown = 4 "the cause is there, and the vehicle has shown the action";
        Ended = 5 "the cause is there, and a pilot or a CUCS has decided otherwise";
    }
}
