//! The situation in which a 2016 is decided, its possible results, and the checks of its values.
//!
//! An absent field is not commanded. The same applies to the values that mean "nothing" in a full presence vector: an
//! altitude or heading command type 0, speed 0, waypoint 0, and a loiter position of exactly 0, 0.

use curve_paths::terrain::Terrain;
use mapping::altitude::{Agl, Altimeter, Datum, Level};
use mapping::area::{Area, Areas};
use mapping::limits::{Limits, Performance, metres};
use mapping::mode::Px4Mode;
use mapping::plan::Plan;
use mapping::report::Commanded;
use mapping::route::Wings;
use mapping::telemetry::Telemetry;
use stanag_msgs::enums::{
    AltitudeCommandType, FlightPathControlMode as Mode, RouteType, SpeedType,
};
use stanag_msgs::messages::{LoiterConfiguration, VehicleOperatingModeCommand};

use super::steering;
use crate::session::maneuver::{self, Step};
use crate::session::mission::progress::RouteProgress;
use crate::session::mission::record::UploadedMission;

/// The result of a 2016.
#[derive(Debug)]
pub(crate) enum Task {
    /// Nothing is sent to the vehicle, which continues as before.
    Nothing,
    /// These steps; then 3002 reports these values as commanded.
    Steps(Vec<Step>, Commanded),
    /// A launch: if its steps fail on the ground, the vehicle is disarmed.
    Launch(Vec<Step>, Commanded),
    /// The route of this type must be uploaded first; then the command is decided again.
    Load(RouteType),
    /// The route that 13000 loaded must be uploaded again first; then the command is decided again.
    Reload,
    /// Manual flight: sticks, then the mode.
    Manual,
    /// Steering: set points, then the mode.
    Steer(steering::Order, Commanded),
}

impl Task {
    /// Whether it flies a route, with a vehicle in the mode `now`.
    pub(crate) fn flies_a_route(&self, now: Option<Px4Mode>) -> bool {
        match self {
            Task::Load(_) | Task::Reload => true,
            Task::Steps(steps, _) | Task::Launch(steps, _) => {
                maneuver::mode_after(steps, now) == Some(Px4Mode::MISSION)
            }
            Task::Nothing | Task::Manual | Task::Steer(..) => false,
        }
    }

    /// Whether its steps lead to a commanded altitude.
    pub(crate) fn climbs(&self) -> bool {
        matches!(self, Task::Steps(_, commanded) if commanded.altitude_amsl_m.is_some())
    }
}

/// The input for deciding a 2016.
#[derive(Debug, Clone)]
pub(crate) struct Situation<'a> {
    pub(crate) telemetry: &'a Telemetry,
    pub(crate) uploaded: Option<&'a UploadedMission>,
    /// Why the vehicle does not fly that, where it finds it infeasible.
    pub(crate) infeasible: Option<String>,
    /// How far that has been flown.
    pub(crate) progress: &'a RouteProgress,
    /// The route that 13000 last loaded.
    pub(crate) loaded: Option<&'a UploadedMission>,
    /// The stored plan.
    pub(crate) plan: &'a Plan,
    /// The fence: the areas of the configuration and those loaded by 50017.
    pub(crate) fence: (&'a [Area], &'a Areas),
    /// Why the vehicle does not hold it, where it could not be uploaded.
    pub(crate) unfenced: Option<&'a str>,
    /// The route has just been uploaded for this command.
    pub(crate) just_loaded: bool,
    /// The command repeats one that was carried out.
    pub(crate) repeats: bool,
    /// What of earlier commands the vehicle may not show yet.
    pub(crate) under_way: UnderWay,
    /// Where AUTO.LAND began, m above mean sea level.
    pub(crate) landing_from_m: Option<f64>,
    pub(crate) loiter: &'a LoiterConfiguration,
    pub(crate) commanded: Commanded,
    pub(crate) agl: Agl,
    pub(crate) altimeter: Altimeter,
    pub(crate) limits: Limits,
    /// Terrain and site data for checks, if configured.
    pub(crate) terrain: Option<&'a Terrain>,
    /// The limits in its present state.
    pub(crate) performance: Performance,
    /// The limits along a route: for a VTOL, on its wings.
    pub(crate) route_performance: Performance,
    /// Its wings; `None` for a multicopter.
    pub(crate) wings: Option<Wings>,
    /// VTO_LOITER_ALT: how high above its take-off a VTOL loiters after a launch, m.
    pub(crate) vtol_loiter_m: Option<f64>,
}

/// Earlier commands whose effect the vehicle may not report yet: its reports are up to a second old, and older on a bad
/// link. Decisions based only on reports would be wrong while a command is taking effect: a mode command would be skipped
/// because the vehicle seems to be in that mode already, or a wave-off refused because it does not seem to be landing.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct UnderWay {
    /// A command that enters a mode is being carried out.
    pub(crate) enters: bool,
    /// The last report of the mode is older than the last command that may have changed it, whether that succeeded or not.
    pub(crate) unseen: bool,
    /// A command is being carried out: the vehicle may not show yet where that leads.
    pub(crate) acts: bool,
    /// A landing is being entered, or waits for its route.
    pub(crate) lands: bool,
    /// The mission item that the vehicle is being sent to.
    pub(crate) item: Option<u16>,
    /// A VTOL is in transition.
    pub(crate) turns: bool,
}

impl Situation<'_> {
    /// The data for converting altitudes.
    pub(super) fn datum(&self) -> Datum<'_> {
        Datum {
            geoid_m: self.telemetry.geoid_m,
            agl: self.agl,
            altimeter: self.altimeter,
            terrain: self.terrain,
        }
    }

    /// The vehicle's position, degrees north and east.
    ///
    /// # Errors
    /// It has not reported it.
    pub(super) fn here(&self) -> Result<(f64, f64), String> {
        let place = self.telemetry.position;
        let place = place.ok_or("the vehicle has not reported a position yet")?;
        Ok((place.latitude, place.longitude))
    }

    /// The vehicle's mode; `None` while another is or may be being entered.
    pub(crate) fn settled_mode(&self) -> Option<Px4Mode> {
        let settled = !self.under_way.enters && !self.under_way.unseen;
        self.telemetry.mode.filter(|_| settled)
    }

    /// Whether another current item is, or may be, a jump within AUTO.MISSION: PX4 repeats the route's speed when it enters that mode,
    /// but keeps the present one on a jump.
    pub(super) fn may_jump(&self) -> bool {
        let mode = self.settled_mode();
        mode.is_none_or(|mode| mode == Px4Mode::MISSION)
    }
}

/// The mode of a command: the commanded one, or the present one if it names none.
pub(crate) fn mode_of(
    command: &VehicleOperatingModeCommand,
    telemetry: &Telemetry,
) -> Option<Mode> {
    command
        .select_flight_path_control_mode
        .filter(|mode| *mode != Mode::NoMode)
        .or_else(|| telemetry.mode.map(Px4Mode::reported))
}

pub(super) fn steps_to_waypoint(command: &VehicleOperatingModeCommand) -> bool {
    command
        .commanded_waypoint_number
        .is_some_and(|number| number != 0)
}

pub(super) fn names_mode(command: &VehicleOperatingModeCommand) -> bool {
    command
        .select_flight_path_control_mode
        .is_some_and(|mode| mode != Mode::NoMode)
}

/// Whether the plan holds a route of this type.
pub(super) fn has(route: RouteType, at: &Situation<'_>) -> bool {
    at.plan.route_of_type(route).is_some()
}

/// Commanded Altitude, if any, m in the reference of its type.
pub(super) fn altitude(command: &VehicleOperatingModeCommand) -> Option<f64> {
    match command.altitude_command_type {
        Some(AltitudeCommandType::None) => None,
        _ => command.commanded_altitude.map(|altitude| altitude.si()),
    }
}

/// An altitude to fly at over these places, within the limits.
///
/// # Errors
/// The command is of another kind than a plain altitude, or beyond the limits.
pub(super) fn checked_level(
    metres: f64,
    command: &VehicleOperatingModeCommand,
    over: &[(f64, f64)],
    at: &Situation<'_>,
) -> Result<Level, String> {
    match command.altitude_command_type {
        None | Some(AltitudeCommandType::Altitude) => {}
        Some(other) => {
            return Err(format!(
                "Altitude Command Type {} ({other}) is not flown, only 1 (altitude)",
                other.raw()
            ));
        }
    }
    level(metres, command, over, at)
}

/// An altitude as it is flown over these places, within the limits.
pub(super) fn level(
    metres: f64,
    command: &VehicleOperatingModeCommand,
    over: &[(f64, f64)],
    at: &Situation<'_>,
) -> Result<Level, String> {
    let datum = at.datum();
    let level = datum.level(metres, command.altitude_type, over.iter().copied());
    let level = level.map_err(|fault| fault.to_string())?;
    let home = at.telemetry.home.ok_or("home is not known yet")?;
    let checked = at.limits.check_height(level, home.amsl_m);
    checked.map_err(|fault| fault.to_string())?;
    Ok(level)
}

/// Refuses a height above the ground for a steered vehicle: it would be converted with the ground at the place of the
/// command, while the ground differs wherever the vehicle is steered to.
///
/// # Errors
/// It is a height above the ground.
pub(super) fn does_not_follow_ground(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<(), String> {
    if at.datum().is_above_ground(command.altitude_type) {
        return Err(
            "mode 15 (autopilot): altitude type 2 (AGL) with vehicle.agl = \"terrain\": a vehicle that is steered does not follow the \
             ground; command an altitude above mean sea level, or fly a route"
                .to_owned(),
        );
    }
    Ok(())
}

/// Commanded Speed, if any, m/s.
///
/// # Errors
/// It is beyond the limits, or of a type that is not flown.
pub(super) fn speed(
    command: &VehicleOperatingModeCommand,
    performance: &Performance,
) -> Result<Option<f64>, String> {
    if command.speed_type == Some(SpeedType::Thrust)
        && command.thrust.is_some_and(|thrust| thrust > 0)
    {
        return Err("Speed Type 3 (thrust) is not flown".to_owned());
    }
    let Some(speed_m_s) = command
        .commanded_speed
        .map(|speed| speed.si())
        .filter(|speed| *speed > 0.0)
    else {
        return Ok(None);
    };
    let checked = performance.check(speed_m_s);
    let speed_m_s = checked.map_err(|fault| fault.to_string())?;
    match command.speed_type {
        None | Some(SpeedType::Ground | SpeedType::Indicated | SpeedType::True) => {
            Ok(Some(speed_m_s))
        }
        Some(other) => Err(format!("Speed Type {} ({other}) is not flown", other.raw())),
    }
}

/// The type of speed that is flown, whatever type was commanded: PX4 uses ground speed for a multicopter and air speed for a
/// fixed wing.
pub(super) fn flown_as(hovers: bool) -> SpeedType {
    if hovers {
        SpeedType::Ground
    } else {
        SpeedType::Indicated
    }
}

pub(super) fn plain(modes: &'static [Px4Mode], at: &Situation<'_>) -> Task {
    // PX4 forgets commanded speeds and altitudes when its mode changes.
    let commanded = if at.settled_mode().is_some_and(|mode| modes.contains(&mode)) {
        at.commanded
    } else {
        Commanded::default()
    };
    Task::Steps(maneuver::enter(modes).into(), commanded)
}

/// Checks that the vehicle does not find the route aboard infeasible, which this mode would fly. PX4 refuses AUTO.MISSION in the air
/// without this reason; on the ground it enters it, and a launch would fly no route. What the VSM commands by itself is followed by
/// another action, as where PX4 refuses it.
pub(super) fn check_feasible(mode: Mode, at: &Situation<'_>) -> Result<(), String> {
    match &at.infeasible {
        Some(why) => Err(format!("mode {}: {why}", mode.in_words())),
        None => Ok(()),
    }
}

/// Checks whether a route aboard is still above home: it was compiled for the home position at its load.
pub(super) fn check_heights(uploaded: &UploadedMission, at: &Situation<'_>) -> Result<(), String> {
    let home = at.telemetry.home.ok_or("home is not known yet")?;
    let (compiled, home_m) = (&uploaded.compiled, home.amsl_m);
    let mut checked = compiled.check_heights(home_m, &at.limits);
    // Heights above home move with home, and elevation files may have been configured since.
    if let Some(terrain) = at.terrain {
        let above = |()| compiled.check_terrain(home_m, &at.limits, terrain);
        checked = checked.and_then(above).map(|_| ());
    }
    checked.map_err(|fault| format!("the route aboard, from the present home: {fault}"))
}

/// Whether the vehicle reports the loaded route as its mission, since another station may have changed it. `None` if it has
/// not reported that yet: for a second after a silence, and longer on a bad link, its mission is unknown.
pub(super) fn holds(vehicle: &Telemetry, uploaded: &UploadedMission) -> Option<bool> {
    // The vehicle has no mission ids (ArduPilot), so there is nothing to compare.
    if uploaded.mission_id == 0 {
        return Some(true);
    }
    vehicle
        .mission
        .map(|mission| mission.mission_id == uploaded.mission_id)
}

/// The refusal of a command that depends on the mission, while the vehicle has not reported which mission it holds or its
/// current item.
pub(super) fn mission_not_reported(mode: &str) -> String {
    format!(
        "{mode}: the vehicle has not reported yet which mission it holds (MISSION_CURRENT): command it again in a second"
    )
}

pub(super) fn place(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Option<(f64, f64)>, String> {
    let (latitude, longitude) = match (
        command.loiter_position_latitude,
        command.loiter_position_longitude,
    ) {
        (None, None) => return Ok(None),
        (Some(latitude), Some(longitude)) => (latitude.degrees(), longitude.degrees()),
        _ => return Err("a loiter position needs latitude and longitude".to_owned()),
    };
    // The value that means no position in a full presence vector.
    if latitude == 0.0 && longitude == 0.0 {
        return Ok(None);
    }
    if !(-90.0..=90.0).contains(&latitude) {
        return Err(format!(
            "loiter latitude {latitude:.4} deg, expected -90 to 90"
        ));
    }
    let from = at
        .telemetry
        .position
        .ok_or("the vehicle has not reported a position yet")?;
    let distance_m = metres((from.latitude, from.longitude), (latitude, longitude));
    if distance_m > at.limits.leg_m {
        return Err(format!(
            "loiter position {distance_m:.0} m away, at most {:.0}",
            at.limits.leg_m
        ));
    }
    Ok(Some((latitude, longitude)))
}

/// Within this distance an altitude is reached without oscillation, m.
pub(super) const NEAR_M: f64 = 1.0;
