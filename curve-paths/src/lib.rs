#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]

pub mod bound;
mod budget;
pub mod cubic;
mod densify;
pub mod fit;
pub mod flight;
mod free;
mod geotiff;
mod leg;
mod local;
mod reading;
pub mod terrain;
pub mod vector;
mod walk;
pub mod wgs84;

pub use budget::{BudgetError, Budgeted, densify_to_budget};
pub use densify::{DensifyError, Leg, Options, Vertices, densify, vertices_needed};
pub use leg::{BezierLeg, Control, LegError, Reach};
pub use local::ErrorAllowance;
pub use walk::{Densified, Vertex};
pub use wgs84::{Ground, Position};
