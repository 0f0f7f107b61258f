//! A maneuver that has ended, and is answered once the vehicle's reason has come or does not come.

use stanag_msgs::enums::AckType;

use crate::session::context::Origin;
use crate::session::effects::Effects;
use crate::session::link::state::VehicleState;
use crate::session::maneuver::Refusal;

/// What is to be answered.
#[derive(Debug)]
pub(super) struct Unexplained {
    pub(super) origin: Option<Origin>,
    /// Other commands that it carried out.
    pub(super) joined: Vec<Origin>,
    pub(super) refusal: Refusal,
}

impl Unexplained {
    pub(super) fn answer(self, vehicle: &VehicleState, effects: &mut Effects<'_>) {
        effects.refuse(self.origin, self.refusal.text(vehicle));
        // For the same reason, which is sent once.
        for joined in self.joined {
            effects.acknowledge(&joined, AckType::Refused);
        }
    }
}
