//! Areas to stay inside or outside, as they come (50016, or the configuration), and as PX4's geofence.
//!
//! | area | PX4 |
//! |---|---|
//! | polygon to stay inside, outside | NAV_FENCE_POLYGON_VERTEX_INCLUSION, _EXCLUSION, one item a corner |
//! | circle to stay inside, outside | NAV_FENCE_CIRCLE_INCLUSION, _EXCLUSION |
//!
//! PX4 holds 64 corners in all. It allows only where all areas to stay inside overlap (geofence.cpp, since v1.15): a further one
//! makes the space smaller. As it reads its fence it leaves out an area that home breaches, and one that the vehicle breaches in the
//! air, and it reads a polygon after a circle wrongly: circles come last.
//!
//! In reading order: `shape` (an area, and what lies inside of it), `crossing` (places and ways compared with areas), `received` (the
//! areas of a CUCS, vertex by vertex), `fence` (areas as PX4 takes them), `error` (each refusal).

mod crossing;
mod error;
mod fence;
mod received;
mod shape;
#[cfg(test)]
mod testing;

pub use crossing::{
    Crossing, circle_crossing, first_breach, first_leg_across, is_breached, way_crossing,
};
pub use error::{AreaError, Reason};
pub use fence::{FencePoint, Holder, fence};
pub use received::Areas;
pub use shape::{Area, Shape};
