//! Areas to stay inside or outside, as they come (50016, or the configuration), and as PX4's geofence.
//!
//! | area | PX4 |
//! |---|---|
//! | polygon to stay inside, outside | NAV_FENCE_POLYGON_VERTEX_INCLUSION, _EXCLUSION, one item a corner |
//! | circle to stay inside, outside | NAV_FENCE_CIRCLE_INCLUSION, _EXCLUSION |
//!
//! PX4 holds 64 corners in all. Of several areas to stay inside it allows every one: a further one makes the space
//! larger, so that a CUCS adds none where the configuration has set one.

mod fault;
mod fence;
mod received;
#[cfg(test)]
mod tests;

pub use fault::{AreaError, Reason};
pub use fence::{FencePoint, fence};
pub use received::Areas;

use geo::{Contains, LineString, Point, Polygon};

use crate::limits::metres;

/// What PX4 holds of a geofence: corners and circles together.
pub const MAX_VERTICES: usize = 64;

/// One area, whole.
#[derive(Debug, Clone, PartialEq)]
pub struct Area {
    /// Whether the vehicle stays inside, else outside.
    pub keep_in: bool,
    /// Its outline.
    pub shape: Shape,
}

/// The outline of an area, degrees north and east.
#[derive(Debug, Clone, PartialEq)]
pub enum Shape {
    /// The corners in turn, 3 and more.
    Polygon(Vec<(f64, f64)>),
    /// A circle.
    Circle {
        /// Its centre.
        centre: (f64, f64),
        /// Metres, above 0.
        radius_m: f64,
    },
}

impl Area {
    /// Whether a place, degrees north and east, lies within the outline.
    #[must_use]
    pub fn contains(&self, at: (f64, f64)) -> bool {
        match &self.shape {
            Shape::Polygon(corners) => outline(corners).contains(&Point::new(at.1, at.0)),
            Shape::Circle { centre, radius_m } => metres(*centre, at) <= *radius_m,
        }
    }
}

fn outline(corners: &[(f64, f64)]) -> Polygon {
    let ring = corners.iter().map(|(north, east)| (*east, *north));
    Polygon::new(ring.collect::<LineString>(), Vec::new())
}
