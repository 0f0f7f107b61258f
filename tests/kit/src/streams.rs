//! What PX4 sends on a radio.

/// MAVLINK_MODE_LOW_BANDWIDTH of a quadcopter without gimbal, camera or other aircraft: bytes of payload, and milliseconds
/// from one to the next.
pub const LOW_BANDWIDTH: [(usize, u64); 24] = [
    (9, 1_000),   // HEARTBEAT
    (28, 1_000),  // LOCAL_POSITION_NED
    (32, 250),    // ATTITUDE_QUATERNION
    (32, 1_000),  // ALTITUDE
    (37, 2_000),  // ATTITUDE_TARGET
    (41, 1_000),  // BATTERY_STATUS
    (9, 2_000),   // CURRENT_MODE
    (42, 1_000),  // ESTIMATOR_STATUS
    (2, 2_000),   // EXTENDED_SYS_STATE
    (28, 500),    // GLOBAL_POSITION_INT
    (20, 10_000), // GPS_GLOBAL_ORIGIN
    (52, 1_000),  // GPS_RAW_INT
    (60, 2_000),  // HOME_POSITION
    (26, 10_000), // NAV_CONTROLLER_OUTPUT
    (14, 10_000), // PING
    (51, 2_000),  // POSITION_TARGET_GLOBAL_INT
    (51, 2_000),  // POSITION_TARGET_LOCAL_NED
    (42, 1_000),  // RC_CHANNELS
    (37, 10_000), // SERVO_OUTPUT_RAW
    (43, 2_000),  // SYS_STATUS
    (12, 2_000),  // SYSTEM_TIME
    (20, 250),    // VFR_HUD
    (32, 10_000), // VIBRATION
    (26, 1_000),  // GIMBAL_MANAGER_STATUS and others that come now and then
];
