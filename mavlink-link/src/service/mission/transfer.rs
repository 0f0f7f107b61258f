//! What all operations of a mission client share: repeats, progress and the short messages.

use std::time::Duration;

use mavlink::dialects::development::{
    MISSION_ACK_DATA, MISSION_CLEAR_ALL_DATA, MISSION_SET_CURRENT_DATA, MavMessage,
    MavMissionResult, MavMissionType,
};

use super::event::{Event, Operation, Timing};
use crate::frame::Node;
use crate::service::bounded::Bounded;

/// A message sent again until something answers it.
#[derive(Debug)]
pub(super) struct Repeat {
    pub(super) at: Duration,
    pub(super) left: u8,
}

/// What a job needs of its client while it works.
pub(super) struct Context<'a> {
    pub(super) vehicle: Node,
    pub(super) timing: Timing,
    pub(super) out: &'a mut Bounded<MavMessage>,
    pub(super) events: &'a mut Bounded<Event>,
}

impl Repeat {
    pub(super) fn first(now: Duration, timing: &Timing) -> Self {
        Self {
            at: now + timing.first_answer,
            left: timing.first_tries.saturating_sub(1),
        }
    }

    /// Whether it may be sent once more, now.
    pub(super) fn again(&mut self, now: Duration, timing: &Timing) -> bool {
        let Some(left) = self.left.checked_sub(1) else {
            return false;
        };
        self.left = left;
        self.at = now + timing.first_answer;
        true
    }
}

impl Context<'_> {
    pub(super) fn progress(&mut self, operation: Operation, done: u16, total: u16) {
        let percent = u32::from(done) * 100 / u32::from(total.max(1));
        let event = Event::Progress {
            operation,
            done,
            total,
            percent: u8::try_from(percent).unwrap_or(100),
        };
        match self.events.last_mut() {
            Some(last @ Event::Progress { .. }) => *last = event,
            _ => {
                self.events.push(event);
            }
        }
    }

    pub(super) fn cancel(&mut self, kind: MavMissionType) {
        self.out.push(cancel(self.vehicle, kind));
    }
}

pub(super) fn cancel(vehicle: Node, kind: MavMissionType) -> MavMessage {
    ack(
        vehicle,
        kind,
        MavMissionResult::MAV_MISSION_OPERATION_CANCELLED,
    )
}

pub(super) fn ack(vehicle: Node, kind: MavMissionType, result: MavMissionResult) -> MavMessage {
    MavMessage::MISSION_ACK(MISSION_ACK_DATA {
        target_system: vehicle.system,
        target_component: vehicle.component,
        mavtype: result,
        mission_type: kind,
        opaque_id: 0,
    })
}

pub(super) fn clear_all(vehicle: Node, kind: MavMissionType) -> MavMessage {
    MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
        target_system: vehicle.system,
        target_component: vehicle.component,
        mission_type: kind,
    })
}

pub(super) fn set_current(vehicle: Node, seq: u16) -> MavMessage {
    MavMessage::MISSION_SET_CURRENT(MISSION_SET_CURRENT_DATA {
        seq,
        target_system: vehicle.system,
        target_component: vehicle.component,
    })
}
