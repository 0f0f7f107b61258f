//! What a vehicle has reported: the latest values of its messages, in SI units and the frames named here.
//!
//! A plain value. The caller decides which messages to believe (verified, fresh) and when the value is stale.

use mavlink_link::dialect::{
    AUTOPILOT_VERSION_DATA, GpsFixType, MavAutopilot, MavLandedState, MavMessage, MavModeFlag,
    MavState, MavType, MavVtolState, MissionState,
};

use crate::airframe::Airframe;
pub use crate::attitude::Attitude;
use crate::attitude::AttitudeTrack;
use crate::equipment::Equipment;
use crate::evidence::{Evidence, percent};
use crate::mode::Px4Mode;

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

/// The uploaded mission (MISSION_CURRENT).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissionProgress {
    /// Sequence of the item that is flown to.
    pub seq: u16,
    /// Number of items; `None` if the vehicle has no mission.
    pub total: Option<u16>,
    /// Not started, active, paused, complete.
    pub state: MissionState,
    /// PX4's checksum of the plan, 0 if it has none.
    pub mission_id: u32,
    /// The same for the geofence.
    pub fence_id: u32,
    /// The same for the rally points.
    pub rally_points_id: u32,
}

/// Whether it is on the ground or in the air (EXTENDED_SYS_STATE.landed_state).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LandedState {
    /// On the ground.
    OnGround,
    /// In the air.
    InAir,
    /// Taking off.
    TakingOff,
    /// Landing.
    Landing,
}

impl LandedState {
    /// From the message. A vehicle that reports its state as undefined has reported none: `None`, as before its first report.
    #[must_use]
    pub fn of(reported: MavLandedState) -> Option<LandedState> {
        use MavLandedState as S;
        match reported {
            S::MAV_LANDED_STATE_UNDEFINED => None,
            S::MAV_LANDED_STATE_ON_GROUND => Some(LandedState::OnGround),
            S::MAV_LANDED_STATE_IN_AIR => Some(LandedState::InAir),
            S::MAV_LANDED_STATE_TAKEOFF => Some(LandedState::TakingOff),
            S::MAV_LANDED_STATE_LANDING => Some(LandedState::Landing),
        }
    }
}

/// A circle that a multicopter flies (ORBIT_EXECUTION_STATUS).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orbit {
    /// Its centre, at the altitude that the vehicle is set to at this moment: on the way to the circle not the commanded one.
    pub centre: Place,
    /// Metres; negative where it turns counter-clockwise.
    pub radius_m: f64,
}

/// The latest values.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Telemetry {
    /// HEARTBEAT.custom_mode, or CURRENT_MODE.custom_mode, whichever came last.
    pub mode: Option<Px4Mode>,
    /// CURRENT_MODE.intended_custom_mode: the operator's, also while a failsafe flies another. Unknown from a HEARTBEAT with
    /// another mode until the next CURRENT_MODE.
    pub intended_mode: Option<Px4Mode>,
    /// HEARTBEAT.base_mode's armed bit.
    pub armed: Option<bool>,
    /// HEARTBEAT.system_status.
    pub system_status: Option<MavState>,
    /// HEARTBEAT.type.
    pub vehicle_type: Option<MavType>,
    /// HEARTBEAT.autopilot.
    pub autopilot: Option<MavAutopilot>,
    /// EXTENDED_SYS_STATE.landed_state; `None` also where the vehicle reports it as undefined.
    pub landed: Option<LandedState>,
    /// EXTENDED_SYS_STATE.vtol_state; `None` for a vehicle that is no VTOL.
    pub vtol_state: Option<MavVtolState>,
    /// A VTOL hovers although it was on its wings or on the way there, and without a transition back: PX4's quad-chute.
    /// True until the next transition to wings, or the ground.
    pub transition_failed: bool,
    /// GLOBAL_POSITION_INT, once the vehicle has a position.
    pub position: Option<Place>,
    /// Metres above home (GLOBAL_POSITION_INT.relative_alt).
    pub above_home_m: Option<f64>,
    /// North, east, down, m/s (GLOBAL_POSITION_INT, finer from LOCAL_POSITION_NED).
    pub velocity_ned: Option<[f64; 3]>,
    /// That of the position's own message (GLOBAL_POSITION_INT).
    pub position_velocity: Option<[f64; 3]>,
    /// ATTITUDE.
    pub attitude: Option<Attitude>,
    /// What it was at the moment of the position.
    pub attitude_track: AttitudeTrack,
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
    /// The place it flies to (POSITION_TARGET_GLOBAL_INT): PX4's own set point, AMSL.
    pub target: Option<Place>,
    /// The circle that it flies, or last flew (ORBIT_EXECUTION_STATUS).
    pub orbit: Option<Orbit>,
    /// The last MISSION_ITEM_REACHED; PX4 repeats it up to ten times.
    pub reached: Option<u16>,
    /// Further values of its sensors.
    pub sensed: Sensed,
    /// The basis for judging contingencies.
    pub evidence: Evidence,
    /// Its equipment. Updated separately, with the time ([`Equipment::update`]).
    pub equipment: Equipment,
    /// AUTOPILOT_VERSION, once it was received.
    pub software: Option<Software>,
}

impl Telemetry {
    /// Takes one message of the vehicle's autopilot. True if this struct keeps any of its values.
    pub fn update(&mut self, message: &MavMessage) -> bool {
        let sensed = self.sensed.update(message);
        self.evidence.update(message);
        match message {
            MavMessage::HEARTBEAT(m) => {
                let mode = Some(Px4Mode(m.custom_mode));
                if self.mode != mode {
                    // The intended mode may have changed with it: otherwise a mode just commanded would look like a
                    // failsafe.
                    self.intended_mode = None;
                }
                self.mode = mode;
                self.armed = Some(
                    m.base_mode
                        .contains(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED),
                );
                self.system_status = Some(m.system_status);
                self.vehicle_type = Some(m.mavtype);
                self.autopilot = Some(m.autopilot);
            }
            MavMessage::CURRENT_MODE(m) => {
                self.mode = Some(Px4Mode(m.custom_mode));
                self.intended_mode =
                    (m.intended_custom_mode != 0).then_some(Px4Mode(m.intended_custom_mode));
            }
            MavMessage::EXTENDED_SYS_STATE(m) => {
                self.landed = LandedState::of(m.landed_state);
                self.turn_vtol(m.vtol_state);
            }
            MavMessage::GLOBAL_POSITION_INT(m) => {
                self.attitude_track.note_position(m.time_boot_ms);
                self.position = Some(place(m.lat, m.lon, f64::from(m.alt) / 1e3));
                self.above_home_m = Some(f64::from(m.relative_alt) / 1e3);
                self.velocity_ned = Some([m.vx, m.vy, m.vz].map(|cm| f64::from(cm) / 100.0));
                self.position_velocity = self.velocity_ned;
            }
            MavMessage::LOCAL_POSITION_NED(m) => {
                let velocity = [m.vx, m.vy, m.vz].map(f64::from);
                if velocity.iter().all(|v| v.is_finite()) {
                    self.velocity_ned = Some(velocity);
                }
            }
            MavMessage::ATTITUDE(m) => {
                let angles = [m.roll, m.pitch, m.yaw];
                let rates = [m.rollspeed, m.pitchspeed, m.yawspeed];
                let finite = angles.iter().chain(&rates).all(|v| v.is_finite());
                self.attitude = finite.then_some(Attitude {
                    roll: m.roll.into(),
                    pitch: m.pitch.into(),
                    yaw: m.yaw.into(),
                    roll_rate: m.rollspeed.into(),
                    pitch_rate: m.pitchspeed.into(),
                    yaw_rate: m.yawspeed.into(),
                });
                self.attitude_track
                    .note_attitude(m.time_boot_ms, self.attitude);
            }
            MavMessage::HOME_POSITION(m) => {
                self.home = Some(place(m.latitude, m.longitude, f64::from(m.altitude) / 1e3));
            }
            MavMessage::GPS_RAW_INT(m) => {
                let fix = m.fix_type as u32 >= GpsFixType::GPS_FIX_TYPE_3D_FIX as u32;
                self.gps_fix = Some(fix);
                // An extension field that was not sent reads as 0; no receiver stays exactly on the ellipsoid.
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
                // The last charge of a battery that has failed or is gone is not its charge.
                let gone = self.sensed.health.is_some_and(|now| now.fails(BATTERY));
                self.battery = percent(m.battery_remaining).or(self.battery.filter(|_| !gone));
            }
            // Only the first battery: others may feed a payload.
            MavMessage::BATTERY_STATUS(m) if m.id == 0 => {
                self.battery = percent(m.battery_remaining).or(self.battery)
            }
            MavMessage::MISSION_CURRENT(m) => {
                self.mission = Some(MissionProgress {
                    // PX4 sends 65535 when it has no mission.
                    seq: m.seq,
                    total: (m.total != u16::MAX).then_some(m.total),
                    state: m.mission_state,
                    mission_id: m.mission_id,
                    fence_id: m.fence_id,
                    rally_points_id: m.rally_points_id,
                });
            }
            MavMessage::POSITION_TARGET_GLOBAL_INT(m) => {
                let finite = m.alt.is_finite();
                self.target = finite.then(|| place(m.lat_int, m.lon_int, m.alt.into()));
            }
            MavMessage::ORBIT_EXECUTION_STATUS(m) => {
                let finite = m.z.is_finite() && m.radius.is_finite();
                self.orbit = finite.then(|| Orbit {
                    centre: place(m.x, m.y, m.z.into()),
                    radius_m: m.radius.into(),
                });
            }
            MavMessage::MISSION_ITEM_REACHED(m) => self.reached = Some(m.seq),
            MavMessage::AUTOPILOT_VERSION(m) => self.software = Some(Software::of(m)),
            _ => return sensed,
        }
        true
    }

    /// Its place, which it has only with a fix of its receiver.
    #[must_use]
    pub fn located(&self) -> Option<Place> {
        self.position.filter(|_| self.gps_fix != Some(false))
    }

    /// The velocity for a report of its place: of the same moment. LOCAL_POSITION_NED is another one.
    #[must_use]
    pub fn velocity_at_place(&self) -> Option<[f64; 3]> {
        let of_place = self.located().and(self.position_velocity);
        of_place.or(self.velocity_ned)
    }

    /// The attitude for a report of its place: as it was then, or the latest where that is not known.
    #[must_use]
    pub fn attitude_at_place(&self) -> Option<Attitude> {
        let latest = self.attitude?;
        let then = self.located().and(self.attitude_track.at_position());
        Some(then.unwrap_or(latest))
    }

    /// The attitude for what is derived from it and from its place: as it was then. `None` where the vehicle may have turned between the two.
    #[must_use]
    pub fn attitude_with_place(&self) -> Option<Attitude> {
        let both = self.attitude.and(self.located());
        both.and(self.attitude_track.with_position())
    }

    /// When its position was measured: ms since its boot.
    #[must_use]
    pub fn position_ms(&self) -> Option<u32> {
        self.attitude_track.position_ms()
    }

    /// Its time since boot, ms, as its latest position or attitude has shown it.
    #[must_use]
    pub fn boot_ms(&self) -> Option<u32> {
        self.attitude_track.boot_ms()
    }

    /// Whether it has reported that it is in the air.
    #[must_use]
    pub fn airborne(&self) -> bool {
        self.landed
            .is_some_and(|landed| landed != LandedState::OnGround)
    }

    /// Whether it has reported that it is on the ground.
    #[must_use]
    pub fn stands(&self) -> bool {
        self.landed == Some(LandedState::OnGround)
    }

    /// Discards its position and what it flew: it has restarted, perhaps elsewhere. Its type stays, and its sensors report
    /// again.
    pub fn restart(&mut self) {
        self.landed = None;
        self.vtol_state = None;
        self.transition_failed = false;
        self.position = None;
        self.above_home_m = None;
        self.velocity_ned = None;
        self.position_velocity = None;
        self.attitude_track = AttitudeTrack::default();
        self.home = None;
        self.geoid_m = None;
        self.mission = None;
        self.target = None;
        self.orbit = None;
        self.reached = None;
        self.evidence = Evidence::default();
    }

    /// Updates the state of a VTOL. A transition back takes seconds, in which this message arrives several times, so a VTOL
    /// that hovers without having reported it has lost its wings.
    fn turn_vtol(&mut self, next: MavVtolState) {
        use MavVtolState as V;
        let before = self.vtol_state;
        let winged = matches!(
            before,
            Some(V::MAV_VTOL_STATE_FW | V::MAV_VTOL_STATE_TRANSITION_TO_FW)
        );
        if self.stands() || next == V::MAV_VTOL_STATE_TRANSITION_TO_FW {
            self.transition_failed = false;
        } else {
            self.transition_failed |= winged && next == V::MAV_VTOL_STATE_MC;
        }
        self.vtol_state = (next != V::MAV_VTOL_STATE_UNDEFINED).then_some(next);
    }

    /// Its airframe; a vehicle of unknown type is treated as one that hovers.
    #[must_use]
    pub fn airframe(&self) -> Airframe {
        self.vehicle_type
            .map_or(Airframe::Multicopter, Airframe::of)
    }

    /// Whether it can stand still in the air in its present state: a fixed wing never, a VTOL unless it flies on its wings.
    #[must_use]
    pub fn hovers(&self) -> bool {
        match self.airframe() {
            Airframe::Multicopter => true,
            Airframe::FixedWing => false,
            Airframe::Vtol => self.vtol_state != Some(MavVtolState::MAV_VTOL_STATE_FW),
        }
    }

    /// Whether a VTOL is in a transition, in either direction.
    #[must_use]
    pub fn transits(&self) -> bool {
        use MavVtolState as V;
        matches!(
            self.vtol_state,
            Some(V::MAV_VTOL_STATE_TRANSITION_TO_FW | V::MAV_VTOL_STATE_TRANSITION_TO_MC)
        )
    }
}

/// From degrees times 1e7, and metres.
fn place(latitude: i32, longitude: i32, amsl_m: f64) -> Place {
    Place {
        latitude: f64::from(latitude) / 1e7,
        longitude: f64::from(longitude) / 1e7,
        amsl_m,
    }
}

/// The battery (BATTERY_STATUS with id 0, or SYS_STATUS if there is none).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Battery {
    /// Volts: the sum of the cells.
    pub volts: Option<f64>,
    /// Discharge current, amperes.
    pub amperes: Option<f64>,
    /// Kelvin.
    pub kelvin: Option<f64>,
}

/// MAV_SYS_STATUS_SENSOR_RC_RECEIVER.
const RC_RECEIVER: u32 = 0x1_0000;
/// MAV_SYS_STATUS_SENSOR_BATTERY.
pub(crate) const BATTERY: u32 = 0x200_0000;

/// SYS_STATUS: which sensors are in use, and which of these are healthy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Health {
    /// onboard_control_sensors_enabled.
    pub enabled: u32,
    /// onboard_control_sensors_health.
    pub healthy: u32,
}

impl Health {
    /// Whether one of these sensors is in use and not healthy.
    #[must_use]
    pub fn fails(self, sensors: u32) -> bool {
        self.enabled & !self.healthy & sensors != 0
    }

    /// Whether sticks reach the vehicle, of a remote control or a ground station (rcAndDataLinkCheck). PX4 reports the sensor as enabled
    /// where it misses them, too.
    #[must_use]
    pub fn has_sticks(self) -> bool {
        self.enabled & self.healthy & RC_RECEIVER != 0
    }
}

/// The latest values.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Sensed {
    /// Velocity of the air over ground: north, east, m/s (WIND_COV.wind_x, wind_y).
    pub wind_ne: Option<[f64; 2]>,
    /// Specific force in the body's axes: forward, right, down, m/s^2 (HIGHRES_IMU). At rest -9.81 down.
    pub acceleration: Option<[f64; 3]>,
    /// The battery.
    pub battery: Battery,
    /// Its voltage is that of BATTERY_STATUS.
    has_battery_status: bool,
    /// SYS_STATUS.
    pub health: Option<Health>,
    /// ESTIMATOR_STATUS.flags.
    pub estimator: Option<u16>,
}

impl Sensed {
    /// Takes one message. True if this struct keeps any of its values.
    pub(crate) fn update(&mut self, message: &MavMessage) -> bool {
        match message {
            MavMessage::WIND_COV(m) => {
                let wind = [m.wind_x, m.wind_y].map(f64::from);
                self.wind_ne = wind.iter().all(|v| v.is_finite()).then_some(wind);
            }
            MavMessage::HIGHRES_IMU(m) => {
                let force = [m.xacc, m.yacc, m.zacc].map(f64::from);
                self.acceleration = force.iter().all(|v| v.is_finite()).then_some(force);
            }
            MavMessage::BATTERY_STATUS(m) if m.id == 0 => {
                // Cells that do not exist are 65535.
                let cells = m.voltages.iter().filter(|cell| **cell != u16::MAX);
                let millivolts: u32 = cells.map(|cell| u32::from(*cell)).sum();
                self.has_battery_status = millivolts > 0;
                self.battery = Battery {
                    volts: (millivolts > 0).then(|| f64::from(millivolts) / 1e3),
                    amperes: (m.current_battery >= 0).then(|| f64::from(m.current_battery) / 1e2),
                    kelvin: (m.temperature != i16::MAX)
                        .then(|| f64::from(m.temperature) / 1e2 + 273.15),
                };
            }
            MavMessage::SYS_STATUS(m) => {
                self.health = Some(Health {
                    enabled: m.onboard_control_sensors_enabled.bits(),
                    healthy: m.onboard_control_sensors_health.bits(),
                });
                // Of all batteries together, so only where nothing is known of the first.
                if !self.has_battery_status {
                    let known = m.voltage_battery != u16::MAX && m.voltage_battery > 0;
                    self.battery.volts = known.then(|| f64::from(m.voltage_battery) / 1e3);
                }
            }
            MavMessage::ESTIMATOR_STATUS(m) => self.estimator = Some(m.flags.bits()),
            _ => return false,
        }
        true
    }
}

/// The vehicle's software and board.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Software {
    /// Such as `1.18.0-beta`.
    pub version: String,
    /// flight_custom_version: the first bytes of the hash of its source, as PX4 sends them.
    pub source: u64,
    /// board_version.
    pub board: u32,
    /// uid.
    pub hardware: u64,
}

impl Software {
    /// From the message.
    #[must_use]
    pub fn of(message: &AUTOPILOT_VERSION_DATA) -> Software {
        let [major, minor, patch, kind] = message.flight_sw_version.to_be_bytes();
        // FIRMWARE_VERSION_TYPE.
        let kind = match kind {
            0..64 => "-dev",
            64..128 => "-alpha",
            128..192 => "-beta",
            192..255 => "-rc",
            255 => "",
        };
        Software {
            version: format!("{major}.{minor}.{patch}{kind}"),
            // Lowest byte first on the wire.
            source: u64::from_le_bytes(message.flight_custom_version),
            board: message.board_version,
            hardware: message.uid,
        }
    }
}

#[cfg(test)]
mod tests {
    use mavlink_link::dialect::{
        BATTERY_STATUS_DATA, EXTENDED_SYS_STATE_DATA, MavSysStatusSensor, SYS_STATUS_DATA,
    };

    use super::*;

    #[test]
    fn a_version_is_reported_as_people_write_it() {
        let reported = |flight_sw_version| {
            let message = AUTOPILOT_VERSION_DATA {
                flight_sw_version,
                ..AUTOPILOT_VERSION_DATA::default()
            };
            Software::of(&message).version
        };
        assert_eq!(reported(0x0112_0080), "1.18.0-beta");
        assert_eq!(reported(0x010f_02ff), "1.15.2");
        assert_eq!(reported(0x0113_0000), "1.19.0-dev");
    }

    #[test]
    fn an_undefined_landed_state_is_none_whatever_was_reported_before() {
        use MavLandedState as S;
        let mut vehicle = Telemetry::default();
        for (landed_state, expected) in [
            (S::MAV_LANDED_STATE_UNDEFINED, None),
            (S::MAV_LANDED_STATE_ON_GROUND, Some(LandedState::OnGround)),
            (S::MAV_LANDED_STATE_UNDEFINED, None),
            (S::MAV_LANDED_STATE_TAKEOFF, Some(LandedState::TakingOff)),
            (S::MAV_LANDED_STATE_IN_AIR, Some(LandedState::InAir)),
            (S::MAV_LANDED_STATE_LANDING, Some(LandedState::Landing)),
            (S::MAV_LANDED_STATE_UNDEFINED, None),
        ] {
            vehicle.update(&MavMessage::EXTENDED_SYS_STATE(EXTENDED_SYS_STATE_DATA {
                landed_state,
                ..EXTENDED_SYS_STATE_DATA::default()
            }));
            assert_eq!(vehicle.landed, expected, "{landed_state:?}");
            let stands = landed_state == S::MAV_LANDED_STATE_ON_GROUND;
            assert_eq!(vehicle.stands(), stands, "{landed_state:?}");
            let airborne = expected.is_some() && !stands;
            assert_eq!(vehicle.airborne(), airborne, "{landed_state:?}");
        }
    }

    #[test]
    fn a_battery_that_is_gone_has_no_charge() {
        let mut vehicle = Telemetry::default();
        let mut charge = |battery_remaining, healthy| {
            let enabled = MavSysStatusSensor::MAV_SYS_STATUS_SENSOR_BATTERY;
            let health = if healthy {
                enabled
            } else {
                MavSysStatusSensor::empty()
            };
            vehicle.update(&MavMessage::SYS_STATUS(SYS_STATUS_DATA {
                onboard_control_sensors_enabled: enabled,
                onboard_control_sensors_health: health,
                battery_remaining,
                ..SYS_STATUS_DATA::default()
            }));
            vehicle.battery
        };
        assert_eq!(charge(80, true), Some(80));
        assert_eq!(charge(-1, true), Some(80), "others report it");
        assert_eq!(
            charge(12, false),
            Some(12),
            "PX4 clears the bit for a low one"
        );
        assert_eq!(charge(-1, false), None);
    }

    #[test]
    fn the_voltage_of_sys_status_is_followed_until_battery_status_has_one() {
        let mut measured = Sensed::default();
        let volts = |measured: &mut Sensed, message| {
            measured.update(&message);
            measured.battery.volts
        };
        let system = |voltage_battery| {
            MavMessage::SYS_STATUS(SYS_STATUS_DATA {
                voltage_battery,
                ..SYS_STATUS_DATA::default()
            })
        };
        assert_eq!(volts(&mut measured, system(16_000)), Some(16.0));
        assert_eq!(volts(&mut measured, system(14_500)), Some(14.5));
        assert_eq!(volts(&mut measured, system(u16::MAX)), None);
        let mut voltages = [u16::MAX; 10];
        voltages[0] = 15_200;
        let battery = MavMessage::BATTERY_STATUS(BATTERY_STATUS_DATA {
            voltages,
            ..BATTERY_STATUS_DATA::default()
        });
        assert_eq!(volts(&mut measured, battery), Some(15.2));
        assert_eq!(volts(&mut measured, system(14_000)), Some(15.2));
    }
}
