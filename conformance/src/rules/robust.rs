//! Rules of robust.

use super::Scene;

pub(super) const SCENES: &[Scene] = &[];
