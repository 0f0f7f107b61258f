//! Items of one kind that the vehicle should hold beside its mission: compared with what it names, and uploaded where they are
//! others. The fence and the rally points are two of them.
//!
//! They are compared when data of the vehicle first arrives, and from then on: what is the same is not sent again; of what
//! another station has changed there is a warning, and no contest.

use std::time::Duration;

use mapping::telemetry::MissionProgress;
use mavlink_link::service::mission::{Item, MavMissionType, plan_id};

use super::input::Context;
use super::upload::Upload;
use crate::session::context::WATCH_SLACK;
use crate::session::link::services::Services;

/// What is known of them.
#[derive(Debug)]
pub(super) struct Kept {
    kind: MavMissionType,
    /// Whether any was ever requested, here or in the configuration: else the vehicle's own are left alone.
    pub(super) wanted: bool,
    /// The id by which the vehicle names those that it should hold.
    id: Option<u32>,
    /// When what the vehicle holds is compared for the first time, or an upload is tried again.
    look_at: Option<Duration>,
    /// That was due, and could not be done yet: what it waits for is an event.
    postponed: bool,
}

/// What a look has shown.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Seen {
    /// Nothing that anything follows from.
    Nothing,
    /// They have to be compared with what the vehicle names: [`Kept::holds`], and an upload where it does not.
    Due,
    /// The vehicle names what it should hold.
    Same,
    /// It names something else.
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

    /// What it should hold is something else now.
    pub(super) fn change(&mut self, now: Duration) {
        self.wanted = true;
        self.look_at = Some(now);
    }

    /// The vehicle is there, or there again: what it holds is compared once it has had the time to report it.
    pub(super) fn look_again(&mut self, now: Duration) {
        self.look_at = Some(now + LOOK_AFTER);
        self.postponed = false;
    }

    /// The vehicle is without what it should hold.
    pub(super) fn try_again(&mut self, now: Duration) {
        self.look_at = Some(now + TRY_AGAIN);
        self.postponed = false;
    }

    /// When a look is due by the time alone. `upload`: what is on its way.
    pub(super) fn poll_timeout(&self, upload: Option<&Upload>) -> Option<Duration> {
        let due = match upload {
            Some(upload) => upload.poll_timeout(),
            None => self.look_at.filter(|_| self.wanted && !self.postponed),
        };
        due.map(|due| due + WATCH_SLACK)
    }

    /// The id by which the vehicle names what it holds.
    pub(super) fn named(&self, context: &Context<'_>) -> Option<u32> {
        let of = |mission: MissionProgress| match self.kind {
            MavMissionType::MAV_MISSION_TYPE_RALLY => mission.rally_points_id,
            _ => mission.fence_id,
        };
        context.vehicle.telemetry.mission.map(of)
    }

    /// Whether the vehicle names these items: PX4 does by a checksum, so that what it still holds is not sent again.
    pub(super) fn holds(&mut self, context: &Context<'_>, items: &[Item]) -> bool {
        let id = plan_id(items);
        // 0 is named by a vehicle that holds none, and by one without ids, whatever it holds: that is cleared.
        let same = !items.is_empty() && self.named(context) == Some(id);
        if same {
            self.id = Some(id);
        }
        same
    }

    /// Begins to upload items, or to clear where there is none.
    pub(super) fn send(
        &self,
        now: Duration,
        items: &[Item],
        vehicle: &mut Services,
    ) -> Result<Upload, String> {
        // Without items there is nothing to read back and no id to wait for.
        let begun = if items.is_empty() {
            Upload::clear(now, self.kind, vehicle)
        } else {
            Upload::send(now, self.kind, items, vehicle)
        };
        begun.map_err(|fault| format!("the mission service is {fault}"))
    }

    /// The vehicle holds them, read back, and names them by this id.
    pub(super) fn uploaded(&mut self, id: u32) {
        self.id = Some(id);
    }

    /// The id by which the vehicle names what it should hold; `None` until it has been seen to.
    pub(super) fn id(&self) -> Option<u32> {
        self.id.filter(|_| self.look_at.is_none())
    }

    /// Looks. `may_change`: whether an upload can begin now.
    pub(super) fn look(&mut self, context: &Context<'_>, may_change: bool) -> Seen {
        let due = self.look_at.is_some_and(|at| at <= context.mono());
        if !self.wanted || !context.vehicle.live() || !may_change {
            // A time that is past and cannot be acted on would wake the timer at once, again and again.
            self.postponed |= due;
            return Seen::Nothing;
        }
        if due {
            self.look_at = None;
            return Seen::Due;
        }
        // An id of 0 compares with nothing: everything is cleared, or the vehicle has no ids.
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
