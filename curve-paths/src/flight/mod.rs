//! Whether a route can be flown: where it is too tight for a speed, what speed it allows, what that costs.
//!
//! Promised: every finding names the place, the figure and the fastest legal speed there; nothing is changed silently.
//! What a policy makes of the findings is data: a list of speed changes, or a refusal. The predicted deviation is a
//! prediction from flights that were measured, never a bound.

mod curvature;
mod flown;
mod plan;
mod vehicle;

pub use curvature::{Tightest, tightest};
pub use flown::{Flown, measure};
pub use plan::{FlightPlan, NotFlyable, Policy, SpeedChange, Tight, plan_flight};
pub use vehicle::{Airframe, FixedWing, Multicopter};
