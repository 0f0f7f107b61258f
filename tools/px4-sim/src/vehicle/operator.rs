//! Operator control, as drafted in MAVLink's development dialect (REQUEST_OPERATOR_CONTROL 32100, CONTROL_STATUS
//! 512): one ground station owns the vehicle, and only that one may change its state. PX4 v1.18 does not implement
//! it, so it is off unless [`Config::operator_control`](crate::Config::operator_control) is set.

use mavlink::dialects::development::{
    CONTROL_STATUS_DATA, GcsControlStatusFlags, MavCmd, MavMessage,
};
use mavlink_link::service::{Node, command};

use super::command::{Answer, Command, REQUEST_OPERATOR_CONTROL};

/// Who owns the vehicle.
#[derive(Debug, Clone, Copy)]
pub(crate) struct OperatorControl {
    enabled: bool,
    /// System id of the vehicle itself, which may always change its state.
    own_system: u8,
    owner: Owner,
}

#[derive(Debug, Clone, Copy, Default)]
struct Owner {
    /// System id; 0 for nobody.
    system: u8,
    /// Whether a takeover is granted without a request to the owner.
    takeover_allowed: bool,
    /// When the owner's last HEARTBEAT arrived, s.
    last_heartbeat: f64,
    /// When CONTROL_STATUS is sent next, s.
    due: f64,
}

impl OperatorControl {
    /// Nobody owns the vehicle.
    pub(crate) fn new(enabled: bool, own_system: u8) -> Self {
        Self {
            enabled,
            own_system,
            owner: Owner::default(),
        }
    }

    /// Whether messages of this node may change the vehicle's state.
    pub(crate) fn obeys(&self, from: Node) -> bool {
        !self.enabled
            || [0, from.system].contains(&self.owner.system)
            || from.system == self.own_system
    }

    /// MAV_RESULT_NOT_IN_CONTROL for a command of a station that is not the owner. Commands that only request
    /// information are answered for everybody: a second station may monitor.
    pub(crate) fn refuse(&self, command: &Command) -> Option<Answer> {
        let harmless = READ_ONLY.contains(&command.id) || command.id == REQUEST_OPERATOR_CONTROL;
        (!harmless && !self.obeys(command.from)).then_some(Answer::NotInControl)
    }

    /// A HEARTBEAT arrived.
    pub(crate) fn heartbeat(&mut self, from: Node, now: f64) {
        if from.system == self.owner.system {
            self.owner.last_heartbeat = now;
        }
    }

    /// REQUEST_OPERATOR_CONTROL: the answer, and the message that forwards the request to the owner.
    pub(crate) fn request(&mut self, c: &Command, now: f64) -> (Answer, Option<MavMessage>) {
        if !self.enabled {
            return (Answer::Unsupported, None);
        }
        let (from, owner) = (c.from.system, self.owner.system);
        let takes = c.param(1) != 0.0;
        match takes {
            false if owner != from => (Answer::Failed, None),
            false => {
                self.owner = Owner::default();
                (Answer::Accepted, None)
            }
            true if owner == 0 || owner == from || self.owner.takeover_allowed => {
                self.owner = Owner {
                    system: from,
                    takeover_allowed: c.param(2) == 1.0,
                    last_heartbeat: now,
                    due: now,
                };
                (Answer::Accepted, None)
            }
            true => {
                let [param1, param2, param3, param4, ..] = c.params.map(|param| param as f32);
                let forwarded = command::long(
                    Node::new(owner, 0),
                    MavCmd::MAV_CMD_REQUEST_OPERATOR_CONTROL,
                    [param1, param2, param3, param4],
                );
                (Answer::Failed, Some(forwarded))
            }
        }
    }

    /// CONTROL_STATUS where it is due: at 1 Hz, and at once when the owner changes. An owner without heartbeats loses
    /// the vehicle.
    pub(crate) fn poll(&mut self, now: f64) -> Option<MavMessage> {
        if !self.enabled {
            return None;
        }
        if self.owner.system != 0 && now - self.owner.last_heartbeat > OWNER_LOST_S {
            self.owner = Owner::default();
        }
        if now < self.owner.due {
            return None;
        }
        self.owner.due = now + 1.0;
        let mut flags = GcsControlStatusFlags::GCS_CONTROL_STATUS_FLAGS_SYSTEM_MANAGER;
        if self.owner.takeover_allowed {
            flags |= GcsControlStatusFlags::GCS_CONTROL_STATUS_FLAGS_TAKEOVER_ALLOWED;
        }
        Some(MavMessage::CONTROL_STATUS(CONTROL_STATUS_DATA {
            flags,
            gcs_main: self.owner.system,
            gcs_secondary: [0; 10],
        }))
    }
}

/// Whether a message (other than a command) changes the state of a vehicle.
#[allow(
    deprecated,
    reason = "PX4 still uses messages that MAVLink has replaced"
)]
pub(crate) fn changes_state(message: &MavMessage) -> bool {
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

/// GET_HOME_POSITION, GET_MESSAGE_INTERVAL, SET_MESSAGE_INTERVAL, REQUEST_MESSAGE, REQUEST_AUTOPILOT_CAPABILITIES.
const READ_ONLY: [u16; 5] = [410, 510, 511, 512, 520];
/// The default of COM_DL_LOSS_T, s.
const OWNER_LOST_S: f64 = 10.0;
