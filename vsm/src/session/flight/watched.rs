//! What a vehicle has shown for how long: a hold of PX4 that nothing follows, a wing that may be on its final approach.

use std::time::Duration;

use mapping::mode::Px4Mode;

use crate::session::context::may_be_on_final;
use crate::session::link::state::VehicleState;
use crate::session::other::{Holding, Other};

/// What the vehicle has shown for how long.
#[derive(Debug, Default)]
pub(super) struct Watched {
    /// It holds, as a failsafe of PX4.
    pub(super) holding: Holding,
    /// A wing flies a mission and has not reported which item, since then.
    pub(super) item_unknown_since: Option<Duration>,
    /// Its mode has changed, and no report since the last command has shown that yet.
    pub(super) mode_changed: bool,
    /// The mode that a maneuver has led to, while the vehicle stays in it: nobody else has entered it.
    pub(super) entered: Option<Px4Mode>,
    /// It has flown a mission, and only held since.
    pub(super) flew: bool,
}

impl Watched {
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
        // A report of before the last command shows no end of it.
        if vehicle.live() && vehicle.settled_mode().is_some() {
            self.holding.note(Other::of(&vehicle.telemetry), now);
        }
    }
}
