//! The plan as received from CUCSs: the stored plan, and the upload that will change it.
//!
//! A plan arrives as messages in any order (13001 to 13003, 50001, 50002), each answered when it is stored; a 13000 ends
//! them. All messages of one CUCS since its last 13000 are one upload, staged apart from the stored plan ([`StagedUpload`]):
//!
//! ```text
//!            13001.. of the controller        13000                loaded
//! (nothing) ---------------------------> staged ------> loading ------------> stored
//!     ^                                   |  ^             |
//!     |                                   |  +-------------+ failed: nothing is wrong with it, 13000 can be repeated
//!     +-----------------------------------+----------------+
//!       dropped: refused for what is in it, cancelled, its owner lost control, it was left for minutes, a route was
//!       cleared, its 13001 came again
//! ```
//!
//! Only the stored plan is flown, downloaded or changed by a later upload. A dropped upload leaves only its reason behind.
//! The next upload must be complete, because its CUCS may not know that a part is gone, or may be another CUCS that
//! continues an upload it has seen. A restart drops nothing that was acknowledged: the upload still belongs to its owner, as
//! long as the owner is in control.

use std::time::Duration;

use mapping::plan::{Plan, StoreError};
use stanag_msgs::messages::UaRoute;
use stanag_msgs::{Id, Message, TimeStamp};

use super::staged::StagedUpload;

/// The stored plan, and the upload that is to change it.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct ReceivedPlan {
    /// The stored plan, as of the last load.
    pub(super) stored: Plan,
    /// The upload being received.
    pub(super) staged: Option<StagedUpload>,
    /// The upload that a 13000 is loading. Later messages belong to the next upload.
    loading: Option<StagedUpload>,
    /// Why the latest upload was dropped, until a complete one follows or nothing is stored.
    pub(super) dropped: Option<String>,
    /// The 13000 that dropped an upload, and until when late messages of that upload may still arrive.
    ended: Option<(Id, TimeStamp, Duration)>,
}

/// A 13000 that dropped an upload: its sender and Time Stamp.
pub(super) type Order = Option<(Id, TimeStamp)>;

impl ReceivedPlan {
    /// A plan that no upload changes.
    pub(super) fn settled(plan: Plan) -> ReceivedPlan {
        ReceivedPlan {
            stored: plan,
            ..ReceivedPlan::default()
        }
    }

    /// The plan that the next upload changes: the stored plan, assuming that the load in progress succeeds.
    fn base(&self) -> &Plan {
        let loading = self.loading.as_ref();
        loading.map_or(&self.stored, |upload| &upload.plan)
    }

    /// The plan that a 13000 of this CUCS loads: its upload, or the stored plan.
    pub(super) fn offered(&self, cucs: Id) -> &Plan {
        let own = self.staged.as_ref().filter(|staged| staged.owner == cucs);
        own.map_or_else(|| self.base(), |staged| &staged.plan)
    }

    /// The plan that the 13000 in progress loads.
    pub(super) fn to_load(&self) -> &Plan {
        self.base()
    }

    /// The owner of the upload that would change the stored plan.
    pub(super) fn open_by(&self) -> Option<Id> {
        let staged = self.staged.as_ref()?;
        (staged.plan != *self.base()).then_some(staged.owner)
    }

    /// Checks whether the plan accepts a message, which continues the upload or begins one.
    ///
    /// # Errors
    /// It does not accept it; nothing has changed.
    pub(super) fn check(&self, message: &Message, cucs: Id, vehicle: Id) -> Result<(), StoreError> {
        self.offered(cucs).check(message, cucs, vehicle)
    }

    /// Why the staged upload is replaced by the upload of this message.
    pub(super) fn gives_way(&self, message: &Message, cucs: Id) -> Option<String> {
        let staged = self.staged.as_ref()?;
        if staged.owner != cucs {
            Some(format!("{cucs} has begun another"))
        } else {
            let replaced = staged.replaced_by(message).is_some();
            replaced.then(|| "a 13001 has begun another".to_owned())
        }
    }

    /// Replaces the staged upload, keeping the messages that already belong to the new one.
    pub(super) fn give_way(&mut self, message: &Message, cucs: Id, vehicle: Id) {
        let Some(why) = self.gives_way(message, cucs) else {
            return;
        };
        let staged = self.staged.as_ref();
        let sent = staged
            .filter(|staged| staged.owner == cucs)
            .and_then(|staged| staged.replaced_by(message));
        self.drop_staged(&why);
        if let Some(sent) = sent.filter(|sent| !sent.is_empty()) {
            self.stage(cucs).add(&sent, vehicle);
        }
    }

    fn stage(&mut self, cucs: Id) -> &mut StagedUpload {
        let base = self.loading.as_ref().map_or(&self.stored, |up| &up.plan);
        self.staged
            .get_or_insert_with(|| StagedUpload::begin(cucs, base.clone()))
    }

    /// Stores a message in the upload of its sender.
    ///
    /// # Errors
    /// The plan does not accept it; nothing has changed, except that another upload may have been replaced.
    pub(super) fn store(
        &mut self,
        message: &Message,
        cucs: Id,
        vehicle: Id,
    ) -> Result<(), StoreError> {
        self.give_way(message, cucs, vehicle);
        // 50001 names its sender; only for messages from the network is that the upload's owner.
        self.check(message, cucs, vehicle)?;
        self.stage(cucs).store(message, vehicle)
    }

    /// Checks whether a 13000 of this CUCS may load a route after an upload was dropped; from then on it may.
    ///
    /// # Errors
    /// The waypoint that is missing, if it is one, and why.
    pub(super) fn admit_load(
        &mut self,
        cucs: Id,
        route: Option<&UaRoute>,
    ) -> Result<(), (Option<u16>, String)> {
        let Some(dropped) = &self.dropped else {
            return Ok(());
        };
        let own = self.staged.as_ref().filter(|staged| staged.owner == cucs);
        let whole = match (own, route) {
            (Some(staged), Some(route)) => staged.is_whole(route),
            _ => Err(None),
        };
        whole.map_err(|missing| {
            let missing_too = missing.map_or_else(String::new, |number| {
                format!("; waypoint {number} has not been sent since")
            });
            (
                missing,
                format!("{dropped}{missing_too}: send the whole route, with its 13001, then 13000"),
            )
        })?;
        self.dropped = None;
        Ok(())
    }

    /// A 13000 begins to load this CUCS's upload, or the stored plan. Returns true for an upload.
    pub(super) fn begin_load(&mut self, cucs: Id) -> bool {
        self.loading = self.staged.take_if(|staged| staged.owner == cucs);
        if let Some(upload) = &mut self.loading {
            upload.sent = Plan::default();
            upload.failed = false;
        }
        self.loading.is_some()
    }

    /// The upload is loaded: stores it. Returns true if that changes the stored plan.
    pub(super) fn loaded(&mut self) -> bool {
        let Some(upload) = self.loading.take() else {
            return false;
        };
        self.dropped = None;
        self.stored = upload.plan;
        true
    }

    /// The 13000 failed for a reason outside the upload: later messages continue this upload.
    pub(super) fn load_failed(&mut self, vehicle: Id) {
        let Some(mut upload) = self.loading.take() else {
            return;
        };
        upload.failed = true;
        match self.staged.take() {
            Some(since) if since.owner == upload.owner => upload.add(&since.sent, vehicle),
            // Its owner has released control, and another CUCS has begun an upload.
            Some(since) => {
                self.dropped = Some(why_dropped(upload.owner, "another CUCS is in control"));
                upload = StagedUpload::begin(since.owner, self.stored.clone());
                upload.add(&since.sent, vehicle);
            }
            None => {}
        }
        self.staged = Some(upload);
    }

    /// The 13000 was refused without checking the upload, perhaps while another one is in progress.
    pub(super) fn load_not_begun(&mut self, cucs: Id) {
        if let Some(staged) = self.staged.as_mut().filter(|staged| staged.owner == cucs) {
            staged.sent = Plan::default();
            staged.failed = true;
        }
    }

    /// The state after a restart: a load that was in progress has failed.
    pub(super) fn at_restart(&self, vehicle: Id) -> ReceivedPlan {
        let mut found = self.clone();
        found.load_failed(vehicle);
        found
    }

    /// The 13000 was refused because of the content of the upload being loaded, or of the staged one: drops it.
    pub(super) fn refuse(&mut self, now: Duration, order: Order, vehicle: Id) {
        self.end_by(now, order);
        if let Some(upload) = self.loading.take() {
            self.dropped = Some(why_dropped(upload.owner, REFUSED));
            // Later messages belong to the next upload, but the plan that they were meant to change no longer exists.
            if let Some(since) = self.staged.take() {
                self.stage(since.owner).add(&since.sent, vehicle);
            }
        } else {
            self.drop_staged(REFUSED);
        }
    }

    /// 13000 mode 5: drops the upload. Returns true if there was one.
    pub(super) fn cancel(&mut self, now: Duration, order: Order) -> bool {
        self.end_by(now, order);
        let staged = self.drop_staged(CANCELLED);
        let loading = self.loading.take().map(|upload| upload.owner);
        if let Some(owner) = loading {
            self.dropped = Some(why_dropped(owner, CANCELLED));
        }
        staged || loading.is_some()
    }

    fn end_by(&mut self, now: Duration, order: Order) {
        self.ended = order.map(|(cucs, stamp)| (cucs, stamp, now + LATE_WITHIN));
    }

    /// Drops the staged upload. Returns true if it had changed the plan.
    pub(super) fn drop_staged(&mut self, why: &str) -> bool {
        let owner = self.open_by();
        self.staged = None;
        if let Some(owner) = owner {
            self.dropped = Some(why_dropped(owner, why));
        }
        owner.is_some()
    }

    /// Whether a message was sent before the 13000 of the same CUCS that dropped its upload: it belongs to that upload, and
    /// arrived late or was a retry.
    pub(super) fn is_late(&self, now: Duration, cucs: Id, stamp: Option<TimeStamp>) -> bool {
        self.ended.is_some_and(|(by, ended, until)| {
            now < until && by == cucs && stamp.is_some_and(|stamp| stamp < ended)
        })
    }

    /// 13000 mode 1 begins to clear: later messages belong to a new upload.
    pub(super) fn begin_clear(&mut self) {
        if let Some(staged) = &mut self.staged {
            staged.sent = Plan::default();
            staged.failed = true;
        }
    }

    /// Forgets a route or everything (13000 mode 1), and uploads from before it began.
    pub(super) fn clear(&mut self, route_id: Option<&str>, vehicle: Id) {
        let before = self.staged.as_ref().is_some_and(|staged| staged.failed);
        let sent = self
            .staged
            .as_ref()
            .map(|staged| (staged.owner, staged.sent.clone()));
        if !(before && self.drop_staged("13000 mode 1 has cleared")) {
            self.staged = None;
        }
        match route_id {
            Some(id) => self.stored.clear_route(id),
            None => self.stored.clear(),
        }
        if let Some((owner, sent)) = sent.filter(|(_, sent)| !sent.is_empty()) {
            self.stage(owner).add(&sent, vehicle);
        }
    }
}

fn why_dropped(owner: Id, why: &str) -> String {
    format!("the upload of {owner} was dropped: {why}")
}

const REFUSED: &str = "it was refused";
const CANCELLED: &str = "it was cancelled (13000 mode 5)";
/// Stations retry unanswered messages for some seconds.
const LATE_WITHIN: Duration = Duration::from_secs(10);

#[cfg(test)]
mod tests {
    use stanag_msgs::Text;
    use stanag_msgs::messages::{CurveSegment, UaLoiterWaypoint, UaPositionWaypoint, UaRoute};

    use super::*;

    const CUCS: Id = Id(0x1b00_00a0);
    const OTHER: Id = Id(0x1b00_00a1);
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

    fn store_as(cucs: Id, received: &mut ReceivedPlan, messages: &[Message]) {
        for message in messages {
            received.store(message, cucs, VEHICLE).expect("it fits");
        }
    }

    fn store(received: &mut ReceivedPlan, messages: &[Message]) {
        store_as(CUCS, received, messages);
    }

    /// What a 13000 of a CUCS for a route would load, as far as it may.
    fn offer(received: &mut ReceivedPlan, cucs: Id, name: &str) -> Option<Plan> {
        let plan = received.offered(cucs).clone();
        let route = plan.route_named(name);
        let admitted = received.admit_load(cucs, route).is_ok() && route.is_some();
        admitted.then_some(plan)
    }

    fn load(received: &mut ReceivedPlan) {
        assert!(received.begin_load(CUCS) && received.loaded());
    }

    /// A curved route with a loiter, loaded.
    fn curved() -> ReceivedPlan {
        let mut received = ReceivedPlan::default();
        let messages = [
            route("A", 1),
            waypoint(1, 2),
            waypoint(2, 0),
            loiter(2),
            curve(1, 2),
        ];
        store(&mut received, &messages);
        assert!(received.stored.is_empty() && received.open_by() == Some(CUCS));
        load(&mut received);
        assert!(received.open_by().is_none());
        received
    }

    fn is_curved(plan: &Plan) -> bool {
        plan.curves_from(1).count() > 0
    }

    /// PX4 leaves OFFBOARD after a second without set points, which the same thread sends.
    #[test]
    fn each_message_of_the_largest_upload_is_stored_at_once() {
        let mut received = ReceivedPlan::default();
        let last = mapping::plan::MAX_WAYPOINTS as u16;
        for number in 1..=last {
            store(&mut received, &[waypoint(number, number + 1)]);
            store(&mut received, &[curve(number, number + 1)]);
        }
        let began = std::time::Instant::now();
        for name in ["A", "B", "C", "D"] {
            store(&mut received, &[route(name, 1)]);
        }
        for number in 1..=2_000 {
            store(&mut received, &[waypoint(number, number + 1)]);
        }
        let took = began.elapsed();
        assert!(took < Duration::from_secs(3), "{took:?}");
        assert!(is_curved(received.offered(CUCS)));
    }

    #[test]
    fn a_route_that_is_sent_whole_keeps_no_curve_and_no_loiter_of_before_in_any_order() {
        let straight = [route("A", 1), waypoint(1, 2), waypoint(2, 0)];
        for order in [[0, 1, 2], [1, 2, 0], [2, 0, 1]] {
            let mut received = curved();
            store(&mut received, &order.map(|at: usize| straight[at].clone()));
            let plan = received.offered(CUCS);
            assert!(!is_curved(plan) && plan.loiter(2).is_none(), "{order:?}");
            assert!(is_curved(&received.stored), "not before its 13000");
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
            let plan = received.offered(CUCS);
            assert!(is_curved(plan) && plan.loiter(2).is_some());
        }
    }

    #[test]
    fn a_change_of_a_part_leaves_the_rest() {
        let mut received = curved();
        store(&mut received, &[waypoint(1, 2), waypoint(2, 0)]);
        load(&mut received);
        assert!(is_curved(&received.stored) && received.stored.loiter(2).is_some());
    }

    #[test]
    fn a_refused_upload_leaves_the_plan_of_before_and_the_next_must_be_whole() {
        let mut received = curved();
        let before = received.stored.clone();
        let flawed = [route("B", 5), curve(5, 6), waypoint(1, 9), curve(8, 9)];
        store(&mut received, &flawed);
        received.begin_load(CUCS);
        received.refuse(Duration::ZERO, Some((CUCS, TimeStamp(100))), VEHICLE);
        assert!(received.stored == before && received.staged.is_none());
        // What was repeated after it is known by its stamp, for as long as stations repeat.
        let late = |seconds, cucs, stamp| {
            received.is_late(Duration::from_secs(seconds), cucs, Some(TimeStamp(stamp)))
        };
        assert!(late(9, CUCS, 99) && !late(9, CUCS, 101));
        assert!(!late(9, OTHER, 99) && !late(11, CUCS, 99));
    }

    /// Each way in which an upload ends but by its load: the plan is as before, nothing is staged, a 13000 does not load
    /// the earlier plan in its place, and neither the rest of it, nor the rest at another CUCS, becomes a route.
    #[test]
    fn an_upload_that_is_dropped_leaves_nothing_that_could_be_loaded() {
        type Drop = fn(&mut ReceivedPlan);
        let ways: [(&str, Drop); 5] = [
            ("cancelled", |received| {
                assert!(received.cancel(Duration::ZERO, None));
            }),
            ("cancelled during its load", |received| {
                received.begin_load(CUCS);
                assert!(received.cancel(Duration::ZERO, None));
            }),
            ("control has changed", |received| {
                assert!(received.drop_staged("control has changed"));
            }),
            ("refused", |received| {
                received.begin_load(CUCS);
                received.refuse(Duration::ZERO, None, VEHICLE);
            }),
            ("cleared", |received| {
                received.begin_clear();
                received.clear(Some("none"), VEHICLE);
            }),
        ];
        for (way, drop) in ways {
            let mut received = curved();
            let before = received.stored.clone();
            store(&mut received, &[route("B", 1), waypoint(1, 7)]);
            drop(&mut received);
            assert!(
                received.stored == before && received.staged.is_none(),
                "{way}"
            );
            for cucs in [CUCS, OTHER] {
                assert_eq!(offer(&mut received, cucs, "A"), None, "{way}");
                let mut rest = received.clone();
                store_as(cucs, &mut rest, &[waypoint(7, 2)]);
                assert_eq!(offer(&mut rest, cucs, "A"), None, "{way}");
                assert_eq!(offer(&mut rest, cucs, "B"), None, "{way}");
                // Its 13001 is not enough: the waypoints of the plan before are no part of it.
                store_as(cucs, &mut rest, &[route("B", 7)]);
                assert_eq!(offer(&mut rest, cucs, "B"), None, "{way}");
                let whole = [waypoint(2, 0), waypoint(7, 2)];
                store_as(cucs, &mut rest, &whole);
                let found = offer(&mut rest, cucs, "B").expect("it is whole");
                assert!(
                    found
                        .waypoint(1)
                        .is_some_and(|w| w.next_waypoint == Some(2))
                );
                assert!(rest.begin_load(cucs) && rest.loaded() && rest.dropped.is_none());
            }
        }
    }

    #[test]
    fn an_upload_that_could_not_be_loaded_can_be_loaded_later_or_is_dropped_by_the_next() {
        let mut received = curved();
        store(&mut received, &[route("B", 5), waypoint(5, 0)]);
        received.begin_load(CUCS);
        let cut_off = received.at_restart(VEHICLE);
        received.load_failed(VEHICLE);
        assert_eq!(received, cut_off, "a restart in the middle finds it too");
        assert!(received.offered(CUCS).waypoint(5).is_some());
        let mut again = received.clone();
        load(&mut again);
        assert!(again.stored.waypoint(5).is_some() && again.staged.is_none());
        // Without a 13001 it is continued.
        let gives_way = |received: &ReceivedPlan, message| received.gives_way(&message, CUCS);
        assert!(gives_way(&received, waypoint(5, 6)).is_none());
        // Another upload drops it, also where its 13001 comes last.
        store(&mut received, &[waypoint(7, 0), curve(1, 2)]);
        assert!(gives_way(&received, route("B", 0)).is_none());
        store(&mut received, &[route("C", 7)]);
        let numbers: Vec<_> = received.offered(CUCS).numbers().collect();
        assert_eq!(numbers, [1, 2, 7]);
        assert!(received.offered(CUCS).route_named("B").is_none());
        assert!(offer(&mut received, CUCS, "C").is_some());
    }

    #[test]
    fn the_13001_of_a_route_that_was_sent_already_begins_another_upload() {
        let mut received = curved();
        let first = [route("B", 5), waypoint(5, 6), curve(5, 6), waypoint(6, 0)];
        store(&mut received, &first);
        // Another route of the same upload.
        store(&mut received, &[route("C", 8), waypoint(8, 0)]);
        assert!(received.offered(CUCS).route_named("B").is_some());
        store(&mut received, &[route("B", 5), waypoint(5, 6)]);
        assert!(
            received.offered(CUCS).waypoint(6).is_none(),
            "it is of before"
        );
        store(&mut received, &[waypoint(6, 0)]);
        let found = offer(&mut received, CUCS, "B").expect("it is whole");
        assert_eq!(found.curves_from(5).count(), 0);
        assert!(found.route_named("C").is_none() && found.route_named("A").is_some());
    }

    #[test]
    fn what_another_cucs_sends_joins_no_upload() {
        let mut received = curved();
        store(&mut received, &[route("B", 5), waypoint(5, 6)]);
        store_as(OTHER, &mut received, &[waypoint(6, 0)]);
        assert_eq!(received.open_by(), Some(OTHER));
        assert!(received.offered(OTHER).waypoint(5).is_none());
        assert!(received.offered(CUCS).waypoint(6).is_none());
        assert_eq!(offer(&mut received, OTHER, "A"), None);
    }

    #[test]
    fn what_arrives_during_a_load_is_of_the_next_upload() {
        let mut received = curved();
        store(&mut received, &[route("B", 5), waypoint(5, 0)]);
        received.begin_load(CUCS);
        store(&mut received, &[waypoint(7, 0)]);
        assert!(received.to_load().waypoint(7).is_none());
        // A 13000 for it comes too early: it can be repeated, and the one that is carried out is not disturbed.
        received.load_not_begun(CUCS);
        let mut refused = received.clone();
        assert!(received.loaded());
        assert!(received.stored.waypoint(5).is_some() && received.stored.waypoint(7).is_none());
        assert!(received.offered(CUCS).waypoint(7).is_some());
        // Of a load that is refused it keeps nothing.
        store(&mut refused, &[waypoint(8, 0)]);
        refused.refuse(Duration::ZERO, None, VEHICLE);
        assert!(refused.offered(CUCS).waypoint(5).is_none());
        assert!(refused.offered(CUCS).waypoint(8).is_some());
    }

    #[test]
    fn a_route_is_cleared_and_what_is_sent_meanwhile_is_kept() {
        let mut received = curved();
        store(&mut received, &[waypoint(5, 0)]);
        received.begin_clear();
        store(&mut received, &[route("C", 6), waypoint(6, 0)]);
        received.clear(None, VEHICLE);
        assert!(received.stored.is_empty());
        let numbers: Vec<_> = received.offered(CUCS).numbers().collect();
        assert_eq!(numbers, [6]);
        assert!(offer(&mut received, CUCS, "C").is_some());
    }
}
