//! Position, velocity and attitude as messages.

#![allow(deprecated, reason = "PX4 speaks what MAVLink has replaced")]

use mavlink::dialects::development as mav;

use super::attitude::quaternion;
use super::reports::{centidegrees, e7, mm};
use super::vehicle::Vehicle;

impl Vehicle {
    pub(super) fn gps_raw_int(&self) -> mav::GPS_RAW_INT_DATA {
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

    pub(super) fn attitude(&self) -> mav::ATTITUDE_DATA {
        let motion = self.body.motion();
        let ([roll, pitch, yaw], [p, q, r]) = (motion.attitude, motion.rates);
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

    pub(super) fn attitude_quaternion(&self) -> mav::ATTITUDE_QUATERNION_DATA {
        let motion = self.body.motion();
        let [q1, q2, q3, q4] = quaternion(motion.attitude);
        let [p, q, r] = motion.rates;
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

    pub(super) fn local_position(&self) -> Option<mav::LOCAL_POSITION_NED_DATA> {
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

    pub(super) fn global_position(&self) -> Option<mav::GLOBAL_POSITION_INT_DATA> {
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

    pub(super) fn global_origin(&self) -> mav::GPS_GLOBAL_ORIGIN_DATA {
        let at = self.frame.origin();
        mav::GPS_GLOBAL_ORIGIN_DATA {
            latitude: e7(at.latitude_deg),
            longitude: e7(at.longitude_deg),
            altitude: mm(at.altitude_m),
            time_usec: self.boot_us(),
        }
    }

    pub(super) fn vfr_hud(&self) -> mav::VFR_HUD_DATA {
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

    pub(super) fn attitude_target(&self) -> mav::ATTITUDE_TARGET_DATA {
        let [roll, pitch, _] = self.body.motion().attitude;
        mav::ATTITUDE_TARGET_DATA {
            time_boot_ms: self.boot_ms(),
            q: quaternion([roll, pitch, self.body.heading_setpoint()]),
            thrust: self.body.throttle() as f32,
            type_mask: mav::AttitudeTargetTypemask::from_bits_retain(0),
            ..Default::default()
        }
    }

    pub(super) fn local_target(&self) -> Option<mav::POSITION_TARGET_LOCAL_NED_DATA> {
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

    pub(super) fn global_target(&self) -> Option<mav::POSITION_TARGET_GLOBAL_INT_DATA> {
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

    pub(super) fn altitude(&self) -> mav::ALTITUDE_DATA {
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
