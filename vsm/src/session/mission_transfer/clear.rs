//! Clearing (13000 mode 1): of the vehicle and all that is stored, or of one route.

use mavlink_link::service::mission::MavMissionType;
use stanag_msgs::Id;
use stanag_msgs::enums::MissionPlanMode as Mode;

use super::{Load, Work, not_received};
use crate::session::aircraft::Aircraft;
use crate::session::desk::{Desk, Origin};
use crate::session::plan_record::UploadedMission;

impl Aircraft {
    /// Everything, or one route: of one that is not aboard the vehicle knows nothing.
    pub(super) fn clear(
        &mut self,
        desk: &mut Desk<'_>,
        origin: Origin,
        name: String,
        route_id: Option<&str>,
    ) {
        if let Some(id) = route_id.filter(|id| !carries(&self.aboard, id)) {
            return self.forget_route(desk, origin, &name, id);
        }
        let begun = self.may_change_mission().and_then(|()| {
            let missions = &mut self.mav.missions;
            missions
                .clear(desk.now.mono, MavMissionType::MAV_MISSION_TYPE_MISSION)
                .map_err(|fault| format!("the mission service is {fault}"))
        });
        if let Err(why) = begun {
            return self.reject(desk, origin, &name, Mode::Clear, None, why);
        }
        self.load = Some(Load {
            work: Work::Clear(route_id.map(str::to_owned)),
            origin: Some(origin),
            mission_name: name,
            then: None,
        });
    }

    /// Clears a route that is not aboard.
    fn forget_route(&mut self, desk: &mut Desk<'_>, origin: Origin, name: &str, id: &str) {
        let loaded_mission = carries(&self.loaded_mission, id);
        let why = if self.plan.route_named(id).is_none() && !loaded_mission {
            Some(not_received(id))
        } else if self.load.is_some() {
            Some("another transfer is in progress".to_owned())
        } else {
            None
        };
        if let Some(why) = why {
            return self.reject(desk, origin, name, Mode::Clear, None, why);
        }
        let before = (self.plan.clone(), self.loaded_mission.clone());
        self.plan.clear_route(id);
        if loaded_mission {
            self.loaded_mission = None;
        }
        if !self.say_cleared(desk, origin, name) {
            (self.plan, self.loaded_mission) = before;
        }
    }

    /// The vehicle holds no plan any more.
    pub(super) fn cleared(&mut self, desk: &mut Desk<'_>) {
        let Some(load) = self.load.take() else { return };
        match &load.work {
            Work::Clear(Some(id)) => {
                self.plan.clear_route(id);
                self.loaded_mission
                    .take_if(|loaded_mission| is_of(loaded_mission, id));
            }
            _ => {
                self.plan.clear();
                self.loaded_mission = None;
            }
        }
        self.aboard = None;
        if let Some(origin) = load.origin {
            self.say_cleared(desk, origin, &load.mission_name);
        }
    }

    /// Stores what a clearing has left, and answers it. False where it cannot be stored.
    fn say_cleared(&mut self, desk: &mut Desk<'_>, origin: Origin, name: &str) -> bool {
        let asker = desk.asker(origin.station);
        let cucs = asker.map_or(Id::NULL, |asker| asker.id);
        let saved = self
            .save_plan(desk, cucs)
            .and_then(|()| self.save_aboard(desk));
        if let Err(fault) = saved {
            let why = format!("what is left cannot be stored: {fault}");
            self.reject(desk, origin, name, Mode::Clear, None, why);
            return false;
        }
        self.complete(desk, &origin, name, Mode::Clear);
        true
    }
}

/// Whether it is the route of this name.
fn is_of(aboard: &UploadedMission, route_id: &str) -> bool {
    aboard.plan.route_named(route_id).is_some()
}

fn carries(aboard: &Option<UploadedMission>, route_id: &str) -> bool {
    aboard
        .as_ref()
        .is_some_and(|aboard| is_of(aboard, route_id))
}
