//! The plan as CUCSs send it, upload by upload: what belongs to an upload, and what is left of one that is refused.
//!
//! A plan comes as messages in any order (13001 to 13003, 50001, 50002), each answered when it is stored; 13000 ends them.
//! What was sent since the last 13000 is one upload:
//!
//! - *loaded*: from then on it is the plan that a later upload changes;
//! - *refused* for what is in it: it is dropped whole, and the plan is what it was before;
//! - *failed* for another reason (no data from the vehicle, another transfer, a lost link, a route that the vehicle finds
//!   infeasible within its fence): it stays, so that 13000 can be repeated, and what is sent without a 13001 continues it;
//!   the 13001 of another upload drops it, but for what has been sent of that one before its 13001.
//!
//! An upload with a 13001 sends its waypoints whole: a loiter or a curve of before, at a waypoint that is sent again without
//! it, is gone. Else a straight route would fly the curves of another file that uses the same numbers. An upload without a
//! 13001 changes what it names and nothing else.

use std::time::Duration;

use mapping::plan::{Plan, StoreError};
use stanag_msgs::messages::UaRoute;
use stanag_msgs::{Id, Message, TimeStamp};

/// The plan, and the upload that changes it.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct ReceivedPlan {
    /// Everything, the upload too.
    pub(super) plan: Plan,
    /// As the last load has left it: what a refused upload returns to.
    pub(super) base: Plan,
    /// The messages of the upload.
    pub(super) sent: Plan,
    /// The last 13000 failed: it can be repeated, and a 13001 begins another upload, of which `sent` is all that has come.
    pub(super) failed: bool,
    /// While a 13000 is carried out: the plan as it was at that moment. What arrives since is of the next upload.
    loading: Option<Plan>,
    /// The 13000 that was refused last, by whom, and until when late messages of its upload may still arrive.
    refused: Option<(Id, TimeStamp, Duration)>,
}

impl ReceivedPlan {
    /// A plan that no upload changes.
    pub(super) fn settled(plan: Plan) -> ReceivedPlan {
        ReceivedPlan {
            base: plan.clone(),
            plan,
            ..ReceivedPlan::default()
        }
    }

    /// Whether an upload has changed the plan since the last load.
    pub(super) fn is_open(&self) -> bool {
        self.plan != self.base
    }

    /// Stores a message.
    ///
    /// # Errors
    /// The plan does not take it; nothing has changed.
    pub(super) fn store(
        &mut self,
        message: &Message,
        cucs: Id,
        vehicle: Id,
    ) -> Result<(), StoreError> {
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

    /// 13000 begins to load it.
    pub(super) fn begin_load(&mut self) {
        self.loading = Some(self.plan.clone());
        self.sent = Plan::default();
        self.failed = false;
    }

    /// What 13000 loads.
    pub(super) fn to_load(&self) -> &Plan {
        self.loading.as_ref().unwrap_or(&self.plan)
    }

    /// It is loaded.
    pub(super) fn loaded(&mut self) {
        self.base = self.loading.take().unwrap_or_else(|| self.plan.clone());
        self.failed &= self.is_open();
    }

    /// 13000 could not load it now: nothing is wrong with the upload.
    pub(super) fn load_failed(&mut self) {
        self.loading = None;
        self.failed = self.is_open();
    }

    /// 13000 was refused without a look at the upload, perhaps while another one is carried out.
    pub(super) fn load_not_begun(&mut self) {
        self.sent = Plan::default();
        self.failed = self.plan != *self.before();
    }

    /// 13000 was refused for what is in the upload: it is dropped. `order`: from whom that 13000 came, and its stamp.
    pub(super) fn refuse(&mut self, now: Duration, order: Option<(Id, TimeStamp)>) {
        self.loading = None;
        self.drop_upload();
        self.refused = order.map(|(cucs, stamp)| (cucs, stamp, now + LATE_WITHIN));
    }

    /// Whether a message was sent before the 13000 that was refused, by the same CUCS: it is of that upload, and was
    /// overtaken on its way or had to be repeated.
    pub(super) fn is_late(&self, now: Duration, cucs: Id, stamp: Option<TimeStamp>) -> bool {
        self.refused.is_some_and(|(by, ended, until)| {
            now < until && by == cucs && stamp.is_some_and(|stamp| stamp < ended)
        })
    }

    /// Whether another upload begins with this message: the one that failed is to be dropped first.
    pub(super) fn begins_another(&self, message: &Message) -> bool {
        let defines = |route: &UaRoute| route.initial_waypoint_number != Some(0);
        self.failed && matches!(message, Message::UaRoute(route) if defines(route))
    }

    /// Drops the upload that failed, but for what has been sent since.
    pub(super) fn drop_failed(&mut self, cucs: Id, vehicle: Id) {
        let sent = std::mem::take(&mut self.sent);
        self.drop_upload();
        for message in sent.messages() {
            // 50001 names the CUCS that sent it.
            let cucs = match &message {
                Message::CurveSegmentPaper(curve) => curve.cucs_id.unwrap_or(cucs),
                _ => cucs,
            };
            // It was stored in a plan that held more.
            self.store(&message, cucs, vehicle).ok();
        }
    }

    /// Returns to the plan before the upload.
    fn drop_upload(&mut self) {
        self.plan = self.before().clone();
        self.sent = Plan::default();
        self.failed = false;
    }

    /// The plan before the upload.
    fn before(&self) -> &Plan {
        self.loading.as_ref().unwrap_or(&self.base)
    }

    /// Forgets a route, or everything (13000 mode 1).
    pub(super) fn clear(&mut self, route_id: Option<&str>) {
        let Some(id) = route_id else {
            *self = ReceivedPlan::default();
            return;
        };
        for plan in [&mut self.plan, &mut self.base, &mut self.sent] {
            plan.clear_route(id);
        }
        self.failed &= self.is_open();
    }
}

/// A station repeats what is not answered for some seconds.
const LATE_WITHIN: Duration = Duration::from_secs(10);

#[cfg(test)]
mod tests {
    use stanag_msgs::Text;
    use stanag_msgs::messages::{CurveSegment, UaLoiterWaypoint, UaPositionWaypoint, UaRoute};

    use super::*;

    const CUCS: Id = Id(0x1b00_00a0);
    const VEHICLE: Id = Id(0x1b00_0101);

    fn route(name: &str, initial: u16) -> Message {
        UaRoute {
            route_id: Some(Text::new(name)),
            initial_waypoint_number: Some(initial),
            ..UaRoute::default()
        }
        .into()
    }

    fn waypoint(number: u16, next: u16) -> Message {
        UaPositionWaypoint {
            waypoint_number: Some(number),
            next_waypoint: Some(next),
            ..UaPositionWaypoint::default()
        }
        .into()
    }

    fn loiter(number: u16) -> Message {
        UaLoiterWaypoint {
            waypoint_number: Some(number),
            ..UaLoiterWaypoint::default()
        }
        .into()
    }

    fn curve(p1: u16, p4: u16) -> Message {
        CurveSegment {
            p1_waypoint_no: Some(p1),
            p4_waypoint_no: Some(p4),
            ..CurveSegment::default()
        }
        .into()
    }

    fn store(received: &mut ReceivedPlan, messages: &[Message]) {
        for message in messages {
            received.store(message, CUCS, VEHICLE).expect("it fits");
        }
    }

    /// A curved route with a loiter, loaded.
    fn curved() -> ReceivedPlan {
        let mut received = ReceivedPlan::default();
        store(
            &mut received,
            &[
                route("A", 1),
                waypoint(1, 2),
                waypoint(2, 0),
                loiter(2),
                curve(1, 2),
            ],
        );
        received.begin_load();
        received.loaded();
        assert!(!received.is_open());
        received
    }

    fn is_curved(received: &ReceivedPlan) -> bool {
        received.plan.curves_from(1).count() > 0
    }

    #[test]
    fn a_route_that_is_sent_whole_keeps_no_curve_and_no_loiter_of_before_in_any_order() {
        let straight = [route("A", 1), waypoint(1, 2), waypoint(2, 0)];
        for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
            let mut received = curved();
            store(&mut received, &order.map(|at: usize| straight[at].clone()));
            assert!(!is_curved(&received), "{order:?}");
            assert!(received.plan.loiter(2).is_none(), "{order:?}");
        }
        let whole = [
            curve(1, 2),
            waypoint(1, 2),
            loiter(2),
            route("A", 1),
            waypoint(2, 0),
        ];
        for first in 0..whole.len() {
            let mut received = curved();
            let mut sent = whole.to_vec();
            sent.rotate_left(first);
            store(&mut received, &sent);
            assert!(is_curved(&received) && received.plan.loiter(2).is_some());
        }
    }

    #[test]
    fn a_change_of_a_part_leaves_the_rest() {
        let mut received = curved();
        store(&mut received, &[waypoint(1, 2), waypoint(2, 0)]);
        assert!(is_curved(&received) && received.plan.loiter(2).is_some());
    }

    #[test]
    fn a_refused_upload_leaves_the_plan_of_before_and_the_next_begins_clean() {
        let mut received = curved();
        let before = received.clone();
        store(
            &mut received,
            &[route("B", 5), curve(5, 6), waypoint(1, 9), curve(8, 9)],
        );
        received.begin_load();
        received.refuse(Duration::ZERO, Some((CUCS, TimeStamp(100))));
        assert_eq!(received.plan, before.plan);
        assert!(!received.is_open() && received.sent == Plan::default());
        // What was repeated after it is known by its stamp, for as long as stations repeat.
        let late = |seconds, cucs, stamp| {
            received.is_late(Duration::from_secs(seconds), cucs, Some(TimeStamp(stamp)))
        };
        assert!(late(9, CUCS, 99) && !late(9, CUCS, 101));
        assert!(!late(9, Id(7), 99) && !late(11, CUCS, 99));
    }

    #[test]
    fn an_upload_that_could_not_be_loaded_can_be_loaded_later_or_is_dropped_by_the_next() {
        let mut received = curved();
        store(&mut received, &[route("B", 5), waypoint(5, 0)]);
        received.begin_load();
        received.load_failed();
        assert!(received.failed && received.to_load().waypoint(5).is_some());
        let mut again = received.clone();
        again.begin_load();
        again.loaded();
        assert!(!again.is_open() && again.base.waypoint(5).is_some() && !again.failed);
        // Without a 13001 it is continued.
        assert!(!received.begins_another(&waypoint(5, 6)));
        // Another upload drops it, also where its 13001 comes last.
        store(&mut received, &[waypoint(7, 0), curve(1, 2)]);
        assert!(received.begins_another(&route("C", 7)));
        assert!(!received.begins_another(&route("B", 0)));
        received.drop_failed(CUCS, VEHICLE);
        let numbers: Vec<_> = received.plan.numbers().collect();
        assert_eq!(numbers, [1, 2, 7]);
        assert!(!received.failed && received.plan.route_named("B").is_none());
    }

    #[test]
    fn what_arrives_during_a_load_is_of_the_next_upload() {
        let mut received = curved();
        store(&mut received, &[route("B", 5), waypoint(5, 0)]);
        received.begin_load();
        store(&mut received, &[waypoint(7, 0)]);
        assert!(received.to_load().waypoint(7).is_none());
        // A 13000 for it comes too early: it can be repeated, and the one that is carried out is not disturbed.
        received.load_not_begun();
        assert!(received.failed);
        received.loaded();
        assert!(received.base.waypoint(5).is_some() && received.base.waypoint(7).is_none());
        assert!(received.failed && received.plan.waypoint(7).is_some());
        received.drop_failed(CUCS, VEHICLE);
        assert!(received.plan.waypoint(5).is_some() && received.plan.waypoint(7).is_none());
    }

    #[test]
    fn a_route_is_cleared_in_the_plan_and_in_what_a_refusal_returns_to() {
        let mut received = curved();
        store(&mut received, &[route("B", 5), waypoint(5, 0)]);
        received.clear(Some("A"));
        received.refuse(Duration::ZERO, None);
        assert!(received.plan.is_empty());
    }
}
