//! Rules of payload.

use super::Scene;

pub(super) const SCENES: &[Scene] = &[];
