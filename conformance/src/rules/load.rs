//! Rules of load.

use super::scene::Scene;

pub(super) const SCENES: &[Scene] = &[];
