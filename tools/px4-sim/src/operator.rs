//! Operator control, as the development dialect of MAVLink drafts it (REQUEST_OPERATOR_CONTROL 32100, CONTROL_STATUS
//! 512): one ground station owns the vehicle, and what changes its state is taken from that one alone. PX4 v1.18 does
//! not speak it, so it is off unless [`Config::operator_control`](super::Config::operator_control) says otherwise.

use mavlink::dialects::development::{
    COMMAND_LONG_DATA, CONTROL_STATUS_DATA, GcsControlStatusFlags, MavCmd, MavMessage,
};
use mavlink_link::service::Node;

use super::command::Command;
use super::dispatch::Answer;
use super::vehicle::Vehicle;

/// Who owns the vehicle.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Operator {
    /// System id; 0 for nobody.
    owner: u8,
    /// Another is granted it without a question.
    open: bool,
    /// When the owner's heartbeat came last, s.
    heard: f64,
    /// When CONTROL_STATUS is sent next, s.
    due: f64,
}

impl Vehicle {
    /// Whether what a system sends may change the vehicle's state.
    pub(super) fn obeys(&self, from: Node) -> bool {
        !self.config.operator_control
            || [0, from.system].contains(&self.operator.owner)
            || from.system == self.config.system_id
    }

    /// MAV_RESULT_NOT_IN_CONTROL for a command of another than the owner; what only asks is answered to everybody.
    pub(super) fn refuse_stranger(&self, command: &Command) -> Option<Answer> {
        let asks = ASKS.contains(&command.id) || command.id == REQUEST;
        (!asks && !self.obeys(command.from)).then_some(Answer::NotInControl)
    }

    /// The owner's heartbeat.
    pub(super) fn hear_operator(&mut self, from: Node) {
        if from.system == self.operator.owner {
            self.operator.heard = self.now();
        }
    }

    /// REQUEST_OPERATOR_CONTROL.
    pub(super) fn request_operator_control(&mut self, c: &Command) -> Answer {
        if !self.config.operator_control {
            return Answer::Unsupported;
        }
        let (from, owner) = (c.from.system, self.operator.owner);
        let now = self.now();
        if c.param(1) == 0.0 {
            if owner != from {
                return Answer::Failed;
            }
            self.operator = Operator::default();
            return Answer::Accepted;
        }
        if owner == 0 || owner == from || self.operator.open {
            self.operator = Operator {
                owner: from,
                open: c.param(2) == 1.0,
                heard: now,
                due: now,
            };
            return Answer::Accepted;
        }
        // The owner is told who asks.
        let [param1, param2, param3, param4, ..] = c.params.map(|param| param as f32);
        self.send(MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
            command: MavCmd::MAV_CMD_REQUEST_OPERATOR_CONTROL,
            target_system: owner,
            param1,
            param2,
            param3,
            param4,
            ..COMMAND_LONG_DATA::default()
        }));
        Answer::Failed
    }

    /// Tells the owner, at 1 Hz and when it changes; one that is not heard any more owns nothing.
    pub(super) fn tell_operator(&mut self, now: f64) {
        if !self.config.operator_control || !self.is_located() {
            return;
        }
        if self.operator.owner != 0 && now - self.operator.heard > OWNER_LOST_S {
            self.operator = Operator::default();
        }
        if now < self.operator.due {
            return;
        }
        self.operator.due = now + 1.0;
        let mut flags = GcsControlStatusFlags::GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER;
        if self.operator.open {
            flags |= GcsControlStatusFlags::GCS_CONTROL_STATUS_FLAGS_TAKEOVER_ALLOWED;
        }
        self.send(MavMessage::CONTROL_STATUS(CONTROL_STATUS_DATA {
            flags,
            gcs_main: self.operator.owner,
            gcs_secondary: [0; 10],
        }));
    }
}

/// Whether a message changes the state of a vehicle, commands apart.
#[allow(deprecated, reason = "PX4 speaks what MAVLink has replaced")]
pub(super) fn changes_state(message: &MavMessage) -> bool {
    use MavMessage as M;
    matches!(
        message,
        M::SET_MODE(_)
            | M::MANUAL_CONTROL(_)
            | M::SET_POSITION_TARGET_LOCAL_NED(_)
            | M::SET_POSITION_TARGET_GLOBAL_INT(_)
            | M::MISSION_COUNT(_)
            | M::MISSION_CLEAR_ALL(_)
            | M::MISSION_SET_CURRENT(_)
            | M::PARAM_SET(_)
    )
}

/// MAV_CMD_REQUEST_OPERATOR_CONTROL.
pub(super) const REQUEST: u16 = 32_100;
/// GET_HOME_POSITION, GET_MESSAGE_INTERVAL, SET_MESSAGE_INTERVAL, REQUEST_MESSAGE, REQUEST_AUTOPILOT_CAPABILITIES.
const ASKS: [u16; 5] = [410, 510, 511, 512, 520];
/// COM_DL_LOSS_T by default.
const OWNER_LOST_S: f64 = 10.0;
