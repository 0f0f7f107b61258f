//! Rules of curves.

use super::Scene;

pub(super) const SCENES: &[Scene] = &[];
