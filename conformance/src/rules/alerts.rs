//! Rules of alerts.

use super::scene::Scene;

pub(super) const SCENES: &[Scene] = &[];
