//! Mode 21: to an altitude, and on along the launch route where there is one.

use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use stanag_msgs::enums::RouteType;
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::route::holds;
use super::values::{altitude, checked_level};
use super::{Situation, Task, has};
use crate::session::maneuver::{self, Step};

pub(super) fn launch(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Task, String> {
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

/// PX4 does not leave the ground for less, m.
const LOWEST_LAUNCH_M: f64 = 1.5;
