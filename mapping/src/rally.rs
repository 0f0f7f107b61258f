//! Rally points: places that PX4 may return to beside home, as items of a store of their own (MAV_MISSION_TYPE_RALLY).
//!
//! No edition of the DLI has a message or a route type for them: they are of the configuration. What PX4 v1.18 does with
//! them (`navigator/rtl.cpp`): where RTL_TYPE is 0 or 3 it returns to the nearest of home and them, where it is 1 to the nearest
//! of them, home only where there is none, and where it is 5 to the nearest of them or to nothing else; with 2 and 4 it follows
//! its mission and ignores them. It lands there: the height of a point is that of its ground.

use mavlink_link::service::mission::{FRAME_GLOBAL, FRAME_GLOBAL_RELATIVE, Item};

use crate::area::{Area, is_breached};
use crate::route::degrees_e7;

/// What PX4 holds of them.
pub const MAX_POINTS: usize = 32;

/// One of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RallyPoint {
    /// Degrees north and east.
    pub place: (f64, f64),
    /// The height of its ground.
    pub height: Height,
}

/// A height, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Height {
    /// Above home, wherever that is when the vehicle returns.
    AboveHome(f64),
    /// Above mean sea level.
    Amsl(f64),
}

/// NAV_RALLY_POINT, as PX4 takes them.
#[must_use]
pub fn items(points: &[RallyPoint]) -> Vec<Item> {
    let item = |point: &RallyPoint| {
        let (frame, height_m) = match point.height {
            Height::AboveHome(height_m) => (FRAME_GLOBAL_RELATIVE, height_m),
            Height::Amsl(height_m) => (FRAME_GLOBAL, height_m),
        };
        Item {
            frame,
            command: RALLY_POINT,
            current: false,
            autocontinue: true,
            params: [0.0; 4],
            x: degrees_e7(point.place.0),
            y: degrees_e7(point.place.1),
            z: height_m as f32,
        }
    };
    points.iter().map(item).collect()
}

/// The first point, from 0, that these areas of a fence forbid: PX4 does not look at its fence when it chooses one.
#[must_use]
pub fn outside(points: &[RallyPoint], areas: &[Area]) -> Option<usize> {
    points
        .iter()
        .position(|point| is_breached(areas, point.place))
}

/// Whether a vehicle with this RTL_TYPE returns to rally points.
#[must_use]
pub fn are_used(rtl_type: f64) -> bool {
    [0.0, 1.0, 3.0, 5.0].contains(&rtl_type)
}

const RALLY_POINT: u16 = 5100;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::area::Shape;

    const POINT: RallyPoint = RallyPoint {
        place: (47.01, 8.0),
        height: Height::AboveHome(5.0),
    };

    #[test]
    fn heights_keep_their_reference() {
        let amsl = RallyPoint {
            height: Height::Amsl(490.5),
            ..POINT
        };
        let items = items(&[POINT, amsl]);
        let sent: Vec<_> = items.iter().map(|i| (i.command, i.frame, i.z)).collect();
        assert_eq!(sent, [(5100, 3, 5.0), (5100, 0, 490.5)]);
        assert_eq!((items[0].x, items[0].y), (470_100_000, 80_000_000));
    }

    #[test]
    fn a_point_that_the_fence_forbids_is_found() {
        let circle = |keep_in, north, radius_m| Area {
            keep_in,
            shape: Shape::Circle {
                centre: (north, 8.0),
                radius_m,
            },
        };
        assert_eq!(outside(&[POINT], &[]), None);
        assert_eq!(outside(&[POINT], &[circle(true, 47.0, 2_000.0)]), None);
        assert_eq!(outside(&[POINT], &[circle(true, 47.0, 500.0)]), Some(0));
        assert_eq!(outside(&[POINT], &[circle(false, 47.01, 50.0)]), Some(0));
        let one_of_two = [circle(true, 47.0, 2_000.0), circle(true, 47.0, 500.0)];
        assert_eq!(outside(&[POINT], &one_of_two), Some(0));
    }
}
