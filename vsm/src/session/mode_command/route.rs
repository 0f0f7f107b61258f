//! Modes that fly a route (11, 19, 23, 24): which one must be aboard for it, and where it is begun.

use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use mapping::telemetry::Telemetry;
use mavlink_link::dialect::MissionState;
use stanag_msgs::enums::RouteType;
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::values::{altitude, flown_as, speed};
use super::{Situation, Task, names_mode, steps_to_waypoint};
use crate::session::maneuver::{self, Step};
use crate::session::plan_record::UploadedMission;

/// Mode 11.
pub(super) fn waypoint(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Task, String> {
    if altitude(command).is_some() {
        return Err(
            "mode 11 flies the altitudes of the route; command another in mode 12".to_owned(),
        );
    }
    if at.aboard.is_none() && at.loaded_mission.is_none() {
        return Err("mode 11: no route has been loaded (13000)".to_owned());
    }
    fly(command, RouteType::Flight, at)
}

/// The route of this type, once it is aboard.
pub(super) fn fly(
    command: &VehicleOperatingModeCommand,
    route: RouteType,
    at: &Situation<'_>,
) -> Result<Task, String> {
    // What makes it impossible is found out before another route goes aboard for it.
    let speed = speed(command, at)?;
    let number = command
        .commanded_waypoint_number
        .filter(|number| *number != 0);
    let absent = |number: u16| format!("waypoint {number} is not in the route");
    let aboard = match at.aboard {
        Some(aboard)
            if serves(aboard, route, at)
                && holds(at.telemetry, aboard)
                && (route == RouteType::Flight || is_current(aboard, route, at)) =>
        {
            aboard
        }
        // Another route went aboard for another mode: what 13000 has loaded comes back.
        _ if route == RouteType::Flight
            && at.loaded_mission.is_some()
            && at.loaded_mission != at.aboard =>
        {
            let knows = |number| {
                at.loaded_mission
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
                "mode 11: the loaded route is not aboard any more; load it again (13000)"
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
    let mut steps = Vec::new();
    let enters = at.telemetry.mode != Some(Px4Mode::MISSION);
    let start = match number {
        Some(number) => Some(
            aboard
                .compiled
                .first_item_of(number)
                .ok_or_else(|| format!("{} aboard", absent(number)))?,
        ),
        None => flies_anew(command, at.telemetry).then_some(0),
    };
    // A speed for the leg that is flown is the operator's word: it is heeded, and the watch on the sequence holds a vehicle
    // that flies past its waypoint.
    let begins = enters || start.is_some();
    if let Some(speed_m_s) = speed.filter(|_| begins && at.telemetry.hovers()) {
        let seq = start.or(at.telemetry.mission.map(|mission| mission.seq));
        let seq = seq.unwrap_or(0);
        let level = Some(comes_level(aboard, seq, enters, at));
        if let Some(number) = aboard
            .compiled
            .missed_at(seq, level, speed_m_s, &at.performance)
        {
            return Err(format!(
                "at {speed_m_s:.1} m/s the vehicle could miss waypoint {number}, to or from which it climbs or \
                 descends, and fly on: give the route this speed (13002), so that it stops there"
            ));
        }
    }
    steps.extend(start.map(|seq| Step::SetCurrent(seq..=aboard.compiled.place_from(seq))));
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
        steps.push(maneuver::change_speed(speed_m_s));
        commanded.speed_m_s = Some(speed_m_s);
        commanded.speed_type = Some(flown_as(at.telemetry));
    }
    Ok(Task::Steps(steps, commanded))
}

/// Whether the vehicle comes to the place that a flight from this item leads to first without a climb or a descent on the
/// way: on entering AUTO.MISSION PX4 climbs before, on the spot.
fn comes_level(aboard: &UploadedMission, seq: u16, enters: bool, at: &Situation<'_>) -> bool {
    let compiled = &aboard.compiled;
    let leg = compiled.leg_of_item(compiled.place_from(seq));
    let leg = leg.and_then(|index| compiled.order.get(index));
    let (Some(leg), Some(here), Some(home)) = (leg, at.telemetry.position, at.telemetry.home)
    else {
        return false;
    };
    let above_m = here.amsl_m - leg.level.amsl(home.amsl_m);
    above_m.abs() < NEAR_M || (enters && above_m < 0.0)
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
fn serves(aboard: &UploadedMission, wanted: RouteType, at: &Situation<'_>) -> bool {
    if wanted == RouteType::Flight {
        let contingency = [RouteType::ContingencyA, RouteType::ContingencyB];
        !contingency.contains(&aboard.route_type)
            && at
                .loaded_mission
                .is_none_or(|loaded_mission| loaded_mission == aboard)
    } else {
        aboard.route_type == wanted
    }
}

/// Whether the vehicle itself names the route that was loaded as its mission: another station may have changed it.
pub(super) fn holds(vehicle: &Telemetry, aboard: &UploadedMission) -> bool {
    aboard.mission_id == 0
        || vehicle
            .mission
            .is_some_and(|mission| mission.mission_id == aboard.mission_id)
}

/// Whether a route that a mode has put aboard is still what has been sent. What 13000 has loaded stays until the next
/// 13000.
pub(super) fn is_current(aboard: &UploadedMission, route: RouteType, at: &Situation<'_>) -> bool {
    at.just_loaded
        || at.loaded_mission == Some(aboard)
        || at
            .plan
            .route_of_type(route)
            .is_none_or(|sent| at.plan.part(sent) == aboard.plan)
}

/// So near an altitude it is flown to without a swing, m.
const NEAR_M: f64 = 1.0;
