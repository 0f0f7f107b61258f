//! What of a draft formats do not hold, each in its own words.

use std::path::Path;

use super::draft::Draft;
use super::items;
use super::losses::{Losses, counted};
use crate::fence::Area;
use crate::route::form::ROUTE_TYPES;

/// Items that only mission files hold.
pub(super) fn extras(draft: &Draft, losses: &mut Losses) {
    for extra in &draft.extras {
        losses.add(extra.item, items::describe(extra));
    }
}

pub(super) fn fence(draft: &Draft, losses: &mut Losses) {
    some(
        draft.areas.len(),
        "area of the geofence",
        "areas of the geofence",
        losses,
    );
}

pub(super) fn rally(draft: &Draft, losses: &mut Losses) {
    some(draft.rally.len(), "rally point", "rally points", losses);
}

/// A geofence has messages of its own.
pub(super) fn sent_fence(areas: &[Area], file: &Path, losses: &mut Losses) {
    if !areas.is_empty() {
        let file = file.display();
        losses.add_whole(format!("geofence (send it with \"cucs fence {file}\")"));
    }
}

/// What only a route file holds.
pub(super) fn route(draft: &Draft, losses: &mut Losses) {
    let Some(plan) = &draft.plan else { return };
    if let Some(kind) = plan.route_type.and_then(|kind| ROUTE_TYPES.word(kind)) {
        losses.add_whole(format!("route type {kind}"));
    }
    for further in &plan.further {
        let name = further.id.as_deref().unwrap_or("without a name");
        losses.add_whole(format!("route {name} from waypoint {}", further.initial));
    }
    for waypoint in &plan.waypoints {
        let number = usize::from(waypoint.number);
        if draft.points.iter().all(|point| point.item != number) {
            losses.add(number, "waypoint that the route does not reach");
        }
    }
}

fn some(count: usize, one: &str, many: &str, losses: &mut Losses) {
    if count > 0 {
        losses.add_whole(counted(count, one, many));
    }
}
