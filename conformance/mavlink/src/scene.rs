//! A rule with the scene by which it is judged.

use conformance::verdict::Judged;

use crate::bench::Trial;

/// A rule with its scene.
pub struct Scene {
    /// Rule id.
    pub rule: &'static str,
    /// What is played.
    pub play: fn(&Trial<'_>) -> Judged,
}
