//! Mode 12: here or at a place, at an altitude, hovering or on a circle.

use mapping::altitude::Level;
use mapping::limits::metres;
use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use stanag_msgs::enums::{
    AltitudeCommandType, FlightPathControlMode as Mode, LoiterDirection, SpeedType,
};
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::values::{altitude, checked_level, flown_as, speed};
use super::{Situation, Task, names_mode, steps_to_waypoint};
use crate::session::loiter::circle;
use crate::session::maneuver::{self, Step};

/// What a loiter has come to so far.
struct Draft {
    steps: Vec<Step>,
    commanded: Commanded,
    /// The speed that is still to be commanded by itself, m/s.
    speed_m_s: Option<f64>,
}

pub(super) fn loiter(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Task, String> {
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
    let mut draft = Draft {
        steps: Vec::new(),
        commanded: if loiters {
            at.commanded
        } else {
            Commanded::default()
        },
        speed_m_s: speed,
    };
    if place.is_none() && level.is_none() {
        stay(&mut draft, command, loiters, at)?;
    } else {
        go(&mut draft, place, level, at)?;
    }
    let Draft {
        mut steps,
        mut commanded,
        speed_m_s,
    } = draft;
    if let Some(speed_m_s) = speed_m_s {
        steps.push(maneuver::change_speed(speed_m_s));
        commanded.speed_m_s = Some(speed_m_s);
        commanded.speed_type = Some(flown_as(at.telemetry));
    }
    Ok(Task::Steps(steps, commanded))
}

/// Where it is, at its altitude.
fn stay(
    draft: &mut Draft,
    command: &VehicleOperatingModeCommand,
    loiters: bool,
    at: &Situation<'_>,
) -> Result<(), String> {
    if !names_mode(command) && steps_to_waypoint(command) {
        return Err("a commanded waypoint needs mode 11".to_owned());
    }
    match draft.speed_m_s {
        // PX4 heeds no other speed on a circle than that of DO_ORBIT.
        Some(speed_m_s) if at.telemetry.mode == Some(Px4Mode::ORBIT) => {
            draft.steps.extend(faster_or_slower(speed_m_s, at)?);
            draft.speed_m_s = None;
            draft.commanded.speed_m_s = Some(speed_m_s);
            draft.commanded.speed_type = Some(flown_as(at.telemetry));
        }
        Some(_) if loiters => {}
        _ if names_mode(command) => {
            draft.steps.extend(maneuver::enter(&[Px4Mode::LOITER]));
            draft.commanded = Commanded::default();
        }
        _ => {}
    }
    Ok(())
}

/// At another place, or at another altitude.
fn go(
    draft: &mut Draft,
    place: Option<(f64, f64)>,
    level: Option<Level>,
    at: &Situation<'_>,
) -> Result<(), String> {
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
            let speed = draft.speed_m_s;
            if hovers {
                within_the_circle(speed, radius_m)?;
                draft.speed_m_s = None;
                draft.commanded.speed_m_s = speed;
                draft.commanded.speed_type = speed.map(|_| SpeedType::Ground);
            }
            let steps = maneuver::orbit(place, amsl_m, turn, speed, hovers);
            draft.steps.extend(steps);
        }
        _ => {
            let steps = maneuver::reposition(place, amsl_m, None);
            draft.steps.extend(steps);
        }
    }
    draft.commanded.altitude_amsl_m = Some(amsl_m);
    draft.commanded.loiter_position = place;
    Ok(())
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
    let most_m_s = (MAX_INWARD_M_S2 * radius_m).sqrt();
    match speed_m_s {
        Some(speed_m_s) if speed_m_s > most_m_s => Err(format!(
            "speed {speed_m_s:.1} m/s on a circle of {radius_m:.0} m, at most {most_m_s:.1}"
        )),
        _ => Ok(()),
    }
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
    let distance_m = metres((from.latitude, from.longitude), (latitude, longitude));
    if distance_m > at.limits.leg_m {
        return Err(format!(
            "loiter position {distance_m:.0} m away, at most {:.0}",
            at.limits.leg_m
        ));
    }
    Ok(Some((latitude, longitude)))
}

/// What PX4 allows toward the centre of a circle, m/s2.
const MAX_INWARD_M_S2: f64 = 2.0;
