//! Cubic Bezier legs: what they mean, straight legs that are proven to keep within a tolerance of them, whether they
//! can be flown, and the fewest of them through a track. Pure geometry: no clock, randomness, input or output.
//!
//! ```
//! use curve_paths::{BezierLeg, Control, Leg, Options, Position, densify};
//!
//! let at = |lat_deg, lon_deg| Control { lat_deg, lon_deg, alt_m: None };
//! let leg = BezierLeg::new(
//!     Position::new(47.3980, 8.5460, 530.0),
//!     at(47.3990, 8.5460),
//!     at(47.3995, 8.5475),
//!     Position::new(47.3985, 8.5485, 530.0),
//! )?;
//! let chords = densify(&[Leg::from(leg)], &Options::flight(1.0))?;
//! assert!(chords.bound_m <= 1.0 && chords.shortest_chord_m >= 4.0);
//! assert!(chords.vertices.len() < 12, "{} vertices", chords.vertices.len());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
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
pub use local::ErrorAllowance;
pub use wgs84::{Ground, Position};
