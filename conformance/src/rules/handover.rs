//! Rules of handover.

use super::scene::Scene;

pub(super) const SCENES: &[Scene] = &[];
