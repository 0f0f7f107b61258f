//! What a vehicle accepts as an item of a plan.

use mavlink::dialects::development::{MavMissionResult, MavMissionType};
use num_traits::FromPrimitive;

use super::item::{
    FRAME_GLOBAL, FRAME_GLOBAL_INT, FRAME_GLOBAL_RELATIVE, FRAME_GLOBAL_RELATIVE_INT,
    FRAME_MISSION, Item,
};
use super::param_table::{Airframe, used_params};

/// Why an item is refused, and with it the whole transfer.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ItemFault {
    /// MAV_MISSION_UNSUPPORTED_FRAME (2).
    Frame,
    /// MAV_MISSION_UNSUPPORTED (3): the command cannot be part of a plan.
    Command,
    /// MAV_MISSION_INVALID_PARAM1 (6) to PARAM7 (12): the parameter, 1 to 7.
    Param(u8),
    /// MAV_MISSION_ERROR (1): of the wrong kind of plan, or a fence that encloses nothing.
    Other,
}

impl ItemFault {
    /// MISSION_ACK.type for this fault.
    pub fn result(self) -> MavMissionResult {
        match self {
            Self::Frame => MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME,
            Self::Command => MavMissionResult::MAV_MISSION_UNSUPPORTED,
            Self::Param(number) => MavMissionResult::from_u8(5 + number.clamp(1, 7))
                .unwrap_or(MavMissionResult::MAV_MISSION_INVALID),
            Self::Other => MavMissionResult::MAV_MISSION_ERROR,
        }
    }
}

/// The vehicle's say on every item that a [`super::Server`] receives.
pub trait ItemRules {
    /// Accepts or refuses `item` of a plan of `kind`; `int` is false for a MISSION_ITEM (39).
    fn check(&self, kind: MavMissionType, item: &Item, int: bool) -> Result<(), ItemFault>;
}

/// PX4 v1.18's own rules, as its `mavlink_mission.cpp` applies them.
#[derive(Clone, Copy, Debug)]
pub struct Px4Rules {
    /// Decides which parameters the vehicle uses.
    pub airframe: Airframe,
}

impl ItemRules for Px4Rules {
    fn check(&self, kind: MavMissionType, item: &Item, int: bool) -> Result<(), ItemFault> {
        match item.frame {
            FRAME_GLOBAL | FRAME_GLOBAL_RELATIVE => {}
            FRAME_GLOBAL_INT | FRAME_GLOBAL_RELATIVE_INT if int => {}
            FRAME_MISSION => {}
            _ => return Err(ItemFault::Frame),
        }
        // Before the command is looked at, as PX4 does: a bad parameter hides a bad command.
        self.check_unused(item, int)?;
        if item.frame == FRAME_MISSION {
            check_without_position(item)?;
        } else {
            check_with_position(item)?;
        }
        check_kind(kind, item)
    }
}

impl Px4Rules {
    fn check_unused(&self, item: &Item, int: bool) -> Result<(), ItemFault> {
        let Some(used) = used_params(item.command, true, self.airframe) else {
            return Ok(());
        };
        // In a global MISSION_ITEM_INT only INT32_MAX is "not set" for x and y; 0 is a place.
        let zero_is_unset = item.frame == FRAME_MISSION || !int;
        let coordinate_set = |value: i32| value != i32::MAX && !(zero_is_unset && value == 0);
        let float_set = |value: f32| !value.is_nan() && value != 0.0;
        let [p1, p2, p3, p4] = item.params;
        let set = [
            float_set(p1),
            float_set(p2),
            float_set(p3),
            float_set(p4),
            coordinate_set(item.x),
            coordinate_set(item.y),
            float_set(item.z),
        ];
        for (number, set) in (1u8..).zip(set) {
            if set && used >> (number - 1) & 1 == 0 {
                return Err(ItemFault::Param(number));
            }
        }
        Ok(())
    }
}

/// Commands that PX4 takes in a global frame.
fn check_with_position(item: &Item) -> Result<(), ItemFault> {
    match item.command {
        16 | 17 | 19 | 21 | 22 | 31 | 84 | 85 | 195 | 212 | 400 | 4501 => Ok(()),
        5000..=5004 | 5100 => Ok(()),
        // A region of interest is a place or nothing: MAV_ROI_LOCATION 3, MAV_ROI_NONE 0.
        80 | 201 if matches!(item.params[0] as i32, 0 | 3) => Ok(()),
        80 | 201 => Err(ItemFault::Param(1)),
        _ => Err(ItemFault::Command),
    }
}

/// Commands that PX4 takes in MAV_FRAME_MISSION.
fn check_without_position(item: &Item) -> Result<(), ItemFault> {
    match item.command {
        20
        | 93
        | 112
        | 177..=179
        | 187
        | 189
        | 196
        | 197
        | 200
        | 203..=206
        | 211
        | 212
        | 214
        | 260
        | 400
        | 530
        | 532
        | 534
        | 1000
        | 1001
        | 2000
        | 2001
        | 2003
        | 2500
        | 2501
        | 3000
        | 42600 => Ok(()),
        // MAV_ROI_NONE 0, WPNEXT 1, WPINDEX 2.
        80 | 201 if matches!(item.params[0] as i32, 0..=2) => Ok(()),
        80 | 201 => Err(ItemFault::Param(1)),
        _ => Err(ItemFault::Command),
    }
}

fn check_kind(kind: MavMissionType, item: &Item) -> Result<(), ItemFault> {
    let foreign = match kind {
        MavMissionType::MAV_MISSION_TYPE_MISSION => matches!(item.command, 5001..=5004 | 5100),
        // A polygon of fewer than three vertices encloses nothing.
        MavMissionType::MAV_MISSION_TYPE_FENCE => {
            matches!(item.command, 5001 | 5002) && item.params[0] + 0.5 < 3.0
        }
        _ => false,
    };
    if foreign {
        Err(ItemFault::Other)
    } else {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RULES: Px4Rules = Px4Rules {
        airframe: Airframe::RotaryWing,
    };
    const MISSION: MavMissionType = MavMissionType::MAV_MISSION_TYPE_MISSION;

    fn item(frame: u8, command: u16) -> Item {
        Item {
            frame,
            command,
            autocontinue: true,
            x: 473_977_418,
            y: 85_455_938,
            z: 10.0,
            ..Item::default()
        }
    }

    fn code(item: &Item) -> u32 {
        match RULES.check(MISSION, item, true) {
            Ok(()) => 0,
            Err(fault) => fault.result() as u32,
        }
    }

    #[test]
    fn faults_have_the_codes_seen_on_the_wire() {
        assert_eq!(code(&item(6, 16)), 0);
        assert_eq!(code(&item(1, 16)), 2);
        assert_eq!(code(&item(11, 16)), 2);
        assert_eq!(code(&item(6, 18)), 3);
        assert_eq!(code(&item(6, 82)), 3);
        assert_eq!(code(&item(6, 5001)), 12);
        for number in 1..=7 {
            assert_eq!(
                ItemFault::Param(number).result() as u32,
                5 + u32::from(number)
            );
        }
        let mut takeoff = item(6, 22);
        takeoff.params[0] = 15.0;
        assert_eq!(code(&takeoff), 6);
    }

    #[test]
    fn the_int_frames_are_for_int_items_only() {
        assert_eq!(
            RULES.check(MISSION, &item(6, 16), false),
            Err(ItemFault::Frame)
        );
        assert_eq!(RULES.check(MISSION, &item(3, 16), false), Ok(()));
    }

    #[test]
    fn a_fence_is_no_mission_and_needs_three_vertices() {
        let mut vertex = item(3, 5001);
        vertex.z = 0.0;
        vertex.params[0] = 2.0;
        assert_eq!(RULES.check(MISSION, &vertex, true), Err(ItemFault::Other));
        let fence = MavMissionType::MAV_MISSION_TYPE_FENCE;
        assert_eq!(RULES.check(fence, &vertex, true), Err(ItemFault::Other));
        vertex.params[0] = 3.0;
        assert_eq!(RULES.check(fence, &vertex, true), Ok(()));
    }

    #[test]
    fn what_is_no_position_is_refused_as_one() {
        let mut jump = item(FRAME_MISSION, 177);
        assert_eq!(RULES.check(MISSION, &jump, true), Err(ItemFault::Param(5)));
        (jump.x, jump.y, jump.z) = (0, i32::MAX, f32::NAN);
        assert_eq!(RULES.check(MISSION, &jump, true), Ok(()));
    }
}
