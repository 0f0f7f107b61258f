//! Private messages of this project: commands that are held until a condition is met (50020 to 50022), and
//! contingencies (50023).

use std::f64::consts::FRAC_PI_2;

use super::codec::messages;
use crate::enums::{
    ContingencyAction, ContingencyCause, ContingencyState, HeldState, HoldCondition, HoldKind,
};
use crate::id::Id;
use crate::scalar::{Bam32, Text, TimeStamp};

messages! {
    HoldCommand = 50020, "Hold Command", presence bytes 2
        sent(ToVsm, Push) own_definition() latency_ms(1000)
        note("another command, carried out once its condition is met; 50022 reports what becomes of it")
    {
        time_stamp: TimeStamp = 0, "Time Stamp", note("what Condition Time and Valid For are counted from");
        held_command_number: u16 = 1, "Held Command Number", note("from 1, chosen by the CUCS");
        held_message_type: u16 = 2, "Held Message Type", note("of the command, such as 2016");
        held_message_data: Text<257> = 3, "Held Message Data",
            note("data of the command as on the wire: presence vector and fields, hexadecimal");
        hold_condition: HoldCondition = 4, "Hold Condition";
        hold_kind: HoldKind = 5, "Hold Kind", note("absent: 0");
        valid_for: u32 = 6, "Valid For", unit("s"), note("1 to 86400; not carried out after that");
        condition_time: TimeStamp = 7, "Condition Time", note("of condition 1");
        condition_number: u16 = 8, "Condition Number",
            note("waypoint of condition 2, area (50016) of 3 and 4 where no circle is given, held command of 7");
        condition_percent: u8 = 9, "Condition Percent", unit("%"), note("of condition 5, 1 to 100");
        condition_latitude: Bam32 = 10, "Condition Latitude", range(-FRAC_PI_2, FRAC_PI_2), note("centre of a circle, of conditions 3 and 4");
        condition_longitude: Bam32 = 11, "Condition Longitude", note("centre of a circle, of conditions 3 and 4");
        condition_radius: f32 = 12, "Condition Radius", unit("m"), note("of a circle, of conditions 3 and 4");
    }

    HeldCommandCancel = 50021, "Held Command Cancel", presence bytes 1
        sent(ToVsm, Push) own_definition() latency_ms(1000)
        note("those of another CUCS only by the one that controls the vehicle")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        held_command_number: u16 = 1, "Held Command Number", note("absent or 0: all of its owner");
        owner_id: Id = 2, "Owner ID", note("the CUCS that gave it; absent: the sender");
    }

    HeldCommandState = 50022, "Held Command State", presence bytes 1
        sent(ToCucs, PushPull) own_definition() latency_ms(2000)
        note("on a change, and requested by 17002: one for each command that is held or has ended lately")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        owner_id: Id = 1, "Owner ID", note("the CUCS that gave it");
        held_command_number: u16 = 2, "Held Command Number";
        held_message_type: u16 = 3, "Held Message Type";
        hold_condition: HoldCondition = 4, "Hold Condition";
        hold_kind: HoldKind = 5, "Hold Kind";
        held_state: HeldState = 6, "Held State";
        reason: Text<80> = 7, "Reason", note("why it was refused or cancelled");
    }

    Contingency = 50023, "Contingency", presence bytes 1
        sent(Both, PushPull) own_definition() latency_ms(1000)
        note("provisional id; what the VSM flies for one cause: set by a CUCS before the flight; on a change, and one of each cause by 17002")
    {
        time_stamp: TimeStamp = 0, "Time Stamp";
        contingency_cause: ContingencyCause = 1, "Contingency Cause";
        contingency_action: ContingencyAction = 2, "Contingency Action";
        contingency_percent: u8 = 3, "Contingency Percent", unit("%"), note("of cause 1: less energy than this, 1 to 90");
        contingency_state: ContingencyState = 4, "Contingency State", note("reported");
    }
}
