//! Whether a route can be flown: where it is too tight for a speed, what speed it allows, what that costs.
//!
//! Promised: every finding names the place, the figure and the fastest legal speed there; nothing is changed
//! silently. The result of a policy is data: a list of speed changes, or a refusal. The predicted deviation is a
//! bound that all measured flights kept ([`flown_bound_m`]); unlike the planned one it is not proven.

mod curvature;
mod deviation;
mod flown;
mod npfg;
mod plan;
mod track;
mod vehicle;
mod wing_track;

pub use curvature::{Tightest, tightest};
pub use deviation::{FlownItem, MAX_WIND_SHARE, flown_bound_m};
pub use flown::{Flown, measure};
pub use npfg::{NorthEast, Npfg};
pub use plan::{
    CURVE_SWING_S, FlightPlan, MIN_ACCEPTANCE_M, NotFlyable, Policy, SpeedChange, Tight,
    chord_acceptance_m, climbing_mps, climbs, plan_flight,
};
pub use track::{Along, Track, TrackLeg, offset_m};
pub use vehicle::{Airframe, FixedWing, Multicopter, ParameterError};
