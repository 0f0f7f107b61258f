//! What a mission client is busy with, and what all its jobs have in common.

use std::ops::RangeInclusive;
use std::time::Duration;

use mavlink::dialects::development::{
    MISSION_ACK_DATA, MISSION_CLEAR_ALL_DATA, MISSION_SET_CURRENT_DATA, MavMessage,
    MavMissionResult, MavMissionType,
};

use super::download::Download;
use super::event::{Event, Failure, Operation, Timing};
use super::upload::Upload;
use crate::service::{Bounded, Node};

/// The present operation.
#[derive(Debug)]
pub(super) enum Job {
    Upload(Upload),
    Download(Download),
    Clear {
        kind: MavMissionType,
        repeat: Repeat,
    },
    SetCurrent {
        /// The one to be set, and what shows that it was.
        items: RangeInclusive<u16>,
        repeat: Repeat,
    },
}

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

impl Job {
    pub(super) fn operation(&self) -> Operation {
        match self {
            Self::Upload(_) => Operation::Upload,
            Self::Download(_) => Operation::Download,
            Self::Clear { .. } => Operation::Clear,
            Self::SetCurrent { .. } => Operation::SetCurrent,
        }
    }

    pub(super) fn kind(&self) -> MavMissionType {
        match self {
            Self::Upload(upload) => upload.kind(),
            Self::Download(download) => download.kind(),
            Self::Clear { kind, .. } => *kind,
            Self::SetCurrent { .. } => MavMissionType::MAV_MISSION_TYPE_MISSION,
        }
    }

    pub(super) fn expects(&self, message: &MavMessage) -> bool {
        use MavMessage as M;
        match (self, message) {
            (Self::Upload(_), M::MISSION_REQUEST(_) | M::MISSION_REQUEST_INT(_))
            | (Self::Download(_), M::MISSION_COUNT(_))
            | (Self::Download(_), M::MISSION_ITEM_INT(_) | M::MISSION_ITEM(_))
            | (Self::SetCurrent { .. }, M::MISSION_CURRENT(_)) => true,
            (Self::SetCurrent { .. }, _) => false,
            (_, M::MISSION_ACK(_)) => true,
            _ => false,
        }
    }

    pub(super) fn handle_message(
        &mut self,
        now: Duration,
        message: &MavMessage,
        context: &mut Context<'_>,
    ) -> Option<Result<Event, Failure>> {
        match (self, message) {
            (Self::Upload(upload), _) => upload.handle_message(now, message, context),
            (Self::Download(download), _) => download.handle_message(now, message, context),
            (Self::Clear { kind, .. }, MavMessage::MISSION_ACK(ack)) => match ack.mavtype {
                // The acknowledgement of an upload names a plan, and is a late one.
                MavMissionResult::MAV_MISSION_ACCEPTED if ack.opaque_id == 0 => {
                    Some(Ok(Event::Cleared { kind: *kind }))
                }
                MavMissionResult::MAV_MISSION_ACCEPTED
                | MavMissionResult::MAV_MISSION_ERROR
                | MavMissionResult::MAV_MISSION_INVALID_SEQUENCE => None,
                result => Some(Err(Failure::Refused { result, seq: None })),
            },
            (Self::SetCurrent { items, .. }, MavMessage::MISSION_CURRENT(current)) => items
                .contains(&current.seq)
                .then_some(Ok(Event::CurrentSet {
                    seq: *items.start(),
                })),
            _ => None,
        }
    }

    pub(super) fn handle_timeout(
        &mut self,
        now: Duration,
        context: &mut Context<'_>,
    ) -> Option<Result<Event, Failure>> {
        let (repeat, message, seq) = match self {
            Self::Upload(upload) => return upload.handle_timeout(now, context),
            Self::Download(download) => return download.handle_timeout(now, context),
            Self::Clear { kind, repeat } => (repeat, clear_all(context.vehicle, *kind), None),
            Self::SetCurrent { items, repeat } => {
                let seq = *items.start();
                (repeat, set_current(context.vehicle, seq), Some(seq))
            }
        };
        if !repeat.again(now, &context.timing) {
            return Some(Err(Failure::NoAnswer { seq }));
        }
        context.out.push(message);
        None
    }

    pub(super) fn deadline(&self) -> Duration {
        match self {
            Self::Upload(upload) => upload.deadline(),
            Self::Download(download) => download.deadline(),
            Self::Clear { repeat, .. } | Self::SetCurrent { repeat, .. } => repeat.at,
        }
    }
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
