//! Rules of an autopilot: a scene each, in which the suite plays a ground station.
//!
//! A scene is given a [`Trial`](crate::bench::Trial), plays, and returns: `Ok` is a pass, a `Stop` returned by `?` is
//! anything else. To add one: write the rule into `rules.toml`, the function in the file of its group, name it in
//! that file's `SCENES`, and show with a fault of `tests/interop/mavlink_peers` that it can fail.

mod command;
mod frame;
mod keys;
mod mission;
mod mission_faults;
mod param;
mod signing;
pub(crate) mod survey;

use crate::scene::Scene;

/// All scenes, in the order of the run: from harmless to what the subject may not survive.
#[must_use]
pub fn scenes() -> Vec<&'static Scene> {
    [
        frame::SCENES,
        command::SCENES,
        param::SCENES,
        mission::SCENES,
        mission_faults::SCENES,
        signing::SCENES,
        keys::SCENES,
    ]
    .into_iter()
    .flatten()
    .collect()
}
