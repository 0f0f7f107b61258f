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
use crate::session::plan_record::Aboard;

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
    if at.aboard.is_none() && at.chosen.is_none() {
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
pub(super) fn holds(vehicle: &Telemetry, aboard: &Aboard) -> bool {
    aboard.mission_id == 0
        || vehicle
            .mission
            .is_some_and(|mission| mission.mission_id == aboard.mission_id)
}
