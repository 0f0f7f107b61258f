//! The vehicle's state as messages: its streams, and its answers to REQUEST_MESSAGE.
//!
//! Positions are those of the estimator, about a decimetre from the truth; values that the model does not compute are
//! constants, mostly those of the reference vehicle.

#![allow(
    deprecated,
    reason = "PX4 still uses messages that MAVLink has replaced"
)]

use mavlink::MessageData as _;
use mavlink::dialects::development as mav;
use mavlink::dialects::development::MavMessage;

use super::state::Vehicle;
use crate::config::Airframe;
use crate::flight::mode::Mode;
use crate::physics::motion::{Geodetic, Ned, quaternion};
use crate::physics::vtol::VtolState;
use crate::services::metadata;

impl Vehicle {
    /// The message of a stream, or `None` while there is nothing to report.
    pub(crate) fn report(&self, message: u32) -> Option<MavMessage> {
        use MavMessage as M;
        Some(match message {
            mav::HEARTBEAT_DATA::ID => M::HEARTBEAT(self.heartbeat()),
            mav::SYS_STATUS_DATA::ID => M::SYS_STATUS(self.sys_status()),
            mav::SYSTEM_TIME_DATA::ID => M::SYSTEM_TIME(mav::SYSTEM_TIME_DATA {
                time_unix_usec: self.unix_time_us(),
                time_boot_ms: self.boot_ms(),
            }),
            mav::GPS_RAW_INT_DATA::ID => M::GPS_RAW_INT(self.gps_raw_int()),
            mav::ATTITUDE_DATA::ID => M::ATTITUDE(self.attitude()),
            mav::ATTITUDE_QUATERNION_DATA::ID => M::ATTITUDE_QUATERNION(self.attitude_quaternion()),
            mav::LOCAL_POSITION_NED_DATA::ID => M::LOCAL_POSITION_NED(self.local_position()?),
            mav::GLOBAL_POSITION_INT_DATA::ID => M::GLOBAL_POSITION_INT(self.global_position()?),
            mav::SERVO_OUTPUT_RAW_DATA::ID => M::SERVO_OUTPUT_RAW(self.servo_output()),
            mav::MISSION_CURRENT_DATA::ID => M::MISSION_CURRENT(self.mission_current()),
            mav::GPS_GLOBAL_ORIGIN_DATA::ID => M::GPS_GLOBAL_ORIGIN(self.global_origin()),
            mav::VFR_HUD_DATA::ID => M::VFR_HUD(self.vfr_hud()),
            mav::ATTITUDE_TARGET_DATA::ID => M::ATTITUDE_TARGET(self.attitude_target()),
            mav::POSITION_TARGET_LOCAL_NED_DATA::ID => {
                M::POSITION_TARGET_LOCAL_NED(self.local_target()?)
            }
            mav::POSITION_TARGET_GLOBAL_INT_DATA::ID => {
                M::POSITION_TARGET_GLOBAL_INT(self.global_target()?)
            }
            mav::ALTITUDE_DATA::ID => M::ALTITUDE(self.altitude()),
            mav::BATTERY_STATUS_DATA::ID => M::BATTERY_STATUS(self.battery()),
            mav::ESTIMATOR_STATUS_DATA::ID => M::ESTIMATOR_STATUS(self.estimator_status()),
            mav::WIND_COV_DATA::ID => M::WIND_COV(self.wind()?),
            mav::VIBRATION_DATA::ID => M::VIBRATION(mav::VIBRATION_DATA {
                time_usec: self.boot_us(),
                vibration_y: 0.1,
                vibration_z: if self.commander.is_armed() { 1.5 } else { 0.0 },
                ..Default::default()
            }),
            mav::ESC_STATUS_DATA::ID => M::ESC_STATUS(self.esc_status()),
            mav::EFI_STATUS_DATA::ID if self.config.combustion => M::EFI_STATUS(self.efi_status()),
            mav::SCALED_PRESSURE_DATA::ID => M::SCALED_PRESSURE(self.scaled_pressure()),
            mav::HOME_POSITION_DATA::ID => M::HOME_POSITION(self.home_position()?),
            mav::EXTENDED_SYS_STATE_DATA::ID => M::EXTENDED_SYS_STATE(self.extended_sys_state()),
            mav::ORBIT_EXECUTION_STATUS_DATA::ID => M::ORBIT_EXECUTION_STATUS(self.orbit_status()?),
            mav::CURRENT_MODE_DATA::ID => M::CURRENT_MODE(self.current_mode()),
            mav::AUTOPILOT_VERSION_DATA::ID => M::AUTOPILOT_VERSION(self.autopilot_version()),
            mav::PROTOCOL_VERSION_DATA::ID => M::PROTOCOL_VERSION(mav::PROTOCOL_VERSION_DATA {
                version: 200,
                min_version: 100,
                max_version: 203,
                ..Default::default()
            }),
            mav::COMPONENT_METADATA_DATA::ID if self.config.events => {
                M::COMPONENT_METADATA(mav::COMPONENT_METADATA_DATA {
                    time_boot_ms: self.boot_ms(),
                    file_crc: 1,
                    uri: metadata::GENERAL_URI.into(),
                })
            }
            _ => return self.payloads.report(message, self.boot_ms()),
        })
    }

    /// AVAILABLE_MODES for the mode with this 1-based index.
    pub(crate) fn available_mode(&self, index: u8) -> Option<MavMessage> {
        let (_termination, modes) = Mode::ALL.split_last()?;
        let mode = modes.get(usize::from(index).checked_sub(1)?)?;
        Some(MavMessage::AVAILABLE_MODES(mav::AVAILABLE_MODES_DATA {
            custom_mode: mode.custom_mode(),
            properties: mav::MavModeProperty::from_bits_retain(0),
            number_modes: modes.len() as u8,
            mode_index: index,
            standard_mode: mode.standard_mode(),
            mode_name: mode.title().into(),
        }))
    }

    fn heartbeat(&self) -> mav::HEARTBEAT_DATA {
        let armed = self.commander.is_armed();
        let system_status = match (armed, self.commander.in_failsafe()) {
            (true, true) => mav::MavState::MAV_STATE_CRITICAL,
            (true, false) => mav::MavState::MAV_STATE_ACTIVE,
            (false, _) if self.commander.can_arm(&self.facts()) => mav::MavState::MAV_STATE_STANDBY,
            (false, _) => mav::MavState::MAV_STATE_UNINIT,
        };
        let mode = self.commander.mode();
        // Armed or not: PX4 reports a termination above everything else.
        let system_status = match mode {
            Mode::Termination => mav::MavState::MAV_STATE_FLIGHT_TERMINATION,
            _ => system_status,
        };
        mav::HEARTBEAT_DATA {
            custom_mode: mode.custom_mode(),
            mavtype: match self.config.airframe {
                Airframe::Quad => mav::MavType::MAV_TYPE_QUADROTOR,
                Airframe::Plane => mav::MavType::MAV_TYPE_FIXED_WING,
                Airframe::Vtol => mav::MavType::MAV_TYPE_VTOL_FIXEDROTOR,
            },
            autopilot: mav::MavAutopilot::MAV_AUTOPILOT_PX4,
            base_mode: mode.base_mode(armed),
            system_status,
            mavlink_version: 3,
        }
    }

    fn sys_status(&self) -> mav::SYS_STATUS_DATA {
        use mav::MavSysStatusSensor as Sensor;
        let mut health = Sensor::from_bits_retain(HEALTH & !self.health_faults.unhealthy);
        if self.commander.can_arm(&self.facts()) || self.commander.is_armed() {
            health |= Sensor::MAV_SYS_STATUS_PREARM_CHECK;
        }
        mav::SYS_STATUS_DATA {
            onboard_control_sensors_present: Sensor::from_bits_retain(PRESENT),
            onboard_control_sensors_enabled: Sensor::from_bits_retain(
                ENABLED | self.health_faults.unhealthy,
            ),
            onboard_control_sensors_health: health,
            load: 196,
            voltage_battery: (self.battery_volts() * 1000.0) as u16,
            current_battery: -1,
            battery_remaining: self.battery_percent(),
            ..Default::default()
        }
    }

    fn servo_output(&self) -> mav::SERVO_OUTPUT_RAW_DATA {
        let [roll_rate, pitch_rate, _] = self.body.motion().rates;
        let armed = self.commander.is_armed();
        let motor = |mix: f64| {
            let out = if armed {
                1000.0 + 1000.0 * self.body.throttle() + 20.0 * mix
            } else {
                900.0
            };
            out.clamp(900.0, 2000.0) as u16
        };
        mav::SERVO_OUTPUT_RAW_DATA {
            time_usec: self.boot_us() as u32,
            servo1_raw: motor(-roll_rate + pitch_rate),
            servo2_raw: motor(roll_rate - pitch_rate),
            servo3_raw: motor(roll_rate + pitch_rate),
            servo4_raw: motor(-roll_rate - pitch_rate),
            servo5_raw: 900,
            servo6_raw: 900,
            servo7_raw: 900,
            servo8_raw: 900,
            ..Default::default()
        }
    }

    /// As in PX4's simulator in hardware: revolutions by the throttle, without volts and amperes.
    fn esc_status(&self) -> mav::ESC_STATUS_DATA {
        let throttle = if self.commander.is_armed() {
            self.body.throttle()
        } else {
            0.0
        };
        let motors = match self.config.airframe {
            Airframe::Quad | Airframe::Vtol => 4,
            Airframe::Plane => 1,
        };
        let rpm = (throttle.max(0.0).sqrt() * MAX_RPM) as i32;
        mav::ESC_STATUS_DATA {
            time_usec: self.boot_us(),
            rpm: std::array::from_fn(|motor| if motor < motors { rpm } else { 0 }),
            ..Default::default()
        }
    }

    /// The engine idles while the vehicle is disarmed.
    fn efi_status(&self) -> mav::EFI_STATUS_DATA {
        let throttle = if self.commander.is_armed() {
            self.body.throttle().clamp(0.0, 1.0)
        } else {
            0.0
        };
        mav::EFI_STATUS_DATA {
            health: 1,
            rpm: (IDLE_RPM + (MAX_RPM - IDLE_RPM) * throttle.sqrt()) as f32,
            throttle_position: (throttle * 100.0) as f32,
            // In kelvins, as PX4 sends it.
            cylinder_head_temperature: 390.0,
            ..Default::default()
        }
    }

    /// As PX4's simulated barometer: the standard atmosphere, with 288 K at sea level.
    fn scaled_pressure(&self) -> mav::SCALED_PRESSURE_DATA {
        let kelvin = 288.0 - 0.0065 * self.believed_place().altitude_m;
        mav::SCALED_PRESSURE_DATA {
            time_boot_ms: self.boot_ms(),
            press_abs: (1013.25 * (kelvin / 288.0).powf(5.256)) as f32,
            temperature: ((kelvin - 273.0) * 100.0).round() as i16,
            ..Default::default()
        }
    }

    /// MISSION_CURRENT: 65535 items means none.
    pub(crate) fn mission_current(&self) -> mav::MISSION_CURRENT_DATA {
        let mission = &self.navigator.mission;
        let [id, fence, rally] = self.plan_ids();
        mav::MISSION_CURRENT_DATA {
            seq: mission.index() as u16,
            total: match mission.count() {
                0 => u16::MAX,
                n => n as u16,
            },
            mission_state: self.mission_state,
            mission_mode: if mission_mode_active(self.commander.mode()) {
                1
            } else {
                2
            },
            mission_id: id,
            fence_id: fence,
            rally_points_id: rally,
        }
    }

    fn battery(&self) -> mav::BATTERY_STATUS_DATA {
        let mut voltages = [u16::MAX; 10];
        voltages[0] = (self.battery_volts() * 1000.0) as u16;
        mav::BATTERY_STATUS_DATA {
            energy_consumed: -1,
            temperature: i16::MAX,
            voltages,
            current_battery: -1,
            battery_function: mav::MavBatteryFunction::MAV_BATTERY_FUNCTION_ALL,
            mavtype: mav::MavBatteryType::MAV_BATTERY_TYPE_LIPO,
            battery_remaining: self.battery_percent(),
            charge_state: mav::MavBatteryChargeState::MAV_BATTERY_CHARGE_STATE_OK,
            fault_bitmask: mav::MavBatteryFault::from_bits_retain(0),
            ..Default::default()
        }
    }

    fn estimator_status(&self) -> mav::ESTIMATOR_STATUS_DATA {
        let flags = if self.is_located() { 895 } else { 1 } ^ self.health_faults.estimator;
        mav::ESTIMATOR_STATUS_DATA {
            time_usec: self.boot_us(),
            vel_ratio: 0.1,
            pos_horiz_ratio: 0.02,
            pos_vert_ratio: 0.01,
            mag_ratio: 0.08,
            hagl_ratio: 0.01,
            tas_ratio: f32::NAN,
            pos_horiz_accuracy: 0.29,
            pos_vert_accuracy: 0.27,
            flags: mav::EstimatorStatusFlags::from_bits_retain(flags),
        }
    }

    /// For a fixed wing only: PX4 in its simulator estimates no wind for a multicopter.
    fn wind(&self) -> Option<mav::WIND_COV_DATA> {
        let [n, e] = self.config.wind_ne_ms;
        (self.config.airframe != Airframe::Quad).then(|| mav::WIND_COV_DATA {
            time_usec: self.boot_us(),
            wind_x: n as f32,
            wind_y: e as f32,
            wind_z: 0.0,
            var_horiz: 0.1,
            var_vert: 0.0,
            wind_alt: self.believed_place().altitude_m as f32,
            horiz_accuracy: 0.3,
            vert_accuracy: 0.0,
        })
    }

    fn home_position(&self) -> Option<mav::HOME_POSITION_DATA> {
        let home = self.home?;
        let at = self.frame.to_global(home);
        Some(mav::HOME_POSITION_DATA {
            latitude: e7(at.latitude_deg),
            longitude: e7(at.longitude_deg),
            altitude: mm(at.altitude_m),
            x: home.n as f32,
            y: home.e as f32,
            z: home.d as f32,
            q: quaternion([0.0, 0.0, self.config.heading_rad]),
            time_usec: self.home_at_us,
            ..Default::default()
        })
    }

    fn extended_sys_state(&self) -> mav::EXTENDED_SYS_STATE_DATA {
        use mav::MavLandedState as Landed;
        mav::EXTENDED_SYS_STATE_DATA {
            vtol_state: (self.body.vtol()).map_or(
                mav::MavVtolState::MAV_VTOL_STATE_UNDEFINED,
                VtolState::reported,
            ),
            landed_state: match (self.landed, self.commander.mode()) {
                (true, _) => Landed::MAV_LANDED_STATE_ON_GROUND,
                (false, Mode::Takeoff | Mode::VtolTakeoff) => Landed::MAV_LANDED_STATE_TAKEOFF,
                (false, Mode::Land) => Landed::MAV_LANDED_STATE_LANDING,
                (false, _) => Landed::MAV_LANDED_STATE_IN_AIR,
            },
        }
    }

    fn orbit_status(&self) -> Option<mav::ORBIT_EXECUTION_STATUS_DATA> {
        let orbit = self
            .navigator
            .orbit()
            .filter(|_| self.commander.mode() == Mode::Orbit)?;
        // The altitude is the set point of this moment, as of FlightTaskOrbit::sendTelemetry.
        let at = self.frame.to_global(Ned {
            d: self.body.setpoint().position.d,
            ..orbit.centre
        });
        Some(mav::ORBIT_EXECUTION_STATUS_DATA {
            time_usec: self.boot_us(),
            radius: orbit.radius as f32,
            x: e7(at.latitude_deg),
            y: e7(at.longitude_deg),
            z: at.altitude_m as f32,
            frame: mav::MavFrame::MAV_FRAME_GLOBAL,
        })
    }

    fn current_mode(&self) -> mav::CURRENT_MODE_DATA {
        let mode = self.commander.mode();
        mav::CURRENT_MODE_DATA {
            custom_mode: mode.custom_mode(),
            intended_custom_mode: self.commander.intended().custom_mode(),
            standard_mode: mode.standard_mode(),
        }
    }

    fn autopilot_version(&self) -> mav::AUTOPILOT_VERSION_DATA {
        mav::AUTOPILOT_VERSION_DATA {
            capabilities: mav::MavProtocolCapability::from_bits_retain(0xe8ff),
            uid: 0x5349_4d00 + u64::from(self.config.system_id),
            flight_sw_version: VERSION_1_18_0_BETA,
            middleware_sw_version: VERSION_1_18_0_BETA,
            board_version: 1,
            ..Default::default()
        }
    }

    pub(crate) fn boot_us(&self) -> u64 {
        (self.now() * 1e6) as u64
    }

    pub(crate) fn boot_ms(&self) -> u32 {
        (self.now() * 1e3) as u32
    }

    fn unix_time_us(&self) -> u64 {
        match self.config.unix_time_us {
            0 => 0,
            at_boot => at_boot + self.boot_us(),
        }
    }

    fn battery_percent(&self) -> i8 {
        match self.health_faults.battery {
            Some(percent) => percent.min(100) as i8,
            None => (self.charge * 100.0).round() as i8,
        }
    }

    /// Four cells between 3.6 and 4.05 V.
    fn battery_volts(&self) -> f64 {
        4.0 * (3.6 + 0.45 * self.charge)
    }

    pub(crate) fn believed_place(&self) -> Geodetic {
        self.frame.to_global(self.believed())
    }

    pub(crate) fn home_or_zero(&self) -> Ned {
        self.home.unwrap_or_default()
    }
}

/// In these modes PX4 reports a mission as active, whether it flies one or not.
pub(crate) fn mission_mode_active(mode: Mode) -> bool {
    matches!(mode, Mode::Mission | Mode::Takeoff | Mode::Land)
}

pub(crate) fn e7(deg: f64) -> i32 {
    (deg * 1e7).round() as i32
}

pub(crate) fn mm(m: f64) -> i32 {
    (m * 1000.0).round() as i32
}

/// An angle from north, 0 to 35999.
pub(crate) fn centidegrees(rad: f64) -> u16 {
    (rad.to_degrees().rem_euclid(360.0) * 100.0) as u16 % 36000
}

/// Revolutions a minute of PX4's simulated motors at full throttle.
const MAX_RPM: f64 = 10_000.0;
/// Revolutions a minute of the armed motors without throttle.
const IDLE_RPM: f64 = 1_500.0;
/// SYS_STATUS of the reference vehicle, without the pre-arm bit.
const PRESENT: u32 = 50_380_847;
const ENABLED: u32 = 50_446_383;
const HEALTH: u32 = 52_480_063;
/// 1.18.0, release type 128 (beta).
const VERSION_1_18_0_BETA: u32 = 0x0112_0080;

impl Vehicle {
    pub(crate) fn gps_raw_int(&self) -> mav::GPS_RAW_INT_DATA {
        let motion = self.body.motion();
        let at = self
            .frame
            .to_global(motion.position + self.estimator.gnss_error());
        let speed = motion.velocity.horizontal();
        mav::GPS_RAW_INT_DATA {
            time_usec: self.boot_us(),
            lat: e7(at.latitude_deg),
            lon: e7(at.longitude_deg),
            alt: mm(at.altitude_m),
            eph: 70,
            epv: 110,
            vel: (speed * 100.0) as u16,
            cog: centidegrees(motion.velocity.bearing()),
            fix_type: mav::GpsFixType::GPS_FIX_TYPE_3D_FIX,
            satellites_visible: 10,
            alt_ellipsoid: mm(at.altitude_m + self.config.geoid_separation_m),
            h_acc: 900,
            v_acc: 1780,
            vel_acc: 400,
            ..Default::default()
        }
    }

    pub(crate) fn attitude(&self) -> mav::ATTITUDE_DATA {
        let motion = self.body.motion();
        let ([roll, pitch, yaw], [p, q, r]) = (motion.attitude, motion.body_rates());
        mav::ATTITUDE_DATA {
            time_boot_ms: self.boot_ms(),
            roll: roll as f32,
            pitch: pitch as f32,
            yaw: yaw as f32,
            rollspeed: p as f32,
            pitchspeed: q as f32,
            yawspeed: r as f32,
        }
    }

    pub(crate) fn attitude_quaternion(&self) -> mav::ATTITUDE_QUATERNION_DATA {
        let motion = self.body.motion();
        let [q1, q2, q3, q4] = quaternion(motion.attitude);
        let [p, q, r] = motion.body_rates();
        mav::ATTITUDE_QUATERNION_DATA {
            time_boot_ms: self.boot_ms(),
            q1,
            q2,
            q3,
            q4,
            rollspeed: p as f32,
            pitchspeed: q as f32,
            yawspeed: r as f32,
            ..Default::default()
        }
    }

    pub(crate) fn local_position(&self) -> Option<mav::LOCAL_POSITION_NED_DATA> {
        let (at, v) = (self.believed(), self.body.motion().velocity);
        self.is_located().then(|| mav::LOCAL_POSITION_NED_DATA {
            time_boot_ms: self.boot_ms(),
            x: at.n as f32,
            y: at.e as f32,
            z: at.d as f32,
            vx: v.n as f32,
            vy: v.e as f32,
            vz: v.d as f32,
        })
    }

    pub(crate) fn global_position(&self) -> Option<mav::GLOBAL_POSITION_INT_DATA> {
        let (at, motion) = (self.believed_place(), self.body.motion());
        let cm = |v: f64| (v * 100.0) as i16;
        self.is_located().then(|| mav::GLOBAL_POSITION_INT_DATA {
            time_boot_ms: self.boot_ms(),
            lat: e7(at.latitude_deg),
            lon: e7(at.longitude_deg),
            alt: mm(at.altitude_m),
            relative_alt: mm(self.home_or_zero().d - self.believed().d),
            vx: cm(motion.velocity.n),
            vy: cm(motion.velocity.e),
            vz: cm(motion.velocity.d),
            hdg: centidegrees(motion.attitude[2]),
        })
    }

    pub(crate) fn global_origin(&self) -> mav::GPS_GLOBAL_ORIGIN_DATA {
        let at = self.frame.origin();
        mav::GPS_GLOBAL_ORIGIN_DATA {
            latitude: e7(at.latitude_deg),
            longitude: e7(at.longitude_deg),
            altitude: mm(at.altitude_m),
            time_usec: self.boot_us(),
        }
    }

    pub(crate) fn vfr_hud(&self) -> mav::VFR_HUD_DATA {
        let motion = self.body.motion();
        mav::VFR_HUD_DATA {
            airspeed: self.body.airspeed().map_or(f32::NAN, |v| v as f32),
            groundspeed: motion.velocity.horizontal() as f32,
            alt: self.believed_place().altitude_m as f32,
            climb: -motion.velocity.d as f32,
            heading: (centidegrees(motion.attitude[2]) / 100) as i16,
            throttle: (self.body.throttle() * 100.0) as u16,
        }
    }

    pub(crate) fn attitude_target(&self) -> mav::ATTITUDE_TARGET_DATA {
        let [roll, pitch, _] = self.body.motion().attitude;
        mav::ATTITUDE_TARGET_DATA {
            time_boot_ms: self.boot_ms(),
            q: quaternion([roll, pitch, self.body.heading_setpoint()]),
            thrust: self.body.throttle() as f32,
            type_mask: mav::AttitudeTargetTypemask::from_bits_retain(0),
            ..Default::default()
        }
    }

    pub(crate) fn local_target(&self) -> Option<mav::POSITION_TARGET_LOCAL_NED_DATA> {
        let plan = self.body.setpoint();
        let (p, v, a) = (plan.position, plan.velocity, plan.acceleration);
        (self.is_located() && self.commander.is_armed()).then(|| {
            mav::POSITION_TARGET_LOCAL_NED_DATA {
                time_boot_ms: self.boot_ms(),
                x: p.n as f32,
                y: p.e as f32,
                z: p.d as f32,
                vx: v.n as f32,
                vy: v.e as f32,
                vz: v.d as f32,
                afx: a.n as f32,
                afy: a.e as f32,
                afz: a.d as f32,
                yaw: self.body.heading_setpoint() as f32,
                yaw_rate: 0.0,
                type_mask: mav::PositionTargetTypemask::from_bits_retain(0),
                coordinate_frame: mav::MavFrame::MAV_FRAME_LOCAL_NED,
            }
        })
    }

    pub(crate) fn global_target(&self) -> Option<mav::POSITION_TARGET_GLOBAL_INT_DATA> {
        let local = self.local_target()?;
        let at = self.frame.to_global(self.target);
        Some(mav::POSITION_TARGET_GLOBAL_INT_DATA {
            time_boot_ms: local.time_boot_ms,
            lat_int: e7(at.latitude_deg),
            lon_int: e7(at.longitude_deg),
            alt: at.altitude_m as f32,
            vx: local.vx,
            vy: local.vy,
            vz: local.vz,
            afx: local.afx,
            afy: local.afy,
            afz: local.afz,
            yaw: local.yaw,
            yaw_rate: 0.0,
            type_mask: local.type_mask,
            coordinate_frame: mav::MavFrame::MAV_FRAME_GLOBAL_INT,
        })
    }

    pub(crate) fn altitude(&self) -> mav::ALTITUDE_DATA {
        let at = self.believed();
        let amsl = self.frame.origin().altitude_m - at.d;
        mav::ALTITUDE_DATA {
            time_usec: self.boot_us(),
            altitude_monotonic: (amsl + 0.4) as f32,
            altitude_amsl: amsl as f32,
            altitude_local: -at.d as f32,
            altitude_relative: (self.home_or_zero().d - at.d) as f32,
            altitude_terrain: 0.0,
            bottom_clearance: -self.body.motion().position.d as f32,
        }
    }
}
