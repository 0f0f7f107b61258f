//! What a rule's scene is: the rule's id and a function.

use crate::bench::trial::Trial;
use crate::verdict::Judged;

/// A rule's scene.
pub struct Scene {
    /// Id of the rule.
    pub rule: &'static str,
    /// The scene.
    pub play: fn(&Trial) -> Judged,
}
