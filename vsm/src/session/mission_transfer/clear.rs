//! Clearing (13000 mode 1): of the vehicle, and then of all that is stored.

use mavlink_link::service::mission::MavMissionType;
use stanag_msgs::Id;
use stanag_msgs::enums::MissionPlanMode as Mode;

use super::{Load, Work};
use crate::session::aircraft::Aircraft;
use crate::session::desk::{Desk, Origin};

impl Aircraft {
    pub(super) fn clear(&mut self, desk: &mut Desk<'_>, origin: Origin, name: String) {
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
            work: Work::Clear,
            origin: Some(origin),
            mission_name: name,
            then: None,
        });
    }

    /// The vehicle holds no plan any more.
    pub(super) fn cleared(&mut self, desk: &mut Desk<'_>) {
        let Some(load) = self.load.take() else { return };
        self.plan.clear();
        self.aboard = None;
        self.chosen = None;
        let cucs = load
            .origin
            .and_then(|origin| desk.stations.get(origin.station))
            .map(|station| station.id());
        let saved = self
            .save_plan(desk, cucs.unwrap_or(Id::NULL))
            .and_then(|()| self.save_aboard(desk));
        if let Err(fault) = saved {
            let why = format!("the vehicle is cleared, but that cannot be stored: {fault}");
            return self.end_load(desk, load, None, why);
        }
        if let Some(origin) = load.origin {
            self.complete(desk, &origin, &load.mission_name, Mode::Clear);
        }
    }
}
