//! A clearing: of everything, or of one route, which the vehicle may carry or not.

use mavlink_link::service::mission::MavMissionType;
use stanag_msgs::enums::MissionPlanMode as Mode;

use super::{Free, Load, Transfers, Work, cucs_of};
use crate::session::context::Origin;
use crate::session::effects::Effects;
use crate::session::mission::input::Context;
use crate::session::mission::record::UploadedMission;
use crate::session::mission::status::{self, not_received};
use crate::session::mission::store::MissionStore;
use crate::session::mission::upload::{Fault, Upload};

impl Transfers {
    /// Clears everything or one route. Only a route that the vehicle carries needs a request to it.
    pub(super) fn clear(
        &mut self,
        context: &Context<'_>,
        (origin, name): (Origin, String),
        route_id: Option<&str>,
        store: &mut MissionStore,
        free: Free,
        effects: &mut Effects<'_>,
    ) {
        let is_of = |route: &Option<UploadedMission>, id: &str| {
            route.as_ref().is_some_and(|route| route.is_of(id))
        };
        if let Some(id) = route_id.filter(|id| !is_of(&store.uploaded, id)) {
            let known = store.plan().route_named(id).is_some() || is_of(&store.loaded, id);
            let fault = if !known {
                Some(not_received(id))
            } else {
                // The route may be the one being uploaded. A silent vehicle is no obstacle, since nothing is requested of
                // it.
                let busy = self.load.is_some();
                busy.then(|| "another transfer is in progress".to_owned())
            };
            if let Some(why) = fault {
                return status::reject(effects, origin, &name, Mode::Clear, None, why);
            }
            let saved = store.forget_route(id, cucs_of(context, &origin), effects);
            return answer_clear(saved, origin, &name, effects);
        }
        let kind = MavMissionType::MAV_MISSION_TYPE_MISSION;
        let begun = free.map_err(str::to_owned).and_then(|()| {
            Upload::clear(context.mono(), kind, effects.vehicle)
                .map_err(|fault| format!("the mission service is {fault}"))
        });
        match begun {
            Ok(upload) => {
                store.begin_clear();
                self.load = Some(Load {
                    work: Work::Clear {
                        route_id: route_id.map(str::to_owned),
                        upload,
                    },
                    origin: Some(origin),
                    mission_name: name,
                    then: None,
                    blocked: false,
                });
            }
            Err(why) => status::reject(effects, origin, &name, Mode::Clear, None, why),
        }
    }

    /// The vehicle no longer carries a mission.
    pub(super) fn cleared(
        &mut self,
        context: &Context<'_>,
        store: &mut MissionStore,
        effects: &mut Effects<'_>,
    ) {
        if let Some(Load {
            work: Work::Clear { route_id, .. },
            origin: Some(origin),
            mission_name,
            ..
        }) = self.load.take()
        {
            self.ended_early.clear();
            let cucs = cucs_of(context, &origin);
            let saved = store.cleared(route_id.as_deref(), cucs, effects);
            answer_clear(saved, origin, &mission_name, effects);
        }
    }

    pub(super) fn not_cleared(
        &mut self,
        fault: &Fault,
        store: &mut MissionStore,
        effects: &mut Effects<'_>,
    ) {
        if let Some(load) = self.load.take() {
            load.end(None, format!("clear: {}", fault.explain("plan")), effects);
        }
        // The vehicle may or may not have cleared its mission, so no route counts as uploaded.
        store.forget_uploaded(effects);
    }
}

fn answer_clear(
    saved: Result<(), impl std::fmt::Display>,
    origin: Origin,
    name: &str,
    effects: &mut Effects<'_>,
) {
    match saved {
        Ok(()) => status::complete(effects, &origin, name, Mode::Clear),
        Err(fault) => {
            let why = format!("the remaining plan cannot be stored: {fault}");
            status::reject(effects, origin, name, Mode::Clear, None, why);
        }
    }
}
