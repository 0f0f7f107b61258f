//! Rules of handover.

use super::Scene;

pub(super) const SCENES: &[Scene] = &[];
