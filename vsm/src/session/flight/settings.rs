//! Settings that hold until others are commanded: the loiter configuration (2017) and the altimeter setting (2016).

use mapping::altitude::Altimeter;
use mapping::limits::WIDEST_CIRCLE_M;
use mavlink_link::store::{Store as _, StoreError};
use serde::{Deserialize, Serialize};
use stanag_msgs::Id;
use stanag_msgs::enums::{LoiterDirection, LoiterType};
use stanag_msgs::messages::{LoiterConfiguration, VehicleOperatingModeCommand};

use crate::session::effects::Effects;
use crate::session::store::{record_fault, vehicle_record};

/// 2017 is a configuration message: an absent field keeps its last value. What PX4 cannot fly is refused here, at once,
/// and changes nothing: kept, it would only be found out by the 2016 that is to stop the vehicle somewhere.
///
/// # Errors
/// The reason, for the operator.
pub(super) fn merged(
    old: &LoiterConfiguration,
    new: &LoiterConfiguration,
    hovers: bool,
) -> Result<LoiterConfiguration, String> {
    let merged = merge(old, new);
    circle(&merged, hovers)?;
    Ok(merged)
}

/// The circle that is configured: its radius in metres; `None` for a hover, or the vehicle's own loiter.
///
/// # Errors
/// PX4 cannot fly it: the reason, for the operator.
pub(super) fn circle(loiter: &LoiterConfiguration, hovers: bool) -> Result<Option<f64>, String> {
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
    match loiter.loiter_type {
        Some(LoiterType::Hover) if hovers => Ok(None),
        Some(LoiterType::Hover) => Err("Loiter Type 4 (hover): it is a fixed wing".to_owned()),
        // Radius 0 is what a full presence vector carries for none.
        None | Some(LoiterType::Circular) => Ok(radius_m.filter(|radius_m| *radius_m > 0.0)),
        Some(other) => Err(format!(
            "Loiter Type {} is not flown by PX4, only 1 (circular) and 4 (hover)",
            other.raw()
        )),
    }
}

/// 2017 is a configuration message: an absent field keeps its last value.
fn merge(old: &LoiterConfiguration, new: &LoiterConfiguration) -> LoiterConfiguration {
    LoiterConfiguration {
        time_stamp: new.time_stamp.or(old.time_stamp),
        loiter_type: new.loiter_type.or(old.loiter_type),
        loiter_radius: new.loiter_radius.or(old.loiter_radius),
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

/// The altimeter setting (2016, field 0043.16): what pressure altitudes are flown by and reported with. It holds until
/// another is commanded, over restarts too; 1013.25 hPa until one was.
#[derive(Serialize, Deserialize)]
struct Record {
    pascal: f64,
}

vehicle_record!(Record, "altimeter", Process);

/// The setting that a command is judged by: its own where it has one, else the `present` one. 0 is what a full presence
/// vector carries for none.
///
/// # Errors
/// No weather has it.
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

/// Stores the setting of a command that is carried out.
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

/// The setting of before a restart.
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
