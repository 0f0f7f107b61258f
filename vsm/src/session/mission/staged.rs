//! An upload: what one CUCS has sent since its last 13000, apart from the stored plan that it would change.
//!
//! It belongs to the CUCS that began it. Nothing of it is flown or downloaded: only its owner's 13000 makes it the stored
//! plan ([`super::received`]). Beside the plan as the upload changes it, it knows its own messages, because
//!
//! - an upload with a 13001 sends its waypoints whole: a loiter or a curve of before, at a waypoint that is sent again
//!   without it, is gone. Else a straight route would fly the curves of another file that uses the same numbers. An upload
//!   without a 13001 changes what it names and nothing else;
//! - an upload that follows a dropped one must be complete by itself ([`StagedUpload::is_whole`]): what is left of the
//!   dropped one at its CUCS would be added to another plan than it was made for.

use mapping::plan::{Plan, StoreError};
use stanag_msgs::messages::UaRoute;
use stanag_msgs::{Id, Message};

/// An upload that has not been loaded.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct StagedUpload {
    /// Who began it: the only one that continues, loads or cancels it.
    pub(super) owner: Id,
    /// The stored plan as the upload changes it: what 13000 loads, and then stores.
    pub(super) plan: Plan,
    /// Its messages since the last 13000.
    pub(super) sent: Plan,
    /// Its last 13000 failed: it can be repeated, and the next 13001 begins another upload, of which `sent` has come.
    pub(super) failed: bool,
}

impl StagedUpload {
    /// One that has sent nothing yet, to this plan.
    pub(super) fn begin(owner: Id, base: Plan) -> StagedUpload {
        StagedUpload {
            owner,
            plan: base,
            sent: Plan::default(),
            failed: false,
        }
    }

    /// Adds a message.
    ///
    /// # Errors
    /// The plan does not take it; nothing has changed.
    pub(super) fn store(&mut self, message: &Message, vehicle: Id) -> Result<(), StoreError> {
        // 50001 names the CUCS that sent it, who is another where a message is of a record.
        let cucs = match message {
            Message::CurveSegmentPaper(curve) => curve.cucs_id.unwrap_or(self.owner),
            _ => self.owner,
        };
        self.plan.store(message, cucs, vehicle)?;
        // It only shows what the upload repeats: where it has no room for more, less of the plan before it is dropped.
        self.sent.store(message, cucs, vehicle).ok();
        if self.sent.routes().is_empty() {
            return Ok(());
        }
        match message {
            Message::UaPositionWaypoint(waypoint) => {
                let number = waypoint.waypoint_number.unwrap_or(0);
                self.plan.drop_unsent(number, &self.sent);
            }
            // Its waypoints may have come before it.
            Message::UaRoute(_) => {
                for number in self.sent.numbers() {
                    self.plan.drop_unsent(number, &self.sent);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Adds the messages of another one that was begun later.
    pub(super) fn add(&mut self, later: &Plan, vehicle: Id) {
        for message in later.messages() {
            // They were stored in a plan that held no less.
            self.store(&message, vehicle).ok();
        }
    }

    /// What begins in its place with this message, as far as it has been sent; `None` where the message continues it.
    ///
    /// After a 13000 that failed every 13001 begins another upload, of which some may have come before its 13001. Without
    /// one, the 13001 of a route that was sent already does: what has come of the route before is of another version.
    pub(super) fn replaced_by(&self, message: &Message) -> Option<Plan> {
        let Message::UaRoute(route) = message else {
            return None;
        };
        if route.initial_waypoint_number == Some(0) {
            return None;
        }
        if self.sent.defines(route) {
            return Some(Plan::default());
        }
        self.failed.then(|| self.sent.clone())
    }

    /// Whether a route of it has been sent, and every waypoint that it leads to; else the first that was not.
    pub(super) fn is_whole(&self, route: &UaRoute) -> Result<(), Option<u16>> {
        if !self.sent.defines(route) {
            return Err(None);
        }
        let part = self.plan.part(route);
        let unsent = part.numbers().find(|n| self.sent.waypoint(*n).is_none());
        unsent.map_or(Ok(()), |number| Err(Some(number)))
    }
}
