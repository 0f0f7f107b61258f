//! Rules of alerts.

use super::Scene;

pub(super) const SCENES: &[Scene] = &[];
