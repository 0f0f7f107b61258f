//! Whether a plan read back is the plan that was sent.
//!
//! PX4 does not keep items as it received them: it stores the fields that its navigator uses
//! and builds the item from them on download. [`px4_read_back`] is that round trip, from PX4 v1.18's
//! `parse_mavlink_mission_item` and `format_mavlink_mission_item`; [`verify`] compares with it.
//!
//! What PX4 returns differently:
//! - frames 0 and 3 as their INT synonyms 5 and 6; every fence point as 5;
//! - in a global frame all parameters that the command does not use as 0;
//! - yaw (param4) in 0..360 degrees after a trip through radians; NaN stays NaN;
//! - the flags of NAV_LOITER_TIME (param2, param4) and NAV_LOITER_TO_ALT (param1, param4) as
//!   0 or 1, precision of NAV_LAND, DO_JUMP numbers and vertex counts as integers;
//! - CONDITION_DELAY as NAV_DELAY, NAV_ROI as DO_SET_ROI;
//! - x and y of MAV_FRAME_MISSION through a float, exact to 2^24 only;
//! - `current` as the vehicle's own progress: it is not compared.

use mavlink::dialects::development::MavMissionType;

use super::item::{
    FRAME_GLOBAL, FRAME_GLOBAL_INT, FRAME_GLOBAL_RELATIVE, FRAME_GLOBAL_RELATIVE_INT,
    FRAME_MISSION, Item, same_bits,
};

/// Yaw may differ by this much, in degrees: a float's trip to radians and back.
const YAW_TOLERANCE_DEG: f32 = 1e-3;

/// A field of an item, as MISSION_ITEM_INT names it.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Field {
    /// MISSION_ITEM_INT.frame
    Frame,
    /// MISSION_ITEM_INT.command
    Command,
    /// MISSION_ITEM_INT.autocontinue
    Autocontinue,
    /// MISSION_ITEM_INT.param1 to param4, by number
    Param(u8),
    /// MISSION_ITEM_INT.x
    X,
    /// MISSION_ITEM_INT.y
    Y,
    /// MISSION_ITEM_INT.z
    Z,
}

/// The first difference between the stored plan and the plan that was sent.
#[derive(Clone, Copy, PartialEq, Debug, thiserror::Error)]
pub enum Difference {
    /// Another number of items.
    #[error("{read} items stored, expected the {sent} that were sent")]
    Count {
        /// Items sent.
        sent: usize,
        /// Items read back.
        read: usize,
    },
    /// One field of one item.
    #[error("item {seq}: {field:?} is {read} on the vehicle, expected {expected}")]
    Item {
        /// Place of the item in the plan, from 0.
        seq: usize,
        /// The field.
        field: Field,
        /// What the vehicle should have returned.
        expected: f64,
        /// What it returned.
        read: f64,
    },
}

/// Compares a plan read back with what was sent.
///
/// A vehicle that keeps the parameters which PX4 drops, or returns frames 0 and 3 where PX4
/// returns 5 and 6, passes too.
///
/// # Errors
/// The first difference.
pub fn verify(kind: MavMissionType, sent: &[Item], read: &[Item]) -> Result<(), Difference> {
    for (seq, (sent, read)) in sent.iter().zip(read).enumerate() {
        let expected = px4_read_back(kind, sent);
        compare(seq, sent, &expected, read)?;
    }
    if sent.len() == read.len() {
        Ok(())
    } else {
        Err(Difference::Count {
            sent: sent.len(),
            read: read.len(),
        })
    }
}

/// The item that PX4 v1.18 returns by MISSION_ITEM_INT for an item that it accepted.
pub fn px4_read_back(kind: MavMissionType, sent: &Item) -> Item {
    let mut back = *sent;
    back.command = match sent.command {
        // CONDITION_DELAY and NAV_DELAY, NAV_ROI and DO_SET_ROI: PX4 stores each pair as one command.
        112 => 93,
        80 => 201,
        command => command,
    };
    if sent.frame == FRAME_MISSION {
        read_back_without_position(&mut back);
        return back;
    }
    let fence = kind == MavMissionType::MAV_MISSION_TYPE_FENCE;
    back.frame = match sent.frame {
        // PX4's store for fence points has no field for "relative".
        FRAME_GLOBAL_RELATIVE | FRAME_GLOBAL_RELATIVE_INT if !fence => FRAME_GLOBAL_RELATIVE_INT,
        _ => FRAME_GLOBAL_INT,
    };
    // Nor does it have one for autocontinue.
    back.autocontinue &= !fence;
    let [p1, p2, p3, p4] = sent.params;
    back.params = match sent.command {
        16 => [p1, p2, 0.0, wrap_360(p4)],
        17 => [0.0, 0.0, p3, wrap_360(p4)],
        19 => [p1, flag(p2), p3, flag(p4)],
        21 => [p1, whole(p2), 0.0, wrap_360(p4)],
        // NAV_LOITER_TIME and NAV_LOITER_TO_ALT keep these parameters as flags of one bit.
        22 | 84 | 85 => [0.0, 0.0, 0.0, wrap_360(p4)],
        31 => [flag(p1), p2, 0.0, flag(p4)],
        // Fence vertex counts are stored as integers; PX4 rounds by adding a half.
        5001 | 5002 => [whole(p1 + 0.5), 0.0, 0.0, 0.0],
        5003 | 5004 => [p1, 0.0, 0.0, 0.0],
        _ => [0.0; 4],
    };
    back
}

fn read_back_without_position(back: &mut Item) {
    // PX4 keeps the parameters of items without a position as an array of floats.
    back.x = back.x as f32 as i32;
    back.y = back.y as f32 as i32;
    match back.command {
        // DO_JUMP's target and count have integer fields of their own.
        177 => {
            back.params[0] = f32::from(back.params[0] as i16);
            back.params[1] = whole(back.params[1]);
        }
        400 => back.params[0] = whole(back.params[0]),
        212 => {
            back.params[0] = whole(back.params[0]);
            back.params[1] = whole(back.params[1]);
        }
        _ => {}
    }
}

fn compare(seq: usize, sent: &Item, expected: &Item, read: &Item) -> Result<(), Difference> {
    let differs = |field, expected: f64, read: f64| Difference::Item {
        seq,
        field,
        expected,
        read,
    };
    // An autopilot that returns what it received is right too, so each field may match either value.
    if int_frame(expected.frame) != int_frame(read.frame)
        && int_frame(sent.frame) != int_frame(read.frame)
    {
        let (expected, read) = (expected.frame.into(), read.frame.into());
        return Err(differs(Field::Frame, expected, read));
    }
    if expected.command != read.command && sent.command != read.command {
        let (expected, read) = (expected.command.into(), read.command.into());
        return Err(differs(Field::Command, expected, read));
    }
    if expected.autocontinue != read.autocontinue && sent.autocontinue != read.autocontinue {
        let (expected, read) = (expected.autocontinue, read.autocontinue);
        return Err(differs(
            Field::Autocontinue,
            u8::from(expected).into(),
            u8::from(read).into(),
        ));
    }
    let yaw_last = matches!(sent.command, 16 | 17 | 21 | 22 | 84 | 85) && sent.is_global();
    for (index, number) in (1u8..=4).enumerate() {
        let (want, kept, got) = (
            expected.params[index],
            // The yaw of these commands comes back after a trip through radians, so it may wrap or lose its last bits.
            sent.params[index],
            read.params[index],
        );
        let same = same_value(want, got)
            || same_value(kept, got)
            || (number == 4 && yaw_last && same_yaw(want, got));
        if !same {
            return Err(differs(Field::Param(number), want.into(), got.into()));
        }
    }
    if expected.x != read.x && sent.x != read.x {
        return Err(differs(Field::X, expected.x.into(), read.x.into()));
    }
    if expected.y != read.y && sent.y != read.y {
        return Err(differs(Field::Y, expected.y.into(), read.y.into()));
    }
    if !same_value(expected.z, read.z) {
        return Err(differs(Field::Z, expected.z.into(), read.z.into()));
    }
    Ok(())
}

fn int_frame(frame: u8) -> u8 {
    match frame {
        FRAME_GLOBAL => FRAME_GLOBAL_INT,
        FRAME_GLOBAL_RELATIVE => FRAME_GLOBAL_RELATIVE_INT,
        frame => frame,
    }
}

fn same_value(a: f32, b: f32) -> bool {
    // `==` lets 0.0 equal -0.0, which a trip through arithmetic may turn into each other.
    same_bits(a, b) || a == b
}

fn same_yaw(a: f32, b: f32) -> bool {
    let apart = (a - b).abs().rem_euclid(360.0);
    apart.min(360.0 - apart) <= YAW_TOLERANCE_DEG
}

fn flag(value: f32) -> f32 {
    if value > 0.0 { 1.0 } else { 0.0 }
}

/// The value after a trip through a u16.
fn whole(value: f32) -> f32 {
    f32::from(value as u16)
}

/// Degrees in 0..360 by way of radians, in PX4's single precision; NaN stays NaN.
fn wrap_360(degrees: f32) -> f32 {
    use std::f32::consts::{PI, TAU};
    let radians = degrees / 180.0 * PI;
    let wrapped = if (0.0..TAU).contains(&radians) {
        radians
    } else {
        radians - TAU * (radians / TAU).floor()
    };
    wrapped * 180.0 / PI
}

#[cfg(test)]
mod tests {
    use super::*;

    const MISSION: MavMissionType = MavMissionType::MAV_MISSION_TYPE_MISSION;

    fn waypoint() -> Item {
        Item {
            frame: FRAME_GLOBAL,
            command: 16,
            autocontinue: true,
            params: [1.5, 2.0, f32::NAN, -90.0],
            x: -337_777_771,
            y: 1_511_111_113,
            z: 488.25,
            ..Item::default()
        }
    }

    #[test]
    fn what_px4_changes_is_no_difference() {
        let sent = waypoint();
        let read = px4_read_back(MISSION, &sent);
        assert_eq!(read.frame, FRAME_GLOBAL_INT);
        assert!((read.params[3] - 270.0).abs() < YAW_TOLERANCE_DEG);
        assert_eq!(read.params[2], 0.0);
        assert_eq!(verify(MISSION, &[sent], &[read]), Ok(()));
    }

    #[test]
    fn an_item_that_comes_back_untouched_is_no_difference() {
        assert_eq!(verify(MISSION, &[waypoint()], &[waypoint()]), Ok(()));
    }

    #[test]
    fn the_first_difference_is_named() {
        let sent = [waypoint(), waypoint()];
        let mut read = sent;
        read[1].z = 488.5;
        read[1].y += 1;
        assert_eq!(
            verify(MISSION, &sent, &read),
            Err(Difference::Item {
                seq: 1,
                field: Field::Y,
                expected: 1_511_111_113.0,
                read: 1_511_111_114.0
            })
        );
        assert_eq!(
            verify(MISSION, &sent, &read[..1]),
            Err(Difference::Count { sent: 2, read: 1 })
        );
    }

    #[test]
    fn every_single_changed_field_is_a_difference() {
        let sent = waypoint();
        let changes: [fn(&mut Item); 7] = [
            |item| item.frame = FRAME_GLOBAL_RELATIVE_INT,
            |item| item.command = 17,
            |item| item.autocontinue = false,
            |item| item.params[1] = 2.5,
            |item| item.params[3] = 90.0,
            |item| item.x += 1,
            |item| item.z = f32::NAN,
        ];
        for (index, change) in changes.into_iter().enumerate() {
            let mut read = px4_read_back(MISSION, &sent);
            change(&mut read);
            assert!(verify(MISSION, &[sent], &[read]).is_err(), "change {index}");
        }
    }

    #[test]
    fn a_heading_not_set_stays_not_set() {
        let mut sent = waypoint();
        sent.params[3] = f32::NAN;
        assert!(px4_read_back(MISSION, &sent).params[3].is_nan());
        let mut read = px4_read_back(MISSION, &sent);
        read.params[3] = 0.0;
        assert!(verify(MISSION, &[sent], &[read]).is_err());
    }

    #[test]
    fn relative_fence_points_come_back_absolute() {
        let fence = MavMissionType::MAV_MISSION_TYPE_FENCE;
        let sent = Item {
            frame: FRAME_GLOBAL_RELATIVE,
            command: 5001,
            params: [4.0, 0.0, 0.0, 0.0],
            autocontinue: true,
            ..Item::default()
        };
        let read = px4_read_back(fence, &sent);
        assert_eq!(read.frame, FRAME_GLOBAL_INT);
        assert_eq!(verify(fence, &[sent], &[read]), Ok(()));
    }
}
