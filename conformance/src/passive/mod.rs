//! Judges of passive rules: pure functions over recorded traffic.
//!
//! They run on the recording of a run, beside the scenes, and on a capture file. A judge never passes a rule for what
//! did not occur. To add one: write a function in the file of its subject, which reads [`View::messages`] and calls
//! the methods of [`Found`], and name it in that file's `JUDGES`.

mod agreement;
mod condition;
mod dialogue;
mod ed25;
mod endurance;
mod meaning;
mod motion;
mod places;
mod station;
mod values;
mod view;
mod wrapper;

use std::sync::Arc;

pub use view::{Found, Judge, View};

use crate::catalogue::Subject;
use crate::verdict::Judgement;
use crate::wire::Seen;

/// All judges.
#[must_use]
pub fn judges() -> Vec<&'static Judge> {
    [
        wrapper::JUDGES,
        values::JUDGES,
        meaning::JUDGES,
        dialogue::JUDGES,
        agreement::JUDGES,
        motion::JUDGES,
        condition::JUDGES,
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// All judges of a CUCS: those of `station`, `places` and `endurance`, and those of the wire.
#[must_use]
pub fn cucs_judges() -> Vec<&'static Judge> {
    [
        wrapper::JUDGES,
        values::JUDGES,
        meaning::JUDGES,
        station::JUDGES,
        places::JUDGES,
        endurance::JUDGES,
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// A judge, and which messages it reads where Edition 2.5 is judged.
#[derive(Clone, Copy)]
pub struct Applied {
    /// The judge.
    pub judge: &'static Judge,
    /// Messages as they are, not their counterparts in Edition 4.
    pub as_they_are: bool,
}

impl Applied {
    /// What it finds in this traffic.
    #[must_use]
    pub fn judge(&self, view: &View<'_>) -> (Judgement, Vec<Arc<Seen>>) {
        let view = View {
            as_they_are: self.as_they_are,
            ..*view
        };
        let mut found = Found::default();
        (self.judge.judge)(&view, &mut found);
        found.judgement()
    }
}

/// Whether the judges of a rule found anything to judge in this traffic of a VSM, and what each of them did not: for a
/// scene that makes traffic for them.
#[must_use]
pub fn looked_at(rule: &str, view: &View<'_>) -> (bool, Vec<String>) {
    let (mut any, mut missing) = (false, Vec::new());
    let judges = judges_of(&view.profile.subject.edition, Subject::Vsm);
    for applied in judges.iter().filter(|one| one.judge.rule == rule) {
        let view = View {
            as_they_are: applied.as_they_are,
            ..*view
        };
        let mut found = Found::default();
        (applied.judge.judge)(&view, &mut found);
        let (looked, missed) = found.looked();
        any |= looked;
        missing.extend_from_slice(missed);
    }
    (any, missing)
}

/// All judges for the traffic of a VSM, or of a CUCS, in an edition.
#[must_use]
pub fn judges_of(edition: &str, subject: Subject) -> Vec<Applied> {
    let of_cucs = subject == Subject::Cucs;
    let applied = |judge, as_they_are| Applied { judge, as_they_are };
    if edition != "2.5" {
        let all = if of_cucs { cucs_judges() } else { judges() };
        return all.into_iter().map(|judge| applied(judge, false)).collect();
    }
    let own = ed25::JUDGES.iter().map(|judge| applied(judge, true));
    // A dialogue is judged from the side that answers: the VSM's.
    let of_vsms = [dialogue::JUDGES, motion::JUDGES];
    let of_vsms = of_vsms.into_iter().flatten().filter(|_| !of_cucs);
    let of_both = [wrapper::JUDGES, values::JUDGES, meaning::JUDGES];
    let shared = of_both.into_iter().flatten().chain(of_vsms);
    let shared = shared.filter_map(|judge| {
        let as_they_are = ed25::AS_THEY_ARE.contains(&judge.rule);
        let wanted = as_they_are || ed25::SHARED.contains(&judge.rule);
        wanted.then(|| applied(judge, as_they_are))
    });
    let of_stations = [station::JUDGES, places::JUDGES, endurance::JUDGES];
    let of_stations = of_stations.into_iter().flatten().filter(|_| of_cucs);
    own.chain(shared)
        .chain(of_stations.map(|judge| applied(judge, false)))
        .collect()
}
