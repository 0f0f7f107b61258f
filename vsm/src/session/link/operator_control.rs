//! MAVLink's operator control: which MAVLink system may command the vehicle.
//!
//! If the vehicle reports who may command it (CONTROL_STATUS), the VSM requests operator control (REQUEST_OPERATOR_CONTROL)
//! while a CUCS holds LOI 4 or 5, or while the VSM flies for a lost CUCS, and releases it afterwards. Other MAVLink stations
//! then see the control decided between the CUCSs and cannot command against it. The VSM requests that no other system is
//! granted control without its consent. A request by another system is reported to the CUCS, which grants it by releasing
//! control. If the vehicle does not report operator control, nothing is requested (PX4 v1.18 does not).

use std::time::Duration;

use mavlink_link::dialect::{CONTROL_STATUS_DATA, GcsControlStatusFlags, MavCmd};
use mavlink_link::service::command::{self, Command, Payload, Repetition, Ticket};
use stanag_msgs::enums::{AlertPriority, SubsystemId};

use super::state::VehicleState;
use crate::session::alerts::Cause;
use crate::session::effects::Effects;

/// The reported operator control, and the request for it.
#[derive(Debug, Default)]
pub(crate) struct OperatorControl {
    /// The system that may command (0: none), and when that was reported.
    reported: Option<(u8, Duration)>,
    ticket: Option<Ticket>,
    next_at: Duration,
    /// Whether it is held or requested although no CUCS controls the vehicle, or the reverse.
    pending: bool,
}

impl OperatorControl {
    /// The system that may command the vehicle (0: none); `None` if the vehicle does not report it.
    pub(crate) fn owner(&self, now: Duration) -> Option<u8> {
        let (owner, at) = self.reported?;
        (now.saturating_sub(at) < STALE).then_some(owner)
    }

    /// Control has changed: the next request need not wait.
    pub(crate) fn soon(&mut self) {
        self.next_at = Duration::ZERO;
    }

    /// A command has ended: the next CONTROL_STATUS shows its effect.
    pub(crate) fn answered(&mut self, event: &command::Event) {
        if let command::Event::Done { ticket, .. } = event
            && self.ticket == Some(*ticket)
        {
            self.ticket = None;
        }
    }

    /// When the next request may be sent, if one is needed.
    pub(crate) fn poll_timeout(&self) -> Option<Duration> {
        self.pending.then_some(self.next_at)
    }

    /// Handles a CONTROL_STATUS of the vehicle.
    pub(crate) fn note(&mut self, status: &CONTROL_STATUS_DATA, effects: &mut Effects<'_>) {
        let manager = GcsControlStatusFlags::GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER;
        // Without this flag it is the status of one component, not of the whole system.
        if !status.flags.contains(manager) {
            return;
        }
        let own = effects.vehicle.own_system();
        // If several systems own it, each of them may command.
        let owner = if status.gcs_secondary.contains(&own) {
            own
        } else {
            status.gcs_main
        };
        self.reported = Some((owner, effects.dli.now.mono));
        match owner {
            0 => effects.clear(
                Cause::OperatorControl,
                "no MAVLink system has operator control of the vehicle now",
            ),
            system if system == own => effects.clear(
                Cause::OperatorControl,
                "this VSM has operator control of the vehicle",
            ),
            system => effects.raise(
                Cause::OperatorControl,
                AlertPriority::Warning,
                SubsystemId::Comms,
                format!(
                    "MAVLink system {system} has operator control of the vehicle: it refuses commands of this VSM"
                ),
            ),
        }
    }

    /// Requests operator control if it is `wanted`, otherwise releases it. Does nothing for a vehicle that does not report
    /// it.
    pub(crate) fn hold(&mut self, wanted: bool, vehicle: &VehicleState, effects: &mut Effects<'_>) {
        let now = effects.dli.now.mono;
        let own = effects.vehicle.own_system();
        let Some(owner) = self.owner(now) else {
            self.pending = false;
            return;
        };
        self.pending = wanted != (owner == own) && self.ticket.is_none() && vehicle.live();
        if !self.pending || self.next_at > now {
            return;
        }
        self.next_at = now + BETWEEN;
        // param1: request or release; param2 = 0: nobody else is granted it automatically; param4: who requests it.
        let params = [
            f32::from(u8::from(wanted)),
            0.0,
            SHOWN_FOR_S,
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
        self.ticket = effects.vehicle.commands.submit(now, command).ok();
        self.pending = self.ticket.is_none();
    }
}

/// CONTROL_STATUS comes at 1 Hz.
const STALE: Duration = Duration::from_secs(5);
/// Time between two attempts.
const BETWEEN: Duration = Duration::from_secs(2);
/// param3 of the request: how long another station is shown a pending request, s.
const SHOWN_FOR_S: f32 = 10.0;

#[cfg(test)]
mod tests {
    use mavlink_link::dialect::{MavMessage, MavResult};
    use stanag_msgs::enums::AlertPriority;

    use super::*;
    use crate::session::testing::World;

    const OWN: u8 = 245;

    fn report(world: &mut World, control: &mut OperatorControl, owner: u8) {
        let status = CONTROL_STATUS_DATA {
            gcs_main: owner,
            flags: GcsControlStatusFlags::GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER,
            ..CONTROL_STATUS_DATA::default()
        };
        world.act(|_, _, effects| control.note(&status, effects));
    }

    /// What is requested now: `true` for control, `false` for its release.
    fn hold(world: &mut World, control: &mut OperatorControl, wanted: bool) -> Option<bool> {
        world.act(|context, _, effects| control.hold(wanted, context.vehicle, effects));
        match world.services.commands.poll_transmit() {
            Some(MavMessage::COMMAND_LONG(sent)) => {
                assert_eq!(sent.command, MavCmd::MAV_CMD_REQUEST_OPERATOR_CONTROL);
                assert_eq!(sent.param4, f32::from(OWN));
                Some(sent.param1 == 1.0)
            }
            other => {
                assert_eq!(other, None);
                None
            }
        }
    }

    fn answer(world: &mut World, control: &mut OperatorControl) {
        let command = MavCmd::MAV_CMD_REQUEST_OPERATOR_CONTROL;
        for event in world.answer(command, MavResult::MAV_RESULT_ACCEPTED) {
            control.answered(&event);
        }
    }

    #[test]
    fn nothing_is_requested_of_a_vehicle_that_does_not_report_it_or_no_longer() {
        let (mut world, mut control) = (World::new(), OperatorControl::default());
        assert_eq!(hold(&mut world, &mut control, true), None);
        report(&mut world, &mut control, 0);
        world.advance(STALE);
        assert_eq!(hold(&mut world, &mut control, true), None);
        assert_eq!(control.poll_timeout(), None);
    }

    #[test]
    fn control_is_requested_until_it_is_shown_and_released_when_it_is_not_wanted() {
        let (mut world, mut control) = (World::new(), OperatorControl::default());
        report(&mut world, &mut control, 0);
        assert_eq!(hold(&mut world, &mut control, false), None);
        assert_eq!(hold(&mut world, &mut control, true), Some(true));
        assert_eq!(hold(&mut world, &mut control, true), None, "unanswered");
        answer(&mut world, &mut control);
        assert_eq!(hold(&mut world, &mut control, true), None, "not at once");
        assert_eq!(control.poll_timeout(), Some(world.now.mono + BETWEEN));
        world.advance(BETWEEN);
        assert_eq!(hold(&mut world, &mut control, true), Some(true));
        answer(&mut world, &mut control);
        report(&mut world, &mut control, OWN);
        assert_eq!(hold(&mut world, &mut control, true), None);
        assert_eq!(control.poll_timeout(), None);
        // Control has passed to nobody: the release need not wait.
        control.soon();
        assert_eq!(hold(&mut world, &mut control, false), Some(false));
    }

    #[test]
    fn another_owner_is_warned_of_until_this_vsm_is_shown() {
        let (mut world, mut control) = (World::new(), OperatorControl::default());
        report(&mut world, &mut control, 250);
        let standing: Vec<_> = world.alerts.standing().map(|one| one.priority).collect();
        assert_eq!(standing, [AlertPriority::Warning]);
        report(&mut world, &mut control, OWN);
        assert_eq!(world.alerts.standing().count(), 0);
        assert_eq!(control.owner(world.now.mono), Some(OWN));
    }
}
