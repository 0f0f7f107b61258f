//! Missions, geofences and rally points: transfer both ways, clearing, and the proof that the
//! vehicle stores what was sent.
//!
//! [`Client`] transfers. [`verify`] compares a read-back with what was sent, knowing which fields PX4
//! stores and how it gives them back; [`plan_id`] is the CRC that PX4 reports for a plan.

#![allow(
    deprecated,
    reason = "PX4 still sends and takes MISSION_REQUEST and MISSION_ITEM"
)]

mod client;
mod download;
mod event;
mod item;
mod readback;
mod transfer;
mod upload;

pub use client::Client;
pub use event::{Event, Failure, Operation, StartError, Timing};
pub use item::{
    DO_SET_ROI_LOCATION, FRAME_GLOBAL, FRAME_GLOBAL_INT, FRAME_GLOBAL_RELATIVE,
    FRAME_GLOBAL_RELATIVE_INT, FRAME_MISSION, Item, UnknownInDialect, extend_plan_id, plan_id,
};
pub use mavlink::dialects::development::{MavMissionResult, MavMissionType};
pub use readback::{Difference, Field, px4_read_back, verify};
