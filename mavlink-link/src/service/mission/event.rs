//! What a mission client can be asked for, how it ends, and how long it waits.

use std::time::Duration;

use mavlink::dialects::development::{MavMissionResult, MavMissionType};

use super::item::{Item, UnknownInDialect};

/// Waits and repeats, chosen for a radio at 0.3 s round trip and PX4's own 0.25 s and 5 s.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Timing {
    /// Wait for the first answer (to COUNT, REQUEST_LIST, CLEAR_ALL, SET_CURRENT).
    pub first_answer: Duration,
    /// How often such a first message is sent in all.
    pub first_tries: u8,
    /// Wait before an item request, or the last item of an upload, is repeated.
    pub item: Duration,
    /// Without progress for this long the transfer is lost; longer than PX4's 5 s, after which
    /// it has forgotten the transfer without saying so.
    pub stall: Duration,
    /// Wait for the vehicle to go on after MAV_MISSION_ERROR.
    pub settle: Duration,
    /// How often a transfer is begun in all.
    pub attempts: u8,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            first_answer: Duration::from_millis(700),
            first_tries: 10,
            item: Duration::from_millis(400),
            stall: Duration::from_secs(6),
            settle: Duration::from_millis(1500),
            attempts: 4,
        }
    }
}

/// What a [`Client`](super::Client) can be busy with.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Operation {
    /// A plan on its way to the vehicle.
    Upload,
    /// A plan on its way from the vehicle.
    Download,
    /// MISSION_CLEAR_ALL.
    Clear,
    /// MISSION_SET_CURRENT.
    SetCurrent,
}

/// Why an operation was not begun.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum StartError {
    /// Another one has not ended.
    #[error("busy with {0:?}")]
    Busy(Operation),
    /// Too many events are unread: the end of this operation would have no room.
    #[error("events are unread")]
    Unread,
    /// An upload without items; clearing is an operation of its own.
    #[error("a plan without items")]
    Empty,
    /// More items than MISSION_COUNT.count can say.
    #[error("{0} items, at most 65535")]
    TooMany(usize),
    /// MAV_MISSION_TYPE_ALL can be cleared, not transferred.
    #[error("no single kind of plan")]
    Kind,
    /// An item that no message can carry.
    #[error("item {seq}: {fault}")]
    Item {
        /// Place of the item in the plan, from 0.
        seq: usize,
        /// What is unknown.
        fault: UnknownInDialect,
    },
}

/// Why an operation that was begun did not reach its end.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Failure {
    /// The vehicle said so by MISSION_ACK.
    Refused {
        /// MISSION_ACK.type
        result: MavMissionResult,
        /// The item it had asked for last; `None` when it had asked for none.
        seq: Option<u16>,
    },
    /// The vehicle acknowledged a plan, but not this one.
    OtherPlan {
        /// This plan's id.
        expected: u32,
        /// MISSION_ACK.opaque_id
        found: u32,
    },
    /// Every repeat went without an answer that helps.
    NoAnswer {
        /// The item the vehicle had asked for last, or the item asked of it.
        seq: Option<u16>,
    },
    /// The caller ended it.
    Cancelled,
}

/// What a [`Client`](super::Client) tells its caller.
#[derive(Clone, PartialEq, Debug)]
pub enum Event {
    /// A transfer went on. Unread progress is replaced, not queued.
    Progress {
        /// Which way.
        operation: Operation,
        /// Items that the receiver is known to hold.
        done: u16,
        /// Items of the plan.
        total: u16,
        /// 0..=100
        percent: u8,
    },
    /// The vehicle holds the plan.
    Uploaded {
        /// What kind of plan.
        kind: MavMissionType,
        /// MISSION_ACK.opaque_id, 0 from autopilots without plan ids.
        opaque_id: u32,
    },
    /// The plan aboard.
    Downloaded {
        /// What kind of plan.
        kind: MavMissionType,
        /// The items in order.
        items: Vec<Item>,
        /// MISSION_COUNT.opaque_id
        opaque_id: u32,
    },
    /// The vehicle holds no plan of this kind.
    Cleared {
        /// What kind of plan.
        kind: MavMissionType,
    },
    /// MISSION_CURRENT says that the vehicle is at this item.
    CurrentSet {
        /// The item.
        seq: u16,
    },
    /// The operation ended otherwise.
    Failed {
        /// Which operation.
        operation: Operation,
        /// What kind of plan.
        kind: MavMissionType,
        /// Why.
        reason: Failure,
    },
}
