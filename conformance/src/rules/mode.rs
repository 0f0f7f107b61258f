//! Rules of mode.

use super::Scene;

pub(super) const SCENES: &[Scene] = &[];
