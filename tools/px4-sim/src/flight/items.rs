//! What the items of an uploaded plan mean in the local frame: mission items and the geofence.
//!
//! Pure functions of an item and the navigator's view; which item is current is decided by
//! [`Mission`](super::mission).

use mavlink_link::service::mission::Item;

use super::view::View;
use crate::config::{Airframe, Param};
use crate::physics::airframe::npfg;
use crate::physics::motion::{Geodetic, LocalFrame, Ned};

/// Where an item is.
pub(crate) fn place(item: &Item, view: &View<'_>) -> Ned {
    let altitude_m = altitude_m(item, view);
    // PX4 accepts INT32_MAX as latitude and longitude: such an item is where the vehicle is.
    if item.x == i32::MAX || item.y == i32::MAX {
        return Ned {
            d: view.frame.origin().altitude_m - altitude_m,
            ..view.position
        };
    }
    view.frame
        .to_local(Geodetic::from_e7(item.x, item.y, altitude_m))
}

/// The altitude of an item, metres AMSL; the present altitude where it is not a number.
pub(crate) fn altitude_m(item: &Item, view: &View<'_>) -> f64 {
    let z = f64::from(item.z);
    let relative = matches!(item.frame, 3 | 6);
    let home = view.frame.origin().altitude_m - view.home.d;
    match (z.is_finite(), relative) {
        (true, true) => home + z,
        (true, false) => z,
        (false, _) => view.frame.origin().altitude_m - view.position.d,
    }
}

/// How long the vehicle stays at the item, s.
pub(crate) fn hold_time(item: &Item) -> f64 {
    match item.command {
        WAYPOINT | LOITER_TIME => f64::from(item.params[0]).max(0.0),
        _ => 0.0,
    }
}

/// Loiter radius of an item for a plane, m; positive is clockwise.
pub(crate) fn loiter_radius(item: &Item, view: &View<'_>) -> f64 {
    let own = f64::from(if item.command == LOITER_TO_ALT {
        item.params[1]
    } else {
        item.params[2]
    });
    if own.is_finite() && own.abs() > 1e-6 {
        own
    } else {
        view.params.get(Param::NAV_LOITER_RAD)
    }
}

/// Acceptance radius of an item, m: a multicopter's waypoint may have its own.
pub(crate) fn acceptance(item: &Item, view: &View<'_>) -> f64 {
    let own = f64::from(item.params[1]);
    let may = item.command == WAYPOINT && view.airframe == Airframe::Quad;
    if may && own.is_finite() && own > 0.0 {
        own
    } else {
        view.acceptance()
    }
}

/// How early a plane switches to the next waypoint, m: by its guidance law, at least the acceptance radius.
pub(crate) fn turn_switch_distance(view: &View<'_>) -> f64 {
    let npfg = npfg(view.params);
    view.acceptance()
        .max(npfg.switch_m(view.velocity.horizontal()))
}

/// Whether the vehicle flies to the item, and does not carry it out where it is.
pub(crate) fn has_place(item: &Item) -> bool {
    matches!(
        item.command,
        WAYPOINT
            | LOITER_UNLIM
            | LOITER_TIME
            | LAND
            | TAKEOFF
            | LOITER_TO_ALT
            | VTOL_TAKEOFF
            | VTOL_LAND
    )
}

#[derive(Debug, Clone)]
enum Area {
    Circle { centre: Ned, radius: f64 },
    Polygon(Vec<Ned>),
}

/// The areas of a fence plan, as PX4 v1.18 reads them (geofence.cpp).
#[derive(Debug, Clone, Default)]
pub(crate) struct Fence(Vec<Bound>);

#[derive(Debug, Clone)]
struct Bound {
    keep_in: bool,
    area: Area,
}

impl Fence {
    /// The areas in the stored items. After a circle PX4 takes every corner of a polygon for the first one of a polygon of its own,
    /// with as many corners: one that would end beyond the items has no inside.
    pub(crate) fn new(items: &[Item], frame: &LocalFrame) -> Self {
        let mut bounds = Vec::new();
        let place = |item: &Item| frame.to_local(Geodetic::from_e7(item.x, item.y, 0.0));
        let (mut i, mut circle_before) = (0, false);
        while let Some(item) = items.get(i) {
            let is_circle = matches!(item.command, 5003 | 5004);
            circle_before |= is_circle;
            let corners = (item.params[0] as usize).max(1);
            let area = match item.command {
                5003 | 5004 => Area::Circle {
                    centre: place(item),
                    radius: f64::from(item.params[0]),
                },
                5001 | 5002 => {
                    let of = items.get(i..i.saturating_add(corners)).unwrap_or_default();
                    Area::Polygon(of.iter().map(place).collect())
                }
                _ => {
                    i += 1;
                    continue;
                }
            };
            bounds.push(Bound {
                keep_in: matches!(item.command, 5001 | 5003),
                area,
            });
            i = i.saturating_add(if circle_before { 1 } else { corners });
        }
        Self(bounds)
    }

    /// Whether a place is inside every inclusion area and outside every exclusion area.
    pub(crate) fn allows(&self, at: Ned) -> bool {
        self.0.iter().all(|bound| bound.allows(at))
    }

    /// Leaves out each area that home, or a vehicle in the air where it is `flown`, would breach. Returns PX4's texts about them.
    pub(crate) fn leave_out(&mut self, home: Option<Ned>, flown: Option<Ned>) -> Vec<&'static str> {
        let mut texts = Vec::new();
        self.0.retain(|bound| {
            let before = texts.len();
            for (at, text) in [(home, WITHOUT_HOME), (flown, WITHOUT_VEHICLE)] {
                if at.is_some_and(|at| !bound.allows(at)) {
                    texts.push(text);
                }
            }
            texts.len() == before
        });
        texts
    }
}

impl Bound {
    fn allows(&self, at: Ned) -> bool {
        self.area.contains(at) == self.keep_in
    }
}

const WITHOUT_HOME: &str = "Geofence invalid, doesn't contain Home position\t";
const WITHOUT_VEHICLE: &str = "Geofence invalid, doesn't contain current vehicle position\t";

impl Area {
    fn contains(&self, at: Ned) -> bool {
        match self {
            Self::Circle { centre, radius } => (at - *centre).horizontal() <= *radius,
            Self::Polygon(corners) => {
                let mut inside = false;
                let mut from = match corners.last() {
                    Some(last) => *last,
                    None => return false,
                };
                for &to in corners {
                    if (to.e > at.e) != (from.e > at.e)
                        && at.n < (from.n - to.n) * (at.e - to.e) / (from.e - to.e) + to.n
                    {
                        inside = !inside;
                    }
                    from = to;
                }
                inside
            }
        }
    }
}

// MAV_CMD numbers.
pub(crate) const WAYPOINT: u16 = 16;
pub(crate) const LOITER_UNLIM: u16 = 17;
pub(crate) const LOITER_TIME: u16 = 19;
pub(crate) const RETURN_TO_LAUNCH: u16 = 20;
pub(crate) const LAND: u16 = 21;
pub(crate) const TAKEOFF: u16 = 22;
pub(crate) const LOITER_TO_ALT: u16 = 31;
pub(crate) const VTOL_TAKEOFF: u16 = 84;
pub(crate) const VTOL_LAND: u16 = 85;
pub(crate) const DELAY: u16 = 93;
pub(crate) const JUMP: u16 = 177;
pub(crate) const CHANGE_SPEED: u16 = 178;
pub(crate) const LAND_START: u16 = 189;
pub(crate) const SET_ROI_LOCATION: u16 = 195;
pub(crate) const SET_ROI_NONE: u16 = 197;
pub(crate) const GIMBAL_PITCHYAW: u16 = 1000;
pub(crate) const GIMBAL_CONFIGURE: u16 = 1001;
pub(crate) const TRANSITION: u16 = 3000;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn areas_bound_as_px4_reads_them() {
        let frame = LocalFrame::new(Geodetic {
            latitude_deg: 47.0,
            longitude_deg: 8.0,
            altitude_m: 0.0,
        });
        let item = |command, param1, n, e| {
            let at = frame.to_global(Ned::new(n, e, 0.0));
            Item {
                command,
                params: [param1, 0.0, 0.0, 0.0],
                x: (at.latitude_deg * 1e7) as i32,
                y: (at.longitude_deg * 1e7) as i32,
                ..Item::default()
            }
        };
        let square = |command| {
            [
                (100.0, 100.0),
                (100.0, -100.0),
                (-100.0, -100.0),
                (-100.0, 100.0),
            ]
            .map(|(n, e)| item(command, 4.0, n, e))
        };
        let of = |items: &[Item]| Fence::new(items, &frame);
        let [inside, outside] = [-50.0, -150.0].map(|n| Ned::new(n, 10.0, 0.0));
        let circle = item(5004, 20.0, 50.0, 50.0);
        let items = [&square(5001)[..], &[circle][..]].concat();
        let fence = of(&items);
        assert!(fence.allows(inside));
        assert!(!fence.allows(outside));
        assert!(!fence.allows(Ned::new(55.0, 45.0, 0.0)));

        // Of two areas to stay inside both bind.
        let near = [item(5003, 100.0, 100.0, 10.0)];
        let items = [&square(5001)[..], &near[..]].concat();
        assert!(!of(&items).allows(inside));
        assert!(!of(&items).allows(Ned::new(120.0, 10.0, 0.0)));
        assert!(of(&items).allows(Ned::new(50.0, 10.0, 0.0)));

        // A polygon after a circle is four, of which three are whole no more.
        let items = [&[circle][..], &square(5001)[..]].concat();
        let mut fence = of(&items);
        assert!(!fence.allows(inside));
        assert_eq!(fence.leave_out(Some(inside), None), [WITHOUT_HOME; 3]);
        assert!(fence.allows(inside) && !fence.allows(outside));

        let mut fence = of(&square(5002));
        assert!(fence.leave_out(Some(outside), Some(outside)).is_empty());
        assert!(!fence.allows(inside));
        let texts = fence.leave_out(Some(outside), Some(inside));
        assert_eq!(texts, [WITHOUT_VEHICLE]);
        assert!(fence.allows(inside));
    }
}
