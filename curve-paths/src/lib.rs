//! Cubic Bezier legs: what they mean, straight legs that are proven to keep within a tolerance of them, whether they
//! can be flown, and the fewest of them through a track. Pure geometry: no clock, randomness, input or output.
#![forbid(unsafe_code)]

pub mod bound;
mod budget;
pub mod cubic;
mod densify;
pub mod fit;
pub mod flight;
mod free;
mod leg;
mod local;
mod reading;
pub mod vector;
mod walk;
pub mod wgs84;

pub use budget::{BudgetError, Budgeted, densify_to_budget};
pub use densify::{
    Densified, DensifyError, Leg, Options, Vertex, Vertices, densify, vertices_needed,
};
pub use leg::{BezierLeg, Control, LegError, Reach};
pub use local::Charges;
pub use wgs84::{Ground, Position};
