//! Mode 21: to an altitude, and on along the launch route where there is one.

use mapping::mode::Px4Mode;
use mapping::report::Commanded;
use stanag_msgs::enums::RouteType;
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::route::{holds, is_current};
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
    if at.telemetry.landed.is_none() {
        return Err("mode 21: the vehicle has not told yet whether it stands".to_owned());
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
                if aboard.route_type == RouteType::Launch
                    && holds(at.telemetry, aboard)
                    && is_current(aboard, RouteType::Launch, at) =>
            {
                steps.push(Step::SetCurrent(0..=aboard.compiled.place_from(0)));
                steps.extend(maneuver::enter(&[Px4Mode::MISSION]));
            }
            _ => return Ok(Task::Load(RouteType::Launch)),
        }
    }
    Ok(Task::Launch(steps, commanded))
}

/// PX4 does not leave the ground for less, m.
const LOWEST_LAUNCH_M: f64 = 1.5;

#[cfg(test)]
mod tests {
    use mapping::altitude::{Agl, Altimeter};
    use mapping::limits::Limits;
    use mapping::limits::Performance;
    use mapping::plan::Plan;
    use mapping::telemetry::{Place, Telemetry};
    use mavlink_link::dialect::MavLandedState;
    use stanag_msgs::Scaled;
    use stanag_msgs::enums::{AltitudeType, FlightPathControlMode as Mode};
    use stanag_msgs::messages::LoiterConfiguration;

    use super::super::task;
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
                aboard: None,
                loaded_mission: None,
                plan: &Plan::default(),
                just_loaded: false,
                entering: false,
                loiter: &LoiterConfiguration::default(),
                commanded: Commanded::default(),
                agl: Agl::AboveHome,
                altimeter: Altimeter::STANDARD,
                limits: Limits::default(),
                performance: Performance::default(),
            };
            task(&command, &at).map(|task| matches!(task, Task::Launch(..)))
        };
        let stands = MavLandedState::MAV_LANDED_STATE_ON_GROUND;
        assert_eq!(judged(Some(stands)), Ok(true));
        // A VSM that was started anew while the vehicle flies.
        assert!(judged(None).is_err_and(|why| why.contains("not told yet")));
    }
}
