//! Whether a held command would take the vehicle from its pilot, a failsafe, the loss action or a contingency.

use stanag_msgs::Message;
use stanag_msgs::messages::{EngineCommand, MissionTransferCommand, VehicleOperatingModeCommand};

use super::input::Context;
use crate::session::other::Other;

/// Whether a command of this kind takes the vehicle from its pilot or failsafe.
pub(super) fn moves(message_type: u16) -> bool {
    matches!(
        message_type,
        VehicleOperatingModeCommand::ID | EngineCommand::ID | MissionTransferCommand::ID
    )
}

/// Checks that nobody else flies the vehicle. An operator sees the effect of a command sent now; a command from an hour ago
/// takes no account of a pilot or failsafe that has taken the vehicle since.
pub(super) fn undisturbed(
    context: &Context<'_>,
    message: &Message,
    for_loss: bool,
) -> Result<(), String> {
    if !moves(message.id()) {
        return Ok(());
    }
    if context.flight.loss_action {
        return Err("the vehicle flies the loss action".to_owned());
    }
    if context.flight.contingency {
        return Err("the vehicle flies a contingency (vehicle.contingency)".to_owned());
    }
    flown_from_here(context, message, for_loss)
}

/// As [`undisturbed`], but without the loss action: a command for the loss of the CUCS may start together with it.
pub(super) fn flown_from_here(
    context: &Context<'_>,
    message: &Message,
    for_loss: bool,
) -> Result<(), String> {
    let telemetry = &context.vehicle.telemetry;
    let armed = telemetry.armed == Some(true);
    if !moves(message.id()) || !(armed || telemetry.airborne()) {
        return Ok(());
    }
    let ends_never = for_loss && context.only_holds;
    match context
        .other
        .filter(|other| !(ends_never && other.may_stay()))
    {
        // On the ground a failsafe means nothing yet, but a pilot who has armed by hand is about to take off.
        Some(other @ Other::Pilot(_)) => Err(other.to_string()),
        Some(other) if !telemetry.stands() => Err(other.to_string()),
        None if telemetry.mode.is_none() => Err("the mode of the vehicle is not known".to_owned()),
        _ => Ok(()),
    }
}

/// Whether the vehicle is being put on hold, or is held by a failsafe that may still do more.
pub(super) fn holds_first(context: &Context<'_>) -> bool {
    context.flight.loss_action
        || (context.other.is_some_and(Other::may_stay) && !context.only_holds)
}
