//! Second looks: what is played for a rule once its scene has passed, such as the other station, the next command,
//! the far end of a route.
//!
//! Each was a fault that the scene alone did not find. They are played in Editions 3 and 4; what the subject does not
//! have becomes a note, since the scene before has judged the rule. [`grounded`] and [`kept`] need no flight; `kept`
//! has what a VSM keeps for each CUCS. [`aloft`] has the rest.

mod aloft;
mod grounded;
mod kept;

use super::scene::Scene;

/// All of them.
pub(super) fn scenes() -> impl Iterator<Item = &'static Scene> {
    [grounded::FURTHER, kept::FURTHER, aloft::FURTHER]
        .into_iter()
        .flatten()
}
