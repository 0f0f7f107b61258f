//! Mode 15: speed, direction and climb by set points.

use stanag_msgs::enums::{AltitudeCommandType, SpeedType};
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::values::{level, speed};
use super::{Situation, Task};
use crate::session::steering::{self, Vertical};

pub(super) fn steer(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Task, String> {
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
