//! Rules of payload.

use super::scene::Scene;

pub(super) const SCENES: &[Scene] = &[];
