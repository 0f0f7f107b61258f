//! A vehicle that comes back, or has started anew: is the plan that was loaded still aboard?
//!
//! PX4 names its plan by a checksum (MISSION_CURRENT.mission_id). Where it is another than the one that was read back
//! after the load, the loaded plan is sent again, byte for byte, and that is said. Never while the vehicle flies a
//! mission: what is flown is not exchanged under it, but said, and mended once it leaves AUTO.MISSION. After a start of
//! this VSM nothing is sent by itself: somebody may have worked on the vehicle meanwhile; the difference is said.

use mapping::mode::Px4Mode;
use stanag_msgs::enums::AlertPriority;

use super::aircraft::Aircraft;
use super::desk::Desk;
use super::mission_transfer::Load;

/// A comparison that is due.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct PlanCheck {
    /// Whether the vehicle was heard before by this process: it has returned.
    returned: bool,
    due: bool,
    /// That it waits for the end of the mission that is flown has been said.
    told: bool,
}

impl PlanCheck {
    /// The vehicle is heard again, or has started anew; what it says of its mission from now on counts.
    pub(super) fn begin(&mut self) {
        self.due = true;
        self.told = false;
    }
}

impl Aircraft {
    /// The vehicle is heard: for the first time, or again.
    pub(super) fn plan_may_differ(&mut self) {
        self.plan_check.begin();
    }

    /// Compares once the vehicle has told its plan, and does what follows.
    pub(super) fn compare_plan(&mut self, desk: &mut Desk<'_>) {
        if !self.plan_check.due || !self.mav.live() {
            return;
        }
        let Some(mission) = self.mav.telemetry.mission else {
            return;
        };
        let loaded = self.aboard.as_ref().map(|aboard| aboard.mission_id);
        // What has no id cannot be compared, and what is loaded just now is compared at its end.
        let Some(loaded) = loaded.filter(|id| *id != 0) else {
            return self.compared();
        };
        if mission.mission_id == loaded {
            return self.compared();
        }
        let differs = format!(
            "the vehicle holds another plan ({:08x}) than the one loaded ({loaded:08x})",
            mission.mission_id
        );
        if !self.plan_check.returned {
            self.compared();
            let text = format!("{differs}: load it again (13000) before it is flown");
            return self.tell_once(desk, AlertPriority::Warning, text);
        }
        let telemetry = &self.mav.telemetry;
        if telemetry.mode == Some(Px4Mode::MISSION) && telemetry.airborne() {
            if !self.plan_check.told {
                self.plan_check.told = true;
                let text = format!(
                    "{differs}, and flies it: the loaded one is sent again once it leaves AUTO.MISSION"
                );
                self.tell_once(desk, AlertPriority::Warning, text);
            }
            return;
        }
        if self.maneuver.is_some() || self.may_change_mission().is_err() {
            return;
        }
        self.compared();
        self.tell_once(
            desk,
            AlertPriority::Warning,
            format!("{differs}: the loaded one is sent again"),
        );
        let Some(aboard) = &self.aboard else { return };
        self.load = Some(Load::again(aboard));
        self.run_until_idle(desk);
    }

    fn compared(&mut self) {
        self.plan_check = PlanCheck {
            returned: true,
            ..PlanCheck::default()
        };
    }
}
