//! Rules of status.

use super::Scene;

pub(super) const SCENES: &[Scene] = &[];
