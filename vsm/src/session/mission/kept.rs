//! Items of one kind that the vehicle should hold in addition to its mission, such as the fence and the rally points:
//! compared with what it reports, and uploaded if they differ.
//!
//! They are compared when the link to the vehicle comes up, and from then on. Unchanged items are not sent again. If another
//! station changes them there is a warning, and they are not overwritten.

use std::time::Duration;

use mapping::telemetry::MissionProgress;
use mavlink_link::service::mission::{Item, MavMissionType, plan_id};

use super::input::Context;
use super::upload::Upload;
use crate::session::context::WATCH_SLACK;
use crate::session::link::services::Services;

/// The state of these items.
#[derive(Debug)]
pub(super) struct Kept {
    kind: MavMissionType,
    /// Whether any were ever requested, by a CUCS or the configuration: otherwise the vehicle's own items are left alone.
    pub(super) wanted: bool,
    /// The vehicle's id for the items that it should hold.
    id: Option<u32>,
    /// When to compare the vehicle's items for the first time, or to retry an upload.
    look_at: Option<Duration>,
    /// That is due but not possible yet; an event will make it possible.
    postponed: bool,
}

/// The result of a check.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Seen {
    /// Nothing to do.
    Nothing,
    /// The items must be compared with the vehicle's: [`Kept::holds`], followed by an upload if they differ.
    Due,
    /// The vehicle reports the items that it should hold.
    Same,
    /// The vehicle reports different items.
    Other,
}

impl Kept {
    pub(super) fn new(kind: MavMissionType, wanted: bool) -> Kept {
        Kept {
            kind,
            wanted,
            id: None,
            look_at: None,
            postponed: false,
        }
    }

    /// The items that it should hold have changed.
    pub(super) fn change(&mut self, now: Duration) {
        self.wanted = true;
        self.look_at = Some(now);
    }

    /// The vehicle's link is up, for the first time or again: its items are compared once it has had time to report them.
    pub(super) fn look_again(&mut self, now: Duration) {
        self.look_at = Some(now + LOOK_AFTER);
        self.postponed = false;
    }

    /// The vehicle lacks the items that it should hold.
    pub(super) fn try_again(&mut self, now: Duration) {
        self.look_at = Some(now + TRY_AGAIN);
        self.postponed = false;
    }

    /// An upload has succeeded before the retry of one that had failed.
    pub(super) fn drop_retry(&mut self) {
        self.look_at = None;
        self.postponed = false;
    }

    /// When a check is next due. `upload`: the upload in progress.
    pub(super) fn poll_timeout(&self, upload: Option<&Upload>) -> Option<Duration> {
        let due = match upload {
            Some(upload) => upload.poll_timeout(),
            None => self.look_at.filter(|_| self.wanted && !self.postponed),
        };
        due.map(|due| due + WATCH_SLACK)
    }

    /// The vehicle's id for the items that it holds.
    pub(super) fn named(&self, context: &Context<'_>) -> Option<u32> {
        let of = |mission: MissionProgress| match self.kind {
            MavMissionType::MAV_MISSION_TYPE_RALLY => mission.rally_points_id,
            _ => mission.fence_id,
        };
        context.vehicle.telemetry.mission.map(of)
    }

    /// Whether the vehicle reports these items. PX4 reports a checksum, so items that it still holds are not sent again.
    pub(super) fn holds(&mut self, context: &Context<'_>, items: &[Item]) -> bool {
        let id = plan_id(items);
        // An id of 0 is reported by a vehicle without items, and by a vehicle without ids, whatever it holds: it is cleared.
        let same = !items.is_empty() && self.named(context) == Some(id);
        if same {
            self.id = Some(id);
        }
        same
    }

    /// Begins to upload the items, or to clear them if there are none.
    pub(super) fn send(
        &self,
        now: Duration,
        items: &[Item],
        vehicle: &mut Services,
    ) -> Result<Upload, String> {
        // Without items there is nothing to read back, and no id to wait for.
        let begun = if items.is_empty() {
            Upload::clear(now, self.kind, vehicle)
        } else {
            Upload::send(now, self.kind, items, vehicle)
        };
        begun.map_err(|fault| format!("the mission service is {fault}"))
    }

    /// The vehicle holds them, confirmed by read-back, and reports this id.
    pub(super) fn uploaded(&mut self, id: u32) {
        self.id = Some(id);
    }

    /// The vehicle's id for the items that it should hold; `None` until confirmed.
    pub(super) fn id(&self) -> Option<u32> {
        self.id.filter(|_| self.look_at.is_none())
    }

    /// Checks the items. `may_change`: whether an upload can begin now.
    pub(super) fn look(&mut self, context: &Context<'_>, may_change: bool) -> Seen {
        let due = self.look_at.is_some_and(|at| at <= context.mono());
        if !self.wanted || !context.vehicle.live() || !may_change {
            // A past deadline that cannot be acted on would wake the timer in a busy loop.
            self.postponed |= due;
            return Seen::Nothing;
        }
        if due {
            self.look_at = None;
            return Seen::Due;
        }
        // An id of 0 cannot be compared: everything is cleared, or the vehicle has no ids.
        let (Some(id), None) = (self.id.filter(|id| *id != 0), self.look_at) else {
            return Seen::Nothing;
        };
        match self.named(context) {
            Some(named) if named != id => Seen::Other,
            _ => Seen::Same,
        }
    }
}

const LOOK_AFTER: Duration = Duration::from_secs(3);
const TRY_AGAIN: Duration = Duration::from_secs(30);
