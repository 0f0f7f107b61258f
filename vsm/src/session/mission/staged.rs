//! An upload: the messages of one CUCS since its last 13000, kept apart from the stored plan that it would change.
//!
//! It belongs to the CUCS that began it. It is not flown or downloaded: only its owner's 13000 makes it the stored plan
//! ([`super::received`]). It holds the changed plan and also its own messages, because
//!
//! - an upload with a 13001 replaces its waypoints completely: an earlier loiter or curve at a waypoint that is sent again
//!   without it is removed. Otherwise a straight route would fly the curves of another file that uses the same numbers. An
//!   upload without a 13001 changes only what it names;
//! - an upload that follows a dropped one must be complete ([`StagedUpload::is_whole`]): otherwise the rest of the dropped
//!   upload would be added to a plan that it was not made for.

use mapping::plan::{Plan, StoreError};
use stanag_msgs::messages::UaRoute;
use stanag_msgs::{Id, Message};

/// An upload that has not been loaded.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct StagedUpload {
    /// The CUCS that began it: only that one can continue, load or cancel it.
    pub(super) owner: Id,
    /// The stored plan as the upload changes it: what 13000 loads, and then stores.
    pub(super) plan: Plan,
    /// Its messages since the last 13000.
    pub(super) sent: Plan,
    /// Its last 13000 failed: it can be repeated. The next 13001 begins another upload, whose messages so far are in `sent`.
    pub(super) failed: bool,
}

impl StagedUpload {
    /// An empty upload that changes this plan.
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
    /// The plan does not accept it; nothing has changed.
    pub(super) fn store(&mut self, message: &Message, vehicle: Id) -> Result<(), StoreError> {
        // 50001 names the CUCS that sent it, which may differ for a message of a record.
        let cucs = match message {
            Message::CurveSegmentPaper(curve) => curve.cucs_id.unwrap_or(self.owner),
            _ => self.owner,
        };
        self.plan.store(message, cucs, vehicle)?;
        // This list only shows what the upload repeats: if it is full, less of the earlier plan is dropped.
        self.sent.store(message, cucs, vehicle).ok();
        if self.sent.routes().is_empty() {
            return Ok(());
        }
        match message {
            Message::UaPositionWaypoint(waypoint) => {
                let number = waypoint.waypoint_number.unwrap_or(0);
                self.plan.drop_unsent(number, &self.sent);
            }
            // Its waypoints may have arrived before it.
            Message::UaRoute(_) => {
                for number in self.sent.numbers() {
                    self.plan.drop_unsent(number, &self.sent);
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// Adds the messages of another upload that was begun later.
    pub(super) fn add(&mut self, later: &Plan, vehicle: Id) {
        for message in later.messages() {
            // They fitted in a plan that was at least as full.
            self.store(&message, vehicle).ok();
        }
    }

    /// The new upload that begins with this message, with its messages so far; `None` if the message continues this upload.
    ///
    /// After a failed 13000 every 13001 begins a new upload, some of whose messages may have arrived before it. Otherwise, a
    /// 13001 of a route that was already sent begins a new one: the earlier messages of that route are of an older version.
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

    /// Checks that a route and every waypoint that it leads to were sent; otherwise returns the first missing waypoint.
    pub(super) fn is_whole(&self, route: &UaRoute) -> Result<(), Option<u16>> {
        if !self.sent.defines(route) {
            return Err(None);
        }
        let part = self.plan.part(route);
        let unsent = part.numbers().find(|n| self.sent.waypoint(*n).is_none());
        unsent.map_or(Ok(()), |number| Err(Some(number)))
    }
}
