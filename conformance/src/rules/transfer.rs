//! Rules of transfer.

use super::Scene;

pub(super) const SCENES: &[Scene] = &[];
