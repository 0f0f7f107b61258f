//! Which parameters of a command PX4 v1.18 uses; a value in any other is refused.
//!
//! Facts of PX4 v1.18 `mavlink_command_params.hpp`, in this page's own form. A parameter that
//! PX4 does not use must be NaN or 0 (INT32_MAX for x and y of a global item).

/// Kinds of airframe that PX4 tells apart when it checks parameters.
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

/// The 1-based number of the first parameter that is set though PX4 does not use it for
/// `command`, or `None` when all is well or PX4 has no entry for the command.
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
    params
        .iter()
        .zip(1u8..)
        .find(|&(&value, number)| {
            let is_used = used >> (number - 1) & 1 == 1;
            !is_used && !value.is_nan() && value != 0.0
        })
        .map(|(_, number)| number)
}

/// Bit n-1 is set when param n is used; `None` for a command that PX4 does not check.
pub(super) fn used_params(command: u16, in_mission: bool, airframe: Airframe) -> Option<u8> {
    let index = USED.binary_search_by_key(&command, |entry| entry.0).ok()?;
    let (_, mission, alone) = USED[index];
    let mut used = if in_mission { mission } else { alone };
    // NAV_TAKEOFF.param1, the pitch, means something on wings only.
    if command == 22 && matches!(airframe, Airframe::FixedWing | Airframe::Vtol) {
        used |= P1;
    }
    Some(used)
}

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
