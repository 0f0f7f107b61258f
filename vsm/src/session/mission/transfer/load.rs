//! A load: which route a 13000 or a mode command loads, its upload, and what is known of the vehicle's mission after it.

use mapping::altitude::Level;
use mapping::mode::Px4Mode;
use mapping::plan::Plan;
use mapping::route::{CompiledMission, Site, stream_permitted};
use stanag_msgs::enums::{MissionPlanMode as Mode, RouteType};
use stanag_msgs::messages::{MissionTransferCommand, UaRoute};

use super::{
    Free, Load, Transfers, WaitingCommand, Work, cucs_of, mission_name, replaceable, route_name,
};
use crate::session::context::Origin;
use crate::session::effects::Effects;
use crate::session::mission::fence::Fence;
use crate::session::mission::input::Context;
use crate::session::mission::payload_action;
use crate::session::mission::progress::RouteProgress;
use crate::session::mission::record::UploadedMission;
use crate::session::mission::route_upload::{Outcome, RouteUpload};
use crate::session::mission::status::{self, not_received};
use crate::session::mission::store::MissionStore;

impl Transfers {
    pub(super) fn load(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        command: &MissionTransferCommand,
        store: &mut MissionStore,
        free: Free,
        effects: &mut Effects<'_>,
    ) {
        let (name, route_id) = (mission_name(command), route_name(command));
        let cucs = cucs_of(context, &origin);
        let of = (cucs, origin.stamp);
        if let Some((_, unfit)) = store.unfit.take_if(|(load, _)| *load == of) {
            if unfit.missing.is_none() && self.load.is_none() {
                store.refuse_upload(context.mono(), of, effects);
            }
            let (mode, waypoint) = (Mode::Load, unfit.missing);
            return status::reject(effects, origin, &name, mode, waypoint, unfit.why);
        }
        let found = route_to_load(store.offered(cucs), route_id);
        let route = found.as_ref().ok().map(|(route, _)| route);
        // Before anything else: an incomplete upload must be refused even if no transfer is possible now.
        if let Err((waypoint, why)) = store.admit_load(cucs, route) {
            if self.load.is_none() {
                store.refuse_upload(context.mono(), (cucs, origin.stamp), effects);
            }
            return status::reject(effects, origin, &name, Mode::Load, waypoint, why);
        }
        let begun = free.map_err(str::to_owned).and(found);
        let begun = begun.map_err(|why| (None, why)).and_then(|found| {
            let part = store.offered(cucs).part(&found.0);
            payload_action::may_load(context, cucs, &part)?;
            is_of_a_route(store.offered(cucs), store.plan()).map(|()| found)
        });
        let (route, route_type) = match begun {
            Ok(found) => found,
            Err((waypoint, why)) => {
                store.load_failed(false, cucs, effects);
                return status::reject(effects, origin, &name, Mode::Load, waypoint, why);
            }
        };
        let flights = store.offered(cucs).routes().iter();
        let flights = flights.filter(|route| mapping::plan::route_type(route) == RouteType::Flight);
        let several = flights.count() > 1;
        let changes = store.upload_of(cucs).1;
        let changes =
            changes.is_some_and(|sent| sent.routes().is_empty() && sent.numbers().next().is_some());
        if let Err(why) = store.begin_load(command, cucs, effects) {
            return status::reject(effects, origin, &name, Mode::Load, None, why);
        }
        if route_id.is_none() && several {
            let named = route.route_id.as_ref().map_or("", |id| id.as_str());
            effects.advise(format!(
                "13000 has no Route ID: the latest of several flight routes, {named:?}, is loaded"
            ));
        }
        if !store.to_load().defines(&route) {
            effects.advise(
                "the waypoints came without a 13001: they are loaded as a route of type flight, from waypoint 1",
            );
        } else if changes {
            effects.advise(
                "the waypoints came without a 13001: they change the routes received before, and make no route of their own",
            );
        }
        status::report(effects, origin.station, &name, 0);
        let upload = RouteUpload::new(context.mono(), &route, route_type, false);
        self.load = Some(Load {
            origin: Some(origin),
            ..Load::of(upload, name)
        });
    }

    /// A mode command needs another route uploaded first: the latest of a type, or the one that 13000 loaded.
    pub(in crate::session::mission) fn load_and_fly(
        &mut self,
        context: &Context<'_>,
        (origin, route_type, command): WaitingCommand,
        store: &MissionStore,
        free: Free,
        effects: &mut Effects<'_>,
    ) {
        if let Err(why) = free.and(replaceable(context, store)) {
            return effects.refuse(origin, why);
        }
        let loaded = store.loaded.as_ref();
        let upload = match route_type {
            Some(route_type) => store
                .plan()
                .route_of_type(route_type)
                .map(|route| RouteUpload::new(context.mono(), route, route_type, true)),
            None => loaded.map(RouteUpload::again),
        };
        let Some(upload) = upload else {
            return effects.refuse(origin, "no such route has been received (13001)");
        };
        let name = loaded.map_or_else(String::new, |loaded| loaded.mission_name.clone());
        self.load = Some(Load {
            then: Some((origin, command)),
            ..Load::of(upload, name)
        });
    }

    /// Uploads the mission that the vehicle has lost, without a request by a CUCS.
    pub(in crate::session::mission) fn load_again(&mut self, uploaded: &UploadedMission) {
        let upload = RouteUpload::again(uploaded);
        self.load = Some(Load::of(upload, uploaded.mission_name.clone()));
    }

    /// Lets a load take its next step. `fence`: within it the vehicle judges the route. `rally_busy`: rally points are being
    /// uploaded.
    pub(in crate::session::mission) fn advance(
        &mut self,
        context: &Context<'_>,
        store: &mut MissionStore,
        progress: &mut RouteProgress,
        (fence, rally_busy): (&Fence, bool),
        effects: &mut Effects<'_>,
    ) {
        let Some(Load {
            work: Work::Load(upload),
            origin,
            blocked,
            ..
        }) = &mut self.load
        else {
            return;
        };
        let now = context.mono();
        *blocked = false;
        // The parameters bound the route.
        if context.parameters.awaits_performance(context) && upload.may_wait(now) {
            return;
        }
        // Wait until a commanded mode is confirmed before uploading another plan: it could be flown at once.
        if context.flight.maneuver && upload.has_not_begun() {
            *blocked = true;
            return;
        }
        if upload.has_not_begun() {
            // The vehicle may be in a mode that was commanded and then given up: another plan would be flown at once. Its
            // next message calls this again; if it is silent, the mission service reports a timeout.
            if context.vehicle.live() && !context.vehicle.state_is_newer_than_command() {
                *blocked = true;
                return;
            }
            // PX4 takes a route that an area forbids which it is sent later, and flies it until it has read that area.
            let bounded = fence.is_aboard(context.vehicle);
            if rally_busy || bounded == Ok(false) {
                *blocked = true;
                return;
            }
            // Checked on the request and again now: a fixed wing may have reached its final approach since.
            let free = replaceable(context, store).map_err(str::to_owned);
            if let Err(why) = bounded.and(free) {
                let outcome = Outcome::Refused {
                    waypoint: None,
                    why,
                    touched: false,
                    flaw: false,
                };
                return self.follow(context, outcome, store, progress, effects);
            }
        }
        if context.flight.maneuver {
            upload.expect_no_reason(context.vehicle);
        }
        let held = upload.held;
        let site = site(context);
        let parts = (context.vehicle, &mut *effects.vehicle);
        // A load that no CUCS requested, for a mode command or after the vehicle lost its mission, flies the stored plan
        // and not an upload in progress.
        let plan = if origin.is_some() {
            store.to_load()
        } else {
            store.plan()
        };
        let outcome = upload.advance(now, plan, site.as_ref(), fence, parts);
        if upload.held && !held {
            effects.advise(
                "the vehicle flies its mission: it is put on hold (mode 12, loiter) while another plan is uploaded",
            );
        }
        self.follow(context, outcome, store, progress, effects);
    }

    /// Handles the result of a load.
    pub(super) fn follow(
        &mut self,
        context: &Context<'_>,
        outcome: Outcome,
        store: &mut MissionStore,
        progress: &mut RouteProgress,
        effects: &mut Effects<'_>,
    ) {
        match outcome {
            Outcome::Going => {}
            Outcome::Percent(percent) => {
                if let Some(load) = &self.load
                    && let Some(origin) = load.origin
                {
                    status::report(effects, origin.station, &load.mission_name, percent);
                }
            }
            Outcome::Done {
                compiled,
                mission_id,
            } => {
                if let Some(Load {
                    work: Work::Load(upload),
                    ..
                }) = &mut self.load
                {
                    let uploaded = UploadedMission {
                        compiled,
                        mission_id,
                        route_type: upload.route_type,
                        mission_name: String::new(),
                        plan: std::mem::take(&mut upload.plan),
                    };
                    self.uploaded(context, uploaded, store, progress, effects);
                }
            }
            Outcome::Refused {
                waypoint,
                mut why,
                touched,
                flaw,
            } => {
                let Some(load) = self.load.take() else { return };
                if let Some(origin) = &load.origin {
                    let cucs = cucs_of(context, origin);
                    if flaw {
                        store.refuse_upload(context.mono(), (cucs, origin.stamp), effects);
                        why += DROPPED;
                    } else {
                        store.load_failed(true, cucs, effects);
                    }
                }
                if touched {
                    // A 13000 was to replace the loaded route. A load for a mode keeps it, so that it can be uploaded again.
                    if load.origin.is_some() && store.loaded.take().is_some() {
                        why += REPLACED;
                    }
                    if let Work::Load(upload) = &load.work {
                        self.note_ended_early(upload.mission_id, store);
                    }
                    store.forget_uploaded(effects);
                }
                load.end(waypoint, why, effects);
            }
        }
    }

    /// The vehicle carries a route and reports it as its mission.
    fn uploaded(
        &mut self,
        context: &Context<'_>,
        mut uploaded: UploadedMission,
        store: &mut MissionStore,
        progress: &mut RouteProgress,
        effects: &mut Effects<'_>,
    ) {
        let Some(load) = self.load.take() else { return };
        self.ended_early.clear();
        uploaded.mission_name.clone_from(&load.mission_name);
        let compiled = &uploaded.compiled;
        let above_home = |level: Level| matches!(level, Level::AboveHome(_));
        if compiled.order.iter().any(|leg| above_home(leg.level)) {
            effects.advise_agl();
        }
        for note in &compiled.notes {
            effects.advise(note);
        }
        if !compiled.streamed.is_empty()
            && let Err(why) = stream_permitted(context.parameters.values)
        {
            effects.advise(format!("curves are flown as chords, not streamed: {why}"));
        }
        // PX4 ignores an upload of the plan that it already holds, so the progress along the same items stays valid.
        let before = store.uploaded.as_ref();
        if before.is_none_or(|before| before.compiled.items != compiled.items) {
            progress.begin(&context.vehicle.telemetry);
        } else if load.origin.is_some() {
            advise_where_it_continues(context, compiled, progress, effects);
        }
        // Only 13000 loads a route; a route for a mode is only carried. The loaded route may have been sent again.
        let loaded = store.loaded.as_ref();
        if load.origin.is_some() || loaded.is_some_and(|loaded| is_same(loaded, &uploaded)) {
            store.loaded = Some(uploaded.clone());
        }
        store.uploaded = Some(uploaded);
        store.ended = progress.has_ended();
        // A route that is answered as loaded, and its plan, must still be known after a crash.
        let cucs = load.origin.map(|origin| cucs_of(context, &origin));
        let saved = store.save_uploaded(effects).and_then(|()| {
            let stored = |cucs| store.upload_loaded(cucs, effects);
            cucs.map_or(Ok(()), stored)
        });
        if let Err(fault) = saved {
            if let Some(cucs) = cucs {
                store.load_failed(true, cucs, effects);
            }
            let why = format!("the route is uploaded, but cannot be stored: {fault}");
            return load.end(None, why, effects);
        }
        load.done(effects);
    }
}

/// Selects the route to load: the named one, otherwise the latest flight route, otherwise the latest of all, otherwise a
/// flight route of the waypoints without a 13001, from waypoint 1.
fn route_to_load(plan: &Plan, route_id: Option<&str>) -> Result<(UaRoute, RouteType), String> {
    let route = match route_id {
        Some(id) => plan
            .route_named(id)
            .cloned()
            .ok_or_else(|| not_received(id))?,
        None => plan
            .route_of_type(RouteType::Flight)
            .or_else(|| plan.routes().last())
            .cloned()
            .or_else(|| plan.route_of_waypoints())
            .ok_or_else(|| without_route(plan))?,
    };
    let route_type = mapping::plan::route_type(&route);
    Ok((route, route_type))
}

/// Checks that an upload has changed a route, if it has changed waypoints: where its 13001 was lost, the 13000 would load an
/// earlier route in place of the one that was sent.
///
/// # Errors
/// None of its waypoints is in a route: the first of them, and why.
fn is_of_a_route(offered: &Plan, stored: &Plan) -> Result<(), (Option<u16>, String)> {
    let changed = |number: &u16| offered.waypoint(*number) != stored.waypoint(*number);
    let changed: Vec<u16> = offered.numbers().filter(changed).collect();
    let [first, ..] = changed.as_slice() else {
        return Ok(());
    };
    // With a 13001 it is that route which has to be whole.
    if offered.routes() != stored.routes() {
        return Ok(());
    }
    let implied = offered.route_of_waypoints();
    let mut routes = offered.routes().iter().chain(&implied);
    let in_a_route = routes.any(|route| {
        let part = offered.part(route);
        changed
            .iter()
            .any(|number| part.waypoint(*number).is_some())
    });
    if in_a_route {
        return Ok(());
    }
    let why = format!(
        "waypoint {first} is in no route, and no other that was sent with it: send the whole route, with its 13001, then 13000"
    );
    Err((Some(*first), why))
}

fn without_route(plan: &Plan) -> String {
    if plan.numbers().next().is_none() {
        "no route has been received (13001)".to_owned()
    } else {
        "no route has been received (13001), and the waypoints are not one chain from waypoint 1, so that some may be missing: send \
         the 13001 that names its first waypoint"
            .to_owned()
    }
}

/// The vehicle's reported position and capabilities; `None` before it has reported its home.
fn site<'a>(context: &Context<'a>) -> Option<Site<'a>> {
    let telemetry = &context.vehicle.telemetry;
    Some(Site {
        home: telemetry.home?,
        geoid_m: telemetry.geoid_m,
        agl: context.bounds.agl,
        terrain: context.bounds.terrain.as_deref(),
        altimeter: context.flight.altimeter,
        wings: context.parameters.wings(context),
        limits: context.parameters.limits(context),
        performance: context.parameters.route_performance(context),
        curving: context.parameters.curving(context),
    })
}

/// PX4 ignores an upload of the plan that it already holds, so the flown part is not flown again: notifies the operator.
fn advise_where_it_continues(
    context: &Context<'_>,
    compiled: &CompiledMission,
    progress: &RouteProgress,
    effects: &mut Effects<'_>,
) {
    let telemetry = &context.vehicle.telemetry;
    let mission = telemetry.mission.filter(|mission| {
        telemetry.mode != Some(Px4Mode::MISSION)
            && mission.seq > compiled.place_from(0)
            && !progress.is_over(compiled, telemetry)
    });
    let Some(mission) = mission else { return };
    let number = compiled.waypoint_of.get(usize::from(mission.seq));
    // At the end of a fixed wing's route, and in its landing pattern, the route restarts from its beginning.
    if let Some(number) = number.filter(|number| **number != 0) {
        effects.advise(format!(
            "the vehicle already holds this plan: mode 11 (waypoint) continues to waypoint {number}, unless another is commanded"
        ));
    }
}

/// Whether the vehicle carries what was loaded before, as it was.
fn is_same(loaded: &UploadedMission, uploaded: &UploadedMission) -> bool {
    loaded.route_type == uploaded.route_type && loaded.compiled.items == uploaded.compiled.items
}

/// Appended to a refusal after which the route that was loaded before is not flown.
const REPLACED: &str = "; mode 11 (waypoint) flies no route before the next load";
/// Appended to a refusal because of the upload's content.
const DROPPED: &str = "; this upload is discarded: correct it and send the whole route";
