//! Settings that hold until others are commanded: the loiter configuration (2017) and the altimeter setting (2016).

use mapping::airframe::Airframe;
use mapping::altitude::Altimeter;
use mapping::limits::WIDEST_CIRCLE_M;
use mavlink_link::store::{Store as _, StoreError};
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;
use stanag_msgs::enums::{LoiterDirection, LoiterType};
use stanag_msgs::messages::{LoiterConfiguration, VehicleOperatingModeCommand};

use crate::session::effects::Effects;
use crate::session::store::{record_fault, vehicle_record};

/// 2017 is a configuration message: an absent field keeps its last value. A loiter that PX4 cannot fly is refused at once
/// and changes nothing. If it were stored, only the 2016 that is meant to stop the vehicle would reveal the fault.
///
/// # Errors
/// The reason, for the operator.
pub(super) fn merged(
    old: &LoiterConfiguration,
    new: &LoiterConfiguration,
    airframe: Airframe,
) -> Result<LoiterConfiguration, String> {
    let merged = merge(old, new);
    pattern(&merged, airframe)?;
    Ok(merged)
}

/// How a loiter is flown.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Pattern {
    /// The vehicle's default: a hover, or a circle with its own radius.
    Own,
    /// A hover.
    Hover,
    /// On a circle of this radius, m.
    Circle(f64),
    /// Half the length of a figure eight and the radius of its ends, m, and the direction of its long axis, rad; PX4's own
    /// value for each `None`.
    FigureEight([Option<f64>; 3]),
}

/// The configured pattern.
///
/// # Errors
/// PX4 cannot fly it with this airframe: the reason, for the operator.
pub(super) fn pattern(loiter: &LoiterConfiguration, airframe: Airframe) -> Result<Pattern, String> {
    match loiter.loiter_direction {
        None
        | Some(
            LoiterDirection::VehicleDependent
            | LoiterDirection::Clockwise
            | LoiterDirection::CounterClockwise,
        ) => {}
        Some(other) => {
            return Err(format!(
                "Loiter Direction {} is not flown, only 0 to 2",
                other.raw()
            ));
        }
    }
    let radius_m = loiter.loiter_radius.map(|radius| radius.si());
    if let Some(radius_m) = radius_m.filter(|radius_m| *radius_m > WIDEST_CIRCLE_M) {
        return Err(format!(
            "Loiter Radius {radius_m:.0} m, at most {WIDEST_CIRCLE_M:.0}"
        ));
    }
    // Refuse it: clipped or replaced by the vehicle's own radius, the circle would differ from the commanded one.
    if radius_m == Some(0.0) && matches!(loiter.loiter_type, None | Some(LoiterType::Circular)) {
        return Err(
            "Loiter Radius 0 m, expected more than 0; leave it out for the vehicle's own, or command Loiter Type 4 (hover)"
                .to_owned(),
        );
    }
    // For a figure 8, 0 in a full presence vector means no value.
    let above_zero = |m: &f64| *m > 0.0;
    let radius_m = radius_m.filter(above_zero);
    match loiter.loiter_type {
        Some(LoiterType::Hover) if airframe == Airframe::FixedWing => {
            Err("Loiter Type 4 (hover): it is a fixed wing".to_owned())
        }
        Some(LoiterType::Hover) => Ok(Pattern::Hover),
        None | Some(LoiterType::Circular) => Ok(radius_m.map_or(Pattern::Own, Pattern::Circle)),
        Some(LoiterType::Figure8) if airframe.has_wings() => {
            let length = loiter.loiter_length.map(|length| length.si());
            let half_m = length.filter(above_zero).map(|length_m| length_m / 2.0);
            if let (Some(half_m), Some(radius_m)) = (half_m, radius_m)
                // PX4 would enlarge the figure instead: it keeps the major axis at least twice the minor one
                // (FigureEight.cpp).
                && half_m < 2.0 * radius_m
            {
                return Err(format!(
                    "Loiter Type 3 (figure 8): Loiter Length {:.0} m, at least four times the Loiter Radius of \
                     {radius_m:.0} m",
                    2.0 * half_m
                ));
            }
            let bearing = loiter.loiter_bearing.map(|bearing| bearing.radians());
            Ok(Pattern::FigureEight([half_m, radius_m, bearing]))
        }
        Some(LoiterType::Racetrack) => Err(
            "Loiter Type 2 (racetrack): PX4 has none; fly it as a route with a loop, or a circle or figure 8".to_owned(),
        ),
        Some(other) => Err(format!(
            "Loiter Type {} is not flown by PX4 with this airframe, only 1 (circular), 3 (figure 8, on wings) and 4 \
             (hover, not of a fixed wing)",
            other.raw()
        )),
    }
}

/// A figure of eight as PX4 flies it where the vehicle's own radius is this: half its length and the radius of its ends, m, and the
/// direction of its long axis, rad (Navigator, DO_FIGUREEIGHT).
pub(super) fn eight([half_m, radius_m, bearing]: [Option<f64>; 3], own_m: f64) -> [f64; 3] {
    let radius_m = radius_m.unwrap_or(own_m);
    let half_m = half_m.unwrap_or(2.5 * radius_m).max(2.0 * radius_m);
    [half_m, radius_m, bearing.unwrap_or(0.0)]
}

/// 2017 is a configuration message: an absent field keeps its last value.
fn merge(old: &LoiterConfiguration, new: &LoiterConfiguration) -> LoiterConfiguration {
    let loiter_type = new.loiter_type.or(old.loiter_type);
    // A hover has no radius: 0 in a full presence vector means no value and does not change the stored one.
    let hover = loiter_type == Some(LoiterType::Hover);
    let radius = new
        .loiter_radius
        .filter(|radius| !hover || radius.si() > 0.0);
    LoiterConfiguration {
        time_stamp: new.time_stamp.or(old.time_stamp),
        loiter_type,
        loiter_radius: radius.or(old.loiter_radius),
        loiter_length: new.loiter_length.or(old.loiter_length),
        loiter_length_units: new.loiter_length_units.or(old.loiter_length_units),
        loiter_bearing: new.loiter_bearing.or(old.loiter_bearing),
        loiter_direction: new.loiter_direction.or(old.loiter_direction),
        flying_behaviour: new.flying_behaviour.or(old.flying_behaviour),
        loiter_duration: new.loiter_duration.or(old.loiter_duration),
        loiter_duration_units: new.loiter_duration_units.or(old.loiter_duration_units),
        activity_id: new.activity_id.or(old.activity_id),
    }
}

/// The altimeter setting (2016, field 0043.16), used to fly and report pressure altitudes. It applies until another is
/// commanded, also after restarts; the default is 1013.25 hPa.
#[derive(Serialize, Deserialize)]
struct Record {
    pascal: f64,
}

vehicle_record!(Record, "altimeter", Answered);

/// The altimeter setting for a command: its own if it has one, otherwise the `present` one. 0 is what a full presence vector
/// carries for none.
///
/// # Errors
/// The value is out of the range of possible pressures.
pub(super) fn altimeter_of(
    command: &VehicleOperatingModeCommand,
    present: Altimeter,
) -> Result<Altimeter, String> {
    let pascal = command.altimeter_setting.map(|setting| setting.si());
    match pascal.filter(|pascal| *pascal > 0.0) {
        Some(pascal) => Altimeter::new(pascal).map_err(|fault| fault.to_string()),
        None => Ok(present),
    }
}

/// Stores the altimeter setting of an accepted command.
///
/// # Errors
/// The reason, for the operator.
pub(super) fn store_altimeter(
    altimeter: Altimeter,
    effects: &mut Effects<'_>,
) -> Result<(), String> {
    let (vehicle, pascal) = (effects.id, altimeter.pascal());
    let stored = effects.disk().save(&vehicle, &Record { pascal });
    stored.map_err(|fault| format!("the altimeter setting cannot be stored: {fault}"))
}

/// Restores the setting after a restart.
///
/// # Errors
/// Its record exists and cannot be read.
pub(super) fn stored_altimeter(effects: &mut Effects<'_>) -> Result<Altimeter, StoreError> {
    let vehicle: Id = effects.id;
    match effects.disk().load::<Record>(&vehicle)? {
        None => Ok(Altimeter::STANDARD),
        Some(Record { pascal }) => {
            Altimeter::new(pascal).map_err(|cause| record_fault("altimeter", vehicle, cause))
        }
    }
}
