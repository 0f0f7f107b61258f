//! How the vehicle moves: short formulas whose figures are those of the reference vehicle.
//!
//! From the bottom: [`motion`] (positions, frames, attitude), [`noise`] (what makes belief differ from truth),
//! [`trajectory`] (what is requested of an airframe, and PX4's smoothing of it), [`quad`] and [`plane`] (the two
//! airframes), [`airframe`] (either of them behind one set of calls).
//!
//! Nothing here knows a mode, a message or a mission.

pub(crate) mod airframe;
pub(crate) mod motion;
pub(crate) mod noise;
pub(crate) mod plane;
pub(crate) mod quad;
pub(crate) mod trajectory;
pub(crate) mod vtol;
