//! The values that a 2016 commands, checked: altitude and speed.

use mapping::altitude::{self, Level};
use mapping::route;
use mapping::telemetry::Telemetry;
use stanag_msgs::enums::{AltitudeCommandType, SpeedType};
use stanag_msgs::messages::VehicleOperatingModeCommand;

use super::Situation;

/// Commanded Altitude, where one is commanded, m as its type says.
pub(super) fn altitude(command: &VehicleOperatingModeCommand) -> Option<f64> {
    match command.altitude_command_type {
        Some(AltitudeCommandType::None) => None,
        _ => command.commanded_altitude.map(|altitude| altitude.si()),
    }
}

/// An altitude to fly at, within the limits.
///
/// # Errors
/// The command is of another kind than a plain altitude, or beyond the limits.
pub(super) fn checked_level(
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
pub(super) fn level(
    metres: f64,
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Level, String> {
    let (geoid_m, agl, altimeter) = (at.telemetry.geoid_m, at.agl, at.altimeter);
    let level = altitude::level(metres, command.altitude_type, geoid_m, agl, altimeter)
        .map_err(|fault| fault.to_string())?;
    let home = at.telemetry.home.ok_or("home is not known yet")?;
    route::height(level, &home, &at.limits).map_err(|fault| fault.to_string())?;
    Ok(level)
}

/// Commanded Speed, where one is commanded, m/s.
///
/// # Errors
/// It is beyond the limits, or of a type that is not flown.
pub(super) fn speed(
    command: &VehicleOperatingModeCommand,
    at: &Situation<'_>,
) -> Result<Option<f64>, String> {
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
    let checked = at.performance.check(speed_m_s);
    let speed_m_s = checked.map_err(|fault| fault.to_string())?;
    match command.speed_type {
        None | Some(SpeedType::Ground | SpeedType::Indicated | SpeedType::True) => {
            Ok(Some(speed_m_s))
        }
        Some(other) => Err(format!("Speed Type {} is not flown", other.raw())),
    }
}

/// What a speed is flown as, whatever type it was commanded as: PX4 takes the speed of a multicopter over ground and that
/// of a fixed wing through the air.
pub(super) fn flown_as(vehicle: &Telemetry) -> SpeedType {
    if vehicle.hovers() {
        SpeedType::Ground
    } else {
        SpeedType::Indicated
    }
}
