//! One item of a plan, without its receiver and transport, and the number by which PX4 identifies a plan.

use crc::{CRC_32_JAMCRC, Crc};
use mavlink::dialects::development::{
    MISSION_ITEM_DATA, MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavMessage, MavMissionType,
};
use num_traits::FromPrimitive;

use crate::frame::Node;

/// MAV_FRAME_GLOBAL: degE7 and metres above mean sea level.
pub const FRAME_GLOBAL: u8 = 0;
/// MAV_FRAME_MISSION: the item has no position; x, y and z are plain parameters.
pub const FRAME_MISSION: u8 = 2;
/// MAV_CMD_DO_SET_ROI_LOCATION: in a frame with a place, and not flown to.
pub const DO_SET_ROI_LOCATION: u16 = 195;
/// MAV_FRAME_GLOBAL_RELATIVE_ALT: degE7 and metres above home.
pub const FRAME_GLOBAL_RELATIVE: u8 = 3;
/// MAV_FRAME_GLOBAL_INT, the older synonym of [`FRAME_GLOBAL`] in MISSION_ITEM_INT.
pub const FRAME_GLOBAL_INT: u8 = 5;
/// MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, the older synonym of [`FRAME_GLOBAL_RELATIVE`].
pub const FRAME_GLOBAL_RELATIVE_INT: u8 = 6;

/// A mission, fence or rally item as MISSION_ITEM_INT (73) carries it.
/// MAV_CMD_DO_SET_ROI_LOCATION: its frame has a position, but the vehicle does not fly to it.
/// Frame and command are the raw numbers of the wire, so that an item of another dialect can be
/// compared and reported. Two items are equal when every bit is, except that any
/// NaN equals any NaN.
#[derive(Clone, Copy, Debug, Default)]
pub struct Item {
    /// MISSION_ITEM_INT.frame, a MAV_FRAME.
    pub frame: u8,
    /// MISSION_ITEM_INT.command, a MAV_CMD.
    pub command: u16,
    /// MISSION_ITEM_INT.current: the plan starts here.
    pub current: bool,
    /// MISSION_ITEM_INT.autocontinue: continue with the next item.
    pub autocontinue: bool,
    /// MISSION_ITEM_INT.param1 to param4, units by command; NaN is "not set".
    pub params: [f32; 4],
    /// MISSION_ITEM_INT.x: latitude in degrees * 1e7, or param5.
    pub x: i32,
    /// MISSION_ITEM_INT.y: longitude in degrees * 1e7, or param6.
    pub y: i32,
    /// MISSION_ITEM_INT.z: altitude in metres (reference by frame), or param7.
    pub z: f32,
}

/// The dialect has no value for this number, so no message can carry it.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum UnknownInDialect {
    /// MISSION_ITEM_INT.command
    #[error("MISSION_ITEM_INT.command: {0} is not a MAV_CMD of the dialect")]
    Command(u16),
    /// MISSION_ITEM_INT.frame
    #[error("MISSION_ITEM_INT.frame: {0} is not a MAV_FRAME of the dialect")]
    Frame(u8),
}

impl Item {
    /// Whether x and y are a position in degrees * 1e7.
    pub const fn is_global(&self) -> bool {
        matches!(
            self.frame,
            FRAME_GLOBAL
                | FRAME_GLOBAL_RELATIVE
                | FRAME_GLOBAL_INT
                | FRAME_GLOBAL_RELATIVE_INT
                | 10
                | 11
        )
    }

    /// Whether the vehicle flies to x and y: the place of DO_SET_ROI_LOCATION is only looked at.
    pub const fn is_flown_to(&self) -> bool {
        self.is_global() && self.command != DO_SET_ROI_LOCATION
    }

    /// Checks that a message can carry the item.
    ///
    /// # Errors
    /// The dialect does not know its command or frame.
    pub fn check_dialect(&self) -> Result<(), UnknownInDialect> {
        self.command_and_frame().map(|_| ())
    }

    /// The MISSION_ITEM_INT (73) for place `seq` of a plan.
    ///
    /// # Errors
    /// The dialect does not know its command or frame.
    pub fn to_message(
        &self,
        to: Node,
        kind: MavMissionType,
        seq: u16,
    ) -> Result<MavMessage, UnknownInDialect> {
        let (command, frame) = self.command_and_frame()?;
        let [param1, param2, param3, param4] = self.params;
        Ok(MavMessage::MISSION_ITEM_INT(MISSION_ITEM_INT_DATA {
            param1,
            param2,
            param3,
            param4,
            x: self.x,
            y: self.y,
            z: self.z,
            seq,
            command,
            target_system: to.system,
            target_component: to.component,
            frame,
            current: self.current.into(),
            autocontinue: self.autocontinue.into(),
            mission_type: kind,
        }))
    }

    /// The MISSION_ITEM (39) for place `seq`; x and y become floats and lose precision.
    ///
    /// # Errors
    /// The dialect does not know its command or frame.
    pub fn to_float_message(
        &self,
        to: Node,
        kind: MavMissionType,
        seq: u16,
    ) -> Result<MavMessage, UnknownInDialect> {
        let (command, frame) = self.command_and_frame()?;
        let [param1, param2, param3, param4] = self.params;
        let (x, y) = if self.is_global() {
            (degrees(self.x), degrees(self.y))
        // In a frame without a position x and y are plain parameters, which MISSION_ITEM carries unscaled.
        } else {
            (self.x as f32, self.y as f32)
        };
        Ok(MavMessage::MISSION_ITEM(MISSION_ITEM_DATA {
            param1,
            param2,
            param3,
            param4,
            x,
            y,
            z: self.z,
            seq,
            command,
            target_system: to.system,
            target_component: to.component,
            frame,
            current: self.current.into(),
            autocontinue: self.autocontinue.into(),
            mission_type: kind,
        }))
    }

    fn command_and_frame(&self) -> Result<(MavCmd, MavFrame), UnknownInDialect> {
        let command =
            MavCmd::from_u16(self.command).ok_or(UnknownInDialect::Command(self.command))?;
        let frame = MavFrame::from_u8(self.frame).ok_or(UnknownInDialect::Frame(self.frame))?;
        Ok((command, frame))
    }
}

impl From<&MISSION_ITEM_INT_DATA> for Item {
    fn from(data: &MISSION_ITEM_INT_DATA) -> Self {
        Self {
            frame: data.frame as u8,
            command: data.command as u16,
            current: data.current != 0,
            autocontinue: data.autocontinue != 0,
            params: [data.param1, data.param2, data.param3, data.param4],
            x: data.x,
            y: data.y,
            z: data.z,
        }
    }
}

impl From<&MISSION_ITEM_DATA> for Item {
    fn from(data: &MISSION_ITEM_DATA) -> Self {
        let mut item = Self {
            frame: data.frame as u8,
            command: data.command as u16,
            current: data.current != 0,
            autocontinue: data.autocontinue != 0,
            params: [data.param1, data.param2, data.param3, data.param4],
            x: 0,
            y: 0,
            z: data.z,
        };
        // A float cast saturates and turns NaN into 0, so no value can overflow.
        let scale = if item.is_global() { 1e7 } else { 1.0 };
        item.x = (f64::from(data.x) * scale).round() as i32;
        item.y = (f64::from(data.y) * scale).round() as i32;
        item
    }
}

impl PartialEq for Item {
    fn eq(&self, other: &Self) -> bool {
        self.frame == other.frame
            && self.command == other.command
            && self.current == other.current
            && self.autocontinue == other.autocontinue
            && self.x == other.x
            && self.y == other.y
            && same_bits(self.z, other.z)
            && self
                .params
                .iter()
                .zip(other.params)
                .all(|(a, b)| same_bits(*a, b))
    }
}

impl Eq for Item {}

/// PX4's id of a plan: MISSION_ACK.opaque_id after an upload by MISSION_ITEM_INT, and
/// MISSION_CURRENT.mission_id (fence_id, rally_points_id) from then on.
///
/// It covers what was sent, not what is stored: frame, command, autocontinue and the seven
/// parameters of every item, in order. `current` is not part of it. An empty plan has id 0.
pub fn plan_id(items: &[Item]) -> u32 {
    items.iter().fold(0, |id, item| {
        extend_plan_id(id, item, item.x.to_le_bytes(), item.y.to_le_bytes())
    })
}

/// The id of a plan one item longer; `x` and `y` are the bytes that the message carried,
/// which are floats in a MISSION_ITEM.
pub fn extend_plan_id(id: u32, item: &Item, x: [u8; 4], y: [u8; 4]) -> u32 {
    // The algorithm reflects its input, so the initial value goes in bit-reversed.
    let mut digest = CRC.digest_with_initial(id.reverse_bits());
    digest.update(&[item.frame]);
    digest.update(&item.command.to_le_bytes());
    digest.update(&[item.autocontinue.into()]);
    for param in item.params {
        digest.update(&param.to_le_bytes());
    }
    digest.update(&x);
    digest.update(&y);
    digest.update(&item.z.to_le_bytes());
    digest.finalize()
}

/// Bit equality in which every NaN is the same.
pub(super) fn same_bits(a: f32, b: f32) -> bool {
    a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
}

fn degrees(e7: i32) -> f32 {
    (f64::from(e7) * 1e-7) as f32
}

/// The polynomial of CRC-32 without the initial and the final inversion, as PX4's crc32part.
const CRC: Crc<u32> = Crc::<u32>::new(&crc::Algorithm {
    init: 0,
    ..CRC_32_JAMCRC
});

#[cfg(test)]
mod tests {
    use super::*;

    const TO: Node = Node::new(1, 1);

    fn waypoint() -> Item {
        Item {
            frame: FRAME_GLOBAL_RELATIVE,
            command: 16,
            current: true,
            autocontinue: true,
            params: [0.0, 2.0, 0.0, f32::NAN],
            x: 473_977_418,
            y: -85_455_938,
            z: 12.5,
        }
    }

    #[test]
    fn survives_its_message() {
        let item = waypoint();
        let Ok(MavMessage::MISSION_ITEM_INT(data)) =
            item.to_message(TO, MavMissionType::MAV_MISSION_TYPE_MISSION, 7)
        else {
            panic!("a waypoint is in the dialect");
        };
        assert_eq!(data.seq, 7);
        assert_eq!(Item::from(&data), item);
    }

    #[test]
    fn a_float_message_keeps_the_position_to_a_float() {
        let item = waypoint();
        let Ok(MavMessage::MISSION_ITEM(data)) =
            item.to_float_message(TO, MavMissionType::MAV_MISSION_TYPE_MISSION, 0)
        else {
            panic!("a waypoint is in the dialect");
        };
        let back = Item::from(&data);
        assert!((back.x - item.x).abs() < 40, "{} {}", back.x, item.x);
        assert!((back.y - item.y).abs() < 40, "{} {}", back.y, item.y);
    }

    #[test]
    fn zero_and_minus_zero_differ_and_nans_do_not() {
        let mut other = waypoint();
        other.params[3] = -f32::NAN;
        assert_eq!(waypoint(), other);
        other.params[0] = -0.0;
        assert_ne!(waypoint(), other);
    }

    #[test]
    fn a_number_outside_the_dialect_is_named() {
        let mut item = waypoint();
        item.command = 65_000;
        assert_eq!(item.check_dialect(), Err(UnknownInDialect::Command(65_000)));
        let mut item = waypoint();
        item.frame = 99;
        assert_eq!(item.check_dialect(), Err(UnknownInDialect::Frame(99)));
    }
}
