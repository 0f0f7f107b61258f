//! What of a draft formats do not hold, each in its own words.

use std::collections::HashSet;
use std::path::Path;

use super::draft::Draft;
use super::items;
use super::losses::{Losses, counted};
use super::qgc_plan;
use crate::fence::Area;
use crate::route::form::ROUTE_TYPES;

/// Items that only mission files hold.
pub(super) fn extras(draft: &Draft, losses: &mut Losses) {
    for extra in &draft.extras {
        losses.add(extra.item, items::describe(extra));
    }
    planned(draft, losses);
}

impl Draft {
    /// What is lost where only the places of its points are taken, as a fit does: what was lost on reading too.
    #[must_use]
    pub fn lost_beside_places(&self) -> Losses {
        let mut losses = self.losses.clone();
        for point in &self.points {
            let conduct = &point.conduct;
            let speed = conduct.speed_m_s.map(|speed| format!("speed {speed} m/s"));
            let others = [
                (point.curve.is_some(), "curve of the leg that begins there"),
                (conduct.turn.is_some(), "kind of the turn"),
                (conduct.loiter.is_some(), "loiter"),
                (conduct.repeat.is_some(), "loop"),
                (conduct.take_off.is_some(), "take-off"),
            ];
            let others = others.into_iter().filter(|(is, _)| *is);
            for what in speed
                .into_iter()
                .chain(others.map(|(_, what)| what.to_owned()))
            {
                losses.add(point.item, what);
            }
        }
        extras(self, &mut losses);
        fence(self, &mut losses);
        rally(self, &mut losses);
        losses
    }
}

/// Speeds that only a .plan has.
pub(super) fn planned(draft: &Draft, losses: &mut Losses) {
    let Some(what) = qgc_plan::planned_speeds(draft) else {
        return;
    };
    if qgc_plan::has_default_speeds(draft) {
        losses.note(format!("not taken, as in every new plan: {what}"));
    } else {
        losses.add_whole(what);
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
    let reached: HashSet<usize> = draft.points.iter().map(|point| point.item).collect();
    for waypoint in &plan.waypoints {
        let number = usize::from(waypoint.number);
        if !reached.contains(&number) {
            losses.add(number, "waypoint that the route does not reach");
        }
    }
}

fn some(count: usize, one: &str, many: &str, losses: &mut Losses) {
    if count > 0 {
        losses.add_whole(counted(count, one, many));
    }
}
