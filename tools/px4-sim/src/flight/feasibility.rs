//! PX4's own checks of a mission, few as they are: `FeasibilityChecker.cpp` of v1.18, in its order.
//!
//! They need a home. A plan that fails them is still stored and acknowledged, but it is not flown.

use mavlink_link::service::mission::Item;

use super::items::{
    LAND, LAND_START, LOITER_TO_ALT, RETURN_TO_LAUNCH, TAKEOFF, TRANSITION, VTOL_LAND,
    VTOL_TAKEOFF, WAYPOINT, altitude_m, has_place, loiter_radius, place,
};
use super::view::View;
use crate::config::{Airframe, Param};

/// The first fault that PX4 reports; `None` for a mission that it flies.
pub(crate) fn fault(items: &[Item], view: &View<'_>) -> Option<String> {
    let rejected = |why: &str| Some(format!("Mission rejected: {why}"));
    let wings = view.kind != Airframe::Quad;
    let mut seen = Seen::default();
    for (index, item) in items.iter().enumerate() {
        let before = index.checked_sub(1).and_then(|i| items.get(i));
        if item.command == TAKEOFF || item.command == VTOL_TAKEOFF {
            if above_home(item, view) <= 0.0 {
                return rejected("takeoff altitude too low!");
            }
            seen.takeoff = true;
            if seen.place {
                return rejected("takeoff not first waypoint item");
            }
        }
        seen.place |= has_place(item);
        let of_vtols = matches!(item.command, VTOL_TAKEOFF | VTOL_LAND | TRANSITION);
        if of_vtols && view.kind != Airframe::Vtol {
            return rejected("Mission contains VTOL items but vehicle is not a VTOL");
        }
        if wings {
            if item.command == LAND_START && seen.land_start.replace(index).is_some() {
                return rejected("more than one land start.");
            }
            if matches!(item.command, LAND | VTOL_LAND) {
                match index.checked_sub(1) {
                    Some(approach) => seen.approach = Some(approach),
                    None => return rejected("starts with land waypoint."),
                }
            }
            if item.command == RETURN_TO_LAUNCH && seen.land_start.is_some() {
                return rejected("land start item before RTL item not possible.");
            }
        } else {
            seen.lands |= item.command == LAND;
        }
        if view.kind == Airframe::Plane
            && item.command == LAND
            && let Some(before) = before
            && let Some(why) = glide(before, item, view)
        {
            return rejected(&why);
        }
    }
    if wings {
        if seen.land_start > seen.approach && seen.land_start.is_some() {
            return rejected("invalid land start.");
        }
        seen.lands = seen.approach.is_some();
    }
    let (takeoff, lands) = (seen.takeoff, seen.lands);
    match view.params.int(Param::MIS_TKO_LAND_REQ) {
        1 if !takeoff => rejected("Takeoff waypoint required."),
        2 if !lands => rejected("Landing waypoint/pattern required."),
        3 if !(takeoff && lands) => rejected("Takeoff or Landing item missing."),
        4 if takeoff && !lands => rejected("Add Landing item or remove Takeoff."),
        4 if lands && !takeoff => rejected("Add Takeoff item or remove Landing."),
        5 if view.landed && takeoff != lands => rejected("Add Landing item or remove Takeoff."),
        5 if !view.landed && !lands => rejected("Landing waypoint/pattern required."),
        _ => None,
    }
}

#[derive(Default)]
struct Seen {
    takeoff: bool,
    place: bool,
    lands: bool,
    land_start: Option<usize>,
    approach: Option<usize>,
}

fn above_home(item: &Item, view: &View<'_>) -> f64 {
    altitude_m(item, view) - view.frame.origin().altitude_m + view.home.d
}

/// The fault of a plane's glide to its landing.
fn glide(before: &Item, land: &Item, view: &View<'_>) -> Option<String> {
    if !has_place(before) {
        return None;
    }
    let height = above_home(before, view) - above_home(land, view);
    if height <= 0.0 {
        return Some("the approach waypoint must be above the landing point.".into());
    }
    let away = (place(before, view) - place(land, view)).horizontal();
    let length = match before.command {
        LOITER_TO_ALT => {
            let radius = loiter_radius(before, view).abs();
            if away <= radius {
                return Some("the landing point must be outside the orbit radius.".into());
            }
            (away * away - radius * radius).sqrt()
        }
        WAYPOINT => away,
        _ => return Some("unsupported landing approach entrance waypoint type. Only ORBIT_TO_ALT or WAYPOINT allowed.".into()),
    };
    // PX4 allows 0.1 degree more, for rounding (FeasibilityChecker.cpp).
    let steepest = view.params.get(Param::FW_LND_ANG);
    (height / length > (steepest + 0.1).to_radians().tan()).then(|| {
        format!(
            "the landing glide slope is steeper than the vehicle setting of {steepest:.1} degrees."
        )
    })
}
