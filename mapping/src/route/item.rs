//! Mission items as PX4 takes them.

use mavlink_link::service::mission::{FRAME_MISSION, Item};

use crate::altitude::Level;

/// An item at a place, degrees north and east.
pub(super) fn placed(place: (f64, f64), level: Level, command: u16, params: [f32; 4]) -> Item {
    let (frame, z) = level.frame();
    Item {
        frame,
        command,
        current: false,
        autocontinue: true,
        params,
        x: degrees_e7(place.0),
        y: degrees_e7(place.1),
        z: z as f32,
    }
}

/// PX4 applies a speed to the present leg only when it is called a ground speed.
pub(super) fn change_speed(speed_m_s: f64) -> Item {
    Item {
        frame: FRAME_MISSION,
        command: DO_CHANGE_SPEED,
        autocontinue: true,
        params: [SPEED_TYPE_GROUND, speed_m_s as f32, THROTTLE_UNCHANGED, 0.0],
        ..Item::default()
    }
}

/// MISSION_ITEM_INT's unit of latitude and longitude.
pub(crate) fn degrees_e7(degrees: f64) -> i32 {
    (degrees * 1e7).round() as i32
}

/// MAV_CMD_NAV_WAYPOINT.
pub(super) const NAV_WAYPOINT: u16 = 16;
/// MAV_CMD_NAV_LAND.
pub(super) const NAV_LAND: u16 = 21;
/// MAV_CMD_DO_JUMP.
pub(super) const DO_JUMP: u16 = 177;
/// MAV_CMD_DO_CHANGE_SPEED.
pub(super) const DO_CHANGE_SPEED: u16 = 178;
const SPEED_TYPE_GROUND: f32 = 1.0;
const THROTTLE_UNCHANGED: f32 = -1.0;
