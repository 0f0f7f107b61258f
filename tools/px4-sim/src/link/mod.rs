//! The vehicle behind its links: [`signing`] checks frames as PX4 v1.18 does, [`autopilot`] frames, signs and
//! delivers them.

pub(crate) mod autopilot;
pub(crate) mod signing;
