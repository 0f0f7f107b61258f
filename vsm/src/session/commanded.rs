//! What 3002 and 3004 report as commanded: what the vehicle took last, as long as it is in the mode that it took it in.
//!
//! PX4 forgets speeds, places and altitudes when it changes its mode; so does this VSM, whoever has changed it.

use mapping::configuration::changes;
use mapping::mode::Px4Mode;
use mapping::report::{self, Commanded};

use super::aircraft::Aircraft;
use super::desk::Desk;

impl Aircraft {
    /// A maneuver is done: what it commanded goes with the mode that the vehicle shows now.
    pub(super) fn keep_commanded(&mut self) {
        let compiled = self.aboard.as_ref().map(|aboard| &aboard.compiled);
        self.commanded_in = self.mav.telemetry.mode;
        self.commanded.speed_leg =
            compiled.and_then(|compiled| report::to_index(&self.mav.telemetry, compiled));
    }

    /// The vehicle has changed its mode.
    pub(super) fn mode_has_changed(&mut self, desk: &mut Desk<'_>) {
        self.watch_commanded();
        self.report_on_change(desk);
        let mode = self.mav.telemetry.mode.map(Px4Mode::reported);
        if let Some(told) = mode.and_then(changes::mode) {
            self.tell_the_configured(desk, &[told], None);
        }
    }

    /// Forgets what was commanded in another mode. What a maneuver leads to is known at its end.
    pub(super) fn watch_commanded(&mut self) {
        let mode = self.mav.telemetry.mode;
        if self.maneuver.is_some() || self.commanded_in == mode {
            return;
        }
        // It hovers where it has taken off to.
        let taken_off =
            self.commanded_in == Some(Px4Mode::TAKEOFF) && mode == Some(Px4Mode::LOITER);
        if !taken_off {
            self.commanded = Commanded::default();
        }
        self.commanded_in = mode;
    }
}
