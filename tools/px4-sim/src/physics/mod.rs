//! How the vehicle moves: short formulas with the figures of the reference vehicle.
//!
//! From the bottom: [`motion`] (positions, frames, attitude), [`noise`] (the difference between estimate and truth),
//! [`trajectory`] (what is requested of an airframe, and PX4's smoothing of it), [`quad`] and [`plane`] (the two
//! airframes), [`airframe`] (any airframe behind one set of calls).
//!
//! Nothing here depends on a mode, a message or a mission.

pub(crate) mod airframe;
pub(crate) mod motion;
pub(crate) mod noise;
pub(crate) mod plane;
pub(crate) mod quad;
pub(crate) mod trajectory;
pub(crate) mod vtol;
