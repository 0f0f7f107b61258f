//! The loiter configuration (2017): kept field by field for the loiters that 2016 commands.
//!
//! What PX4 cannot fly is refused here, at once, and changes nothing: kept, it would only be found out by the 2016 that
//! is to stop the vehicle somewhere.

use mapping::configuration::changes;
use mapping::limits::WIDEST_CIRCLE_M;
use stanag_msgs::enums::{AckType, LoiterDirection, LoiterType};
use stanag_msgs::messages::LoiterConfiguration;

use super::aircraft::Aircraft;
use super::desk::{Desk, Origin};

impl Aircraft {
    /// 2017.
    pub(super) fn configure_loiter(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        configuration: &LoiterConfiguration,
    ) {
        let merged = merge(&self.loiter, configuration);
        if let Err(why) = circle(&merged, self.mav.telemetry.hovers()) {
            return self.refuse(desk, Some(origin), why);
        }
        let changed: Vec<_> = changes::loiter(&merged, &self.loiter).collect();
        self.loiter = merged;
        desk.acknowledge(self.id(), &origin, AckType::CarriedOut);
        self.tell_the_configured(desk, &changed, Some(origin.station));
    }
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
