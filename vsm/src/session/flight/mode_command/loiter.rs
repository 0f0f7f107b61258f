//! Mode 12: a loiter here or at a place, at an altitude, hovering, on a circle or on a figure of eight.

use curve_paths::Position;
use mapping::altitude::Level;
use mapping::area::{circle_crossing, way_crossing};
use mapping::limits::{HeightError, disc, eight};
use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mapping::route::check_way;
use mapping::telemetry::Orbit;
use stanag_msgs::enums::{
    AltitudeCommandType, FlightPathControlMode as Mode, LoiterDirection, SpeedType,
};
use stanag_msgs::messages::{LoiterConfiguration, VehicleOperatingModeCommand};

use crate::session::flight::settings::{self, Pattern};
use crate::session::flight::situation::{
    Situation, Task, altitude, checked_level, flown_as, names_mode, place, speed, steps_to_waypoint,
};
use crate::session::flight::wings;
use crate::session::maneuver::{self, Away, Climb, Step};

/// A partly composed loiter.
struct Draft {
    steps: Vec<Step>,
    commanded: Commanded,
    /// The speed that still needs its own command, m/s.
    speed_m_s: Option<f64>,
    /// The command names the mode: the loiter uses the present configuration.
    restarts: bool,
    /// The circle of a multicopter that stays as it is.
    circle: Option<Orbit>,
}

/// Mode 12: here or at a place, at an altitude, hovering or on a circle.
pub(super) fn loiter(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Task, String> {
    let speed = speed(command, &at.performance)?;
    let place = place(command, at)?;
    let mut pattern = settings::pattern(at.loiter, at.telemetry.airframe())?;
    let (level, circle) = match altitude(command) {
        Some(metres) => {
            let circle = kept_circle(place, command, at)?;
            let centre = circle.map(|circle| (circle.centre.latitude, circle.centre.longitude));
            if let Some(circle) = circle {
                pattern = Pattern::Circle(circle.radius_m.abs());
            }
            let over = flown_over(place.or(centre), pattern, command, at)?;
            (Some(checked_level(metres, command, &over, at)?), circle)
        }
        None => (None, None),
    };
    if let (None, Some(kind)) = (level, command.altitude_command_type)
        && !matches!(
            kind,
            AltitudeCommandType::None | AltitudeCommandType::Altitude
        )
    {
        return Err(format!(
            "mode 12 (loiter): Altitude Command Type {} ({kind}) is not flown; a vertical speed needs mode 15 (autopilot)",
            kind.raw()
        ));
    }
    let loiters = at.settled_mode().map(Px4Mode::reported) == Some(Mode::Loiter);
    let mut draft = Draft {
        steps: Vec::new(),
        commanded: if loiters {
            at.commanded
        } else {
            Commanded::default()
        },
        speed_m_s: speed,
        restarts: names_mode(command),
        circle,
    };
    // A VTOL hovers or circles on its wings, as the loiter requires: it transitions first.
    let hovers = wings::transition_for(pattern, names_mode(command), at, &mut draft.steps)?;
    if place.is_none() && level.is_none() && !wings::circles_here(pattern, hovers, command) {
        stay(&mut draft, command, (loiters, hovers), at)?;
    } else {
        go(&mut draft, place, level, (pattern, hovers), at)?;
    }
    let Draft {
        mut steps,
        mut commanded,
        speed_m_s,
        ..
    } = draft;
    if let Some(speed_m_s) = speed_m_s {
        steps.push(maneuver::change_speed(speed_m_s, hovers));
        commanded.speed_m_s = Some(speed_m_s);
        commanded.speed_type = Some(flown_as(hovers));
    }
    Ok(Task::Steps(steps, commanded))
}

/// What a station is sent where a multicopter hovers although 2017 has configured a circle.
///
/// The mode without a place is how operators stop a vehicle: a circle around the present position would fly it away first.
pub(crate) fn hovers_instead(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Option<&'static str> {
    let named = command.select_flight_path_control_mode == Some(Mode::Loiter);
    let pattern = settings::pattern(at.loiter, at.telemetry.airframe());
    let circle = matches!(pattern, Ok(Pattern::Circle(_)));
    let here = matches!(place(command, at), Ok(None));
    (named && circle && here && at.wings.is_none())
        .then_some("2016: mode 12 (loiter) without a loiter position hovers here; the circle of 2017 needs a position")
}

/// What a station is sent where nothing has configured a loiter since this VSM was started: one of before a restart is not flown.
pub(crate) fn is_unconfigured(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Option<&'static str> {
    let named = command.select_flight_path_control_mode == Some(Mode::Loiter);
    if !named || *at.loiter != LoiterConfiguration::default() {
        return None;
    }
    if at.wings.is_some() {
        return Some(
            "2016: mode 12 (loiter) circles as the vehicle is set: no 2017 since the start of this VSM",
        );
    }
    // Without a place it hovers in any case.
    matches!(place(command, at), Ok(Some(_)))
        .then_some("2016: mode 12 (loiter) hovers: no 2017 since the start of this VSM")
}

/// The circle of a multicopter that an altitude alone leaves as it is, whatever 2017 has configured since: DO_REPOSITION
/// would end it.
fn kept_circle(
    place: Option<(f64, f64)>,
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Option<Orbit>, String> {
    if place.is_some() || names_mode(command) || at.settled_mode() != Some(Px4Mode::ORBIT) {
        return Ok(None);
    }
    flown_circle(at).map(Some)
}

/// The places that a loiter passes over, for a height above the ground: only that needs the vehicle's position.
pub(super) fn flown_over(
    place: Option<(f64, f64)>,
    pattern: Pattern,
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Vec<(f64, f64)>, String> {
    if !at.datum().is_above_ground(command.altitude_type) {
        return Ok(Vec::new());
    }
    let centre = match place {
        Some(place) => place,
        None => at.here()?,
    };
    let own_m = at.wings.map_or(0.0, |wings| wings.loiter_radius_m.abs());
    let radius_m = match pattern {
        Pattern::Hover => 0.0,
        Pattern::Own => own_m,
        Pattern::Circle(radius_m) => radius_m,
        // For any direction of its long axis.
        Pattern::FigureEight(shape) => settings::eight(shape, own_m)[0],
    };
    Ok(disc(centre, radius_m))
}

/// A loiter at the present position and altitude.
fn stay(
    draft: &mut Draft,
    command: &VehicleOperatingModeCommand,
    (loiters, hovers): (bool, bool),
    at: &Situation<'_>,
) -> Result<(), String> {
    let named = names_mode(command);
    if !named && steps_to_waypoint(command) {
        return Err("a commanded waypoint needs mode 11 (waypoint)".to_owned());
    }
    match draft.speed_m_s {
        // On a circle PX4 ignores any speed but that of DO_ORBIT.
        Some(speed_m_s) if at.settled_mode() == Some(Px4Mode::ORBIT) => {
            draft.steps.extend(faster_or_slower(speed_m_s, at)?);
            draft.speed_m_s = None;
            draft.commanded.speed_m_s = Some(speed_m_s);
            draft.commanded.speed_type = Some(flown_as(true));
        }
        Some(_) if loiters && !(named && flies_on(hovers, at)) => {}
        _ if named => {
            draft.steps.extend(hold(hovers, at));
            draft.commanded = Commanded::default();
        }
        _ => {}
    }
    Ok(())
}

/// The steps to a vehicle that stays where it is.
fn hold(hovers: bool, at: &Situation<'_>) -> Vec<Step> {
    let stops = flies_on(hovers, at);
    let mut steps = Vec::new();
    // On wings DO_REPOSITION without a place does not end PX4's course mode, which may be entered still.
    if !stops || !hovers {
        steps.extend(maneuver::enter(&[Px4Mode::LOITER]));
    }
    if stops {
        steps.extend(maneuver::stop(circle_m(hovers, at)));
    }
    steps
}

/// Whether the vehicle flies to a place or an altitude in AUTO.LOITER, or may do so: that mode, commanded once more, does not end it.
/// So may one that has reported no set point yet, as just after a start of the VSM or a lost link.
fn flies_on(hovers: bool, at: &Situation<'_>) -> bool {
    let on_its_way = || {
        let away = Away::of(at.telemetry, circle_m(hovers, at));
        away.is_none_or(|away| away.ground_m > 0.0 || away.height_m > 0.0)
    };
    match at.settled_mode() {
        _ if !at.telemetry.airborne() => false,
        Some(Px4Mode::LOITER) => at.under_way.acts || on_its_way(),
        Some(_) => false,
        // A command of before may still take effect, or has.
        None => true,
    }
}

/// The radius of the vehicle's own circles, m; 0 where it hovers.
fn circle_m(hovers: bool, at: &Situation<'_>) -> f64 {
    let wings = at.wings.as_ref().filter(|_| !hovers);
    wings.map_or(0.0, |wings| wings.loiter_radius_m.abs())
}

/// A loiter at another position or altitude.
fn go(
    draft: &mut Draft,
    place: Option<(f64, f64)>,
    level: Option<Level>,
    (pattern, hovers): (Pattern, bool),
    at: &Situation<'_>,
) -> Result<(), String> {
    if !at.telemetry.airborne() {
        return Err("a loiter position or altitude needs an airborne vehicle".to_owned());
    }
    let present = at
        .telemetry
        .position
        .ok_or("the vehicle has not reported a position yet")?;
    if let Some(place) = place {
        within_the_fence(place, pattern, hovers, at)?;
    }
    let centre = draft
        .circle
        .map(|circle| (circle.centre.latitude, circle.centre.longitude));
    let place = place.or(centre);
    let home = at.telemetry.home.ok_or("home is not known yet")?;
    // Without a commanded altitude the vehicle flies there at its present one, which may be below home after manual flight.
    let level = level.unwrap_or(Level::Amsl(present.amsl_m));
    if let Err(fault @ HeightError::BelowHome { .. }) = at.limits.check_height(level, home.amsl_m) {
        return Err(format!(
            "mode 12 (loiter) without an altitude: the present {fault}"
        ));
    }
    let amsl_m = level.amsl(home.amsl_m);
    if let Some(terrain) = at.terrain {
        let to = place.unwrap_or((present.latitude, present.longitude));
        let from = Position::new(present.latitude, present.longitude, present.amsl_m);
        let to = Position::new(to.0, to.1, amsl_m);
        check_way(from, to, &at.limits, terrain)
            .map_err(|fault| format!("mode 12 (loiter): {fault}"))?;
    }
    let here = (present.latitude, present.longitude);
    // If only an altitude is commanded, a loitering fixed wing keeps its circle.
    let keeps = place.is_none()
        && at.settled_mode() == Some(Px4Mode::LOITER)
        && draft.steps.is_empty()
        && !hovers;
    let keeps = keeps && !draft.restarts;
    match (place.or((!hovers).then_some(here)), pattern) {
        // DO_CHANGE_ALTITUDE would make a circle of an eight, with half its length as its radius (Navigator::run).
        _ if keeps => {
            let steps = maneuver::reposition(None, amsl_m, None);
            draft.steps.extend(steps);
        }
        (Some(place), Pattern::FigureEight(shape)) => {
            if let Some(wings) = &at.wings {
                let [half_m, radius_m, _] = settings::eight(shape, wings.loiter_radius_m.abs());
                if let Some(wanted_m) = shape[0].filter(|wanted_m| *wanted_m < half_m) {
                    return Err(format!(
                        "Loiter Type 3 (figure 8): Loiter Length {:.0} m, at least four times the vehicle's own radius of {radius_m:.0} m \
                         (NAV_LOITER_RAD), or configure a Loiter Radius (2017)",
                        2.0 * wanted_m
                    ));
                }
                if shape[1].is_some() {
                    wings::check_circle(wings, radius_m, draft.speed_m_s, at)?;
                }
            }
            draft
                .steps
                .extend(maneuver::figure_eight(place, amsl_m, shape));
        }
        (Some(place), Pattern::Circle(radius_m)) => {
            let turn = match (draft.circle, at.loiter.loiter_direction) {
                (Some(circle), _) => circle.radius_m,
                (None, Some(LoiterDirection::CounterClockwise)) => -radius_m,
                (None, _) => radius_m,
            };
            let kept = draft.circle.and(draft.commanded.speed_m_s);
            let speed = draft.speed_m_s.or(kept);
            if let Some(wings) = at.wings.as_ref().filter(|_| !hovers) {
                wings::check_circle(wings, radius_m, speed, at)?;
            }
            if hovers {
                // PX4 takes the speed on a multicopter's circle from DO_ORBIT only, so no DO_CHANGE_SPEED follows.
                within_the_circle(speed, radius_m)?;
                draft.speed_m_s = None;
                draft.commanded.speed_m_s = speed;
                draft.commanded.speed_type = speed.map(|_| SpeedType::Ground);
            }
            let flown = at.telemetry.orbit;
            let flown = flown.filter(|_| at.settled_mode() == Some(Px4Mode::ORBIT));
            let climb = Climb::on_the_same(flown, here, place, turn, amsl_m);
            let steps = maneuver::orbit(place, Some(amsl_m), turn, speed, hovers, climb);
            draft.steps.extend(steps);
        }
        _ => {
            if place.is_none() && draft.restarts && !hovers_here(at) {
                draft.steps.extend(hold(hovers, at));
            }
            // The speed follows by DO_CHANGE_SPEED: entering a mode takes PX4 back to its own.
            let steps = maneuver::reposition(place, amsl_m, None);
            draft.steps.extend(steps);
        }
    }
    draft.commanded.altitude_amsl_m = Some(amsl_m);
    // What stays where it is stays where it was commanded: the vehicle reports the place of its circle rounded.
    if !keeps && draft.circle.is_none() {
        draft.commanded.loiter_position = place;
    }
    Ok(())
}

/// Whether a multicopter hovers, at whatever altitude, so that another altitude is flown to where it is: elsewhere PX4 would fly on to
/// the place that it flies to.
fn hovers_here(at: &Situation<'_>) -> bool {
    let away = Away::of(at.telemetry, 0.0);
    at.settled_mode() == Some(Px4Mode::LOITER) && away.is_some_and(|away| away.ground_m == 0.0)
}

/// PX4 compares a place to hover at with its fence (DO_REPOSITION), but has left what it flew for a hold when it refuses it; and no circle
/// of a multicopter, of one or an eight on wings only the centre. A circle where the vehicle is already is flown: refusing it would not
/// stop the vehicle.
fn within_the_fence(
    place: (f64, f64),
    pattern: Pattern,
    hovers: bool,
    at: &Situation<'_>,
) -> Result<(), String> {
    let (configured, loaded) = at.fence;
    let areas = || loaded.numbered_with(configured);
    let circle = |radius_m: f64| {
        let crossing = circle_crossing(&areas(), place, radius_m);
        crossing.map(|crossing| format!("circle of {radius_m:.0} m {crossing}"))
    };
    let crossing = match (pattern, &at.wings) {
        (Pattern::Circle(radius_m), _) => circle(radius_m),
        (Pattern::Own, Some(wings)) if !hovers => circle(wings.loiter_radius_m.abs()),
        (Pattern::FigureEight(shape), Some(wings)) => {
            let own_m = wings.loiter_radius_m.abs();
            let [half_m, radius_m, bearing] = settings::eight(shape, own_m);
            let crossing = way_crossing(&areas(), &eight(place, half_m, radius_m, bearing));
            crossing.map(|crossing| format!("figure 8 of {:.0} m {crossing}", 2.0 * half_m))
        }
        _ => {
            let crossing = way_crossing(&areas(), &[place]);
            crossing.map(|crossing| format!("hover there {crossing}"))
        }
    };
    match crossing {
        Some(crossing) => Err(format!("mode 12 (loiter): the {crossing}")),
        None => Ok(()),
    }
}

/// The circle that a multicopter flies.
fn flown_circle(at: &Situation<'_>) -> Result<Orbit, String> {
    let orbit = at.telemetry.orbit;
    orbit.ok_or_else(|| "the vehicle has not reported the circle that it flies".to_owned())
}

/// The present circle at another speed.
fn faster_or_slower(speed_m_s: f64, at: &Situation<'_>) -> Result<Vec<Step>, String> {
    let orbit = flown_circle(at)?;
    within_the_circle(Some(speed_m_s), orbit.radius_m.abs())?;
    let centre = (orbit.centre.latitude, orbit.centre.longitude);
    // The reported altitude is that of this moment: on the way to its circle, commanding it would end the climb there.
    let mut steps = maneuver::orbit(centre, None, orbit.radius_m, Some(speed_m_s), true, None);
    steps.push(maneuver::shows_speed(speed_m_s));
    Ok(steps)
}

/// PX4 flies a circle more slowly than commanded if the centripetal acceleration would exceed its limit.
fn within_the_circle(speed_m_s: Option<f64>, radius_m: f64) -> Result<(), String> {
    let most_m_s = (MAX_INWARD_M_S2 * radius_m).sqrt();
    match speed_m_s {
        Some(speed_m_s) if speed_m_s > most_m_s => Err(format!(
            "speed {speed_m_s:.1} m/s on a circle of {radius_m:.0} m, at most {most_m_s:.1}"
        )),
        _ => Ok(()),
    }
}

/// PX4's limit of centripetal acceleration, m/s2.
const MAX_INWARD_M_S2: f64 = 2.0;
