//! Rules of link.

use super::Scene;

pub(super) const SCENES: &[Scene] = &[];
