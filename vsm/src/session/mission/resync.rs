//! A vehicle whose data arrives again, or that has restarted: does it still carry the mission that was loaded?
//!
//! PX4 names its mission by a checksum (MISSION_CURRENT.mission_id). Where it is another than the one that was read back
//! after the load, the loaded mission is sent again, byte for byte, with a warning. Never while the vehicle flies a
//! mission: that is not exchanged in flight; there is a warning, and the loaded one is sent once the vehicle leaves
//! AUTO.MISSION. After a start of this VSM nothing is sent without a command: somebody may have worked on the vehicle
//! meanwhile; there is a warning of the difference.

use mapping::mode::Px4Mode;

use super::input::Context;
use super::record::UploadedMission;
use crate::session::effects::Effects;

/// A comparison that is due.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Resync {
    /// Whether this process has compared before: the vehicle has returned.
    returned: bool,
    due: bool,
    /// There was a warning that the end of the flown mission is awaited.
    warned: bool,
}

impl Resync {
    /// Data of the vehicle arrives again, or it has restarted; what it reports of its mission from now on counts.
    pub(super) fn begin(&mut self) {
        self.due = true;
        self.warned = false;
    }

    /// Compares once the vehicle has reported its mission. True where the loaded one must be sent again; `free`: that
    /// can begin now.
    pub(super) fn compare(
        &mut self,
        context: &Context<'_>,
        uploaded: Option<&UploadedMission>,
        free: bool,
        effects: &mut Effects<'_>,
    ) -> bool {
        if !self.due || !context.vehicle.live() {
            return false;
        }
        let telemetry = &context.vehicle.telemetry;
        let Some(mission) = telemetry.mission else {
            return false;
        };
        let loaded = uploaded.map_or(0, |uploaded| uploaded.mission_id);
        // What has no id cannot be compared; what is being loaded is compared at its end.
        if loaded == 0 || mission.mission_id == loaded {
            self.compared();
            return false;
        }
        let differs = format!(
            "the vehicle holds another plan ({:08x}) than the one loaded ({loaded:08x})",
            mission.mission_id
        );
        // The first look after a start of this VSM: another station may have changed the mission on purpose meanwhile.
        if !self.returned {
            self.compared();
            effects.warn_of_link(format!(
                "{differs}: load it again (13000) before it is flown"
            ));
            return false;
        }
        // PX4 would fly the other plan at once, from the index that it has reached in this one.
        if telemetry.mode == Some(Px4Mode::MISSION) && telemetry.airborne() {
            if !self.warned {
                // Once: the comparison stays due, and is repeated until the vehicle leaves the mode.
                self.warned = true;
                effects.warn_of_link(format!(
                    "{differs}, and flies it: the loaded one is sent again once it leaves AUTO.MISSION"
                ));
            }
            return false;
        }
        // The comparison stays due, and is made again when the maneuver or the transfer is over, and the vehicle shows a mode of after
        // the last command: it may be entering AUTO.MISSION.
        if context.flight.maneuver || !free || !context.vehicle.state_is_newer_than_command() {
            return false;
        }
        self.compared();
        effects.warn_of_link(format!("{differs}: the loaded one is sent again"));
        true
    }

    fn compared(&mut self) {
        *self = Resync {
            returned: true,
            ..Resync::default()
        };
    }
}
