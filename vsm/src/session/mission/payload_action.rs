//! Checks whether a payload station can carry out a 13004. This is checked on reception, since a mission reports nothing
//! about it later. The right is checked again when the route is loaded, since the station may have passed to another CUCS.
//!
//! [`PayloadAction::of`] already refuses actions that no PX4 mission can do. This module checks what depends on the vehicle
//! and the sender: a mission reaches only PX4's own gimbal manager, and a gimbal only turns within its limits. LOI 4 is
//! needed, as for every part of a plan, and also LOI 3 of the station: the pilot CUCS must not turn a sensor that another
//! CUCS is using.

use mapping::payload::report::Station;
use mapping::payload::waypoint::{PayloadAction, Pointing, camera_of};
use mapping::plan::Plan;
use mavlink_link::dialect::CameraCapFlags;
use stanag_msgs::Id;
use stanag_msgs::messages::PayloadActionWaypoint;

use super::Context;
use crate::config::Provisional;
use crate::session::context::Origin;
use crate::session::effects::Effects;

/// Checks whether the sender of a 13000 holds the payload stations that the route points. Only 13000 is checked: flying a
/// route aboard needs only LOI 4, and a contingency route is flown without any CUCS.
///
/// # Errors
/// The waypoint, and which right is missing.
pub(super) fn may_load(
    context: &Context<'_>,
    by: Id,
    route: &Plan,
) -> Result<(), (Option<u16>, String)> {
    for waypoint in route.numbers() {
        let Some(action) = route.payload_action(waypoint) else {
            continue;
        };
        if let Err(why) = may_point(context, by, action.station) {
            let why = format!("waypoint {waypoint} has a payload action (13004): {why}");
            return Err((Some(waypoint), why));
        }
    }
    Ok(())
}

fn may_point(context: &Context<'_>, by: Id, station: u8) -> Result<(), String> {
    if context.rights.holds_station(by, station) {
        return Ok(());
    }
    Err(format!(
        "it needs LOI 3 (payload) of station {station} in addition to LOI 4; this CUCS holds {}",
        context.rights.held(by).in_words()
    ))
}

/// Checks whether a 13004 may become part of a plan.
///
/// # Errors
/// Why not, for its sender.
pub(super) fn admit(
    context: &Context<'_>,
    origin: &Origin,
    message: &PayloadActionWaypoint,
    effects: &mut Effects<'_>,
) -> Result<(), String> {
    if context.provisional(origin.station) != Provisional::All {
        return Err(
            "its layout is derived from Edition 2: it is stored with dli.provisional = \"all\" only"
                .to_owned(),
        );
    }
    let action = PayloadAction::of(message)?;
    let number = action.station;
    let by = context.asker(origin.station).map(|asker| asker.id);
    let by = by.ok_or("its sender is not configured")?;
    may_point(context, by, number)?;
    if !context.vehicle.live() {
        return Err("no data from the vehicle".to_owned());
    }
    let all = context.equipment();
    let equipment = all.into_iter().find(|one| one.number == number);
    let equipment =
        equipment.ok_or_else(|| format!("the vehicle has no payload station {number}"))?;
    let station = Station::of(equipment, &context.vehicle.payloads, context.mono());
    if let Some(pointing) = action.pointing {
        let autopilot = effects.vehicle.autopilot().component;
        let gimbal = (station.gimbal).filter(|gimbal| gimbal.manager == Some(autopilot));
        let gimbal = gimbal.ok_or_else(|| {
            format!(
                "station {number} has no gimbal that the autopilot steers (GIMBAL_MANAGER_INFORMATION), and a mission points no \
                 other: command it in flight (19100, 19001)"
            )
        })?;
        if let (Pointing::Angles(to), Some(regard)) = (pointing, gimbal.regard) {
            regard.reaches(to, ["Payload Az", "Payload El"])?;
        }
    }
    if action.thermal.is_some() {
        let thermal_too = CameraCapFlags::CAMERA_CAP_FLAGS_HAS_THERMAL_RANGE;
        let known = station.camera.and_then(|camera| camera.information);
        if !known.is_some_and(|known| known.can.contains(thermal_too)) {
            return Err(format!(
                "Sensor Output: the camera of station {number} reports no second sensor (CAMERA_INFORMATION), expected 0"
            ));
        }
        let camera = camera_of(number);
        if equipment.camera != Some(camera) {
            return Err(format!(
                "Sensor Output: a mission switches the sensor of station {number} by camera {camera}, and its camera is {}",
                equipment.camera.unwrap_or(0)
            ));
        }
    }
    Ok(())
}
