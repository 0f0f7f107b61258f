//! The operations of a mission client, how they end, and how long it waits.

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
    /// Wait before an item request, or the last item of an upload, is retried.
    pub item: Duration,
    /// Without progress for this long the attempt has failed; longer than PX4's 5 s, after which
    /// it drops the transfer without a MISSION_ACK.
    pub stall: Duration,
    /// Wait for the vehicle to continue after MAV_MISSION_ERROR.
    pub settle: Duration,
    /// How many times a transfer is started in all.
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

/// An operation of a [`Client`](super::Client).
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Operation {
    /// A plan is sent to the vehicle.
    Upload,
    /// A plan is read from the vehicle.
    Download,
    /// MISSION_CLEAR_ALL.
    Clear,
    /// MISSION_SET_CURRENT.
    SetCurrent,
}

/// Why an operation did not start.
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum StartError {
    /// Another one has not ended.
    #[error("busy with {0:?}")]
    Busy(Operation),
    /// Too many events are unread: the end of this operation would have no room.
    #[error("too many events are unread")]
    Unread,
    /// An upload without items; clearing is an operation of its own.
    #[error("a plan without items, expected at least one")]
    Empty,
    /// More items than fit in MISSION_COUNT.count.
    #[error("{0} items, expected at most 65535")]
    TooMany(usize),
    /// MAV_MISSION_TYPE_ALL can be cleared, not transferred.
    #[error("MAV_MISSION_TYPE_ALL, expected a single kind of plan")]
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

/// Why an operation failed.
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Failure {
    /// The vehicle refused by MISSION_ACK.
    Refused {
        /// MISSION_ACK.type
        result: MavMissionResult,
        /// The item it had requested last; `None` when it had requested none.
        seq: Option<u16>,
    },
    /// The vehicle acknowledged a plan, but not this one.
    OtherPlan {
        /// This plan's id.
        expected: u32,
        /// MISSION_ACK.opaque_id
        found: u32,
    },
    /// No usable answer to any retry.
    NoAnswer {
        /// The item requested last, by the vehicle or by us.
        seq: Option<u16>,
    },
}

/// What a [`Client`](super::Client) reports.
#[derive(Clone, PartialEq, Debug)]
pub enum Event {
    /// Progress of a transfer. Unread progress is replaced, not queued.
    Progress {
        /// Which way.
        operation: Operation,
        /// Items that the receiver is known to have.
        done: u16,
        /// Items of the plan.
        total: u16,
        /// 0..=100
        percent: u8,
    },
    /// The vehicle stores the plan.
    Uploaded {
        /// What kind of plan.
        kind: MavMissionType,
        /// MISSION_ACK.opaque_id, 0 from autopilots without plan ids.
        opaque_id: u32,
    },
    /// The stored plan.
    Downloaded {
        /// What kind of plan.
        kind: MavMissionType,
        /// The items in order.
        items: Vec<Item>,
        /// MISSION_COUNT.opaque_id
        opaque_id: u32,
    },
    /// The vehicle stores no plan of this kind.
    Cleared {
        /// What kind of plan.
        kind: MavMissionType,
    },
    /// MISSION_CURRENT reports this item.
    CurrentSet {
        /// The item.
        seq: u16,
    },
    /// The operation failed.
    Failed {
        /// Which operation.
        operation: Operation,
        /// What kind of plan.
        kind: MavMissionType,
        /// Why.
        reason: Failure,
    },
}
