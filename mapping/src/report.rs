//! Messages 3001, 3002, 4000 and 4001 from the vehicle's telemetry.
//!
//! A field that the vehicle has not reported is absent, never zero.

use mavlink_link::dialect::{MavState, MavVtolState, MissionState};
use stanag_msgs::enums::{
    AltitudeCommandType, AltitudeType, FlightPathControlMode, HeadingCommandType, SpeedType,
    UaState,
};
use stanag_msgs::messages::{
    FromToNextWaypointStates, InertialStates, VehicleOperatingModeReport, VehicleOperatingStates,
};
use stanag_msgs::scalar::{Integer, Scale};
use stanag_msgs::{Bam16, Bam32, Scaled, TimeStamp};

use crate::altitude::Level;
use crate::limits::metres;
use crate::mode::Px4Mode;
use crate::route::{CompiledMission, Leg};
use crate::telemetry::{LandedState, MissionProgress, Telemetry};

/// UA State (3002.01) of a vehicle in the air: VSM specific, described by 41002.
pub const UA_STATE_AIRBORNE: u8 = 10;
/// UA State of a vehicle that takes off.
pub const UA_STATE_TAKE_OFF: u8 = 11;
/// UA State of a vehicle that lands.
pub const UA_STATE_LANDING: u8 = 12;
/// UA State of a vehicle that flies a failsafe.
pub const UA_STATE_FAILSAFE: u8 = 13;

/// UA State of a VTOL that transitions to its wings.
pub const UA_STATE_TO_WINGS: u8 = 14;
/// UA State of a VTOL that transitions to a hover.
pub const UA_STATE_TO_HOVER: u8 = 15;

/// What the CUCS last commanded and the vehicle accepted: the source of 3002's commanded fields.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Commanded {
    /// Altitude, above mean sea level.
    pub altitude_amsl_m: Option<f64>,
    /// Speed, m/s.
    pub speed_m_s: Option<f64>,
    /// Its reference.
    pub speed_type: Option<SpeedType>,
    /// The leg of the route at the time of the command: a later leg may have its own speed.
    pub speed_leg: Option<usize>,
    /// Loiter position: degrees north and east.
    pub loiter_position: Option<(f64, f64)>,
    /// The commanded direction (mode 15).
    pub direction: Option<CommandedDirection>,
}

impl Commanded {
    /// Applies what `later` commands; the rest is unchanged.
    pub fn keep(&mut self, later: &Commanded) {
        let Commanded {
            altitude_amsl_m,
            speed_m_s,
            speed_type,
            speed_leg,
            loiter_position,
            direction,
        } = *later;
        self.altitude_amsl_m = altitude_amsl_m.or(self.altitude_amsl_m);
        if speed_m_s.is_some() {
            (self.speed_m_s, self.speed_type, self.speed_leg) = (speed_m_s, speed_type, speed_leg);
        }
        self.loiter_position = loiter_position.or(self.loiter_position);
        self.direction = direction.or(self.direction);
    }
}

/// A direction as 2016 commands it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CommandedDirection {
    /// Where nose and track point, as far as commanded.
    Steady {
        /// Commanded Heading.
        heading: Option<Bam16>,
        /// Commanded Course.
        course: Option<Bam16>,
    },
    /// Commanded Turn Rate, rad/s, clockwise.
    Turning(f64),
}

/// 3001: the vehicle's actual mode, never the requested one. `None` before it has reported one.
#[must_use]
pub fn operating_mode(vehicle: &Telemetry, stamp: TimeStamp) -> Option<VehicleOperatingModeReport> {
    Some(VehicleOperatingModeReport {
        time_stamp: Some(stamp),
        select_flight_path_control_mode: Some(vehicle.mode?.reported()),
    })
}

/// 3001 for a vehicle that is no longer received: no mode.
#[must_use]
pub fn no_operating_mode(stamp: TimeStamp) -> VehicleOperatingModeReport {
    VehicleOperatingModeReport {
        time_stamp: Some(stamp),
        select_flight_path_control_mode: Some(FlightPathControlMode::NoMode),
    }
}

/// 3002. `stale` leaves only values that do not come from the vehicle, with UA State unknown.
#[must_use]
pub fn operating_states(
    vehicle: &Telemetry,
    commanded: &Commanded,
    compiled: Option<&CompiledMission>,
    stale: bool,
    stamp: TimeStamp,
) -> VehicleOperatingStates {
    let mut states = VehicleOperatingStates {
        time_stamp: Some(stamp),
        ..VehicleOperatingStates::default()
    };
    if stale {
        states.ua_state = Some(UaState::NotKnown);
        return states;
    }
    states.ua_state = Some(ua_state(vehicle));
    let (altitude_type, offset_m) = reference(vehicle);
    states.commanded_altitude = scaled(commanded.altitude_amsl_m.map(|m| m + offset_m));
    states.altitude_type = states.commanded_altitude.and(Some(altitude_type));
    states.altitude_command_type = states
        .commanded_altitude
        .and(Some(AltitudeCommandType::Altitude));
    if let Some((speed_m_s, kind)) = commanded_speed(vehicle, commanded, compiled)
        && let Ok(speed) = Scaled::from_si(speed_m_s)
    {
        states.commanded_speed = Some(speed);
        states.speed_type = Some(kind);
    }
    states.power_level = vehicle
        .throttle
        .and_then(|percent| i8::try_from(percent).ok());
    states.current_propulsion_energy_level = scaled(vehicle.battery.map(f64::from));
    if let Some((latitude, longitude)) = commanded.loiter_position {
        states.commanded_loiter_position_latitude = Some(Bam32::from_degrees(latitude));
        states.commanded_loiter_position_longitude = Some(Bam32::from_degrees(longitude));
    }
    match commanded.direction {
        Some(CommandedDirection::Steady { heading, course }) => {
            states.commanded_heading = heading;
            states.commanded_course = course;
            states.heading_command_type = match (heading, course) {
                (Some(_), Some(_)) => Some(HeadingCommandType::HeadingAndCourse),
                (Some(_), None) => Some(HeadingCommandType::Heading),
                (None, Some(_)) => Some(HeadingCommandType::Course),
                (None, None) => None,
            };
        }
        Some(CommandedDirection::Turning(rate)) => {
            states.commanded_turn_rate = scaled(Some(rate));
            states.heading_command_type = states
                .commanded_turn_rate
                .and(Some(HeadingCommandType::TurnRate));
        }
        None => {}
    }
    states.commanded_waypoint_number = to_leg(vehicle, compiled).map(|leg| leg.number);
    states
}

/// Fills what 3002 leaves out because nothing is commanded in the present mode, for Edition 2.5: #104 always carries all
/// fields, and an altitude of 0 would be one that nobody commanded. The value is the `last` commanded one, in whatever mode
/// and by whichever CUCS, so that the next CUCS in control sees the same; before any command it is the flown one. Altitude
/// and Heading Command Type stay absent, which means that neither is commanded now; a speed of 0 means none, as in #43.
pub fn fill_commanded(states: &mut VehicleOperatingStates, vehicle: &Telemetry, last: &Commanded) {
    if states.commanded_altitude.is_none() {
        let (altitude_type, offset_m) = reference(vehicle);
        let flown = vehicle.position.map(|place| place.amsl_m);
        let amsl_m = last.altitude_amsl_m.or(flown);
        states.commanded_altitude = scaled(amsl_m.map(|m| m + offset_m));
        states.altitude_type = states.commanded_altitude.and(Some(altitude_type));
    }
    if states.commanded_speed.is_none() {
        states.commanded_speed = scaled(last.speed_m_s);
        states.speed_type = states.commanded_speed.and(last.speed_type);
    }
    let (heading, course) = match last.direction {
        Some(CommandedDirection::Steady { heading, course }) => (heading, course),
        Some(CommandedDirection::Turning(_)) | None => (None, None),
    };
    let nose = || {
        let attitude = vehicle.attitude?;
        Some(Bam16::from_radians(attitude.yaw))
    };
    let track = || {
        let [north, east, _] = vehicle.velocity_ned?;
        Some(Bam16::from_radians(east.atan2(north)))
    };
    states.commanded_heading = states.commanded_heading.or(heading).or_else(nose);
    states.commanded_course = states.commanded_course.or(course).or_else(track);
}

/// 4000. `None` before the vehicle has reported any of its values.
///
/// Altitude is type 3 (ellipsoid) if the vehicle's geoid separation is known, otherwise type 1 (AMSL). Without a position
/// fix, latitude, longitude and altitude are absent. The stamp is that of the position, and so are
/// speed and attitude.
#[must_use]
pub fn inertial_states(vehicle: &Telemetry, stamp: TimeStamp) -> Option<InertialStates> {
    let position = vehicle.located();
    if position.is_none() && vehicle.attitude.is_none() && vehicle.velocity_ned.is_none() {
        return None;
    }
    let mut states = InertialStates {
        time_stamp: Some(stamp),
        ..InertialStates::default()
    };
    if let Some(place) = position {
        let (altitude_type, offset_m) = reference(vehicle);
        states.latitude = Some(Bam32::from_degrees(place.latitude));
        states.longitude = Some(Bam32::from_degrees(place.longitude));
        states.altitude = Scaled::from_si(place.amsl_m + offset_m).ok();
        states.altitude_type = states.altitude.is_some().then_some(altitude_type);
    }
    if let Some([north, east, down]) = vehicle.velocity_at_place() {
        states.u_speed = Scaled::from_si(north).ok();
        states.v_speed = Scaled::from_si(east).ok();
        states.w_speed = Scaled::from_si(down).ok();
    }
    if let Some(attitude) = vehicle.attitude_at_place() {
        states.roll = Some(Bam16::from_radians(attitude.roll));
        states.pitch = Some(Bam16::from_radians(attitude.pitch));
        states.heading = Some(Bam16::from_radians(attitude.yaw));
        // Those of the angles in this message, not of the body (3010): a tracker predicts the heading by Turn Rate.
        let rates = attitude.angle_rates();
        states.roll_rate = scaled(rates.map(|[roll, _, _]| roll));
        states.pitch_rate = scaled(rates.map(|[_, pitch, _]| pitch));
        states.turn_rate = scaled(rates.map(|[_, _, yaw]| yaw));
    }
    Some(states)
}

/// A vehicle's position along its route, as indices of [`CompiledMission::order`].
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Along {
    /// The last waypoint it was at; `None` before the first, and after it was sent elsewhere.
    pub from: Option<usize>,
    /// The waypoint that it flies to, or will fly to first.
    pub to: Option<usize>,
    /// The one after that.
    pub next: Option<usize>,
}

/// 4001, in the CUCS's own waypoint numbers; 0 if there is no such waypoint.
#[must_use]
pub fn waypoint_states(
    vehicle: &Telemetry,
    compiled: Option<&CompiledMission>,
    along: Along,
    stamp: TimeStamp,
) -> FromToNextWaypointStates {
    let mut states = FromToNextWaypointStates {
        time_stamp: Some(stamp),
        from_waypoint_number: Some(0),
        to_waypoint_number: Some(0),
        next_waypoint_number: Some(0),
        ..FromToNextWaypointStates::default()
    };
    let Some(compiled) = compiled else {
        return states;
    };
    let leg = |index: Option<usize>| compiled.order.get(index?);
    let (altitude_type, offset_m) = reference(vehicle);
    let home_m = vehicle.home.map(|home| home.amsl_m);
    let altitude = |leg: &Leg| {
        let amsl_m = match leg.level {
            Level::Amsl(m) => m,
            Level::AboveHome(m) => m + home_m?,
        };
        Scaled::from_si(amsl_m + offset_m).ok()
    };
    states.altitude_type = Some(altitude_type);
    // For the legs of a wing the commanded speed is an air speed.
    states.speed_type = Some(if vehicle.airframe().has_wings() {
        SpeedType::Indicated
    } else {
        SpeedType::Ground
    });
    if let Some(from) = leg(along.from) {
        states.from_waypoint_latitude = Some(Bam32::from_degrees(from.latitude));
        states.from_waypoint_longitude = Some(Bam32::from_degrees(from.longitude));
        states.from_waypoint_altitude = altitude(from);
        states.from_waypoint_number = Some(from.number);
    }
    let mut arrival_ms = None;
    if let Some(to) = leg(along.to) {
        arrival_ms = eta_ms(vehicle, to, stamp);
        states.to_waypoint_latitude = Some(Bam32::from_degrees(to.latitude));
        states.to_waypoint_longitude = Some(Bam32::from_degrees(to.longitude));
        states.to_waypoint_altitude = altitude(to);
        states.to_waypoint_speed = scaled(to.speed_m_s);
        states.to_waypoint_time = arrival_ms.map(TimeStamp);
        states.to_waypoint_number = Some(to.number);
    }
    if let (Some(to), Some(next)) = (leg(along.to), leg(along.next)) {
        states.next_waypoint_latitude = Some(Bam32::from_degrees(next.latitude));
        states.next_waypoint_longitude = Some(Bam32::from_degrees(next.longitude));
        states.next_waypoint_altitude = altitude(next);
        states.next_waypoint_speed = scaled(next.speed_m_s);
        states.next_waypoint_time = arrival_ms.and_then(|arrival_ms| {
            let distance_m = metres(to.place(), next.place());
            let speed_m_s = next.speed_m_s.or(vehicle.groundspeed)?;
            later(arrival_ms, distance_m, speed_m_s).map(TimeStamp)
        });
        states.next_waypoint_number = Some(next.number);
    }
    states
}

/// 4001 for a vehicle that loiters at a commanded place: that place as To, with number 65535, since it is none of the
/// uploader's waypoints.
#[must_use]
pub fn loiter_place_states(
    vehicle: &Telemetry,
    commanded: &Commanded,
    stamp: TimeStamp,
) -> Option<FromToNextWaypointStates> {
    let (latitude, longitude) = commanded.loiter_position?;
    let (altitude_type, offset_m) = reference(vehicle);
    let altitude_amsl_m = commanded.altitude_amsl_m;
    Some(FromToNextWaypointStates {
        time_stamp: Some(stamp),
        altitude_type: Some(altitude_type),
        from_waypoint_number: Some(0),
        to_waypoint_latitude: Some(Bam32::from_degrees(latitude)),
        to_waypoint_longitude: Some(Bam32::from_degrees(longitude)),
        to_waypoint_altitude: altitude_amsl_m
            .and_then(|amsl_m| Scaled::from_si(amsl_m + offset_m).ok()),
        to_waypoint_number: Some(NO_NUMBER),
        next_waypoint_number: Some(0),
        ..FromToNextWaypointStates::default()
    })
}

/// 4001.14: valid, and no waypoint of the uploader's.
const NO_NUMBER: u16 = 65_535;

/// The altitude type of reports, and what to add to an altitude above mean sea level for it.
pub(crate) fn reference(vehicle: &Telemetry) -> (AltitudeType, f64) {
    match vehicle.geoid_m {
        Some(geoid_m) => (AltitudeType::Wgs84, geoid_m),
        None => (AltitudeType::Barometric, 0.0),
    }
}

/// A quantity, if it is known and its field can express it.
pub(crate) fn scaled<R: Integer, S: Scale>(value: Option<f64>) -> Option<Scaled<R, S>> {
    Scaled::from_si(value?).ok()
}

/// UA State of 3002.
#[must_use]
pub fn ua_state(vehicle: &Telemetry) -> UaState {
    let failsafe = matches!(
        vehicle.system_status,
        Some(MavState::MAV_STATE_CRITICAL | MavState::MAV_STATE_EMERGENCY)
    );
    let turning = vehicle.vtol_state.filter(|_| vehicle.airborne());
    match vehicle.landed {
        _ if failsafe && vehicle.airborne() => UaState::from_raw(UA_STATE_FAILSAFE),
        _ if turning == Some(MavVtolState::MAV_VTOL_STATE_TRANSITION_TO_FW) => {
            UaState::from_raw(UA_STATE_TO_WINGS)
        }
        _ if turning == Some(MavVtolState::MAV_VTOL_STATE_TRANSITION_TO_MC) => {
            UaState::from_raw(UA_STATE_TO_HOVER)
        }
        Some(LandedState::InAir) => UaState::from_raw(UA_STATE_AIRBORNE),
        Some(LandedState::TakingOff) => UaState::from_raw(UA_STATE_TAKE_OFF),
        Some(LandedState::Landing) => UaState::from_raw(UA_STATE_LANDING),
        // It may fly: each state below means that it is on the ground.
        None if vehicle.armed == Some(true) => UaState::NotKnown,
        // Armed on the ground, before the take-off.
        _ if vehicle.armed == Some(true) => UaState::PreLaunch,
        _ => match vehicle.system_status {
            Some(MavState::MAV_STATE_STANDBY) => UaState::PreStart,
            Some(_) => UaState::PowerUp,
            None => UaState::NotKnown,
        },
    }
}

/// The leg that is flown, or the number of legs when the route is complete; `None` if the vehicle has reported none.
#[must_use]
pub fn to_index(vehicle: &Telemetry, compiled: &CompiledMission) -> Option<usize> {
    let mission = vehicle.mission?;
    // A complete mission flies to nothing; its last waypoint stays the one it came from.
    if mission.state == MissionState::MISSION_STATE_COMPLETE {
        return Some(compiled.order.len());
    }
    compiled.leg_of_item(mission.seq)
}

fn to_leg<'a>(vehicle: &Telemetry, compiled: Option<&'a CompiledMission>) -> Option<&'a Leg> {
    let compiled = compiled?;
    if vehicle.mode != Some(Px4Mode::MISSION) {
        return None;
    }
    compiled.order.get(to_index(vehicle, compiled)?)
}

/// The speed last commanded to the vehicle: by 2016, or by the leg that a mission flies since then.
fn commanded_speed(
    vehicle: &Telemetry,
    commanded: &Commanded,
    compiled: Option<&CompiledMission>,
) -> Option<(f64, SpeedType)> {
    let kind = if vehicle.hovers() {
        SpeedType::Ground
    } else {
        SpeedType::Indicated
    };
    let by_2016 = commanded
        .speed_m_s
        .map(|speed_m_s| (speed_m_s, commanded.speed_type.unwrap_or(kind)));
    let in_mission = vehicle.mode == Some(Px4Mode::MISSION);
    // Landed by it.
    let is_complete =
        |mission: MissionProgress| mission.state == MissionState::MISSION_STATE_COMPLETE;
    if in_mission && vehicle.stands() && vehicle.mission.is_some_and(is_complete) {
        return None;
    }
    let Some((compiled, at)) = compiled
        .filter(|_| in_mission)
        .and_then(|compiled| Some((compiled, to_index(vehicle, compiled)?)))
    else {
        return by_2016;
    };
    // A speed of the route applies until the next one.
    let by_route = compiled
        .order
        .iter()
        .enumerate()
        .take(at + 1)
        .filter_map(|(index, leg)| Some((index, leg.speed_m_s?)))
        .next_back();
    match (by_2016, by_route) {
        // Commanded on this leg or after the route's own speed, and the vehicle has not jumped back since.
        (Some(own), Some((index, _)))
            if commanded
                .speed_leg
                .is_some_and(|leg| (index..=at).contains(&leg)) =>
        {
            Some(own)
        }
        (_, Some((_, speed_m_s))) => Some((speed_m_s, kind)),
        (own, None) => own,
    }
}

fn eta_ms(vehicle: &Telemetry, to: &Leg, stamp: TimeStamp) -> Option<u64> {
    let place = vehicle.position?;
    let distance_m = metres((place.latitude, place.longitude), to.place());
    later(stamp.0, distance_m, vehicle.groundspeed?)
}

/// When a distance will be flown; `None` at a speed so low that the time has no meaning.
fn later(from_ms: u64, distance_m: f64, speed_m_s: f64) -> Option<u64> {
    const SLOWEST_M_S: f64 = 0.5;
    (speed_m_s >= SLOWEST_M_S)
        .then(|| from_ms.saturating_add((distance_m / speed_m_s * 1e3) as u64))
}

#[cfg(test)]
mod tests {
    use mavlink_link::dialect::{
        ATTITUDE_DATA, GLOBAL_POSITION_INT_DATA, LOCAL_POSITION_NED_DATA, MavMessage,
    };

    use super::*;

    /// Degrees clockwise from north at this time in a turn of 80 degrees a second, right through south.
    fn heading_deg(boot_ms: u32) -> f64 {
        130.0 + 0.08 * f64::from(boot_ms)
    }

    fn attitude(boot_ms: u32) -> MavMessage {
        let yaw = (heading_deg(boot_ms) + 180.0).rem_euclid(360.0) - 180.0;
        MavMessage::ATTITUDE(ATTITUDE_DATA {
            time_boot_ms: boot_ms,
            yaw: yaw.to_radians() as f32,
            yawspeed: 80_f32.to_radians(),
            ..ATTITUDE_DATA::default()
        })
    }

    fn position(boot_ms: u32) -> MavMessage {
        MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            time_boot_ms: boot_ms,
            lat: 470_000_000,
            ..GLOBAL_POSITION_INT_DATA::default()
        })
    }

    /// A station takes 1 to 4 as on the ground.
    #[test]
    fn an_armed_vehicle_of_unknown_landed_state_is_not_reported_on_the_ground() {
        let reported = |armed, landed| {
            ua_state(&Telemetry {
                armed: Some(armed),
                landed,
                system_status: Some(MavState::MAV_STATE_STANDBY),
                ..Telemetry::default()
            })
        };
        let on_ground = Some(LandedState::OnGround);
        assert_eq!(reported(true, None), UaState::NotKnown);
        assert_eq!(reported(true, on_ground), UaState::PreLaunch);
        assert_eq!(reported(false, None), UaState::PreStart);
    }

    /// How far the heading of 4000 is from this, degrees.
    fn heading_error_deg(vehicle: &Telemetry, expected_deg: f64) -> f64 {
        let states = inertial_states(vehicle, TimeStamp(1)).expect("a 4000");
        let heading = states.heading.expect("a heading").degrees();
        let rate = states.turn_rate.expect("a rate").si();
        assert!((rate - 80_f64.to_radians()).abs() < 0.005, "{rate}");
        ((heading - expected_deg + 180.0).rem_euclid(360.0) - 180.0).abs()
    }

    /// Two streams of 5 Hz, one of them half a period behind, or only just before or behind the other.
    #[test]
    fn a_heading_is_that_of_the_moment_of_its_position() {
        for behind_ms in [5, 100, 195] {
            let mut vehicle = Telemetry::default();
            for at_ms in (0..2_000).step_by(200) {
                vehicle.update(&position(at_ms));
                if at_ms > 0 {
                    let error_deg = heading_error_deg(&vehicle, heading_deg(at_ms));
                    assert!(error_deg < 0.05, "{behind_ms}, {at_ms}: {error_deg}");
                }
                vehicle.update(&attitude(at_ms + behind_ms));
                let error_deg = heading_error_deg(&vehicle, heading_deg(at_ms));
                assert!(error_deg < 0.05, "{behind_ms}, {at_ms}: {error_deg}");
            }
        }
    }

    /// In a level turn the heading changes alone, however far the vehicle is banked.
    #[test]
    fn the_rates_are_those_of_the_angles() {
        let (roll, turn) = (60_f32.to_radians(), 0.5);
        let mut banked = ATTITUDE_DATA {
            roll,
            pitchspeed: turn * roll.sin(),
            yawspeed: turn * roll.cos(),
            ..ATTITUDE_DATA::default()
        };
        let rates = |attitude: &ATTITUDE_DATA| {
            let mut vehicle = Telemetry::default();
            vehicle.update(&MavMessage::ATTITUDE(attitude.clone()));
            let states = inertial_states(&vehicle, TimeStamp(1)).expect("a 4000");
            let tilt = [states.roll_rate, states.pitch_rate].map(|rate| rate.map(|rate| rate.si()));
            [tilt[0], tilt[1], states.turn_rate.map(|rate| rate.si())]
        };
        for (found, expected) in rates(&banked).into_iter().zip([0.0, 0.0, 0.5]) {
            let found = found.expect("a rate");
            assert!((found - expected).abs() < 0.006, "{found} {expected}");
        }
        // Near the vertical the angles have none.
        banked.pitch = 85_f32.to_radians();
        assert_eq!(rates(&banked), [None; 3]);
    }

    #[test]
    fn a_speed_is_that_of_its_position() {
        let mut vehicle = Telemetry::default();
        let north_m_s = |vehicle: &Telemetry| {
            let states = inertial_states(vehicle, TimeStamp(1)).expect("a 4000");
            states.u_speed.expect("a speed").si()
        };
        let local = |vx| {
            MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                vx,
                ..LOCAL_POSITION_NED_DATA::default()
            })
        };
        vehicle.update(&local(3.0));
        assert_eq!(north_m_s(&vehicle), 3.0);
        vehicle.update(&MavMessage::GLOBAL_POSITION_INT(GLOBAL_POSITION_INT_DATA {
            vx: 400,
            ..GLOBAL_POSITION_INT_DATA::default()
        }));
        vehicle.update(&local(5.0));
        assert_eq!(north_m_s(&vehicle), 4.0);
        vehicle.gps_fix = Some(false);
        assert_eq!(north_m_s(&vehicle), 5.0, "without a place");
    }

    #[test]
    fn without_a_position_of_that_time_the_heading_is_the_latest() {
        let mut vehicle = Telemetry::default();
        vehicle.update(&attitude(1_000));
        assert!(heading_error_deg(&vehicle, heading_deg(1_000)) < 0.05);
        vehicle.update(&position(1_100));
        vehicle.update(&attitude(1_200));
        // It has no place, and the stamp is that of the attitude.
        vehicle.gps_fix = Some(false);
        assert!(heading_error_deg(&vehicle, heading_deg(1_200)) < 0.05);
        vehicle.gps_fix = Some(true);
        assert!(heading_error_deg(&vehicle, heading_deg(1_100)) < 0.05);
        vehicle.restart();
        vehicle.update(&position(100));
        assert!(heading_error_deg(&vehicle, heading_deg(1_200)) < 0.05);
    }
}
