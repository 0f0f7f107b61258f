//! What a rule looks at once more, after its scene has passed: the other station, the next command, the far end of a route.
//!
//! Each was a fault that the scene alone let through. They are played in Editions 3 and 4; what the subject does not have ends in a
//! note, since the scene before has judged the rule.
//! [`grounded`] has what needs no flight, [`aloft`] the rest.

mod aloft;
mod grounded;

use super::scene::Scene;

/// All of them.
pub(super) fn scenes() -> impl Iterator<Item = &'static Scene> {
    grounded::FURTHER.iter().chain(aloft::FURTHER)
}
