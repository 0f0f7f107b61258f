//! What a 2016 asks of PX4, or why PX4 cannot do it.
//!
//! A field that is absent is not commanded. So are the values that a full presence vector carries for "nothing": an
//! altitude or heading command type 0, speed 0, waypoint 0, and a loiter position of exactly 0, 0.

use std::ops::RangeInclusive;

use mapping::altitude::{self, Agl, Altimeter, Level};
use mapping::curve::Curving;
use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mapping::route::{self, Limits, Site};
use mapping::telemetry::Telemetry;
use mavlink_link::dialect::MissionState;
use stanag_msgs::enums::{
    AltitudeCommandType, FlightPathControlMode as Mode, HeadingCommandType, LoiterDirection,
    RouteType, SpeedType,
};
use stanag_msgs::messages::{LoiterConfiguration, VehicleOperatingModeCommand};

use super::loiter::circle;
use super::maneuver::{self, Step};
use super::plan_record::Aboard;
use super::steering::{self, Vertical};

/// What is to be done.
#[derive(Debug)]
pub(crate) enum Task {
    /// These steps; then this is what 3002 reports as commanded.
    Steps(Vec<Step>, Commanded),
    /// A launch: its steps, undone by disarming when it fails on the ground.
    Launch(Vec<Step>, Commanded),
    /// The route of this type must first go aboard, then the command is looked at again.
    Load(RouteType),
    /// What 13000 has loaded must first go aboard again, then the command is looked at again.
    Reload,
    /// Manual flight: sticks, then the mode.
    Manual,
    /// Steering: set points, then the mode.
    Steer(steering::Order, Commanded),
}

impl Task {
    /// Whether a route is flown for it.
    pub(crate) fn flies_a_route(&self) -> bool {
        match self {
            Task::Load(_) | Task::Reload => true,
            Task::Steps(steps, _) | Task::Launch(steps, _) => {
                maneuver::enters(steps, Px4Mode::MISSION)
            }
            Task::Manual | Task::Steer(..) => false,
        }
    }
}

/// What must be known to decide.
#[derive(Debug, Clone)]
pub(crate) struct Situation<'a> {
    pub(crate) telemetry: &'a Telemetry,
    pub(crate) aboard: Option<&'a Aboard>,
    /// What 13000 has loaded last.
    pub(crate) chosen: Option<&'a Aboard>,
    /// The types of the routes that the plan holds.
    pub(crate) routes: &'a [RouteType],
    pub(crate) loiter: &'a LoiterConfiguration,
    pub(crate) commanded: Commanded,
    pub(crate) agl: Agl,
    pub(crate) altimeter: Altimeter,
    pub(crate) limits: Limits,
    /// What Commanded Speed may be, m/s.
    pub(crate) speeds: RangeInclusive<f64>,
}

/// The mode that a command is about: its own, or the present one where it names none.
pub(crate) fn mode_of(
    command: &VehicleOperatingModeCommand,
    telemetry: &Telemetry,
) -> Option<Mode> {
    command
        .select_flight_path_control_mode
        .filter(|mode| *mode != Mode::NoMode)
        .or_else(|| telemetry.mode.map(Px4Mode::reported))
}

fn steps_to_waypoint(command: &VehicleOperatingModeCommand) -> bool {
    command
        .commanded_waypoint_number
        .is_some_and(|number| number != 0)
}

fn names_mode(command: &VehicleOperatingModeCommand) -> bool {
    command
        .select_flight_path_control_mode
        .is_some_and(|mode| mode != Mode::NoMode)
}

/// Whether no mode, altitude, speed, heading, place or waypoint is commanded: nothing is to be flown otherwise.
fn names_nothing(command: &VehicleOperatingModeCommand) -> bool {
    let angles = [
        command.loiter_position_latitude,
        command.loiter_position_longitude,
    ];
    altitude(command).is_none()
        && command
            .commanded_vertical_speed
            .is_none_or(|rate| rate.si() == 0.0)
        && command
            .commanded_speed
            .is_none_or(|speed| speed.si() == 0.0)
        && command
            .heading_command_type
            .is_none_or(|kind| kind == HeadingCommandType::None)
        && !steps_to_waypoint(command)
        && angles
            .iter()
            .all(|angle| angle.is_none_or(|angle| angle.degrees() == 0.0))
}

/// Decides.
///
/// # Errors
/// The reason, for the operator.
pub(crate) fn task(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Task, String> {
    let mode = mode_of(command, at.telemetry)
        .ok_or("no mode is commanded, and the vehicle has told none")?;
    if !names_mode(command) {
        if names_nothing(command) {
            // A setting that is kept, such as the altimeter's.
            return Ok(Task::Steps(Vec::new(), at.commanded));
        }
        if !matches!(mode, Mode::Waypoint | Mode::Loiter | Mode::Autopilot) {
            return Err(format!(
                "no mode is commanded, and in the present one, {}, nothing can be changed",
                mode.raw()
            ));
        }
    }
    if let Some(heading) = command.heading_command_type
        && heading != HeadingCommandType::None
        && mode != Mode::Autopilot
    {
        return Err(format!(
            "heading commands are not flown in mode {}",
            mode.raw()
        ));
    }
    match mode {
        Mode::Waypoint => waypoint(command, at),
        Mode::Loiter => loiter(command, at),
        Mode::Launch => launch(command, at),
        Mode::AutolandEngage if at.telemetry.airborne() && has(RouteType::Approach, at) => {
            fly(command, RouteType::Approach, at)
        }
        Mode::AutolandEngage => Ok(plain(&[Px4Mode::LAND], at)),
        Mode::ContingencyA => contingency(command, RouteType::ContingencyA, &[Px4Mode::RTL], at),
        Mode::ContingencyB => contingency(command, RouteType::ContingencyB, &[Px4Mode::LAND], at),
        // A multicopter that lands is stopped where it is; DO_GO_AROUND is for wings.
        Mode::AutolandWaveOff if at.telemetry.mode == Some(Px4Mode::LAND) => {
            Ok(plain(&[Px4Mode::LOITER], at))
        }
        Mode::AutolandWaveOff if at.telemetry.hovers() => Err(
            "mode 20 (wave-off): the vehicle is not landing, there is nothing to break off"
                .to_owned(),
        ),
        Mode::FlightDirector => Ok(Task::Manual),
        Mode::Autopilot => steer(command, at),
        other => Err(format!("mode {}: PX4 cannot do that", other.raw())),
    }
}

fn plain(modes: &'static [Px4Mode], at: &Situation<'_>) -> Task {
    let commanded = if at.telemetry.mode.is_some_and(|mode| modes.contains(&mode)) {
        at.commanded
    } else {
        Commanded::default()
    };
    Task::Steps(maneuver::enter(modes).into(), commanded)
}

fn contingency(
    command: &VehicleOperatingModeCommand,
    route: RouteType,
    otherwise: &'static [Px4Mode],
    at: &Situation<'_>,
) -> Result<Task, String> {
    if has(route, at) {
        fly(command, route, at)
    } else {
        Ok(plain(otherwise, at))
    }
}

/// Whether the plan holds a route of this type.
fn has(route: RouteType, at: &Situation<'_>) -> bool {
    at.routes.contains(&route)
}

fn waypoint(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Task, String> {
    if altitude(command).is_some() {
        return Err(
            "mode 11 flies the altitudes of the route; command another in mode 12".to_owned(),
        );
    }
    if at.aboard.is_none() && at.chosen.is_none() {
        return Err("mode 11: no route has been loaded (13000)".to_owned());
    }
    fly(command, RouteType::Flight, at)
}

fn fly(
    command: &VehicleOperatingModeCommand,
    route: RouteType,
    at: &Situation<'_>,
) -> Result<Task, String> {
    let aboard = match at.aboard {
        Some(aboard) if serves(aboard, route, at) && holds(at.telemetry, aboard) => aboard,
        // Another route went aboard for another mode: what 13000 has loaded comes back.
        _ if route == RouteType::Flight && at.chosen.is_some() && at.chosen != at.aboard => {
            return Ok(Task::Reload);
        }
        // Mode 11 flies what 13000 has loaded, never what has been stored since.
        _ if route == RouteType::Flight => {
            return Err(
                "mode 11: the loaded route is not aboard any more; load it again (13000)"
                    .to_owned(),
            );
        }
        _ => return Ok(Task::Load(route)),
    };
    let speed = speed(command, at)?;
    let mut steps = Vec::new();
    let number = command
        .commanded_waypoint_number
        .filter(|number| *number != 0);
    let start = match number {
        Some(number) => Some(
            aboard
                .flight
                .first_item_of(number)
                .ok_or_else(|| format!("waypoint {number} is not in the route aboard"))?,
        ),
        None => flies_anew(command, at.telemetry).then_some(0),
    };
    steps.extend(start.map(|seq| Step::SetCurrent(seq..=aboard.flight.place_from(seq))));
    let enters = at.telemetry.mode != Some(Px4Mode::MISSION);
    if enters || start.is_some() {
        steps.extend(maneuver::enter(&[Px4Mode::MISSION]));
    }
    let mut commanded = if enters {
        Commanded::default()
    } else {
        at.commanded
    };
    if let Some(speed_m_s) = speed {
        // After the mode: entering one takes PX4 back to its own speed.
        steps.push(maneuver::change_speed(speed_m_s));
        commanded.speed_m_s = Some(speed_m_s);
        commanded.speed_type = Some(flown_as(at.telemetry));
    }
    Ok(Task::Steps(steps, commanded))
}

/// Whether a route that has been flown to its end is flown again from its start: where the mode is commanded, and no
/// waypoint.
pub(crate) fn flies_anew(command: &VehicleOperatingModeCommand, vehicle: &Telemetry) -> bool {
    let complete = vehicle
        .mission
        .is_some_and(|mission| mission.state == MissionState::MISSION_STATE_COMPLETE);
    complete && names_mode(command) && !steps_to_waypoint(command)
}

/// Whether a route aboard is the one that is to be flown: mode 11 flies what 13000 has loaded, but for contingency routes.
fn serves(aboard: &Aboard, wanted: RouteType, at: &Situation<'_>) -> bool {
    if wanted == RouteType::Flight {
        let contingency = [RouteType::ContingencyA, RouteType::ContingencyB];
        !contingency.contains(&aboard.route_type) && at.chosen.is_none_or(|chosen| chosen == aboard)
    } else {
        aboard.route_type == wanted
    }
}

/// Whether the vehicle itself names the route that was loaded as its mission: another station may have changed it.
fn holds(vehicle: &Telemetry, aboard: &Aboard) -> bool {
    aboard.mission_id == 0
        || vehicle
            .mission
            .is_some_and(|mission| mission.mission_id == aboard.mission_id)
}

fn loiter(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Task, String> {
    let speed = speed(command, at)?;
    let place = place(command, at)?;
    let level = match altitude(command) {
        Some(metres) => Some(checked_level(metres, command, at)?),
        None => None,
    };
    if let (None, Some(kind)) = (level, command.altitude_command_type)
        && !matches!(
            kind,
            AltitudeCommandType::None | AltitudeCommandType::Altitude
        )
    {
        return Err(format!(
            "mode 12: Altitude Command Type {} is not flown; a vertical speed needs mode 15",
            kind.raw()
        ));
    }
    let loiters = at.telemetry.mode.map(Px4Mode::reported) == Some(Mode::Loiter);
    let mut commanded = if loiters {
        at.commanded
    } else {
        Commanded::default()
    };
    let mut steps = Vec::new();
    let mut flown = speed;
    if place.is_none() && level.is_none() {
        if !names_mode(command) && steps_to_waypoint(command) {
            return Err("a commanded waypoint needs mode 11".to_owned());
        }
        match speed {
            // PX4 heeds no other speed on a circle than that of DO_ORBIT.
            Some(speed_m_s) if at.telemetry.mode == Some(Px4Mode::ORBIT) => {
                steps.extend(faster_or_slower(speed_m_s, at)?);
                flown = None;
                commanded.speed_m_s = Some(speed_m_s);
                commanded.speed_type = Some(flown_as(at.telemetry));
            }
            Some(_) if loiters => {}
            _ if names_mode(command) => {
                steps.extend(maneuver::enter(&[Px4Mode::LOITER]));
                commanded = Commanded::default();
            }
            _ => {}
        }
    } else {
        if !at.telemetry.airborne() {
            return Err("a loiter position or altitude needs an airborne vehicle".to_owned());
        }
        let present = at
            .telemetry
            .position
            .ok_or("the vehicle has told no position yet")?;
        let home = at.telemetry.home.ok_or("home is not known yet")?;
        let amsl_m = level.map_or(present.amsl_m, |level| level.amsl(home.amsl_m));
        let hovers = at.telemetry.hovers();
        match (place, circle(at.loiter, hovers)?) {
            (Some(place), Some(radius_m)) => {
                let turn = match at.loiter.loiter_direction {
                    Some(LoiterDirection::CounterClockwise) => -radius_m,
                    _ => radius_m,
                };
                if hovers {
                    within_the_circle(speed, radius_m)?;
                    flown = None;
                    commanded.speed_m_s = speed;
                    commanded.speed_type = speed.map(|_| SpeedType::Ground);
                }
                steps.extend(maneuver::orbit(place, amsl_m, turn, speed, hovers));
            }
            _ => steps.extend(maneuver::reposition(place, amsl_m, None)),
        }
        commanded.altitude_amsl_m = Some(amsl_m);
        commanded.loiter_position = place;
    }
    if let Some(speed_m_s) = flown {
        steps.push(maneuver::change_speed(speed_m_s));
        commanded.speed_m_s = Some(speed_m_s);
        commanded.speed_type = Some(flown_as(at.telemetry));
    }
    Ok(Task::Steps(steps, commanded))
}

/// The circle that is flown, at another speed.
fn faster_or_slower(speed_m_s: f64, at: &Situation<'_>) -> Result<Vec<Step>, String> {
    let orbit = at
        .telemetry
        .orbit
        .ok_or("the vehicle has not told the circle that it flies")?;
    within_the_circle(Some(speed_m_s), orbit.radius_m.abs())?;
    let centre = (orbit.centre.latitude, orbit.centre.longitude);
    let amsl_m = orbit.centre.amsl_m;
    let mut steps = maneuver::orbit(centre, amsl_m, orbit.radius_m, Some(speed_m_s), true);
    steps.push(maneuver::shows_speed(speed_m_s));
    Ok(steps)
}

/// PX4 flies a circle more slowly than told where it would be drawn outward by more than it allows.
fn within_the_circle(speed_m_s: Option<f64>, radius_m: f64) -> Result<(), String> {
    let most_m_s = (MOST_INWARD_M_S2 * radius_m).sqrt();
    match speed_m_s {
        Some(speed_m_s) if speed_m_s > most_m_s => Err(format!(
            "speed {speed_m_s:.1} m/s on a circle of {radius_m:.0} m, at most {most_m_s:.1}"
        )),
        _ => Ok(()),
    }
}

fn launch(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Task, String> {
    if at.telemetry.airborne() {
        return Err("mode 21: the vehicle is in the air already".to_owned());
    }
    let route = has(RouteType::Launch, at);
    if route && !at.telemetry.hovers() {
        return Err("mode 21: the launch route of a fixed wing is not flown; delete it".to_owned());
    }
    let metres = altitude(command).ok_or("mode 21 needs a commanded altitude to take off to")?;
    let level = checked_level(metres, command, at)?;
    let home = at.telemetry.home.ok_or("mode 21: home is not known yet")?;
    let amsl_m = level.amsl(home.amsl_m);
    let height_m = amsl_m - home.amsl_m;
    if height_m < LOWEST_LAUNCH_M {
        return Err(format!(
            "mode 21: {height_m:.1} m above home, expected at least {LOWEST_LAUNCH_M} m"
        ));
    }
    let commanded = Commanded {
        altitude_amsl_m: Some(amsl_m),
        ..Commanded::default()
    };
    let mut steps = maneuver::launch(amsl_m);
    if route {
        match at.aboard {
            Some(aboard)
                if aboard.route_type == RouteType::Launch && holds(at.telemetry, aboard) =>
            {
                steps.push(Step::SetCurrent(0..=aboard.flight.place_from(0)));
                steps.extend(maneuver::enter(&[Px4Mode::MISSION]));
            }
            _ => return Ok(Task::Load(RouteType::Launch)),
        }
    }
    Ok(Task::Launch(steps, commanded))
}

fn steer(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Task, String> {
    if !at.telemetry.hovers() {
        return Err("mode 15: PX4 steers a fixed wing by no set points of speed".to_owned());
    }
    if !at.telemetry.airborne() {
        return Err("mode 15 needs an airborne vehicle".to_owned());
    }
    let rate = command.commanded_vertical_speed.map(|rate| rate.si());
    let altitude_m = command.commanded_altitude.map(|altitude| altitude.si());
    let mut commanded = at.commanded;
    let vertical = match command.altitude_command_type {
        Some(AltitudeCommandType::None) => None,
        None if altitude_m.is_none() => None,
        Some(AltitudeCommandType::VerticalSpeed) => {
            commanded.altitude_amsl_m = None;
            Some(Vertical::Rate(
                rate.ok_or("mode 15: Commanded Vertical Speed is missing")?,
            ))
        }
        None | Some(AltitudeCommandType::Altitude | AltitudeCommandType::RateLimitedAltitude) => {
            let home = at.telemetry.home.ok_or("home is not known yet")?;
            let metres = altitude_m.ok_or("mode 15: Commanded Altitude is missing")?;
            let amsl_m = level(metres, command, at)?.amsl(home.amsl_m);
            commanded.altitude_amsl_m = Some(amsl_m);
            let limited =
                command.altitude_command_type == Some(AltitudeCommandType::RateLimitedAltitude);
            let most_m_s = rate.filter(|rate| limited && *rate != 0.0);
            Some(Vertical::Altitude {
                amsl_m,
                most_m_s: most_m_s.map_or(steering::CLIMB_M_S, f64::abs),
            })
        }
        Some(other) => {
            return Err(format!(
                "Altitude Command Type {} is not known",
                other.raw()
            ));
        }
    };
    let order = steering::Order {
        speed_m_s: speed(command, at)?,
        direction: steering::direction(command)?,
        vertical,
    };
    if order.speed_m_s.is_some() {
        commanded.speed_m_s = order.speed_m_s;
        commanded.speed_type = Some(SpeedType::Ground);
    }
    commanded.loiter_position = None;
    Ok(Task::Steer(order, commanded))
}

fn altitude(command: &VehicleOperatingModeCommand) -> Option<f64> {
    match command.altitude_command_type {
        Some(AltitudeCommandType::None) => None,
        _ => command.commanded_altitude.map(|altitude| altitude.si()),
    }
}

fn checked_level(
    metres: f64,
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Level, String> {
    match command.altitude_command_type {
        None | Some(AltitudeCommandType::Altitude) => {}
        Some(other) => {
            return Err(format!(
                "Altitude Command Type {} is not flown, only 1 (altitude)",
                other.raw()
            ));
        }
    }
    level(metres, command, at)
}

/// An altitude as it is flown, within the limits.
fn level(
    metres: f64,
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Level, String> {
    let (geoid_m, agl, altimeter) = (at.telemetry.geoid_m, at.agl, at.altimeter);
    let level = altitude::level(metres, command.altitude_type, geoid_m, agl, altimeter)
        .map_err(|fault| fault.to_string())?;
    let site = Site {
        home: at.telemetry.home.ok_or("home is not known yet")?,
        geoid_m,
        agl,
        altimeter,
        hovers: at.telemetry.hovers(),
        limits: at.limits,
        curving: Curving::default(),
    };
    route::height(level, &site).map_err(|fault| fault.to_string())?;
    Ok(level)
}

fn place(
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
        .ok_or("the vehicle has told no position yet")?;
    let distance_m = route::metres((from.latitude, from.longitude), (latitude, longitude));
    if distance_m > at.limits.leg_m {
        return Err(format!(
            "loiter position {distance_m:.0} m away, at most {:.0}",
            at.limits.leg_m
        ));
    }
    Ok(Some((latitude, longitude)))
}

fn speed(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Option<f64>, String> {
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
    if !at.speeds.contains(&speed_m_s) {
        return Err(format!(
            "speed {speed_m_s:.1} m/s, expected {:.1} to {:.1}",
            at.speeds.start(),
            at.speeds.end()
        ));
    }
    match command.speed_type {
        None | Some(SpeedType::Ground | SpeedType::Indicated | SpeedType::True) => {
            Ok(Some(speed_m_s))
        }
        Some(other) => Err(format!("Speed Type {} is not flown", other.raw())),
    }
}

/// What a speed is flown as, whatever type it was commanded as: PX4 takes the speed of a multicopter over ground and that
/// of a fixed wing through the air.
fn flown_as(vehicle: &Telemetry) -> SpeedType {
    if vehicle.hovers() {
        SpeedType::Ground
    } else {
        SpeedType::Indicated
    }
}

/// What PX4 allows toward the centre of a circle, m/s2.
const MOST_INWARD_M_S2: f64 = 2.0;
/// PX4 does not leave the ground for less, m.
const LOWEST_LAUNCH_M: f64 = 1.5;
