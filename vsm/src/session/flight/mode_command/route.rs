//! Modes that fly a route: the one aboard, from the commanded waypoint, or another one that is uploaded first.

use curve_paths::Position;
use mapping::airframe::Airframe;
use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mapping::route::check_way;
use stanag_msgs::enums::{FlightPathControlMode as Mode, RouteType};
use stanag_msgs::messages::VehicleOperatingModeCommand;

use crate::session::flight::repeated::REPEATED_WITHIN;
use crate::session::flight::situation::{
    NEAR_M, Situation, Task, check_feasible, check_heights, flown_as, holds, mission_not_reported,
    mode_of, names_mode, speed, steps_to_waypoint,
};
use crate::session::flight::wings;
use crate::session::maneuver::{self, Step};
use crate::session::mission::record::UploadedMission;

/// The route of this type, once it is uploaded.
pub(super) fn fly(
    command: &VehicleOperatingModeCommand,
    route: RouteType,
    at: &Situation<'_>,
) -> Result<Task, String> {
    // Detect reasons for refusal before another route is uploaded for the command.
    let speed = speed(command, &at.route_performance)?;
    wings::may_begin_a_route(at)?;
    let number = command
        .commanded_waypoint_number
        .filter(|number| *number != 0);
    let absent = |number: u16| format!("waypoint {number} is not in the route");
    let uploaded = match at.uploaded {
        Some(uploaded)
            if serves(uploaded, route, at)
                && holds(at.telemetry, uploaded) == Some(true)
                && (route == RouteType::Flight || is_current(uploaded, route, at)) =>
        {
            uploaded
        }
        // Another mode has uploaded another route: upload the one that 13000 loaded again.
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
        Some(uploaded) if route == RouteType::Flight && holds(at.telemetry, uploaded).is_none() => {
            return Err(mission_not_reported("mode 11 (waypoint)"));
        }
        // Mode 11 flies the route that 13000 loaded, never one that was stored later.
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
    let mode = mode_of(command, at.telemetry).unwrap_or(Mode::Waypoint);
    check_feasible(mode, at)?;
    check_heights(uploaded, at)?;
    let mut steps = Vec::new();
    let enters = at.settled_mode() != Some(Px4Mode::MISSION);
    if at.repeats && enters && is_over(at) {
        return Err(format!(
            "mode {}: the route was flown to its end, and this repeats the command that flew it: to fly it again, command it after a pause \
             of {} s, or another mode first",
            mode.in_words(),
            REPEATED_WITHIN.as_secs()
        ));
    }
    let start = match number {
        // It continues where it is.
        _ if at.repeats => None,
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
    // The operator may set a speed for the current leg. It applies, and the mission watchdog holds a vehicle that misses its
    // waypoint.
    let begins = enters || start.is_some();
    let seq = start.or(at.telemetry.mission.map(|mission| mission.seq));
    let seq = seq.unwrap_or(0);
    let compiled = &uploaded.compiled;
    let leg = compiled.leg_of_item(compiled.place_from(seq));
    if let Some(speed_m_s) = speed
        && let Some(waypoint) = leg.and_then(|leg| compiled.speed_left_out_after(leg))
    {
        return Err(format!(
            "at {speed_m_s:.1} m/s the vehicle could fly the legs behind this one too: repeated speeds are left out of the route, that \
             of waypoint {waypoint} among them, so that it fits the vehicle; give the route this speed (13002)"
        ));
    }
    if let Some(speed_m_s) = speed.filter(|_| begins && at.wings.is_none()) {
        let level = Some(comes_level(uploaded, seq, enters, at));
        if let Some(number) = compiled.missed_at(seq, level, speed_m_s, &at.performance) {
            return Err(format!(
                "at {speed_m_s:.1} m/s the vehicle could miss waypoint {number}, to or from which it climbs or \
                 descends, and fly on: give the route this speed (13002), so that it stops there"
            ));
        }
    }
    // PX4 drops a DO_CHANGE_SPEED while it lands, and acknowledges it.
    if let Some(speed_m_s) = speed
        && !begins
        && at.telemetry.airframe() == Airframe::FixedWing
        && compiled.is_touch_down(seq)
    {
        return Err(format!(
            "Commanded Speed {speed_m_s:.1} m/s on the final approach: PX4 flies it at its own (FW_LND_AIRSPD, FW_AIRSPD_MIN); abort the \
             landing first (mode 20, wave-off)"
        ));
    }
    if begins {
        wings::turn_for_the_leg(uploaded, seq, at, &mut steps)?;
    }
    // Before the mode: in AUTO.MISSION the vehicle flies to the current item.
    steps.extend(start.map(|seq| Step::SetCurrent(seq..=compiled.place_from(seq))));
    if begins {
        steps.extend(maneuver::enter(&[Px4Mode::MISSION]));
    }
    let mut commanded = if enters {
        Commanded::default()
    } else {
        at.commanded
    };
    if let Some(speed_m_s) = speed {
        // After the mode: PX4 resets to its own speed when it enters a mode.
        steps.push(maneuver::change_speed(speed_m_s, at.wings.is_none()));
        commanded.speed_m_s = Some(speed_m_s);
        commanded.speed_type = Some(flown_as(at.wings.is_none()));
    } else if let Some(speed_m_s) = start
        .filter(|_| at.may_jump())
        .and_then(|seq| compiled.speed_of_jump(seq, at.route_performance.cruise_m_s))
    {
        let hovers = at.wings.is_none() || compiled.hovers_from(seq);
        steps.push(maneuver::change_speed(speed_m_s, hovers));
        commanded.speed_m_s = None;
    }
    Ok(Task::Steps(steps, commanded))
}

/// The first item if no waypoint is named; `None` to continue to the current item.
fn continued_from(
    command: &VehicleOperatingModeCommand,
    uploaded: &UploadedMission,
    at: &Situation<'_>,
) -> Option<u16> {
    let restart = restarts_route(command, at).then_some(0);
    match at.under_way.item {
        // The target of an earlier command that the vehicle does not report yet.
        Some(item) if !uploaded.compiled.lands(item) => Some(item),
        // Except the landing of a mode 19: it may have become the current item, and mode 11 returns to where the route was
        // left.
        Some(_) => restart.or(at.telemetry.mission.map(|mission| mission.seq)),
        None => restart,
    }
}

/// Checks that the straight path from the vehicle to the point where its route begins or continues is above the terrain, if
/// that is known. A vehicle on the ground is not checked: a launch has its own checks, and this check is made when the route
/// is flown.
fn check_way_to_route(
    uploaded: &UploadedMission,
    start: Option<u16>,
    enters: bool,
    at: &Situation<'_>,
) -> Result<(), String> {
    let Some(terrain) = at.terrain.filter(|_| !at.telemetry.stands()) else {
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
    // On entering AUTO.MISSION a multicopter first climbs on the spot; a fixed wing climbs on the way.
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

/// Whether the vehicle flies to the first place from this item without a climb or descent on the way: on entering
/// AUTO.MISSION PX4 first climbs on the spot.
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

/// What a station is sent where the vehicle is not sent to a waypoint once more that it has passed since this command came first.
pub(crate) fn continues_instead(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Option<String> {
    let number = command.commanded_waypoint_number;
    let number = number.filter(|number| *number != 0 && at.repeats)?;
    let (compiled, seq) = (&at.uploaded?.compiled, at.telemetry.mission?.seq);
    let leg = compiled.leg_of_item(compiled.place_from(seq))?;
    let to = compiled.order.get(leg)?.number;
    (to != number).then(|| {
        format!(
            "2016 repeats a command that was carried out: the route continues to waypoint {to}; the vehicle is sent to waypoint {number} \
             again by a command after a pause of {} s",
            REPEATED_WITHIN.as_secs()
        )
    })
}

/// Whether a completed route restarts: if the mode is commanded without a waypoint.
pub(crate) fn restarts_route(command: &VehicleOperatingModeCommand, at: &Situation<'_>) -> bool {
    // A multicopter that has landed by its approach is still in the mode, and would take off again.
    let landed = at.telemetry.mode == Some(Px4Mode::MISSION)
        && at.wings.is_none()
        && (at.uploaded).is_some_and(|uploaded| uploaded.route_type == RouteType::Approach);
    let again = names_mode(command) && !steps_to_waypoint(command) && !at.repeats;
    again && is_over(at) && !landed
}

/// Whether the route aboard was flown to its end.
pub(crate) fn is_over(at: &Situation<'_>) -> bool {
    // A fixed wing's mission is not complete at the end of its route: it loiters there until its landing.
    let seq = at.telemetry.mission.map(|mission| mission.seq);
    let compiled = at.uploaded.map(|uploaded| &uploaded.compiled);
    compiled.is_some_and(|compiled| {
        seq.is_some_and(|seq| compiled.is_past_the_route(seq))
            || at.progress.is_over(compiled, at.telemetry)
    })
}

/// Whether the route aboard is the one to fly: mode 11 flies the route that 13000 loaded, except for contingency routes.
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

/// Whether a route that a mode has uploaded still matches the received one. The route that 13000 loaded stays until the next
/// 13000.
pub(super) fn is_current(uploaded: &UploadedMission, route: RouteType, at: &Situation<'_>) -> bool {
    at.just_loaded
        || at.loaded == Some(uploaded)
        || at
            .plan
            .route_of_type(route)
            .is_none_or(|sent| at.plan.part(sent) == uploaded.plan)
}
