//! Checks whether the vehicle still carries the loaded mission: after a lost link or a restart of the vehicle, and whenever it reports
//! another one, which another station has sent it.
//!
//! PX4 identifies its mission by a checksum (MISSION_CURRENT.mission_id). If it differs from the one read back after the
//! load, the loaded mission is sent again, byte for byte, with a warning. A mission is never replaced while the vehicle
//! flies it: there is a warning, and the loaded one is sent once the vehicle leaves AUTO.MISSION. After a start of this VSM
//! there is only a warning and nothing is sent without a command: another station may have changed the mission meanwhile. The same holds
//! for a mission that changes while the link is up: another station has changed it, so it is left, over a lost link too.

use mapping::mode::Px4Mode;

use super::input::Context;
use super::record::UploadedMission;
use crate::session::effects::Effects;

/// A comparison that is due.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Resync {
    /// Whether this process has compared before, so that the vehicle has returned.
    returned: bool,
    due: bool,
    /// Whether the warning was sent that the end of the mission is awaited.
    warned: bool,
    /// The loaded one, since the vehicle has reported it.
    shown: Option<u32>,
    foreign: Option<Foreign>,
}

/// What another station has put in the place of the loaded mission while the link was up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Foreign {
    loaded: u32,
    mission_id: u32,
    /// The vehicle was seen to fly it.
    flown: bool,
}

impl Resync {
    /// The link is up again or the vehicle has restarted: only later reports of its mission count.
    pub(super) fn begin(&mut self) {
        self.due = true;
        self.warned = false;
    }

    /// Compares once the vehicle has reported its mission. Returns true if the loaded one must be sent again. `free`:
    /// whether that can begin now; `transferring`: whether another one is being sent from here.
    pub(super) fn compare(
        &mut self,
        context: &Context<'_>,
        uploaded: Option<&UploadedMission>,
        (free, transferring): (bool, bool),
        effects: &mut Effects<'_>,
    ) -> bool {
        if !context.vehicle.live() {
            return false;
        }
        let telemetry = &context.vehicle.telemetry;
        let Some(mission) = telemetry.mission else {
            return false;
        };
        let loaded = uploaded.map_or(0, |uploaded| uploaded.mission_id);
        let flies = telemetry.mode == Some(Px4Mode::MISSION) && !telemetry.stands();
        if !self.due {
            if loaded != 0 && mission.mission_id == loaded {
                (self.shown, self.foreign) = (Some(loaded), None);
            } else if !transferring && self.shown == Some(loaded) {
                let one = Foreign {
                    loaded,
                    mission_id: mission.mission_id,
                    flown: flies,
                };
                self.name(one, effects);
            }
            return false;
        }
        let known = |one: Foreign| one.loaded == loaded && one.mission_id == mission.mission_id;
        if self.foreign.is_some_and(known) {
            self.compared();
            return false;
        }
        // A mission without id cannot be compared; a mission being loaded is compared at the end of the load.
        if loaded == 0 || mission.mission_id == loaded {
            self.compared();
            return false;
        }
        let differs = format!(
            "the vehicle holds another plan ({:08x}) than the one loaded ({loaded:08x})",
            mission.mission_id
        );
        // The first comparison after a start of this VSM: another station may have changed the mission on purpose.
        if !self.returned {
            self.compared();
            effects.warn_of_link(format!(
                "{differs}: load it again (13000) before it is flown"
            ));
            return false;
        }
        // PX4 would fly the new plan at once, from the index that it has reached in the present one.
        if flies {
            if !self.warned {
                // Warn once: the comparison stays due and is repeated until the vehicle leaves the mode.
                self.warned = true;
                effects.warn_of_link(format!(
                    "{differs}, and flies it: the loaded one is sent again once it leaves AUTO.MISSION"
                ));
            }
            return false;
        }
        // The comparison stays due until the maneuver or transfer has ended and the vehicle has reported a mode after the
        // last command: it may be entering AUTO.MISSION.
        if context.flight.maneuver || !free || !context.vehicle.state_is_newer_than_command() {
            return false;
        }
        self.compared();
        effects.warn_of_link(format!("{differs}: the loaded one is sent again"));
        true
    }

    /// Names a mission of another station: as it comes, and as the vehicle begins to fly it.
    fn name(&mut self, one: Foreign, effects: &mut Effects<'_>) {
        let before = self
            .foreign
            .filter(|before| before.mission_id == one.mission_id);
        if before.is_some_and(|before| before.flown || !one.flown) {
            return;
        }
        self.foreign = Some(one);
        let loaded = one.loaded;
        let holds = match one.mission_id {
            0 => format!("the vehicle holds no plan any more, {loaded:08x} was loaded"),
            other => format!(
                "the vehicle holds another plan ({other:08x}) than the one loaded ({loaded:08x})"
            ),
        };
        let follows = if one.flown {
            "and it flies that now"
        } else {
            "load it again (13000) before it is flown"
        };
        effects.warn_of_link(format!(
            "{holds}: another station has changed it, {follows}"
        ));
    }

    fn compared(&mut self) {
        *self = Resync {
            returned: true,
            shown: self.shown,
            foreign: self.foreign,
            ..Resync::default()
        };
    }
}
