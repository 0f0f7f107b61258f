//! The vehicle's side of control: who may command it as MAVLink has it, commands of other stations, and what it does
//! without this VSM.
//!
//! Where the vehicle tells who may command it (CONTROL_STATUS), the VSM takes operator control
//! (REQUEST_OPERATOR_CONTROL) for as long as a CUCS holds LOI 4 or 5, or the VSM flies for one that is lost, and lets
//! it go when nobody does: what is decided between the CUCSs is then seen by other MAVLink stations, and holds against
//! them. It asks that no other be granted it unasked; who asks for it is told to the CUCS, which decides by giving
//! control up. A vehicle that does not tell is asked for nothing.

use std::time::Duration;

use mavlink_link::dialect::{CONTROL_STATUS_DATA, GcsControlStatusFlags, MavCmd};
use mavlink_link::service::command::{self, Command, Payload, Repetition, Ticket};
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use super::aircraft::Aircraft;
use super::alerts::Cause;
use super::desk::Desk;

/// What the vehicle tells of it, and what is asked for.
#[derive(Debug, Default)]
pub(super) struct OperatorControl {
    /// Who may command, 0 for nobody, and when that was told.
    told: Option<(u8, Duration)>,
    ticket: Option<Ticket>,
    next_at: Duration,
}

impl OperatorControl {
    /// Who may command the vehicle, 0 for nobody; `None` where it does not tell.
    pub(super) fn owner(&self, now: Duration) -> Option<u8> {
        let (owner, at) = self.told?;
        (now.saturating_sub(at) < STALE).then_some(owner)
    }

    /// Control has changed hands: what follows is asked for at once.
    pub(super) fn soon(&mut self) {
        self.next_at = Duration::ZERO;
    }

    /// The end of a command: the next CONTROL_STATUS tells what came of it.
    pub(super) fn answered(&mut self, event: &command::Event) {
        if let command::Event::Done { ticket, .. } = event
            && self.ticket == Some(*ticket)
        {
            self.ticket = None;
        }
    }
}

impl Aircraft {
    /// CONTROL_STATUS.
    pub(super) fn take_control_status(
        &mut self,
        desk: &mut Desk<'_>,
        status: &CONTROL_STATUS_DATA,
    ) {
        let manager = GcsControlStatusFlags::GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER;
        if !status.flags.contains(manager) {
            return;
        }
        let own = self.mav.own_system();
        // Where several own it, each of them may command.
        let owner = if status.gcs_secondary.contains(&own) {
            own
        } else {
            status.gcs_main
        };
        self.operator_control.told = Some((owner, desk.now.mono));
        self.say_operator_control(desk, owner);
        self.tend_operator_control(desk);
    }

    fn say_operator_control(&mut self, desk: &mut Desk<'_>, owner: u8) {
        let own = self.mav.own_system();
        let raised = match owner {
            0 => self.alerts.clear(
                Cause::OperatorControl,
                "no MAVLink system has operator control of the vehicle any more",
            ),
            system if system == own => self.alerts.clear(
                Cause::OperatorControl,
                "this VSM has operator control of the vehicle",
            ),
            system => self.alerts.raise(
                Cause::OperatorControl,
                AlertPriority::Warning,
                SubsystemId::Comms,
                format!(
                    "MAVLink system {system} has operator control of the vehicle: it refuses commands of this VSM"
                ),
            ),
        };
        let listeners = desk.listeners(&self.authority, None);
        desk.alert(self.id(), &listeners, raised);
    }

    /// Takes operator control, or lets it go, where the vehicle speaks of it.
    pub(super) fn tend_operator_control(&mut self, desk: &mut Desk<'_>) {
        let now = desk.now.mono;
        let Some(owner) = self.operator_control.owner(now) else {
            return;
        };
        let own = self.mav.own_system();
        let wanted = self.authority.controller().is_some() || self.loss_action.is_some();
        let waits = self.operator_control.ticket.is_some() || self.operator_control.next_at > now;
        if wanted == (owner == own) || waits || !self.mav.live() {
            return;
        }
        self.operator_control.next_at = now + BETWEEN;
        let params = [
            f32::from(u8::from(wanted)),
            0.0,
            ASKED_FOR_S,
            f32::from(own),
            0.0,
            0.0,
            0.0,
        ];
        let command = Command {
            command: MavCmd::MAV_CMD_REQUEST_OPERATOR_CONTROL,
            payload: Payload::Long(params),
            repetition: Repetition::Safe,
        };
        // A full queue is tried again later.
        self.operator_control.ticket = self.mav.commands.submit(now, command).ok();
    }

    /// Another station asks for operator control: the CUCS that holds control decides.
    pub(super) fn say_control_asked(&mut self, desk: &mut Desk<'_>, system: u8) {
        let text = format!(
            "MAVLink system {system} asks for operator control of the vehicle: it can have it once control is given up"
        );
        self.tell_once(desk, AlertPriority::Warning, text);
    }

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
/// CONTROL_STATUS comes at 1 Hz.
const STALE: Duration = Duration::from_secs(5);
/// From one try to the next.
const BETWEEN: Duration = Duration::from_secs(2);
/// param3 of the request: how long another station is shown that it waits, s.
const ASKED_FOR_S: f32 = 10.0;
