//! The Mission Transfer Command (13000), and the transfers to the vehicle for it or for a mode command.
//!
//! One load or clearing at a time, and one download. Each is answered by 14000, and refused with the reason.

use std::time::Duration;

use mapping::altitude::Level;
use mapping::mode::Px4Mode;
use mapping::plan::Plan;
use mapping::route::{CompiledMission, Site, stream_permitted};
use mavlink_link::dialect::MissionState;
use mavlink_link::service::command;
use mavlink_link::service::mission::{self, MavMissionType};
use stanag_msgs::Id;
use stanag_msgs::enums::{AckType, FlightPathControlMode, MissionPlanMode as Mode, RouteType};
use stanag_msgs::messages::{MissionTransferCommand, UaRoute, VehicleOperatingModeCommand};

use super::download::{Download, Part};
use super::input::Context;
use super::payload_action;
use super::progress::RouteProgress;
use super::record::UploadedMission;
use super::route_upload::{Outcome, RouteUpload};
use super::status::{self, not_received};
use super::store::MissionStore;
use super::upload::{Fault, Progress, Upload};
use crate::session::context::{Origin, Transfer};
use crate::session::effects::{Effects, Request};

/// The machine.
#[derive(Debug, Default)]
pub(super) struct Transfers {
    load: Option<Load>,
    download: Option<Download>,
}

/// A load or a clearing.
#[derive(Debug)]
struct Load {
    work: Work,
    /// The requesting 13000; `None` if a mode command needs another route.
    origin: Option<Origin>,
    mission_name: String,
    /// Flown once the route is uploaded.
    then: Option<(Option<Origin>, Box<VehicleOperatingModeCommand>)>,
    /// It waits for a maneuver to end.
    blocked: bool,
}

#[expect(clippy::large_enum_variant, reason = "one a vehicle, and rare")]
#[derive(Debug)]
enum Work {
    Load(RouteUpload),
    /// Clears everything, or the route with this name, which the vehicle carries.
    Clear {
        route_id: Option<String>,
        upload: Upload,
    },
}

/// A mode command, with its sender, that waits for the upload of a route of this type or of the loaded one.
pub(super) type WaitingCommand = (
    Option<Origin>,
    Option<RouteType>,
    Box<VehicleOperatingModeCommand>,
);
/// Whether the vehicle's mission store can be changed now, or why not.
pub(super) type Free = Result<(), &'static str>;

/// Checks whether the mission aboard can be replaced or cleared. The vehicle is put on hold for that, or PX4 does so when
/// its mission is gone; on its final approach a fixed wing would circle at its present low height.
fn replaceable(context: &Context<'_>, store: &MissionStore) -> Free {
    let telemetry = &context.vehicle.telemetry;
    let aboard = store.uploaded.as_ref();
    if aboard.is_some_and(|aboard| aboard.is_on_final(telemetry)) {
        return Err(
            "the vehicle is on its final approach: abort the landing first (2016 mode 20, wave-off), or let it end",
        );
    }
    let unknown = context.flight.item_unknown_until;
    if unknown.is_some_and(|until| context.mono() < until) {
        return Err(
            "it is not known yet after a silence whether the vehicle is on its final approach: try again in 5 s",
        );
    }
    Ok(())
}

impl Transfers {
    /// 13000.
    pub(super) fn command(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        command: &MissionTransferCommand,
        store: &mut MissionStore,
        free: Free,
        effects: &mut Effects<'_>,
    ) {
        effects.acknowledge(&origin, AckType::Received);
        let (name, route_id) = (mission_name(command), route_name(command));
        let part = match command.mission_plan_mode {
            Some(Mode::Load) => {
                let free = free.and(replaceable(context, store));
                return self.load(context, origin, command, store, free, effects);
            }
            Some(Mode::Clear) => {
                let free = free.and(replaceable(context, store));
                return self.clear(context, (origin, name), route_id, store, free, effects);
            }
            Some(Mode::Cancel) => return self.cancel(context, (origin, &name), store, effects),
            Some(Mode::Download) => route_id.map_or(Part::All, Part::Route),
            Some(mode @ Mode::DownloadWaypoint) => match command.waypoint_number {
                Some(number) => Part::Waypoint(number),
                None => {
                    let why = "Waypoint Number is missing";
                    return status::reject(effects, origin, &name, mode, None, why);
                }
            },
            Some(mode @ Mode::Unknown(value)) => {
                let why = format!("Mission Plan Mode {value}, expected 1 to 5");
                return status::reject(effects, origin, &name, mode, None, why);
            }
            None => return effects.refuse(Some(origin), "Mission Plan Mode is missing"),
        };
        let (busy, to) = (self.download.is_some(), (origin, name.as_str()));
        if let Some(download) = Download::begin(context, store, to, part, busy, effects) {
            self.download = Some(download);
            self.advance_download(context, effects);
        }
    }

    fn load(
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
            payload_action::may_load(context, cucs, &part).map(|()| found)
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
        }
        status::report(effects, origin.station, &name, 0);
        let upload = RouteUpload::new(context.mono(), &route, route_type, false);
        self.load = Some(Load {
            origin: Some(origin),
            ..Load::of(upload, name)
        });
    }

    /// Clears everything or one route. Only a route that the vehicle carries needs a request to it.
    fn clear(
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

    fn cancel(
        &mut self,
        context: &Context<'_>,
        (origin, name): (Origin, &str),
        store: &mut MissionStore,
        effects: &mut Effects<'_>,
    ) {
        // This also drops the upload, loaded or not: otherwise the next 13000 would load it.
        let sender = (cucs_of(context, &origin), origin.stamp);
        let dropped = store.cancel_upload(context.mono(), sender, effects);
        self.end_load(context, "cancelled", store, effects);
        if let Some(download) = self.download.take() {
            download.cancel(effects);
        }
        match dropped {
            // Also if nothing is in progress: the state that mode 5 requests is then already reached.
            Ok(()) => status::complete(effects, &origin, name, Mode::Cancel),
            Err(why) => status::reject(effects, origin, name, Mode::Cancel, None, why),
        }
    }

    /// Ends a load or a clearing.
    pub(super) fn end_load(
        &mut self,
        context: &Context<'_>,
        why: &str,
        store: &mut MissionStore,
        effects: &mut Effects<'_>,
    ) {
        let Some(mut load) = self.load.take() else {
            return;
        };
        match &mut load.work {
            Work::Load(upload) => {
                if upload.cancel(context.mono(), context.vehicle, effects.vehicle) {
                    store.forget_uploaded(effects);
                }
            }
            Work::Clear { upload, .. } => {
                upload.cancel(effects.vehicle);
                // The vehicle was requested to clear at once, and its answer is not awaited.
                store.forget_uploaded(effects);
            }
        }
        load.end(None, why.to_owned(), effects);
    }

    /// A mode command needs another route uploaded first: the latest of a type, or the one that 13000 loaded.
    pub(super) fn load_and_fly(
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
    pub(super) fn load_again(&mut self, uploaded: &UploadedMission) {
        let upload = RouteUpload::again(uploaded);
        self.load = Some(Load::of(upload, uploaded.mission_name.clone()));
    }

    /// Refuses the mode command that waits for its route: it has not begun, and must not begin later.
    pub(super) fn drop_waiting_command(
        &mut self,
        context: &Context<'_>,
        why: &str,
        without_right: bool,
        effects: &mut Effects<'_>,
    ) {
        let drops = |(origin, _): &mut (Option<Origin>, _)| {
            let sender = |origin: Origin| context.asker(origin.station).map(|asker| asker.id);
            // A command of the VSM itself, such as the loss action, needs no right.
            !without_right || origin.is_some_and(|origin| sender(origin) != context.controller)
        };
        let waiting = self.load.as_mut().map(|load| &mut load.then);
        if let Some((origin, _)) = waiting.and_then(|then| then.take_if(drops)) {
            effects.refuse(origin, why);
        }
    }

    /// Lets a load take its next step.
    pub(super) fn advance(
        &mut self,
        context: &Context<'_>,
        store: &mut MissionStore,
        progress: &mut RouteProgress,
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
            // Checked on the request and again now: a fixed wing may have reached its final approach since.
            if let Err(why) = replaceable(context, store) {
                let outcome = Outcome::Refused {
                    waypoint: None,
                    why: why.to_owned(),
                    touched: false,
                    flaw: false,
                };
                return self.follow(context, outcome, store, progress, effects);
            }
        }
        let held = upload.held;
        let site = site(context);
        let (state, vehicle) = (context.vehicle, &mut *effects.vehicle);
        // A load that no CUCS requested, for a mode command or after the vehicle lost its mission, flies the stored plan
        // and not an upload in progress.
        let plan = if origin.is_some() {
            store.to_load()
        } else {
            store.plan()
        };
        let outcome = upload.advance(now, plan, site.as_ref(), state, vehicle);
        if upload.held && !held {
            effects.advise(
                "the vehicle flies its mission: it is put on hold (mode 12, loiter) while another plan is uploaded",
            );
        }
        self.follow(context, outcome, store, progress, effects);
    }

    /// The end of a command, while the vehicle is put on hold for a load.
    pub(super) fn handle_command(
        &mut self,
        context: &Context<'_>,
        event: &command::Event,
        store: &mut MissionStore,
        progress: &mut RouteProgress,
        effects: &mut Effects<'_>,
    ) {
        if let Some(Load {
            work: Work::Load(upload),
            ..
        }) = &mut self.load
        {
            let outcome = upload.handle_command(context.mono(), event, context.vehicle);
            self.follow(context, outcome, store, progress, effects);
        }
    }

    /// Handles an event of the mission service for a load or a clearing.
    pub(super) fn handle_service(
        &mut self,
        context: &Context<'_>,
        event: &mission::Event,
        store: &mut MissionStore,
        progress: &mut RouteProgress,
        effects: &mut Effects<'_>,
    ) {
        let now = context.mono();
        match self.load.as_mut().map(|load| &mut load.work) {
            Some(Work::Load(upload)) => {
                let outcome = upload.handle_service(now, event, context.vehicle, effects.vehicle);
                self.follow(context, outcome, store, progress, effects);
            }
            Some(Work::Clear { upload, .. }) => {
                match upload.handle(now, event, &[], effects.vehicle) {
                    Progress::Done(_) => self.cleared(context, store, effects),
                    Progress::Failed(fault) => self.not_cleared(&fault, store, effects),
                    Progress::Going | Progress::Percent(_) => {}
                }
            }
            None => {}
        }
    }

    /// The vehicle no longer carries a mission.
    fn cleared(
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
            let cucs = cucs_of(context, &origin);
            let saved = store.cleared(route_id.as_deref(), cucs, effects);
            answer_clear(saved, origin, &mission_name, effects);
        }
    }

    fn not_cleared(&mut self, fault: &Fault, store: &mut MissionStore, effects: &mut Effects<'_>) {
        if let Some(load) = self.load.take() {
            load.end(None, format!("clear: {}", fault.explain("plan")), effects);
        }
        // The vehicle may or may not have cleared its mission, so no route counts as uploaded.
        store.forget_uploaded(effects);
    }

    /// Handles the result of a load.
    fn follow(
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
                    if load.origin.is_some() {
                        store.loaded = None;
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
            advise_where_it_continues(context, compiled, effects);
        }
        // Only 13000 loads a route; a route for a mode is only carried. The loaded route may have been sent again.
        let loaded = store.loaded.as_ref();
        if load.origin.is_some() || loaded.is_some_and(|loaded| is_same(loaded, &uploaded)) {
            store.loaded = Some(uploaded.clone());
        }
        store.uploaded = Some(uploaded);
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

    /// Sends the next few messages of a download.
    pub(super) fn advance_download(&mut self, context: &Context<'_>, effects: &mut Effects<'_>) {
        let ended = |download: &mut Download| download.advance(context, effects);
        self.download.take_if(ended);
    }

    /// Whether a load or a clearing runs.
    pub(super) fn is_running(&self) -> bool {
        self.load.is_some()
    }

    /// The state that other machines may read.
    pub(super) fn view(&self) -> Transfer {
        let Some(load) = &self.load else {
            return Transfer::None;
        };
        let waiting_command = load.then.as_ref().map(|(origin, _)| *origin);
        Transfer::Running {
            owner: load
                .origin
                .or(waiting_command.flatten())
                .map(|origin| origin.station),
            waiting_command,
        }
    }

    /// The mode of the command that waits for its route.
    pub(super) fn waiting_mode(&self) -> Option<FlightPathControlMode> {
        let (_, command) = self.load.as_ref()?.then.as_ref()?;
        command.select_flight_path_control_mode
    }

    /// When a load or a download needs its next step.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        let load = self.load.as_ref().and_then(|load| match &load.work {
            Work::Load(upload) if !load.blocked => upload.poll_timeout(),
            // The end of the maneuver, or of the clearing, is an event.
            Work::Load(_) | Work::Clear { .. } => None,
        });
        let download = self.download.as_ref().map(Download::poll_timeout);
        load.into_iter().chain(download).min()
    }
}

impl Load {
    /// The load of a route without a request by a CUCS.
    fn of(upload: RouteUpload, mission_name: String) -> Load {
        Load {
            work: Work::Load(upload),
            origin: None,
            mission_name,
            then: None,
            blocked: false,
        }
    }

    /// Whether no CUCS requested it: the vehicle had lost its loaded mission.
    fn is_own(&self) -> bool {
        self.origin.is_none() && self.then.is_none()
    }

    /// Whether the vehicle was taken out of its mission for it.
    fn held(&self) -> bool {
        matches!(&self.work, Work::Load(upload) if upload.held)
    }

    /// Answers the requester, and flies the route if a mode was commanded.
    fn done(self, effects: &mut Effects<'_>) {
        if self.then.is_none() && self.held() {
            effects.advise(
                "another plan is uploaded, and the vehicle holds (mode 12, loiter): mode 11 (waypoint) flies it",
            );
        }
        if self.is_own() {
            effects.advise("the loaded plan is uploaded again");
        }
        if let Some(origin) = self.origin {
            status::complete(effects, &origin, &self.mission_name, Mode::Load);
        }
        if let Some((origin, command)) = self.then {
            // The command is checked again; `just_loaded` prevents another load if the plan has changed during the upload.
            effects.request(Request::Fly {
                origin,
                command,
                just_loaded: true,
            });
        }
    }

    /// Answers that it has failed.
    fn end(self, waypoint: Option<u16>, why: String, effects: &mut Effects<'_>) {
        let why = if self.held() {
            format!("{why}; the vehicle was put on hold (mode 12, loiter) for it")
        } else {
            why
        };
        let mode = match self.work {
            Work::Load(_) => Mode::Load,
            Work::Clear { .. } => Mode::Clear,
        };
        if self.is_own() {
            effects.warn_of_link(format!(
                "the vehicle no longer holds the loaded plan: {why}"
            ));
        }
        if let Some((origin, _)) = self.then {
            effects.refuse(origin, why.clone());
        }
        if let Some(origin) = self.origin {
            status::reject(effects, origin, &self.mission_name, mode, waypoint, why);
        }
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

fn without_route(plan: &Plan) -> String {
    if plan.numbers().next().is_none() {
        "no route has been received (13001)".to_owned()
    } else {
        "no route has been received (13001), and the waypoints are not one chain from waypoint 1, so that some may be missing: send \
         the 13001 that names its first waypoint"
            .to_owned()
    }
}

fn mission_name(command: &MissionTransferCommand) -> String {
    let mission_id = command.mission_id.as_ref();
    mission_id.map_or_else(String::new, |id| id.as_str().to_owned())
}

fn route_name(command: &MissionTransferCommand) -> Option<&str> {
    let route_id = command.route_id.as_ref().map(|id| id.as_str());
    route_id.filter(|id| !id.is_empty())
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
    effects: &mut Effects<'_>,
) {
    let telemetry = &context.vehicle.telemetry;
    let mission = telemetry.mission.filter(|mission| {
        telemetry.mode != Some(Px4Mode::MISSION)
            && mission.seq > compiled.place_from(0)
            && mission.state != MissionState::MISSION_STATE_COMPLETE
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

fn cucs_of(context: &Context<'_>, origin: &Origin) -> Id {
    let asker = context.asker(origin.station);
    asker.map_or(Id::NULL, |asker| asker.id)
}

/// Appended to a refusal because of the upload's content.
const DROPPED: &str = "; this upload is discarded: correct it and send the whole route";
