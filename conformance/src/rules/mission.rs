//! Rules of mission.

use super::Scene;

pub(super) const SCENES: &[Scene] = &[];
