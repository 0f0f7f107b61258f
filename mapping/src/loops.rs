//! Loops of a route: a waypoint of Waypoint Type 1 (0802.17) leads back, so often as Limit Type and Loop Limit say.
//!
//! PX4 counts jumps (DO_JUMP param2), the DLI counts how often the loop is flown: one more. Endless is the most that
//! PX4 counts. After the last pass the route ends at the loop's last waypoint. PX4 does not time loops.

use mavlink_link::service::mission::{FRAME_MISSION, Item};
use stanag_msgs::enums::{LimitType, WaypointType};
use stanag_msgs::messages::UaPositionWaypoint;

use crate::route::{CompiledMission, Reason};

/// Whether a waypoint ends a loop.
pub(crate) fn ends(waypoint: &UaPositionWaypoint) -> Result<bool, Reason> {
    match waypoint.waypoint_type {
        None | Some(WaypointType::Normal) => Ok(false),
        Some(WaypointType::EndOfLoop) => Ok(true),
        Some(WaypointType::Unknown(value)) => Err(Reason::UnknownValue {
            field: "Waypoint Type",
            value,
        }),
    }
}

/// The jump back from the end of a loop, `number`, whose own items are in `compiled` already; `None` for a loop that
/// is flown once.
pub(crate) fn jump(
    number: u16,
    waypoint: &UaPositionWaypoint,
    compiled: &CompiledMission,
) -> Result<Option<Item>, Reason> {
    let start = waypoint.next_waypoint.unwrap_or(0);
    let seq = compiled
        .first_item_of(start)
        .filter(|_| start != number)
        .ok_or(Reason::LoopStart(start))?;
    let jumps = match waypoint.limit_type {
        None | Some(LimitType::None) => MAX_JUMPS,
        Some(LimitType::Count) => match waypoint.loop_limit {
            None => return Err(Reason::Missing("Loop Limit")),
            Some(0) => return Err(Reason::LoopLimit),
            Some(times) => times - 1,
        },
        Some(LimitType::Time) => return Err(Reason::LoopTime),
        Some(LimitType::Unknown(value)) => {
            return Err(Reason::UnknownValue {
                field: "Limit Type",
                value,
            });
        }
    };
    Ok((jumps > 0).then(|| Item {
        frame: FRAME_MISSION,
        command: DO_JUMP,
        autocontinue: true,
        params: [f32::from(seq), f32::from(jumps), 0.0, 0.0],
        ..Item::default()
    }))
}

/// MAV_CMD_DO_JUMP.
pub(crate) const DO_JUMP: u16 = 177;
const MAX_JUMPS: u16 = u16::MAX;
