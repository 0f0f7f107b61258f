//! The geofence of one vehicle: areas of the configuration and of a CUCS (50016, 50017), uploaded, read back and compared;
//! 50018 reports the result.
//!
//! Areas of the configuration are always part of the fence. No route is sent before the vehicle holds the areas that it should: it
//! would take one that they forbid, and report that only once it has them.
//!
//! Before any area is sent, it is stored that the vehicle may hold areas of this VSM, as with rally points. So what a restart in
//! the middle of an upload leaves aboard is replaced after it, or cleared where no area is left.
//!
//! PX4 leaves out an area that home breaches as it reads its fence, or the vehicle in the air, and reads a fence again only once its
//! id is another. None is uploaded with such an area, since the rest would be reported as the whole.

use std::time::Duration;

use mapping::area::{self, Area, AreaError, Areas, FencePoint, Holder};
use mapping::route::CompiledMission;
use mapping::telemetry::Place;
use mavlink_link::dialect::MissionState;
use mavlink_link::service::mission::{self, Item, MavMissionType, plan_id};
use mavlink_link::store::{Store as _, StoreError};
use serde::{Deserialize, Serialize};
use stanag_msgs::enums::{AckType, AreaPlanMode as Mode, MissionTransferStatus};
use stanag_msgs::messages::{AreaTransferCommand, AreaTransferStatus, AreaVertex};
use stanag_msgs::{Id, Message};

use super::input::Context;
use super::kept::{Kept, Seen};
use super::record::{UploadedMission, decode_messages, encode_messages};
use super::upload::{Fault, Progress, Upload};
use crate::session::alerts::Cause;
use crate::session::context::Origin;
use crate::session::effects::{Effects, Request};
use crate::session::link::state::VehicleState;
use crate::session::store::{record_fault, vehicle_record};

/// The machine.
#[derive(Debug)]
pub(super) struct Fence {
    configured: Vec<Area>,
    /// The areas as received from a CUCS.
    sent: Areas,
    /// The areas that were last loaded.
    loaded: Areas,
    kept: Kept,
    /// Whether the record on disk says that the vehicle may hold areas of this VSM.
    stored_wanted: bool,
    /// When the vehicle has read the items that were uploaded last.
    read_at: Option<Duration>,
    /// The id and the waypoints of the route that was last reported as infeasible within these areas.
    reported: Option<(u32, Vec<u16>)>,
    /// The id and the places of the route whose legs were last compared with these areas.
    compared: Option<(u32, Vec<(i32, i32)>)>,
    /// Why the vehicle does not hold the areas that it should, since the last attempt.
    fault: Option<String>,
    work: Option<Work>,
}

#[derive(Debug)]
struct Work {
    requester: Requester,
    /// Whether the vehicle could already hold areas of this VSM before this upload.
    wanted_before: bool,
    areas: Areas,
    points: Vec<FencePoint>,
    upload: Upload,
}

/// The requesting message; `None` if the VSM started the upload itself.
type Requester = Option<(Origin, Mode)>;
/// An area and its vertex, for 50018.
type Vertex = (u16, u8);

#[derive(Serialize, Deserialize)]
struct Record {
    sent: Vec<String>,
    loaded: Vec<String>,
    wanted: bool,
}

vehicle_record!(Record, "areas", Process);

impl Fence {
    /// The areas of the configuration have changed: they are uploaded as soon as possible.
    pub(super) fn set_configured(&mut self, configured: Vec<Area>, now: Duration) {
        self.configured = configured;
        self.reported = None;
        self.compared = None;
        self.fault = None;
        self.kept.change(now);
    }

    /// With the areas of the configuration.
    pub(super) fn new(configured: Vec<Area>) -> Fence {
        Fence {
            kept: Kept::new(KIND, !configured.is_empty()),
            configured,
            sent: Areas::default(),
            loaded: Areas::default(),
            stored_wanted: false,
            read_at: None,
            reported: None,
            compared: None,
            fault: None,
            work: None,
        }
    }

    /// The areas that CUCSs have sent, loaded or not.
    pub(super) fn sent(&self) -> &Areas {
        &self.sent
    }

    /// The areas of the configuration and those that were last loaded.
    pub(super) fn areas(&self) -> (&[Area], &Areas) {
        (&self.configured, &self.loaded)
    }

    /// The id under which the vehicle was read back to hold them.
    pub(super) fn id(&self) -> Option<u32> {
        self.kept.id().filter(|_| !self.busy())
    }

    /// When the vehicle has read the fence that was uploaded last; `None` if this process has uploaded none. Only then has it
    /// judged its mission against it, although it reports the fence's id at once.
    pub(super) fn read_at(&self) -> Option<Duration> {
        self.read_at
    }

    /// The first item of a route that breaches it, as an index.
    pub(super) fn first_breach(&self, compiled: &CompiledMission) -> Option<usize> {
        area::first_breach(&self.loaded.with(&self.configured), &compiled.items)
    }

    /// Whether the vehicle holds the areas that it should, so that it judges a route within them; false while they are
    /// compared or uploaded.
    ///
    /// # Errors
    /// They could not be uploaded, for the operator.
    pub(super) fn is_aboard(&self, vehicle: &VehicleState) -> Result<bool, String> {
        if self.busy() {
            return Ok(false);
        }
        if !self.is_due() {
            return Ok(true);
        }
        let silent = (!vehicle.live()).then_some("no data from the vehicle");
        match self.fault.as_deref().or(silent) {
            Some(why) => Err(format!(
                "the vehicle is not known to hold its fence, within which it has to judge the route: {why}"
            )),
            None => Ok(false),
        }
    }

    /// Why the vehicle does not hold the areas that it should, since the last attempt; also while they are sent once more. `None` while
    /// they are compared or sent for the first time.
    pub(super) fn failed(&self) -> Option<&str> {
        self.fault.as_deref().filter(|_| self.is_due())
    }

    /// Whether the vehicle is not known to hold areas that it should.
    fn is_due(&self) -> bool {
        // What is left to be cleared forbids more than it should, never less.
        let none = !self.kept.wanted || self.configured.is_empty() && self.loaded.is_empty();
        !none && self.kept.id().is_none()
    }

    /// The bridge did not run for so long.
    pub(super) fn postpone(&mut self, stopped: Duration) {
        if let Some(work) = &mut self.work {
            work.upload.postpone(stopped);
        }
    }

    /// Whether a fence is being uploaded.
    pub(super) fn busy(&self) -> bool {
        self.work.is_some()
    }

    /// Whether a fence is being uploaded that no CUCS has requested.
    pub(super) fn is_sent_unasked(&self) -> bool {
        self.work
            .as_ref()
            .is_some_and(|work| work.requester.is_none())
    }

    /// The vehicle's link is up, for the first time or again: its fence is compared once it has had time to report it.
    pub(super) fn look_again(&mut self, now: Duration) {
        self.fault = None;
        self.kept.look_again(now);
        // It may have restarted: it judges its mission once it has read its fence again.
        let aboard = self
            .points(&self.loaded, &Holder::default())
            .unwrap_or_default();
        let judged = now + judged_after(&aboard);
        self.read_at = self.read_at.map(|at| at.max(judged));
    }

    /// When [`Fence::watch`] is next due.
    pub(super) fn poll_timeout(&self) -> Option<Duration> {
        let upload = self.work.as_ref().map(|work| &work.upload);
        self.kept.poll_timeout(upload)
    }

    /// 50016: stored at once, uploaded by 50017.
    pub(super) fn store_area(
        &mut self,
        origin: Origin,
        vertex: &AreaVertex,
        effects: &mut Effects<'_>,
    ) {
        let before = self.sent.clone();
        let stored = self.sent.store(vertex).map_err(|fault| fault.to_string());
        // On disk before 17000: what is acknowledged must survive a restart.
        let stored = stored.and_then(|()| {
            self.save(effects)
                .map_err(|fault| format!("it cannot be stored: {fault}"))
        });
        match stored {
            Ok(()) => effects.acknowledge(&origin, AckType::CarriedOut),
            Err(why) => {
                self.sent = before;
                effects.refuse(Some(origin), why);
            }
        }
    }

    /// 50017. `free`: why no upload can begin now.
    pub(super) fn command(
        &mut self,
        context: &Context<'_>,
        origin: Origin,
        command: &AreaTransferCommand,
        free: Result<(), &'static str>,
        effects: &mut Effects<'_>,
    ) {
        effects.acknowledge(&origin, AckType::Received);
        let Some(mode) = command.area_plan_mode else {
            return effects.refuse(Some(origin), "Area Plan Mode is missing");
        };
        let none = AreaError {
            area: 0,
            configured: None,
            vertex: None,
            reason: area::Reason::None,
        };
        let (areas, points) = match mode {
            Mode::Load | Mode::Download if self.sent.is_empty() => (Areas::default(), Err(none)),
            Mode::Load => {
                let holder = self.holder(context.vehicle);
                (self.sent.clone(), self.points(&self.sent, &holder))
            }
            // A CUCS can clear only its own areas: those of the configuration are uploaded again without them.
            Mode::Clear => {
                let holder = self.holder(context.vehicle);
                let none = Areas::default();
                let points = self.points(&none, &holder);
                (none, points)
            }
            Mode::Download => return self.download(context, origin, effects),
            Mode::Unknown(value) => {
                let why = format!("Area Plan Mode {value}, expected 1 to 3");
                return effects.refuse(Some(origin), why);
            }
        };
        let requester = Some((origin, mode));
        match points {
            Ok(points) => self.begin(context, requester, areas, points, free, effects),
            Err(fault) => {
                let vertex = (fault.area, fault.vertex.unwrap_or(0));
                self.end(context, requester, Some(vertex), fault.to_string(), effects);
            }
        }
    }

    /// Sends the areas of CUCSs that were loaded last: what was sent since, or was not loaded, does not bound the vehicle.
    fn download(&self, context: &Context<'_>, origin: Origin, effects: &mut Effects<'_>) {
        let mode = Mode::Download;
        if self.loaded.is_empty() {
            report(
                effects,
                origin.station,
                mode,
                MissionTransferStatus::Aborted,
                None,
            );
            return effects.refuse(Some(origin), NONE_LOADED);
        }
        if self.sent != self.loaded {
            effects.advise("areas were sent (50016) and not loaded: the download shows those that were loaded last");
        }
        let id = self
            .points(&self.loaded, &Holder::default())
            .map(|points| plan_id(&items(&points)));
        if id.ok() != self.kept.named(context) {
            effects.advise("the vehicle does not report the areas of this download as its fence");
        }
        let mut answers: Vec<Message> = self.loaded.messages().collect();
        answers.push(status(mode, MissionTransferStatus::Complete, None).into());
        effects.request(Request::AnswerLater {
            station: origin.station,
            answers,
            origin: Some(origin),
        });
    }

    fn points(&self, areas: &Areas, holder: &Holder) -> Result<Vec<FencePoint>, AreaError> {
        area::fence(&self.configured, &areas.whole()?, holder)
    }

    fn holder(&self, vehicle: &VehicleState) -> Holder {
        let at = |place: Place| (place.latitude, place.longitude);
        Holder {
            position: vehicle.telemetry.position.map(at),
            home: vehicle.telemetry.home.map(at),
            // PX4 before v1.15 has no ids.
            unites: !self.configured.is_empty() && self.kept.id() == Some(0),
        }
    }

    fn begin(
        &mut self,
        context: &Context<'_>,
        requester: Requester,
        areas: Areas,
        points: Vec<FencePoint>,
        free: Result<(), &'static str>,
        effects: &mut Effects<'_>,
    ) {
        let (now, wanted_before) = (context.mono(), self.kept.wanted);
        let begun = free
            .map_err(str::to_owned)
            .and_then(|()| self.store_wanted(effects))
            .and_then(|()| self.kept.send(now, &items(&points), effects.vehicle));
        match begun {
            Ok(upload) => {
                if let Some((origin, mode)) = requester {
                    let running = MissionTransferStatus::InProgress;
                    report(effects, origin.station, mode, running, None);
                }
                self.work = Some(Work {
                    requester,
                    wanted_before,
                    areas,
                    points,
                    upload,
                });
            }
            Err(why) => self.end(context, requester, None, why, effects),
        }
    }

    /// Handles an event of the mission service. Returns false if it is not about the fence.
    pub(super) fn handle_service(
        &mut self,
        context: &Context<'_>,
        event: &mission::Event,
        effects: &mut Effects<'_>,
    ) -> bool {
        let Some(work) = &mut self.work else {
            return false;
        };
        let items = items(&work.points);
        let progress = work
            .upload
            .handle(context.mono(), event, &items, effects.vehicle);
        self.follow(context, progress, effects);
        true
    }

    /// Checks that MISSION_CURRENT names the fence that was read back, and still does later. `free`: why no upload can begin
    /// now.
    pub(super) fn watch(
        &mut self,
        context: &Context<'_>,
        free: Result<(), &'static str>,
        effects: &mut Effects<'_>,
    ) {
        if let Some(work) = &self.work {
            // MISSION_CURRENT.mission_state is about the mission: for a fence its id alone can be checked.
            let named = self.kept.named(context);
            let progress = work.upload.check(context.mono(), named, true);
            if progress != Progress::Going {
                return self.follow(context, progress, effects);
            }
        }
        match self.kept.look(context, free.is_ok()) {
            Seen::Nothing => {}
            Seen::Due => {
                let areas = self.loaded.clone();
                // What is aboard has been read already, wherever the vehicle and its home are now.
                let is_aboard = self
                    .points(&areas, &Holder::default())
                    .is_ok_and(|points| self.kept.holds(context, &items(&points)));
                if is_aboard {
                    // The record may be new, with areas that were sent before it.
                    if let Err(why) = self.store_wanted(effects) {
                        effects.advise(format!("fence: {why}"));
                    }
                    return;
                }
                match self.points(&areas, &self.holder(context.vehicle)) {
                    Ok(points) => self.begin(context, None, areas, points, free, effects),
                    Err(fault) => {
                        let why = format!("{fault}; {}", cure(&fault));
                        self.end(context, None, None, why, effects);
                    }
                }
            }
            Seen::Other => {
                let text = "the vehicle's fence is not the loaded one: load it again (50017)";
                effects.warn(Cause::Fence, text);
            }
            Seen::Same => effects.clear(Cause::Fence, UPLOADED),
        }
    }

    /// Whether the vehicle would fly the route aboard within the fence that was uploaded last: PX4 flies none that it finds
    /// infeasible, and reports that by MISSION_CURRENT alone.
    pub(super) fn watch_route(
        &mut self,
        context: &Context<'_>,
        route: Option<&UploadedMission>,
        effects: &mut Effects<'_>,
    ) {
        self.watch_legs(route, effects);
        match (self.finds_infeasible(context.vehicle, route), route) {
            (Some(true), Some(route)) => {
                let numbers = &route.compiled.waypoint_of;
                let is_reported = self
                    .reported
                    .as_ref()
                    .is_some_and(|(id, reported)| *id == route.mission_id && reported == numbers);
                // This runs at every datagram: the route is compared with the areas only where either has changed.
                if !is_reported {
                    let breach = route.breach_of(&self.loaded.with(&self.configured));
                    effects.warn(Cause::Infeasible, route.infeasible(breach));
                    self.reported = Some((route.mission_id, numbers.clone()));
                }
            }
            (Some(_), _) => {
                self.reported = None;
                let text = "the vehicle finds no route aboard infeasible any more";
                effects.clear(Cause::Infeasible, text);
            }
            (None, _) => {}
        }
    }

    /// Whether a leg of the route aboard crosses an area: PX4 takes such a route, and breaks it off at the area. No reason to refuse
    /// it: the way that is flown is not known to a turn, and an area may be one that the vehicle is to pass.
    fn watch_legs(&mut self, route: Option<&UploadedMission>, effects: &mut Effects<'_>) {
        let none = self.configured.is_empty() && self.loaded.is_empty();
        let Some(route) = route.filter(|_| !none) else {
            self.compared = None;
            return effects.clear(Cause::LegAcross, NO_LEG);
        };
        let places = || route.compiled.items.iter().map(|item| (item.x, item.y));
        // Compared by their places too: a vehicle without mission ids reports 0 for every route.
        let is_compared = self.compared.as_ref().is_some_and(|(id, compared)| {
            *id == route.mission_id && compared.iter().copied().eq(places())
        });
        if is_compared {
            return;
        }
        self.compared = Some((route.mission_id, places().collect()));
        let areas = self.loaded.numbered_with(&self.configured);
        match route.leg_across(&areas) {
            Some(leg) => effects.warn(
                Cause::LegAcross,
                format!(
                    "the route aboard: {leg}; the vehicle compares only waypoints with its fence, begins the route, and acts on the \
                     breach in flight (GF_ACTION): load another route (13000), or other areas (50017)"
                ),
            ),
            None => effects.clear(Cause::LegAcross, NO_LEG),
        }
    }

    /// Whether the vehicle finds the route aboard infeasible within the fence that was uploaded last; `None` before it has judged it.
    pub(super) fn finds_infeasible(
        &self,
        vehicle: &VehicleState,
        route: Option<&UploadedMission>,
    ) -> Option<bool> {
        let is_judged = self
            .read_at
            .is_some_and(|at| vehicle.progress_at() >= Some(at));
        // After a restart of its own the vehicle judges its mission once it has a home and a position.
        let is_placed = vehicle
            .telemetry
            .home
            .and(vehicle.telemetry.position)
            .is_some();
        let mission = vehicle
            .telemetry
            .mission
            .filter(|_| is_judged && is_placed)?;
        let is_aboard = route.is_some_and(|route| route.mission_id == mission.mission_id);
        let is_infeasible =
            mission.total.is_some() && mission.state == MissionState::MISSION_STATE_NO_MISSION;
        Some(is_aboard && is_infeasible)
    }

    fn follow(&mut self, context: &Context<'_>, progress: Progress, effects: &mut Effects<'_>) {
        match progress {
            Progress::Going | Progress::Percent(_) => {}
            Progress::Done(id) => {
                if let Some(work) = self.work.take() {
                    self.uploaded(context, work, id, effects);
                }
            }
            Progress::Failed(fault) => {
                if let Some(work) = self.work.take() {
                    if work.upload.touched() {
                        // It may hold these areas, or none: what it should hold is compared, and sent or cleared.
                        self.kept.try_again(context.mono());
                        self.fault = Some(fault.explain("fence"));
                    } else if !work.wanted_before {
                        // The vehicle's own areas, if any, are left alone.
                        self.kept.wanted = false;
                        if let Err(fault) = self.save(effects) {
                            effects.advise(format!("fence: {NOT_STORED}: {fault}"));
                        }
                    }
                    let vertex = vertex_of(&work.points, &fault);
                    self.end(
                        context,
                        work.requester,
                        vertex,
                        fault.explain("fence"),
                        effects,
                    );
                }
            }
        }
    }

    fn uploaded(&mut self, context: &Context<'_>, work: Work, id: u32, effects: &mut Effects<'_>) {
        let requester = work.requester;
        self.loaded = work.areas;
        self.reported = None;
        self.compared = None;
        // The configuration may have changed since it was sent: what is aboard and no longer configured has yet to be cleared.
        let aboard = !work.points.is_empty();
        self.kept.wanted = aboard || !self.configured.is_empty();
        self.kept.uploaded(id);
        // A change of the configuration meanwhile has taken the fault, and is still due.
        if self.fault.take().is_some() {
            self.kept.drop_retry();
        }
        self.read_at = Some(context.mono() + judged_after(&work.points));
        // Only after the vehicle has cleared its fence: a failed clearing leaves the areas unchanged.
        if let Some((_, Mode::Clear)) = requester {
            self.sent.clear();
        }
        effects.clear(Cause::Fence, UPLOADED);
        // Store before the answer: a fence reported as complete must be known after a restart.
        if let Err(fault) = self.save(effects) {
            let why = format!("the fence is uploaded, but cannot be stored: {fault}");
            return self.end(context, requester, None, why, effects);
        }
        if aboard {
            advise_breach(context, effects);
        }
        if let Some((origin, mode)) = requester {
            let complete = MissionTransferStatus::Complete;
            report(effects, origin.station, mode, complete, None);
            effects.acknowledge(&origin, AckType::CarriedOut);
        }
    }

    fn end(
        &mut self,
        context: &Context<'_>,
        requester: Requester,
        vertex: Option<Vertex>,
        why: String,
        effects: &mut Effects<'_>,
    ) {
        match requester {
            Some((origin, mode)) => {
                let aborted = MissionTransferStatus::Aborted;
                report(effects, origin.station, mode, aborted, vertex);
                effects.refuse(Some(origin), why);
            }
            None => {
                // The vehicle flies without a fence that it should have.
                self.kept.try_again(context.mono());
                effects.warn(Cause::Fence, format!("the fence is not uploaded: {why}"));
                self.fault = Some(why);
            }
        }
    }

    /// Stores that the vehicle may hold areas of this VSM.
    fn store_wanted(&mut self, effects: &mut Effects<'_>) -> Result<(), String> {
        let before = std::mem::replace(&mut self.kept.wanted, true);
        if self.stored_wanted {
            return Ok(());
        }
        self.save(effects).map_err(|fault| {
            self.kept.wanted = before;
            format!("{NOT_STORED}: {fault}")
        })
    }

    fn save(&mut self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let vehicle = effects.id;
        let lines = |areas: &Areas| {
            encode_messages(areas.messages(), Id::NULL, vehicle)
                .map_err(|cause| StoreError::new("areas", cause))
        };
        let record = Record {
            sent: lines(&self.sent)?,
            loaded: lines(&self.loaded)?,
            wanted: self.kept.wanted,
        };
        effects.disk().save(&vehicle, &record)?;
        self.stored_wanted = self.kept.wanted;
        Ok(())
    }

    /// Restores the areas after a restart.
    ///
    /// # Errors
    /// Their record exists but cannot be read.
    pub(super) fn restore(&mut self, effects: &mut Effects<'_>) -> Result<(), StoreError> {
        let vehicle = effects.id;
        let Some(record) = effects.disk().load::<Record>(&vehicle)? else {
            return Ok(());
        };
        let unreadable = |cause: String| record_fault("areas", vehicle, cause);
        self.sent = areas(&record.sent).map_err(unreadable)?;
        self.loaded = areas(&record.loaded).map_err(unreadable)?;
        // The configuration may have gained an area since the record was written.
        self.kept.wanted |= record.wanted;
        self.stored_wanted = record.wanted;
        Ok(())
    }
}

/// What an operator can do about areas that were not sent just now, and with which nothing is launched.
fn cure(fault: &AreaError) -> &'static str {
    match fault.configured {
        Some(_) => "it is one of vehicle.area in the configuration of this VSM",
        None => {
            "areas that a CUCS has loaded are kept over a restart of the VSM: clear them (50017, Area Plan Mode 1), or load others"
        }
    }
}

/// The areas of a record.
fn areas(lines: &[String]) -> Result<Areas, String> {
    let mut areas = Areas::default();
    for (_, message) in decode_messages(lines).map_err(|cause| cause.to_string())? {
        if let Message::AreaVertex(vertex) = message {
            areas.store(&vertex).map_err(|cause| cause.to_string())?;
        }
    }
    Ok(areas)
}

fn items(points: &[FencePoint]) -> Vec<Item> {
    points.iter().map(|point| point.item).collect()
}

/// The vehicle's action on a breach of the fence, by its own parameter.
fn advise_breach(context: &Context<'_>, effects: &mut Effects<'_>) {
    let Some(action) = context.parameters.get("GF_ACTION") else {
        return;
    };
    let what = match action as i64 {
        0 => "does nothing",
        1 => "only reports it",
        2 => "holds",
        3 => "returns",
        4 => "terminates its flight",
        5 => "lands",
        _ => "takes an action unknown to this VSM",
    };
    effects.advise(format!(
        "on a breach of the fence the vehicle {what} (GF_ACTION {action})"
    ));
}

fn report(
    effects: &mut Effects<'_>,
    station: usize,
    mode: Mode,
    state: MissionTransferStatus,
    vertex: Option<Vertex>,
) {
    let report = AreaTransferStatus {
        time_stamp: Some(effects.stamp()),
        ..status(mode, state, vertex)
    };
    effects.send(station, &report.into());
}

/// 50018 with status 2 for a 50017 that a restart of the VSM has cut off. The caller refuses it.
pub(super) fn cut_off(effects: &mut Effects<'_>, station: usize, mode: Option<Mode>) {
    let report = AreaTransferStatus {
        time_stamp: Some(effects.stamp()),
        area_plan_mode: mode,
        status: Some(MissionTransferStatus::Aborted),
        ..AreaTransferStatus::default()
    };
    effects.send(station, &report.into());
}

fn status(mode: Mode, status: MissionTransferStatus, vertex: Option<Vertex>) -> AreaTransferStatus {
    AreaTransferStatus {
        area_plan_mode: Some(mode),
        status: Some(status),
        area_id: vertex.map(|(area, _)| area),
        vertex_number: vertex.map(|(_, vertex)| vertex),
        ..AreaTransferStatus::default()
    }
}

/// The vertex of the item at which the vehicle refused.
fn vertex_of(points: &[FencePoint], fault: &Fault) -> Option<Vertex> {
    let point = points.get(fault.item()?)?;
    Some((point.area, point.vertex))
}

/// How long the vehicle takes to read this fence and to judge its mission within it.
fn judged_after(points: &[FencePoint]) -> Duration {
    let read_within: Duration = points.iter().map(|_| READ_WITHIN).sum();
    read_within + JUDGED_WITHIN
}

const KIND: MavMissionType = MavMissionType::MAV_MISSION_TYPE_FENCE;
/// Text of the cleared warning.
const UPLOADED: &str = "the fence is uploaded";
/// Text of the cleared warning.
const NO_LEG: &str = "no leg of the route aboard crosses an area of the fence any more";
const NONE_LOADED: &str =
    "no areas are loaded: those that were sent (50016) wait for a load (50017)";
/// PX4 v1.18 reads a vertex of its fence in two rounds of its navigator, at 20 Hz (geofence.cpp, DatamanCache::update): 40 vertices
/// have taken it 3 to 4 s. Half as much again.
const READ_WITHIN: Duration = Duration::from_millis(150);
/// Then it checks its mission.
const JUDGED_WITHIN: Duration = Duration::from_secs(1);
const NOT_STORED: &str = "what the vehicle holds cannot be stored";
