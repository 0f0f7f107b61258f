//! What the vehicle does without this VSM: its own failsafe, and commands of other stations.

use stanag_msgs::enums::{AlertPriority, SubsystemId};

use super::aircraft::Aircraft;
use super::alerts::Cause;
use super::desk::Desk;

impl Aircraft {
    /// PX4's own reaction to the loss of this VSM, as its parameters say. It is changed only on command.
    pub(super) fn say_own_failsafe(&mut self, desk: &mut Desk<'_>) {
        let (Some(action), Some(after_s)) =
            (self.parameter(LOSS_ACTION), self.parameter(LOSS_TIME))
        else {
            return;
        };
        let text = format!(
            "without this link the vehicle {} after {after_s} s (NAV_DLL_ACT {action}, COM_DL_LOSS_T {after_s})",
            what_it_does(action)
        );
        let raised = self.alerts.raise(
            Cause::OwnFailsafe,
            AlertPriority::Nominal,
            SubsystemId::Comms,
            text,
        );
        let listeners = desk.listeners(&self.authority, None);
        desk.alert(self.id(), &listeners, raised);
    }

    /// The vehicle has answered a command that is not this VSM's: another station commands it beside us.
    pub(super) fn say_foreign_command(&mut self, desk: &mut Desk<'_>, system: u8, command: u32) {
        let text = format!(
            "MAVLink system {system} commands the vehicle too: command {command}, not through this VSM"
        );
        self.tell_once(desk, AlertPriority::Warning, text);
    }

    /// Something that happened on the vehicle's side, to all who listen.
    pub(super) fn tell_once(&mut self, desk: &mut Desk<'_>, priority: AlertPriority, text: String) {
        let raised = self
            .alerts
            .notice(desk.now.mono, priority, SubsystemId::Comms, text);
        let listeners = desk.listeners(&self.authority, None);
        desk.alert(self.id(), &listeners, raised);
    }
}

/// NAV_DLL_ACT as PX4 documents it.
fn what_it_does(action: f64) -> &'static str {
    match action as i64 {
        0 => "goes on as it is",
        1 => "holds",
        2 => "returns",
        3 => "lands",
        5 => "terminates its flight",
        6 => "disarms",
        _ => "does something that is not known here",
    }
}

/// What PX4 does when it hears no ground station.
const LOSS_ACTION: &str = "NAV_DLL_ACT";
/// After how long it does so, s.
const LOSS_TIME: &str = "COM_DL_LOSS_T";
