//! Rules of load.

use super::Scene;

pub(super) const SCENES: &[Scene] = &[];
