//! Rules of curves.

use super::scene::Scene;

pub(super) const SCENES: &[Scene] = &[];
