//! What a vehicle accepts as an item of a plan, and which parameters of a command it uses.
//!
//! The facts are those of PX4 v1.18's `mavlink_command_params.hpp`, in a form of this project's own. A parameter that
//! PX4 does not use must be NaN or 0 (INT32_MAX for x and y of a global item).

use mavlink::dialects::development::{MavMissionResult, MavMissionType};
use mavlink_link::service::mission::{
    FRAME_GLOBAL, FRAME_GLOBAL_INT, FRAME_GLOBAL_RELATIVE, FRAME_GLOBAL_RELATIVE_INT,
    FRAME_MISSION, Item,
};
use num_traits::FromPrimitive;

/// Why an item is refused, and with it the whole transfer.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum ItemFault {
    /// MAV_MISSION_UNSUPPORTED_FRAME (2).
    Frame,
    /// MAV_MISSION_UNSUPPORTED (3): the command cannot be part of a plan.
    Command,
    /// MAV_MISSION_INVALID_PARAM1 (6) to PARAM7 (12): the parameter, 1 to 7.
    Param(u8),
    /// MAV_MISSION_ERROR (1): an item of another kind of plan, or a fence that encloses nothing.
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

/// The vehicle's verdict on every item that a [`super::mission::Server`] receives.
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
        // Before the command is checked, as in PX4: a bad parameter hides a bad command.
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
        // In a global MISSION_ITEM_INT only INT32_MAX means "not set" for x and y; 0 is a place.
        let zero_is_unset = item.frame == FRAME_MISSION || !int;
        let coordinate_set = |value: i32| value != i32::MAX && !(zero_is_unset && value == 0);
        let [p1, p2, p3, p4] = item.params.map(is_set);
        let (x, y) = (coordinate_set(item.x), coordinate_set(item.y));
        let set = [p1, p2, p3, p4, x, y, is_set(item.z)];
        unused(used, set).map_or(Ok(()), |number| Err(ItemFault::Param(number)))
    }
}

/// Commands that PX4 accepts in a global frame.
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

/// Commands that PX4 accepts in MAV_FRAME_MISSION.
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

/// Kinds of airframe that PX4 distinguishes when it checks parameters.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Airframe {
    /// Multicopter or helicopter.
    RotaryWing,
    /// Aeroplane.
    FixedWing,
    /// Both: hovers and flies on wings.
    Vtol,
    /// Ground or water vehicle.
    Rover,
}

/// The 1-based number of the first parameter that is set although PX4 does not use it for `command`; `None` where
/// there is no such parameter, or PX4 has no entry for the command.
///
/// `params` are param1 to param7; a parameter that is absent is given as NaN. `in_mission`
/// chooses between mission items and COMMAND_LONG / COMMAND_INT, whose tables differ.
pub fn first_unused_param_set(
    command: u16,
    in_mission: bool,
    airframe: Airframe,
    params: [f32; 7],
) -> Option<u8> {
    let used = used_params(command, in_mission, airframe)?;
    unused(used, params.map(is_set))
}

fn is_set(value: f32) -> bool {
    !value.is_nan() && value != 0.0
}

/// The number of the first parameter that is set and not used.
fn unused(used: u8, set: [bool; 7]) -> Option<u8> {
    let mut numbers = (1u8..).zip(set);
    let (number, _) = numbers.find(|&(number, set)| set && used >> (number - 1) & 1 == 0)?;
    Some(number)
}

/// Bit n-1 is set when param n is used; `None` for a command that PX4 does not check.
fn used_params(command: u16, in_mission: bool, airframe: Airframe) -> Option<u8> {
    let index = USED.binary_search_by_key(&command, |entry| entry.0).ok()?;
    let (_, mission, alone) = USED[index];
    let mut used = if in_mission { mission } else { alone };
    // NAV_TAKEOFF.param1, the pitch, has a meaning on wings only.
    if command == 22 && matches!(airframe, Airframe::FixedWing | Airframe::Vtol) {
        used |= P1;
    }
    Some(used)
}

// Sets of used parameters, bit n-1 for param n.
const NONE: u8 = 0;
const P1: u8 = 0b000_0001;
const P12: u8 = 0b000_0011;
const P123: u8 = 0b000_0111;
const P1234: u8 = 0b000_1111;
const XY: u8 = 0b011_0000;
const XYZ: u8 = 0b111_0000;
const YAW: u8 = 0b000_1000;
const P3: u8 = 0b000_0100;

/// (MAV_CMD, used as a mission item, used as a command), in rising order.
const USED: [(u16, u8, u8); 46] = [
    (16, P12 | YAW | XYZ, P12 | YAW | XYZ), // NAV_WAYPOINT
    (17, P3 | YAW | XYZ, P3 | YAW | XYZ),   // NAV_LOITER_UNLIM
    (19, P1234 | XYZ, P1234 | XYZ),         // NAV_LOITER_TIME
    (20, NONE, NONE),                       // NAV_RETURN_TO_LAUNCH
    (21, P12 | YAW | XYZ, P12 | YAW | XYZ), // NAV_LAND
    (22, YAW | XYZ, YAW | XYZ),             // NAV_TAKEOFF
    (31, P12 | YAW | XYZ, P12 | YAW | XYZ), // NAV_LOITER_TO_ALT
    (80, P123 | XYZ, P123 | XYZ),           // NAV_ROI
    (84, YAW | XYZ, P3 | YAW | XYZ),        // NAV_VTOL_TAKEOFF
    (85, YAW | XYZ, P1234 | XYZ),           // NAV_VTOL_LAND
    (93, P1234, P1234),                     // NAV_DELAY
    (112, P1, P1),                          // CONDITION_DELAY
    (114, P1, P1),                          // CONDITION_DISTANCE
    (176, P123, P123),                      // DO_SET_MODE
    (177, P12, P12),                        // DO_JUMP
    (178, P123, P123),                      // DO_CHANGE_SPEED
    (179, P1234 | XYZ, P1234 | XYZ),        // DO_SET_HOME
    (189, NONE, NONE),                      // DO_LAND_START
    (195, XYZ, P1 | XYZ),                   // DO_SET_ROI_LOCATION
    (196, P1, P1),                          // DO_SET_ROI_WPNEXT_OFFSET
    (197, P1, P1),                          // DO_SET_ROI_NONE
    (201, P123, P123),                      // DO_SET_ROI
    (206, P1234, P1234),                    // DO_SET_CAM_TRIGG_DIST
    (211, P12, P12),                        // DO_GRIPPER
    (212, P12, P12),                        // DO_AUTOTUNE_ENABLE
    (214, P123, P123),                      // DO_SET_CAM_TRIGG_INTERVAL
    (400, P12, P12),                        // COMPONENT_ARM_DISARM
    (420, P123, P123),                      // INJECT_FAILURE
    (530, P12, P12),                        // SET_CAMERA_MODE
    (532, P123, P123),                      // SET_CAMERA_FOCUS
    (534, P123, P123),                      // SET_CAMERA_SOURCE
    (611, NONE, XYZ),                       // DO_SET_GLOBAL_ORIGIN
    (2000, P1234, P1234),                   // IMAGE_START_CAPTURE
    (2001, P1, P1),                         // IMAGE_STOP_CAPTURE
    (2003, P1234, P1234),                   // DO_TRIGGER_CONTROL
    (2500, P123, P123),                     // VIDEO_START_CAPTURE
    (2501, P12, P12),                       // VIDEO_STOP_CAPTURE
    (3000, P12, P12),                       // DO_VTOL_TRANSITION
    (4501, NONE, NONE),                     // CONDITION_GATE
    (5000, XYZ, NONE),                      // NAV_FENCE_RETURN_POINT
    (5001, P1 | XY, P1),                    // NAV_FENCE_POLYGON_VERTEX_INCLUSION
    (5002, P1 | XY, P1),                    // NAV_FENCE_POLYGON_VERTEX_EXCLUSION
    (5003, P1 | XY, P1),                    // NAV_FENCE_CIRCLE_INCLUSION
    (5004, P1 | XY, P1),                    // NAV_FENCE_CIRCLE_EXCLUSION
    (5100, XYZ, NONE),                      // NAV_RALLY_POINT
    (42600, P1234, P1234),                  // DO_WINCH
];

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

    const UNSET: [f32; 7] = [f32::NAN; 7];

    #[test]
    fn the_table_is_sorted() {
        assert!(USED.windows(2).all(|pair| pair[0].0 < pair[1].0));
    }

    #[test]
    fn takeoff_pitch_is_refused_on_a_multicopter_only() {
        let mut params = UNSET;
        params[0] = 15.0;
        assert_eq!(
            first_unused_param_set(22, false, Airframe::RotaryWing, params),
            Some(1)
        );
        assert_eq!(
            first_unused_param_set(22, false, Airframe::FixedWing, params),
            None
        );
    }

    #[test]
    fn arming_with_a_seventh_parameter_is_refused_and_zero_is_not() {
        let mut params = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0];
        assert_eq!(
            first_unused_param_set(400, false, Airframe::RotaryWing, params),
            Some(7)
        );
        params[6] = -0.0;
        assert_eq!(
            first_unused_param_set(400, false, Airframe::RotaryWing, params),
            None
        );
    }

    #[test]
    fn an_unlisted_command_is_not_checked() {
        assert_eq!(
            first_unused_param_set(511, false, Airframe::Rover, [9.0; 7]),
            None
        );
    }
}
