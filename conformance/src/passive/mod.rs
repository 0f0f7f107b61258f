//! Judges of passive rules: pure functions over recorded traffic.
//!
//! They run on the recording of a run, beside the scenes, and on a capture file. A judge gives no pass for what did not
//! occur. To add one: write a function in the file of its subject, which looks at [`View::messages`] and calls
//! [`Found`]'s methods, and name it in that file's `JUDGES`.

mod dialogue;
mod ed25;
mod endurance;
mod meaning;
mod station;
mod values;
mod view;
mod wrapper;

pub use view::{Found, Judge, View};

/// All judges.
#[must_use]
pub fn judges() -> Vec<&'static Judge> {
    [
        wrapper::JUDGES,
        values::JUDGES,
        meaning::JUDGES,
        dialogue::JUDGES,
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// All judges of a CUCS: its own, and those of the wire.
#[must_use]
pub fn cucs_judges() -> Vec<&'static Judge> {
    [
        wrapper::JUDGES,
        values::JUDGES,
        meaning::JUDGES,
        station::JUDGES,
        endurance::JUDGES,
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// A judge of Edition 2.5, and whether it looks at the counterparts of messages in Edition 4.
#[derive(Clone, Copy)]
pub struct Applied {
    /// The judge.
    pub judge: &'static Judge,
    /// Whether its view has the counterparts in place of the messages.
    pub counterparts: bool,
}

/// All judges of recorded traffic of an edition.
#[must_use]
pub fn judges_of(edition: &str) -> Vec<Applied> {
    let as_it_is = |judge| Applied {
        judge,
        counterparts: false,
    };
    if edition != "2.5" {
        return judges().into_iter().map(as_it_is).collect();
    }
    let shared = cucs_judges();
    let named = |rules: &'static [&str], counterparts: bool| {
        let found = shared.iter().filter(|judge| rules.contains(&judge.rule));
        found.map(move |&judge| Applied {
            judge,
            counterparts,
        })
    };
    ed25::JUDGES
        .iter()
        .map(as_it_is)
        .chain(named(ed25::AS_THEY_ARE, false))
        .chain(named(ed25::SHARED, true))
        .collect()
}
