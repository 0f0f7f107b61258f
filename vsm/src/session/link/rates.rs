//! Which messages are requested of a vehicle, and how often.

use mavlink_link::service::interval::Rate;

/// The messages that the DLI needs. Messages that PX4 streams at up to 50 Hz by default and that are not needed are switched
/// off: a radio has no room for them.
pub(super) const RATES: &[(u32, Rate)] = &[
    // First, because it prevents a lossy link from being mistaken for a silent vehicle (the other source of the mode,
    // HEARTBEAT, is sent at 1 Hz).
    (436, Rate::Hz(5.0)), // CURRENT_MODE
    (30, Rate::Hz(5.0)),  // ATTITUDE
    (33, Rate::Hz(5.0)),  // GLOBAL_POSITION_INT
    (32, Rate::Hz(5.0)),  // LOCAL_POSITION_NED
    (245, Rate::Hz(2.0)), // EXTENDED_SYS_STATE
    // PX4 sends it every 2 s by default.
    (242, Rate::Hz(1.0)), // HOME_POSITION
    (24, Rate::Hz(1.0)),  // GPS_RAW_INT
    (74, Rate::Hz(2.0)),  // VFR_HUD
    (87, Rate::Hz(2.0)),  // POSITION_TARGET_GLOBAL_INT
    (1, Rate::Hz(1.0)),   // SYS_STATUS
    (147, Rate::Hz(0.5)), // BATTERY_STATUS
    (31, Rate::Off),      // ATTITUDE_QUATERNION
    (83, Rate::Off),      // ATTITUDE_TARGET
    (85, Rate::Off),      // POSITION_TARGET_LOCAL_NED
    (36, Rate::Off),      // SERVO_OUTPUT_RAW
];

/// Messages that the bridge cannot work without, and the longest interval of each, us. HEARTBEAT is part of the protocol
/// itself.
pub(crate) fn needed_every_us() -> impl Iterator<Item = (u32, f32)> {
    let requested = RATES.iter().filter_map(|(id, rate)| match rate {
        Rate::Hz(hz) => Some((*id, 1e6 / hz)),
        _ => None,
    });
    requested.chain([(0, 1e6)])
}
