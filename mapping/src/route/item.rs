//! Mission items in the form that PX4 accepts.

use curve_paths::Position;
use mavlink_link::service::mission::{DO_SET_ROI_LOCATION, FRAME_MISSION, Item};

use crate::action::Action;
use crate::altitude::Level;
use crate::payload::Direction;

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

/// A point of a leg between heights above the ground, with the vehicle's own acceptance radius.
pub(super) fn over(point: Position) -> Item {
    let params = [0.0, 0.0, 0.0, f32::NAN];
    let place = (point.lat_deg, point.lon_deg);
    placed(place, Level::Amsl(point.alt_m), NAV_WAYPOINT, params)
}

/// PX4 applies a speed to the present leg of a multicopter only if it is a ground speed, and to that of a wing only if it
/// is an air speed, which is what a wing flies.
pub(super) fn change_speed(speed_m_s: f64, hovers: bool) -> Item {
    let kind = if hovers {
        SPEED_TYPE_GROUND
    } else {
        SPEED_TYPE_AIR
    };
    Item {
        frame: FRAME_MISSION,
        command: DO_CHANGE_SPEED,
        autocontinue: true,
        params: [kind, speed_m_s as f32, THROTTLE_UNCHANGED, 0.0],
        ..Item::default()
    }
}

/// MAV_CMD_DO_VTOL_TRANSITION.
pub(super) fn transition(to_hover: bool) -> Item {
    let state = if to_hover {
        VTOL_STATE_MC
    } else {
        VTOL_STATE_FW
    };
    Item {
        frame: FRAME_MISSION,
        command: DO_VTOL_TRANSITION,
        autocontinue: true,
        params: [state, 0.0, 0.0, 0.0],
        ..Item::default()
    }
}

/// The items of an action at a waypoint.
pub(super) fn action(action: &Action) -> Vec<Item> {
    let plain = |command, params: [f64; 4]| plain(command, params.map(|param| param as f32));
    let one = |command, params| vec![plain(command, params)];
    match *action {
        Action::Transition(_) => Vec::new(),
        // All cameras, no interval, one picture.
        Action::Photo => one(IMAGE_START_CAPTURE, [0.0, 0.0, 1.0, 0.0]),
        Action::PhotoEvery(seconds) => one(IMAGE_START_CAPTURE, [0.0, seconds, 0.0, 0.0]),
        Action::PhotoStop => one(IMAGE_STOP_CAPTURE, [0.0; 4]),
        // A camera with modes records only in its video mode, and takes pictures only in its image mode.
        Action::Video(true) => vec![
            plain(SET_CAMERA_MODE, [0.0, CAMERA_MODE_VIDEO, 0.0, 0.0]),
            plain(VIDEO_START_CAPTURE, [0.0; 4]),
        ],
        Action::Video(false) => vec![
            plain(VIDEO_STOP_CAPTURE, [0.0; 4]),
            plain(SET_CAMERA_MODE, [0.0, CAMERA_MODE_IMAGE, 0.0, 0.0]),
        ],
        // Param3: the first picture at once.
        Action::TriggerMetres(metres) => one(DO_SET_CAM_TRIGG_DIST, [metres, 0.0, 1.0, 0.0]),
        // An interval does not switch the trigger on; a distance does.
        Action::TriggerSeconds(seconds) => vec![
            plain(
                DO_SET_CAM_TRIGG_INTERVAL,
                [1_000.0 * seconds, 0.0, 0.0, 0.0],
            ),
            plain(DO_TRIGGER_CONTROL, [1.0, 0.0, 0.0, 0.0]),
        ],
        Action::TriggerOff => one(DO_TRIGGER_CONTROL, [0.0; 4]),
        Action::RoiOff => one(DO_SET_ROI_NONE, [0.0; 4]),
        // Param2 to param4 are hour, minute and second of a time of day: -1 is "not used".
        Action::Delay(seconds) => one(NAV_DELAY, [seconds, -1.0, -1.0, -1.0]),
    }
}

/// An item without a place.
fn plain(command: u16, params: [f32; 4]) -> Item {
    Item {
        frame: FRAME_MISSION,
        command,
        autocontinue: true,
        params,
        ..Item::default()
    }
}

/// The autopilot takes primary control of the gimbal from whoever has it; -2 stands for its own system and component.
/// Secondary control is unchanged (-1).
pub(super) fn take_gimbal() -> Item {
    plain(DO_GIMBAL_MANAGER_CONFIGURE, [-2.0, -2.0, -1.0, -1.0])
}

/// Points the gimbal at these angles. It first clears the region of interest, for the gimbal and for the nose of a
/// multicopter; that centres the gimbal, so it must come first.
pub(super) fn point_gimbal(to: Direction) -> [Item; 3] {
    let [pitch, yaw] = [to.elevation, to.azimuth].map(|angle| angle.to_degrees() as f32);
    // NaN: as fast as possible. Flags (param5) 0: the angles follow the vehicle.
    let angles = [pitch, yaw, f32::NAN, f32::NAN];
    [
        plain(DO_SET_ROI_NONE, [0.0; 4]),
        take_gimbal(),
        plain(DO_GIMBAL_MANAGER_PITCHYAW, angles),
    ]
}

/// A place to look at: an item in a frame with a position that is not flown to.
pub(super) fn look_at(place: (f64, f64), level: Level) -> Item {
    placed(place, level, DO_SET_ROI_LOCATION, [0.0; 4])
}

/// Which sensor of a camera is shown: CAMERA_SOURCE_IR (2), or CAMERA_SOURCE_RGB (1).
pub(super) fn show_sensor(camera: u8, thermal: bool) -> Item {
    let source = if thermal { 2.0 } else { 1.0 };
    plain(SET_CAMERA_SOURCE, [camera.into(), source, 0.0, 0.0])
}

/// Whether an item before a waypoint's own belongs to its leg: the speed, and where a sensor points.
pub(super) fn prepares_leg(item: &Item) -> bool {
    matches!(
        item.command,
        DO_CHANGE_SPEED
            | DO_SET_ROI_NONE
            | DO_SET_ROI_LOCATION
            | DO_GIMBAL_MANAGER_CONFIGURE
            | DO_GIMBAL_MANAGER_PITCHYAW
            | SET_CAMERA_SOURCE
    )
}

/// The speed that the items before this one leave in force, m/s, in the order of their index: PX4 flies the item with it where
/// no jump leads there, and where AUTO.MISSION is entered. `None` before the first.
pub(super) fn speed_before(items: &[Item], at: usize) -> Option<f32> {
    let before = items.iter().take(at).rev();
    before
        .filter(|item| item.command == DO_CHANGE_SPEED)
        .map(|item| item.params[1])
        .find(|speed_m_s| *speed_m_s > 0.0)
}

/// MISSION_ITEM_INT's unit of latitude and longitude.
pub(crate) fn degrees_e7(degrees: f64) -> i32 {
    (degrees * 1e7).round() as i32
}

/// MAV_CMD_NAV_WAYPOINT.
pub(super) const NAV_WAYPOINT: u16 = 16;
/// MAV_CMD_NAV_LAND.
pub(super) const NAV_LAND: u16 = 21;
/// MAV_CMD_NAV_LOITER_UNLIM.
pub(super) const NAV_LOITER_UNLIM: u16 = 17;
/// MAV_CMD_NAV_LOITER_TO_ALT.
pub(super) const NAV_LOITER_TO_ALT: u16 = 31;
/// MAV_CMD_NAV_VTOL_LAND.
pub(super) const NAV_VTOL_LAND: u16 = 85;
/// MAV_CMD_DO_LAND_START.
pub(super) const DO_LAND_START: u16 = 189;
const NAV_DELAY: u16 = 93;
const DO_SET_ROI_NONE: u16 = 197;
const DO_SET_CAM_TRIGG_DIST: u16 = 206;
const DO_SET_CAM_TRIGG_INTERVAL: u16 = 214;
const SET_CAMERA_MODE: u16 = 530;
const CAMERA_MODE_IMAGE: f64 = 0.0;
const CAMERA_MODE_VIDEO: f64 = 1.0;
const SET_CAMERA_SOURCE: u16 = 534;
const DO_GIMBAL_MANAGER_PITCHYAW: u16 = 1000;
const DO_GIMBAL_MANAGER_CONFIGURE: u16 = 1001;
const IMAGE_START_CAPTURE: u16 = 2000;
const IMAGE_STOP_CAPTURE: u16 = 2001;
const DO_TRIGGER_CONTROL: u16 = 2003;
const VIDEO_START_CAPTURE: u16 = 2500;
const VIDEO_STOP_CAPTURE: u16 = 2501;
/// MAV_CMD_DO_VTOL_TRANSITION.
pub(super) const DO_VTOL_TRANSITION: u16 = 3000;
/// MAV_CMD_DO_JUMP.
pub(crate) const DO_JUMP: u16 = 177;
/// MAV_CMD_DO_CHANGE_SPEED.
pub(super) const DO_CHANGE_SPEED: u16 = 178;
/// MAV_VTOL_STATE_MC.
pub(super) const VTOL_STATE_MC: f32 = 3.0;
/// MAV_VTOL_STATE_FW.
const VTOL_STATE_FW: f32 = 4.0;
const SPEED_TYPE_AIR: f32 = 0.0;
const SPEED_TYPE_GROUND: f32 = 1.0;
const THROTTLE_UNCHANGED: f32 = -1.0;
