//! What a rule looks at once more, after its scene has passed: the other station, the next command, the far end of a route.
//!
//! Each was a fault that the scene alone let through. They are played in Editions 3 and 4; what the subject does not have ends in a
//! note, since the scene before has judged the rule.
//! [`grounded`] and [`kept`] have what needs no flight, the latter what a VSM keeps of each CUCS; [`aloft`] has the rest.

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
