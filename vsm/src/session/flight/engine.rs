//! Engines (2008): arming and disarming by PX4's own rules.
//!
//! PX4 arms all motors together, so an Engine Number only has to name an existing engine. Arming is never forced: PX4
//! refuses to disarm in the air and to arm when it is not ready, and its reason is passed on. The vehicle is put in
//! AUTO.LOITER before it is armed on the ground: armed in AUTO.MISSION it would take off at once.

use std::time::Duration;

use mapping::mode::Px4Mode;
use mapping::status;
use stanag_msgs::enums::{CommandedEngineState as Wanted, OffOnNotspec, ReverseThrust};
use stanag_msgs::messages::EngineCommand;

use crate::session::link::state::VehicleState;
use crate::session::maneuver::{self, Confirmation, Step};

/// The result of a 2008.
pub(super) enum Task {
    /// These steps.
    Steps(Vec<Step>),
    /// Nothing is sent: the vehicle already reports the state; a newer report confirms it.
    Look(Step),
}

/// The requested state of a 2008, and the steps to it.
///
/// # Errors
/// The reason, for the operator.
pub(super) fn steps(
    command: &EngineCommand,
    vehicle: &VehicleState,
) -> Result<(Wanted, Task), String> {
    let vehicle = &vehicle.telemetry;
    let engines = status::engines(vehicle);
    if let Some(number) = command.engine_number
        && engines > 0
        && number > engines
    {
        return Err(format!("Engine Number {number}, it has {engines}"));
    }
    if matches!(
        command.reverse_thrust,
        Some(ReverseThrust::On | ReverseThrust::Auto)
    ) || command.reverse_thrust_power == Some(OffOnNotspec::On)
    {
        return Err("PX4 has no command for reverse thrust".to_owned());
    }
    if command.ignition_switch_power == Some(OffOnNotspec::On)
        || command.ignition_switch_activation == Some(OffOnNotspec::On)
    {
        return Err("PX4 has no command for an ignition".to_owned());
    }
    let wanted = command.engine_command.ok_or("Engine Command is missing")?;
    let arm = |armed: bool| {
        let (what, confirmation) = if armed {
            ("arming", Confirmation::Armed)
        } else {
            ("disarming", Confirmation::Disarmed)
        };
        let command = Step::Command {
            command: maneuver::arm(armed),
            what,
            // PX4 answers TEMPORARILY_REJECTED to a disarming in flight, too: that is passed on, not retried.
            patience: if armed { ARM_PATIENCE } else { Duration::ZERO },
        };
        let confirm = Step::Confirm {
            confirmation,
            within: STATE_WITHIN,
        };
        [command, confirm]
    };
    match wanted {
        Wanted::Stop => Ok((wanted, Task::Steps(arm(false).into()))),
        // Nothing is sent to an armed vehicle: AUTO.LOITER would take a flying vehicle out of its mode. A report after the
        // last command shows whether it is still armed.
        Wanted::Start | Wanted::Enable if vehicle.armed == Some(true) => {
            let [_, confirm] = arm(true);
            Ok((wanted, Task::Look(confirm)))
        }
        Wanted::Start | Wanted::Enable => {
            let mut steps: Vec<Step> = maneuver::enter(&[Px4Mode::LOITER]).into();
            steps.extend(arm(true));
            Ok((wanted, Task::Steps(steps)))
        }
        other => Err(format!("Engine Command {} is not known", other.raw())),
    }
}

/// After its start PX4 refuses to arm for some seconds.
const ARM_PATIENCE: Duration = Duration::from_secs(8);
/// HEARTBEAT comes at 1 Hz, and some of them are lost.
const STATE_WITHIN: Duration = Duration::from_secs(6);
