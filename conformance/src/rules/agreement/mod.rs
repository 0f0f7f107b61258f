//! What a rule looks at once more, after its scene has passed: the other station, the next command, the far end of a route.
//!
//! Each was a fault that the scene alone let through. They are played in Editions 3 and 4; what the subject does not have ends in a
//! note, since the scene before has judged the rule.
//! [`grounded`] has what needs no flight, [`aloft`] the rest.

mod aloft;
mod grounded;

use std::sync::atomic::Ordering;

use super::acknowledgement::about;
use super::scene::Scene;
use crate::bench::station::{Sent, Station};
use crate::bench::trial::Trial;

/// All of them.
pub(super) fn scenes() -> impl Iterator<Item = &'static Scene> {
    grounded::FURTHER.iter().chain(aloft::FURTHER)
}

/// Whether 17000 type 3 came about a message within the time of an acknowledgement.
fn refused(t: &Trial, a: &Station, sent: &Sent) -> bool {
    let (kind, stamp) = (sent.kind, sent.stamp);
    a.wait(sent.mark, t.timers().ack, |seen| {
        about(seen, kind, stamp) && seen.raw("Acknowledgement Type") == Some(3)
    })
    .is_some()
}

fn released_to_fly(t: &Trial) -> bool {
    t.bench.flight_released.load(Ordering::SeqCst)
}
