//! What a 2016 asks of PX4, or why PX4 cannot do it: a pure function of the [`Situation`].
//!
//! [`task`] comes first, then the modes: routes (11, 19, 23, 24), launch (21), loiter (12), steering (15). What wings do
//! otherwise is in [`wings`].

use curve_paths::Position;
use mapping::altitude::Level;
use mapping::limits::{HeightError, disc};
use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mapping::route::check_way;
use mapping::telemetry::Telemetry;
use mavlink_link::dialect::MissionState;
use stanag_msgs::enums::{
    AltitudeCommandType, FlightPathControlMode as Mode, HeadingCommandType, LoiterDirection,
    RouteType, SpeedType,
};
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::settings::{self, Pattern};
use super::situation::{
    Situation, Task, altitude, check_heights, checked_level, does_not_follow_ground, flown_as, has,
    holds, level, mode_of, names_mode, place, plain, speed, steps_to_waypoint,
};
use super::steering::{self, Vertical};
use super::wings;
use crate::session::duplicates::commands_values;
use crate::session::maneuver::{self, Step};
use crate::session::mission::record::UploadedMission;

/// Decides.
///
/// # Errors
/// The reason, for the operator.
pub(crate) fn task(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Task, String> {
    let mode = mode_of(command, at.telemetry)
        .ok_or("no mode is commanded, and the vehicle has not reported one")?;
    if !names_mode(command) {
        if !commands_values(command) {
            // A setting that is kept, such as the altimeter's.
            return Ok(Task::Nothing);
        }
        if at.settled_mode().is_none() {
            return Err(
                "no mode is commanded while another is being entered, or was commanded and is not shown yet: name the mode"
                    .to_owned(),
            );
        }
        if !matches!(mode, Mode::Waypoint | Mode::Loiter | Mode::Autopilot) {
            return Err(format!(
                "no mode is commanded, and in the current one, {}, nothing can be changed",
                mode.raw()
            ));
        }
    }
    // Refused, not ignored: it commands something else than the mode does.
    if let Some(heading) = command.heading_command_type
        && heading != HeadingCommandType::None
        && mode != Mode::Autopilot
    {
        return Err(format!(
            "heading commands are not flown in mode {}",
            mode.in_words()
        ));
    }
    match mode {
        Mode::Waypoint => waypoint(command, at),
        Mode::Loiter => loiter(command, at),
        Mode::Launch => launch(command, at),
        Mode::AutolandEngage => match wings::land(at)? {
            Some(task) => Ok(task),
            None => fly(command, RouteType::Approach, at),
        },
        Mode::ContingencyA => contingency(command, RouteType::ContingencyA, &[Px4Mode::RTL], at),
        Mode::ContingencyB => contingency(command, RouteType::ContingencyB, &[Px4Mode::LAND], at),
        // What is shown or what is commanded: to abort is the safe decision about either.
        Mode::AutolandWaveOff
            if at.telemetry.hovers()
                && (at.telemetry.mode == Some(Px4Mode::LAND) || at.under_way.lands) =>
        {
            wave_off(command, at)
        }
        Mode::AutolandWaveOff => wings::wave_off(at),
        Mode::FlightDirector => Ok(Task::Manual),
        Mode::Autopilot if at.wings.is_some() && !at.telemetry.hovers() => {
            wings::steer(command, at)
        }
        Mode::Autopilot => steer(command, at),
        other => Err(format!("mode {}: not supported by PX4", other.in_words())),
    }
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

/// Mode 11.
fn waypoint(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Task, String> {
    if altitude(command).is_some() {
        return Err(
            "mode 11 (waypoint) flies the altitudes of the route; command another in mode 12 (loiter)".to_owned(),
        );
    }
    if at.uploaded.is_none() && at.loaded.is_none() {
        return Err("mode 11 (waypoint): no route has been loaded (13000)".to_owned());
    }
    fly(command, RouteType::Flight, at)
}

/// The route of this type, once it is uploaded.
fn fly(
    command: &VehicleOperatingModeCommand,
    route: RouteType,
    at: &Situation<'_>,
) -> Result<Task, String> {
    // What makes it impossible is found out before another route goes aboard for it.
    let speed = speed(command, &at.route_performance)?;
    wings::may_begin_a_route(at)?;
    let number = command
        .commanded_waypoint_number
        .filter(|number| *number != 0);
    let absent = |number: u16| format!("waypoint {number} is not in the route");
    let uploaded = match at.uploaded {
        Some(uploaded)
            if serves(uploaded, route, at)
                && holds(at.telemetry, uploaded)
                && (route == RouteType::Flight || is_current(uploaded, route, at)) =>
        {
            uploaded
        }
        // Another route went aboard for another mode: what 13000 has loaded comes back.
        _ if route == RouteType::Flight && at.loaded.is_some() && at.loaded != at.uploaded => {
            let knows = |number| {
                at.loaded
                    .and_then(|loaded_mission| loaded_mission.compiled.first_item_of(number))
            };
            return match number.filter(|number| knows(*number).is_none()) {
                Some(number) => Err(absent(number)),
                None => Ok(Task::Reload),
            };
        }
        // Mode 11 flies what 13000 has loaded, never what has been stored since.
        _ if route == RouteType::Flight => {
            return Err(
                "mode 11 (waypoint): the vehicle no longer holds the loaded route; load it again (13000)"
                    .to_owned(),
            );
        }
        _ => {
            let sent = at.plan.route_of_type(route).map(|sent| at.plan.part(sent));
            let knows = |number| sent.as_ref().and_then(|sent| sent.waypoint(number));
            return match number.filter(|number| knows(*number).is_none()) {
                Some(number) => Err(absent(number)),
                None => Ok(Task::Load(route)),
            };
        }
    };
    check_heights(uploaded, at)?;
    let mut steps = Vec::new();
    let enters = at.settled_mode() != Some(Px4Mode::MISSION);
    let start = match number {
        Some(number) => Some(
            uploaded
                .compiled
                .first_item_of(number)
                .ok_or_else(|| format!("{} aboard", absent(number)))?,
        ),
        None => continued_from(command, uploaded, at),
    };
    if enters || start.is_some() {
        check_way_to_route(uploaded, start, enters, at)?;
    }
    // A speed for the leg that is being flown is the operator's decision: it applies, and the mission watchdog holds a
    // vehicle that flies past its waypoint.
    let begins = enters || start.is_some();
    if let Some(speed_m_s) = speed.filter(|_| begins && at.wings.is_none()) {
        let seq = start.or(at.telemetry.mission.map(|mission| mission.seq));
        let seq = seq.unwrap_or(0);
        let level = Some(comes_level(uploaded, seq, enters, at));
        if let Some(number) = uploaded
            .compiled
            .missed_at(seq, level, speed_m_s, &at.performance)
        {
            return Err(format!(
                "at {speed_m_s:.1} m/s the vehicle could miss waypoint {number}, to or from which it climbs or \
                 descends, and fly on: give the route this speed (13002), so that it stops there"
            ));
        }
    }
    if begins {
        let seq = start.or(at.telemetry.mission.map(|mission| mission.seq));
        wings::turn_for_the_leg(uploaded, seq.unwrap_or(0), at, &mut steps)?;
    }
    // Before the mode: in AUTO.MISSION the vehicle flies to the item that is current.
    steps.extend(start.map(|seq| Step::SetCurrent(seq..=uploaded.compiled.place_from(seq))));
    if begins {
        steps.extend(maneuver::enter(&[Px4Mode::MISSION]));
    }
    let mut commanded = if enters {
        Commanded::default()
    } else {
        at.commanded
    };
    if let Some(speed_m_s) = speed {
        // After the mode: entering one takes PX4 back to its own speed.
        steps.push(maneuver::change_speed(speed_m_s, at.wings.is_none()));
        commanded.speed_m_s = Some(speed_m_s);
        commanded.speed_type = Some(flown_as(at.wings.is_none()));
    }
    Ok(Task::Steps(steps, commanded))
}

/// The item to begin with where no waypoint is named; none to fly on to the current one.
fn continued_from(
    command: &VehicleOperatingModeCommand,
    uploaded: &UploadedMission,
    at: &Situation<'_>,
) -> Option<u16> {
    let restart = restarts_route(command, at.telemetry, Some(uploaded)).then_some(0);
    match at.under_way.item {
        // Where an earlier command sends the vehicle, and it does not report yet.
        Some(item) if !uploaded.compiled.lands(item) => Some(item),
        // But to the landing of a mode 19: it may have become current, and mode 11 flies back to where the route was left.
        Some(_) => restart.or(at.telemetry.mission.map(|mission| mission.seq)),
        None => restart,
    }
}

/// Whether the straight way from the vehicle to where its route is begun or continued is above the terrain, where that is
/// known. On the ground there is none yet: a launch is refused elsewhere, and this is compared when the route is flown.
fn check_way_to_route(
    uploaded: &UploadedMission,
    start: Option<u16>,
    enters: bool,
    at: &Situation<'_>,
) -> Result<(), String> {
    let Some(terrain) = at.terrain.filter(|_| at.telemetry.airborne()) else {
        return Ok(());
    };
    let compiled = &uploaded.compiled;
    let seq = start.or(at.telemetry.mission.map(|mission| mission.seq));
    let leg = compiled.leg_of_item(compiled.place_from(seq.unwrap_or(0)));
    let Some(leg) = leg.and_then(|index| compiled.order.get(index)) else {
        return Ok(());
    };
    let present = at
        .telemetry
        .position
        .ok_or("the vehicle has not reported a position yet")?;
    let home = at.telemetry.home.ok_or("home is not known yet")?;
    let to_m = leg.level.amsl(home.amsl_m);
    // On entering AUTO.MISSION a multicopter climbs before, on the spot; a wing climbs on the way.
    let climbs_first = enters && at.wings.is_none();
    let from_m = if climbs_first {
        present.amsl_m.max(to_m)
    } else {
        present.amsl_m
    };
    let from = Position::new(present.latitude, present.longitude, from_m);
    let to = Position::new(leg.latitude, leg.longitude, to_m);
    check_way(from, to, &at.limits, terrain).map_err(|fault| {
        format!(
            "from where the vehicle is, waypoint {}: {fault}",
            leg.number
        )
    })
}

/// Whether the vehicle comes to the place that a flight from this item leads to first without a climb or a descent on the
/// way: on entering AUTO.MISSION PX4 climbs before, on the spot.
fn comes_level(uploaded: &UploadedMission, seq: u16, enters: bool, at: &Situation<'_>) -> bool {
    let compiled = &uploaded.compiled;
    let leg = compiled.leg_of_item(compiled.place_from(seq));
    let leg = leg.and_then(|index| compiled.order.get(index));
    let (Some(leg), Some(here), Some(home)) = (leg, at.telemetry.position, at.telemetry.home)
    else {
        return false;
    };
    let above_m = here.amsl_m - leg.level.amsl(home.amsl_m);
    above_m.abs() < NEAR_M || (enters && above_m < 0.0)
}

/// Whether a route that has been flown to its end restarts: where the mode is commanded, and no waypoint.
pub(crate) fn restarts_route(
    command: &VehicleOperatingModeCommand,
    vehicle: &Telemetry,
    uploaded: Option<&UploadedMission>,
) -> bool {
    // A wing's mission is not complete at the end of its route: it waits there for its landing.
    let past = |seq| uploaded.is_some_and(|uploaded| uploaded.compiled.is_past_the_route(seq));
    let complete = vehicle.mission.is_some_and(|mission| {
        mission.state == MissionState::MISSION_STATE_COMPLETE || past(mission.seq)
    });
    complete && names_mode(command) && !steps_to_waypoint(command)
}

/// Whether a route aboard is the one that is to be flown: mode 11 flies what 13000 has loaded, but for contingency routes.
fn serves(uploaded: &UploadedMission, wanted: RouteType, at: &Situation<'_>) -> bool {
    if wanted == RouteType::Flight {
        let contingency = [RouteType::ContingencyA, RouteType::ContingencyB];
        !contingency.contains(&uploaded.route_type)
            && at
                .loaded
                .is_none_or(|loaded_mission| loaded_mission == uploaded)
    } else {
        uploaded.route_type == wanted
    }
}

/// Whether a route that a mode has put aboard is still what has been sent. What 13000 has loaded stays until the next
/// 13000.
fn is_current(uploaded: &UploadedMission, route: RouteType, at: &Situation<'_>) -> bool {
    at.just_loaded
        || at.loaded == Some(uploaded)
        || at
            .plan
            .route_of_type(route)
            .is_none_or(|sent| at.plan.part(sent) == uploaded.plan)
}

/// Mode 20 of a vehicle in AUTO.LAND: up to the commanded altitude, else to the one at which the landing began, through
/// which it has come down just now; where neither is known it holds. DO_GO_AROUND is for wings.
fn wave_off(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Task, String> {
    // DO_REPOSITION would take it off.
    if at.telemetry.stands() {
        return Err("mode 20 (wave-off): the vehicle is on the ground already".to_owned());
    }
    let commanded = match altitude(command) {
        Some(metres) => {
            let home = at
                .telemetry
                .home
                .ok_or("mode 20 (wave-off): home is not known yet")?;
            let over = flown_over(None, Pattern::Hover, command, at)?;
            Some(checked_level(metres, command, &over, at)?.amsl(home.amsl_m))
        }
        None => None,
    };
    let present = at.telemetry.position.map(|place| place.amsl_m);
    if let (Some(wanted), Some(present)) = (commanded, present)
        && wanted < present
    {
        return Err(format!(
            "mode 20 (wave-off) climbs: commanded {wanted:.1} m AMSL, the vehicle is at {present:.1} m"
        ));
    }
    match (commanded.or(at.landing_from_m), present) {
        (Some(amsl_m), Some(present))
            if at.telemetry.hovers() && at.telemetry.airborne() && amsl_m > present + NEAR_M =>
        {
            let commanded = Commanded {
                altitude_amsl_m: Some(amsl_m),
                ..Commanded::default()
            };
            let steps = maneuver::reposition(None, amsl_m, None);
            Ok(Task::Steps(steps.into(), commanded))
        }
        _ => Ok(plain(&[Px4Mode::LOITER], at)),
    }
}

/// Mode 21: to an altitude, and on along the launch route where there is one.
fn launch(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Task, String> {
    if at.telemetry.airborne() {
        return Err("mode 21 (launch): the vehicle is already in the air".to_owned());
    }
    // After a start of the VSM nothing is reported yet: the vehicle may be in the air.
    if at.telemetry.landed.is_none() {
        return Err(
            "mode 21 (launch): the vehicle has not reported yet whether it is on the ground"
                .to_owned(),
        );
    }
    let route = has(RouteType::Launch, at);
    let metres =
        altitude(command).ok_or("mode 21 (launch) needs a commanded altitude to take off to")?;
    let home = at
        .telemetry
        .home
        .ok_or("mode 21 (launch): home is not known yet")?;
    let level = checked_level(metres, command, &[(home.latitude, home.longitude)], at)?;
    let amsl_m = level.amsl(home.amsl_m);
    let height_m = amsl_m - home.amsl_m;
    if height_m < LOWEST_LAUNCH_M {
        return Err(format!(
            "mode 21 (launch): {height_m:.1} m above home, expected at least {LOWEST_LAUNCH_M} m"
        ));
    }
    let (mut steps, commanded) = match &at.wings {
        Some(wings) => wings::launch(command, at, wings, amsl_m)?,
        None => {
            let commanded = Commanded {
                altitude_amsl_m: Some(amsl_m),
                ..Commanded::default()
            };
            (maneuver::launch(amsl_m), commanded)
        }
    };
    if route {
        if at.wings.is_some() {
            // On its way up a wing turns to nothing.
            steps.push(maneuver::climbed());
        }
        match at.uploaded {
            Some(uploaded)
                if uploaded.route_type == RouteType::Launch
                    && holds(at.telemetry, uploaded)
                    && is_current(uploaded, RouteType::Launch, at) =>
            {
                check_heights(uploaded, at)?;
                steps.push(Step::SetCurrent(0..=uploaded.compiled.place_from(0)));
                steps.extend(maneuver::enter(&[Px4Mode::MISSION]));
            }
            _ => return Ok(Task::Load(RouteType::Launch)),
        }
    }
    Ok(Task::Launch(steps, commanded))
}

/// A loiter as far as it is composed.
struct Draft {
    steps: Vec<Step>,
    commanded: Commanded,
    /// The speed that is still to be commanded by itself, m/s.
    speed_m_s: Option<f64>,
    /// The mode is named: the loiter is flown as it is configured now.
    anew: bool,
}

/// Mode 12: here or at a place, at an altitude, hovering or on a circle.
fn loiter(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Task, String> {
    let speed = speed(command, &at.performance)?;
    let place = place(command, at)?;
    let pattern = settings::pattern(at.loiter, at.telemetry.airframe())?;
    let level = match altitude(command) {
        Some(metres) => {
            let over = flown_over(place, pattern, command, at)?;
            Some(checked_level(metres, command, &over, at)?)
        }
        None => None,
    };
    if let (None, Some(kind)) = (level, command.altitude_command_type)
        && !matches!(
            kind,
            AltitudeCommandType::None | AltitudeCommandType::Altitude
        )
    {
        return Err(format!(
            "mode 12 (loiter): Altitude Command Type {} is not flown; a vertical speed needs mode 15 (autopilot)",
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
        anew: names_mode(command),
    };
    // A VTOL hovers, or circles on its wings, as the loiter asks: it turns into that first.
    let hovers = wings::transition_for(pattern, names_mode(command), at, &mut draft.steps)?;
    if place.is_none() && level.is_none() && !wings::circles_here(pattern, hovers, command) {
        stay(&mut draft, command, loiters, at)?;
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

/// The places that a loiter leads over, for a height above the ground: only that needs to know where the vehicle is.
fn flown_over(
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
        // Wherever its long axis points.
        Pattern::FigureEight([half_m, radius_m, _]) => {
            let radius_m = radius_m.unwrap_or(own_m);
            half_m.unwrap_or(radius_m) + radius_m
        }
    };
    Ok(disc(centre, radius_m))
}

/// Where it is, at its altitude.
fn stay(
    draft: &mut Draft,
    command: &VehicleOperatingModeCommand,
    loiters: bool,
    at: &Situation<'_>,
) -> Result<(), String> {
    if !names_mode(command) && steps_to_waypoint(command) {
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
    let home = at.telemetry.home.ok_or("home is not known yet")?;
    // Without an altitude the vehicle is sent there at its present one, which a flight by hand may have left below home.
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
    // Where nothing but its altitude is commanded, a wing that loiters keeps its circle.
    let keeps = place.is_none()
        && at.settled_mode() == Some(Px4Mode::LOITER)
        && draft.steps.is_empty()
        && !hovers;
    match (place.or((!hovers).then_some(here)), pattern) {
        _ if keeps && !draft.anew => draft.steps.extend(maneuver::change_altitude(amsl_m)),
        (Some(place), Pattern::FigureEight(shape)) => {
            if let (Some(wings), [_, Some(radius_m), _]) = (&at.wings, shape) {
                wings::check_circle(wings, radius_m, draft.speed_m_s, at)?;
            }
            draft
                .steps
                .extend(maneuver::figure_eight(place, amsl_m, shape));
        }
        (Some(place), Pattern::Circle(radius_m)) => {
            let turn = match at.loiter.loiter_direction {
                Some(LoiterDirection::CounterClockwise) => -radius_m,
                _ => radius_m,
            };
            let speed = draft.speed_m_s;
            if let Some(wings) = at.wings.as_ref().filter(|_| !hovers) {
                wings::check_circle(wings, radius_m, speed, at)?;
            }
            if hovers {
                // PX4 takes the speed on a multicopter's circle from DO_ORBIT alone: no DO_CHANGE_SPEED follows.
                within_the_circle(speed, radius_m)?;
                draft.speed_m_s = None;
                draft.commanded.speed_m_s = speed;
                draft.commanded.speed_type = speed.map(|_| SpeedType::Ground);
            }
            let steps = maneuver::orbit(place, amsl_m, turn, speed, hovers);
            draft.steps.extend(steps);
        }
        _ => {
            // The speed follows by DO_CHANGE_SPEED: entering a mode takes PX4 back to its own.
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
        .ok_or("the vehicle has not reported the circle that it flies")?;
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

/// Mode 15: speed, direction and climb by set points.
fn steer(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> Result<Task, String> {
    if !at.telemetry.airborne() {
        return Err("mode 15 (autopilot) needs an airborne vehicle".to_owned());
    }
    let rate = command.commanded_vertical_speed.map(|rate| rate.si());
    let altitude_m = command.commanded_altitude.map(|altitude| altitude.si());
    let mut commanded = at.commanded;
    let vertical = match command.altitude_command_type {
        Some(AltitudeCommandType::None) => None,
        None if altitude_m.is_none() => None,
        Some(AltitudeCommandType::VerticalSpeed) => {
            // A vertical speed leads to no altitude that 3002 could report as commanded.
            commanded.altitude_amsl_m = None;
            Some(Vertical::Rate(rate.ok_or(
                "mode 15 (autopilot): Commanded Vertical Speed is missing",
            )?))
        }
        None | Some(AltitudeCommandType::Altitude | AltitudeCommandType::RateLimitedAltitude) => {
            let home = at.telemetry.home.ok_or("home is not known yet")?;
            let metres = altitude_m.ok_or("mode 15 (autopilot): Commanded Altitude is missing")?;
            does_not_follow_ground(command, at)?;
            let amsl_m = level(metres, command, &[], at)?.amsl(home.amsl_m);
            commanded.altitude_amsl_m = Some(amsl_m);
            let limited =
                command.altitude_command_type == Some(AltitudeCommandType::RateLimitedAltitude);
            // A rate of 0 is an unused field of a full presence vector, not a limit.
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
        speed_m_s: speed(command, &at.performance)?,
        direction: steering::direction(command)?,
        vertical,
    };
    if order.speed_m_s.is_some() {
        commanded.speed_m_s = order.speed_m_s;
        commanded.speed_type = Some(SpeedType::Ground);
    }
    commanded.loiter_position = None;
    // What turns no heading leaves the one that is steered.
    if order.direction.is_some() {
        commanded.direction = steering::reported(command);
    }
    Ok(Task::Steer(order, commanded))
}

/// So near an altitude it is flown to without a swing, m.
const NEAR_M: f64 = 1.0;
/// What PX4 allows toward the centre of a circle, m/s2.
const MAX_INWARD_M_S2: f64 = 2.0;
/// PX4 does not leave the ground for less, m.
const LOWEST_LAUNCH_M: f64 = 1.5;

#[cfg(test)]
mod tests {
    use mapping::altitude::{Agl, Altimeter, FRAME_AMSL};
    use mapping::limits::{Limits, Performance};
    use mapping::plan::Plan;
    use mapping::route::CompiledMission;
    use mapping::telemetry::{Place, Telemetry};
    use mavlink_link::dialect::MavLandedState;
    use mavlink_link::service::mission::Item;
    use stanag_msgs::Scaled;
    use stanag_msgs::enums::{AltitudeType, FlightPathControlMode as Mode};
    use stanag_msgs::messages::LoiterConfiguration;

    use super::super::situation::UnderWay;
    use super::*;

    #[test]
    fn a_launch_waits_for_the_vehicles_word_that_it_stands() {
        let home = Place {
            latitude: 47.0,
            longitude: 8.0,
            amsl_m: 488.0,
        };
        let command = VehicleOperatingModeCommand {
            select_flight_path_control_mode: Some(Mode::Launch),
            commanded_altitude: Scaled::from_si(20.0).ok(),
            altitude_type: Some(AltitudeType::Agl),
            ..VehicleOperatingModeCommand::default()
        };
        let judged = |landed| {
            let telemetry = Telemetry {
                home: Some(home),
                landed,
                ..Telemetry::default()
            };
            let at = Situation {
                telemetry: &telemetry,
                uploaded: None,
                loaded: None,
                plan: &Plan::default(),
                just_loaded: false,
                under_way: UnderWay::default(),
                landing_from_m: None,
                loiter: &LoiterConfiguration::default(),
                commanded: Commanded::default(),
                agl: Agl::AboveHome,
                altimeter: Altimeter::STANDARD,
                limits: Limits::default(),
                terrain: None,
                performance: Performance::default(),
                route_performance: Performance::default(),
                wings: None,
                vtol_loiter_m: None,
            };
            task(&command, &at).map(|task| matches!(task, Task::Launch(..)))
        };
        let stands = MavLandedState::MAV_LANDED_STATE_ON_GROUND;
        assert_eq!(judged(Some(stands)), Ok(true));
        // A VSM that was started anew while the vehicle flies.
        assert!(judged(None).is_err_and(|why| why.contains("not reported yet")));
    }

    #[test]
    fn a_route_aboard_is_flown_only_above_the_present_home() {
        let item = Item {
            frame: FRAME_AMSL,
            command: 16,
            z: 500.0,
            ..Item::default()
        };
        let uploaded = UploadedMission {
            compiled: CompiledMission {
                items: vec![item],
                waypoint_of: vec![7],
                ..CompiledMission::default()
            },
            mission_id: 0,
            route_type: RouteType::Flight,
            mission_name: String::new(),
            plan: Plan::default(),
        };
        let command = VehicleOperatingModeCommand {
            select_flight_path_control_mode: Some(Mode::Waypoint),
            ..VehicleOperatingModeCommand::default()
        };
        let judged = |amsl_m, below_home| {
            let telemetry = Telemetry {
                home: Some(Place {
                    latitude: 47.0,
                    longitude: 8.0,
                    amsl_m,
                }),
                ..Telemetry::default()
            };
            let at = Situation {
                telemetry: &telemetry,
                uploaded: Some(&uploaded),
                loaded: None,
                plan: &Plan::default(),
                just_loaded: false,
                under_way: UnderWay::default(),
                landing_from_m: None,
                loiter: &LoiterConfiguration::default(),
                commanded: Commanded::default(),
                agl: Agl::AboveHome,
                altimeter: Altimeter::STANDARD,
                limits: Limits {
                    below_home,
                    ..Limits::default()
                },
                terrain: None,
                performance: Performance::default(),
                route_performance: Performance::default(),
                wings: None,
                vtol_loiter_m: None,
            };
            task(&command, &at).map(drop)
        };
        assert_eq!(judged(488.0, false), Ok(()));
        // The vehicle was carried up a hill after the load.
        let why = judged(520.0, false).expect_err("it is 20 m below home");
        let expected = "the route aboard, from the present home: waypoint 7: 500.0 m AMSL is 20.0 m below home (520.0 m";
        assert!(why.starts_with(expected), "{why}");
        assert_eq!(judged(520.0, true), Ok(()));
    }
}
