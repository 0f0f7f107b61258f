//! What a vehicle has said of itself: the latest values of its messages, in SI units and the frames named here.
//!
//! A plain value. Whoever feeds it decides which messages to believe (verified, fresh) and when it is stale.

use mavlink_link::dialect::{
    GpsFixType, MavLandedState, MavMessage, MavModeFlag, MavState, MavType, MissionState,
};

use crate::mode::Px4Mode;
use crate::sensed::Sensed;
use crate::software::Software;

/// A place: WGS-84 latitude and longitude in degrees, altitude in metres above mean sea level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// Degrees north, -90 to 90.
    pub latitude: f64,
    /// Degrees east, -180 to 180.
    pub longitude: f64,
    /// Metres above mean sea level.
    pub amsl_m: f64,
}

/// Attitude and rates (ATTITUDE), rad and rad/s, aerospace axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Attitude {
    /// Right wing down is positive.
    pub roll: f64,
    /// Nose up is positive.
    pub pitch: f64,
    /// Clockwise from true north.
    pub yaw: f64,
    /// About the body's x axis.
    pub roll_rate: f64,
    /// About the body's y axis.
    pub pitch_rate: f64,
    /// About the body's z axis.
    pub yaw_rate: f64,
}

/// The mission aboard (MISSION_CURRENT).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissionProgress {
    /// Sequence of the item that is flown to.
    pub seq: u16,
    /// Items aboard; `None` where the vehicle has no mission.
    pub total: Option<u16>,
    /// Not started, active, paused, complete.
    pub state: MissionState,
    /// PX4's checksum of the plan aboard, 0 where it has none.
    pub mission_id: u32,
    /// The same of the geofence aboard.
    pub fence_id: u32,
}

/// A circle that a multicopter flies (ORBIT_EXECUTION_STATUS).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Its centre, at the altitude that is flown.
    pub centre: Place,
    /// Metres; negative where it turns counter-clockwise.
    pub radius_m: f64,
}

/// The latest values.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Telemetry {
    /// HEARTBEAT.custom_mode, or CURRENT_MODE.custom_mode, whichever came last.
    pub mode: Option<Px4Mode>,
    /// CURRENT_MODE.intended_custom_mode: the operator's, also while a failsafe flies another.
    pub intended_mode: Option<Px4Mode>,
    /// HEARTBEAT.base_mode's armed bit.
    pub armed: Option<bool>,
    /// HEARTBEAT.system_status.
    pub system_status: Option<MavState>,
    /// HEARTBEAT.type.
    pub vehicle_type: Option<MavType>,
    /// EXTENDED_SYS_STATE.landed_state.
    pub landed: Option<MavLandedState>,
    /// GLOBAL_POSITION_INT, once the vehicle has a position.
    pub position: Option<Place>,
    /// Metres above home (GLOBAL_POSITION_INT.relative_alt).
    pub above_home_m: Option<f64>,
    /// North, east, down, m/s (GLOBAL_POSITION_INT, finer from LOCAL_POSITION_NED).
    pub velocity_ned: Option<[f64; 3]>,
    /// ATTITUDE.
    pub attitude: Option<Attitude>,
    /// HOME_POSITION.
    pub home: Option<Place>,
    /// Height of the geoid above the ellipsoid where the vehicle is, m (GPS_RAW_INT: alt_ellipsoid - alt).
    pub geoid_m: Option<f64>,
    /// GPS_RAW_INT.fix_type is at least a 3-D fix.
    pub gps_fix: Option<bool>,
    /// Indicated or calibrated air speed, m/s (VFR_HUD).
    pub airspeed: Option<f64>,
    /// Ground speed, m/s (VFR_HUD).
    pub groundspeed: Option<f64>,
    /// Throttle, 0 to 100 % (VFR_HUD).
    pub throttle: Option<u8>,
    /// Energy left, 0 to 100 % (SYS_STATUS, BATTERY_STATUS).
    pub battery: Option<u8>,
    /// MISSION_CURRENT.
    pub mission: Option<MissionProgress>,
    /// Where it flies to (POSITION_TARGET_GLOBAL_INT): PX4's own set point, AMSL.
    pub target: Option<Place>,
    /// The circle that it flies, or flew last (ORBIT_EXECUTION_STATUS).
    pub orbit: Option<Orbit>,
    /// The last MISSION_ITEM_REACHED; PX4 says it ten times over.
    pub reached: Option<u16>,
    /// What its sensors have told beyond that.
    pub sensed: Sensed,
    /// AUTOPILOT_VERSION, once it was asked for.
    pub software: Option<Software>,
}

impl Telemetry {
    /// Takes in one message of the vehicle's autopilot. True where it held something that is kept here.
    pub fn update(&mut self, message: &MavMessage) -> bool {
        let sensed = self.sensed.update(message);
        match message {
            MavMessage::HEARTBEAT(m) => {
                self.mode = Some(Px4Mode(m.custom_mode));
                self.armed = Some(
                    m.base_mode
                        .contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED),
                );
                self.system_status = Some(m.system_status);
                self.vehicle_type = Some(m.mavtype);
            }
            MavMessage::CURRENT_MODE(m) => {
                self.mode = Some(Px4Mode(m.custom_mode));
                self.intended_mode =
                    (m.intended_custom_mode != 0).then_some(Px4Mode(m.intended_custom_mode));
            }
            MavMessage::EXTENDED_SYS_STATE(m) => self.landed = Some(m.landed_state),
            MavMessage::GLOBAL_POSITION_INT(m) => {
                self.position = Some(place(m.lat, m.lon, m.alt));
                self.above_home_m = Some(f64::from(m.relative_alt) / 1e3);
                self.velocity_ned = Some([m.vx, m.vy, m.vz].map(|cm| f64::from(cm) / 100.0));
            }
            MavMessage::LOCAL_POSITION_NED(m) => {
                let velocity = [m.vx, m.vy, m.vz].map(f64::from);
                if velocity.iter().all(|v| v.is_finite()) {
                    self.velocity_ned = Some(velocity);
                }
            }
            MavMessage::ATTITUDE(m) => {
                let [roll, pitch, yaw, roll_rate, pitch_rate, yaw_rate] = [
                    m.roll,
                    m.pitch,
                    m.yaw,
                    m.rollspeed,
                    m.pitchspeed,
                    m.yawspeed,
                ]
                .map(f64::from);
                let attitude = Attitude {
                    roll,
                    pitch,
                    yaw,
                    roll_rate,
                    pitch_rate,
                    yaw_rate,
                };
                let finite = [roll, pitch, yaw, roll_rate, pitch_rate, yaw_rate]
                    .iter()
                    .all(|v| v.is_finite());
                self.attitude = finite.then_some(attitude);
            }
            MavMessage::HOME_POSITION(m) => {
                self.home = Some(place(m.latitude, m.longitude, m.altitude))
            }
            MavMessage::GPS_RAW_INT(m) => {
                let fix = m.fix_type as u32 >= GpsFixType::GPS_FIX_TYPE_3D_FIX as u32;
                self.gps_fix = Some(fix);
                // An extension field that was never sent reads as 0: no receiver is exactly on the ellipsoid for long.
                if fix && m.alt_ellipsoid != 0 {
                    self.geoid_m = Some((f64::from(m.alt_ellipsoid) - f64::from(m.alt)) / 1e3);
                }
            }
            MavMessage::VFR_HUD(m) => {
                self.airspeed = m.airspeed.is_finite().then_some(m.airspeed.into());
                self.groundspeed = m.groundspeed.is_finite().then_some(m.groundspeed.into());
                self.throttle = u8::try_from(m.throttle)
                    .ok()
                    .filter(|percent| *percent <= 100);
            }
            MavMessage::SYS_STATUS(m) => {
                self.battery = percent(m.battery_remaining).or(self.battery)
            }
            MavMessage::BATTERY_STATUS(m) if m.id == 0 => {
                self.battery = percent(m.battery_remaining).or(self.battery)
            }
            MavMessage::MISSION_CURRENT(m) => {
                self.mission = Some(MissionProgress {
                    seq: m.seq,
                    total: (m.total != u16::MAX).then_some(m.total),
                    state: m.mission_state,
                    mission_id: m.mission_id,
                    fence_id: m.fence_id,
                });
            }
            MavMessage::POSITION_TARGET_GLOBAL_INT(m) => {
                self.target = m.alt.is_finite().then(|| Place {
                    latitude: f64::from(m.lat_int) / 1e7,
                    longitude: f64::from(m.lon_int) / 1e7,
                    amsl_m: m.alt.into(),
                });
            }
            MavMessage::ORBIT_EXECUTION_STATUS(m) => {
                let finite = m.z.is_finite() && m.radius.is_finite();
                self.orbit = finite.then(|| Orbit {
                    centre: Place {
                        latitude: f64::from(m.x) / 1e7,
                        longitude: f64::from(m.y) / 1e7,
                        amsl_m: m.z.into(),
                    },
                    radius_m: m.radius.into(),
                });
            }
            MavMessage::MISSION_ITEM_REACHED(m) => self.reached = Some(m.seq),
            MavMessage::AUTOPILOT_VERSION(m) => self.software = Some(Software::of(m)),
            _ => return sensed,
        }
        true
    }

    /// Whether it is in the air, as far as it has said.
    #[must_use]
    pub fn airborne(&self) -> bool {
        use MavLandedState as S;
        matches!(
            self.landed,
            Some(
                S::MAV_LANDED_STATE_IN_AIR
                    | S::MAV_LANDED_STATE_TAKEOFF
                    | S::MAV_LANDED_STATE_LANDING
            )
        )
    }

    /// Whether it stands on the ground, as it has said itself.
    #[must_use]
    pub fn stands(&self) -> bool {
        self.landed == Some(MavLandedState::MAV_LANDED_STATE_ON_GROUND)
    }

    /// Forgets where it was and what it flew: it has started anew, perhaps somewhere else. What it is stays, and what
    /// its sensors tell is told again.
    pub fn start_anew(&mut self) {
        self.landed = None;
        self.position = None;
        self.above_home_m = None;
        self.velocity_ned = None;
        self.home = None;
        self.geoid_m = None;
        self.mission = None;
        self.target = None;
        self.orbit = None;
        self.reached = None;
    }

    /// Whether it can stand still in the air: every type but a fixed wing, as long as it has not said.
    #[must_use]
    pub fn hovers(&self) -> bool {
        self.vehicle_type != Some(MavType::MAV_TYPE_FIXED_WING)
    }
}

fn place(latitude: i32, longitude: i32, amsl_mm: i32) -> Place {
    Place {
        latitude: f64::from(latitude) / 1e7,
        longitude: f64::from(longitude) / 1e7,
        amsl_m: f64::from(amsl_mm) / 1e3,
    }
}

fn percent(remaining: i8) -> Option<u8> {
    u8::try_from(remaining)
        .ok()
        .filter(|percent| *percent <= 100)
}
