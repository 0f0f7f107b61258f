//! How long the vehicle has been in a state: a PX4 hold that leads to nothing else, or a fixed wing that may be on its final
//! approach.

use std::time::Duration;

use mapping::mode::Px4Mode;

use crate::session::context::may_be_on_final;
use crate::session::link::state::VehicleState;
use crate::session::other::{Holding, Other};

/// The tracked states and their durations.
#[derive(Debug, Default)]
pub(super) struct Watched {
    /// Since when it has been holding as a PX4 failsafe.
    pub(super) holding: Holding,
    /// Since when a fixed wing has been flying a mission without reporting its item.
    pub(super) item_unknown_since: Option<Duration>,
    /// The mode may have changed, not confirmed yet by a report after the last command.
    pub(super) mode_changed: bool,
    /// The mode that a maneuver has entered, while the vehicle stays in it: nobody else has commanded it.
    pub(super) entered: Option<Px4Mode>,
    /// It has flown a mission and has only held since.
    pub(super) flew: bool,
}

impl Watched {
    /// The bridge did not run for so long, and so saw nothing of it.
    pub(super) fn note_stop(&mut self, stopped: Duration) {
        self.item_unknown_since = self.item_unknown_since.map(|since| since + stopped);
        self.holding.note_stop(stopped);
    }

    pub(super) fn note(&mut self, vehicle: &VehicleState, now: Duration) {
        let since = |before: Option<Duration>, so: bool| so.then(|| before.unwrap_or(now));
        let unknown = vehicle.live() && may_be_on_final(&vehicle.telemetry);
        self.item_unknown_since = since(self.item_unknown_since, unknown);
        self.entered = self
            .entered
            .filter(|mode| vehicle.telemetry.mode == Some(*mode));
        self.flew = match vehicle.telemetry.mode {
            Some(Px4Mode::MISSION) => true,
            Some(Px4Mode::LOITER) => self.flew,
            _ => false,
        };
        // A report from before the last command cannot show its end.
        if vehicle.live() && vehicle.settled_mode().is_some() {
            self.holding.note(Other::of(&vehicle.telemetry), now);
        }
    }
}
