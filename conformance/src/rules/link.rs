//! Rules of link.

use super::scene::Scene;

pub(super) const SCENES: &[Scene] = &[];
