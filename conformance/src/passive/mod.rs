//! Judges of passive rules: pure functions over recorded traffic.
//!
//! They run on the recording of a run, beside the scenes, and on a capture file. A judge gives no pass for what did not
//! occur. To add one: write a function in the file of its subject, which looks at [`View::messages`] and calls
//! [`Found`]'s methods, and name it in that file's `JUDGES`.

mod meaning;
mod station;
mod values;
mod view;
mod wrapper;

pub use view::{Found, Judge, View};

/// All judges.
#[must_use]
pub fn judges() -> Vec<&'static Judge> {
    [wrapper::JUDGES, values::JUDGES, meaning::JUDGES]
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
    ]
    .into_iter()
    .flatten()
    .collect()
}
