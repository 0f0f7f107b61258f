//! Rules of robust.

use super::scene::Scene;

pub(super) const SCENES: &[Scene] = &[];
